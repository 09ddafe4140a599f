"""Settings of the study of corrections, and what is made once for all trials.

Two jobs on a curved panel, the robot's program, and plans among candidate poses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Annotated

import numpy as np
import typer
from pydantic import Field

from testbench.arm.folder import find_arm
from testbench.correct.inverse import joints_along
from testbench.correct.stiffness import process_wrench
from testbench.design.planning import make_plan
from testbench.design.refine import Feasibility
from testbench.design.rows import MeasurementSetup, Specification, Tasks
from testbench.errors import Array, BenchError
from testbench.identify.metric import scale_by_prior
from testbench.model.load import Load, weight
from testbench.model.poses import WorkArea
from testbench.plant.site import Payload
from testbench.plant.tracker import Station, trial_rng
from testbench.studies.study import DEFAULT_WITHOUT_CONE, Everywhere
from testbench.workflows.candidates import Checks, PoseConditions, build_checks, feasible, find
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.models import JOINTS, named_models
from testbench.workflows.perturbed_prior import UNCERTAINTY, wrong_prior

NAME = "compensation"
ARM = "kr500_l480"  #: The panel stands in its work area.
PAYLOAD, PULL, SLING = 460.3, 3000.0, 0.5
"""Hung mass [kg], pull of the rope along world y at the load point [N], and length of the sling [m]."""
RUNS = 2  #: In every pose.
SIGMA = 50e-6  #: Standard deviation of one reading along one axis [m].
STATION = (4.5, -2.5, 1.6)  #: Of the tracker [m].
AREA = WorkArea((1.7, -0.9, 1.1), (2.7, 0.9, 2.1), (1.0, 0.0, 0.0), np.pi / 4)
"""Where the panel stands: the work area of section 6."""
PLANNED, RANDOM = "planned", "random"
WEIGHT, BOTH = "weight", "weight and pull"
"""What loads the arm while it is measured: in every pose the weight, or in every pose one of both."""
FEATURED = 12  #: Poses that the bars are about, and those of all campaigns of a disturbed arm.
IDEAL, LINEAR, REAL = "undisturbed", "linear joints", "disturbed"
"""How a true arm is disturbed: not at all; in all but that its joints are linear springs; in all."""
ARMS = (IDEAL, LINEAR, REAL)
NUMBERS, QUICK_NUMBERS = (6, 12, 20), (FEATURED,)
CANDIDATES, QUICK_CANDIDATES = 2000, 150
NOMINAL, PRIOR, PERFECT = "nominal", "prior alone", "perfect"
"""Not identified: the folder's values; the same as the prior has them, wrong; the true compliances."""
DEFAULT = "default"  #: What `identify` takes by default.
LEAST_SQUARES = "MLS56"
MODELS_WITHOUT_PRIOR = (JOINTS, LEAST_SQUARES, "MGCO56")  #: Identified without a prior.
IDENTIFIED = (*MODELS_WITHOUT_PRIOR, DEFAULT_WITHOUT_CONE, DEFAULT)
MODELS = (NOMINAL, PRIOR, *IDENTIFIED, PERFECT)
DRAWN = (JOINTS, DEFAULT)

Angles = tuple[tuple[float, ...], ...]  #: Joint angles, (poses, n) [rad].


@dataclass(frozen=True)
class CompensationPlanRow:
    """Hold a planned campaign."""

    loads: str  #: What loads the arm, WEIGHT or BOTH.
    poses: int
    q_rad: tuple[float, ...]  #: Joint angles, one pose after the other, (poses * n,) [rad].
    load: tuple[int, ...]  #: Which of the loads acts in each, (poses,).


@dataclass(frozen=True)
class CompensationScene:
    """Hold what all trials share."""

    candidates: Angles = ()  #: Feasible poses to measure.
    program: Angles = ()  #: Programmed joints of all jobs, one job after the other.
    plans: tuple[CompensationPlanRow, ...] = ()


@dataclass(frozen=True)
class Way:
    """Describe how a model is identified; one that is not has a campaign of no poses."""

    by: str = ""  #: PLANNED or RANDOM.
    loads: str = ""  #: WEIGHT or BOTH.
    poses: int = 0

    @property
    def campaign(self) -> str:
        """Describe the campaign in words."""
        return f"{self.by}, {self.loads}" if self.by else "none"


NOWHERE = Way()
ADVISED = Way(PLANNED, BOTH, FEATURED)


@dataclass(frozen=True)
class CompensationOptions:
    """Hold the flags of the study."""

    arm: Annotated[str, typer.Option(metavar="ARM", help="Arm in front of the panel.")] = ARM


@dataclass(frozen=True)
class CompensationSettings:
    """Describe what is tried."""

    arm: str
    seed: int  #: Root of the candidates and of the planner's prior.
    numbers: tuple[int, ...] = NUMBERS  #: Poses of the campaigns.
    candidates: int = CANDIDATES  #: Feasible poses to choose from.
    #: Made of the rest by `prepare`; empty before.
    scene: Annotated[CompensationScene, Field(exclude=True)] = CompensationScene()

    def ways(self, arm: str) -> tuple[Way, ...]:
        """List the campaigns of one of ARMS."""
        if arm == LINEAR:
            return (ADVISED,)
        numbers = self.numbers if arm == IDEAL else (FEATURED,)
        return tuple(Way(*one) for one in product((PLANNED, RANDOM), (WEIGHT, BOTH), numbers))


def settings(options: CompensationOptions, quick: bool, seeds: range) -> CompensationSettings:
    """Make the settings of the flags.

    Args:
        options: Flags of the command line.
        quick: Whether the run is a small one.
        seeds: Seeds of the trials.

    Returns:
        The settings.

    Raises:
        BenchError: When it is an arm that does not reach the panel.
    """
    if find_arm(options.arm).resolve().name != ARM:
        raise BenchError(f"--arm: expected {ARM}, whose work area has the panel, got {options.arm!r}")
    if quick:
        return CompensationSettings(options.arm, seeds[0], QUICK_NUMBERS, QUICK_CANDIDATES)
    return CompensationSettings(options.arm, seeds[0])


START = (0.3, -1.2, 1.6, 0.1, -0.4, 0.0)  #: Joints near the panel [rad].
AROUND = 50  #: Candidates that stand for the workspace, which no criterion here asks for.
DRILLING, MILLING = "drilling", "milling"
FORCE_RANGE = (1000.0, 3000.0)  #: Least and largest force of the process [N].
TIP = (0.5, 0.0, 0.0)  #: Where the tool cuts, in the tool's frame [m].
RADIUS, NEAREST, HEIGHT = 2.0, 2.4, 1.6
"""Of the panel, a cylinder about a level axis along y: how far its nearest line is from the robot [m]."""
HOLES, PATTERN = (6, 5), (0.6, 0.4)  #: Along y and up the panel, and half of the pattern's size [m].
WINDOW, CORNER, STEPS = (0.5, 0.3), 0.1, 64
"""Half of the milled window's size, the radius of its corners [m], and points of the path around it."""
MIN_FORCE_COMPONENT = 0.3  #: Of a component of the milling force before scaling, over the largest.


@dataclass(frozen=True)
class Job:
    """Hold points on the panel, in order, world axes, both (points, 3)."""

    name: str
    position: Array  #: [m].
    axis: Array  #: Of the spindle, into the panel.
    typical: Array  #: Direction of the force that a plan is made for: along the feed, across, axial, (3,).

    @property
    def rotation(self) -> Array:
        """Compute the orientation, world from tool: x is the spindle, y level, (points, 3, 3)."""
        y = np.cross([0.0, 0.0, 1.0], self.axis)
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        return np.asarray(np.stack([self.axis, y, np.cross(self.axis, y)], axis=-1))


def jobs() -> tuple[Job, Job]:
    """Make both jobs; a drill is pushed back along its spindle alone."""
    milled = np.array([-1.0, 1.0, -1.0]) / np.sqrt(3)
    return _on_panel(DRILLING, _pattern(), np.array([0.0, 0.0, -1.0])), _on_panel(MILLING, _window(), milled)


def _on_panel(name: str, at: Array, typical: Array) -> Job:
    """A job at places of the panel, (points, 2) along y and up it [m]."""
    angle = at[:, 1] / RADIUS
    cosine, sine, level = np.cos(angle), np.sin(angle), np.zeros(len(at))
    position = np.column_stack([NEAREST + RADIUS * (1 - cosine), at[:, 0], HEIGHT + RADIUS * sine])
    return Job(name, position, np.column_stack([cosine, level, -sine]), typical)


def _pattern() -> Array:
    """Holes, row by row, there and back."""
    y, s = (np.linspace(-half, half, n) for half, n in zip(PATTERN, HOLES, strict=True))
    return np.array([(one, up) for k, up in enumerate(s) for one in (y if k % 2 == 0 else y[::-1])])


def _window() -> Array:
    """Points around a window with rounded corners, evenly spaced: straight and round parts in turn."""
    a, b = (half - CORNER for half in WINDOW)
    quarter = np.pi / 2 * CORNER
    lengths = np.tile([2 * b, quarter, 2 * a, quarter], 2)
    starts = np.cumsum(np.r_[0.0, lengths])
    way = (np.arange(STEPS) + 0.5) * starts[-1] / STEPS
    part = np.searchsorted(starts, way, side="right") - 1
    gone, round_it = way - starts[part], part % 2 == 1
    turn = np.pi / 2 * (part // 2) + np.where(round_it, gone / CORNER, 0.0)
    straight = np.where(round_it, 0.0, gone - lengths[part])
    cosine, sine = np.cos(turn), np.sin(turn)
    centres = np.array([(a, b), (-a, b), (-a, -b), (a, -b)])[part // 2]
    return np.asarray(
        centres + np.column_stack([CORNER * cosine - straight * sine, CORNER * sine + straight * cosine])
    )


def drawn(job: Job, rng: np.random.Generator) -> Array:
    """Draw forces of a trial along the feed, across it and along the spindle.

    A mill is held back, pushed aside to either side and out of the panel.

    Args:
        job: The job.
        rng: Source of randomness.

    Returns:
        Forces, (3,) [N].
    """
    size, parts, side = (
        rng.uniform(*FORCE_RANGE),
        rng.uniform(MIN_FORCE_COMPONENT, 1, 3),
        rng.choice([-1.0, 1.0]),
    )
    milled = parts / np.linalg.norm(parts) * [-1.0, side, -1.0]
    return np.asarray(size * (job.typical if job.name == DRILLING else milled))


def tasks(q: Array, forces: Sequence[Array]) -> Tasks:
    """Collect the points of all jobs, one job after the other, each job under forces of its own.

    Args:
        q: Programmed joints, (points, n) [rad].
        forces: Along the feed, across it and along the spindle, a job each.

    Returns:
        The tasks.
    """
    wrench = np.concatenate(
        [
            process_wrench(np.tile(own, (len(job.position), 1)), job.position, job.axis)
            for job, own in zip(jobs(), forces, strict=True)
        ]
    )
    return Tasks(q, Load(wrench, np.array(TIP)).over(len(wrench)))


def prepare(asked: CompensationSettings, everywhere: Everywhere) -> CompensationSettings:
    """Make the scene; PoseError for too few feasible poses.

    Args:
        asked: Settings of the study.
        everywhere: Does pieces of work on all cores.

    Returns:
        The settings with their scene.
    """
    cell = build_cell(find_arm(asked.arm))
    found = find(_checks(cell), asked.candidates, trial_rng(asked.seed, 1)).q
    q = np.concatenate([program(cell, job) for job in jobs()])
    plain = [tuple(map(tuple, own.tolist())) for own in (found, q)]
    scene = CompensationScene(candidates=plain[0], program=plain[1])
    asked = replace(asked, scene=scene)
    rows = everywhere(partial(plan_rows, asked), len(_planned(asked)), CompensationPlanRow, "plans")
    return replace(asked, scene=replace(scene, plans=tuple(rows)))


def _planned(asked: CompensationSettings) -> list[tuple[str, int]]:
    return list(product((WEIGHT, BOTH), asked.numbers))


def _checks(cell: Cell) -> Checks:
    payload = Payload(PAYLOAD, SLING)
    return build_checks(cell, PoseConditions(area=AREA, station=Station(STATION), payload=payload))


def program(cell: Cell, job: Job) -> Array:
    """Compute the joints that a controller takes which knows the drawing alone.

    Args:
        cell: The arm with its model and its truth.
        job: The job.

    Returns:
        Joints, (points, n) [rad].

    Raises:
        BenchError: When a point is out of reach.
    """
    start, tip = np.array(START), np.array(TIP)
    reached = joints_along(cell.vjm, job.position, job.rotation, start=start, point=tip)
    if not reached.converged.all():
        raise BenchError(
            f"{job.name}: {cell.arm.name} does not reach point {np.argmin(reached.converged) + 1}"
        )
    return reached.q


def loads(cell: Cell) -> tuple[Load, Load]:
    """Make the hung weight, and the pull of the rope."""
    return weight(cell.vjm, PAYLOAD), Load(np.array([0.0, PULL, 0.0, 0.0, 0.0, 0.0]), cell.vjm.load)


def plan_rows(asked: CompensationSettings, numbers: Sequence[int]) -> list[list[CompensationPlanRow]]:
    """Make plans by their numbers, one list each.

    Args:
        asked: Settings of the study.
        numbers: Numbers of the plans.

    Returns:
        The plans.
    """
    cell = build_cell(find_arm(asked.arm))
    reach, found = Feasibility(partial(feasible, _checks(cell))), []
    for name, poses in map(_planned(asked).__getitem__, numbers):
        spec = specify(cell, asked, name, poses)
        best = make_plan(spec, "test", np.array(asked.scene.candidates), reach, trial_rng(asked.seed, 2))
        found.append(
            [CompensationPlanRow(name, poses, tuple(best.q.ravel().tolist()), tuple(best.load.tolist()))]
        )
    return found


def specify(cell: Cell, asked: CompensationSettings, name: str, poses: int) -> Specification:
    """Specify what a plan is for: the points of both jobs under forces of the middle of their range.

    Args:
        cell: The arm with its model and its truth.
        asked: Settings of the study.
        name: Name of the loads.
        poses: Number of poses.

    Returns:
        The specification.
    """
    scaling = scale_by_prior(
        wrong_prior(cell, asked.seed), cell.vjm, named_models(cell, ("ALL153",))[0].structure
    )
    return Specification(
        experiment=MeasurementSetup(cell.vjm, scaling, cell.vjm.markers, SIGMA),
        loads=loads(cell)[: 1 if name == WEIGHT else 2],
        tasks=tasks(np.array(asked.scene.program), [np.mean(FORCE_RANGE) * job.typical for job in jobs()]),
        workspace=np.array(asked.scene.candidates[:AROUND]),
        uncertainty=UNCERTAINTY,
        poses=poses,
    )
