"""report.json of section 5.1."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.bench.campaign import Truth
from testbench.bench.rows import DatasetRow
from testbench.studies.paper import Claim
from testbench.studies.single_link.judge import Judged
from testbench.studies.single_link.order import Order
from testbench.studies.single_link.printed import Matrix, Numbers, PrintedMatrices, Rows
from testbench.studies.single_link.trial import Fitted, Loads
from testbench.trials.gain import Gain
from testbench.trials.spread import Number


@dataclass(frozen=True)
class Printed(Judged):
    """A printed matrix judged as ours are, under the check loads of the first draw."""

    conservative: bool
    f_m: float


@dataclass(frozen=True)
class LinkModel(Fitted):
    """A model over all draws."""

    rank_of_C: Mapping[str, int]  #: Draws by the number of eigenvalues beyond rounding.
    entry_rms: Rows  #: RMS error of every entry, (6, 6).
    entry_bias: Rows  #: Mean error of every entry, (6, 6).
    min_eigenvalues: Numbers  #: Smallest eigenvalue (its real part) of every draw.
    paper: Printed | None  #: The printed matrix of this method.


@dataclass(frozen=True)
class LinkDataset(DatasetRow):
    """The readings of the first draw, and the noise of a reading and of a deflection."""

    check_runs: int
    sigma_urad: float
    sigma_of_a_deflection_um: float
    sigma_of_a_deflection_urad: float


@dataclass(frozen=True)
class Paired:
    """In how many draws GCO has the smaller error by more than a millionth on the same data, by quantity."""

    draws: int
    gco_better: Mapping[str, int]


@dataclass(frozen=True)
class Gains:
    """Position errors of GCO beside others, draw by draw."""

    least_squares: Gain  #: Of 36 free entries.
    symmetric: Gain  #: Of 21 symmetric ones.


@dataclass(frozen=True)
class WorstEntry:
    """The entry on the diagonal of C that GCO finds worst, over its true value; RMS errors in the unit."""

    name: str  #: Such as c11.
    unit: str
    true: float
    gco: float
    least_squares: float


@dataclass(frozen=True)
class LinkReport:
    """report.json."""

    scenario: str
    seed: int
    draws: int
    arm: str
    truth: Truth
    noise: bool
    noise_per: str
    loads: Loads
    condition_of_the_loads: Number
    dataset: LinkDataset
    models: list[LinkModel]
    best_position: tuple[str, ...]
    best_rotation: tuple[str, ...]
    gains: Gains
    worst: WorstEntry
    paired: Mapping[str, Paired]
    order_draws: int
    order_range: tuple[float, float]
    order: list[Order]
    eq_22_23: PrintedMatrices
    first_draw: Mapping[str, Matrix]
    truth_matrix: Rows
    units: str
    which_m: str
    claims: list[Claim]
    rule: str  #: How verdicts are made.

    def model(self, name: str) -> LinkModel:
        """The model of a name."""
        return next(m for m in self.models if m.name == name)
