"""Rows of models.json: what a user's runs said, model by model."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.bench.baselines import is_least_squares
from testbench.bench.frame_rows import RegistrationRow
from testbench.bench.rows import ErrorRow, FitRow
from testbench.identify.contradiction import Unchecked
from testbench.identify.doubts import Doubt
from testbench.identify.estimate import Rejected
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import middle

Bound = float | None


@dataclass(frozen=True)
class IntervalRow:
    """The interval of one predicted deflection, world axes; None where the data leave it without a bound."""

    run: int
    marker: str
    centre_mm: tuple[float, ...]
    lower_mm: tuple[Bound, ...]
    upper_mm: tuple[Bound, ...]


@dataclass(frozen=True)
class IntervalsRow:
    """Intervals of predicted deflections."""

    confidence: float  #: Of each interval by itself [1].
    on_boundary: bool  #: Whether the cone holds the estimate: then they are not exact.
    unbounded: int  #: Components that the data leave without a bound.
    components: int  #: How many there are.
    half_width_mm: Bound  #: Median over those with a bound.
    half_width_max_mm: Bound  #: The largest of those.
    deflections: tuple[IntervalRow, ...]  #: One a run and marker.


@dataclass(frozen=True)
class Fitted(FitRow):
    """A model fitted to a user's runs."""

    equations: int  #: Of the readings.
    identification: ErrorRow  #: Errors on the runs that were fitted, against their readings.
    check: ErrorRow | None  #: The same on those held back; None if there are none.
    #: Of the deflections predicted where it is checked, or was fitted; None if not asked for, or where other
    #: models have a prior and this one has none.
    intervals: IntervalsRow | None
    learnt: bool  #: Whether the readings taught its prior: then its intervals count how wrong that may be.
    links: Mapping[str, list[list[float]]]  #: Compliance of every link in its beam frame.
    #: Compliance of every joint; None where it is aggregated: counted in that of the link before it.
    joints: Mapping[str, float | None]
    units: str  #: Of both.
    rejected: tuple[Rejected, ...]  #: Readings that the fit does without.

    @property
    def aggregated(self) -> tuple[str, ...]:
        """Joints whose compliance is counted in that of the link before them."""
        return tuple(name for name, compliance in self.joints.items() if compliance is None)


@dataclass(frozen=True)
class HeldOut:
    """Mean F_M of a model on poses and load levels held out in turn, and its standard error."""

    name: str
    f_m: float
    standard_error: float


@dataclass(frozen=True)
class Fits:
    """models.json."""

    dataset: str  #: Name of the file.
    arm: str  #: Name of the arm.
    runs: int  #: That were fitted.
    poses: int  #: They are in.
    models: tuple[Fitted, ...]  #: What was found.
    recommended: str  #: Name of the model to take.
    why: str  #: Why this one.
    held_out: tuple[HeldOut, ...]  #: What the recommendation rests on.
    #: What may be wrong with the runs, the likeliest first, then with the prior of the model to take.
    doubts: tuple[Doubt, ...]
    #: What the readings do not check of its prior.
    unchecked: Unchecked
    notes: tuple[str, ...]  #: What was understood of the runs.
    registration: RegistrationRow | None  #: Frames and targets; None where no frame fitted.
    #: By what factor the deflections exceed those that the arm's folder says [1]; None where nobody looked.
    scale: float | None = None

    @property
    def least_squares(self) -> str:
        """The best of least squares without a prior in the runs held back; empty for none."""
        plain = {
            m.name: m.check.rms_mm
            for m in self.models
            if m.check is not None and is_least_squares(m.structure, m.constraint, prior=m.prior)
        }
        return min(plain, key=lambda name: middle(plain[name]), default="")

    def beside(self, name: str) -> Gain | None:
        """The model to take beside another one in the runs held back; None where one was not judged there."""
        errors = {m.name: middle(m.check.rms_mm) for m in self.models if m.check is not None}
        if name == self.recommended or not {name, self.recommended} <= errors.keys():
            return None
        return gained(self.recommended, name, [errors[self.recommended]], [errors[name]])
