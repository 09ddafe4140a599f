"""The folder of a check of data: picture, recording and page, all of it or nothing."""

import json
from pathlib import Path

from testbench import files
from testbench.bench.campaign import Cell
from testbench.bench.model_folder import digests
from testbench.output.run import whole_folder
from testbench.views.data.words import CheckedRuns, words
from testbench.views.page.page import write_page

COMMAND = "testbench data check"  #: As manifest.json names it.


def write(cell: Cell, runs: CheckedRuns, out: Path) -> None:
    """data.png, recording.rrd, report.html and manifest.json; InputError when they cannot be written."""
    from testbench.views.data.page import seen  # of a second
    from testbench.views.recording.run import write_run
    from testbench.views.recording.stream import Header
    from testbench.views.run_figure import overview  # importing matplotlib and rerun takes two thirds

    with whole_folder(out) as folder:
        text, drawn = words(runs), seen(cell, runs)
        header = Header(COMMAND, json.dumps({"arm": cell.arm.name, "data": runs.name}), 0)
        overview(text, drawn).savefig(folder / "data.png")
        write_run(folder / "recording.rrd", header, text, drawn, {"Charts": folder / "data.png"})
        write_page(folder, f"{COMMAND}: {runs.name}", text, drawn)
        arms = [cell.arm.rigid.parent]
        files.write_manifest(
            folder, command=COMMAND, scenario={"data": runs.name}, seeds=range(0), models=digests(arms)
        )
