"""The door for mesh files of an arm: what is no plain file, too large, or lies about its size is not read.

MuJoCo reads what passes: binary STL, OBJ and its own MSH.
"""

import re
import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from testbench.errors import InputError, read_bytes

MAX_BYTES = 64_000_000  #: Of one mesh file.
MAX_TOTAL = 256_000_000  #: Of all mesh files of an arm.
MAX_FACES = 200_000  #: Triangles of a mesh, and of the polygons of an OBJ file once they are cut.
MAX_ALL_FACES = 500_000  #: Of all meshes of an arm.
MAX_VERTICES = 3 * MAX_FACES
MAX_CORNERS = 256  #: Of a polygon: the time to cut it into triangles grows with their square.
LARGEST = 1e6  #: Of the coordinates of a vertex in the file's own unit: a kilometre in millimetres.
READ = ("stl", "obj", "msh")

MAX_LINE = 40 * MAX_CORNERS  #: Bytes of a line of OBJ.
STL_HEAD, STL_FACE = 84, 50
STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
MSH = struct.Struct("<4i")
VERTEX = re.compile(rb"^[ \t]*v[ \t]+([^\r\n]*)", re.MULTILINE)
FACE = re.compile(rb"^[ \t]*f[ \t]+([^\r\n]*)", re.MULTILINE)
MORE = re.compile(rb"^[ \t]*(?:v[nt]|[lp])[ \t]", re.MULTILINE)


def read_meshes(files: Mapping[str, Path]) -> dict[str, bytes]:
    """The content of the mesh files of an arm, by the names that its MJCF has for them.

    Raises:
        InputError: When one of them is no plain file, of no kind that is read, too large or not whole; or all
            of them together are too large.
    """
    found: dict[str, bytes] = {}
    size = faces = 0
    for name, file in files.items():
        found[name], own = read_mesh(file)
        size, faces = size + len(found[name]), faces + own
        if size > MAX_TOTAL or faces > MAX_ALL_FACES:
            limits = f"{MAX_TOTAL} bytes and {MAX_ALL_FACES} triangles"
            raise InputError(file, "", f"expected at most {limits} in all meshes of an arm together")
    return found


def read_mesh(file: Path) -> tuple[bytes, int]:
    """The content of a mesh file, and how many triangles it has.

    Raises:
        InputError: When it is no plain file, of no kind that is read, too large or not whole.
    """
    kind = file.suffix[1:].lower()
    if kind not in READ:
        raise InputError(file, "", f"expected a mesh: {', '.join(READ)}")
    data = read_bytes(file, MAX_BYTES)
    faces = {"stl": _stl, "obj": _obj, "msh": _msh}[kind](file, data)
    return data, faces


def _stl(file: Path, data: bytes) -> int:
    """How many triangles a binary STL file has."""
    count = int.from_bytes(data[STL_HEAD - 4 : STL_HEAD], "little")
    if len(data) < STL_HEAD or len(data) != STL_HEAD + STL_FACE * count:
        problem = (
            f"expected binary STL of 84 + 50 bytes a triangle, got {len(data)} bytes for {count} of them"
        )
        raise InputError(file, "", problem)
    _check_counts(file, 3 * count, count)
    _check_sizes(file, np.frombuffer(data, STL, offset=STL_HEAD)["corners"].reshape(-1, 3))
    return count


def _msh(file: Path, data: bytes) -> int:
    """How many triangles a file of MuJoCo's own format has."""
    if len(data) < MSH.size:
        raise InputError(file, "", "expected a MuJoCo MSH file, got less than its head")
    vertices, normals, places, faces = counts = MSH.unpack_from(data)
    size = MSH.size + 12 * vertices + 12 * normals + 8 * places + 12 * faces
    if min(counts) < 0 or size != len(data):
        raise InputError(file, "", f"expected a MuJoCo MSH file of {size} bytes by its head, got {len(data)}")
    _check_counts(file, max(vertices, normals, places), faces)
    _check_sizes(file, np.frombuffer(data, "<f4", 3 * vertices, MSH.size).reshape(-1, 3))
    return int(faces)


def _obj(file: Path, data: bytes) -> int:
    """How many triangles an OBJ file has once its polygons are cut."""
    text = data.replace(b"\r", b"\n")
    if b"\\\n" in text:
        raise InputError(file, "", "expected an OBJ file without lines that go on in the next one")
    if longest_line(text) > MAX_LINE:
        raise InputError(file, "", f"expected lines of up to {MAX_LINE} bytes")
    vertices, polygons, more = VERTEX.findall(text), FACE.findall(text), len(MORE.findall(text))
    _check_counts(file, max(len(vertices), more), len(polygons))
    corners = [len(line.split()) for line in polygons]
    if max(corners) > MAX_CORNERS:
        raise InputError(file, "", f"expected faces of up to {MAX_CORNERS} corners, got {max(corners)}")
    faces = sum(max(count - 2, 0) for count in corners)
    _check_counts(file, len(vertices), faces)
    try:
        places = np.array([line.split()[:3] for line in vertices], dtype=float).reshape(-1, 3)
    except ValueError as err:
        raise InputError(file, "", "expected three numbers behind every v of an OBJ file") from err
    _check_sizes(file, places)
    return faces


def longest_line(text: bytes) -> int:
    """Bytes of the longest line."""
    ends = np.flatnonzero(np.frombuffer(text, "u1") == ord("\n"))
    return int(np.diff(ends, prepend=-1, append=len(text)).max()) - 1


def _check_counts(file: Path, vertices: int, faces: int) -> None:
    if not 0 < faces <= MAX_FACES:
        raise InputError(file, "", f"expected 1 to {MAX_FACES} triangles, got {faces}; simplify the mesh")
    if vertices > MAX_VERTICES:
        raise InputError(file, "", f"expected at most {MAX_VERTICES} vertices, got {vertices}")


def _check_sizes(file: Path, vertices: npt.NDArray[np.floating]) -> None:
    """Refuse vertices, (v, 3), that no mesh of an arm has."""
    with np.errstate(invalid="ignore"):
        bad = np.flatnonzero(~(np.abs(vertices) <= LARGEST).all(axis=1))
    if len(bad):
        place = f"vertex {bad[0] + 1}"
        raise InputError(
            file, place, f"expected finite coordinates up to {LARGEST:g}, got {vertices[bad[0]]}"
        )
