"""Simulated campaigns: a scenario becomes poses, settled arms and readings.

Section 5 as data: full poses of the tool read under wrenches along every axis, then checked elsewhere.

Of an arm without joints (section 5.1) there is one pose; of a six-axis arm (section 5.2) there are many.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Literal, Self, TypeVar

import numpy as np
from pydantic import Field, ModelWrapValidatorHandler, ValidationError, model_validator

from testbench.arm.document import StrictModel, first_invalid_value
from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset, concatenate_rows, line_precision, select_rows, split_by_pose
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, PoseError, check_type
from testbench.model.vjm import WorkArea, marker_positions, tool_points, tool_poses
from testbench.plant.tracker import (
    DistanceMeter,
    Gauge,
    IsotropicTracker,
    PlaneProbe,
    read_orientations,
    read_positions,
)
from testbench.plant.true_arms import draw_true_plant
from testbench.runs.rows import trial_rng
from testbench.workflows.cell import Cell, clear_poses
from testbench.workflows.instruments import Mounted, check_markers

if TYPE_CHECKING:  # importing MuJoCo takes a sixth of a second, and --help does without
    from testbench.plant.build import Plant
    from testbench.plant.equilibrium import ArmEquilibrium

    Pair = tuple[ArmEquilibrium, ArmEquilibrium]

# --- Section 6 as data: a gravity calibration, its poses, loads and readings --------------------------------

T = TypeVar("T")
Truth = Literal["nonlinear", "linear"]


class Setup(StrictModel):
    """Describe a campaign as data: a manifest holds it to run the campaign again."""

    arm: str  #: The arm's folder.
    #: "nonlinear" solves the arm's equilibrium in MuJoCo; "linear" takes its first-order deflection,
    #: weightless.
    truth: Truth
    noise: bool = True  #: Whether readings are noisy.
    #: Standard deviation of one position reading along one axis [m]; also the weight of the fit.
    sigma: float

    @model_validator(mode="wrap")
    @classmethod
    def _in_one_line(cls, given: object, handler: ModelWrapValidatorHandler[Self]) -> Self:
        try:
            return handler(given)
        except ValidationError as err:
            keys, kind, problem = first_invalid_value(err)
            place = ".".join(map(str, keys))
            if kind == "extra_forbidden":
                problem = f"no such field; fields are {', '.join(cls.model_fields)}"
            elif kind == "missing":
                problem = "this field is missing"
            else:
                problem += " (SI units)"
            raise BenchError(f"{cls.__name__}: {place}: {problem}") from err

    @property
    def sigmas(self) -> tuple[float, float | None]:
        """Return the standard deviation of a position [m] and of an orientation [rad], None if not read."""
        return self.sigma, None


SECTION_6 = "kr500_l480"
"""The arm of section 6: its scenarios have the payload and the areas of that campaign."""
SECTION_6_AREA = WorkArea((1.7, -0.9, 1.1), (2.7, 0.9, 2.1), (1.0, 0.0, 0.0), np.pi / 4)
"""Work area of the calibration poses in section 6."""
SECTION_6_WORKSPACE = WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0))
"""The whole workspace above the floor in section 6."""


def _as_in_section_6(value: T) -> Callable[[dict[str, object]], T | None]:
    """A default that holds for the arm of section 6 and is None for any other."""
    return lambda known: value if known.get("arm") == SECTION_6 else None


class Scenario(Setup):
    """Describe a simulated gravity calibration as in section 6, of any arm."""

    #: Hung mass [kg]; None for the payload that the arm states.
    payload: float | None = Field(default_factory=_as_in_section_6(460.3), ge=0.001, le=10_000)
    sigma: float = Field(default=50e-6, ge=1e-9, le=0.01)
    truth: Truth = "nonlinear"
    #: Work area of the calibration poses; None for all that the arm reaches.
    station: WorkArea | None = Field(default_factory=_as_in_section_6(SECTION_6_AREA))
    #: Area of the second check, the whole workspace above the floor; None for all that the arm reaches.
    workspace: WorkArea | None = Field(default_factory=_as_in_section_6(SECTION_6_WORKSPACE))
    identification_poses: int = Field(default=8, ge=1, le=1000)  #: Poses to identify from.
    check_poses: int = Field(default=3, ge=1, le=1000)  #: Poses never used for it.
    #: Runs over the identification poses; some poses are measured twice.
    identification_runs: int = Field(default=15, ge=1, le=10_000)
    check_runs: int = Field(default=6, ge=1, le=10_000)  #: Runs over the check poses.
    workspace_poses: int = Field(default=200, ge=1, le=10_000)  #: Poses of the second check.

    @property
    def mass(self) -> float:
        """Return the mass of the payload [kg]; BenchError if neither scenario nor arm states one."""
        if self.payload is None:
            raise BenchError(f"payload [kg]: expected a payload, as {self.arm} states none")
        return self.payload


def of_arm(arm: Arm, scenario: Scenario) -> Scenario:
    """Fill in the payload of the arm if the scenario states none.

    Args:
        arm: The arm.
        scenario: The scenario.

    Returns:
        The scenario with a payload, if the arm has one.
    """
    return scenario if scenario.payload else scenario.model_copy(update={"payload": arm.payload})


@dataclass(frozen=True, repr=False)
class Campaign(Displayed):
    """Hold a simulated campaign: its readings, and the truth to judge a model by.

    It is of section 6 (`simulate`) or of section 5 (`simulate_full_pose`).
    """

    scenario: Setup  #: Settings of the campaign.
    seed: int  #: Root of all randomness.
    measured: Dataset  #: All measured runs, in the order of the dataset file.
    identification: Dataset  #: Runs to identify from.
    check: Dataset  #: Runs in poses that are never used for identification.
    check_true: Dataset  #: The check runs without noise.
    truth: Dataset  #: Runs without noise, over the whole workspace in section 6, the check runs in section 5.
    drawn: int = 0  #: In section 5 check runs drawn until enough had a deflection in range.

    def summary(self) -> dict[str, object]:
        """Summarise arm, seed, and the runs to identify from, to check with and to judge by."""
        own: dict[str, object] = {"arm": self.scenario.arm, "seed": self.seed}
        for name in ("identification", "check", "truth"):
            data = getattr(self, name)
            own[name] = f"{data.n_runs} runs in {len(np.unique(data.pose_id))} poses"
        return own | {"sigma_um": f"{1e6 * self.measured.sigma:g}"}


def simulate(cell: Cell, scenario: Scenario | None = None, seed: int = 1) -> Campaign:
    """Simulate a campaign: choose poses, load the true arm in each, and read the markers.

    Args:
        cell: The arm.
        scenario: Settings of the campaign; None for that of section 6 under the payload of the arm.
        seed: Root of all randomness.

    Returns:
        Runs to identify from, runs to check with, and true deflections over the workspace.

    Raises:
        BenchError: When an argument has another type, neither scenario nor arm states a payload, the scenario
            is of another arm, or the seed is no integer from 0 on.
        PoseError: When too few feasible poses exist.
        NoEquilibrium: When the arm cannot carry the payload.
    """
    check_type(cell, Cell, "cell")
    check_type(scenario, (Scenario, NoneType), "scenario")
    scenario = of_arm(cell.arm, Scenario(arm=cell.arm.name) if scenario is None else scenario)
    if Path(scenario.arm).name != cell.arm.name:
        raise BenchError(f"scenario: expected a scenario for {cell.arm.name!r}, got one for {scenario.arm!r}")
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise BenchError(f"seed: expected an integer from 0 on, got {seed!r}")
    return simulate_at(cell, scenario, seed, draw_poses(cell, scenario, seed))


@dataclass(frozen=True)
class CampaignPoses:
    """Hold the poses of a campaign; they depend neither on truth nor on payload."""

    station: Array  #: Poses to identify from, then those of the check runs, (poses, n) [rad, m].
    anywhere: Array  #: Poses of the second check, (workspace_poses, n) [rad, m].


def draw_poses(cell: Cell, scenario: Scenario, seed: int) -> CampaignPoses:
    """Draw the poses of a campaign.

    Args:
        cell: The arm.
        scenario: Numbers of poses, and their areas.
        seed: Root of all randomness.

    Returns:
        The poses.

    Raises:
        PoseError: If too few are feasible.
    """
    rng = trial_rng(seed, 0)
    count = scenario.identification_poses + scenario.check_poses
    station = clear_poses(cell, scenario.station, count, rng)
    return CampaignPoses(station, clear_poses(cell, scenario.workspace, scenario.workspace_poses, rng))


def simulate_at(cell: Cell, scenario: Scenario, seed: int, poses: CampaignPoses) -> Campaign:
    """Simulate a campaign in given poses.

    Args:
        cell: The arm.
        scenario: Settings; its numbers of poses are those given.
        seed: Seed of the noise.
        poses: The poses.

    Returns:
        The campaign.
    """
    pose = np.concatenate(
        [
            spread(scenario.identification_poses, scenario.identification_runs),
            scenario.identification_poses + spread(scenario.check_poses, scenario.check_runs),
        ]
    )
    loaded = poses_with_weight(cell, poses.station[pose], pose + 1, scenario.mass)
    measured, true = measure_both(cell, scenario, loaded, trial_rng(seed, 1))
    everywhere = poses_with_weight(cell, poses.anywhere, np.arange(len(poses.anywhere)) + 1, scenario.mass)
    (fitted, check), (_, check_true) = (
        split_by_pose(data, np.arange(scenario.identification_poses) + 1) for data in (measured, true)
    )
    return Campaign(
        scenario, seed, measured, fitted, check, check_true, measure_markers(cell, scenario, everywhere)
    )


def spread(poses: int, runs: int) -> Ids:
    """Distribute runs evenly over poses.

    Args:
        poses: Number of poses.
        runs: Number of runs.

    Returns:
        Pose of every run, sorted, (runs,); poses differ by one run at most.
    """
    return np.sort(np.arange(runs) % poses)


@dataclass(frozen=True)
class LoadedPoses:
    """Describe what is measured: one pose and one load per run."""

    q: Array  #: Actuated joints, (runs, n) [rad, m].
    pose_id: Ids  #: Identifier of the pose, (runs,).
    wrench: Array  #: Force and moment, world axes, (runs, 6) [N, N m].
    point: Array  #: Point where the load acts, in the tool's frame, (runs, 3) [m].


def poses_with_weight(cell: Cell, q: Array, pose: Ids, mass: float | Array) -> LoadedPoses:
    """Load poses with a weight at the arm's load point.

    Args:
        cell: The arm.
        q: Actuated joints, (runs, n) [rad, m].
        pose: Identifier of every pose, (runs,).
        mass: One mass for all runs, or one each, (runs,) [kg].

    Returns:
        The loaded poses.
    """
    wrench = np.zeros((len(q), 6))
    wrench[:, 2] = -GRAVITY * mass
    return LoadedPoses(q, pose, wrench, np.tile(cell.plant.load_point, (len(q), 1)))


def measure_markers(
    cell: Cell, setup: Setup, loaded: LoadedPoses, rng: np.random.Generator | None = None
) -> Dataset:
    """Read every marker before and after loading, and the tool's orientation if the setup reads it.

    Args:
        cell: The arm.
        setup: Kind of truth, and noise.
        loaded: Poses and loads.
        rng: Source of the noise; None for readings without noise.

    Returns:
        The runs.
    """
    settled = settle_both(cell.plant, setup.truth, loaded.q, loaded.wrench, loaded.point)
    return read_markers(cell, setup, loaded, settled, rng)


def measure_both(
    cell: Cell, setup: Setup, loaded: LoadedPoses, rng: np.random.Generator
) -> tuple[Dataset, Dataset]:
    """Read runs with noise and without, from one pair of equilibria.

    Args:
        cell: The arm.
        setup: Kind of truth, and noise.
        loaded: Poses and loads.
        rng: Source of the noise.

    Returns:
        The runs with noise, and without.
    """
    settled = settle_both(cell.plant, setup.truth, loaded.q, loaded.wrench, loaded.point)
    return read_markers(cell, setup, loaded, settled, rng), read_markers(cell, setup, loaded, settled)


def read_markers(
    cell: Cell, setup: Setup, loaded: LoadedPoses, settled: "Pair", rng: np.random.Generator | None = None
) -> Dataset:
    """Read the arm at rest, unloaded and loaded.

    Args:
        cell: The arm.
        setup: Noise of the readings.
        loaded: Poses and loads.
        settled: Unloaded and loaded equilibria.
        rng: Source of the noise; None for readings without noise.

    Returns:
        The runs.
    """
    sigma, sigma_rotation = setup.sigmas
    tracker = IsotropicTracker(sigma, sigma_rotation) if setup.noise and rng else IsotropicTracker(0.0, 0.0)
    rng, runs = rng or trial_rng(0), np.arange(len(loaded.q)) + 1  # of no effect: the tracker has no noise
    before, after = (read_positions(tracker, rest.marker_positions, rng) for rest in settled)
    data = Dataset(cell.arm.markers, runs, **vars(loaded), before=before, after=after, sigma=sigma)
    if sigma_rotation is None:
        return data
    before, after = (read_orientations(tracker, rest.tool_rotations, rng) for rest in settled)
    return replace(data, rotation_before=before, rotation_after=after, sigma_rotation=sigma_rotation)


def settle_both(plant: "Plant", truth: Truth, q: Array, wrench: Array, point: Array) -> "Pair":
    """Find the equilibria of the true arm, unloaded and loaded, in one call.

    A second call costs as much as 20 poses.

    Args:
        plant: The true arm.
        truth: "nonlinear" or "linear".
        q: Actuated joints, (runs, n) [rad, m].
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Point where the force acts, in the tool's frame, (runs, 3) [m].

    Returns:
        The unloaded and the loaded equilibria.
    """
    from testbench.plant.equilibrium import (
        solve_equilibrium,
        solve_linear_equilibrium,
        solve_unloaded_and_loaded,
    )

    if (
        truth == "nonlinear"
        and plant.spring_effects is not None
        and plant.spring_effects.max_slip_half_width is not None
    ):
        return solve_unloaded_and_loaded(plant, q, wrench, point)  # where it stood decides where it comes to
    runs, find = len(q), solve_linear_equilibrium if truth == "linear" else solve_equilibrium
    loads = np.concatenate([np.zeros_like(wrench), wrench])
    rest = find(plant, np.concatenate([q, q]), loads, np.concatenate([point, point]))
    return select_rows(rest, slice(runs)), select_rows(rest, slice(runs, None))


def true_cell(cell: Cell, name: str, seed: int, stiffer: float = 1.0) -> Cell:
    """Give a cell another true arm, a new one for every seed; its model stays.

    Args:
        cell: The cell.
        name: Kind of truth, a name of `true_arms`.
        seed: Seed of the true arm's random numbers.
        stiffer: How many times stiffer its links are [1].

    Returns:
        The cell with that truth.

    Raises:
        BenchError: When there is no such kind, or what it draws is no arm of the same joints and links.
    """
    check_type(cell, Cell, "cell")
    return replace(cell, truth=draw_true_plant(cell.arm, name, trial_rng(seed, 8), stiffer))


# --- Section 5 as data --------------------------------------------------------------------------------------

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
    q = cell.arm.draw_poses(poses_rng, scenario.poses)
    loads = np.diag([scenario.force] * 3 + [scenario.moment] * 3)
    pose = np.repeat(np.arange(scenario.poses), 6)
    wrench = np.tile(loads, (scenario.poses, 1))
    check_q, check_wrench, drawn = _check_runs(cell, scenario, poses_rng)
    ids = scenario.poses + np.arange(scenario.check_runs) + 1
    checks = at_tool(check_q, ids, check_wrench)
    identification = measure_markers(cell, scenario, at_tool(q[pose], pose + 1, wrench), noise_rng)
    check, true = measure_both(cell, scenario, checks, noise_rng)
    both = concatenate_rows([identification, check])
    measured = replace(both, run_id=np.arange(both.n_runs) + 1)
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
        q = cell.arm.draw_poses(rng, POSES_PER_BATCH)
        wrench = random_wrenches(POSES_PER_BATCH, scenario.force, scenario.moment, rng)
        rest, loaded = settle_both(cell.plant, "linear", q, wrench, np.zeros((POSES_PER_BATCH, 3)))
        size = np.linalg.norm(loaded.tool_positions - rest.tool_positions, axis=1)
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


# --- What instruments around a cell read --------------------------------------------------------------------


def read_instruments(
    cell: Cell, truth: Truth, loaded: LoadedPoses, mounted: Sequence[Mounted], rng: np.random.Generator
) -> Dataset:
    """Read the arm at rest, unloaded and loaded, with several instruments at once.

    Instruments that share a marker are read one after the other: then there are several runs per load.

    Args:
        cell: The arm.
        truth: Kind of truth.
        loaded: Poses and loads.
        mounted: The instruments.
        rng: Source of the instruments' errors.

    Returns:
        The runs: along lines, positions, or both; markers without an instrument are neither read nor lost.

    Raises:
        BenchError: When a marker is none of the arm's, or a probe of orientations is not the only instrument.
    """
    check_markers(cell, mounted)
    if any(isinstance(own.instrument, PlaneProbe) for own in mounted):
        raise BenchError("--instrument: a plane needs --absolute; a gauge reads deflections")
    probes = [
        own
        for own in mounted
        if isinstance(own.instrument, IsotropicTracker) and own.instrument.sigma_rotation
    ]
    if not mounted or (probes and len(mounted) > 1):
        raise BenchError(
            "instruments: expected one or more; a probe of orientations cannot be combined with others"
        )
    settled = settle_both(cell.plant, truth, loaded.q, loaded.wrench, loaded.point)
    lines = any(not isinstance(own.instrument, IsotropicTracker) for own in mounted)
    parts = [_read(cell, loaded, settled, layer, rng, lines=lines) for layer in _layers(cell, mounted)]
    data = concatenate_rows(parts)
    order = np.argsort(np.tile(np.arange(len(loaded.q)), len(parts)), kind="stable")
    return replace(select_rows(data, order), run_id=np.arange(data.n_runs) + 1)


def _layers(cell: Cell, mounted: Sequence[Mounted]) -> list[list[Mounted]]:
    """Split instruments into layers in each of which every marker is read once."""
    layers: list[tuple[set[str], list[Mounted]]] = []
    for own in mounted:
        markers = {own.marker} if own.marker else set(cell.arm.markers)
        layer = next((layer for layer in layers if not layer[0] & markers), None)
        if layer is None:
            layer = (set(), [])
            layers.append(layer)
        layer[0].update(markers)
        layer[1].append(own)
    return [own for _, own in layers]


def _read(
    cell: Cell,
    loaded: LoadedPoses,
    settled: "Pair",
    layer: Sequence[Mounted],
    rng: np.random.Generator,
    *,
    lines: bool,
) -> Dataset:
    """Read instruments of different markers; with fields of lines if any instrument reads along one."""
    markers, runs = cell.arm.markers, len(loaded.q)
    read, P = np.zeros((2, runs, len(markers), 3)), np.zeros((runs, len(markers), 3, 3))
    direction = np.zeros(read.shape[1:])
    tilt = np.zeros(P.shape[:2])
    reach = np.zeros(P.shape[:2])
    turned: dict[str, object] = {}
    for own in layer:
        if isinstance(own.instrument, IsotropicTracker):
            some = [markers.index(own.marker)] if own.marker else list(range(len(markers)))
            read[:, :, some] = [
                read_positions(own.instrument, equilibrium.marker_positions[:, some], rng)
                for equilibrium in settled
            ]
            P[:, some] = np.eye(3) / (2 * own.instrument.sigma**2)
            if own.instrument.sigma_rotation:
                both = [
                    read_orientations(own.instrument, equilibrium.tool_rotations, rng)
                    for equilibrium in settled
                ]
                turned = dict(zip(("rotation_before", "rotation_after"), both, strict=True))
                turned["sigma_rotation"] = own.instrument.sigma_rotation
            continue
        k = markers.index(own.marker)
        u, tilt[:, k], reach[:, k] = _line(cell, loaded.q, own)
        places = tuple(equilibrium.marker_positions[:, k] for equilibrium in settled)
        if isinstance(own.instrument, Gauge):
            rotations = tuple(equilibrium.tool_rotations for equilibrium in settled)
            numbers = own.instrument.read(u, places, rotations, loaded.pose_id, rng)  # type: ignore[arg-type]
        else:
            assert isinstance(own.instrument, DistanceMeter)
            numbers = own.instrument.read(np.asarray(own.fixed), places, rng)  # type: ignore[arg-type]
        lost = np.asarray(np.isnan(numbers).any(axis=0))
        direction[:, k] = u
        read[:, :, k] = np.nan_to_num(numbers)[..., None] * u
        P[:, k] = line_precision(u, own.instrument.sigma) * ~lost[:, None, None]
    whole = not lines and bool(P.any(axis=(2, 3)).all())
    return Dataset(
        markers=markers,
        run_id=np.arange(runs) + 1,
        **vars(loaded),
        before=read[0],
        after=read[1],
        sigma=layer[0].instrument.sigma,
        precision=None if whole else P,
        line_direction=direction if lines else None,
        line_direction_deviation=tilt if lines else None,
        line_length=reach if lines else None,
        **turned,  # type: ignore[arg-type]
    )


def _line(cell: Cell, q: Array, own: Mounted) -> tuple[Array, Array, Array]:
    """Compute direction, its standard deviation and reach in every pose, as they are said to be."""
    if isinstance(own.instrument, Gauge):
        u = np.broadcast_to(np.asarray(own.direction, dtype=float), (len(q), 3))
        u = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), np.finfo(float).tiny)
        if own.on_tool:
            u = np.matvec(tool_poses(cell.vjm, q)[1], u)
        return u, np.full(len(q), own.instrument.tilt_sigma), np.zeros(len(q))
    assert isinstance(own.instrument, DistanceMeter)
    assert own.fixed is not None
    beam = tool_points(cell.vjm, q, marker_positions(cell.vjm, (own.marker,)))[:, 0] - own.fixed
    reach = np.linalg.norm(beam, axis=1)
    return beam / reach[:, None], own.instrument.fixed_point_sigma / reach, reach
