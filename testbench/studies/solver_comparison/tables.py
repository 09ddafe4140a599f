"""The columns of the solver comparison, and its tables."""

from dataclasses import replace

from testbench.studies.solver_comparison.report import SolverComparisonReport
from testbench.views.schema import Column, Table

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
    Column("share_sharp", "within 10^-6", "%", ".0f", scale=100),
    Column("share_close", "within 10^-5", "%", ".0f", scale=100),
    Column("median", "median excess", form=".1e"),
    Column("worst", "worst excess", form=".1e"),
    Column("unfinished", "out of steps", form="d"),
    Column("cap", "cap costs"),
)


def tables(report: SolverComparisonReport) -> dict[str, Table]:
    """The solvers, and where local solves end."""
    return {
        "solvers": Table(COLUMNS, report.solvers),
        "short": Table(SHORT, report.solvers, bold="d", headline="seconds_to_1_percent"),
        "recorded": Table(tuple(replace(c, exact=True) for c in SHORT), report.solvers, bold="d"),
        "minima": Table(MINIMA, list(report.local_minima.values())),
    }
