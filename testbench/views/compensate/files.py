"""The corrected program and the folder of its report, all of it or nothing."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from testbench import files
from testbench.bench.campaign import Cell
from testbench.bench.compensate import CorrectedProgram, more_columns
from testbench.bench.compensate_report import CompensationReport
from testbench.bench.model_folder import digests
from testbench.data.motion.formats import CSV, WRITERS, write_moves
from testbench.data.program_corrected import write_program
from testbench.output.place import Kind
from testbench.output.run import whole_folder
from testbench.output.whole import whole_file
from testbench.views.compensate.words import words
from testbench.views.page.page import write_page

COMMAND = "testbench compensate"  #: As manifest.json names it.
WRITTEN = ("report.md", "report.json", "compensation.png")  #: For people.
TABLE = Kind("a corrected program", rb"[^\n]*correction_")


@dataclass(frozen=True)
class Places:
    """Where results go."""

    program: Path  #: The corrected program.
    format: str  #: "csv" or a robots' language, as of `format_of`.
    report: Path  #: Folder of the report.


def kind_of(language: str) -> Kind:
    """What a corrected program looks like."""
    if language == CSV:
        return TABLE
    own = WRITERS[language]
    return Kind(f"a program in {own.title}", own.begins)


def write(
    cell: Cell,
    found: CorrectedProgram,
    report: CompensationReport,
    asked: Mapping[str, object],
    to: Places,
) -> None:
    """The report with its figure, recording, page and manifest.json, at last the corrected program.

    Args:
        cell: The arm, of the model's folder.
        found: The correction.
        report: What there is to say of it.
        asked: What was asked for, as plain data.
        to: Where to.

    Raises:
        InputError: When they cannot be written.
    """
    from testbench.views.compensate.page import seen  # thirds of a second
    from testbench.views.recording.run import write_run
    from testbench.views.recording.stream import Header
    from testbench.views.run_figure import overview  # here: importing matplotlib and rerun takes two

    with whole_file(to.program) as program, whole_folder(to.report) as folder:
        files.write_json(asdict(report), folder / "report.json")
        text = words(report)
        (folder / "report.md").write_text(text.whole(), encoding="utf-8")
        header = Header(COMMAND, json.dumps({"arm": report.arm, **asked}, sort_keys=True), 0)
        drawn = seen(cell, found, report)
        overview(text, drawn).savefig(folder / "compensation.png")
        write_run(folder / "recording.rrd", header, text, drawn, {"Charts": folder / "compensation.png"})
        write_page(folder, f"{COMMAND}: {report.program}", text, drawn)
        write_corrected(found, replace(to, program=program))
        files.write_manifest(
            folder,
            command=COMMAND,
            scenario=asked,
            seeds=range(0),
            models=digests([cell.arm.rigid.parent]),
            corrected={to.program.name: files.digest(program)},  # a kill may leave the earlier one beside it
        )


def write_corrected(found: CorrectedProgram, to: Places) -> None:
    """The program alone, as a table or in a robots' language."""
    program, q = found.program, found.found.q
    if to.format == CSV:
        write_program(to.program, program, q, more_columns(found))
    else:
        write_moves(to.program, WRITERS[to.format], q, found.model.arm.joints, program.labels)
