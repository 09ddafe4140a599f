"""What people see of their own runs' fits: the table, and the words around it."""

from testbench.bench.fit_rows import Fits
from testbench.views.markdown import TEMPLATES, Words
from testbench.views.schema import Column, Table

COLUMNS = (
    Column("name", "model"),
    Column("parameters", "unknowns", form="d", short="un-\nknowns"),
    Column("rank", "seen", form=".0f"),
    Column("conservative", "conservative", form="yes", short="conser-\nvative"),
    Column("f_m", "F_M", form=".2f"),
    Column("f_m_floor", "floor", form=".2f"),
    Column("identification.rms_mm", "RMS fit", "mm"),
)
FIT = (Column("identification.max_mm", "max fit", "mm"),)
CHECK = (
    Column("check.rms_mm", "RMS check", "mm"),
    Column("check.max_mm", "max check", "mm"),
)
COUNTS = "noise and the prior count, not what a model leaves out: joints alone look too sure"
"""What every interval of a model is told with."""
INTERVALS = (
    Column("name", "model"),
    Column("intervals.half_width_mm", "median half width", "mm"),
    Column("intervals.half_width_max_mm", "largest half width", "mm"),
    Column("intervals.components", "components", form="d"),
    Column("intervals.unbounded", "without bound", form="d"),
)
"""Of the 95 % intervals of predicted deflections, each component by itself."""


def tables(fits: Fits) -> dict[str, Table]:
    """Every model with its errors, and the intervals of its predictions where they were asked for."""
    best, first = fits.recommended, fits.models[0]
    known = [m for m in fits.models if m.intervals]
    found = {"models": Table((*COLUMNS, *(CHECK if first.check else FIT)), fits.models, bold=best)}
    if known and known[0].intervals:
        title = f"{100 * known[0].intervals.confidence:g} % intervals of predicted deflections; {COUNTS}"
        found["intervals"] = Table(INTERVALS, known, title, best)
    return found


def words(fits: Fits) -> Words:
    """Title, answer and statements."""
    return Words(TEMPLATES, {"fits": fits, "checked": fits.models[0].check is not None}, "fits.md.j2")
