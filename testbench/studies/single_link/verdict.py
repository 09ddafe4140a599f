"""What our draws say of the statements of section 5.1."""

from testbench.studies.paper import Claim, judged
from testbench.studies.single_link.order import sure
from testbench.studies.single_link.report import LinkReport
from testbench.studies.single_link.trial import GCO, LEAST_SQUARES
from testbench.trials.spread import middle


def claims(report: LinkReport) -> list[Claim]:
    """The paper's statements, each with our numbers."""
    ls, ours = report.model(LEAST_SQUARES), report.model(GCO)
    ls_um, our_um = (middle(m.prediction.position_rms_um) for m in (ls, ours))
    wins = report.paired[LEAST_SQUARES].gco_better["position_rms_um"]
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
            f"symmetric in {_percent(ls.symmetric)} of the draws, a negative eigenvalue in "
            f"{_percent(ls.negative_eigenvalue_matrix)}",
        ),
        judged(
            "GCO predicts better than least squares",
            our_um < ls_um,
            f"position error {our_um:.1f} against {ls_um:.1f} um; GCO is better in {wins} draws",
        ),
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


def _percent(share: float | None) -> str:
    return f"{100 * (share or 0.0):.0f} %"
