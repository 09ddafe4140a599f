"""What the study of noise reports: types of report.json."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.bench.campaign import Truth
from testbench.bench.rows import DatasetRow
from testbench.identify import Constraint
from testbench.studies.noise_sensitivity.trial import Part
from testbench.trials.spread import Spread


@dataclass(frozen=True)
class Errors:
    """Errors of one model over all trials.

    Attributes:
        part: Of the study.
        model: Its name; of the instruments the instrument's.
        structure: Name of its structure.
        constraint: What its method asks of the blocks.
        prior: Whether it has a prior.
        x: Noise of a reading along an axis, or distance of the instrument [m].
        rms_um: RMS error of predicted deflection.
        p95_um: 95 % of the errors are smaller.
        conservative: Share of trials in which every block is symmetric and positive semi-definite.
        solved: Share of trials in which the method found its solution.
        trials: How many.
    """

    part: Part
    model: str
    structure: str
    constraint: Constraint
    prior: bool
    x: float
    rms_um: Spread
    p95_um: Spread
    conservative: float
    solved: float
    trials: int


@dataclass(frozen=True)
class Level(Errors):
    """The same at one level of noise."""

    sigma_um: float


@dataclass(frozen=True)
class Instrument(Errors):
    """The same with one instrument."""

    truth: Truth


@dataclass(frozen=True)
class Slope:
    """What noise costs a model: median error without noise, and per noise at the largest one."""

    part: Part
    model: str
    structure: str
    prior: bool
    noise_free_um: float
    um_per_um: float


@dataclass(frozen=True)
class Extremes:
    """The models to which the largest noise costs least and most; several where they are alike."""

    part: Part
    prior: bool
    least: tuple[str, ...]
    least_um_per_um: float
    most: tuple[str, ...]
    most_um_per_um: float


@dataclass(frozen=True)
class NearInstruments:
    """The instruments of least and of largest median error, near the arm, linear truth."""

    distance_m: float
    least: tuple[str, ...]
    least_um: float
    most: tuple[str, ...]
    most_um: float


@dataclass(frozen=True)
class PriorEffect:
    """Whether a prior lowers the error of its structure, at the largest noise and without any."""

    part: Part
    structure: str
    lower_with_noise: bool
    lower_without_noise: bool


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

    rms_mm: Spread
    p95_mm: Spread


@dataclass(frozen=True)
class ModelAt:
    """A model at the noise nearest that of the paper's tracker."""

    name: str
    method: str
    constraint: Constraint
    prior: bool
    conservative: float
    solved: float
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
    extremes: list[Extremes]
    prior: list[PriorEffect]
    instruments: list[Instrument]
    near: NearInstruments
    weighted_over_flat: Mapping[Truth, list[Weighted]]
    gco_over_ls: list[Paired]
    gco_better: Mapping[Part, Shares]
    conservative: Mapping[Constraint, Shares]
    models: list[ModelAt]
    dataset: DatasetRow
