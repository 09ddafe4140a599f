"""The report of all seeds: every solver's numbers, where local solves end, and what holds of our theses."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from testbench.bench.campaign import Truth
from testbench.bench.rows import UM, ErrorRow
from testbench.identify.factorised import CLOSE, LARGEST_ORDER
from testbench.studies.six_dof_arm.trial import Judged, Measured
from testbench.studies.solver_comparison.trial import (
    ARM,
    NAME,
    ORDERS,
    Data,
    Minima,
    Settings,
    SolverNumbers,
    SolverRow,
    TrialRow,
)
from testbench.studies.study import Trials
from testbench.trials.spread import Number, Spread, merge, middle, spread
from testbench.views.schema import Column, Table

NEVER_ABOVE = 1e-9  #: Relative difference of F_M that rounding leaves.
WANTED_RATIO = 1000  #: How much faster than the paper's optimiser the conic program is meant to be.
SHARP = 1e-6  #: Relative excess of F_M within which local solves end that do not creep along a flat valley.
NUMBERS = (
    "f_m", "excess_f_m", "relative_excess", "f_m_excess_bound", "relative_excess_bound", "seconds",
    "seconds_to_1_percent", "ratio_to_conic", "whole_ratio_to_conic", "evaluations",
)  # fmt: skip
"""Numbers of a solver that have a spread, whatever there is of them."""


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
    f_m_first_seed: list[float]

    @property
    def starts(self) -> str:
        """How many local solves."""
        return f"{self.starts_per_seed} in each of {len(self.seeds)} seeds"

    @property
    def cap(self) -> str:
        """What the order costs: best found over the conic optimum."""
        return f"{min(self.best_over_conic):.1e} to {max(self.best_over_conic):.1e}"


@dataclass(frozen=True)
class Met:
    """Whether something holds."""

    met: bool


@dataclass(frozen=True)
class NeverAbove(Met):
    """Whether the conic program never ends above the paper's optimiser."""

    largest_relative_excess_of_d_over_a: float
    largest_relative_excess_of_d_over_any: float
    met_up_to_the_certified_bound: bool


@dataclass(frozen=True)
class Faster(Met):
    """How much longer the paper's optimiser takes to come within 1 %."""

    seeds_met: int
    seeds: int
    ratio: Number
    least_ratio: float | None


@dataclass(frozen=True)
class Lean(Met):
    """The same for its evaluations of F_M alone."""

    ratio: float
    seconds_of_f_m_alone: float


@dataclass(frozen=True)
class Everywhere(Met):
    """Whether all local solves with gradients reach the conic program's F_M."""

    elsewhere: int
    of: int
    tolerance: float


@dataclass(frozen=True)
class Targets:
    """Our theses, and the numbers that decide them."""

    conic_never_above_paper: NeverAbove
    conic_1000_times_faster_than_paper_to_1_percent: Faster
    the_same_without_bookkeeping: Lean
    all_local_solves_reach_the_conic_f_m: Everywhere
    all_conservative: Met


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
    targets: Targets


Solvers = Mapping[str, Sequence[SolverRow]]  #: Rows of every solver, one a seed.


def summary(asked: Settings, seeds: range, trials: Trials[TrialRow]) -> SolverComparisonReport:
    """Medians and spreads of every solver; ways down of the first seed."""
    every = [(seed, list(rows)) for seed, rows in trials]
    data = [row.data for _, rows in every for row in rows if row.data]
    pairs = [(seed, row.key, row.solver) for seed, rows in every for row in rows if row.solver]
    solvers = {key: [s for _, k, s in pairs if k == key] for key in dict.fromkeys(k for _, k, _ in pairs)}
    minima = [(seed, row.minima) for seed, rows in every for row in rows if row.minima]
    reports = [_over_seeds(key, names(asked)[key], rows) for key, rows in solvers.items()]
    micro = spread([own.microseconds_f_m for own in data])
    first = {
        key: list(zip(rows[0].way_seconds, rows[0].way_gap, strict=True)) for key, rows in solvers.items()
    }
    return SolverComparisonReport(
        scenario=NAME,
        seed=list(seeds),
        arm=ARM,
        model=asked.model,
        m=asked.m,
        noise=asked.scenario.noise,
        truth=asked.scenario.truth,
        dataset=merge([own.measured for own in data]),
        solvers=reports,
        models=[ModelReport(**vars(merge([own.model for own in data])))],
        floor_out_of_reach=sum(map(_out_of_reach, data)),
        microseconds_f_m=micro,
        convergence=Convergence(seeds[0], first),
        runs=[_end(seed, key, row) for seed, key, row in pairs],
        local_minima={f"m={m}": local_minima(m, [(s, o) for s, o in minima if o.m == m]) for m in ORDERS},
        targets=targets(solvers, reports, micro),
    )


def names(asked: Settings) -> dict[str, str]:
    """Words for every solver."""
    return {
        "a": f"genetic algorithm of up to {asked.generations} generations, then global search (the paper)",
        "a'": f"the same with {asked.short_generations} generations",
        "b": "one local solve over b, analytic gradient",
        "b'": "one local solve over b, finite differences",
        "c": f"{asked.starts} local solves over b",
        "d": "conic program with certificate",
        "e": "conic program in cvxpy, by SCS",
    }


def _known(values: Sequence[Number]) -> Number:
    """Spread of what there is; None where there is nothing."""
    known = [middle(value) for value in values if value is not None]
    return spread(known) if known else None


def _over_seeds(key: str, name: str, rows: Sequence[SolverRow]) -> SolverReport:
    solves = [row.local_solves for row in rows if row.local_solves is not None]
    errors = {k: _known([getattr(row.check_true, k) for row in rows]) for k in vars(rows[0].check_true)}
    return SolverReport(
        key=key,
        name=name,
        **{number: _known([getattr(row, number) for row in rows]) for number in NUMBERS},
        within_1_percent=sum(row.seconds_to_1_percent is not None for row in rows),
        local_solves=sum(solves) if solves else None,
        local_solves_elsewhere=sum(row.local_solves_elsewhere or 0 for row in rows) if solves else None,
        conservative=all(row.conservative for row in rows),
        check_true=ErrorRow(**errors),
        status=" | ".join(sorted({row.status for row in rows})),
    )


def _end(seed: int, key: str, row: SolverRow) -> End:
    there = None if row.seconds_to_1_percent is None else middle(row.seconds_to_1_percent)
    return End(seed, key, middle(row.f_m), middle(row.seconds), there, row.way_gap[-1])


def _out_of_reach(own: Data) -> bool:
    """Whether the certified lower bound lies above the F_M of noise alone: no search can stop there."""
    return middle(own.model.f_m) - middle(own.model.f_m_excess_bound) > middle(own.model.f_m_floor)


def local_minima(m: int, found: Sequence[tuple[int, Minima]]) -> LocalMinima:
    """Excess over the global optimum of the same order: the conic one for m = 6, else the best found."""
    excess, cap = [], []
    for _, own in found:
        best = own.conic_f_m if m == LARGEST_ORDER else min(own.f_m)
        excess += [value / best - 1 for value in own.f_m]
        cap.append(min(own.f_m) / own.conic_f_m - 1)
    values = np.sort(excess)
    return LocalMinima(
        m=m,
        reference="conic optimum" if m == LARGEST_ORDER else "best found of this order",
        seeds=[seed for seed, _ in found],
        starts_per_seed=len(found[0][1].f_m),
        share_sharp=float(np.mean(values <= SHARP)),
        share_close=float(np.mean(values <= CLOSE)),
        worst=float(values[-1]),
        median=float(np.median(values)),
        excess=values.tolist(),
        best_over_conic=cap,
        unfinished=sum(own.unfinished for _, own in found),
        f_m_first_seed=sorted(found[0][1].f_m),
    )


def targets(solvers: Solvers, reports: Sequence[SolverReport], micro: Spread) -> Targets:
    """What holds of our theses, and by how much."""
    a, d, by_key = solvers["a"], solvers["d"], {row.key: row for row in reports}
    above = max(_excess(x, y) for x, y in zip(d, a, strict=True))
    above_any = max(_excess(x, y) for rows in solvers.values() for x, y in zip(d, rows, strict=True))
    beyond = [middle(x.f_m) - middle(y.f_m) - middle(x.f_m_excess_bound) for x, y in zip(d, a, strict=True)]
    ratios = [None if row.ratio_to_conic is None else middle(row.ratio_to_conic) for row in a]
    slow = sum(ratio is None or ratio >= WANTED_RATIO for ratio in ratios)
    seconds = middle(by_key["a"].evaluations) * middle(micro) / UM
    lean = seconds / middle(by_key["d"].seconds)
    counted = [row for key, row in by_key.items() if key in ("a", "a'", "b", "c")]
    elsewhere = sum(row.local_solves_elsewhere or 0 for row in counted)
    return Targets(
        NeverAbove(above <= NEVER_ABOVE, above, above_any, max(beyond) <= 0),
        Faster(
            met=slow == len(ratios),
            seeds_met=slow,
            seeds=len(ratios),
            ratio=by_key["a"].ratio_to_conic,
            least_ratio=min((ratio for ratio in ratios if ratio is not None), default=None),
        ),
        Lean(lean >= WANTED_RATIO, lean, seconds),
        Everywhere(elsewhere == 0, elsewhere, sum(row.local_solves or 0 for row in counted), CLOSE),
        Met(all(row.conservative for row in reports)),
    )


def _excess(conic: SolverRow, other: SolverRow) -> float:
    return middle(conic.f_m) / middle(other.f_m) - 1


COLUMNS = (
    Column("title", "solver"),
    Column("f_m", "F_M"),
    Column("relative_excess", "over (d)", form=".1e", rounding=1e-12, short="over\n(d)"),
    Column("relative_excess_bound", "over the bound", form=".1e", short="over\nthe\nbound"),
    Column("seconds", "time", "s", ".3g"),
    Column("seconds_to_1_percent", "time to 1 %", "s", ".3g", short="to\n1 %\ns"),
    Column("ratio_to_conic", "to 1 %, times (d)", form=".3g", short="to 1 %\nx (d)"),
    Column("whole_ratio_to_conic", "whole time, times (d)", form=".3g"),
    Column("evaluations", "F_M evaluations", form=".0f"),
    Column("local_solves", "local solves", form="d"),
    Column("local_solves_elsewhere", "of them elsewhere", form="d"),
    Column("conservative", "conservative", form="yes"),
    Column("check_true.rms_mm", "RMS true", "mm", ".4f"),
    Column("check_true.p95_mm", "95 % true", "mm", ".4f"),
    Column("status", "status"),
)
SHORT = (
    Column("key", "solver"),
    *COLUMNS[1:7],
    Column("check_true.rms_mm", "RMS true", "mm", short="RMS\ntrue\nmm"),
)
MINIMA = (
    Column("m", "m", form="d"),
    Column("starts", "starts"),
    Column("reference", "excess is over"),
    Column("share_sharp", "within 1e-6", "%", ".0f", scale=100),
    Column("share_close", "within 1e-5", "%", ".0f", scale=100),
    Column("median", "median excess", form=".1e"),
    Column("worst", "worst excess", form=".1e"),
    Column("unfinished", "out of steps", form="d"),
    Column("cap", "cap costs"),
)


def tables(report: SolverComparisonReport) -> dict[str, Table]:
    """The solvers, and where local solves end."""
    return {
        "solvers": Table(COLUMNS, report.solvers),
        "short": Table(SHORT, report.solvers, bold="d"),
        "recorded": Table(tuple(replace(c, exact=True) for c in SHORT), report.solvers, bold="d"),
        "minima": Table(MINIMA, list(report.local_minima.values())),
    }
