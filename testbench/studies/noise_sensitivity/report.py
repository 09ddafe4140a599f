"""What the study of noise reports: types of report.json."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.bench.campaign import Truth
from testbench.bench.rows import DatasetRow
from testbench.identify import Constraint
from testbench.studies.noise_sensitivity.by_arm import ByArm
from testbench.studies.noise_sensitivity.fits import FitRow
from testbench.studies.noise_sensitivity.trial import Part
from testbench.trials.gain import Gain
from testbench.trials.spread import Number, Share, Spread


@dataclass(frozen=True)
class Level(FitRow):
    """A model over all trials, at one level of noise or with an instrument at one distance."""

    part: Part
    x: float  #: Noise of a reading along an axis, or distance of the instrument [m].
    trials: int
    truth: Truth
    sigma_um: float | None  #: None of an instrument.


@dataclass(frozen=True)
class Slope:
    """What noise costs a model, trial by trial."""

    model: str
    structure: str
    constraint: Constraint
    prior: bool
    noise_free_um: Spread
    #: What the largest noise adds in quadrature to the error without noise, per noise.
    um_per_um: Spread


@dataclass(frozen=True)
class Extremes:
    """Who has the least and the largest median; several where they are alike. Values are of the first."""

    least: tuple[str, ...]
    least_value: Spread
    most: tuple[str, ...]
    most_value: Spread


@dataclass(frozen=True)
class Costs:
    """To which models noise costs least and most [um/um], and what a prior does to its structure's error."""

    plain: Extremes
    with_prior: Extremes
    lowered: tuple[str, ...]  #: Structures, at the largest noise.
    raised_without_noise: tuple[str, ...]


@dataclass(frozen=True)
class Leaders:
    """Errors at the noise of the paper's tracker."""

    noise_um: float
    best: tuple[str, ...]  #: Of all models; several where they are alike.
    best_um: Number
    default_um: Number  #: Of what `identify` takes by default with a prior.
    plain: tuple[str, ...]  #: Of those without a prior, joints alone left out.
    plain_um: Number
    joints_um: Number  #: Of joints alone.


@dataclass(frozen=True)
class Gains:
    """The default at the noise of the paper's tracker, trial by trial."""

    least_squares: Gain  #: Beside the best of least squares without a prior.
    joints: Gain  #: Beside joints alone.


@dataclass(frozen=True)
class Worst:
    """RMS errors at the largest noise."""

    noise_um: float
    default_um: Number
    least_squares_um: Number  #: Of the best of least squares without a prior at the noise of the tracker.
    joints_um: Number


@dataclass(frozen=True)
class Weighted:
    """Trial by trial: error with full covariances over that with flat weights; which has the less median."""

    truth: Truth
    model: str  #: By which the readings are identified.
    distance_m: float
    ratio: Spread
    better_in: float  #: Share of trials in which full covariances have the smaller error.
    trials: int
    better: tuple[str, ...]


@dataclass(frozen=True)
class Paired:
    """Trial by trial on the same readings: a model's error over another one's."""

    part: Part
    ours: str
    theirs: str
    sigma_um: float
    ratio: Spread
    better_in: float  #: Share of trials.
    alike_in: float  #: Share of trials in which they differ by a solver's digits.


@dataclass(frozen=True)
class Compared:
    """A pair at every noise."""

    ours: str
    theirs: str
    cone: bool  #: Whether they differ in nothing but the cone.
    sigmas_um: tuple[float, ...]
    better_in: tuple[float, ...]  #: Shares of trials in which ours is better.
    alike_in: tuple[float, ...]  #: Shares in which they err alike.


@dataclass(frozen=True)
class Shares:
    """Least and largest share of trials."""

    least: float
    most: float


@dataclass(frozen=True)
class Scores:
    """Errors in millimetres."""

    rms_mm: Number
    p95_mm: Number


@dataclass(frozen=True)
class ModelAt:
    """A model at the noise nearest that of the paper's tracker."""

    name: str
    method: str
    constraint: Constraint
    prior: bool
    conservative: Share
    solved: Share
    check: Scores | None
    workspace: Scores | None
    paper: None = None


@dataclass(frozen=True)
class NoiseReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    noise: bool
    truth: Mapping[str, str]
    true_arm: str  #: Its name, or "family".
    true_arms: Mapping[str, int]  #: Trials of each.
    default: str  #: The model that `identify` takes by default with a prior.
    trials: Mapping[Part, int]
    sigmas_um: list[float]
    sweeps: Mapping[Part, list[Level]]
    slopes: Mapping[Part, Mapping[str, Slope]]
    costs: Mapping[Part, Costs]
    instruments: list[Level]
    instruments_by: str  #: The model by which instruments are compared.
    near_m: float
    near: Extremes  #: Errors of instruments there, linear truth [um].
    weighted_over_flat: Mapping[Truth, list[Weighted]]
    leaders: Mapping[Part, Leaders]
    gains: Mapping[Part, Gains]
    worst: Mapping[Part, Worst]
    by_arm: Mapping[Part, list[ByArm]]  #: Of the leaders, those whose errors differ by true arm [um].
    weighted_by_arm: list[ByArm]  #: Ratios at `near_m` that do.
    paired: list[Paired]
    compared: Mapping[Part, list[Compared]]
    conservative: Mapping[str, Shares]  #: Of all noisy fits, by method in words.
    models: list[ModelAt]
    dataset: DatasetRow
