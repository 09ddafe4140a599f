"""The tables and words of a prediction, for terminal, report.md and recording."""

from pathlib import Path

from testbench.bench.prediction_report import PredictionReport
from testbench.views.markdown import Words
from testbench.views.schema import Column, Table

FEW = 5  #: Poses that the terminal lists.
POSES = (
    Column("label", "pose"),
    Column("deflection_mm", "tool moves", "mm", short="moves\nmm"),
    Column("half_words", "+- (95 %)", "mm", short="+- 95 %\nmm"),
    Column("deflections_mm.0", "x", "mm", short="x\nmm"),
    Column("deflections_mm.1", "y", "mm", short="y\nmm"),
    Column("deflections_mm.2", "z", "mm", short="z\nmm"),
    Column("turn_mrad", "turns", "mrad", ".2f", short="turns\nmrad"),
    Column("least_n_per_um", "least stiffness", "N/um", ".3g", short="softest\nN/um"),
    Column("softest", "where softest", short="direction"),
)


def tables(report: PredictionReport) -> dict[str, Table]:
    """Every table by its name."""
    few = tuple(column for column in POSES if column.key != "turn_mrad")
    return {"worst": Table(POSES, report.worst), "few": Table(few, report.worst[:FEW])}


def words(report: PredictionReport) -> Words:
    """The words of a prediction."""
    return Words(Path(__file__).parent, {"report": report, "tables": tables(report)}, "predicted.md.j2")
