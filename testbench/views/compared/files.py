"""The folder of a comparison, all of it or nothing."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from testbench import files
from testbench.bench.compare_report import ComparedReport
from testbench.output.finished import Finished
from testbench.output.run import whole_folder
from testbench.views.compared.words import sortable, words

COMMAND = "testbench compare"  #: As manifest.json names it.


def write(runs: Sequence[Finished], report: ComparedReport, out: Path) -> None:
    """Words, numbers, page, recording and manifest.json.

    Args:
        runs: What was compared.
        report: What was found.
        out: Folder of the results.

    Raises:
        InputError: When they cannot be written.
    """
    from testbench.views.page.page import Seen, write_page
    from testbench.views.recording.run import write_run  # here: importing rerun takes a third of a second
    from testbench.views.recording.stream import Header

    text = words(report)
    asked = {row.letter: {row.folder: run.digest} for row, run in zip(report.runs, runs, strict=True)}
    with whole_folder(out) as folder:
        files.write_json(asdict(report), folder / "report.json")
        (folder / "report.md").write_text(text.whole(), encoding="utf-8")
        header = Header(COMMAND, json.dumps(asked, sort_keys=True), 0)
        seen = Seen(tables=sortable(report))
        write_run(folder / "recording.rrd", header, text, seen, {})
        write_page(folder, "Compare", text, seen)
        files.write_manifest(folder, command=COMMAND, scenario=asked, seeds=range(0), models={})
