"""The folder of a check: picture, recording and page, all of it or nothing."""

import json
from pathlib import Path

from testbench import files
from testbench.bench.checked import Checked
from testbench.bench.model_folder import digests
from testbench.output.run import whole_folder
from testbench.views.checked.words import words
from testbench.views.page.page import write_page

COMMAND = "testbench check"  #: As manifest.json names it.


def write(checked: Checked, arm: Path, out: Path) -> None:
    """arm.png, recording.rrd, report.html and manifest.json; InputError when they cannot be written."""
    from testbench.views.checked.page import seen  # of a second
    from testbench.views.recording.run import write_run
    from testbench.views.recording.stream import Header
    from testbench.views.run_figure import overview  # importing matplotlib and rerun takes two thirds

    with whole_folder(out) as folder:
        text, drawn, name = words(checked), seen(checked), checked.cell.arm.name
        header = Header(COMMAND, json.dumps({"arm": name}), 0)
        overview(text, drawn).savefig(folder / "arm.png")
        write_run(folder / "recording.rrd", header, text, drawn, {"Picture": folder / "arm.png"})
        write_page(folder, f"{COMMAND}: {name}", text, drawn)
        files.write_manifest(folder, command=COMMAND, scenario={}, seeds=range(0), models=digests([arm]))
