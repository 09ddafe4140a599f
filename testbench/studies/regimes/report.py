"""What the study of regimes reports: types of report.json."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.bench.rows import DatasetRow
from testbench.identify import Constraint
from testbench.studies.regimes.campaigns import Kind
from testbench.trials.gain import Gain
from testbench.trials.spread import Share, Spread

MATTERS = 0.95  #: Ratio of errors, median, above which a gain is too small to count.


def better(ratio: Spread) -> bool:
    """Whether a ratio of errors is below 1 in 95 % of the fits, and `MATTERS` at most in the middle."""
    return ratio.ends[1] < 1 and ratio.median <= MATTERS


@dataclass(frozen=True)
class Ratios:
    """GCO against others over some fits, fit by fit; without a prior."""

    fits: int
    gco_over_ls: Spread  #: Of the same structure.
    gco_over_lent: Spread  #: Over least squares with GCO's free directions: what the cone does by itself.
    gco_over_joints: Spread  #: Over joints alone.
    better_in: float  #: Share of the fits in which GCO is better than least squares.
    beats_joints_in: float


@dataclass(frozen=True)
class MapCell(Ratios):
    """A structure with so many poses and so much noise, over all arms."""

    kind: Kind
    structure: str
    poses: int
    noise_um: float  #: Of a reading along an axis.
    gco_over_equal: Spread  #: Over least squares that is conservative at equal fit, where it can be.
    lent_over_ls: Spread  #: What taking GCO's free directions does to least squares.
    fitted: Spread  #: GCO over least squares in the fitted runs, against the truth.
    ls_um: Spread  #: RMS errors over the workspace.
    equal_um: Spread
    gco_um: Spread
    joints_um: Spread
    binds_in: float  #: Share of the fits in which nothing conservative fits as well as least squares.
    conservative_in: float  #: Share of the fits in which least squares is.
    solved_in: float  #: Share of the fits in which GCO is.
    expected: Spread  #: Error that noise is expected to leave least squares, over the deflection.
    rank: Spread  #: Directions that the data see.
    free: Spread  #: Directions that they do not.

    @property
    def name(self) -> str:
        """Of its line in the map."""
        return f"{self.structure}, {self.poses} poses"

    @property
    def pays(self) -> bool:
        """Whether GCO beats least squares in 95 % of the fits, in the middle by `MATTERS` at least."""
        return better(self.gco_over_ls)

    @property
    def cone_pays(self) -> bool:
        """The same with the same free directions: by the cone itself."""
        return better(self.gco_over_lent)

    @property
    def costs(self) -> bool:
        """Whether least squares beat GCO in 95 % of the fits, in the middle by as much."""
        return self.gco_over_ls.ends[0] > 1 and self.gco_over_ls.median >= 1 / MATTERS

    @property
    def beats_joints(self) -> bool:
        """Whether GCO beats joints alone in most fits."""
        return self.beats_joints_in > 0.5


@dataclass(frozen=True)
class Level(Ratios):
    """Some of the fits of one kind of reading."""

    name: str  #: Which they are.
    share: float  #: Of all fits of the kind.


@dataclass(frozen=True)
class Counts:
    """How many cells of a map do what."""

    cells: int
    cone_pays: int  #: The cone by itself pays.
    cone_pays_and_beats_joints: int  #: Of these, GCO beats joints alone in most fits.
    pay: int  #: GCO pays, by the cone or by what it takes for the free directions.
    pay_and_beat_joints: int
    cost: int  #: GCO costs.
    cost_with_free: int  #: Of these, the data leave directions free.


@dataclass(frozen=True)
class Explained:
    """Rank correlations with GCO over least squares of the same free directions, where the cone binds.

    None where there is nothing to correlate.
    """

    expected: float | None  #: Of the error to expect of least squares over the deflection.
    expected_by_cell: float | None  #: The same of the medians of cells in which it binds in most fits.
    taken: float | None  #: Of chi squared that the cone adds, a seen direction.
    noise: float | None  #: Of the noise alone.
    poses: float | None  #: Of the number of poses.


@dataclass(frozen=True)
class WithPrior:
    """GCO with prior over least squares with the same prior."""

    prior: str  #: How firmly it is believed.
    noise_um: float | None  #: None for all.
    fits: int
    binds_in: float  #: Share of the fits in which least squares is not conservative.
    gco_over_ls: Spread
    where_it_binds: Spread | None
    gco_over_joints: Spread
    beats_joints_in: float


@dataclass(frozen=True)
class Scores:
    """Errors in millimetres."""

    rms_mm: Spread


@dataclass(frozen=True)
class FeaturedModel:
    """A model in the featured cell."""

    name: str
    method: str
    constraint: Constraint
    prior: bool
    conservative: Share | None  #: None where nobody looked.
    solved: Share
    workspace: Scores
    check: None = None
    paper: None = None


@dataclass(frozen=True)
class Gains:
    """The structure of least GCO error in the featured cell, fit by fit."""

    structure: str
    least_squares: Gain  #: GCO beside least squares of the same structure.
    joints: Gain  #: GCO beside joints alone.


@dataclass(frozen=True)
class RegimesReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    noise: bool
    truth: tuple[str, ...]  #: The family.
    arms: Mapping[Kind, str]
    trials: int
    workspace_poses: int
    cells: Mapping[Kind, list[MapCell]]
    counts: Mapping[Kind, Counts]
    levels: Mapping[Kind, list[Level]]  #: Where the cone binds, by what is expected.
    free: Mapping[Kind, Level | None]  #: Where it does not; None where it always does.
    truths: Mapping[Kind, list[Level]]
    priors: Mapping[Kind, list[WithPrior]]
    priors_by_noise: Mapping[Kind, list[WithPrior]]
    explained: Mapping[Kind, Explained]
    worst: Mapping[Kind, MapCell]  #: Where GCO costs most.
    featured_poses: int
    featured_um: float  #: Noise of a reading.
    gains: Gains
    models: list[FeaturedModel]
    dataset: DatasetRow
