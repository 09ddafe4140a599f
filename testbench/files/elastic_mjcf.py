"""The elastic arm as MJCF: a file with its virtual joints, and copies of its meshes."""

import os
from pathlib import Path

from testbench.arm.folder import Arm
from testbench.arm.mesh import MAX_BYTES, read_meshes
from testbench.arm.mjcf import assets, read_mjcf
from testbench.errors import InputError, read_bytes
from testbench.plant.elastic import elastic_mjcf
from testbench.runs.whole import whole_files


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
