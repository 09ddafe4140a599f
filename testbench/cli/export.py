"""testbench export MODEL --urdf robot.urdf: what was identified in the robot's own file or a controller's."""

import contextlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from testbench.arm.folder import Arm
from testbench.errors import BenchError, InputError
from testbench.files.export import (
    ABB,
    AXES,
    BEGINS,
    STAMP,
    BestOffsets,
    Draft,
    Sizes,
    companion_path,
    draft_new,
    draft_robot_urdf,
    export,
    export_offsets,
    read_controller,
)
from testbench.files.export_own import BEGINS as STAMPED
from testbench.files.export_own import BEGINS_NEW, RANDOM_POSES
from testbench.identify.posterior import ArmModel
from testbench.report.terminal import plain_console
from testbench.runs.manifest import read_plain
from testbench.runs.rows import Row
from testbench.runs.whole import HEAD, INSTEAD, Kind, check_file, look, writing
from testbench.workflows.arm_models import load_model
from testbench.workflows.options import Force, takes
from testbench.workflows.plan_input import parse_numbers

URDF = Kind("a URDF that testbench export wrote", STAMPED)
BESIDE = Kind("a JSON file that testbench export wrote", BEGINS)
CONTROLLER = Kind("a controller's file that testbench export wrote", rb"(?s).*?" + STAMP.encode())


@dataclass(frozen=True)
class ExportOptions:
    """Hold the flags of the command."""

    model: Annotated[Path, typer.Argument(help="Folder of an identified or calibrated arm.")]
    urdf: Annotated[Path | None, typer.Option(metavar="FILE", help="The robot's URDF, or a new file.")] = None
    into: Annotated[Path | None, typer.Option(metavar="FILE", help="KUKA $machine.dat or ABB MOC.cfg.")] = (
        None
    )
    gears: Annotated[str, typer.Option(metavar="A,B,...", help="ABB: motor turns per axis turn.")] = ""
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File to write (default: NAME_calibrated).")
    ] = None
    tip: Annotated[
        str | None, typer.Option(metavar="LINK", help="Link with the tool (default: the end).")
    ] = None
    force: Force = False


@takes(ExportOptions)
def command(asked: ExportOptions) -> None:
    """Write a model into a URDF or a controller's file, what that cannot hold as JSON beside it."""
    if asked.urdf is not None and asked.into is None:
        _write_urdf(asked, asked.urdf)
    elif asked.into is not None and asked.urdf is None and asked.tip is None:
        _write_into(asked, asked.into)
    else:
        raise BenchError("expected either --urdf or --into; --tip is only for --urdf")


def _write_urdf(asked: ExportOptions, urdf: Path) -> None:
    own = look(urdf) is not None and not (_new(urdf) and asked.out is None)  # with --out it is as any other
    if not own and (asked.out or asked.tip):
        problem = "there is no such URDF of the robot; to write a new one omit --out and --tip"
        raise InputError(urdf, "", problem)
    out = (asked.out or Path(f"{urdf.stem}_calibrated.urdf")) if own else urdf
    if out.suffix.lower() != ".urdf":
        raise InputError(out, "", "expected the name of a URDF, ending with .urdf")
    model = _read(asked, out, URDF, [urdf] if own else [])
    _export(model, draft_robot_urdf(model.state, urdf, asked.tip) if own else draft_new(model.state), out)


def _write_into(asked: ExportOptions, file: Path) -> None:
    out, (form, _) = asked.out or Path(f"{file.stem}_calibrated{file.suffix}"), read_controller(file)
    if asked.gears and form is not ABB:
        raise BenchError("--gears is only for a file of an ABB controller")
    gears = parse_numbers(asked.gears, (AXES, AXES**2), "--gears") if form is ABB else []
    model = _read(asked, out, CONTROLLER, [file])
    _say(model, _offset_words(model.arm, out, *export_offsets(model.state, file, out, gears)))


def _read(asked: ExportOptions, out: Path, kind: Kind, files: list[Path]) -> ArmModel:
    """The model, once both files may be written."""
    inputs = [asked.model, *files]
    check_file(out, kind, inputs=inputs, force=asked.force)
    check_file(companion_path(out), BESIDE, inputs=inputs, force=asked.force)
    model = load_model(asked.model)
    if not asked.force:
        _refuse_another(out, model.arm.name)
    return model


def _export(model: ArmModel, draft: Draft, out: Path) -> None:
    stood = look(out) is not None
    _say(model, _words(model.arm.name, draft, out, export(model.state, draft, out), replaced=stood))


def _say(model: ArmModel, lines: list[str]) -> None:
    if not model.is_absolute:
        lines.append(
            "warning    testbench identify does not change the geometry: the nominal geometry is written"
        )
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
        found = read_plain(companion_path(out))
        other = found.get("arm") if isinstance(found, dict) else None
        if isinstance(other, str) and other != arm:
            raise BenchError(f"{out}: testbench export wrote this file for another arm, {other}; {INSTEAD}")


def _words(arm: str, draft: Draft, out: Path, done: Row, *, replaced: bool) -> list[str]:
    """What was written, how far it was off when it was read back, and what it cannot hold."""
    back, new = done.read_back, draft.drawing_off is None
    lines = [
        f"written    {out}" + ", a new URDF without shapes" * new + ", replaced" * replaced,
        f"beside     {companion_path(out)}: compliances, joint errors, joint laws and weights",
        f"arm        {arm}, tool {draft.frames.names[-1]!r}",
        f"read back  in {back.poses} poses the file differs from the model by at most "
        f"{max(back.position_um, 0.001):.3g} um and {max(back.rotation_urad, 0.001):.3g} urad",
        *_sizes({"difference between calibrated and nominal geometry": done.geometry_mm}),
        *_sizes({f"{what} (not in the file)": own for what, own in done.left.items()}),
    ]
    if draft.drawing_off is not None:
        off, aside = 1e6 * draft.drawing_off, round(1e3 * draft.aside, 6)
        lines.append(
            f"nominal    URDF and arm differ by up to {off:.3g} um and {off:.3g} urad; "
            f"the tip is {aside:.4g} mm from the tool"
        )
    if draft.loose_meshes:
        lines.append("warning    mesh paths are relative: keep the file beside the robot's URDF")
    return lines


def _sizes(sizes: Sizes) -> list[str]:
    """A line for every kind of error at the tool."""
    return [
        f"at tool    {rms:.3f} mm RMS, {most:.3f} mm at most: {what}" for what, (rms, most) in sizes.items()
    ]


def _offset_words(arm: Arm, out: Path, best: BestOffsets, off: float) -> list[str]:
    """The offsets, how far they were off when they were read back, and what they cannot hold."""
    offsets = np.degrees(arm.to_file_joint_change(best.offsets))
    shown = (f"{joint.name} {x:.4f}" for joint, x in zip(arm.file_joints, offsets, strict=True))
    return [
        f"written    {out}",
        f"arm        {arm.name}, offsets in deg: {', '.join(shown)}",
        f"read back  in {RANDOM_POSES} poses the file differs from these offsets by at most "
        f"{max(1e6 * off, 0.001):.3g} um",
        *_sizes({"error without these offsets (base and tool are fitted again)": best.drawn_mm}),
        *_sizes({"error with these offsets (base and tool are fitted again)": best.corrected_mm}),
        *_sizes({f"{what} (not in the file)": own for what, own in best.left.items()}),
    ]
