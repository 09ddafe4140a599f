"""URDF before MuJoCo compiles it: only what an arm's statics needs, joints checked, meshes read by us.

MuJoCo would take two trees for one, mimic joints for free ones, limits of 0 to 0 for none, a torus for
nothing; refuse joints that float; and name no joint whose link is missing. It reads neither COLLADA nor PLY,
nor large meshes: it gets boxes for all.
"""

import copy
import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import unquote, urlparse

import mujoco
import numpy as np

from testbench.arm.document import inside
from testbench.arm.lines import xml_place
from testbench.arm.mesh import MeshError
from testbench.errors import Array, InputError
from testbench.plant.collide import VISUAL_GROUPS
from testbench.plant.import_robot.compiled import ROOT, Cleaned
from testbench.plant.import_robot.equalities import Coupling
from testbench.plant.import_robot.meshes import LARGEST, Meshes, check_size, stl_bytes
from testbench.plant.import_robot.robot import Mesh, Note
from testbench.plant.import_robot.solids import VISIBLE, plausible, primitive
from testbench.plant.import_robot.source import (
    MAX_BODIES,
    MAX_DEPTH,
    MAX_SHAPES,
    UP,
    check_count,
    check_numbers,
    need,
    packages,
    read_numbers,
)
from testbench.plant.import_robot.tip import ARM_JOINTS

MOVING = ("revolute", "continuous", "prismatic")
ODD = {"floating": "floats free", "planar": "is planar", "spherical": "is a ball joint"}
KEPT = frozenset(
    "robot link inertial mass inertia origin visual collision geometry mesh box sphere".split()
    + "cylinder capsule material color joint parent child axis limit".split()
)
FORMS = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
}
"""Primitives, and how many numbers their attributes have."""
THINNEST = 1e-6  #: What is thinner has no extent [m].
ENDLESS = 1000.0  #: Limits beyond it mean none [rad, m].


def clean_urdf(file: Path, root: ET.Element) -> Cleaned:
    """What MuJoCo is to compile.

    Args:
        file: The URDF, for messages and meshes.
        root: Its root element; it is changed.

    Raises:
        InputError: When links or joints are wrong.
    """
    check_count(file, root, "geometry", MAX_SHAPES)
    check_count(file, root, "joint", MAX_BODIES)
    links, joints = root.findall("link"), root.findall("joint")
    _check_tree(file, links, joints)
    mimics = {e.get("name", ""): e.find("mimic") for e in joints}
    _keep(root)
    check_numbers(file, root)
    odd = {_end(file, e, "child"): why for e in joints if (why := ODD.get(e.get("type", "")))}
    locked = _hold(file, joints)
    meshes, surfaces = Meshes(), dict[str, Mesh]()
    for link in links:
        _check_inertial(file, link)
    _shapes(file, root, meshes, surfaces)
    for e in root.iter():
        for key in [key for key, text in e.attrib.items() if key in ("name", "link") and text == "world"]:
            e.set(key, ROOT)
    options = {
        "fusestatic": "false",
        "discardvisual": "false",
        "inertiafromgeom": "false",
        "strippath": "false",
    }
    bounds = {"balanceinertia": "true", "boundmass": "1e-14", "boundinertia": "1e-14"}
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", {**options, **bounds})
    box = primitive("box", np.array([1.0, 2.0, 3.0]))
    assets = dict.fromkeys((f"{name}.stl" for name in surfaces), stl_bytes(box.vertices + 1, box.faces))
    notes = [Note("locked", tuple(locked))] if locked else []
    text = ET.tostring(root, encoding="unicode")
    couplings = _couplings(file, joints, mimics)
    return Cleaned(text, assets, (*notes, *meshes.notes()), _prepare, surfaces, odd, couplings)


def _check_tree(file: Path, links: Sequence[ET.Element], joints: Sequence[ET.Element]) -> None:
    """One tree of links with names of their own, not too deep for MuJoCo."""
    for elements in (links, joints):
        first = {need(file, e, "name"): e for e in reversed(elements)}
        if twice := [e for e in elements if first[e.get("name", "")] is not e]:
            raise InputError(file, xml_place(file, twice[0]), "the name stands twice")
    children: dict[str, list[str]] = {e.get("name", ""): [] for e in links}
    roots = dict.fromkeys(children)
    for joint in joints:
        parent, child = _end(file, joint, "parent"), _end(file, joint, "child")
        for which, end in (("parent", parent), ("child", child)):
            if end not in children:
                raise InputError(file, xml_place(file, joint), f"{which}: there is no link {end!r}")
        if child not in roots:
            problem = f"link {child!r} is another joint's child already: leave out what closes the loop"
            raise InputError(file, xml_place(file, joint), problem)
        del roots[child]
        children[parent].append(child)
    if len(roots) != 1:
        got = ", ".join(roots) or ("a circle of joints" if links else "no links")
        raise InputError(file, "<robot>", f"expected one link without a parent, got {got}")
    left, level = set(children), list(roots)
    for _ in range(MAX_DEPTH):
        left -= set(level)
        level = [child for link in level for child in children[link]]
    if left:
        problem = f"these links stand in a circle of joints: {', '.join(sorted(left))}"
        raise InputError(
            file, "<robot>", f"expected at most {MAX_DEPTH} links in a row" if level else problem
        )


def _end(file: Path, joint: ET.Element, which: str) -> str:
    end = joint.find(which)
    if end is None:
        raise InputError(file, xml_place(file, joint), f"expected a <{which}>")
    return need(file, end, "link")


def _keep(root: ET.Element) -> None:
    """Take out what is not on the list, and of limits all but the two."""
    for parent in list(root.iter()):
        for child in [e for e in parent if e.tag not in KEPT and parent.tag != "geometry"]:
            parent.remove(child)
    for limit in root.iter("limit"):
        for key in set(limit.attrib) - {"lower", "upper"}:
            del limit.attrib[key]


def _hold(file: Path, joints: Sequence[ET.Element]) -> list[str]:
    """Joints as MuJoCo has them, without limits that mean none.

    Returns:
        Those that limits of 0 to 0 lock; none where no arm would be left: their exporter knew no limits.
    """
    moving = [e for e in joints if e.get("type") in MOVING]
    zero = [e for e in moving if _limits(file, e) == (0, 0)]
    locked = zero if len(moving) - len(zero) >= ARM_JOINTS else []
    for e in joints:
        kind = e.get("type", "")
        if kind in ODD or e in locked:
            e.set("type", "fixed")
        elif kind not in (*MOVING, "fixed"):
            problem = f"type: expected {', '.join(MOVING)} or fixed, got {kind!r}"
            raise InputError(file, xml_place(file, e), problem)
    return [e.get("name", "") for e in locked]


def _couplings(
    file: Path, joints: Sequence[ET.Element], mimics: Mapping[str, ET.Element | None]
) -> list[Coupling]:
    """What joints mimic: q = multiplier q_other + offset; one that is held stands at zero."""
    kinds = {e.get("name", ""): e.get("type") for e in joints}
    found = []
    for name, mimic in mimics.items():
        if mimic is None or kinds[name] not in MOVING:
            continue
        other, numbers = need(file, mimic, "joint"), {"multiplier": 1.0, "offset": 0.0}
        numbers |= {
            key: float(read_numbers(file, mimic, key, 1)[0]) for key in numbers if key in mimic.attrib
        }
        terms, label = {name: 1.0}, f"joint {name!r} mimics {other!r}"
        if other == name:
            raise InputError(file, f"<joint name={name!r}>", "it mimics itself")
        if kinds.get(other) in (None, *MOVING):  # one that is not there is refused where an arm has it
            terms[other] = -numbers["multiplier"]
        found.append(Coupling(label, terms, numbers["offset"], name))
    return found


def _limits(file: Path, e: ET.Element) -> tuple[float, float] | None:
    """The limits that a joint states [rad, m]; None, and no <limit>, where it states none that bounds."""
    if (limit := e.find("limit")) is None:
        return None
    found = {key: float(read_numbers(file, limit, key, 1)[0]) for key in limit.attrib}
    lower, upper = found.get("lower", 0.0), found.get("upper", 0.0)
    bounds = bool(found) and e.get("type") != "continuous" and max(abs(lower), abs(upper)) <= ENDLESS
    if bounds and not lower < upper and (lower or upper):
        problem = f"limit: expected lower < upper, got {lower:g} and {upper:g}"
        raise InputError(file, xml_place(file, e), problem)
    if not bounds or lower == upper:
        e.remove(limit)
    return (lower, upper) if bounds else None


def _check_inertial(file: Path, link: ET.Element) -> None:
    """A link of a mass above zero, or of none."""
    for inertial in link.findall("inertial"):
        mass = inertial.find("mass")
        kilograms = 0.0 if mass is None else float(read_numbers(file, mass, "value", 1)[0])
        if kilograms < 0:
            raise InputError(file, xml_place(file, link), f"mass: expected more than 0 kg, got {kilograms}")
        if kilograms == 0:
            link.remove(inertial)
        elif inertial.find("inertia") is None:
            ET.SubElement(inertial, "inertia", dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), "0"))


def _shapes(file: Path, root: ET.Element, meshes: Meshes, surfaces: dict[str, Mesh]) -> None:
    """Take out shapes without extent, or that cannot be read, which is noted; each other has one colour."""
    colours = {m.get("name", ""): m.find("color") for m in root.findall("material")}
    for link in root.findall("link"):
        shown = link.findall("visual")
        for e in [*shown, *link.findall("collision")]:
            form = next(iter(e.findall("geometry/*")), None)
            if form is None or not _is_there(file, form, meshes, surfaces):
                link.remove(e)
            else:
                rgba = _colour(file, e, colours, surfaces.get(form.get("filename", "").removesuffix(".stl")))
                for material in e.findall("material"):
                    e.remove(material)
                ET.SubElement(ET.SubElement(e, "material"), "color", rgba=" ".join(map(repr, rgba.tolist())))
        if shown and link.find("visual") is None:  # none that can be read
            for e in link.findall("collision"):
                link.append(copy.deepcopy(e))
                link[-1].tag = "visual"
    for material in root.findall("material"):
        root.remove(material)
    for k, look in enumerate(root.iter("material")):  # for MuJoCo a name has the colour that it had first
        look.set("name", f"{k}")


def _colour(file: Path, e: ET.Element, colours: Mapping[str, ET.Element | None], mesh: Mesh | None) -> Array:
    """Of the element's own material, of the robot's of that name, of its mesh, or ours, (4,) [1]."""
    colour, material = e.find("material/color"), e.find("material")
    if colour is None and material is not None:
        colour = colours.get(material.get("name", ""))
    if colour is not None:
        return read_numbers(file, colour, "rgba", 4)
    return VISIBLE if mesh is None or mesh.rgba is None else mesh.rgba


def _is_there(file: Path, form: ET.Element, meshes: Meshes, surfaces: dict[str, Mesh]) -> bool:
    """Whether a shape has an extent; a mesh is read."""
    if form.tag == "mesh":
        return _is_read(file, form, meshes, surfaces)
    if form.tag not in FORMS:
        raise InputError(file, xml_place(file, form), f"expected {', '.join(FORMS)} or mesh as a <geometry>")
    sizes = np.concatenate([read_numbers(file, form, key, count) for key, count in FORMS[form.tag].items()])
    if not 0 <= min(sizes) <= max(sizes) <= LARGEST:
        raise InputError(
            file, xml_place(file, form), f"expected sizes of 0 to {LARGEST:g} m, got {sizes.tolist()}"
        )
    return bool(min(sizes) > THINNEST)


def _is_read(file: Path, form: ET.Element, meshes: Meshes, surfaces: dict[str, Mesh]) -> bool:
    """Whether a mesh can be read; MuJoCo has a box in its place, of a name of its own at each scale."""
    name = need(file, form, "filename")
    scale = read_numbers(file, form, "scale", 3) if "scale" in form.attrib else np.ones(3)
    try:
        mesh = meshes.load(find_mesh(file, name))
        check_size(mesh.vertices * scale)
    except MeshError as err:
        meshes.failed[name.rpartition("/")[2]] = str(err)
        return False
    faces = mesh.faces if np.prod(scale) > 0 else mesh.faces[:, ::-1]  # a mirrored surface turns inside out
    form.attrib = {"filename": f"{len(surfaces)}.stl"}
    surfaces[f"{len(surfaces)}"] = Mesh(mesh.vertices * scale, faces, mesh.outer * scale, mesh.rgba)
    return True


def _prepare(spec: mujoco.MjSpec) -> None:
    """What collides is not drawn, and inertias are such as bodies can have."""
    for geom in spec.geoms:
        if geom.contype:
            geom.group, geom.rgba = VISUAL_GROUPS, VISIBLE
    for body in spec.bodies:
        if body.explicitinertial:
            xx, yy, zz, xy, xz, yz = body.fullinertia
            tensor = plausible(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
            body.fullinertia = tensor[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]


def find_mesh(urdf: Path, name: str) -> Path:
    """The file of a mesh.

    Args:
        urdf: The URDF that names it.
        name: As it stands there.

    Raises:
        MeshError: When there is none.
    """
    scheme, _, rest = name.strip().replace("\\", "/").partition("://")
    folder = Path(os.path.realpath(urdf)).parent
    if scheme == "file" and rest:
        return Path(unquote(urlparse(name.strip()).path))
    if rest and scheme not in ("package", "model"):
        raise MeshError(f"{scheme}:// is not known; package:// and file:// are")
    package, _, path = rest.partition("/")
    if not rest:
        roots, path = [folder], scheme
    elif not (roots := packages(folder, package)):
        raise MeshError(f"no package {package!r} beside the file or in {UP} folders above it")
    root = next((root for root in roots if (root / path).exists()), roots[0])
    found = inside(root if rest else folder.parent, root / path)
    if found is None:
        raise MeshError(f"lies outside of {root if rest else folder.parent}")
    if rest and not found.exists():
        raise MeshError(f"not in the package {root}")
    return found
