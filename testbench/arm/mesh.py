"""The door for mesh files: what is no plain file, too large, or lies about its size is not read.

An arm's own are for MuJoCo: binary STL, OBJ and its own MSH, whose coordinates are checked too. A stranger's
are for a parser that takes memory by what a file says of itself, so that is counted first.
"""

import re
import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from testbench.errors import InputError, read_bytes

MAX_BYTES = 64_000_000  #: Of one mesh file.
MAX_TOTAL = 256_000_000  #: Of all mesh files of an arm.
MAX_FACES, MAX_ALL_FACES = 200_000, 500_000
"""Triangles of a mesh, and of all meshes of an arm, polygons of OBJ once they are cut."""
MAX_VERTICES = 3 * MAX_FACES
MAX_CORNERS = 256  #: Of a polygon: the time to cut it into triangles grows with their square.
MOST_FACES, MOST_CORNERS = 500_000, 1000  #: The same of a stranger's mesh and polygon.
MOST_GROUPS = 2000  #: Solids, groups, changes of material, instances.
MOST_ELEMENTS, MOST_DEPTH = 100_000, 100  #: Of COLLADA, and nested ones.
MOST_NUMBERS = 30 * MOST_FACES  #: Of COLLADA: places, normals, their indices.
LARGEST = 1e6  #: Of the coordinates of a vertex in the file's own unit: a kilometre in millimetres.

LINE_OF_CORNER = 40  #: Bytes in a line of OBJ for every corner.
STL_HEAD, STL_FACE = 84, 50
STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
MSH = struct.Struct("<4i")
VERTEX = re.compile(rb"^[ \t]*v[ \t]+([^\r\n]*)", re.MULTILINE)
FACE = re.compile(rb"^[ \t]*f[ \t]+([^\r\n]*)", re.MULTILINE)
MORE = re.compile(rb"^[ \t]*(?:v[nt]|[lp])[ \t]", re.MULTILINE)
GROUP = re.compile(rb"^[ \t]*(?:o|g|s|usemtl|mtllib)[ \t]", re.MULTILINE)
ELEMENT = re.compile(rb"^element\s+\S+\s+([0-9]{1,12})\s*$", re.MULTILINE)
PLY_HEAD = 10_000  #: Bytes in which the head of a PLY file ends.


class MeshError(Exception):
    """A mesh that cannot be read; the reader of a stranger's robot goes on without it and says so."""


def read_meshes(files: Mapping[str, Path]) -> dict[str, bytes]:
    """The content of the mesh files of an arm, by the names that its MJCF has for them.

    Raises:
        InputError: When one of them is no plain file, of no kind that is read, too large or not whole; or all
            of them together are too large.
    """
    found: dict[str, bytes] = {}
    size = faces = 0
    for name, file in files.items():
        try:
            found[name], own = _through(file, OWN)
        except MeshError as err:
            raise InputError(file, "", str(err)) from err
        size, faces = size + len(found[name]), faces + own
        if size > MAX_TOTAL or faces > MAX_ALL_FACES:
            limits = f"{MAX_TOTAL} bytes and {MAX_ALL_FACES} triangles"
            raise InputError(file, "", f"expected at most {limits} in all meshes of an arm together")
    return found


def mesh_bytes(file: Path) -> bytes:
    """The content of a stranger's mesh file that a parser may have.

    Raises:
        MeshError: When it is no plain file, too large, of another kind, or lies about what is in it.
    """
    return _through(file, STRANGERS)[0]


def _through(file: Path, doors: Mapping[str, Callable[[bytes], int]]) -> tuple[bytes, int]:
    """The content of a file, and how many triangles it has at most."""
    kind = file.suffix[1:].lower()
    if kind not in doors:
        raise MeshError(f"expected a mesh: {', '.join(doors)}")
    try:
        data = read_bytes(file, MAX_BYTES)
    except InputError as err:
        raise MeshError(str(err).removeprefix(f"{file}: ")) from err
    return data, doors[kind](data)


def check_count(what: str, count: int, most: int) -> None:
    """Refuse a mesh with too many of something with a MeshError."""
    if count > most:
        raise MeshError(f"expected at most {most} {what}, got {count}; simplify the mesh")


def _binary_stl(data: bytes) -> int | None:
    """How many triangles a binary STL file has; None where it is none."""
    count = int.from_bytes(data[STL_HEAD - 4 : STL_HEAD], "little")
    return count if len(data) >= STL_HEAD and len(data) == STL_HEAD + STL_FACE * count else None


def _own_stl(data: bytes) -> int:
    count = _binary_stl(data)
    if count is None:
        raise MeshError(f"expected binary STL of 84 + 50 bytes a triangle, got {len(data)} bytes")
    _check_own(3 * count, count)
    _check_sizes(np.frombuffer(data, STL, offset=STL_HEAD)["corners"].reshape(-1, 3))
    return count


def _stl(data: bytes) -> int:
    count = _binary_stl(data)
    if count is None:
        if not data.lstrip()[:5].lower() == b"solid" or b"\0" in data:
            raise MeshError("expected STL, binary of 84 + 50 bytes a triangle or text that begins with solid")
        words = data.lower()
        check_count("solids", words.count(b"solid"), MOST_GROUPS)
        count = -(-words.count(b"vertex") // 3)
    check_count("triangles", count, MOST_FACES)
    return count


def _msh(data: bytes) -> int:
    """MuJoCo's own format."""
    if len(data) < MSH.size:
        raise MeshError("expected a MuJoCo MSH file, got less than its head")
    vertices, normals, places, faces = counts = MSH.unpack_from(data)
    size = MSH.size + 12 * vertices + 12 * normals + 8 * places + 12 * faces
    if min(counts) < 0 or size != len(data):
        raise MeshError(f"expected a MuJoCo MSH file of {size} bytes by its head, got {len(data)}")
    _check_own(max(vertices, normals, places), faces)
    _check_sizes(np.frombuffer(data, "<f4", 3 * vertices, MSH.size).reshape(-1, 3))
    return int(faces)


def _own_obj(data: bytes) -> int:
    text = data.replace(b"\r", b"\n")
    if b"\\\n" in text:
        raise MeshError("expected an OBJ file without lines that go on in the next one")
    corners, vertices = _corners(text, MAX_FACES, MAX_CORNERS), VERTEX.findall(text)
    faces = sum(max(count - 2, 0) for count in corners)
    _check_own(max(len(vertices), len(MORE.findall(text))), faces)
    try:
        places = np.array([line.split()[:3] for line in vertices], dtype=float).reshape(-1, 3)
    except ValueError as err:
        raise MeshError("expected three numbers behind every v of an OBJ file") from err
    _check_sizes(places)
    return faces


def _obj(data: bytes) -> int:
    text = data.replace(b"\r", b"\n").replace(b"\\\n", b"  ")
    check_count("lines", text.count(b"\n"), 4 * MOST_FACES)
    check_count("groups", sum(1 for _ in GROUP.finditer(text)), MOST_GROUPS)
    count = sum(_corners(text, MOST_FACES, MOST_CORNERS))
    check_count("corners", count, 6 * MOST_FACES)
    return count


def _corners(text: bytes, faces: int, corners: int) -> list[int]:
    """How many corners every polygon of an OBJ file has, so many polygons and corners at most."""
    ends = np.flatnonzero(np.frombuffer(text, "u1") == ord("\n"))
    longest = int(np.diff(ends, prepend=-1, append=len(text)).max()) - 1
    check_count("bytes in a line", longest, LINE_OF_CORNER * corners)
    polygons = FACE.findall(text)
    check_count("triangles", len(polygons), faces)
    found = [len(line.split()) for line in polygons]
    check_count("corners of a face", max(found, default=0), corners)
    return found


def _check_own(vertices: int, faces: int) -> None:
    check_count("triangles", faces, MAX_FACES)
    check_count("vertices", vertices, MAX_VERTICES)
    if not faces:
        raise MeshError("expected triangles, got none")


def _check_sizes(vertices: npt.NDArray[np.floating]) -> None:
    """Refuse vertices, (v, 3), that no mesh of an arm has."""
    with np.errstate(invalid="ignore"):
        bad = np.flatnonzero(~(np.abs(vertices) <= LARGEST).all(axis=1))
    if len(bad):
        problem = f"expected finite coordinates up to {LARGEST:g}, got {vertices[bad[0]]}"
        raise MeshError(f"vertex {bad[0] + 1}: {problem}")


def _ply(data: bytes) -> int:
    head, end, _ = data[:PLY_HEAD].partition(b"end_header")
    if not end:
        raise MeshError(f"expected the head of a PLY file to end within {PLY_HEAD} bytes")
    counts = [int(count) for count in ELEMENT.findall(head)]
    if len(counts) != head.count(b"element "):
        raise MeshError("expected a number behind every element of a PLY file")
    check_count("elements", sum(counts), 3 * MOST_FACES)
    check_count("elements in so many bytes", sum(counts), len(data) - len(head))
    return sum(counts)


def _dae(data: bytes) -> int:
    if any(word in data for word in (b"<!DOCTYPE", b"<!ENTITY", b"\0")):  # UTF-16 hides them
        raise MeshError("expected UTF-8 without document types and entities")
    check_count("elements", data.count(b"</") + data.count(b"/>"), MOST_ELEMENTS)
    check_count("elements", data.count(b"<"), 3 * MOST_ELEMENTS)
    numbers = data.count(b" ") + data.count(b"\n") + data.count(b"\t")
    check_count("numbers", numbers, MOST_NUMBERS)
    try:
        root = ET.fromstring(data.decode())
    except (ET.ParseError, ValueError) as err:  # also what is no UTF-8
        raise MeshError(f"expected COLLADA in UTF-8: {err}") from err
    level = [root]
    for _ in range(MOST_DEPTH):
        level = [child for e in level for child in e]
    if level:
        raise MeshError(f"expected at most {MOST_DEPTH} nested elements")
    _check_instances(root)
    return numbers


def _check_instances(root: ET.Element) -> None:
    """A node may show another one again and again: the scene is counted as it unfolds."""
    every = [(_tag(e), f"#{e.get('id')}", e) for e in root.iter()]
    indices = ("p", "ph", "vcount")
    sizes = {
        url: sum(len(part.text or "") for part in e.iter() if _tag(part) in indices)
        for tag, url, e in every
        if tag == "geometry"
    }
    shown = {url: _shows(e) for tag, url, e in every if tag == "node"}
    todo = [url for tag, _, e in every if tag == "visual_scene" for url in _shows(e)]
    instances = size = 0
    while todo:
        url = todo.pop()
        instances, size = instances + 1, size + sizes.get(url, 0)
        check_count("instances", instances, MOST_GROUPS)
        check_count("bytes of triangles", size, MAX_BYTES)
        more = shown.get(url, [])
        check_count("instances", len(more), MOST_GROUPS)
        todo += more


def _shows(e: ET.Element) -> list[str]:
    """What an element shows more of: geometries and nodes."""
    return [i.get("url", "") for i in e.iter() if _tag(i).startswith("instance_")]


def _tag(e: ET.Element) -> str:
    return e.tag.rpartition("}")[2]


OWN = {"stl": _own_stl, "obj": _own_obj, "msh": _msh}
STRANGERS = {"stl": _stl, "obj": _obj, "ply": _ply, "dae": _dae}
