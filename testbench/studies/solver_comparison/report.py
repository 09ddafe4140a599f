"""What the solver comparison reports: types of report.json."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from testbench.bench.campaign import Truth
from testbench.studies.six_dof_arm.trial import Judged, Measured
from testbench.studies.solver_comparison.rows import SolverNumbers
from testbench.trials.spread import Spread, middle
from testbench.views.schema import show


@dataclass(frozen=True)
class SolverReport(SolverNumbers):
    """A solver over all seeds."""

    key: str
    name: str
    within_1_percent: int

    @property
    def title(self) -> str:
        """Letter and words."""
        return f"({self.key}) {self.name}"

    @property
    def times(self) -> str:
        """Time to come within 1 %, as a multiple of the conic program's whole time."""
        ratio = middle(self.ratio_to_conic)
        return (
            "never" if math.isnan(ratio) else f"{ratio:.0f} times" if ratio >= 100 else f"{ratio:.2g} times"
        )


@dataclass(frozen=True)
class ModelReport(Judged):
    """The model that the conic program found; the paper has no numbers beside it."""

    paper: None = None


@dataclass(frozen=True)
class Convergence:
    """Ways down of the first seed: seconds, gap over the certified lower bound."""

    seed: int
    points: Mapping[str, list[tuple[float, float]]]


@dataclass(frozen=True)
class End:
    """Where a solver ended in one seed."""

    seed: int
    key: str
    f_m: float
    seconds: float
    seconds_to_1_percent: float | None
    gap_to_bound: float


@dataclass(frozen=True)
class LocalMinima:
    """Where local solves of one order m end: excess over the conic optimum (m = 6), or the best found."""

    m: int
    reference: str
    seeds: list[int]
    starts_per_seed: int
    share_sharp: float = field(metadata={"key": "share_within_1e-6"})
    share_close: float = field(metadata={"key": "share_within_1e-5"})
    worst: float
    median: float
    excess: list[float]
    best_over_conic: list[float]
    unfinished: int

    @property
    def starts(self) -> str:
        """How many local solves."""
        return f"{self.starts_per_seed} in each of {len(self.seeds)} seeds"

    @property
    def cap(self) -> str:
        """What the order costs: best found over the conic optimum."""
        return f"{show(min(self.best_over_conic), '.1e')} to {show(max(self.best_over_conic), '.1e')}"


@dataclass(frozen=True)
class NeverAbove:
    """Whether the conic program never ends above the paper's optimiser."""

    met: bool
    largest_relative_excess_of_d_over_a: float
    largest_relative_excess_of_d_over_any: float
    met_up_to_the_certified_bound: bool


@dataclass(frozen=True)
class Faster:
    """How much longer the paper's optimiser takes to come within 1 %."""

    least_ratio: float | None  #: Over the seeds; None where it never does.


@dataclass(frozen=True)
class Lean:
    """The same for its evaluations of F_M alone."""

    ratio: float
    seconds_of_f_m_alone: float


@dataclass(frozen=True)
class Everywhere:
    """How many local solves with gradients do not reach the conic program's F_M."""

    elsewhere: int
    of: int
    tolerance: float


@dataclass(frozen=True)
class Theses:
    """The conic program beside the paper's optimiser."""

    conic_never_above_paper: NeverAbove
    conic_1000_times_faster_than_paper_to_1_percent: Faster
    the_same_without_bookkeeping: Lean
    all_local_solves_reach_the_conic_f_m: Everywhere


@dataclass(frozen=True)
class SolverComparisonReport:
    """report.json."""

    scenario: str
    seed: list[int]
    arm: str
    model: str
    m: int
    noise: bool
    truth: Truth
    dataset: Measured
    solvers: list[SolverReport]
    models: list[ModelReport]
    floor_out_of_reach: int
    microseconds_f_m: Spread
    convergence: Convergence
    runs: list[End]
    local_minima: Mapping[str, LocalMinima]
    theses: Theses = field(metadata={"key": "targets"})
