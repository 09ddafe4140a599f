"""Mesh files of an arm: read up to a size before MuJoCo sees them."""

from collections.abc import Mapping
from pathlib import Path

from testbench.errors import InputError, read_bytes

KINDS = ("stl", "obj", "msh")  #: What MuJoCo reads.
MAX_BYTES = 64_000_000  #: Of one mesh file.
MAX_TOTAL = 256_000_000  #: Of all mesh files of an arm.


def read_meshes(files: Mapping[str, Path]) -> dict[str, bytes]:
    """Read the mesh files of an arm, by the names that its MJCF has for them.

    Raises:
        InputError: When one of them is no plain file, of no kind that MuJoCo reads, or too large; or all of
            them together are too large.
    """
    found: dict[str, bytes] = {}
    for name, file in files.items():
        if file.suffix[1:].lower() not in KINDS:
            raise InputError(file, "", f"expected a mesh: {', '.join(KINDS)}")
        found[name] = read_bytes(file, MAX_BYTES)
        if sum(map(len, found.values())) > MAX_TOTAL:
            raise InputError(file, "", f"expected at most {MAX_TOTAL} bytes in all meshes of an arm together")
    return found
