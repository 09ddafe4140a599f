"""testbench compensate MODEL PROGRAM.csv --out CORRECTED.csv: joints that bring the tool to its target."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from testbench.correct.newton import CorrectedPart
from testbench.correct.newton import JointMeaning as Meant
from testbench.errors import BenchError
from testbench.files.program import read_program
from testbench.report.badge import Badge, decide
from testbench.report.markdown import Markdown, capital, ended
from testbench.report.markdown import counted as number_of
from testbench.report.program_scene import (
    AFTER,
    BEFORE,
    CORRECTED,
    EXPECTED,
    LOOKS,
    STIFFNESS,
    WITHIN,
    draw_correction,
    program_figures,
)
from testbench.report.report import Report, RunRequest, say, write_run
from testbench.report.schema import Table, columns
from testbench.report.table import Row
from testbench.report.terminal import plain_console, print_words, viewing_lines
from testbench.runs.manifest import digest
from testbench.runs.spread import MIN_PERCENTILE_TRIALS
from testbench.runs.whole import check_file, claim_folder, whole_files
from testbench.workflows import program as programs
from testbench.workflows.arm_models import load_model
from testbench.workflows.cell import build_cell
from testbench.workflows.options import ArmCheck, Force, MapFile, Payload, Recording, of_flag, plain, takes
from testbench.workflows.plan_input import joints_of
from testbench.workflows.program import CorrectedProgram
from testbench.workflows.program_numbers import correction_numbers, correction_warnings

COMMAND, PICTURE = "testbench compensate", "compensation.png"
WRITTEN = ("report.md", "report.json", PICTURE, STIFFNESS)
#: Chance that the median point gets better from which on the correction is sure to help [1].
SURE_PROBABILITY = 0.95


@dataclass(frozen=True)
class CompensateOptions:
    """Hold the flags of the command."""

    model: Annotated[Path, typer.Argument(help="Folder of an identified or calibrated arm.")]
    program: Annotated[Path, typer.Argument(help="Table of points and loads, or a robot's program.")]
    out: Annotated[
        Path,
        typer.Option(metavar="FILE", help="Corrected program: .csv, .src, .mod, .script, .ls, .jbi."),
    ]
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the report (default: beside --out).")
    ] = None
    arm: ArmCheck = None
    mapping: MapFile = None
    payload: Payload = None
    asked: Annotated[
        Meant | None,
        typer.Option(metavar="HOW", help="Programmed poses are of the unloaded, or the drawn (rigid), arm."),
    ] = None
    hold: Annotated[
        CorrectedPart, typer.Option(metavar="WHAT", help="What to correct: pose, axis or position.")
    ] = "pose"
    tool_point: Annotated[
        str, typer.Option("--tip", metavar="X,Y,Z", help="Tool point in the tool's frame, m.")
    ] = "0,0,0"
    spindle: Annotated[str, typer.Option(metavar="AXIS", help="Spindle axis in the tool's frame.")] = "x"
    start: Annotated[
        str | None, typer.Option(metavar="Q", help="Joint angles near the first point, deg or mm.")
    ] = None
    tolerance: Annotated[
        float | None, typer.Option(min=0, metavar="MM", help="Exit with 1 if an error may exceed MM.")
    ] = None
    keep_unreachable: Annotated[
        bool, typer.Option("--keep-unreachable", help="Keep unreachable points unchanged.")
    ] = False
    jumps: Annotated[bool, typer.Option("--jumps", help="Accept large steps between points.")] = False
    recording: Recording = False
    force: Force = False


@takes(CompensateOptions, draws=True)
def command(asked: CompensateOptions) -> None:
    """Correct a program for what the process load does to the arm; write it, and a page beside it."""
    with of_flag("--out"):
        form, kind, folder = programs.output_paths(asked.out, asked.report)
    files = programs.output_files(asked.out, form, asked.program)
    given = [asked.model, *programs.input_files(asked.program), *([asked.mapping] if asked.mapping else [])]
    for file in files:
        check_file(file, kind, inputs=given, force=asked.force)
    with claim_folder(folder, COMMAND, own=frozenset(), inputs=given, force=asked.force):
        aim = programs.aim_of(asked.hold, asked.asked, asked.tool_point, asked.spindle)
        model = load_model(asked.model, asked.arm)
        if not model.arm.joints:
            raise BenchError(f"{model.arm.name} has no joints, so a program cannot correct it")
        cell = build_cell(asked.model)
        program = read_program(asked.program, model.arm, asked.mapping, jumps=asked.jumps)
        programs.refuse_corrected(program)
        program, notes = programs.with_payload(model, program, asked.payload)
        start = None if asked.start is None else joints_of(asked.start, model.arm)
        corrected_program = programs.correct_program(model, program, aim, cell.room, start=start)
        if not asked.keep_unreachable:
            programs.refuse_unreached(corrected_program)
        said = report(corrected_program, asked.tolerance)
        flags, arm = plain(asked, read="program", without=("model",)), cell.arm.mjcf_path.parent
        notes += programs.configuration_notes(program, start) + programs.conversion_notes(program, form)
        notes += programs.turn_notes(corrected_program)
        with whole_files(files) as parts:
            programs.write_corrected(corrected_program, parts, form)
            # a kill may leave the earlier one
            more = {"corrected": {file.name: digest(part) for file, part in zip(files, parts, strict=True)}}
            run = RunRequest(
                COMMAND,
                program.path.name,
                flags,
                [arm],
                PICTURE,
                more=lambda _: more,
                draw=partial(program_figures, PICTURE, said.numbers["ellipsoid_force_n"]),
                recording=asked.recording,
            )
            write_run(folder, run, said, draw_correction(cell, corrected_program, said))
        places = ", ".join(str(folder / name) for name in WRITTEN)
        out = ", ".join(map(str, files))
        lines = [
            *notes,
            f"corrected  {out}",
            f"report     {places}",
            *viewing_lines(folder, recording=asked.recording),
        ]
        print_words(plain_console(), said, [said.tables["worst"]], lines)
    if any(row.verdict == "fail" for row in said.numbers["rows"]):
        raise typer.Exit(1)


def report(found: CorrectedProgram, tolerance_mm: float | None = None) -> Report:
    """Report a corrected program.

    Args:
        found: The corrected program.
        tolerance_mm: Largest error that passes [mm]; None without a tolerance.

    Returns:
        The report.
    """
    f = correction_numbers(found, tolerance_mm)
    answer = "No point has a load: the program is unchanged."
    if f.loaded:
        answer = (
            "Expected error of the tool, median: {before_mm.median:.3f} mm as programmed. "
            "{unseen:counted point} have no bound after correction."
        )
    if f.loaded and f.most_mm:  # bound beside bound: the expected error of a corrected program is no success
        answer = (
            "95 % bound on the error of the tool, median: {before_most_mm.median:.3f} mm as programmed, "
            "{most_mm.median:.3f} mm corrected."
        )
    tables = _tables(f)
    return Report(
        scenario="compensate",
        question=Markdown("Where does the loaded tool go, and which program corrects it?"),
        title=say("{program} corrected for {arm}, {points:counted point}", f),
        answer=say(answer, f),
        claims=[say("{text}", text=ended(capital(text))) for text in correction_warnings(f)],
        numbers=f,
        tables=tables,
        body=[*tables, Markdown("What each table means: docs/correction.md, *Correct*.")],
        badge=badge_of(f),
    )


def badge_of(f: Row) -> Badge | None:
    """Compare 95 % bounds, corrected and not, over the points where something acts; None without any."""
    loaded = [row for row in f.rows if row.before_mm > 0]
    if not loaded:
        return None
    sizes = [np.array([row[key] for row in loaded], dtype=float) for key in ("most_mm", "before_most_mm")]
    why = "the correction may make the error larger" if f.harmful else ""
    if not why and f.tolerance and f.tolerance.failed:
        why = f"{number_of(f.tolerance.failed, 'point')} may be off by more than {f.tolerance.mm:g} mm"
    badge = decide((CORRECTED, sizes[0]), (BEFORE, sizes[1]), "point", why)
    badge = replace(badge, what="95 % bound", article="the ")
    likely = badge.verdict == "holds" and f.chance < SURE_PROBABILITY
    return replace(badge, verdict="likely", chance=f.chance) if likely else badge


def _tables(f: Row) -> dict[str, Table]:
    """How far the tool is off, the points that are not corrected or worst, and all other numbers."""
    errors = {WITHIN: f.before_most_mm, AFTER: f.most_mm}
    if f.most_mm is None:
        errors = {EXPECTED: f.before_mm, AFTER: None}
    off = [Row({f"{k}_mm": mm for k, mm in (own or {}).items()}, what=name) for name, own in errors.items()]
    sizes = columns(f"what median_mm {'p95_mm' if f.loaded >= MIN_PERCENTILE_TRIALS else ''} max_mm")
    turn, reason = "turn_left_mrad" if f.turned else "", "reason" if f.corrected < f.points else ""
    verdict, key = ("verdict", "most_mm") if f.tolerance else ("", "before_mm")
    points = columns(f"line label before_mm before_most_mm most_mm {verdict} {turn} {reason}")
    worst = sorted(f.rows, key=lambda row: (not row.reason, -(np.inf if row[key] is None else row[key])))[:12]
    others = [Row(what=name, value=own) for name, own in _others(f) if own is not None]
    return {
        "sizes": Table(sizes, off, "Error of the loaded tool", headline="median_mm", looks=LOOKS),
        "worst": Table(points, worst, f"Worst points, {len(worst)} of {f.points:,}", headline="before_mm"),
        "numbers": Table(columns("what value"), others, "Other numbers"),
    }


def _others(f: Row) -> Iterator[tuple[str, object]]:
    """Numbers that stand in no other table, with their units."""
    yield "model", f.method
    yield "arm of the programmed poses: unloaded, or drawn (rigid)", f.asked
    yield "corrected quantity", f.hold
    yield "points with a load", f.loaded
    yield "points corrected", f.corrected
    yield "largest force, N", f.force_n[1]
    yield "expected error as programmed, median, mm", f.before_mm.median
    yield "expected error as programmed, largest, mm", f.before_mm.max
    yield "probability that a point improves, median, %", f.chance and 100 * f.chance
    yield (
        "95 % half width relative to the other points, median, mm",
        f.half_fitted_mm and f.half_fitted_mm.median,
    )
    yield (
        "95 % half width relative to the other points, largest, mm",
        f.half_fitted_mm and f.half_fitted_mm.max,
    )
    if f.open:
        yield f"variance of the corrected tool position from {f.open.name}, %", 100 * f.open.share
    yield "largest orientation change that is not corrected, mrad", f.turns_mrad or None
    if f.tolerance:
        yield "tolerance, mm", f.tolerance.mm
        yield "points outside the tolerance, as programmed", f.tolerance.failed_before
        yield "points outside the tolerance, corrected", f.tolerance.failed
    if f.jump:
        yield f"largest jump of a correction between two points, {f.jump.unit}", f.jump.size
        yield "joint and line of this jump", f"{f.jump.joint}, line {f.jump.line}"
