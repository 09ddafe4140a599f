"""The tables and words of a calibration, for terminal, report.md and recording."""

from pathlib import Path

from testbench.bench.absolute_doubts import doubts
from testbench.bench.absolute_report import AbsoluteReport
from testbench.views.markdown import Words
from testbench.views.schema import Column, Table

MOST = 5  #: Ranges that are listed as the worst.
KEYS = (("mean", "mean"), ("p95", "95 %"), ("max", "max"))
SERIES = (
    Column("series", "series"),
    Column("after.n", "positions", form="d"),
    *(
        Column(f"{when}.{key}_mm", f"{name} {said}", "mm", short=f"{name}\n{said}\nmm")
        for when, name, keys in (("before", "drawn", KEYS[:2]), ("after", "calibrated", KEYS))
        for key, said in keys
    ),
)
STEPS = (
    Column("name", "errors", short="errors\ntried"),
    Column("verdict", "verdict"),
    Column("after_mm", "held-out blocks, RMS", "mm", short="held out\nblocks\nmm"),
    Column("series_after_mm", "held-out series, RMS", "mm", short="held out\nseries\nmm"),
)
VALUE, HALF, UNIT = Column("value", "value"), Column("half_95", "+- (95 %)"), Column("unit", "unit")
GEOMETRY = (Column("name", "error"), VALUE, HALF, UNIT)
COMPLIANCES = (
    Column("name", "joint"),
    Column("value", "compliance"),
    Column("half_95", "+- (95 %)"),
    UNIT,
    Column("folder", "in the folder"),
)
SPECTRUM = (
    Column("joint", "joint"),
    Column("rms_urad", "RMS over a turn", "urad", ".0f"),
    Column("largest.order", "largest order", form="d"),
    Column("largest.amplitude_urad", "its amplitude", "urad", ".0f"),
    Column("largest.deviation_urad", "+- (1 sd)", "urad", ".0f"),
    Column("significant", "orders above 3 sd", form="d"),
)
BLOCKS = (
    Column("name", "block"),
    Column("smallest", "smallest eigenvalue", form=".3g"),
    Column("largest", "largest", form=".3g"),
)
OUTLIERS = (
    Column("series", "series"),
    Column("row", "row", form="d"),
    Column("marker", "target"),
    Column("error_mm", "error", "mm"),
    Column("pull", "counts", form=".2f"),
)


def tables(report: AbsoluteReport) -> dict[str, Table]:
    """Every table by its name."""
    return {
        "series": Table(SERIES, report.series),
        "steps": Table(STEPS, report.ladder),
        "geometry": Table(GEOMETRY, report.geometry),
        "compliances": Table(COMPLIANCES, report.compliances),
        "spectrum": Table(SPECTRUM, report.spectrum),
        "blocks": Table(BLOCKS, report.blocks),
        "outliers": Table(OUTLIERS, report.outliers),
    }


def words(report: AbsoluteReport) -> Words:
    """The words of a calibration."""
    values = {"report": report, "doubts": doubts(report), "tables": tables(report), "most": MOST}
    return Words(Path(__file__).parent, values, "absolute.md.j2")
