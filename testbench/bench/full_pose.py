"""Section 5 as data: full poses of the tool read under wrenches along every axis, then checked elsewhere.

Of an arm without joints (section 5.1) there is one pose; of a six-axis arm (section 5.2) there are many.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from testbench.bench.campaign import Cell, LoadedPoses, Model, Truth, settle_both, stream
from testbench.data.dataset import Dataset, Ids
from testbench.data.tracker import Tracker, read_orientations, read_positions
from testbench.errors import Array, PoseError
from testbench.identify import Estimate
from testbench.identify.evaluate import Score, predict, score
from testbench.plant import settle_linear

BATCH = 120
MAX_BATCHES = 200


class FullPose(BaseModel):
    """A campaign of section 5 as data: what a manifest must hold to run it again."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)

    arm: str  #: The arm's folder.
    poses: int = Field(default=18, ge=1, le=1000)  #: Random poses to identify from, within the joint limits.
    force: float = Field(default=1000.0, gt=0, le=1e6)  #: Force along each axis in turn, at the tool [N].
    moment: float = Field(default=1000.0, gt=0, le=1e6)  #: Moment about each axis in turn [N m].
    #: Standard deviation of one position reading along one axis [m].
    sigma: float = Field(default=25e-6, ge=1e-9, le=0.01)
    #: The same of one orientation reading [rad].
    sigma_rotation: float = Field(default=250e-6, ge=1e-9, le=0.1)
    #: "nonlinear" settles the arm with MuJoCo; "linear" takes its first-order deflection, weightless.
    truth: Truth = "linear"
    noise: bool = True  #: Whether readings are noisy.
    #: Runs to check with, each in a pose and under a wrench of its own.
    check_runs: int = Field(default=120, ge=1, le=10_000)
    least: float = Field(default=0.0, ge=0, le=1)  #: Least deflection of a check run [m].
    most: float = Field(default=1.0, gt=0, le=1)  #: Greatest deflection of a check run [m].


@dataclass(frozen=True)
class Campaign:
    """What was measured, and what it is checked with."""

    scenario: FullPose  #: What was asked for.
    seed: int  #: Root of all randomness.
    identification: Dataset  #: Noisy readings of six runs a pose.
    check: Dataset  #: Noisy readings of the check runs, in other poses under other wrenches.
    truth: Dataset  #: The check runs without noise.
    drawn: int  #: Check runs drawn until enough had a deflection in range.


@dataclass(frozen=True)
class Result:
    """One model, identified and judged."""

    model: Model  #: What was asked for.
    estimate: Estimate  #: What was found.
    identification: Score  #: Errors on the readings that it was identified from.
    check: Score  #: Errors on the check runs, against their true deflection.
    readings: Score  #: Errors on the check runs, against their readings.
    seconds: float  #: Wall time of the estimator.


def simulate(cell: Cell, scenario: FullPose, seed: int) -> Campaign:
    """Draw poses and wrenches, load the true arm, and read the tool's pose.

    Poses, wrenches and noise do not depend on the kind of truth.

    Args:
        cell: The arm.
        scenario: What to measure.
        seed: Root of all randomness.

    Raises:
        PoseError: When too few runs have a deflection in the range that is asked for.
        NoEquilibrium: When the arm cannot carry a load.
    """
    poses_rng, noise_rng = stream(seed, 0), stream(seed, 1)
    q = _random_q(cell, scenario.poses, poses_rng)
    loads = np.diag([scenario.force] * 3 + [scenario.moment] * 3)
    pose = np.repeat(np.arange(scenario.poses), 6)
    wrench = np.tile(loads, (scenario.poses, 1))
    check_q, check_wrench, drawn = _check_runs(cell, scenario, poses_rng)
    ids = scenario.poses + np.arange(scenario.check_runs) + 1
    checks = at_tool(check_q, ids, check_wrench)
    return Campaign(
        scenario=scenario,
        seed=seed,
        identification=read_runs(cell, scenario, at_tool(q[pose], pose + 1, wrench), noise_rng),
        check=read_runs(cell, scenario, checks, noise_rng),
        truth=read_runs(cell, scenario, checks, None),
        drawn=drawn,
    )


def _random_q(cell: Cell, count: int, rng: np.random.Generator) -> Array:
    lower, upper = cell.arm.limits
    return rng.uniform(lower, upper, (count, cell.arm.n_joints))


def random_wrenches(count: int, force: float, moment: float, rng: np.random.Generator) -> Array:
    """Wrenches of random direction with force and moment of these magnitudes, (count, 6) [N, N m]."""
    directions = rng.standard_normal((count, 2, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return np.asarray((directions * [[force], [moment]]).reshape(count, 6))


def _check_runs(cell: Cell, scenario: FullPose, rng: np.random.Generator) -> tuple[Array, Array, int]:
    """Random poses and wrenches whose first-order deflection is in range; and how many were drawn."""
    kept_q, kept_wrench = np.empty((0, cell.arm.n_joints)), np.empty((0, 6))
    for k in range(1, MAX_BATCHES + 1):
        q = _random_q(cell, BATCH, rng)
        wrench = random_wrenches(BATCH, scenario.force, scenario.moment, rng)
        zero = np.zeros((BATCH, 3))
        moved = [settle_linear(cell.plant, q, load, zero).tool for load in (0 * wrench, wrench)]
        size = np.linalg.norm(moved[1] - moved[0], axis=1)
        inside = (size >= scenario.least) & (size <= scenario.most)
        kept_q, kept_wrench = np.vstack([kept_q, q[inside]]), np.vstack([kept_wrench, wrench[inside]])
        if len(kept_q) >= scenario.check_runs:
            return kept_q[: scenario.check_runs], kept_wrench[: scenario.check_runs], k * BATCH
    raise PoseError(
        f"found {len(kept_q)} of {scenario.check_runs} check runs with a deflection of "
        f"{1e3 * scenario.least:g} to {1e3 * scenario.most:g} mm among {MAX_BATCHES * BATCH} drawn; widen "
        "the range or change the loads"
    )


def at_tool(q: Array, pose: Ids, wrench: Array) -> LoadedPoses:
    """Poses with a load at the tool.

    Args:
        q: Actuated joint angles, (runs, n) [rad].
        pose: Identifier of the pose of every run, (runs,).
        wrench: World axes, (runs, 6) [N, N m].
    """
    return LoadedPoses(q, pose, wrench, np.zeros((len(q), 3)))


def read_runs(
    cell: Cell, scenario: FullPose, loaded: LoadedPoses, rng: np.random.Generator | None
) -> Dataset:
    """Full pose of the tool before and after loading.

    Args:
        cell: The arm.
        scenario: Kind of truth, and the sigmas.
        loaded: The runs.
        rng: Source of the noise; None for readings without noise.
    """
    before, after = settle_both(cell.plant, scenario.truth, loaded.q, loaded.wrench, loaded.point)
    noisy = scenario.noise and rng is not None
    tracker = Tracker(scenario.sigma, scenario.sigma_rotation) if noisy else Tracker(0.0, 0.0)
    rng = stream(0) if rng is None else rng  # of no effect: the tracker has no noise
    return Dataset(
        markers=cell.arm.markers,
        run=np.arange(len(loaded.q)) + 1,
        pose=loaded.pose,
        q=loaded.q,
        wrench=loaded.wrench,
        point=loaded.point,
        before=read_positions(tracker, before.markers, rng),
        after=read_positions(tracker, after.markers, rng),
        sigma=scenario.sigma,
        rotation_before=read_orientations(tracker, before.rotation, rng),
        rotation_after=read_orientations(tracker, after.rotation, rng),
        sigma_rotation=scenario.sigma_rotation,
    )


def identify(
    cell: Cell, campaign: Campaign, models: Sequence[Model], clock: Callable[[], float]
) -> list[Result]:
    """Identify every model from the campaign and judge it on the check runs.

    Args:
        cell: The arm.
        campaign: The data.
        models: What to identify, and how.
        clock: Wall time [s], such as time.perf_counter.
    """
    results = []
    for model in models:
        start = clock()
        estimate = model.estimator(cell.vjm, model.structure, campaign.identification)
        results.append(judge(cell, campaign, model, estimate, clock() - start))
    return results


def judge(cell: Cell, campaign: Campaign, model: Model, estimate: Estimate, seconds: float) -> Result:
    """Score an estimate on the runs that it was identified from, and on the check runs."""
    predicted = predict(cell.vjm, estimate, campaign.check)
    fitted = predict(cell.vjm, estimate, campaign.identification)
    return Result(
        model=model,
        estimate=estimate,
        identification=score(fitted, campaign.identification.deflection),
        check=score(predicted, campaign.truth.deflection),
        readings=score(predicted, campaign.check.deflection),
        seconds=seconds,
    )
