"""testbench export MODEL --urdf robot.urdf: what was identified in the robot's own file or a controller's."""

import contextlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from testbench.arm.decimal import read_decimals
from testbench.arm.folder import Arm
from testbench.arm.urdf_text import BEGINS as STAMPED
from testbench.arm.urdf_text import BEGINS_NEW
from testbench.campaign.arm_models import load_model
from testbench.campaign.controller_files import ABB, STAMP, UR, read_controller
from testbench.campaign.export import BEGINS, Draft, beside_of, draft_new, draft_own, export
from testbench.campaign.export_controller import draft_ur, export_offsets
from testbench.campaign.export_geometry import POSES
from testbench.campaign.export_left import BestOffsets, Sizes
from testbench.errors import BenchError, InputError
from testbench.identify.arm_model import ArmModel
from testbench.output.manifest import read_plain
from testbench.output.place import HEAD, INSTEAD, Kind, check_file, look
from testbench.output.whole import writing
from testbench.shell.options import Force, takes
from testbench.trials.rows import Row
from testbench.views.terminal import plain_console

URDF = Kind("a URDF that testbench export wrote", STAMPED)
BESIDE = Kind("the JSON beside such a file", BEGINS)
CONTROLLER = Kind("such a file that testbench export wrote", rb"(?s).*?" + STAMP.encode())


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    model: Annotated[Path, typer.Argument(help="Folder of a model, of calibrate or identify.")]
    urdf: Annotated[
        Path | None,
        typer.Option(help="The robot's own URDF; where there is none, one is written from scratch."),
    ] = None
    into: Annotated[
        Path | None,
        typer.Option(help="The robot's own kinematics of a UR driver, $machine.dat of KUKA, MOC.cfg of ABB."),
    ] = None
    gears: Annotated[
        str, typer.Option(help="Of ABB: turns of each motor for one of its axis, with sign: a,b,...")
    ] = ""
    out: Annotated[Path | None, typer.Option(help="File to write; else NAME_calibrated here.")] = None
    tip: Annotated[
        str | None, typer.Option(help="Link of the robot's own URDF that carries the tool; else its end.")
    ] = None
    force: Force = False


@takes(Options)
def command(asked: Options) -> None:
    """Write a model into a URDF or a controller's file, what that cannot hold as JSON beside it."""
    if asked.urdf is not None and asked.into is None:
        _write_urdf(asked, asked.urdf)
    elif asked.into is not None and asked.urdf is None and asked.tip is None:
        _write_into(asked, asked.into)
    else:
        raise BenchError("expected --urdf or --into, one of the two; --tip is for --urdf")


def _write_urdf(asked: Options, urdf: Path) -> None:
    own = look(urdf) is not None and not (_new(urdf) and asked.out is None)  # with --out it is as any other
    if not own and (asked.out or asked.tip):
        problem = "expected the robot's own URDF; to write one from scratch leave --out and --tip away"
        raise InputError(urdf, "", problem)
    out = (asked.out or Path(f"{urdf.stem}_calibrated.urdf")) if own else urdf
    if out.suffix.lower() != ".urdf":
        raise InputError(out, "", "expected the name of a URDF, ending with .urdf")
    model = _read(asked, out, URDF, [urdf] if own else [])
    _export(model, draft_own(model.state, urdf, asked.tip) if own else draft_new(model.state), out)


def _write_into(asked: Options, file: Path) -> None:
    out, (form, _) = asked.out or Path(f"{file.stem}_calibrated{file.suffix}"), read_controller(file)
    try:
        gears = read_decimals(word.strip() for word in asked.gears.split(",") if asked.gears)
    except ValueError as err:
        raise BenchError(f"--gears: expected numbers with commas between, got {asked.gears!r}") from err
    if gears and form is not ABB:
        raise BenchError("--gears: is for ABB's motors alone")
    model = _read(asked, out, CONTROLLER, [file])
    if form is UR:
        _export(model, draft_ur(model.state, file), out)
    else:
        _say(model, _offset_words(model.arm, out, *export_offsets(model.state, file, out, gears)))


def _read(asked: Options, out: Path, kind: Kind, files: list[Path]) -> ArmModel:
    """The model, once both files may be written."""
    inputs = [asked.model, *files]
    check_file(out, kind, inputs=inputs, force=asked.force)
    check_file(beside_of(out), BESIDE, inputs=inputs, force=asked.force)
    model = load_model(asked.model)
    if not asked.force:
        _refuse_another(out, model.arm.name)
    return model


def _export(model: ArmModel, draft: Draft, out: Path) -> None:
    stood = look(out) is not None
    _say(model, _words(model.arm.name, draft, out, export(model.state, draft, out), replaced=stood))


def _say(model: ArmModel, lines: list[str]) -> None:
    if not model.absolute:
        lines.append("the model is of compliances alone: its geometry is the drawing's")
    plain_console().print("\n".join(lines), soft_wrap=True)


def _new(urdf: Path) -> bool:
    """Whether an earlier call wrote it from scratch: then it is no input."""
    if not urdf.is_file():
        return False
    with writing(urdf), urdf.open("rb") as file:
        return re.match(BEGINS_NEW, file.read(HEAD)) is not None


def _refuse_another(out: Path, arm: str) -> None:
    """Refuse to replace what an earlier call wrote of another arm, as the JSON beside it says."""
    with contextlib.suppress(InputError):
        found = read_plain(beside_of(out))
        other = found.get("arm") if isinstance(found, dict) else None
        if isinstance(other, str) and other != arm:
            raise BenchError(f"{out}: testbench export wrote it of another arm, {other}; {INSTEAD}")


def _words(arm: str, draft: Draft, out: Path, done: Row, *, replaced: bool) -> list[str]:
    off, back, (moved, moved_most) = draft.drawing_off, done.read_back, done.geometry_mm
    tip, at = draft.frames.names[-1], f"{out}, replaced" if replaced and off is not None else out
    lines = [
        f"{arm}: the identified geometry is in {at}, its tool is {tip!r}",
        f"read back by Pinocchio in {back.poses} poses: within {max(back.position_um, 0.001):.3g} um and "
        f"{max(back.rotation_urad, 0.001):.3g} urad of the model",
        f"it moves the tool by {moved:.3f} mm RMS, {moved_most:.3f} mm at most, from the drawing",
        f"not in it, but in {beside_of(out)}: compliances, errors and laws of the joints, weights; at the "
        "tool, RMS and at most:",
        *_left(done.left),
    ]
    if off is None:
        found = f"no file {out}: written from scratch"
        if replaced:
            found = f"{out} of an earlier export: replaced, from scratch as that was"
        lines.insert(0, f"{found}, with links, joints and masses, without shapes")
    else:
        lines.append(
            f"its own drawing was that of {arm} to {1e6 * off:.3g} um and urad; {tip!r} stands "
            f"{round(1e3 * draft.aside, 6):.4g} mm from the model's tool, and so it does still"
        )
    if draft.loose_meshes:
        lines.append("it names meshes by their place beside the robot's URDF: keep it in that folder")
    return lines


def _left(left: Sizes) -> list[str]:
    """A line for every kind of error."""
    return [f"  {rms:.3f} and {most:.3f} mm: {what}" for what, (rms, most) in left.items()]


def _offset_words(arm: Arm, out: Path, best: BestOffsets, off: float) -> list[str]:
    offsets = np.degrees(arm.change_to_file(best.offsets))
    shown = (f"{joint.name} {x:.4f}" for joint, x in zip(arm.file_joints, offsets, strict=True))
    (drawn, drawn_most), (left, left_most) = best.drawn_mm, best.corrected_mm
    return [
        f"{arm.name}: offsets of the joints are in {out} [deg]: {', '.join(shown)}",
        f"read back in {POSES} poses: within {max(1e6 * off, 0.001):.3g} um of these offsets",
        f"with base and tool measured anew they leave {left:.3f} mm RMS, {left_most:.3f} mm at most, to the "
        f"identified arm without payload; the drawing {drawn:.3f} and {drawn_most:.3f} mm",
        "what offsets cannot hold, RMS and at most, in comments there too:",
        *_left(best.left),
    ]
