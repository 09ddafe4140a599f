"""Section 5 as data: full poses of the tool read under wrenches along every axis, then checked elsewhere.

Of an arm without joints (section 5.1) there is one pose; of a six-axis arm (section 5.2) there are many.
"""

from dataclasses import replace

import numpy as np
from pydantic import Field

from testbench.data.dataset import join_rows
from testbench.errors import Array, Ids, PoseError
from testbench.plant.equilibrium import solve_linear_equilibrium
from testbench.plant.tracker import trial_rng
from testbench.workflows.cell import Campaign, Cell, LoadedPoses, Setup, Truth, measure_both, measure_markers

POSES_PER_BATCH = 120
MAX_BATCHES = 200


class FullPose(Setup):
    """Describe a campaign of section 5."""

    poses: int = Field(default=18, ge=1, le=1000)  #: Random poses to identify from, within the joint limits.
    force: float = Field(default=1000.0, gt=0, le=1e6)  #: Force along each axis in turn, at the tool [N].
    moment: float = Field(default=1000.0, gt=0, le=1e6)  #: Moment about each axis in turn [N m].
    sigma: float = Field(default=25e-6, ge=1e-9, le=0.01)
    #: Standard deviation of one orientation reading [rad].
    sigma_rotation: float = Field(default=250e-6, ge=1e-9, le=0.1)
    truth: Truth = "linear"
    #: Runs to check with, each in a pose and under a wrench of its own.
    check_runs: int = Field(default=120, ge=1, le=10_000)
    least: float = Field(default=0.0, ge=0, le=1)  #: Least deflection of a check run [m].
    most: float = Field(default=1.0, gt=0, le=1)  #: Greatest deflection of a check run [m].

    @property
    def sigmas(self) -> tuple[float, float | None]:
        """Return the standard deviations of a position [m] and of an orientation [rad]."""
        return self.sigma, self.sigma_rotation


def simulate_full_pose(cell: Cell, scenario: FullPose, seed: int) -> Campaign:
    """Draw poses and wrenches, load the true arm, and read the tool's pose.

    Poses, wrenches and noise do not depend on the kind of truth.

    Args:
        cell: The arm with its model and its truth.
        scenario: The campaign as data.
        seed: Root of all randomness.

    Returns:
        The campaign.
    """
    poses_rng, noise_rng = trial_rng(seed, 0), trial_rng(seed, 1)
    q = cell.arm.drawn(poses_rng, scenario.poses)
    loads = np.diag([scenario.force] * 3 + [scenario.moment] * 3)
    pose = np.repeat(np.arange(scenario.poses), 6)
    wrench = np.tile(loads, (scenario.poses, 1))
    check_q, check_wrench, drawn = _check_runs(cell, scenario, poses_rng)
    ids = scenario.poses + np.arange(scenario.check_runs) + 1
    checks = at_tool(check_q, ids, check_wrench)
    identification = measure_markers(cell, scenario, at_tool(q[pose], pose + 1, wrench), noise_rng)
    check, true = measure_both(cell, scenario, checks, noise_rng)
    both = join_rows([identification, check])
    measured = replace(both, run=np.arange(both.runs) + 1)
    return Campaign(scenario, seed, measured, identification, check, true, true, drawn)


def random_wrenches(count: int, force: float, moment: float, rng: np.random.Generator) -> Array:
    """Draw wrenches of random direction with force and moment of given magnitudes.

    Args:
        count: Number of wrenches.
        force: Magnitude of the force [N].
        moment: Magnitude of the moment [N m].
        rng: Source of randomness.

    Returns:
        Wrenches, (count, 6) [N, N m].
    """
    directions = rng.standard_normal((count, 2, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return np.asarray((directions * [[force], [moment]]).reshape(count, 6))


def _check_runs(cell: Cell, scenario: FullPose, rng: np.random.Generator) -> tuple[Array, Array, int]:
    """Random poses and wrenches whose first-order deflection is in range; and how many were drawn."""
    kept_q, kept_wrench = np.empty((0, cell.arm.n_joints)), np.empty((0, 6))
    for k in range(1, MAX_BATCHES + 1):
        q = cell.arm.drawn(rng, POSES_PER_BATCH)
        wrench = random_wrenches(POSES_PER_BATCH, scenario.force, scenario.moment, rng)
        zero = np.zeros((POSES_PER_BATCH, 3))
        moved = [solve_linear_equilibrium(cell.plant, q, load, zero).tool for load in (0 * wrench, wrench)]
        size = np.linalg.norm(moved[1] - moved[0], axis=1)
        inside = (size >= scenario.least) & (size <= scenario.most)
        kept_q, kept_wrench = np.vstack([kept_q, q[inside]]), np.vstack([kept_wrench, wrench[inside]])
        if len(kept_q) >= scenario.check_runs:
            return kept_q[: scenario.check_runs], kept_wrench[: scenario.check_runs], k * POSES_PER_BATCH
    raise PoseError(
        f"found {len(kept_q)} of {scenario.check_runs} check runs with a deflection of "
        f"{1e3 * scenario.least:g} to {1e3 * scenario.most:g} mm among {MAX_BATCHES * POSES_PER_BATCH} "
        f"drawn; widen "
        "the range or change the loads"
    )


def at_tool(q: Array, pose: Ids, wrench: Array) -> LoadedPoses:
    """Make poses with a load at the tool.

    Args:
        q: Poses, (poses, n) [rad, m].
        pose: Pose of every run, (runs,).
        wrench: Force and moment, world axes, (runs, 6) [N, N m].

    Returns:
        The loaded poses.
    """
    return LoadedPoses(q, pose, wrench, np.zeros((len(q), 3)))
