"""Conversion of rigid MJCF to elastic MJCF: six sprung virtual joints after every link, one per joint.

The coupled 6x6 stiffness K = inv(C) of a link becomes six fixed tendons, one per eigenvector of K, over the
link's three slides and three hinges. Their energy is 1/2 sum lambda_k (v_k^T theta)^2 = 1/2 theta^T K theta.
The result is plain MJCF that MuJoCo's own viewer opens.
"""

import copy
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm, Link
from testbench.arm.mjcf import find_body, read_mjcf
from testbench.errors import Array

AXES = ("x", "y", "z", "phi_x", "phi_y", "phi_z")
CARRIER_MASS = 1e-9
"""Mass [kg] and inertia [kg m^2] of the body between a link and the next joint.

MuJoCo admits at most six degrees of freedom a body, so the virtual joint needs one; it weighs nothing
that a float of the arm's weight could see.
"""

BRAKE = 1e15
"""Armature of an actuated joint [kg m^2, kg]: its brake is on, so that a simulated arm holds its pose.

Statics does not depend on it. Without it the two joints on one axis make the mass matrix singular.
"""

DAMPING = 0.02
"""Damping of every spring over its stiffness [s]: in a time simulation the arm comes to rest. Statics ignores
it."""


def virtual_joint(link: str, axis: str) -> str:
    """Return the name of a virtual joint in the elastic MJCF.

    Args:
        link: Name of the link.
        axis: Name of the axis.

    Returns:
        The name.
    """
    return f"{link}_theta_{axis}"


def sprung_joint(joint: str) -> str:
    """Name the sprung hinge or slide on the axis of an actuated joint in the elastic MJCF.

    Args:
        joint: Name of the actuated joint.

    Returns:
        Name of the sprung joint.
    """
    return f"{joint}_theta"


def theta_names(arm: Arm) -> list[str]:
    """List the names of the virtual joints in the order of theta.

    Args:
        arm: The arm.

    Returns:
        The names, (n_theta,).
    """
    links = [virtual_joint(link.name, axis) for link in arm.links for axis in AXES]
    return links + [sprung_joint(j.name) for j in arm.joints]


def elastic_mjcf(arm: Arm, foundation: Array | None = None) -> str:
    """Convert the arm's rigid MJCF to an elastic one with its true compliances as joints and springs.

    Contacts are off: an equilibrium has none, and feasibility of a pose is checked on the rigid arm.

    Args:
        arm: The arm.
        foundation: Diagonal of the compliance of a sprung foundation, at the base's origin in world axes,
            (6,) [m/N, rad/(N m)]; None for a rigid one.

    Returns:
        MJCF text; mesh files are named as in rigid.xml.
    """
    root = copy.deepcopy(read_mjcf(arm.rigid))
    root.set("model", f"{arm.name}_elastic")
    option = root.find("option")
    if option is None:
        option = ET.SubElement(root, "option")
    # Contacts are off; stiff springs need these options.
    option.set("jacobian", "dense")  # MuJoCo 4.0.0's sparse constraint solver is wrong
    option.set("integrator", "implicitfast")  # damping in proportion to stiffness is stiff
    option.set("timestep", "0.001")
    flag = option.find("flag")
    ET.SubElement(option, "flag", contact="disable") if flag is None else flag.set("contact", "disable")
    # A virtual joint at the end of every link, with six springs.
    tendons = ET.SubElement(root, "tendon")
    ends = [*(link.name for link in arm.links[1:]), arm.tool]
    for link, end in zip(arm.links, ends, strict=True):
        _insert_virtual_joint(arm.rigid, root, link, end)
        _add_springs(tendons, link)
    # A spring in series with every actuated joint.
    for joint in arm.joints:
        _insert_spring(root, joint.name, 1 / joint.compliance)
    if foundation is not None:
        # A sprung body below the base.
        base = find_body(arm.rigid, root, arm.links[0].name)
        parent = next(element for element in root.iter() if base in list(element))
        carrier = _insert_carrier(parent, base, "foundation", np.eye(3), "foundation")
        for own, soft in zip(carrier.findall("joint"), foundation, strict=True):
            own.set("stiffness", repr(float(1 / soft)))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def _insert_virtual_joint(rigid: Path, root: ET.Element, link: Link, end: str) -> None:
    """Put a body with the link's virtual joint between the link and the body at its end."""
    parent, child = find_body(rigid, root, link.name), find_body(rigid, root, end)
    carrier = _insert_carrier(parent, child, f"{link.name}_end", link.frame, f"{link.name}_theta")
    tiny = repr(CARRIER_MASS)
    ET.SubElement(carrier, "inertial", pos="0 0 0", mass=tiny, diaginertia=" ".join([tiny] * 3))


def _insert_carrier(parent: ET.Element, child: ET.Element, name: str, frame: Array, joint: str) -> ET.Element:
    """Insert a body between two others, with slides and hinges JOINT_x to JOINT_phi_z along a frame."""
    carrier = ET.Element("body", name=name, pos=child.attrib.pop("pos", "0 0 0"))
    parent.insert(list(parent).index(child), carrier)
    parent.remove(child)
    for k, axis in enumerate(AXES):
        kind, along = "slide" if k < 3 else "hinge", " ".join(map(repr, frame[:, k % 3].tolist()))
        ET.SubElement(carrier, "joint", name=f"{joint}_{axis}", type=kind, axis=along)
    carrier.append(child)
    return carrier


def _add_springs(tendons: ET.Element, link: Link) -> None:
    """Add six fixed tendons whose springs have the link's stiffness together."""
    for k, (stiffness, v) in enumerate(zip(*springs(link.compliance), strict=True)):
        tendon = ET.SubElement(
            tendons,
            "fixed",
            name=f"{link.name}_spring_{k + 1}",
            stiffness=repr(float(stiffness)),
            damping=repr(float(DAMPING * stiffness)),
            springlength="0",
        )
        for axis, coef in zip(AXES, v, strict=True):
            if coef != 0:
                ET.SubElement(tendon, "joint", joint=virtual_joint(link.name, axis), coef=repr(float(coef)))


def springs(C: Array) -> tuple[Array, Array]:
    """Decompose K = C^-1 into six springs, K = sum_k k v_k v_k^T.

    The eigenvectors are those of the unit-diagonal matrix D^-1/2 C D^-1/2, not of C: C mixes m/N with rad/(N
    m), and its raw eigenvectors lose digits of the small entries.

    Mathematics: `loaded-8`.

    Args:
        C: Positive definite compliance, (6, 6) [m/N, rad/(N m)].

    Returns:
        Stiffness k of each spring, (6,), and the coefficients v of its tendon as rows, (6, 6).
    """
    # Unit-diagonal matrix and its eigenvectors.
    d = np.sqrt(np.diag(C))
    eigenvalues, Q = np.linalg.eigh(C / np.outer(d, d))
    # Back to C's units: each spring's direction, normalised to length one.
    v = Q.T / d
    norm = np.linalg.norm(v, axis=1)
    return norm**2 / eigenvalues, v / norm[:, None]


def _insert_spring(root: ET.Element, joint: str, stiffness: float) -> None:
    """Insert a sprung joint of the same type on the axis of an actuated one."""
    body = next(b for b in root.iter("body") if any(j.get("name") == joint for j in b.findall("joint")))
    actuated = next(j for j in body.findall("joint") if j.get("name") == joint)
    spring = ET.Element(
        "joint",
        name=sprung_joint(joint),
        type=actuated.get("type", "hinge"),
        axis=actuated.get("axis", ""),
        stiffness=repr(stiffness),
        damping=repr(DAMPING * stiffness),
    )
    actuated.set("armature", repr(BRAKE))
    body.insert(list(body).index(actuated) + 1, spring)
