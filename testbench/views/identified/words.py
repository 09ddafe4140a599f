"""The words of an identified model, for report.md and recording; what is printed is `views.fits`."""

from pathlib import Path

from testbench.bench.fit_rows import Fits
from testbench.views import fits as fitted
from testbench.views.identified.report import IdentifiedReport
from testbench.views.markdown import Words
from testbench.views.schema import Column, Table

MOST = 30  #: Runs that are listed, the worst.
RUNS = (
    Column("where", "run"),
    Column("pose", "pose", form="d"),
    Column("deflection_mm", "deflection", "mm"),
    Column("taken_mm", "residual", "mm"),
)
BLOCKS = (
    Column("component", "link or joint"),
    Column("parameters", "unknowns", form="d"),
    Column("data_share", "share that the readings tell", "%", ".0f", scale=100),
    Column("decided_by_prior", "unknowns that the prior decides", form="d"),
)


def tables(fits: Fits, report: IdentifiedReport) -> dict[str, Table]:
    """Every table by its name."""
    worst = sorted(report.residuals, key=lambda row: -row.taken_mm)[:MOST]
    return {
        **fitted.tables(fits),
        "runs": Table(RUNS, worst),
        "seen": Table(BLOCKS, report.seen.blocks),
    }


def words(fits: Fits, report: IdentifiedReport) -> Words:
    """The words of a report."""
    values = {
        "report": report,
        "tables": tables(fits, report),
        "said": fitted.words(fits),
        "most": MOST,
    }
    return Words(Path(__file__).parent, values, "identified.md.j2")
