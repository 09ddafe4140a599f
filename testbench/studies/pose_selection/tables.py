"""The columns and tables of the study of pose selection."""

from dataclasses import replace

from testbench.studies.pose_selection.report import PoseReport
from testbench.studies.pose_selection.settings import PLANNED
from testbench.views.schema import Column, Table, pivot

PLAN = Column("plan", "poses by")
POSES = Column("poses", "poses", form="d")
TASKS = Column("tasks_mm", "tasks", "mm")
WORKSPACE = Column("workspace_mm", "workspace", "mm")
EFFICIENCY = Column("efficiency", "efficient, at least", "%", ".1f", scale=100, short="effi-\ncient\n>= %")
EXPECTED = Column("expected_tasks_mm", "forecast tasks", "mm", short="fore-\ncast\ntasks\nmm")
JUDGED = Column("judged.tasks_mm", "simulated tasks", "mm")
VARIANT = Column("variant", "measured")
CRITERIA = (PLAN, EFFICIENCY, EXPECTED, TASKS, WORKSPACE)
"""The featured number of poses; errors are RMS against the true deflection."""
PLANS = (
    Column("criterion", "criterion"),
    POSES,
    EFFICIENCY,
    Column("directions_seen", "directions seen", form=".0f"),
    Column("directions_of_loads", "of", form=".0f"),
    EXPECTED,
    Column("expected_tasks_p05_mm", "5 %", "mm"),
    Column("expected_tasks_p95_mm", "95 %", "mm"),
    Column("expected_workspace_mm", "forecast workspace", "mm"),
    *(Column(f"observability.{key}", key.upper(), form=".1e") for key in ("o1", "o2", "o3", "o4", "o5")),
    Column("seconds", "time", "s", ".1f"),
)
FORECASTS = (
    PLAN,
    POSES,
    Column("expected_mm", "forecast", "mm", ".4f"),
    Column("gco_mm", "simulated GCO", "mm", ".4f"),
    Column("ls_mm", "simulated LS", "mm", ".4f"),
    Column("gco_over_expected", "GCO over forecast"),
    Column("inside_90_percent", "inside 90 % interval", "%", ".0f", scale=100),
)
KEPT = (
    Column("cases", "promises"),
    Column("count", "cases", form="d"),
    Column("inside_90", "inside 90 % interval", "%", ".0f", scale=100),
    Column("below", "below", "%", ".0f", scale=100),
    Column("above", "above", "%", ".0f", scale=100),
    Column("inside_95", "deflections inside 95 % interval", "%", ".1f", scale=100),
    Column("ratio", "simulated over promised", form=".2f"),
)
VARIANTS = (
    VARIANT,
    POSES,
    Column("directions", "directions", form=".0f"),
    Column("with_first_load", "runs under first load", form="d"),
    EFFICIENCY,
    EXPECTED,
    JUDGED,
    Column("judged.workspace_mm", "simulated workspace", "mm"),
)
GROUNDS = (
    Column("ground", "tasks"),
    Column("fit", "planned for and identified by"),
    EXPECTED,
    Column("tasks.planned_mm", "planned, tasks", "mm"),
    Column("tasks.random_mm", "random, tasks", "mm"),
    Column("tasks.ratio", "ratio, tasks", form=".2f"),
    Column("tasks.wins", "planned better, tasks", form="d"),
    Column("workspace.planned_mm", "planned, workspace", "mm"),
    Column("workspace.random_mm", "random, workspace", "mm"),
    Column("workspace.ratio", "ratio, workspace", form=".2f"),
    Column("workspace.wins", "planned better, workspace", form="d"),
    Column("workspace.better_than_joints", "better than joints, workspace", form="d"),
)
"""Planned for the very fit, against random poses; counts are of seeds."""


def tables(report: PoseReport) -> dict[str, Table]:
    """The featured poses, every fit at the tasks and over the workspace, plans, forecasts, other ways."""
    levels = {fit: [x for own in rows.values() for x in own] for fit, rows in report.errors.items()}
    curves = {}
    for fit, every in levels.items():
        table = Table((PLAN, POSES, TASKS, WORKSPACE), every)
        curves[f"tasks, {fit}"] = pivot(table, POSES, PLAN, TASKS)
        curves[f"workspace, {fit}"] = pivot(table, POSES, PLAN, WORKSPACE)
    medians = Table((PLAN, POSES, TASKS), levels[PLANNED.name])
    best = report.verdict.tasks
    marked = best[0] if len(best) == 1 else ""
    return {
        "criteria": Table(CRITERIA, report.criteria, bold=marked, headline=TASKS.key),
        "recorded": Table((PLAN, TASKS, WORKSPACE), report.criteria, bold=marked),
        **curves,
        "medians": pivot(medians, POSES, PLAN, replace(TASKS, exact=True)),
        "plans": Table(PLANS, report.plans),
        "forecasts": Table(FORECASTS, report.promises),
        "kept": Table(KEPT, [*report.kept, report.kept_joints]),
        "variants": Table(VARIANTS, report.worth),
        "grounds": Table(GROUNDS, report.grounds),
    }
