"""The report of all seeds: every solver's numbers, and where local solves end."""

from collections.abc import Sequence

import numpy as np

from testbench.bench.rows import ErrorRow
from testbench.identify.factorised import CLOSE, LARGEST_ORDER
from testbench.studies.solver_comparison.report import (
    Convergence,
    End,
    LocalMinima,
    ModelReport,
    SolverComparisonReport,
    SolverReport,
)
from testbench.studies.solver_comparison.rows import Data, Minima, SolverRow, TrialRow
from testbench.studies.solver_comparison.theses import theses
from testbench.studies.solver_comparison.trial import ARM, NAME, ORDERS, Settings
from testbench.studies.study import Rows
from testbench.trials.spread import Number, merge, middle, spread

SHARP = 1e-6  #: Relative excess of F_M within which local solves end that do not creep along a flat valley.
NUMBERS = (
    "f_m", "excess_f_m", "relative_excess", "f_m_excess_bound", "relative_excess_bound", "seconds",
    "seconds_to_1_percent", "ratio_to_conic", "whole_ratio_to_conic", "evaluations",
)  # fmt: skip
"""Numbers of a solver that have a spread, whatever there is of them."""


def summary(asked: Settings, seeds: range, trials: Rows[TrialRow]) -> SolverComparisonReport:
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
        theses=theses(solvers, reports, micro),
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
    )
