"""testbench data check and data map: contents of a file of readings, and the map that reads it."""

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from testbench.arm.folder import find_arm
from testbench.errors import BenchError, InputError, sheet_of
from testbench.files.columns import Columns, UnknownColumns
from testbench.files.layouts import fitting
from testbench.files.mapping import Map
from testbench.files.propose_map import Proposal, fit_of_series, map_text, propose
from testbench.files.read_pairs import Export, read_export
from testbench.files.read_series import read_series
from testbench.files.read_unknown import sheets_of
from testbench.files.text import UnevenRows
from testbench.identify.diagnosis.hypotheses import length_text
from testbench.report.readings import column_lines, draw_runs, file_lines, report, written
from testbench.report.report import RunRequest, write_run
from testbench.report.table import Row
from testbench.report.terminal import plain_console, print_words, viewing_lines
from testbench.runs.whole import Kind, check_file, claim_folder, whole_file
from testbench.workflows.absolute import kinematic_misfit
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.options import ArmName, Force, Load, ProjectCommand, ShownFolder, takes
from testbench.workflows.read_runs import (
    ReadingOptions,
    column_rows,
    contents,
    diagnose_runs,
    files_read,
    read_export_file,
    register_export,
    registration_notes,
)

COMMAND = "testbench data check"  #: As manifest.json names it.
MAP = Kind("a map that testbench data map wrote", b"# A map of ")
LogFile = Annotated[Path | None, typer.Option(metavar="FILE", help="File of the joint angles, if separate.")]
LoadedReadings = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Loaded readings, if in another file or FILE.xlsx#SHEET.")
]
LayoutName = Annotated[
    str | None, typer.Option(metavar="NAME", help="Layout of the file; default: the one that fits.")
]
group = typer.Typer(no_args_is_help=True)


@dataclass(frozen=True)
class DataOptions:
    """Hold the flags of `data check`."""

    log: LogFile = None
    loaded: LoadedReadings = None
    layout: LayoutName = None
    out: ShownFolder = None
    force: Force = False


@group.command("check", cls=ProjectCommand, help="Show the quantity of each column, and likely mistakes.")
@takes(ReadingOptions, DataOptions, draws=True)
def check(runs: ReadingOptions, asked: DataOptions) -> None:
    """Show the quantity of each column, likely mistakes, and the runs on the arm.

    Args:
        runs: The file, and how it is read.
        asked: Flags of the command.
    """
    given = [find_arm(runs.arm), *files_read(runs), *(file for file in (asked.log, asked.loaded) if file)]
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=given, force=asked.force):
        filed, console = build_cell(runs.arm), plain_console()
        export = _pairs(console, filed, runs, _map_of_layout(console, filed, runs, asked))
        if export is None:
            return
        found = contents(export)
        found["columns"] = [Row(row, values=written(row)) for row in found.columns]
        try:
            cell, registered = register_export(filed, export, runs)
        except BenchError:
            console.print("\n".join(file_lines(found)), soft_wrap=True)  # it helps where no frame is found
            raise
        doubts, scale = diagnose_runs(filed, export, registered, runs)
        found.update(dataset=runs.dataset.name, scale=scale, doubts=[doubt.sentence for doubt in doubts])
        said = report(found, registered)
        lines = file_lines(Row(said.numbers), registration_notes(registered))
        if asked.out is not None:
            name, flags = runs.dataset.name, {"data": runs.dataset.name, "flags": runs.words}
            run = RunRequest(COMMAND, name, flags, [cell.arm.mjcf_path.parent], "data.png")
            write_run(asked.out, run, said, draw_runs(cell, registered))
            opened = viewing_lines(asked.out, arm=runs.arm, data=runs.dataset)
            lines += [f"picture    {asked.out / 'data.png'}", *opened]
        print_words(console, said, lines=lines)


def _pairs(console: Console, cell: Cell, runs: ReadingOptions, mapping: Path | Map | None) -> Export | None:
    """The pairs of a file, by a map, our names or known ones; None of other readings, which are shown."""
    if isinstance(mapping, Map) and not _are_pairs(runs, cell, mapping):
        _show_series(console, cell, runs.dataset, mapping)
        return None
    try:
        return read_export_file(cell, runs, mapping)
    except InputError as err:
        if _shown_as_poses(console, cell, runs.dataset, mapping):
            return None
        if mapping is not None or not isinstance(err, (UnknownColumns, UnevenRows)):
            raise
        suggested = _map_by_names(console, cell, runs, err)
    return _pairs(console, cell, runs, suggested)


def _map_of_layout(
    console: Console, cell: Cell, runs: ReadingOptions, asked: DataOptions
) -> Path | Map | None:
    """The map that is given, else that of the layout that fits, which is printed; None without either."""
    if runs.mapping and (asked.log or asked.layout or asked.loaded):
        raise BenchError(
            "--map states the log, loaded file and layout: leave out --log, --loaded and --layout"
        )
    fits = runs.mapping is None and (
        asked.log
        or asked.loaded
        or fitting(runs.dataset, cell.arm, asked.layout)
        or sheets_of(runs.dataset, cell.arm)
    )
    if not fits:
        return runs.mapping
    proposal = propose(runs.dataset, cell.arm, asked.log, runs.dataset.parent, asked.layout, asked.loaded)
    _print_map(console, runs.dataset, proposal)
    return proposal.map()


def _map_by_names(console: Console, cell: Cell, runs: ReadingOptions, unknown: InputError) -> Map:
    """The map that the names of columns suggest, which is printed; the error if they suggest none."""
    try:
        proposal = propose(runs.dataset, cell.arm, None, runs.dataset.parent)
    except InputError as err:
        raise (unknown if isinstance(unknown, UnknownColumns) and unknown.joints else err) from err
    _print_map(console, runs.dataset, proposal)
    return proposal.map()


def _shown_as_poses(console: Console, cell: Cell, dataset: Path, mapping: Path | Map | None) -> bool:
    """Show distances, and positions without a load, by the map or our names; False for others."""
    with contextlib.suppress(InputError):
        export = read_series(dataset, cell.arm, mapping)
        distances = any(one.distance is not None for one in export.series)
        if distances or not export.columns.all_of("state", "mass", "force", "moment"):
            _show_series(console, cell, dataset, mapping)
            return True
    return False


def _print_map(console: Console, dataset: Path, proposal: Proposal) -> None:
    """Print a proposed map, to be saved."""
    file = sheet_of(dataset)[0]
    hint = f"Save this map as {file.with_suffix('.toml').name} and give it with --map:"
    console.print("\n".join([*_origin(proposal), "", hint, "", _map_file(file, proposal)]), soft_wrap=True)


def _are_pairs(runs: ReadingOptions, cell: Cell, mapping: Map) -> bool:
    """Whether the readings of a file are in pairs, unloaded and loaded."""
    if _along_lines(mapping):
        return True
    series = read_series(runs.dataset, cell.arm, mapping, load=runs.load).series
    return any(own.wrench.any() for own in series)


def _along_lines(mapping: Map) -> bool:
    """Whether a map reads gauges, or pairs of distances."""
    return any(key.startswith(("travel", "distance_before")) for key in mapping.columns)


@dataclass(frozen=True)
class MapOptions:
    """Hold the flags of `data map`."""

    arm: ArmName
    dataset: Annotated[Path, typer.Argument(help="Export of an instrument: text table or FILE.xlsx#SHEET.")]
    log: LogFile = None
    loaded: LoadedReadings = None
    load: Load = None
    layout: LayoutName = None
    out: Annotated[Path | None, typer.Option(metavar="TOML", help="Map to write.")] = None
    force: Force = False


@group.command("map", cls=ProjectCommand)
@takes(MapOptions)
def propose_map(asked: MapOptions) -> None:
    """Propose a map for an export, and show how well its readings fit the arm."""
    file = sheet_of(asked.dataset)[0]
    out, console = asked.out or file.with_suffix(".toml"), plain_console()
    inputs = [find_arm(asked.arm), file, *(file for file in (asked.log, asked.loaded) if file)]
    check_file(out, MAP, inputs=inputs, force=asked.force)
    cell = build_cell(asked.arm)
    proposal = propose(asked.dataset, cell.arm, asked.log, out.parent, asked.layout, asked.loaded)
    with whole_file(out) as part:
        part.write_text(_map_file(file, proposal), "utf-8")
    console.print("\n".join([f"map        {out}", *_origin(proposal), ""]), soft_wrap=True)
    if _along_lines(proposal.map()):
        export = read_export(asked.dataset, cell.arm, out, load=asked.load)
        _show_columns(console, export.columns, export.notes, f"{export.data.n_runs} runs")
        return
    _show_series(console, cell, asked.dataset, out, asked.load)


def _map_file(file: Path, proposal: Proposal) -> str:
    """The text of a proposed map."""
    return f"# A map of {file.name}, proposed by testbench data map\n{map_text(proposal.entries)}"


def _origin(proposal: Proposal) -> list[str]:
    """The layouts of a proposed map, and what it guesses."""
    entries = proposal.entries
    guesses = {why: [own.key for own in entries if own.why == why] for *_, why in entries if why}
    layouts = [f"layout     {name}" for name in proposal.layouts]
    guessed = [f"guess      {', '.join(keys)}: {why}" for why, keys in guesses.items()]
    return [*layouts, *guessed, *([f"missing    {proposal.asked}"] if proposal.asked else [])]


def _show_series(
    console: Console, cell: Cell, dataset: Path, mapping: Path | Map | None, load: float | None = None
) -> None:
    """Show what a map reads of a file, and how well that fits the arm."""
    export = read_series(dataset, cell.arm, mapping, load=load)
    _show_columns(
        console, export.columns, export.notes, f"{sum(series.n_rows for series in export.series)} readings"
    )
    off = length_text(kinematic_misfit(cell.vjm, export.series))
    console.print(f"The median distance of these readings from the nominal arm is {off}.")
    for one in export.series:
        if fit := fit_of_series(cell.arm, one):
            angle = f"{math.degrees(fit.angle):.2g} deg"
            console.print(
                f"{one.name}: orientations differ from the nominal arm by {angle} RMS.", soft_wrap=True
            )


def _show_columns(console: Console, columns: Columns, notes: Sequence[str], count: str) -> None:
    """Show what the columns of a file are, which are not read, and how much it holds."""
    rows = [Row(row, values=written(row)) for row in column_rows(columns)]
    unread = f"columns not read: {', '.join(columns.ignored) or 'none'}"
    remarks = [f"- {note}" for note in (*columns.table.notes, *notes)]
    console.print("\n".join([*column_lines(rows), "", unread, *remarks, count]), soft_wrap=True)
