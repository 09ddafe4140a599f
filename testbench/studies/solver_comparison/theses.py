"""The conic program beside the paper's optimiser: what holds of it, and by how much."""

from collections.abc import Mapping, Sequence

from testbench.bench.rows import UM
from testbench.identify.factorised import CLOSE
from testbench.studies.solver_comparison.report import (
    Everywhere,
    Faster,
    Lean,
    NeverAbove,
    SolverReport,
    Theses,
)
from testbench.studies.solver_comparison.rows import SolverRow
from testbench.trials.spread import Spread, middle

NEVER_ABOVE = 1e-9  #: Relative difference of F_M that rounding leaves.

Solvers = Mapping[str, Sequence[SolverRow]]  #: Rows of every solver, one a seed.


def theses(solvers: Solvers, reports: Sequence[SolverReport], micro: Spread) -> Theses:
    """What holds of the conic program, and by how much."""
    a, d, by_key = solvers["a"], solvers["d"], {row.key: row for row in reports}
    above = max(_excess(x, y) for x, y in zip(d, a, strict=True))
    above_any = max(_excess(x, y) for rows in solvers.values() for x, y in zip(d, rows, strict=True))
    beyond = [middle(x.f_m) - middle(y.f_m) - middle(x.f_m_excess_bound) for x, y in zip(d, a, strict=True)]
    ratios = [None if row.ratio_to_conic is None else middle(row.ratio_to_conic) for row in a]
    seconds = middle(by_key["a"].evaluations) * middle(micro) / UM
    lean = seconds / middle(by_key["d"].seconds)
    counted = [row for key, row in by_key.items() if key in ("a", "a'", "b", "c")]
    elsewhere = sum(row.local_solves_elsewhere or 0 for row in counted)
    return Theses(
        NeverAbove(above <= NEVER_ABOVE, above, above_any, max(beyond) <= 0),
        Faster(min((ratio for ratio in ratios if ratio is not None), default=None)),
        Lean(lean, seconds),
        Everywhere(elsewhere, sum(row.local_solves or 0 for row in counted), CLOSE),
    )


def _excess(conic: SolverRow, other: SolverRow) -> float:
    return middle(conic.f_m) / middle(other.f_m) - 1
