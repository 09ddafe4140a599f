"""What our draws say of the statements of section 5.1."""

from testbench.studies.paper import Claim, comparison, judged
from testbench.studies.single_link.order import sure
from testbench.studies.single_link.report import LinkReport
from testbench.studies.single_link.trial import GCO, LEAST_SQUARES, SYMMETRIC


def claims(report: LinkReport) -> list[Claim]:
    """The paper's statements, each with our numbers."""
    ls, symmetric, ours = (report.model(name) for name in (LEAST_SQUARES, SYMMETRIC, GCO))
    allowed, own = report.order_range, report.eq_22_23.eq_23_from_the_data_of_eq_22
    safe = sure(report.order)
    failing = [row.m for row in report.order if row.m >= allowed[0] and row.m not in safe]
    printed = own.printed_f_m_within_rounding
    return [
        judged(
            "GCO gives a conservative matrix (Eq. 23)",
            ours.conservative == 1,
            f"conservative in {_percent(ours.conservative)} of the draws",
        ),
        judged(
            "least squares does not (Eq. 22)",
            ls.conservative == 0,
            f"trivial with 36 free entries: symmetric in {_percent(ls.symmetric)} of the draws, whatever the "
            f"truth; a negative eigenvalue in {_percent(ls.negative_eigenvalue_matrix)}",
        ),
        judged(
            "least squares with a symmetric matrix is never conservative either (not in the paper)",
            symmetric.conservative == 0,
            f"conservative in {_percent(symmetric.conservative)} of the draws",
        ),
        _better("least squares", report, LEAST_SQUARES),
        _better("least squares with a symmetric matrix", report, SYMMETRIC),
        judged(
            "Eq. (23) has the least F_M of a conservative matrix",
            printed[0] <= own.optimum_f_m + (own.optimum_f_m_excess_bound or 0.0),
            f"F_M is {own.printed_f_m:.3f}, {printed[0]:.2f} to {printed[1]:.2f} within its rounding; the "
            f"certified optimum of the paper's own data has {own.optimum_f_m:.3f}",
        ),
        judged(
            f"any order m that Eq. (20) allows, {allowed[0]:g} to {allowed[1]:g}, will do",
            not failing,
            f"not in every draw at the optimum: {', '.join(f'm = {m}' for m in failing) or 'none'}",
        ),
    ]


def _better(words: str, report: LinkReport, name: str) -> Claim:
    """GCO's position error against that of another method."""
    pair = report.paired[name]
    return comparison(
        f"GCO predicts better than {words}",
        "its position error is the smaller one",
        pair.gco_better["position_rms_um"],
        pair.draws,
    )


def _percent(share: float | None) -> str:
    return f"{100 * (share or 0.0):.0f} %"
