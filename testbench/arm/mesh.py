"""Mesh files of an arm: checked for kind and size, and read, before MuJoCo sees them."""

from collections.abc import Mapping
from pathlib import Path

from testbench.errors import InputError, read_bytes

MESH_SUFFIXES = ("stl", "obj", "msh")  #: Suffixes of mesh files that MuJoCo reads.
MAX_MESH_BYTES = 64_000_000  #: Largest mesh file [byte].
MAX_TOTAL = 256_000_000  #: Largest size of all mesh files of an arm together [byte].


def read_meshes(files: Mapping[str, Path]) -> dict[str, bytes]:
    """Read the mesh files of an arm.

    Args:
        files: Paths by the names that the MJCF has for them.

    Returns:
        Contents by the same names.

    Raises:
        InputError: When a file is no plain file, of a kind that MuJoCo does not read, or too large; or when
            all files together are too large.
    """
    found: dict[str, bytes] = {}
    for name, file in files.items():
        if file.suffix[1:].lower() not in MESH_SUFFIXES:
            raise InputError(file, "", f"expected a mesh: {', '.join(MESH_SUFFIXES)}")
        found[name] = read_bytes(file, MAX_MESH_BYTES)
        if sum(map(len, found.values())) > MAX_TOTAL:
            raise InputError(file, "", f"expected at most {MAX_TOTAL} bytes in all meshes of an arm together")
    return found
