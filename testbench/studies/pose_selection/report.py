"""report.json of the study of pose selection, as types. Errors are against the true deflection, RMS."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.bench.plan_report import Found
from testbench.bench.rows import DatasetRow
from testbench.studies.pose_selection.rows import Certificate, Model, PlanRow, Where
from testbench.studies.pose_selection.settings import Scope
from testbench.trials.gain import Gain
from testbench.trials.spread import Number


@dataclass(frozen=True)
class Believed:
    """How wrong the priors are, and how firmly they are believed."""

    scale: float
    shape_percent: float
    believed_within_percent: float


@dataclass(frozen=True)
class Measured(DatasetRow):
    """Runs of the featured plan in the first trial, and where predictions are judged."""

    poses: int
    tasks: int
    workspace_poses: int


@dataclass(frozen=True)
class ModelReport(Model):
    """A fit over all trials; the paper has no number for it."""

    paper: None = None


@dataclass(frozen=True)
class Errors:
    """At the tasks and over the workspace."""

    tasks_mm: Number
    workspace_mm: Number


@dataclass(frozen=True)
class Level(Errors):
    """Of a plan, with its forecast, or of random poses; at the tasks in the best tenth of all trials too."""

    plan: str
    poses: int
    tasks_best_tenth_mm: float
    efficiency: Number
    expected_tasks_mm: Number


@dataclass(frozen=True)
class Featured:
    """At the tasks the plan for them against random poses; `best` names the better, both if alike."""

    poses: int
    test_mm: Number
    random_mm: Number
    random_best_tenth_mm: float
    ratio_of_medians: float
    best: tuple[str, ...]
    beats_best_tenth: bool


@dataclass(frozen=True)
class Possible:
    """What limits a plan of the featured size: the least forecast, and what stays without any noise."""

    poses: int
    least_promise_mm: float
    noise_free_mm: Mapping[str, Number]


@dataclass(frozen=True)
class Recommendation:
    """The fewest poses that keep the tasks within so much in 95 % of all trials, None for more than tried.

    Beyond `little_more_beyond` poses `step` more take less than `little_percent` off the error.
    """

    within_mm: float
    fewest: Mapping[str, int | None]
    little_more_beyond: int | None
    step: int
    little_percent: float


@dataclass(frozen=True)
class Anew(Certificate):
    """Plans made anew in every trial, from other candidates and another wrong prior."""

    test: Errors
    random: Errors
    seeds: int
    random_best_tenth_mm: float
    ratio_of_medians: float
    wins: int
    least_efficiency: float


@dataclass(frozen=True)
class Against:
    """Errors of a plan made for the very fit, against random poses of the same number."""

    planned_mm: Number
    random_mm: Number
    ratio: float  #: Of medians, planned over random [1].
    wins: int  #: Seeds in which the plan has the smaller error.
    better_than_joints: int  #: Those in which it leaves less than joints alone from a plan of their own.
    seeds: int


@dataclass(frozen=True)
class GroundReport:
    """A fit with a plan of its own, made for the tasks of one of two grounds."""

    ground: str
    fit: str
    poses: int
    expected_tasks_mm: Number
    tasks: Against
    workspace: Against


@dataclass(frozen=True)
class ForecastReport:
    """Forecast and simulated errors at the tasks on drawn arms, root mean squares over them."""

    plan: str
    poses: int
    expected_mm: float
    gco_mm: float
    ls_mm: float
    gco_over_expected: float
    inside_90_percent: float
    arms: int


@dataclass(frozen=True)
class KeptReport:
    """Promises of some cases, with the intervals of `testbench plan`, and what came of them.

    Shares of 90 % intervals of the RMS error at the tasks that hold it, of errors below and above them, and
    of 95 % intervals of a deflection along an axis that hold it; simulated over promised error.
    """

    cases: str
    count: int
    inside_90: float
    below: float
    above: float
    inside_95: float
    ratio: Number


@dataclass(frozen=True)
class VariantReport:
    """Another way to measure: its plan, the forecast error at the tasks, simulated errors."""

    variant: str
    poses: int
    directions: Number
    with_first_load: int
    efficiency: Number
    expected_tasks_mm: Number
    judged: Errors


@dataclass(frozen=True)
class Verdict:
    """Who is best, of several that are alike all, and whether forecasts hold."""

    tasks: tuple[str, ...]  #: Plans of least error at the tasks, random poses among them.
    workspace: tuple[str, ...]  #: The same over the workspace.
    no_better: tuple[str, ...]  #: Criteria that are no better at the tasks than random poses.
    ratio: tuple[float, float]  #: Least and largest simulated over forecast error on drawn arms [1].
    inside: tuple[float, float]  #: Least and largest share of drawn arms inside the 90 % interval [1].
    #: Poses, and simulated over forecast error of the plan for the tasks on the true arm [1].
    true_arm: tuple[tuple[int, float], ...]
    helps: tuple[str, ...]  #: Other ways of least simulated error, where it is less than the featured plan's.
    loses: tuple[str, ...]  #: Where a plan made for the very fit is no better than random poses, in words.


@dataclass(frozen=True)
class Gains:
    """Errors at the tasks of the featured plan, identified as planned for."""

    random: Gain  #: Beside random poses.
    joints: Gain  #: Beside joints alone, from poses planned likewise.


@dataclass(frozen=True)
class Worst:
    """Largest errors of the featured plan, medians pose by pose; and where planning gains least."""

    task_mm: float
    workspace_mm: float
    case: str  #: Fit, where it is judged, and which tasks were planned for.
    ratio: float  #: Median error there over that of random poses [1].


@dataclass(frozen=True)
class PoseReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    arm: str
    payload_kg: float
    noise: bool
    truth: str
    prior: Believed
    tracker_m: tuple[float, ...]
    dataset: Measured
    candidates: Found
    models: list[ModelReport]
    where: Where
    plans: list[PlanRow]
    errors: Mapping[str, Mapping[str, list[Level]]]
    featured: Mapping[str, Featured]
    possible: Possible
    recommendation: Recommendation
    replanned: Anew
    promises: list[ForecastReport]
    kept: list[KeptReport]  #: Of all links and joints with a learnt prior: all, then by what they share.
    kept_joints: KeptReport  #: Joints alone.
    worth: list[VariantReport]
    grounds: list[GroundReport]
    truths: list[str]  #: Names of the true arms of `grounds`, seed by seed in turn.
    study: Scope
    criteria: list[Level]
    verdict: Verdict
    gains: Gains
    worst: Worst
