"""The report of the study: what report.json holds."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.studies.real_ur10.rows import Error
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import Number

ALIKE = 0.7  #: Correlation above which a joint's error counts as the same: half of what either says.


@dataclass(frozen=True)
class SeriesReport:
    """A series of readings."""

    name: str
    poses: int
    sigma_um: float  #: Of a position along an axis, typical.
    reach_mm: float  #: Largest distance of two of its positions.


@dataclass(frozen=True)
class ModelReport:
    """A model of the ladder, over all splits."""

    name: str
    words: str
    method: str | None  #: How compliances were found; None of a rigid arm.
    parameters: int  #: Unknowns of the arm, frames and targets not counted; the most.
    conservative: bool  #: Whether every block of the compliances is a Gramian, in all splits.
    min_eigenvalue: float  #: The least of a block [m/N, rad/(N m)].
    duality_gap: float | None  #: The largest.
    paper: None = None  #: The paper has no real arm.


@dataclass(frozen=True)
class LadderLine:
    """A model trained on a split, judged on a series."""

    model: str
    split: str
    judged: str
    poses: int  #: That trained it.
    error: Error


@dataclass(frozen=True)
class NumberLine:
    """A model that learnt from random poses of C; medians over the seeds with their spread."""

    poses: int
    model: str
    judged: str
    seeds: int
    mean_mm: Number
    p95_mm: Number
    p99_mm: Number
    max_mm: Number
    coverage_95: Number  #: Share [1].


@dataclass(frozen=True)
class JointReport:
    """A joint: where it was turned, and its periodic error by either series alone and by both."""

    joint: str
    low_A_deg: float
    high_A_deg: float
    low_C_deg: float
    high_C_deg: float
    strange_to_A_percent: float  #: Poses of C farther than STRANGE from every angle of A.
    strange_to_C_percent: float  #: Poses of A farther than that from every angle of C.
    common_deg: float  #: Angles that both visited.
    #: Correlation there of the error's curve by A alone and by C alone, months apart [1]; None of few angles.
    alike: float | None
    rms_A_urad: float  #: Of its curve by A alone, where A was.
    rms_C_urad: float
    rms_both_urad: float
    amplitude_A_urad: list[float]  #: By order, from 1 on.
    amplitude_C_urad: list[float]
    amplitude_both_urad: list[float]
    angle_deg: list[float]
    curve_A_urad: list[float | None]  #: At these angles, orders 1 and 2 left out; None where A never was.
    curve_C_urad: list[float | None]


@dataclass(frozen=True)
class CompliancesReport:
    """Compliances of the joints, by what trained the model."""

    trained: str
    model: str
    urad_per_Nm: list[float]


@dataclass(frozen=True)
class ChosenReport:
    """What cross-validation kept and declined on a split."""

    trained: str  #: Series that trained.
    kept: tuple[str, ...]
    declined: tuple[str, ...]


@dataclass(frozen=True)
class KnownReport:
    """A number of the prototype, and ours where it was trained alike."""

    model: str
    trained: str
    judged: str
    mean_mm: float
    ours_mm: Number


@dataclass(frozen=True)
class RealReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    arm: str
    dataset: list[SeriesReport]
    splits: Mapping[str, str]
    models: list[ModelReport]
    ladder: list[LadderLine]
    by_number: list[NumberLine]
    joints: list[JointReport]
    compliances: list[CompliancesReport]
    chosen: list[ChosenReport]
    known: list[KnownReport]

    @property
    def lasts(self) -> bool:
        """Whether the errors of all joints are alike by either series, where they can be compared."""
        return all(one.alike > ALIKE for one in self.joints if one.alike is not None)

    def error(self, model: str, split: str, judged: str) -> Error:
        """Of a model on a split."""
        return next(
            line.error
            for line in self.ladder
            if (line.model, line.split, line.judged) == (model, split, judged)
        )

    def mean(self, model: str, split: str) -> float:
        """Mean error over all readings that judge a model on a split [mm]."""
        own = [line.error for line in self.ladder if (line.model, line.split) == (model, split)]
        return sum(one.n * one.mean_mm for one in own) / sum(one.n for one in own)

    def gain(self, ours: str, theirs: str, split: str) -> Gain:
        """Two models on a split, by their mean errors."""
        return gained(ours, theirs, *([self.mean(name, split)] for name in (ours, theirs)))

    def worst(self, model: str, split: str) -> float:
        """Largest error of a position [mm]."""
        return max(row.error.max_mm for row in self.ladder if (row.model, row.split) == (model, split))

    def springs(self, model: str, joint: int) -> list[float]:
        """Compliance of a joint by A alone and by C alone [urad/(N m)]."""
        return [
            one.urad_per_Nm[joint] for one in self.compliances if one.model == model and one.trained in "AC"
        ]

    def has(self, model: str, split: str) -> bool:
        """Whether a model was judged on a split."""
        return any((line.model, line.split) == (model, split) for line in self.ladder)

    def line(self, model: str, judged: str) -> list[NumberLine]:
        """A model over the number of poses that trained it."""
        return [one for one in self.by_number if (one.model, one.judged) == (model, judged)]
