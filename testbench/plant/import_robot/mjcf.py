"""A stranger's MJCF before MuJoCo sees it: includes resolved, and only what an arm's statics needs.

MJCF can read any file, replicate without end and load plugins; so elements pass an allow-list, and files are
read by us.
"""

import os
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from testbench.arm.document import inside
from testbench.arm.lines import xml_place
from testbench.arm.mesh import MeshError
from testbench.errors import InputError
from testbench.plant.build import HULL_CORNERS
from testbench.plant.import_robot.compiled import Cleaned
from testbench.plant.import_robot.meshes import Meshes, check_size, decimated, stl_bytes
from testbench.plant.import_robot.robot import Note
from testbench.plant.import_robot.solids import hull_of
from testbench.plant.import_robot.source import (
    MAX_BODIES,
    MAX_ELEMENTS,
    MAX_SHAPES,
    check_count,
    check_numbers,
    need,
    read_numbers,
    read_xml,
)

KEPT = frozenset(
    "mujoco compiler default worldbody body frame inertial joint freejoint geom site".split()
    + "asset mesh material equality connect weld tendon fixed spatial pulley".split()
)
COUPLED = "equality", "tendon"
"""Elements that are read for what they say of the arm's joints, and left out else."""
SILENT = frozenset("option visual statistic size light camera texture layer custom extension".split())
"""Elements that go without a word: nobody expects them in an arm."""
REFUSED = frozenset("replicate attach model".split())
COMPILER = frozenset(
    "angle eulerseq autolimits inertiafromgeom inertiagrouprange boundmass boundinertia".split()
    + "settotalmass alignfree".split()
)
GONE = {
    "geom": frozenset({"hfield", "user"}),
    "material": frozenset({"texture", "texrepeat", "texuniform"}),
    "mesh": frozenset({"content_type", "builtin", "params", "material"}),
    "body": frozenset({"gravcomp", "sleep", "user"}),
    "joint": frozenset({"user"}),
    "site": frozenset({"user"}),
}
"""Attributes that go."""
MAX_FILES = 50  #: Included, each once.
MOST_FACES = 200_000  #: Of a mesh; MuJoCo reads no more.


def clean_mjcf(file: Path, root: ET.Element) -> Cleaned:
    """What MuJoCo is to compile.

    Args:
        file: The MJCF, for messages and for the files beside it.
        root: Its root element; it is changed.

    Raises:
        InputError: When it includes what lies elsewhere, or holds what cannot be an arm.
    """
    _include(file, root)
    if refused := [e for e in root.iter() if e.tag in REFUSED]:
        raise InputError(
            file, xml_place(file, refused[0]), "not read; save the compiled model as one MJCF file first"
        )
    check_count(file, root, "geom", MAX_SHAPES)
    check_count(file, root, "body", MAX_BODIES)
    if (count := sum(len(e) for e in root.findall("equality"))) > MAX_BODIES:
        raise InputError(file, "<equality>", f"expected at most {MAX_BODIES} in a robot, got {count}")
    folder = _mesh_folder(file, root)
    driven = {e.get("joint", "") for actuators in root.findall("actuator") for e in actuators}
    left_out = _keep(root) | {tag for tag in COUPLED if root.find(tag) is not None}
    check_numbers(file, root)
    _simplify(root)
    meshes = Meshes()
    assets = _assets(file, root, folder, meshes)
    notes = [Note("left out", tuple(sorted(left_out)))] if left_out else []
    text = ET.tostring(root, encoding="unicode")
    return Cleaned(text, assets, (*notes, *meshes.notes()), driven=frozenset(driven - {""}))


def _include(file: Path, root: ET.Element) -> None:
    """Every <include> becomes the children of the file that it names; each file once, as in MuJoCo."""
    seen = {os.path.realpath(file)}
    while pair := next(((p, c) for p in root.iter() for c in p if c.tag == "include"), None):
        parent, e = pair
        name = need(file, e, "file")
        path = inside(file.parent, Path(name))
        if path is None:
            raise InputError(
                file, xml_place(file, e), f"expected a file inside of {file.parent}, got {name!r}"
            )
        if str(path) in seen or len(seen) > MAX_FILES:
            raise InputError(
                file, xml_place(file, e), f"{name!r} is included twice, or more than {MAX_FILES} files are"
            )
        seen.add(str(path))
        place = list(parent).index(e)
        parent.remove(e)
        for k, child in enumerate(read_xml(path)):
            parent.insert(place + k, child)
        if sum(1 for _ in root.iter()) > MAX_ELEMENTS:
            raise InputError(file, xml_place(file, e), f"expected at most {MAX_ELEMENTS} elements in all")


def _mesh_folder(file: Path, root: ET.Element) -> Path:
    """Where meshes are, as the compiler elements say; the last one counts."""
    folder = ""
    for compiler in root.iter("compiler"):
        if compiler.get("coordinate", "local") != "local":
            raise InputError(file, xml_place(file, compiler), "coordinate: expected 'local'")
        folder = compiler.get("meshdir", compiler.get("assetdir", folder))
    return file.parent / folder


def _keep(root: ET.Element) -> set[str]:
    """Take out what is not on the list; tells what of it somebody might miss."""
    left_out, inside = set(), [root]
    while inside:
        parent = inside.pop()
        for child in list(parent):
            if child.tag not in KEPT:
                parent.remove(child)
                if child.tag not in SILENT and parent.tag != "default":
                    left_out.add(str(child.tag))
            elif child.tag == "geom" and (child.get("type") in ("hfield", "sdf") or "hfield" in child.attrib):
                parent.remove(child)
            else:
                inside.append(child)
    return left_out


def _simplify(root: ET.Element) -> None:
    """Attributes that go, and compiler options that keep every body as the file names it."""
    for e in root.iter():
        for key in GONE.get(e.tag, frozenset()) & set(e.attrib):
            del e.attrib[key]
        if e.tag == "compiler":
            for key in set(e.attrib) - COMPILER:
                del e.attrib[key]
        if e.tag == "mesh":
            e.set("maxhullvert", str(HULL_CORNERS))
    ET.SubElement(root, "compiler", balanceinertia="true", fusestatic="false", discardvisual="false")


def _assets(file: Path, root: ET.Element, folder: Path, meshes: Meshes) -> dict[str, bytes]:
    """The meshes read by us; a mesh that cannot be read goes, with the geoms that show it."""
    assets: dict[str, bytes] = {}
    gone: set[str] = set()
    for asset in root.findall("asset"):
        for e in [e for e in asset.findall("mesh") if "file" in e.attrib]:
            name = e.get("file", "")
            e.set("name", e.get("name") or Path(name).stem)
            try:
                assets[f"{len(assets)}.stl"] = _stl(file, e, folder / name, meshes)
                e.set("file", f"{len(assets) - 1}.stl")
            except MeshError as err:
                meshes.failed[name] = str(err)
                gone.add(e.get("name", ""))
                asset.remove(e)
    for parent in root.iter():
        for geom in [g for g in parent.findall("geom") if g.get("mesh") in gone]:
            parent.remove(geom)
    return assets


def _stl(file: Path, e: ET.Element, path: Path, meshes: Meshes) -> bytes:
    """A mesh file as STL; MuJoCo is told where it is flat."""
    found = inside(file.parent, path.absolute())
    if found is None:
        raise MeshError(f"lies outside of {file.parent}")
    mesh = meshes.load(found)
    scale = read_numbers(file, e, "scale", 3) if "scale" in e.attrib else np.ones(3)
    check_size(mesh.vertices * scale)
    if hull_of(mesh.outer) is None:
        e.set("inertia", "shell")
    return stl_bytes(*decimated(mesh.vertices, mesh.faces, MOST_FACES))
