"""URDF as a tree of bodies."""

import math
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbench.errors import Array, InputError
from testbench.plant.import_robot.chain import JointOf
from testbench.plant.import_robot.meshes import Meshes
from testbench.plant.import_robot.source import (
    check_shapes,
    need,
    read_number,
    read_numbers,
    read_origin,
    where,
)
from testbench.plant.import_robot.tree import ARM_JOINTS, Body, Tree
from testbench.plant.import_robot.urdf_shapes import link_shapes

MOVING = ("revolute", "continuous", "prismatic")
ODD = {"floating": "floats free", "planar": "is planar", "spherical": "is a ball joint"}
UNLIMITED = 2 * math.pi  #: Of a turning joint without limits, each way [rad].
ENDLESS = 1000.0  #: Limits beyond it mean none [rad, m].
SLIDE = 1.0  #: Of a sliding joint without limits, each way [m].


def read_urdf(file: Path, root: ET.Element) -> Tree:
    """The bodies of a URDF.

    Args:
        file: The URDF, for messages and meshes.
        root: Its root element.

    Raises:
        InputError: When links or joints are wrong.
    """
    check_shapes(file, root, "geometry")
    links = _by_name(file, root.findall("link"))
    joints = list(_by_name(file, root.findall("joint")).values())
    if not links:
        raise InputError(file, "<robot>", "expected links, got none")
    parents = _parents(file, links, joints)
    meshes = Meshes()
    colours = _colours(file, root)
    index: dict[str, int] = {}
    bodies: list[Body] = []
    locked = _locked(file, joints)
    for name in _from_the_root(file, links, parents):
        e, joint = links[name], parents.get(name)
        body = replace(_link(file, e, name), shapes=link_shapes(file, e, colours, meshes))
        index[name] = len(bodies)
        if joint is not None:
            body = replace(body, parent=index[_end(file, joint, "parent")], pose=read_origin(file, joint))
            body = body if joint.get("name") in locked else _jointed(file, joint, body)
        bodies.append(body)
    notes = [f"limits of 0 to 0, so held at zero: {', '.join(locked)}"] if locked else []
    return Tree(root.get("name") or file.stem, tuple(bodies), (*notes, *meshes.notes()))


def _by_name(file: Path, elements: list[ET.Element]) -> dict[str, ET.Element]:
    found: dict[str, ET.Element] = {}
    for e in elements:
        name = need(file, e, "name")
        if name in found:
            raise InputError(file, where(e), "the name stands twice")
        found[name] = e
    return found


def _end(file: Path, joint: ET.Element, which: str) -> str:
    end = joint.find(which)
    if end is None:
        raise InputError(file, where(joint), f"expected a <{which}>")
    return need(file, end, "link")


def _parents(file: Path, links: dict[str, ET.Element], joints: list[ET.Element]) -> dict[str, ET.Element]:
    """The joint before every link but the root."""
    parents: dict[str, ET.Element] = {}
    for joint in joints:
        for which in ("parent", "child"):
            if (end := _end(file, joint, which)) not in links:
                raise InputError(file, where(joint), f"{which}: there is no link {end!r}")
        child = _end(file, joint, "child")
        if child in parents:
            first = parents[child].get("name")
            raise InputError(file, where(joint), f"link {child!r} is the child of {first!r} already")
        parents[child] = joint
    return parents


def _from_the_root(file: Path, links: dict[str, ET.Element], parents: dict[str, ET.Element]) -> list[str]:
    """Links, every parent before its children."""
    roots = [name for name in links if name not in parents]
    if len(roots) != 1:
        got = ", ".join(roots) or "a circle of joints"
        raise InputError(file, "<robot>", f"expected one link without a parent, got {got}")
    children: dict[str, list[str]] = {name: [] for name in links}
    for child, joint in parents.items():
        children[_end(file, joint, "parent")].append(child)
    order = roots
    for name in order:
        order += children[name]
    if len(order) != len(links):
        circle = ", ".join(sorted(set(links) - set(order)))
        raise InputError(file, "<robot>", f"these links stand in a circle of joints: {circle}")
    return order


def _link(file: Path, e: ET.Element, name: str) -> Body:
    """A link with its mass, at no joint yet."""
    inertial = e.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    kilograms = 0.0 if mass is None else read_number(file, mass, "value", 0.0)
    if inertial is None or kilograms == 0:
        return Body(name, -1, np.eye(4), weighed=False)
    if kilograms < 0:
        raise InputError(file, where(e), f"mass: expected more than 0 kg, got {kilograms}")
    pose, tensor = read_origin(file, inertial), np.zeros((3, 3))
    if (inertia := inertial.find("inertia")) is not None:
        xx, xy, xz, yy, yz, zz = (
            read_number(file, inertia, key, 0.0) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    R = pose[:3, :3]
    return Body(name, -1, np.eye(4), mass=kilograms, com=pose[:3, 3], inertia=R @ tensor @ R.T)


def _jointed(file: Path, e: ET.Element, body: Body) -> Body:
    """The link behind its joint."""
    kind, name = e.get("type", ""), e.get("name", "")
    if kind == "fixed":
        return body
    if kind in ODD:
        return replace(body, odd=ODD[kind])
    if kind not in MOVING:
        raise InputError(file, where(e), f"type: expected {', '.join(MOVING)} or fixed, got {kind!r}")
    axis_e = e.find("axis")
    axis = np.array([1.0, 0, 0]) if axis_e is None else read_numbers(file, axis_e, "xyz", "1 0 0", 3)
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        raise InputError(file, where(e), "axis: expected a direction, got zero")
    lower, upper, stated = _limits(file, e, kind)
    joint = JointOf(name, axis / length, kind == "prismatic", lower, upper, "file" if stated else "none")
    if (mimic := e.find("mimic")) is None:
        return replace(body, joint=joint)
    follows = mimic.get("joint", "")
    return replace(body, joint=joint, odd=f"follows {follows!r} (mimic)", follows=follows)


def _locked(file: Path, joints: list[ET.Element]) -> list[str]:
    """Joints that limits of 0 to 0 lock; none where no arm would be left: its exporter knew no limits."""
    moving = [e for e in joints if e.get("type") in MOVING]
    zero = [e for e in moving if e.get("type") != "continuous" and _stated(file, e) == (0, 0)]
    return [e.get("name", "") for e in zero] if len(moving) - len(zero) >= ARM_JOINTS else []


def _stated(file: Path, e: ET.Element) -> tuple[float, float] | None:
    """The limits that a joint states [rad, m]; None where it states none."""
    limit = e.find("limit")
    if limit is None or not {"lower", "upper"} & set(limit.attrib):
        return None
    return read_number(file, limit, "lower", 0.0), read_number(file, limit, "upper", 0.0)


def _limits(file: Path, e: ET.Element, kind: str) -> tuple[float, float, bool]:
    """Lower and upper limit [rad, m], and whether the file states them."""
    ours, stated = SLIDE if kind == "prismatic" else UNLIMITED, _stated(file, e)
    if kind == "continuous" or stated is None:
        return -ours, ours, False
    lower, upper = stated
    if lower == upper == 0 or max(abs(lower), abs(upper)) > ENDLESS:
        return -ours, ours, False
    if not lower < upper:
        raise InputError(file, where(e), f"limit: expected lower < upper, got {lower:g} and {upper:g}")
    return lower, upper, True


def _colours(file: Path, root: ET.Element) -> dict[str, Array]:
    """The robot's materials by name."""
    found = {m.get("name", ""): m.find("color") for m in root.findall("material")}
    return {name: read_numbers(file, e, "rgba", "", 4) for name, e in found.items() if e is not None}
