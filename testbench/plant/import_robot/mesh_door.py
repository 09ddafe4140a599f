"""The door for a stranger's mesh files: what is in them is counted before a parser takes memory for it."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

from testbench.arm.mesh import MAX_BYTES, longest_line
from testbench.errors import InputError, read_bytes

MAX_FACES = 500_000  #: Triangles of a mesh.
MAX_GROUPS = 2000  #: Solids, groups, changes of material, instances.
MAX_CORNERS = 1000  #: Of a polygon.
MAX_LINE = 40 * MAX_CORNERS  #: Bytes of a line of OBJ.
MAX_ELEMENTS, MAX_DEPTH = 100_000, 100  #: Of COLLADA, and nested ones.
MAX_NUMBERS = 30 * MAX_FACES  #: Of COLLADA: places, normals, their indices.
STL_HEAD, STL_FACE = 84, 50
FACE = re.compile(rb"^[ \t]*f[ \t]+([^\r\n]*)", re.MULTILINE)
GROUP = re.compile(rb"^[ \t]*(?:o|g|s|usemtl|mtllib)[ \t]", re.MULTILINE)
ELEMENT = re.compile(rb"^element\s+\S+\s+([0-9]{1,12})\s*$", re.MULTILINE)
PLY_HEAD = 10_000  #: Bytes in which the head of a PLY file ends.


class MeshError(Exception):
    """A mesh that cannot be read; the reader goes on without it and says so."""


def mesh_bytes(file: Path) -> bytes:
    """The content of a mesh file that a parser may have.

    Raises:
        MeshError: When it is no plain file, too large, of another kind, or lies about what is in it.
    """
    kind = file.suffix[1:].lower()
    if kind not in DOORS:
        raise MeshError(f"expected {', '.join(DOORS)}")
    try:
        data = read_bytes(file, MAX_BYTES)
    except InputError as err:
        raise MeshError(str(err).removeprefix(f"{file}: ")) from err
    DOORS[kind](data)
    return data


def check_count(what: str, count: int, most: int) -> None:
    """Refuse a mesh with too many of something with a MeshError."""
    if count > most:
        raise MeshError(f"expected at most {most} {what}, got {count}; simplify the mesh")


def _stl(data: bytes) -> None:
    faces = int.from_bytes(data[STL_HEAD - 4 : STL_HEAD], "little")
    if len(data) >= STL_HEAD and len(data) == STL_HEAD + STL_FACE * faces:
        check_count("triangles", faces, MAX_FACES)
        return
    if not data.lstrip()[:5].lower() == b"solid" or b"\0" in data:
        raise MeshError("expected STL, binary of 84 + 50 bytes a triangle or text that begins with solid")
    words = data.lower()
    check_count("corners", words.count(b"vertex"), 3 * MAX_FACES)
    check_count("solids", words.count(b"solid"), MAX_GROUPS)


def _obj(data: bytes) -> None:
    text = data.replace(b"\r", b"\n").replace(b"\\\n", b"  ")
    check_count("bytes in a line", longest_line(text), MAX_LINE)
    check_count("lines", text.count(b"\n"), 4 * MAX_FACES)
    check_count("groups", sum(1 for _ in GROUP.finditer(text)), MAX_GROUPS)
    faces = FACE.findall(text)
    check_count("faces", len(faces), MAX_FACES)
    corners = [len(line.split()) for line in faces]
    check_count("corners of a face", max(corners, default=0), MAX_CORNERS)
    check_count("corners", sum(corners), 6 * MAX_FACES)


def _ply(data: bytes) -> None:
    head, end, _ = data[:PLY_HEAD].partition(b"end_header")
    if not end:
        raise MeshError(f"expected the head of a PLY file to end within {PLY_HEAD} bytes")
    counts = [int(count) for count in ELEMENT.findall(head)]
    if len(counts) != head.count(b"element "):
        raise MeshError("expected a number behind every element of a PLY file")
    check_count("elements", sum(counts), 3 * MAX_FACES)
    check_count("elements in so many bytes", sum(counts), len(data) - len(head))


def _dae(data: bytes) -> None:
    if any(word in data for word in (b"<!DOCTYPE", b"<!ENTITY", b"\0")):  # UTF-16 hides them
        raise MeshError("expected UTF-8 without document types and entities")
    check_count("elements", data.count(b"</") + data.count(b"/>"), MAX_ELEMENTS)
    check_count("elements", data.count(b"<"), 3 * MAX_ELEMENTS)
    numbers = data.count(b" ") + data.count(b"\n") + data.count(b"\t")
    check_count("numbers", numbers, MAX_NUMBERS)
    try:
        root = ET.fromstring(data.decode())
    except (ET.ParseError, ValueError) as err:  # also what is no UTF-8
        raise MeshError(f"expected COLLADA in UTF-8: {err}") from err
    level = [root]
    for _ in range(MAX_DEPTH):
        level = [child for e in level for child in e]
    if level:
        raise MeshError(f"expected at most {MAX_DEPTH} nested elements")
    _check_instances(root)


def _check_instances(root: ET.Element) -> None:
    """A node may show another one again and again: the scene is counted as it unfolds."""
    sizes = {f"#{e.get('id')}": _size(e) for e in root.iter() if _tag(e) == "geometry"}
    nodes = {f"#{e.get('id')}": e for e in root.iter() if _tag(e) == "node"}
    shown: dict[str, list[str]] = {}  # what a node shows, by its name
    todo = [url for e in root.iter() if _tag(e) == "visual_scene" for url in _shows(e)]
    instances = size = 0
    while todo:
        url = todo.pop()
        instances, size = instances + 1, size + sizes.get(url, 0)
        check_count("instances", instances, MAX_GROUPS)
        check_count("bytes of triangles", size, MAX_BYTES)
        if url in nodes:
            if url not in shown:
                shown[url] = _shows(nodes[url])
            check_count("instances", len(shown[url]), MAX_GROUPS)
            todo += shown[url]


def _shows(e: ET.Element) -> list[str]:
    """What an element shows more of: geometries and nodes."""
    return [i.get("url", "") for i in e.iter() if _tag(i).startswith("instance_")]


def _tag(e: ET.Element) -> str:
    return e.tag.rpartition("}")[2]


def _size(geometry: ET.Element) -> int:
    """Bytes of the indices of its triangles."""
    return sum(len(e.text or "") for e in geometry.iter() if _tag(e) in ("p", "ph", "vcount"))


DOORS: dict[str, Callable[[bytes], None]] = {"stl": _stl, "obj": _obj, "ply": _ply, "dae": _dae}
