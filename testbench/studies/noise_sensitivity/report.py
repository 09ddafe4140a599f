"""What the study of noise reports: types of report.json."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.bench.campaign import Truth
from testbench.bench.rows import DatasetRow
from testbench.identify import Constraint
from testbench.studies.noise_sensitivity.fits import FitRow
from testbench.studies.noise_sensitivity.trial import Part
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
    """What noise costs a model, by median errors."""

    model: str
    structure: str
    prior: bool
    noise_free_um: float
    um_per_um: float  #: At the largest noise.


@dataclass(frozen=True)
class Extremes:
    """Who has the least and the largest value; several where they are alike."""

    least: tuple[str, ...]
    least_value: float
    most: tuple[str, ...]
    most_value: float


@dataclass(frozen=True)
class Costs:
    """To which models noise costs least and most [um/um], and what a prior does to its structure's error."""

    plain: Extremes
    with_prior: Extremes
    lowered: tuple[str, ...]  #: Structures, at the largest noise.
    raised_without_noise: tuple[str, ...]


@dataclass(frozen=True)
class Weighted:
    """Median error with full covariances over that with flat weights, and which is better."""

    truth: Truth
    distance_m: float
    ratio: float
    better: tuple[str, ...]


@dataclass(frozen=True)
class Paired:
    """Trial by trial on the same readings: GCO's error over that of LS with the same structure."""

    part: Part
    sigma_um: float
    ratio: Spread
    better_in: float


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
    trials: Mapping[Part, int]
    sigmas_um: list[float]
    sweeps: Mapping[Part, list[Level]]
    slopes: Mapping[Part, Mapping[str, Slope]]
    costs: Mapping[Part, Costs]
    instruments: list[Level]
    near_m: float
    near: Extremes  #: Median errors of instruments there, linear truth [um].
    weighted_over_flat: Mapping[Truth, list[Weighted]]
    gco_over_ls: list[Paired]
    gco_better: Mapping[Part, Shares]
    conservative: Mapping[Constraint, Shares]
    models: list[ModelAt]
    dataset: DatasetRow
