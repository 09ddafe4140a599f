"""Tables of the study of pose selection: a row a plan, and a row a fit of a trial."""

from dataclasses import dataclass
from typing import Literal

from testbench.bench.rows import MM, DatasetRow, ErrorRow, FitRow
from testbench.design.forecast import Forecast
from testbench.trials.spread import Number

Part = Literal["measured", "noise-free", "planned anew", "drawn arm", "variant"]
"""What was measured: the true arm with noise or without, with a plan and a prior of the trial's own, an arm
that the prior could have drawn (linear truth), or the true arm in another way."""
Angles = tuple[tuple[float, ...], ...]
"""Joint angles, (poses, n) [rad]."""


@dataclass(frozen=True)
class Indices:
    """Observability indices of design.observability [1]."""

    o1: Number
    o2: Number
    o3: Number
    o4: Number
    o5: Number


@dataclass(frozen=True)
class Certificate:
    """What a plan is certified for, and which error at the tasks it forecasts with its 90 % interval.

    Efficiency is at least its share of the best that as many of the poses examined can reach [1].
    """

    efficiency: Number
    examined: Number
    directions_seen: Number
    directions_of_loads: Number
    expected_tasks_mm: Number
    expected_tasks_p05_mm: Number
    expected_tasks_p95_mm: Number
    expected_workspace_mm: Number
    observability: Indices


@dataclass(frozen=True)
class PlanRow(Certificate):
    """A plan.

    Attributes:
        criterion: Key of planning.CRITERIA.
        variant: Another way to measure than the study's own; empty for that.
        poses: How many.
        q_rad: Their joint angles, one pose after the other, (poses * n,) [rad].
        load: Which of the loads hangs in each, (poses,).
        seconds: Wall time of planning.
    """

    criterion: str
    variant: str
    poses: int
    q_rad: tuple[float, ...]
    load: tuple[int, ...]
    seconds: float


@dataclass(frozen=True)
class Scene:
    """What all plans and trials share: feasible poses, and where predictions are wanted.

    Attributes:
        candidates: Feasible poses to choose from.
        drawn: Poses drawn to find them.
        rejected: How many each reason refused, in the order of candidates.REASONS.
        tasks: Poses where the robot works.
        workspace: Poses all over the workspace.
        plans: By criterion and number of poses, then by variant.
    """

    candidates: Angles = ()
    drawn: int = 0
    rejected: tuple[int, ...] = ()
    tasks: Angles = ()
    workspace: Angles = ()
    plans: tuple[PlanRow, ...] = ()

    def plan(self, criterion: str, poses: int, variant: str = "") -> PlanRow:
        """The plan by a criterion of so many poses."""
        wanted = (criterion, poses, variant)
        return next(p for p in self.plans if (p.criterion, p.poses, p.variant) == wanted)


@dataclass(frozen=True)
class Expected:
    """Forecast of the error at the tasks, with the ends of its 90 % interval."""

    tasks_mm: float
    low_mm: float
    high_mm: float


@dataclass(frozen=True)
class Model(FitRow):
    """A fit of the featured number of poses, its runs and its errors; the tasks are its check set."""

    data: DatasetRow
    identification: ErrorRow
    check: ErrorRow
    workspace: ErrorRow


@dataclass(frozen=True)
class Where:
    """RMS error over the markers in every task and in every pose of the workspace."""

    tasks_mm: tuple[Number, ...]
    workspace_mm: tuple[Number, ...]


@dataclass(frozen=True)
class Row:
    """RMS errors of one fit against the true deflection.

    Attributes:
        part: What was measured.
        plan: Criterion of the plan, "random", or the variant's name.
        poses: How many were measured.
        fit: How they were identified.
        tasks_mm: At the tasks.
        workspace_mm: Over the workspace, where it is asked for.
        expected: Forecast of random poses, and of all poses on a drawn arm.
        certificate: Of a plan made anew.
        model: Of the featured number of poses.
        where: Errors of the featured plan for the tasks, pose by pose.
    """

    part: Part
    plan: str
    poses: int
    fit: str
    tasks_mm: float
    workspace_mm: float | None = None
    expected: Expected | None = None
    certificate: Certificate | None = None
    model: Model | None = None
    where: Where | None = None


def expected(forecast: Forecast) -> Expected:
    """What a forecast says of all poses together."""
    return Expected(MM * forecast.overall, MM * forecast.overall_low, MM * forecast.overall_high)
