"""The folder of a plan of absolute readings, all of it or nothing."""

import json
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

from testbench import files
from testbench.arm.folder import Joint
from testbench.bench.absolute_plan import AbsolutePlanned
from testbench.bench.absolute_plan_report import AbsolutePlanReport
from testbench.bench.absolute_plan_settings import AbsolutePlanSettings
from testbench.bench.campaign import Cell
from testbench.bench.model_folder import digests
from testbench.data.posefile import absolute_columns
from testbench.model.vjm import chain
from testbench.output.run import whole_folder
from testbench.views.map_figure import error_map
from testbench.views.page.page import write_page
from testbench.views.plan.absolute_figure import overview
from testbench.views.plan.absolute_tables import words
from testbench.views.plan.files import COMMAND, write_table

EXPECTED = [f"expected_{what}_mm" for what in ("sag", "error", "error_p05", "error_p95")]


def write(cell: Cell, planned: AbsolutePlanned, arm: Path, out: Path) -> None:
    """All files of a plan and its manifest.json; InputError when they cannot be written."""
    from testbench.views.plan.absolute_page import seen
    from testbench.views.recording.run import write_run  # here: importing rerun takes a third of a second
    from testbench.views.recording.stream import Header

    report = planned.report
    own = {field.name: getattr(report, field.name) for field in fields(AbsolutePlanSettings)}
    asked = {"absolute": True, "arm": report.arm, **own}
    tools = chain(cell.vjm, planned.found.q).position
    with whole_folder(out) as folder:
        write_poses(report, cell.arm.joints, folder / "plan.csv")
        files.write_json(asdict(report), folder / "plan.json")
        text = words(report)
        (folder / "plan.md").write_text(text.whole(), encoding="utf-8")
        error_map(report.map, f"{report.arm}, {report.poses} poses").savefig(folder / "error_map.png")
        header = Header(COMMAND, json.dumps(asked, sort_keys=True), report.seed)
        drawn = seen(cell, planned, tools)
        overview(report, tools).savefig(folder / "plan.png")
        write_run(folder / "recording.rrd", header, text, drawn, {"Charts": folder / "plan.png"})
        write_page(folder, f"{COMMAND}: {report.arm}", text, drawn)
        seeds = range(report.seed, report.seed + 1)
        files.write_manifest(folder, command=COMMAND, scenario=asked, seeds=seeds, models=digests([arm]))


def write_poses(report: AbsolutePlanReport, joints: Sequence[Joint], path: Path) -> None:
    """plan.csv: `posefile.absolute_columns`; rad and m in full, read back bit by bit."""
    slides, loaded = any(joint.prismatic for joint in joints), len(report.loads_kg) == 1
    rows: list[list[object]] = []
    for row in report.plan:
        shown = [f"{value:.4f}" for value in row.q_shown]
        expected = [f"{getattr(row, key):.4f}" for key in EXPECTED]
        travel = [f"{row.travel_deg:.2f}", *[f"{row.travel_mm:.2f}"] * slides]
        mass = [repr(report.loads_kg[0])] if loaded else []
        rows.append([row.run, *map(repr, row.q), *shown, *mass, *expected, *travel, row.way])
    write_table(absolute_columns(joints, loaded=loaded), rows, path)
