"""Tables of the study of pose selection: a row a plan, and a row a fit of a trial."""

from dataclasses import dataclass
from typing import Literal

from testbench.bench.plan_report import Expected
from testbench.bench.rows import DatasetRow, ErrorRow, FitRow
from testbench.trials.spread import Number

Part = Literal["measured", "noise-free", "planned anew", "drawn arm", "variant", "ground", "promise"]
"""What was measured: the true arm with noise or without, with a plan and a prior of the trial's own, an arm
that the prior could have drawn (linear truth), the true arm in another way, or on one of two grounds with
plans that are made for the very fit; there too, what came of a promise."""
Angles = tuple[tuple[float, ...], ...]  #: Joint angles, (poses, n) [rad].


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
    """A plan."""

    ground: str  #: Name of the ground that it is for.
    fit: str  #: Name of the fit that it is made for.
    criterion: str  #: Key of planning.CRITERIA.
    variant: str  #: Another way to measure than the study's own; empty for that.
    poses: int  #: How many.
    q_rad: tuple[float, ...]  #: Their joint angles, one pose after the other, (poses * n,) [rad].
    load: tuple[int, ...]  #: Which of the loads hangs in each, (poses,).
    seconds: float  #: Wall time of planning.


@dataclass(frozen=True)
class Scene:
    """What all plans and trials share: feasible poses, and where predictions are wanted."""

    candidates: Angles = ()  #: Feasible poses to choose from.
    drawn: int = 0  #: Poses drawn to find them.
    rejected: tuple[int, ...] = ()  #: How many each reason refused, in the order of candidates.REASONS.
    tasks: Angles = ()  #: Poses where the robot works.
    workspace: Angles = ()  #: Poses all over the workspace.
    plans: tuple[PlanRow, ...] = ()  #: By criterion and number of poses, then by variant.

    def plan(self, criterion: str, poses: int, fit: str, variant: str = "") -> PlanRow:
        """The plan by a criterion of so many poses for a fit."""
        wanted = (criterion, poses, fit, variant)
        return next(p for p in self.plans if (p.criterion, p.poses, p.fit, p.variant) == wanted)


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
class Kept:
    """What a promise was tried on, and the share of deflections along an axis inside their half widths."""

    truth: str  #: One of truths.TRUTHS.
    prior: str  #: One of wrong_prior.PRIORS.
    inside: float


@dataclass(frozen=True)
class Row:
    """RMS errors of one fit against the true deflection."""

    part: Part  #: What was measured.
    plan: str  #: Criterion of the plan, "random", or the variant's name.
    poses: int  #: How many were measured.
    fit: str  #: How they were identified.
    tasks_mm: float  #: At the tasks.
    workspace_mm: float | None = None  #: Over the workspace, where it is asked for.
    ground: str = ""  #: Name of the ground, of that part.
    #: Forecast of random poses, and of all poses on a drawn arm; the promise that was tried.
    expected: Expected | None = None
    kept: Kept | None = None  #: Of a promise.
    certificate: Certificate | None = None  #: Of a plan made anew.
    model: Model | None = None  #: Of the featured number of poses.
    where: Where | None = None  #: Errors of the featured plan for the tasks, pose by pose.
