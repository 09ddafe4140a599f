"""The folder of a plan, all of it or nothing."""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

from testbench import files
from testbench.arm.folder import Joint
from testbench.bench.campaign import Cell
from testbench.bench.model_folder import digests
from testbench.bench.plan import Planned
from testbench.bench.plan_report import PlanReport, PoseRow, Row
from testbench.bench.plan_settings import PlanSettings
from testbench.data.posefile import plan_columns
from testbench.model.vjm import chain
from testbench.output.run import whole_folder
from testbench.output.whole import write_whole
from testbench.views.map_figure import error_map
from testbench.views.page.page import write_page
from testbench.views.plan.figure import overview
from testbench.views.plan.tables import words

COMMAND = "testbench plan"  #: As manifest.json names it.
OF_PULLS = ("pulls_n", "pull_N", "unshown")  #: Keys that stand in plan.json only where they say something.
EXPECTED = [f"expected_{what}_mm" for what in ("deflection", "error", "error_p05", "error_p95")]


def write(cell: Cell, planned: Planned, arm: Path, task: Path, out: Path) -> None:
    """All files of a plan and its manifest.json; InputError when they cannot be written."""
    from testbench.views.plan.page import seen
    from testbench.views.recording.run import write_run  # here: importing rerun takes a third of a second
    from testbench.views.recording.stream import Header

    report = planned.report
    own = _said([(field.name, getattr(report, field.name)) for field in fields(PlanSettings)])
    asked = {"task": task.name, "arm": report.arm, **own}
    tools = chain(cell.vjm, planned.found.q).position
    with whole_folder(out) as folder:
        write_poses(report, cell.arm.joints, folder / "plan.csv")
        write_tasks(report, cell.arm.joints, folder / "tasks_expected.csv")
        files.write_json(asdict(report, dict_factory=_said), folder / "plan.json")
        text = words(report)
        (folder / "plan.md").write_text(text.whole(), encoding="utf-8")
        error_map(report.map, f"{report.arm}, {report.poses} poses").savefig(folder / "error_map.png")
        seeds = range(report.seed, report.seed + 1)
        header = Header(COMMAND, json.dumps(asked, sort_keys=True), report.seed)
        drawn = seen(cell, planned, tools)
        overview(report, tools).savefig(folder / "plan.png")
        write_run(folder / "recording.rrd", header, text, drawn, {"Charts": folder / "plan.png"})
        write_page(folder, f"{COMMAND}: {report.arm}", text, drawn)
        files.write_manifest(folder, command=COMMAND, scenario=asked, seeds=seeds, models=digests([arm]))


def write_poses(report: PlanReport, joints: Sequence[Joint], path: Path) -> None:
    """plan.csv: `posefile.plan_columns`; rad and m in full, so that reading gives them back bit by bit."""
    rows: list[list[object]] = []
    slides, pulls = any(joint.prismatic for joint in joints), bool(report.pulls_n)
    for row in report.plan:
        asked = [row.run, *map(repr, row.q), *_shown(row), *_load(row, pulls)]
        travel = [f"{row.travel_deg:.2f}", *[f"{row.travel_mm:.2f}"] * slides]
        rows.append([*asked, *_expected(row), *travel, row.way])
    write_table(plan_columns(joints, pulls=pulls), rows, path)


def write_tasks(report: PlanReport, joints: Sequence[Joint], path: Path) -> None:
    """tasks_expected.csv: of every task its pose and the error to expect."""
    head = ["task", *(joint.shown_column for joint in joints), *EXPECTED]
    write_table(head, [[row.task, *_shown(row), *_expected(row)] for row in report.tasks], path)


def _load(row: PoseRow, pulls: bool) -> list[str]:
    """What hangs, and where the plan may pull what pulls; a run has either."""
    mass = "" if row.pull_N else repr(row.load_kg)
    return [mass, *(map(repr, row.pull_N) if row.pull_N else [""] * 3 * pulls)]


def _said(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Keys and values without what is said of pulls where there are none."""
    return {key: value for key, value in pairs if value or key not in OF_PULLS}


def _shown(row: Row) -> list[str]:
    return [f"{value:.4f}" for value in row.q_shown]


def _expected(row: Row) -> list[str]:
    return [f"{getattr(row, key):.4f}" for key in EXPECTED]


def write_table(head: Sequence[str], rows: Sequence[Sequence[object]], path: Path) -> None:
    """A CSV of its header and its rows."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([head, *rows])
    write_whole(text.getvalue(), path)
