"""The tables and words of a plan of absolute readings, for terminal, plan.md and recording."""

from pathlib import Path

from testbench.bench.absolute_plan_report import AbsolutePlanReport
from testbench.views.markdown import Words
from testbench.views.plan.tables import ERROR, MANY, MOST_ROWS, POSES, SLID, WAY, joint_columns
from testbench.views.schema import Column, Table

CRITERIA = {
    "I": "mean square position error over the workspace",
    "G": "largest mean square position error of a pose in the workspace",
    "A": "mean variance of the unknowns",
    "D": "volume of the unknowns' confidence ellipsoid",
    "E": "variance of the least known direction",
}
"""What a criterion makes small."""
SAG = Column("expected_sag_mm", "sag", "mm", ".2f")
CURVE = (
    Column("poses", "poses", form="d"),
    Column("greedy_mm", "best next pose", "mm"),
    Column("random_median_mm", "random median", "mm"),
    Column("random_p10_mm", "random 10 %", "mm"),
    Column("random_p90_mm", "random 90 %", "mm"),
)
"""Errors over the workspace of other plans by the number of poses."""


def tables(report: AbsolutePlanReport) -> dict[str, Table]:
    """The poses in full and for 80 columns, the errors of other plans."""
    shown, travel = report.plan[:MOST_ROWS], POSES[-1]
    slid = [SLID] * ("mm" in report.units)
    many = len(report.joints) > MANY
    short = Column("expected_error_mm", "error", "mm")
    return {
        "poses": Table((*joint_columns(report, ".2f"), SAG, ERROR, travel, *slid, WAY), shown),
        "short": Table((*joint_columns(report, ".0f" if many else ".1f"), short, travel, WAY), shown[:10]),
        "curve": Table(CURVE, report.curve),
    }


def words(report: AbsolutePlanReport) -> Words:
    """The words of a plan."""
    values = {"report": report, "tables": tables(report), "criterion": CRITERIA[report.criterion]}
    return Words(Path(__file__).parent, values, "absolute.md.j2")
