"""What may be wrong with a calibration, the gravest first."""

from testbench.bench.absolute_report import AbsoluteReport
from testbench.identify.doubts import Doubt


def doubts(report: AbsoluteReport) -> list[Doubt]:
    """Doubts about the calibrated arm, for its page and for whoever loads it."""
    found = []
    if report.worse:
        far = "none could be held out, so that nothing says how far others are off"
        if report.held_out_mm:
            after, drawn = report.held_out_mm[1], report.total_before.rms_mm
            arms = f"from the calibrated arm, {drawn:.3f} mm from the arm as drawn"
            far = f"held-out ones are {after:.3f} mm RMS {arms}"
        found.append(Doubt("too few poses", f"{far}. Do not use it; read more."))
    if report.unread:
        found.append(
            Doubt("not read, hence extrapolated", f"{', '.join(row.words for row in report.unread)}.")
        )
    if report.weight_alone and report.compliances:
        scale = "compliances have the scale of the masses in rigid.xml"
        words = "Masses 10 % too small make them 10 % too large; positions stay right."
        found.append(Doubt("own weight is the only load", f"{scale}. {words}"))
    if report.program and not report.program.conservative:
        found.append(Doubt("not conservative", "a block of the compliances has a negative eigenvalue."))
    if report.program and report.program.status != "solved":
        found.append(Doubt("compliances", f"{report.program.method}, {report.program.status}."))
    return found
