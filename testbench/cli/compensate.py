"""testbench compensate MODEL PROGRAM.csv --out CORRECTED.csv: joints that put the loaded tool right."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from testbench.campaign.arm_models import load_model
from testbench.campaign.campaign import build_cell
from testbench.campaign.campaign_flags import MapFile, Payload
from testbench.campaign.plan_input import joints_of, payload_of, place
from testbench.campaign.program import NAMED, correct_program, with_payload
from testbench.cli.arguments import ArmCheck, plain
from testbench.commands.compensate import COMMAND, WRITTEN, Places, report, write
from testbench.correct.newton import Aim, Asked, Hold
from testbench.data.motion import CSV, WRITERS, format_of
from testbench.data.program import read_program
from testbench.errors import BenchError, InputError
from testbench.output.place import Kind, check_file, claim_folder, inside
from testbench.shell.options import Force, of_flag, takes
from testbench.views.terminal import looked_at, plain_console, print_words

SIGNS = {"": 1.0, "-": -1.0}
AXES = {f"{sign}{name}": s * np.eye(3)[k] for sign, s in SIGNS.items() for k, name in enumerate("xyz")}
"""Directions in the tool's frame."""


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    model: Annotated[Path, typer.Argument(help="Folder of a model, of identify or calibrate.")]
    program: Annotated[
        Path, typer.Argument(help="Set-points and their loads, any text table or FILE.xlsx#SHEET.")
    ]
    out: Annotated[Path, typer.Option(help="Corrected: .csv, .src (KRL), .mod (RAPID), .script (URScript).")]
    format: Annotated[
        str | None, typer.Option(help="csv, krl, rapid or urscript, if the suffix does not say.")
    ] = None
    report: Annotated[Path | None, typer.Option(help="Folder of the page; default: beside --out.")] = None
    arm: ArmCheck = None
    mapping: MapFile = None
    payload: Payload = None
    asked: Annotated[
        Asked | None,
        typer.Option(
            help="What the program means: where the tool is unloaded (default of models of identify), or "
            "where the drawn arm has it (of calibrate)."
        ),
    ] = None
    hold: Annotated[
        Hold, typer.Option(help="What to correct: pose, axis (the spindle may turn), or position.")
    ] = "pose"
    tool_point: Annotated[
        str, typer.Option("--tip", help="Tool point in the frame of the tool, x,y,z in m.")
    ] = "0,0,0"
    spindle: Annotated[str, typer.Option(help="Where the spindle points in the tool's frame: x, -x ...")] = (
        "x"
    )
    start: Annotated[
        str | None,
        typer.Option(help="Joints near the first pose, in deg and mm, commas between."),
    ] = None
    tolerance: Annotated[
        float | None,
        typer.Option(
            min=0,
            help="Largest error that passes, in mm, interval counted; exits with 1 if a point fails.",
        ),
    ] = None
    keep_unreachable: Annotated[
        bool, typer.Option("--keep-unreachable", help="Leave points that cannot be corrected unchanged.")
    ] = False
    jumps: Annotated[bool, typer.Option("--jumps", help="Accept points far apart.")] = False
    force: Force = False


@takes(Options)
def command(asked: Options) -> None:
    """Correct a program for what the process load does to the arm; write it, and a page beside it."""
    to = program_to, form, folder = _places(asked)
    given = [asked.model, asked.program, *([asked.mapping] if asked.mapping else [])]
    kind = Kind("a corrected program", rb"[^\n]*correction_")
    if form != CSV:
        kind = Kind(f"a program in {WRITERS[form].title}", WRITERS[form].begins.encode())
    check_file(program_to, kind, inputs=given, force=asked.force)
    with claim_folder(folder, COMMAND, own=frozenset(), inputs=given, force=asked.force):
        aim = _aim(asked)
        model = load_model(asked.model, asked.arm)
        if not model.arm.joints:
            raise BenchError(f"{model.arm.name} has no joints: nothing could correct it")
        cell = build_cell(asked.model)
        program = read_program(asked.program, model.arm, asked.mapping, jumps=asked.jumps)
        program, notes = with_payload(model, program, lambda: payload_of(model.arm, asked.payload, "--load"))
        start = None if asked.start is None else joints_of(asked.start, model.arm)
        found = correct_program(model, program, aim, cell.room, start=start)
        if found.unreached and not asked.keep_unreachable:
            named, more = "; ".join(found.unreached[:NAMED]), len(found.unreached) - NAMED
            named += f"; and {more} more" if more > 0 else ""
            problem = f"{named}; --keep-unreachable leaves such points as they are"
            raise InputError(asked.program, "", problem)
        said = report(found, asked.tolerance)
        write(cell, found, said, plain(asked, read="program", without=("model",)), to)
        console = plain_console()
        for note in notes:
            console.print(note, soft_wrap=True)
        lines = [
            f"corrected  {program_to}",
            f"report     {', '.join(str(folder / name) for name in WRITTEN)}",
            *looked_at(folder),
        ]
        print_words(console, said, [said.tables["worst"]], lines)
    if any(row.verdict == "fail" for row in said.numbers["rows"]):
        raise typer.Exit(1)


def _places(asked: Options) -> Places:
    if not asked.out.name:
        raise InputError(asked.out, "", "expected the name of a file, got a folder")
    named = asked.out.stem if asked.out.suffix == ".csv" else asked.out.name.replace(".", "_")
    beside = asked.out.with_name(f"{named}_report")
    if asked.report and inside(asked.out, asked.report):
        raise InputError(asked.out, "", f"expected a place outside of {asked.report}, the folder of --report")
    with of_flag("--format" if asked.format else "--out"):
        return asked.out, format_of(asked.out, asked.format), asked.report or beside


def _aim(asked: Options) -> Aim:
    if asked.spindle not in AXES:
        raise InputError(Path("--spindle"), "", f"expected one of {', '.join(AXES)}, got {asked.spindle!r}")
    x, y, z = AXES[asked.spindle].tolist()
    return Aim(asked.hold, asked.asked, place(asked.tool_point, "--tip x,y,z [m]"), (x, y, z))
