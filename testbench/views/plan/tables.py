"""The tables and words of a plan, for terminal, plan.md and recording."""

from dataclasses import replace
from pathlib import Path

from testbench.bench.absolute_plan_report import AbsolutePlanReport
from testbench.bench.plan_report import PlanReport
from testbench.views.markdown import Words
from testbench.views.schema import Column, Table
from testbench.views.worst import worst_table

MOST_ROWS = 40  #: Rows of the plan that are shown; plan.csv has all of them.
MANY = 6  #: With more joints, or pulls, a terminal of 80 columns has no decimals and no travel of slides.
WORST = 5  #: Tasks that are shown, those of the largest errors.
CRITERIA = {
    "test": "mean square error at the tasks",
    "I": "mean square error over the workspace",
    "G": "largest mean square error of a pose in the workspace",
    "A": "mean variance of the unknowns",
    "D": "volume of the unknowns' confidence ellipsoid",
    "E": "variance of the least known direction",
}
"""What a criterion makes small."""
DEFLECTION = Column("expected_deflection_mm", "deflection", "mm", ".2f")
ERROR = Column("error_mm", "error there", "mm")
TRAVEL = Column("travel_deg", "travel", "deg", ".0f")
POSES = (
    Column("load_kg", "load", "kg", "g"),
    DEFLECTION,
    ERROR,
    TRAVEL,
)
"""What a plan says of a pose, behind its joints."""
PULLED = Column("load", "load")  #: In place of the mass, where a plan may pull.
SLID = Column("travel_mm", "travel", "mm", ".0f")
WAY = Column("way", "way")
TASKS = (Column("task", "task", form="d"), DEFLECTION, ERROR)
CURVE = (
    Column("poses", "poses", form="d"),
    Column("greedy_mm", "best next pose", "mm"),
    Column("random_median_mm", "random median", "mm"),
    Column("random_p10_mm", "random 10 %", "mm"),
    Column("random_p90_mm", "random 90 %", "mm"),
)
"""Errors at the tasks of other plans by the number of poses."""


def tables(report: PlanReport) -> dict[str, Table]:
    """The poses in full and for 80 columns, the worst tasks, the errors of other plans."""
    shown = report.plan[:MOST_ROWS]
    load = (PULLED, *POSES[1:]) if report.pulls_n else POSES
    columns = (*load, *[SLID] * ("mm" in report.units), WAY)
    narrow = tuple(replace(c, exact=True, heading="error") if c is ERROR else c for c in columns)
    many = len(report.joints) > MANY or bool(report.pulls_n)
    left_out = (DEFLECTION, *[SLID] * many, *[TRAVEL] * bool(report.pulls_n))
    return {
        "poses": Table((*joint_columns(report, ".2f"), *columns), shown),
        "short": Table(
            (*joint_columns(report, ".0f" if many else ".1f"), *(c for c in narrow if c not in left_out)),
            shown,
        ),
        "tasks": Table(TASKS, report.worst[:WORST]),
        "curve": Table(CURVE, report.curve),
        "map": worst_table(report.map),
    }


def joint_columns(report: PlanReport | AbsolutePlanReport, form: str) -> list[Column]:
    """Number of a run and its joints; a terminal has room for q1, q2, ... only."""
    return [
        Column("run", "run", form="d"),
        *(
            Column(f"q_shown.{k}", name, unit, form, short=f"q{k + 1}\n{unit}")
            for k, (name, unit) in enumerate(zip(report.joints, report.units, strict=True))
        ),
    ]


def words(report: PlanReport) -> Words:
    """The words of a plan."""
    values = {"report": report, "tables": tables(report), "criterion": CRITERIA[report.criterion]}
    return Words(Path(__file__).parent, values, "plan.md.j2")
