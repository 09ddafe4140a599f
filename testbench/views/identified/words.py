"""The words of an identified model, for report.md and recording; what is printed is `views.fits`."""

from pathlib import Path

import numpy as np

from testbench.bench.fit_rows import Fits
from testbench.views import fits as fitted
from testbench.views.identified.report import IdentifiedReport, MapRow
from testbench.views.markdown import Words
from testbench.views.schema import Column, Table

MOST = 30  #: Runs that are listed, the worst.
RUNS = (
    Column("where", "run"),
    Column("pose", "pose", form="d"),
    Column("deflection_mm", "deflection", "mm"),
    Column("taken_mm", "residual", "mm"),
)
ELSEWHERE = (
    Column("model", "model"),
    Column("median_mm", "median half width", "mm"),
    Column("greatest_mm", "greatest", "mm"),
    Column("unbounded", "places without a bound", form="d"),
    Column("apart_mm", "apart, median", "mm"),
    Column("farthest_mm", "greatest", "mm"),
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
        "elsewhere": Table(ELSEWHERE, elsewhere(report.map) if report.map else [], bold=report.recommended),
    }


def elsewhere(found: MapRow) -> list[dict[str, object]]:
    """Every model over the workspace: how sure it is, and how far it is from the one to take."""
    rows: list[dict[str, object]] = []
    for name in found.errors.error_mm:
        worst, apart = found.errors.worst.get(name), found.apart_mm.get(name)
        rows.append(
            {
                "model": name,
                "median_mm": found.errors.typical_mm(name) if worst else None,
                "greatest_mm": worst.error_mm if worst else None,
                "unbounded": found.errors.unbounded(name),
                "apart_mm": float(np.median(apart)) if apart else None,
                "farthest_mm": max(apart) if apart else None,
            }
        )
    return rows


def words(fits: Fits, report: IdentifiedReport) -> Words:
    """The words of a report."""
    values = {
        "report": report,
        "tables": tables(fits, report),
        "said": fitted.words(fits),
        "most": MOST,
    }
    return Words(Path(__file__).parent, values, "identified.md.j2")
