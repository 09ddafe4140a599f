"""testbench export MODEL --urdf robot.urdf: the identified geometry in the robot's own file."""

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.arm.urdf_text import BEGINS as STAMPED
from testbench.arm.urdf_text import BEGINS_NEW
from testbench.campaign.arm_models import load_model
from testbench.campaign.export import BEGINS, Exported, beside_of, draft_new, draft_own, export
from testbench.errors import BenchError, InputError
from testbench.output.manifest import read_plain
from testbench.output.place import HEAD, INSTEAD, Kind, claim_file, look
from testbench.output.whole import writing
from testbench.shell.options import Force, takes
from testbench.views.terminal import plain_console

URDF = Kind("a URDF that testbench export wrote", STAMPED)
BESIDE = Kind("the JSON beside such a URDF", BEGINS)


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    model: Annotated[Path, typer.Argument(help="Folder of a model, of calibrate or identify.")]
    urdf: Annotated[
        Path, typer.Option(help="The robot's own URDF; where there is none, one is written from scratch.")
    ]
    out: Annotated[
        Path | None, typer.Option(help="URDF to write; else NAME_calibrated.urdf in this folder.")
    ] = None
    tip: Annotated[
        str | None, typer.Option(help="Link of the robot's own URDF that carries the tool; else its end.")
    ] = None
    force: Force = False


@takes(Options)
def command(asked: Options) -> None:
    """Write the identified geometry as URDF, what it cannot hold as JSON beside it; read both back."""
    scratch = _new(asked.urdf)  # with --out it is read as any other
    own = look(asked.urdf) is not None and not (scratch and asked.out is None)
    out = _place(asked, own=own)
    inputs = [asked.model, *([asked.urdf] if own else [])]
    with (
        claim_file(out, URDF, inputs=inputs, force=asked.force),
        claim_file(beside_of(out), BESIDE, inputs=inputs, force=asked.force),
    ):
        model = load_model(asked.model)
        state, arm, stood = model.state, model.arm.name, look(out) is not None
        _refuse_another(out, arm, force=asked.force)
        done = export(state, draft_own(state, asked.urdf, asked.tip) if own else draft_new(state), out)
        lines = _words(arm, done, replaced=stood)
        if not model.absolute:
            lines.append("the model is of compliances alone: its geometry is the drawing's")
        plain_console().print("\n".join(lines), soft_wrap=True)


def _new(urdf: Path) -> bool:
    """Whether an earlier call wrote it from scratch: then it is no input."""
    if not urdf.is_file():
        return False
    with writing(urdf), urdf.open("rb") as file:
        return re.match(BEGINS_NEW, file.read(HEAD)) is not None


def _place(asked: Options, *, own: bool) -> Path:
    """Where to write."""
    if own:
        out = asked.out or Path(f"{asked.urdf.stem}_calibrated.urdf")
    elif asked.out is not None:
        problem = "expected the robot's own URDF; to write one from scratch leave --out away"
        raise InputError(asked.urdf, "", problem)
    elif asked.tip is not None:
        raise BenchError(f"--tip: is for a robot's own URDF; {asked.urdf} is written from scratch")
    else:
        out = asked.urdf
    if out.suffix.lower() != ".urdf":
        raise InputError(out, "", "expected the name of a URDF, ending with .urdf")
    return out


def _refuse_another(out: Path, arm: str, *, force: bool) -> None:
    """Refuse to replace what an earlier call wrote of another arm."""
    named = {_arm_of(out), _arm_beside(beside_of(out))} - {None, arm}
    if named and not force:
        other = " and ".join(sorted(filter(None, named)))
        raise InputError(out, "", f"testbench export wrote it of another arm, {other}; {INSTEAD}")


def _arm_of(urdf: Path) -> str | None:
    """The arm of a URDF from scratch; None of any other file."""
    if not _new(urdf):
        return None
    try:
        return ET.parse(urdf).getroot().get("name")
    except ET.ParseError as err:
        raise InputError(urdf, "", f"not XML: {err}") from err


def _arm_beside(document: Path) -> str | None:
    """The arm of the JSON beside a URDF; None where there is none that can be read."""
    try:
        found = read_plain(document)
    except InputError:
        return None
    name = found.get("arm") if isinstance(found, dict) else None
    return name if isinstance(name, str) else None


def _words(arm: str, done: Exported, *, replaced: bool) -> list[str]:
    draft, off = done.draft, done.draft.drawing_off
    tip, at = draft.frames.names[-1], f"{done.urdf}, replaced" if replaced and off is not None else done.urdf
    (moved, moved_most), (rest, rest_most) = done.geometry_mm, done.rest_mm
    lines = [
        f"{arm}: the identified geometry is in {at}, its tool is {tip!r}",
        f"read back by Pinocchio in {done.poses} poses: within {max(done.position_um, 0.001):.3g} um and "
        f"{max(done.rotation_urad, 0.001):.3g} urad of the model",
        f"it moves the tool by {moved:.3f} mm RMS, {moved_most:.3f} mm at most, from the drawing",
        f"not in it, but in {done.beside}: compliances, errors and laws of the joints, weights; own weight "
        f"and errors of the joints move the tool by {rest:.3f} mm RMS, {rest_most:.3f} mm at most",
    ]
    if off is None:
        found = f"no file {done.urdf}: written from scratch"
        if replaced:
            found = f"{done.urdf} of an earlier export: replaced, from scratch as that was"
        lines.insert(0, f"{found}, with links, joints and masses, without shapes")
    else:
        lines.append(
            f"its own drawing was that of {arm} to {1e6 * off:.3g} um and urad; {tip!r} stands "
            f"{1e3 * draft.aside:.4g} mm from the model's tool, and so it does still"
        )
    if draft.loose_meshes:
        lines.append("it names meshes by their place beside the robot's URDF: keep it in that folder")
    return lines
