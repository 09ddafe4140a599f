"""What the study of compensation reports: types of report.json."""

from dataclasses import dataclass

from testbench.studies.compensation.settings import IDEAL
from testbench.trials.gain import Gain
from testbench.trials.spread import Spread

ALL = "both"  #: Both jobs together.
NO_CAMPAIGN = "none"


@dataclass(frozen=True)
class DatasetRow:
    """What the dataset holds that is written beside the report."""

    runs: int
    points: int
    sigma_um: float


@dataclass(frozen=True)
class Sizes:
    """How far the loaded tool is from where it was asked [mm]."""

    median_mm: Spread  #: Of the points of a trial, over the trials.
    p95_mm: Spread
    most_mm: float  #: Of all cases.


@dataclass(frozen=True)
class Group:
    """A model, campaign and job over some trials; a case is a point of a trial."""

    truth: str  #: Of the trials; empty for all.
    arm: str  #: One of ARMS.
    by: str
    loads: str
    poses: int
    model: str
    job: str  #: One of JOBS, or ALL.
    trials: int
    cases: int
    before: Sizes  #: Not corrected.
    after: Sizes
    removed: Spread  #: Share of that distance which the correction removed, over the cases [1].
    worst: float  #: The least of them.
    nine: float  #: Share of cases with nine tenths or more removed.
    by_trial: Spread  #: Medians of the trials.
    median_kept: float  #: Share of trials whose median is `MEDIAN` or more.
    nine_kept: float  #: Share of trials that have nine tenths removed in `OFTEN` of the cases.
    worse: int  #: Cases made worse.
    trials_worse: int  #: Trials that have one.
    #: Share of components of what is left inside their 95 % interval, of those that have a bound.
    covered: float | None
    covered_by_trial: Spread | None
    unseen: float | None  #: Share of components whose interval has no bound.
    buckled: int  #: Trials in which the model had no equilibrium under the process.
    solved: float  #: Share of cases for which joints were found.

    @property
    def campaign(self) -> str:
        """In words."""
        return f"{self.by}, {self.loads}" if self.by else NO_CAMPAIGN


@dataclass(frozen=True)
class ChosenAt:
    """How often the default was a model."""

    model: str
    fits: int


@dataclass(frozen=True)
class Shown:
    """The milling path of one trial, corrected by the campaign that is advised, undisturbed."""

    seed: int
    truth: str
    force: float  #: Of the process [N].
    way_m: tuple[float, ...]  #: Along the path.
    before_mm: tuple[float, ...]  #: Distance of the loaded tool from where it was asked, not corrected.
    after_mm: dict[str, tuple[float, ...]]  #: The same, corrected, by model.


@dataclass(frozen=True)
class Gains:
    """What is left after the default's correction, undisturbed, by the campaign that is advised.

    Medians of a trial's points, trial by trial.
    """

    least_squares: Gain
    joints: Gain  #: Joints alone.


@dataclass(frozen=True)
class CompensationReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    trials: int
    arm: str
    payload: float  #: Hung mass [kg].
    pull: float  #: Of the rope [N].
    runs: int  #: In every pose.
    sigma_um: float
    force: tuple[float, float]  #: Least and largest of the process [N].
    points: dict[str, int]  #: Of every job.
    featured: int
    numbers: tuple[int, ...]
    truths: dict[str, str]  #: True arms of these trials, in words.
    gains: Gains
    groups: list[Group]  #: All truths.
    by_truth: list[Group]  #: The campaign that is advised, both jobs.
    chosen: list[ChosenAt]
    shown: Shown
    dataset: DatasetRow

    def group(self, model: str, campaign: str = NO_CAMPAIGN, poses: int = 0, *, arm: str = IDEAL) -> Group:
        """One of the groups, both jobs."""
        wanted = (model, campaign, poses, ALL, arm)
        return next(g for g in self.groups if (g.model, g.campaign, g.poses, g.job, g.arm) == wanted)
