"""testbench new NAME --from FILE: a robot's URDF or MJCF as an arm's folder."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from scipy.spatial.transform import Rotation

from testbench.arm.elastic import PAYLOAD_RANGE
from testbench.errors import Array, BenchError, InputError, shell_word
from testbench.files.robot.chain import read_chain
from testbench.files.robot.robot import pose_of
from testbench.report.terminal import plain_console
from testbench.runs.whole import look, new_folder, whole_file
from testbench.workflows.cell import build_cell
from testbench.workflows.new_arm import UserInputs, write_arm
from testbench.workflows.options import NAME as PROJECT
from testbench.workflows.options import TEMPLATE
from testbench.workflows.plan_input import parse_numbers


def command(
    name: Annotated[Path, typer.Argument(help="Folder to make.")],
    source: Annotated[Path, typer.Option("--from", metavar="FILE", help="The robot as URDF or MJCF.")],
    tip: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Link, body or site of the tool (default: the end)."),
    ] = None,
    payload_kg: Annotated[
        float | None, typer.Option(metavar="KG", help="Rated payload (default: by the arm's mass).")
    ] = None,
    tool: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Tool in the tip's frame, m; also RX,RY,RZ, deg.")
    ] = None,
    marker: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=X,Y,Z", help="Marker in the tool's frame, m; repeatable."),
    ] = None,
    load: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Load point in the tool's frame, m.")
    ] = None,
    project: Annotated[bool, typer.Option("--project", help=f"Also write {PROJECT} here.")] = False,
) -> None:
    """Make an arm's folder from a robot's URDF or MJCF."""
    if not name.name:
        raise BenchError(f"NAME: expected the name of a new folder, got {str(name)!r}")
    if project and look(PROJECT) is not None:
        raise BenchError(f"{PROJECT}: exists already; edit it, or leave out --project")
    wishes = read_user_inputs(payload_kg, tool, marker or [], load)
    with new_folder(name) as folder:
        chain = read_chain(source, tip)
        try:
            notes = write_arm(chain, wishes, folder)
            arm = build_cell(folder).arm
        except BenchError as err:  # which names a part of the robot
            raise InputError(source, "", str(err)) from err
    console = plain_console()
    joints = f"{len(arm.joints)} joints"
    if arm.joint_map is not None:
        joints += f" (files have {len(arm.file_joints)}: {', '.join(arm.joint_map.file_joint_names)})"
    first = f"{name}: {joints}, tool at {chain.tip.name!r}, mass {chain.mass:.4g} kg"
    if project:
        write_project(name, source)
    last = f"next       testbench check {shell_word(name)} --out runs/{shell_word(Path(name.name))}"
    for line in (first, *(f"  {note}" for note in notes), last):
        console.print(line, soft_wrap=True)


def write_project(arm: Path, robot: Path) -> None:
    """Write the project file of a cell into the current folder: arm and URDF, other keys as comments.

    Args:
        arm: Folder of the arm.
        robot: The robot's file; only a URDF is kept, for `export`.
    """
    text = TEMPLATE.read_text(encoding="utf-8")
    found = {"arm": arm, **({"urdf": robot} if robot.suffix == ".urdf" else {})}
    for key, path in found.items():
        value = json.dumps(str(path), ensure_ascii=False)
        line = f"{key} = {value}".replace("\\", r"\\")  # re.sub reads a backslash as an escape
        text = re.sub(rf"^# {key} = \S+", line, text, flags=re.MULTILINE)
    with whole_file(PROJECT) as part:
        part.write_text(text, encoding="utf-8")


MAX_TIP_DISTANCE = 10.0  #: Farthest point from the tip that can be meant in metres [m].
ARM_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,62}")


def read_user_inputs(
    payload_kg: float | None, tool: str | None, markers: Sequence[str], load: str | None
) -> UserInputs:
    """Read the flags as numbers.

    Args:
        payload_kg: Rated payload [kg].
        tool: x,y,z of the tool from the tip in m; or with rx,ry,rz in degrees, turns about the tip's x, y, z.
        markers: NAME=x,y,z in the tool's frame in m, each.
        load: x,y,z of the load point in the tool's frame in m.

    Returns:
        The numbers.

    Raises:
        BenchError: Names the flag and what was expected.
    """
    low, high = PAYLOAD_RANGE
    if payload_kg is not None and not low <= payload_kg <= high:
        raise BenchError(f"--payload-kg: expected {low:g} to {high:g} kg, got {payload_kg}")
    named = tuple(_marker(text) for text in markers)
    names = [name for name, _ in named]
    if len(set(names)) < len(names):
        raise BenchError(f"--marker: expected different names, got {', '.join(names)}")
    if 0 < len(named) < 3:
        raise BenchError(f"--marker: expected three markers or more, got {len(named)}")
    return UserInputs(
        payload=payload_kg,
        tool=None if tool is None else _pose(tool),
        markers=named,
        load=None if load is None else _numbers("--load", load, (3,)),
    )


def _pose(text: str) -> Array:
    values = _numbers("--tool", text, (3, 6))
    turned = Rotation.from_euler(
        "xyz", [*values[3:], 0, 0, 0][:3], degrees=True
    )  # about the fixed x, then y, then z
    return pose_of(turned.as_matrix(), values[:3])


def _marker(text: str) -> tuple[str, Array]:
    name, equals, place = text.partition("=")
    if not equals or not ARM_NAME.fullmatch(name):
        raise BenchError(f"--marker: expected NAME=x,y,z with a name of letters and digits, got {text!r}")
    return name, _numbers(f"--marker {name}", place, (3,))


def _numbers(flag: str, text: str, counts: tuple[int, ...]) -> Array:
    values = np.array(parse_numbers(text, counts, flag))
    if np.abs(values[:3]).max() > MAX_TIP_DISTANCE:
        raise BenchError(f"{flag}: expected metres up to {MAX_TIP_DISTANCE:g}, got {text!r}")
    return values
