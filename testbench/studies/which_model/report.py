"""What the study of the default method reports: types of report.json."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.bench.truths import CALLED
from testbench.bench.wrong_prior import PRIORS_CALLED
from testbench.identify import Constraint
from testbench.trials.gain import Gain
from testbench.trials.spread import Spread

EVERY = "all"  #: All cases, in words.


@dataclass(frozen=True)
class MethodAt:
    """A method over the cases of some truths and priors, at one number of poses."""

    truth: str  #: Of the cases; empty for all.
    prior: str  #: The same.
    poses: int
    method: str
    structure: str
    constraint: Constraint
    filled: bool  #: Whether it knows the prior.
    cases: int
    workspace_mm: Spread  #: RMS error over the workspace, against the truth.
    check_mm: Spread  #: The same at check poses.
    misfit: Spread  #: F_M over its floor.
    conservative: float  #: Share of cases.
    solved: float
    over_joints: Spread  #: Error over that of joints alone, case by case.
    loses: float  #: Share of cases in which that exceeds 1 by more than the margin.
    over_best: Spread  #: Error over that of the fixed method that is best at this number of poses.
    over_least: Spread  #: Error over the least of any fixed method in the same case.
    wins: float  #: Share of cases in which it is that of least error, or as good.


@dataclass(frozen=True)
class ChosenAt:
    """How often the default chose a method."""

    poses: int
    method: str
    cases: int
    share: float  #: Of the cases at this number of poses.


@dataclass(frozen=True)
class WorstAt:
    """A case in which the default loses to joints alone."""

    trial: int  #: Its seed.
    truth: str
    prior: str
    poses: int
    chosen: str  #: What the default chose.
    workspace_mm: float
    over_joints: float
    over_best: float  #: Over the best fixed method at this number of poses.


@dataclass(frozen=True)
class DoubtAt:
    """What the default says of a prior, over the cases of one prior at one number of poses."""

    prior: str
    what: str  #: Which of its cases; EVERY for all.
    poses: int | None  #: None for all.
    cases: int
    doubted: float  #: Share in which the readings contradict anything.
    told: float | None  #: Share in which that is what is ten times off; None where nothing is.
    #: Share in which that is named as what the readings do not check; None but for a link.
    unchecked: float | None
    #: The same share of these links where the prior has another link wrong; None where that is never so.
    otherwise: float | None
    either: float | None  #: Share in which one of both is said; None but for a link.


@dataclass(frozen=True)
class CoverAt:
    """Intervals of 95 % over the cases of a truth or a prior, or at a number of poses."""

    truth: str  #: Of the cases; empty for all.
    prior: str  #: The same.
    poses: int | None  #: None for all.
    method: str
    cases: int
    covered: float  #: Share of true components of deflection over the workspace inside their intervals.
    by_case: Spread  #: The same share, case by case.
    half_mm: Spread  #: Median half width.
    ideal_mm: Spread  #: Half width of the narrowest intervals, all alike in a case, that cover 95 %.
    over_ideal: Spread  #: Half width over that, case by case.

    @property
    def every(self) -> bool:
        """Whether these are all cases."""
        return not self.truth and not self.prior and self.poses is None

    @property
    def where(self) -> str:
        """The cases in words."""
        poses = EVERY if self.poses is None else f"{self.poses} poses"
        prior = self.prior and f"prior {PRIORS_CALLED[self.prior]}"
        return CALLED.get(self.truth, self.truth) or prior or poses


@dataclass(frozen=True)
class Gains:
    """RMS errors over the workspace, case by case, of the default; None where a method is not there."""

    least_squares: Gain | None  #: Beside the best of least squares that knows no prior.
    joints: Gain | None  #: Beside joints alone.


@dataclass(frozen=True)
class WorstArm:
    """The true arm with which the default's median error is largest, and the others' there."""

    truth: str
    poses: int
    default_mm: float
    least_squares_mm: float
    joints_mm: float


@dataclass(frozen=True)
class Advice:
    """At one number of poses, over the family: the default, and the fixed method of least median error."""

    poses: int
    default: MethodAt
    best: MethodAt  #: Fixed, as all that follow.
    without_prior: MethodAt  #: Of those that know no prior.
    joints: MethodAt  #: The incumbent.
    gains: Gains


@dataclass(frozen=True)
class TruthAt:
    """A true arm over all trials."""

    truth: str
    what: str  #: In words.
    off_tubes: Spread  #: Median distance of its links from tubes.
    cad_mm: Spread  #: RMS error over the workspace of the folder's compliances as they are.


@dataclass(frozen=True)
class WhichModelReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    arm: str
    noise: bool
    truth: str
    sigma_um: float
    trials: int
    workspace_poses: int
    runs_a_pose: int
    margin_percent: float  #: By how much a method's error must exceed that of joints alone for it to lose.
    stiffer: float  #: How many times stiffer the true links are than the folder's.
    advice: list[Advice]
    family: list[MethodAt]  #: Over all truths and priors.
    by_truth: list[MethodAt]
    by_prior: list[MethodAt]  #: Of methods that know it.
    cells: list[MethodAt]  #: Every truth with every prior.
    #: Truths and priors with which the default loses to joints alone, worst first.
    losses: list[MethodAt]
    worst_arm: WorstArm  #: At the least number of poses.
    worst: list[WorstAt]  #: The worst cases of the default, over joints alone.
    chosen: list[ChosenAt]
    cover: list[CoverAt]
    doubts: list[DoubtAt]
    truths: list[TruthAt]
    priors: Mapping[str, str]  #: What is wrong with each, in words.
