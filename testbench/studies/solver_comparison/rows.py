"""A trial's rows: what every solver found, what all of them had, where local solves end."""

from dataclasses import dataclass

from testbench.bench.rows import ErrorRow
from testbench.studies.six_dof_arm.trial import Judged, Measured
from testbench.trials.spread import Number, Share


@dataclass(frozen=True)
class SolverNumbers:
    """What one solver found, in one seed or over all."""

    f_m: Number  #: Cost of Eq. (19).
    excess_f_m: Number  #: Over that of the conic program.
    relative_excess: Number  #: The same, relative.
    f_m_excess_bound: Number  #: F_M over its certified lower bound.
    relative_excess_bound: Number  #: The same, relative to the bound.
    seconds: Number  #: Wall time of the whole call, reduction of the dataset included.
    seconds_to_1_percent: Number  #: Until F_M was within 1 % of the conic program's; None where it never was.
    ratio_to_conic: Number  #: The same over the conic program's whole time.
    whole_ratio_to_conic: Number  #: Whole time over the conic program's.
    evaluations: Number  #: Of F_M; None where nobody counts them.
    local_solves: int | None  #: How many; None where there are none.
    local_solves_elsewhere: int | None  #: Those that ended more than CLOSE above the conic program.
    conservative: Share  #: Whether every block is positive semi-definite.
    status: str  #: What the solver says.
    check_true: ErrorRow  #: Errors of the check runs, without noise.


@dataclass(frozen=True)
class SolverRow(SolverNumbers):
    """The same of one seed, with its way down."""

    way_seconds: tuple[float, ...]  #: When it improved, thinned.
    way_gap: tuple[float, ...]  #: Least F_M over the certified lower bound by then, minus 1.


@dataclass(frozen=True)
class Data:
    """What every solver of a seed had: measurements, what the conic program made of them, time of one F_M."""

    measured: Measured
    model: Judged
    microseconds_f_m: float


@dataclass(frozen=True)
class Minima:
    """Local solves of one order m from random starts: F_M of each, and how many ran out of steps."""

    m: int
    f_m: tuple[float, ...]
    conic_f_m: float
    unfinished: int


@dataclass(frozen=True)
class TrialRow:
    """One line of a seed: its data, a solver, or local minima of one order."""

    key: str = ""  #: Letter of the solver, empty for the others.
    data: Data | None = None  #: Of the seed, in its first line.
    solver: SolverRow | None = None  #: What a solver found.
    minima: Minima | None = None  #: Where local solves end.
