"""The folder of an identified model, all of it or nothing."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from testbench import files
from testbench.bench.campaign import Cell
from testbench.bench.explained import Explained
from testbench.bench.model_folder import FITS, digests
from testbench.bench.stiffness_write import write_stiffness
from testbench.output.run import whole_folder
from testbench.views.identified.report import report_of
from testbench.views.identified.words import words
from testbench.views.markdown import Words
from testbench.views.page.page import write_page

COMMAND = "testbench identify"  #: As manifest.json names it.


@dataclass(frozen=True)
class Source:
    """What was read, and what was asked for."""

    filed: Cell  #: The arm as its folder has it.
    cell: Cell  #: The same with the targets that were found.
    data: Mapping[str, str]  #: SHA-256 of every file of readings, by its name.
    asked: Mapping[str, object]  #: As plain data.


def write(source: Source, made: Explained, out: Path) -> Words:
    """The model, all fits, their report, figure, recording, page and manifest.json.

    Args:
        source: Where it comes from.
        made: What was found.
        out: Folder of the results.

    Returns:
        What there is to say.

    Raises:
        InputError: When they cannot be written.
    """
    from testbench.views.identified.page import seen  # thirds of a second
    from testbench.views.map_figure import error_map
    from testbench.views.recording.run import write_run
    from testbench.views.recording.stream import Header
    from testbench.views.run_figure import overview  # here: importing matplotlib and rerun takes two

    cell, fits, asked = source.cell, made.found.fits, dict(source.asked)
    report = report_of(cell, made)
    with whole_folder(out) as folder:
        files.write_json(asdict(fits), folder / FITS)
        write_stiffness(cell, made.found, made.runs, source.data, folder)
        files.write_json(asdict(report), folder / "report.json")
        text = words(fits, report)
        (folder / "report.md").write_text(text.whole(), encoding="utf-8")
        if report.map is not None and report.map.bounded:
            error_map(report.map.errors, f"{report.arm} under {report.map.load}").savefig(
                folder / "error_map.png"
            )
        header = Header(COMMAND, json.dumps({"arm": fits.arm, **asked}, sort_keys=True), 0)
        drawn = seen(source.filed, made, report)
        overview(text, drawn).savefig(folder / "identify.png")
        write_run(folder / "recording.rrd", header, text, drawn, {"Charts": folder / "identify.png"})
        write_page(folder, f"{COMMAND}: {fits.arm}", text, drawn)
        arms = [cell.arm.rigid.parent]
        files.write_manifest(folder, command=COMMAND, scenario=asked, seeds=range(0), models=digests(arms))
    return text
