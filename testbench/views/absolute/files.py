"""The folder of a calibration, all of it or nothing."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from testbench import files
from testbench.bench.absolute_doubts import doubts
from testbench.bench.absolute_model import write_model
from testbench.bench.absolute_summary import Reported
from testbench.bench.campaign import Cell
from testbench.bench.model_folder import digests
from testbench.output.run import whole_folder
from testbench.views.absolute.words import words
from testbench.views.page.page import write_page

COMMAND = "testbench calibrate"  #: As manifest.json names it.


def write(
    cell: Cell,
    reported: Reported,
    data: Mapping[str, str],
    asked: Mapping[str, object],
    out: Path,
) -> None:
    """The model, its report, figure, recording, page and manifest.json.

    Args:
        cell: The arm.
        reported: Its calibration, and what there is to say of it.
        data: SHA-256 of every file of readings, by its name.
        asked: What was asked for, as plain data.
        out: Folder of the results.

    Raises:
        InputError: When they cannot be written.
    """
    from testbench.views.absolute.page import seen  # thirds of a second
    from testbench.views.recording.run import write_run
    from testbench.views.recording.stream import Header
    from testbench.views.run_figure import overview  # here: importing matplotlib and rerun takes two

    report = reported.report
    said = [f"{doubt.name.capitalize()}: {doubt.sentence}" for doubt in doubts(report)]
    with whole_folder(out) as folder:
        write_model(reported.found.calibration, data, said, folder)
        files.write_json(asdict(report), folder / "report.json")
        text = words(report)
        (folder / "report.md").write_text(text.whole(), encoding="utf-8")
        header = Header(COMMAND, json.dumps({"arm": report.arm, **asked}, sort_keys=True), 0)
        drawn = seen(cell, reported)
        overview(text, drawn).savefig(folder / "calibration.png")
        write_run(folder / "recording.rrd", header, text, drawn, {"Charts": folder / "calibration.png"})
        write_page(folder, f"{COMMAND}: {report.arm}", text, drawn)
        files.write_manifest(
            folder, command=COMMAND, scenario=asked, seeds=range(0), models=digests([cell.arm.rigid.parent])
        )
