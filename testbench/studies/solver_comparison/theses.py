"""Our theses of the conic program beside the paper's optimiser: what holds of them, and by how much."""

from collections.abc import Mapping, Sequence

from testbench.bench.rows import UM
from testbench.identify.factorised import CLOSE
from testbench.studies.solver_comparison.report import (
    Everywhere,
    Faster,
    Lean,
    Met,
    NeverAbove,
    SolverReport,
    Targets,
)
from testbench.studies.solver_comparison.rows import SolverRow
from testbench.trials.spread import Spread, middle

NEVER_ABOVE = 1e-9  #: Relative difference of F_M that rounding leaves.
WANTED_RATIO = 1000  #: How much faster than the paper's optimiser the conic program is meant to be.

Solvers = Mapping[str, Sequence[SolverRow]]  #: Rows of every solver, one a seed.


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
