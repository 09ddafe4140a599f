"""URDF read by Pinocchio, which checks it and places and weighs its links; shapes are read from its elements.

Pinocchio's reader of shapes in Python rejects the whole robot for one missing mesh, and drops mimic joints
and which joints state limits. So these are read here.
"""

import contextlib
import os
import re
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO
from urllib.parse import unquote, urlparse

import numpy as np
import pinocchio as pin

from testbench.arm.document import path_inside, unused_name, xml_place
from testbench.arm.mjcf import attribute_numbers
from testbench.errors import Array, InputError
from testbench.files.robot.meshes import (
    MAX_MESH_SIZE,
    VISIBLE,
    MeshError,
    Meshes,
    check_size,
    plausible,
    primitive,
)
from testbench.files.robot.robot import (
    ARM_JOINTS,
    UP,
    Body,
    Coupling,
    ImportedJoint,
    ImportedMesh,
    ImportedShape,
    Note,
    Robot,
    packages,
    pose_of,
    substitute_limits,
)
from testbench.plant.shapes import GeomKind

MOVING = ("revolute", "continuous", "prismatic")
ODD = {"floating": "floats free", "planar": "is planar", "spherical": "is a ball joint"}
PLACED = ("origin", "parent", "child", "axis")
"""Elements of a joint that Pinocchio needs."""
INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
FORMS: dict[GeomKind, dict[str, int]] = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
}
"""Primitives, and how many numbers their attributes have."""
THINNEST = 1e-6
"""Size below which a shape has no extent [m]."""
ENDLESS = 1000.0
"""Limit beyond which a joint counts as unlimited, which is noted [rad, m]."""
MAX_NUMBER = 1e9
"""Largest number that is read; limits of an arm are checked on the whole tree."""
MAX_TURN = 4 * np.pi  #: Largest angle of an origin [rad].
PARSER_ERROR = re.compile(rb"Error:\s+(.*)")
"""Beginning of an error message of Pinocchio's parser."""


def read_urdf(file: Path, root: ET.Element) -> Robot:
    """Read all links and joints of a robot, with the shapes of the links.

    Args:
        file: The URDF, for messages and as the place from which mesh files are found.
        root: Its root element.

    Returns:
        The robot; its notes name the meshes that could not be read.

    Raises:
        InputError: If links, joints or shapes are wrong.
    """
    robot, meshes = read_tree(file, root), Meshes()
    colours = {m.get("name", ""): m.find("color") for m in root.findall("material")}
    shapes = {e.get("name", ""): _shapes(file, e, colours, meshes) for e in root.findall("link")}
    bodies = tuple(replace(body, shapes=shapes[body.name]) for body in robot.bodies)
    return replace(robot, bodies=bodies, notes=(*robot.notes, *meshes.notes()))


def read_tree(file: Path, root: ET.Element) -> Robot:
    """Read all links and joints of a robot, without the shapes of the links.

    Args:
        file: The URDF, for messages.
        root: Its root element.

    Returns:
        The robot; its bodies are ordered with parents first.

    Raises:
        InputError: If links or joints are wrong, or the joints form no tree.
    """
    joints = {e.get("name", ""): e for e in root.findall("joint")}
    limits = {name: _limits(file, e) for name, e in joints.items()}
    locked = _locked(joints, limits)
    couplings = _couplings(file, joints, locked)
    follows = {
        coupling.follower: next((n for n in coupling.terms if n != coupling.follower), "")
        for coupling in couplings
    }
    model = _by_pinocchio(file, root)
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    links = {f.parentJoint: f.name for f in model.frames if f.type == pin.FrameType.BODY}
    rank = {name: k for k, name in enumerate(joints)}
    above = {j: [rank[model.names[i]] for i in list(model.supports[j])[2:]] for j in range(1, model.njoints)}
    order = sorted(above, key=lambda j: (len(above[j]), above[j]))  # as the file has them, parents first
    bodies = []
    for j in order:
        name, inertia = model.names[j], model.inertias[j]
        moves = j > 1 and name not in locked
        kind = joints[name].get("type", "") if moves else "fixed"
        joint = _joint(file, joints[name], data.joints[j].S, limits[name]) if kind in MOVING else None
        body = Body(
            name=links[j],
            parent=order.index(model.parents[j]) if j > 1 else -1,
            pose=model.jointPlacements[j].homogeneous,
            joint=joint,
            odd=ODD.get(kind, ""),
            follows=follows.get(name, "") if joint else "",
            mass=inertia.mass,
            com=inertia.lever.copy(),
            inertia=plausible(inertia.inertia) if inertia.mass else np.zeros((3, 3)),
            weighed=inertia.mass > 0,
        )
        bodies.append(body)
    notes = (Note("locked", tuple(locked)),) if locked else ()
    return Robot(root.get("name") or file.stem, tuple(bodies), notes, tuple(couplings))


def _by_pinocchio(file: Path, root: ET.Element) -> pin.Model:
    """Parse the tree with movable joints and a floating first link, so that each link keeps its inertia.

    Raises:
        InputError: With the words of Pinocchio's parser, or if the joints form no tree.
    """
    bare = ET.Element("robot", name="bare")
    for link in root.findall("link"):
        ET.SubElement(bare, "link", name=link.get("name", "")).extend(_inertial(file, link))
    for joint in root.findall("joint"):
        kind = joint.get("type", "")
        if kind not in (*MOVING, *ODD, "fixed"):
            problem = f"type: expected {', '.join(MOVING)} or fixed, got {kind!r}"
            raise InputError(file, xml_place(joint), problem)
        place = joint.find("origin")
        turn = np.abs(_numbers(file, place, "rpy", [0.0] * 3, joint)).max()
        if turn > MAX_TURN:
            problem = f"rpy: expected radians, up to 4 pi, got {turn:g}: is it in degrees?"
            raise InputError(file, xml_place(joint), problem)
        for e, key in (
            (place, "xyz"),
            (joint.find("axis"), "xyz"),
        ):  # Pinocchio does not say which joint is wrong
            _numbers(file, e, key, [0.0] * 3, joint)
        kind = "prismatic" if kind == "prismatic" else "revolute"
        e = ET.SubElement(bare, "joint", name=joint.get("name", ""), type=kind)
        e.extend(child for child in joint if child.tag in PLACED)
        ET.SubElement(e, "limit", dict.fromkeys(("lower", "upper", "effort", "velocity"), "0"))
    names = [e.get("name", "") for e in bare.findall("joint")]
    children = Counter(e.get("link", "") for e in bare.findall("joint/child"))
    if twice := [name for name, count in children.items() if count > 1]:
        problem = f"link {twice[0]!r} is the child of two joints: leave out what closes the loop"
        raise InputError(file, "<robot>", problem)
    with _standard_error() as said:
        try:
            text = ET.tostring(bare, encoding="unicode")
            model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer(), unused_name("root", names))
        except (RuntimeError, ValueError, IndexError) as err:
            said.seek(0)
            found = PARSER_ERROR.search(said.read())
            why = " ".join(found[1].decode(errors="replace").split()) if found else str(err)
            raise InputError(file, "", f"Pinocchio refuses it: {why}") from err
    if lost := [name for name in names if not model.existJointName(name)]:
        problem = (
            f"expected a tree of links; these joints are not connected to the first link: {', '.join(lost)};"
        )
        raise InputError(file, "<robot>", f"{problem} leave out what closes a loop")
    return model


@contextlib.contextmanager
def _standard_error() -> Iterator[BinaryIO]:
    """Capture what libraries in C++ write to standard error."""
    with tempfile.TemporaryFile() as said:
        real = os.dup(2)
        os.dup2(said.fileno(), 2)
        try:
            yield said
        finally:
            os.dup2(real, 2)
            os.close(real)


def _numbers(
    file: Path, e: ET.Element | None, key: str, default: Sequence[float], owner: ET.Element
) -> Array:
    """Read an attribute as numbers, as many as the default has, which replaces a missing attribute."""
    if e is None or key not in e.attrib:
        return np.array(default, dtype=float)
    return np.array(attribute_numbers(file, e, key, len(default), MAX_NUMBER, owner))


def _inertial(file: Path, link: ET.Element) -> list[ET.Element]:
    """Return the <inertial> of a link with mass, else nothing."""
    inertial = link.find("inertial")
    if inertial is None:
        return []
    mass = float(_numbers(file, inertial.find("mass"), "value", [0.0], link)[0])
    if mass < 0:
        raise InputError(file, xml_place(link), f"mass: expected more than 0 kg, got {mass}")
    for key in ("xyz", "rpy"):
        _numbers(file, inertial.find("origin"), key, [0.0] * 3, link)
    if (tensor := inertial.find("inertia")) is not None:
        for key in INERTIA:
            attribute_numbers(file, tensor, key, 1, np.inf, link)
    found = ET.Element("inertial")
    found.extend(e for e in inertial if e.tag in ("origin", "mass", "inertia"))
    if found.find("inertia") is None:
        ET.SubElement(found, "inertia", dict.fromkeys(INERTIA, "0"))
    return [found] if mass else []


def _limits(file: Path, e: ET.Element) -> tuple[float, float] | None:
    """Read the limits of a joint [rad, m]; None if it states none or unlimited ones."""
    limit = e.find("limit")
    if limit is None or not {"lower", "upper"} & limit.attrib.keys() or e.get("type") == "continuous":
        return None
    ends = {"lower": "0", "upper": "0"} | limit.attrib
    lower, upper = (
        attribute_numbers(file, ET.Element("limit", ends), key, 1, np.inf, e)[0] for key in ("lower", "upper")
    )
    if not lower < upper and (lower or upper):
        raise InputError(file, xml_place(e), f"limit: expected lower < upper, got {lower:g} and {upper:g}")
    return lower, upper


def _locked(joints: Mapping[str, ET.Element], limits: Mapping[str, tuple[float, float] | None]) -> list[str]:
    """List joints locked by limits of 0 to 0; none if no arm is left, as some exporters omit limits."""
    moving = [name for name, e in joints.items() if e.get("type") in MOVING]
    locked = [name for name in moving if limits[name] == (0, 0)]
    return locked if len(moving) - len(locked) >= ARM_JOINTS else []


def _joint(file: Path, e: ET.Element, axis: Array, limits: tuple[float, float] | None) -> ImportedJoint:
    """Make a moving joint; its motion in the link's frame is Pinocchio's, (6,) [1]."""
    slides = e.get("type") == "prismatic"
    axis = np.ravel(axis)[:3] if slides else np.ravel(axis)[3:]
    if not abs(np.linalg.norm(axis) - 1) < THINNEST:
        raise InputError(file, xml_place(e), "axis: expected a direction, got zero")
    endless = limits is not None and max(map(abs, limits)) > ENDLESS
    limited = limits is not None and limits != (0, 0) and not endless
    lower, upper = limits if limits and limited else substitute_limits(prismatic=slides)
    return ImportedJoint(e.get("name", ""), axis, slides, lower, upper, limited, limits if endless else None)


def _couplings(file: Path, joints: Mapping[str, ET.Element], locked: Sequence[str]) -> list[Coupling]:
    """Read mimic joints, q = multiplier q_other + offset; a locked joint stands at zero."""
    moving = {name for name, e in joints.items() if e.get("type") in MOVING} - set(locked)
    followed = {name: m.get("joint", "") for name in moving if (m := joints[name].find("mimic")) is not None}
    couplings = []
    for name, e in joints.items():
        if name not in moving or (mimic := e.find("mimic")) is None:
            continue
        other = mimic.get("joint", "")
        chain = [name]
        while chain[-1] in followed and len(chain) <= len(followed):
            chain.append(followed[chain[-1]])
            if chain[-1] == name:
                raise InputError(file, xml_place(e), f"it mimics itself: {' mimics '.join(chain)}")
        terms = {name: 1.0}
        if other in moving or other not in joints:  # one that is not there is refused where an arm has it
            terms[other] = -float(_numbers(file, mimic, "multiplier", [1.0], e)[0])
        offset = float(_numbers(file, mimic, "offset", [0.0], e)[0])
        couplings.append(Coupling(f"joint {name!r} mimics {other!r}", terms, offset, name))
    return couplings


def _shapes(
    file: Path, link: ET.Element, colours: Mapping[str, ET.Element | None], meshes: Meshes
) -> tuple[ImportedShape, ...]:
    """Read the shapes of a link; collision shapes are drawn if no visual shape can be read."""
    visual, collision = (
        [s for e in link.findall(tag) if (s := _shape(file, link, e, colours, meshes))]
        for tag in ("visual", "collision")
    )
    if link.find("visual") is not None and not visual:
        visual = collision
    hard = (replace(s, rgba=VISIBLE, visual=False, collides=True) for s in collision)
    return (*visual, *hard)


def _shape(
    file: Path, link: ET.Element, e: ET.Element, colours: Mapping[str, ET.Element | None], meshes: Meshes
) -> ImportedShape | None:
    """Read a shape; None if it has no extent or its mesh cannot be read, which is noted."""
    form, origin = next(iter(e.findall("geometry/*")), None), e.find("origin")
    if form is None:
        return None
    kind: GeomKind = next((kind for kind in FORMS if kind == form.tag), "mesh")
    size = _size(file, form, kind)
    mesh = (
        _mesh(file, link, form, meshes) if kind == "mesh" else primitive(kind, size) if size.any() else None
    )
    if mesh is None:
        return None
    turn = pin.rpy.rpyToMatrix(*_numbers(file, origin, "rpy", [0.0] * 3, link))
    pose = pose_of(turn, _numbers(file, origin, "xyz", [0.0] * 3, link))
    return ImportedShape(kind, size, pose, mesh, _colour(file, e, colours, mesh), visual=True, collides=False)


def _size(file: Path, form: ET.Element, kind: GeomKind) -> Array:
    """Read the size of a primitive in MuJoCo's convention, (3,) [m], lengths halved; zero without extent."""
    size = np.zeros(3)
    if form.tag not in (*FORMS, "mesh"):
        raise InputError(file, xml_place(form), f"expected {', '.join(FORMS)} or mesh as a <geometry>")
    if kind == "mesh":
        return size
    found = np.concatenate([attribute_numbers(file, form, key, count) for key, count in FORMS[kind].items()])
    if not 0 <= min(found) <= max(found) <= MAX_MESH_SIZE:
        problem = f"expected sizes of 0 to {MAX_MESH_SIZE:g} m, got {found.tolist()}"
        raise InputError(file, xml_place(form), problem)
    if min(found) > THINNEST:
        size[: len(found)] = found
        size[0 if kind == "box" else 1 :] /= 2
    return size


def _mesh(file: Path, link: ET.Element, form: ET.Element, meshes: Meshes) -> ImportedMesh | None:
    """Read a mesh in metres; None if it cannot be read, which is noted."""
    name = form.get("filename", "")
    scale = _numbers(file, form, "scale", [1.0] * 3, link)
    try:
        mesh = meshes.load(find_mesh(file, name))
        check_size(mesh.vertices * scale)
    except MeshError as err:
        meshes.failed[name.rpartition("/")[2]] = str(err)
        return None
    faces = mesh.faces if np.prod(scale) > 0 else mesh.faces[:, ::-1]  # a mirrored surface turns inside out
    return ImportedMesh(mesh.vertices * scale, faces, mesh.outer * scale, mesh.rgba)


def _colour(file: Path, e: ET.Element, colours: Mapping[str, ET.Element | None], mesh: ImportedMesh) -> Array:
    """Find the colour of an element: its own material, the robot's, the mesh's, or ours, (4,) [1]."""
    colour, material = e.find("material/color"), e.find("material")
    if colour is None and material is not None:
        colour = colours.get(material.get("name", ""))
    if colour is not None:
        return np.array(attribute_numbers(file, colour, "rgba", 4))
    return VISIBLE if mesh.rgba is None else mesh.rgba


def find_mesh(urdf: Path, name: str) -> Path:
    """Find the file of a mesh.

    Args:
        urdf: The URDF that refers to it.
        name: Path or URI of the mesh in the URDF.

    Returns:
        The file.

    Raises:
        MeshError: If there is none.
    """
    scheme, _, rest = name.strip().replace("\\", "/").partition("://")
    folder = Path(os.path.realpath(urdf)).parent
    if scheme == "file" and rest:
        return Path(unquote(urlparse(name.strip()).path))
    if rest and scheme not in ("package", "model"):
        raise MeshError(f"{scheme}:// is not supported; use package:// or file://")
    package, _, path = rest.partition("/")
    if not rest:
        roots, path = [folder], scheme
    elif not (roots := packages(folder, package)):
        raise MeshError(f"no package {package!r} beside the file or in {UP} folders above it")
    root = next((root for root in roots if (root / path).exists()), roots[0])
    found = path_inside(root if rest else folder.parent, root / path)
    if found is None:
        raise MeshError(f"lies outside of {root if rest else folder.parent}")
    if rest and not found.exists():
        raise MeshError(f"not in the package {root}")
    return found
