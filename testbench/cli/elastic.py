"""testbench elastic ARM FILE: the elastic arm as plain MJCF, with its meshes beside it."""

import os
from pathlib import Path
from typing import Annotated

import typer

from testbench.arm.folder import Arm, find_arm
from testbench.arm.mesh import MAX_BYTES, read_meshes
from testbench.arm.mjcf import assets, read_mjcf
from testbench.campaign.campaign import build_cell
from testbench.campaign.campaign_flags import ArmName
from testbench.errors import InputError, read_bytes, word
from testbench.output.place import Kind, check_file
from testbench.output.whole import whole_files
from testbench.plant.elastic import elastic_mjcf
from testbench.shell.options import Force
from testbench.views.terminal import plain_console

ELASTIC = Kind("an elastic arm", rb"<mujoco [^>]*model=\"[^\"]*_elastic\"")


def command(
    arm: ArmName, file: Annotated[Path, typer.Argument(help="MJCF to write.")], force: Force = False
) -> None:
    """Write the arm with its springs."""
    check_file(file, ELASTIC, inputs=[find_arm(arm)], force=force)
    write_elastic(build_cell(arm).arm, file)
    console = plain_console()
    console.print(f"{file}; open it with: python -m mujoco.viewer --mjcf={word(file)}", soft_wrap=True)


def write_elastic(arm: Arm, file: Path) -> None:
    """Write the elastic arm as plain MJCF that MuJoCo's own viewer opens.

    Mesh files are copied beside it.

    Args:
        arm: The arm.
        file: The MJCF to write; its folder is made where it does not exist.

    Raises:
        InputError: When a file cannot be read or written, or would replace another one.
    """
    source = arm.rigid.parent
    if file.resolve().is_relative_to(source.resolve()):
        raise InputError(file, "", "expected a place outside the arm's own folder")
    text = elastic_mjcf(arm)
    meshes = read_meshes({name: source / name for name in assets(arm.rigid, read_mjcf(arm.rigid))})
    for name, content in meshes.items():
        _check_mesh(content, file.parent / name, file.parent)
    with whole_files([*(file.parent / name for name in meshes), file]) as parts:
        for content, part in zip((*meshes.values(), text.encode()), parts, strict=True):
            part.write_bytes(content)


def _check_mesh(content: bytes, copy: Path, folder: Path) -> None:
    """Refuse a copy of a mesh outside of the folder, or in place of another file."""
    if not Path(os.path.realpath(copy)).is_relative_to(os.path.realpath(folder)):
        raise InputError(copy, "", f"expected a mesh inside of {folder}")
    if os.path.lexists(copy) and not (copy.is_file() and read_bytes(copy, MAX_BYTES) == content):
        raise InputError(copy, "", "is not the arm's mesh; choose another folder, or move it away")
