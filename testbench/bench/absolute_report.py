"""What a calibration tells its readers: report.json as typed rows, the unit in the name or beside it."""

from dataclasses import dataclass

from testbench.trials.gain import Gain, gained

SIGNIFICANT = 3.0  #: Standard deviations above which the amplitude of an order is more than scatter.
FAR = 1.5  #: Error of a range over that of all readings, of held-out ones over the drawing, that is said.


@dataclass(frozen=True)
class Errors:
    """Distances of positions from a model."""

    n: int
    mean_mm: float
    rms_mm: float
    p95_mm: float
    max_mm: float


@dataclass(frozen=True)
class SeriesRow:
    """A series by the arm as drawn, frame and mount aligned, and by the calibrated arm.

    `after` is of readings that were fitted; what was held out stands in the steps.
    """

    series: str
    rows: int
    before: Errors
    after: Errors


@dataclass(frozen=True)
class StepRow:
    """A kind of error that was tried beside those kept before it.

    RMS distances of readings that were held out, blocks of joint space and whole series realigned; the latter
    None of a single series, the former where poses are too few to hold any out.
    """

    name: str
    kept: bool
    before_mm: float | None
    after_mm: float | None
    series_before_mm: float | None
    series_after_mm: float | None

    @property
    def verdict(self) -> str:
        """Kept or declined."""
        return "kept" if self.kept else "declined"


@dataclass(frozen=True)
class PlaceRow:
    """A range of a joint, in deg or mm: how many positions were read there, and their RMS distance.

    Of a hinge that turns more than once by whole turns. None where nothing was read.
    """

    joint: str
    low: float
    high: float
    unit: str
    n: int
    before_mm: float | None
    after_mm: float | None

    @property
    def words(self) -> str:
        """The range for people."""
        return f"{self.joint} {self.low:.0f} to {self.high:.0f} {self.unit}"


@dataclass(frozen=True)
class OrderRow:
    """Amplitude of one order of a joint's periodic error and its standard deviation."""

    order: int
    amplitude_urad: float
    deviation_urad: float

    @property
    def significant(self) -> bool:
        """Whether it is more than scatter."""
        return self.amplitude_urad > SIGNIFICANT * self.deviation_urad


@dataclass(frozen=True)
class SpectrumRow:
    """The periodic error of a joint: RMS over a turn, and its orders."""

    joint: str
    rms_urad: float
    orders: list[OrderRow]

    @property
    def largest(self) -> OrderRow:
        """The order of largest amplitude."""
        return max(self.orders, key=lambda row: row.amplitude_urad)

    @property
    def significant(self) -> int:
        """Number of orders that are more than scatter."""
        return sum(row.significant for row in self.orders)


@dataclass(frozen=True)
class Value:
    """A number with its 95 % interval, value - half_95 to value + half_95."""

    name: str
    value: float
    half_95: float
    unit: str


@dataclass(frozen=True)
class ComplianceRow(Value):
    """A joint's compliance with that of the link before it about its axis, beside the arm's folder."""

    folder: float

    @property
    def factor(self) -> float:
        """Over the folder's."""
        return self.value / self.folder


@dataclass(frozen=True)
class BlockRow:
    """Smallest and largest eigenvalue of a block of the compliances, in its own (mixed) SI units."""

    name: str
    smallest: float
    largest: float


@dataclass(frozen=True)
class Program:
    """The inner program at the last point: whether it asks for PSD blocks, how it ended, whether they are."""

    method: str
    constrained: bool
    status: str
    conservative: bool


@dataclass(frozen=True)
class Noise:
    """What the model leaves open beside the scatter of the readings, and scatter over what was expected."""

    sigma_um: float
    open_position_um: float
    open_rotation_urad: float
    position_factor: float


@dataclass(frozen=True)
class OutlierRow:
    """A reading far from the model; `pull` is how much it counted, 1 for a sound one."""

    series: str
    row: int
    marker: str
    error_mm: float
    pull: float


@dataclass(frozen=True)
class AbsoluteReport:
    """A calibration by absolute readings; the fields are the keys of report.json.

    `places` are ranges of the joints one after the other. Whether own weight is the only load: compliances
    then have the scale of the masses that were assumed. `left_open` is what hides behind what.
    `less_pull_percent` is the share of positions that counted less than a sound one: 0.7 are expected.
    """

    arm: str
    series: list[SeriesRow]
    total_before: Errors
    total_after: Errors
    steps: list[StepRow]
    places: list[PlaceRow]
    spectrum: list[SpectrumRow]
    geometry: list[Value]
    compliances: list[ComplianceRow]
    blocks: list[BlockRow]
    program: Program | None
    noise: Noise
    weight_alone: bool
    less_pull_percent: float
    left_open: list[str]
    outliers: list[OutlierRow]
    notes: list[str]

    @property
    def unread(self) -> list[PlaceRow]:
        """Ranges without a reading, neighbours as one."""
        found: list[PlaceRow] = []
        for row in self.places:
            if row.n:
                continue
            last = found[-1] if found else None
            if last and (last.joint, last.high) == (row.joint, row.low):
                found[-1] = PlaceRow(row.joint, last.low, row.high, row.unit, 0, None, None)
            else:
                found.append(row)
        return found

    @property
    def worst(self) -> list[PlaceRow]:
        """Ranges whose error stands out, the largest first."""
        limit = FAR * self.total_after.rms_mm
        far = [row for row in self.places if row.after_mm is not None and row.after_mm > limit]
        return sorted(far, key=lambda row: -(row.after_mm or 0.0))

    @property
    def ladder(self) -> list[StepRow]:
        """Geometry alone, then what was tried beside it."""
        if not self.steps:
            return []
        first = self.steps[0]
        alone = (first.before_mm, first.series_before_mm)
        return [StepRow("geometry", True, alone[0], alone[0], alone[1], alone[1]), *self.steps]

    @property
    def held_out_mm(self) -> tuple[float, float] | None:
        """RMS distance of held-out readings by geometry alone and by all that was kept; None if not tried."""
        kept = [row.after_mm for row in self.ladder if row.kept]
        if not kept or kept[0] is None or kept[-1] is None:
            return None
        return kept[0], kept[-1]

    @property
    def gain(self) -> Gain:
        """The calibrated arm beside the arm as drawn, by the mean distance of the readings."""
        return _gain(self.total_after.mean_mm, self.total_before.mean_mm)

    @property
    def gain_held_out(self) -> Gain | None:
        """All that was kept beside geometry alone, by the readings held out; None if not tried."""
        return _gain(self.held_out_mm[1], self.held_out_mm[0]) if self.held_out_mm else None

    @property
    def worse(self) -> bool:
        """Whether the calibrated arm foretells readings worse than the arm as drawn, or nothing says."""
        if self.held_out_mm is None:
            return bool(self.steps) and self.steps[0].series_after_mm is None
        return self.held_out_mm[1] > FAR * self.total_before.rms_mm

    @property
    def paying(self) -> list[str]:
        """Names of what pays: joint springs are kept even where they do not."""
        return [row.name for row in self.steps if row.kept and (row.after_mm or 0.0) < (row.before_mm or 0.0)]

    @property
    def declined(self) -> list[str]:
        """Names of what does not pay."""
        return [row.name for row in self.steps if not row.kept]


def _gain(ours: float, theirs: float) -> Gain:
    return gained("calibrated", "before", [ours], [theirs])
