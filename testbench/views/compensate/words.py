"""The tables and words of a corrected program, for terminal, report.md and recording."""

from pathlib import Path

import numpy as np

from testbench.bench.compensate_report import CompensationReport, PointRow
from testbench.views.markdown import Words
from testbench.views.schema import Column, Table

ALL, MOST = 20, 8  #: Points up to which a table lists all, and how many of more.
WORST = (
    Column("line", "line", form="d"),
    Column("label", "point"),
    Column("before_mm", "as programmed, off by", "mm", short="as\nprogrammed\nmm"),
    Column("half_95_mm", "corrected, within (95 %)", "mm", short="corrected\n(95 %)\nmm"),
    Column("turn_left_mrad", "turn that is left", "mrad", short="turn\nleft\nmrad"),
    Column("reason", "left as it is because"),
)
JOINTS = (
    Column("name", "joint"),
    Column("largest", "largest correction", form=".4f"),
    Column("unit", "unit"),
    Column("held", "points at its limit", form="d"),
)


def tables(report: CompensationReport) -> dict[str, Table]:
    """Every table by its name."""
    refused = any(row.reason is not None for row in report.rows)
    absent = {"reason": not refused, "turn_left_mrad": not report.turned}
    columns = tuple(column for column in WORST if not absent.get(column.key))
    joints = [
        {"name": name, "largest": largest, "unit": unit, "held": report.held.get(name, 0)}
        for name, largest, unit in zip(report.joints, report.largest, report.units, strict=True)
    ]
    return {
        "worst": Table(columns, worst(report)),
        "joints": Table(JOINTS if report.held else JOINTS[:-1], joints),
    }


def worst(report: CompensationReport) -> list[PointRow]:
    """Points that are not corrected, then the one of the largest error in every stretch of the program."""
    refused = [row for row in report.rows if row.reason is not None][:MOST]
    parts = report.points if report.points <= ALL else MOST
    stretches = np.array_split(np.arange(report.points), parts)
    rows = [max((report.rows[k] for k in part), key=lambda row: row.before_mm) for part in stretches]
    return refused + [row for row in rows if row.reason is None]


def words(report: CompensationReport) -> Words:
    """The words of a corrected program."""
    return Words(
        Path(__file__).parent, {"report": report, "tables": tables(report), "most": MOST}, "compensate.md.j2"
    )
