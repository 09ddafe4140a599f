"""A URDF of an arm where the robot has none: links, joints with limits, tool, masses; no shapes."""

import xml.etree.ElementTree as ET

import numpy as np

from testbench.arm.folder import Arm
from testbench.arm.mjcf import angle_unit, find_body, numbers, read_mjcf
from testbench.arm.mjcf_words import NUMBERS
from testbench.arm.urdf_text import NEW_STAMP, origin_of, words
from testbench.campaign.export_geometry import Rigid
from testbench.errors import Array
from testbench.identify.absolute.state import State
from testbench.model.kinematics import body_pose

ROOT = "world"  #: The first link: MJCF keeps the name for itself, so no link of an arm has it.
UNKNOWN = {"effort": "0", "velocity": "0"}
"""Limits that URDF asks for and an arm's folder does not hold."""


def new_urdf(state: State, geometry: Rigid) -> str:
    """The text of a URDF."""
    arm = state.vjm.arm
    robot = ET.Element("robot", name=arm.name)
    tensors = _tensors(arm)
    names = [*(link.name for link in arm.links), arm.tool]
    ET.SubElement(robot, "link", name=ROOT)
    for name, mass, centre in zip(names, state.weights.mass, state.weights.centre, strict=True):
        link = ET.SubElement(robot, "link", name=name)
        if mass > 0:
            _inertial(link, float(mass), centre, tensors[name])
    taken = {joint.name for joint in arm.joints}
    _joint(robot, _free(f"{names[0]}_fixed", taken), "fixed", (ROOT, names[0]), geometry.base)
    for k, joint in enumerate(arm.joints):
        kind = "prismatic" if joint.prismatic else "revolute"
        e = _joint(robot, joint.name, kind, (names[k], names[k + 1]), geometry.steps[k])
        ET.SubElement(e, "axis", xyz=words(state.vjm.axes[k]))
        ET.SubElement(e, "limit", lower=f"{joint.lower:.12g}", upper=f"{joint.upper:.12g}")
        e[-1].attrib.update(UNKNOWN)
    _joint(robot, _free(f"{names[-1]}_fixed", taken), "fixed", (names[-2], names[-1]), geometry.tool)
    ET.indent(robot)
    return f'<?xml version="1.0"?>\n{NEW_STAMP}{ET.tostring(robot, encoding="unicode")}\n'


def _free(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _joint(robot: ET.Element, name: str, kind: str, ends: tuple[str, str], pose: Array) -> ET.Element:
    e = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(e, "origin", origin_of(pose))
    for tag, link in zip(("parent", "child"), ends, strict=True):
        ET.SubElement(e, tag, link=link)
    return e


def _inertial(link: ET.Element, mass: float, centre: Array, tensor: Array) -> None:
    e = ET.SubElement(link, "inertial")
    ET.SubElement(e, "origin", xyz=words(centre), rpy="0 0 0")
    ET.SubElement(e, "mass", value=f"{mass:.12g}")
    upper = {f"i{'xyz'[a]}{'xyz'[b]}": f"{tensor[a, b]:.12g}" for a in range(3) for b in range(a, 3)}
    ET.SubElement(e, "inertia", upper)


def _tensors(arm: Arm) -> dict[str, Array]:
    """Inertia of every body about its centre in its own axes, as rigid.xml says, (3, 3) [kg m^2]."""
    root = read_mjcf(arm.rigid)
    found = {}
    for name in (*(link.name for link in arm.links), arm.tool):
        e = find_body(arm.rigid, root, name).find("inertial")
        tensor = np.zeros((3, 3))
        if e is not None and "fullinertia" in e.attrib:
            xx, yy, zz, xy, xz, yz = numbers(arm.rigid, e, "fullinertia", NUMBERS["fullinertia"])
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        elif e is not None and "diaginertia" in e.attrib:
            R = body_pose(arm, e, angle_unit(root))[:3, :3]
            tensor = R @ np.diag(numbers(arm.rigid, e, "diaginertia", NUMBERS["diaginertia"])) @ R.T
        found[name] = tensor
    return found
