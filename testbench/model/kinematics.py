"""Kinematics of the rigid arm: joint placements and axes by Pinocchio, from the poses in the arm's MJCF.

`build_vjm` is where the model side begins: it turns an `Arm` into the `Vjm` that all later steps evaluate.
Bodies are placed by our own reading of MJCF, because Pinocchio's reader (4.1.0) moves a root body without a
joint to the world's origin and does not normalise the axis of an axisangle. MuJoCo reads the same file by
itself, so truth and model share no code. Pinocchio's reader of URDF checks the URDF files that we write.
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin

from testbench.arm.document import parse_xml
from testbench.arm.folder import Arm
from testbench.arm.mjcf import NUMBERS, angle_unit, find_body, numbers, read_mjcf
from testbench.errors import Array, InputError
from testbench.model.vjm import Vjm

ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
JOINT_PLACEMENTS = ("origin", "parent", "child", "axis")  #: Elements of a URDF's joint that place it.
MIN_DIRECTION_LENGTH = 1e-10  #: Least length of a vector that gives a direction [unit of the vector].


def build_vjm(arm: Arm) -> Vjm:
    """Build the extended kinematic chain of an arm, Eq. (1): placements, axes, tool, load point and markers.

    Args:
        arm: Description of the arm; its rigid.xml is read.

    Returns:
        The kinematics at q = 0, without joint laws.

    Raises:
        InputError: When the MJCF cannot be read, or a body has no pose that can be read.
    """
    model = build_tree(arm)
    data, q0 = model.createData(), pin.neutral(model)
    pin.framesForwardKinematics(model, data, q0)

    def pose(body: str) -> pin.SE3:
        return data.oMf[model.getFrameId(body, pin.FrameType.BODY)]

    # poses of all bodies at q = 0; load point and markers in the tool's frame
    bodies = [pose(link.name) for link in arm.links]
    tool = pose(arm.tool)
    local = [tool.actInv(pose(name).translation) for name in (arm.load, *arm.markers)]
    # axis of every joint in its own body: the one column of its Jacobian
    jacobians = [pin.computeJointJacobian(model, data, q0, i + 1) for i in range(arm.n_joints)]
    motion = [J.reshape(6, -1)[:, i] for i, J in enumerate(jacobians)]  # of one joint a vector
    axes = [m[:3] if joint.prismatic else m[3:] for m, joint in zip(motion, arm.joints, strict=True)]
    return Vjm(
        arm=arm,
        base=bodies[0].homogeneous,
        placements=np.array([a.actInv(b).homogeneous for a, b in pairwise(bodies)]).reshape(-1, 4, 4),
        axes=np.array(axes).reshape(-1, 3),
        tool=bodies[-1].actInv(tool).homogeneous,
        load=local[0],
        markers=np.array(local[1:]),
    )


def build_tree(arm: Arm) -> pin.Model:
    """Build Pinocchio's model of the rigid arm: joints, and frames of links, tool, load point and markers.

    Args:
        arm: Description of the arm; its rigid.xml is read.

    Returns:
        The kinematic tree. It has no inertias and no limits.

    Raises:
        InputError: When the MJCF cannot be read, or a body has no orientation that can be read.
    """
    root = read_mjcf(arm.rigid)
    unit, model = angle_unit(root), pin.Model()
    above = {child: parent for parent in root.iter() for child in parent}

    def pose(body: ET.Element) -> pin.SE3:
        return pin.SE3(body_pose(arm, body, unit))

    def add(name: str, joint: int, placement: pin.SE3) -> None:
        """Add the frame of a body to the tree.

        Args:
            name: Name of the body.
            joint: Index of its parent joint in Pinocchio.
            placement: Pose of the body in that joint's frame [m].
        """
        model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.BODY))

    # pose of the base in the world, through all bodies above it
    base = find_body(arm.rigid, root, arm.links[0].name)
    placement, mount = pose(base), above[base]
    while mount.tag == "body":
        placement, mount = pose(mount) * placement, above[mount]
    add(arm.links[0].name, 0, placement)
    # joints and links from the base on, each placed in the body before it
    last = 0
    for joint, link in zip(arm.joints, arm.links[1:], strict=True):
        body = find_body(arm.rigid, root, link.name)
        [actuated] = body.findall("joint")
        kind = pin.JointModelPrismaticUnaligned if joint.prismatic else pin.JointModelRevoluteUnaligned
        axis = np.array(numbers(arm.rigid, actuated, "axis", 3))
        last = model.addJoint(last, kind(axis / np.linalg.norm(axis)), placement * pose(body), joint.name)
        placement = pin.SE3.Identity()
        add(link.name, last, placement)
    # tool, load point and markers move with the last joint
    tool = placement * pose(find_body(arm.rigid, root, arm.tool))
    add(arm.tool, last, tool)
    for name in {arm.load: None, **dict.fromkeys(arm.markers)}:
        add(name, last, tool * pose(find_body(arm.rigid, root, name)))
    return model


def urdf_poses(file: Path, text: str, joints: Sequence[str], link: str, q: Array) -> Array:
    """Compute poses of a URDF's link in its root link, by Pinocchio's own reader of URDF.

    Args:
        file: Path of the URDF, for messages.
        text: Text of the URDF; its links and joints must form a tree.
        joints: Names of the joints that move, n; all others are held at zero.
        link: Name of the link.
        q: Values of the joints that move, (poses, n) [rad, m].

    Returns:
        Homogeneous transforms, root link from link, (poses, 4, 4) [1, m].

    Raises:
        InputError: When Pinocchio refuses the text, or it has no such joint or link.
    """
    try:
        model = pin.buildModelFromXML(_bare(parse_xml(file, text), joints))
    except (RuntimeError, ValueError, IndexError) as err:
        raise InputError(file, "", f"Pinocchio refuses it: {err}") from err
    if missing := [name for name in joints if not model.existJointName(name)]:
        raise InputError(file, "", f"Pinocchio finds no joint {missing[0]!r}")
    if not model.existBodyName(link):
        raise InputError(file, "", f"Pinocchio finds no link {link!r}")
    data, end = model.createData(), model.getFrameId(link, pin.FrameType.BODY)
    own = [model.joints[model.getJointId(name)] for name in joints]
    found = []
    for row in q:
        x = pin.neutral(model)
        for joint, angle in zip(own, row, strict=True):
            turns = joint.nq == 2  # without limits: on the unit circle
            x[joint.idx_q : joint.idx_q + joint.nq] = (np.cos(angle), np.sin(angle)) if turns else angle
        pin.framesForwardKinematics(model, data, x)
        found.append(data.oMf[end].homogeneous)
    return np.array(found)


def _bare(root: ET.Element, joints: Sequence[str]) -> str:
    """Keep the links and joints of a URDF alone: shapes, masses and limits may be wrong here."""
    bare = ET.Element("robot", name="bare")
    for link in root.findall("link"):
        ET.SubElement(bare, "link", name=link.get("name", ""))
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        kind = joint.get("type", "") if name in joints else "fixed"
        e = ET.SubElement(bare, "joint", name=name, type=kind)
        e.extend(child for child in joint if child.tag in JOINT_PLACEMENTS)
        ET.SubElement(e, "limit", dict.fromkeys(("lower", "upper", "effort", "velocity"), "0"))
    return ET.tostring(bare, encoding="unicode")


def body_pose(arm: Arm, body: ET.Element, unit: float) -> Array:
    """Read the pose of an MJCF body in its parent.

    Args:
        arm: The arm, for messages.
        body: The <body> element.
        unit: Size of one unit of the file's angles [rad].

    Returns:
        Homogeneous transform, parent from body, (4, 4) [1, m].

    Raises:
        InputError: When its position or orientation cannot be read.
    """
    pose = np.eye(4)
    pose[:3, :3] = _rotation(arm, body, unit)
    if "pos" in body.attrib:
        pose[:3, 3] = numbers(arm.rigid, body, "pos", 3)
    return pose


def _rotation(arm: Arm, body: ET.Element, unit: float) -> Array:
    """Read the rotation parent from body of an MJCF element, in any of the five notations.

    Args:
        arm: The arm, for messages.
        body: The <body> element.
        unit: Size of one unit of the file's angles [rad].

    Returns:
        Rotation matrix, (3, 3) [1]; the identity without an orientation.

    Raises:
        InputError: When there are two orientations, or one that is no direction.
    """
    named = [key for key in ORIENTATIONS if key in body.attrib]
    where = f"<body name={body.get('name')!r}>"
    if len(named) > 1:
        raise InputError(arm.rigid, where, f"expected one orientation, got {' and '.join(named)}")
    if not named:
        return np.eye(3)
    [key] = named
    values = np.array(numbers(arm.rigid, body, key, NUMBERS[key]))
    try:
        if key == "quat":
            return np.asarray(pin.Quaternion(*_unit(values)).matrix())
        if key == "axisangle":
            return np.asarray(pin.AngleAxis(unit * values[3], _unit(values[:3])).matrix())
        if key == "euler":  # about x, then the new y, then the new z
            x, y, z = map(pin.utils.rotate, "xyz", unit * values)
            return np.asarray(x @ y @ z)
        return _of_axes(values[:3], values[3:]) if key == "xyaxes" else _of_z(_unit(values))
    except ZeroDivisionError:
        raise InputError(arm.rigid, where, f"{key}: expected directions, got {body.get(key)!r}") from None


def _unit(vector: Array) -> Array:
    length = np.linalg.norm(vector)
    if length < MIN_DIRECTION_LENGTH:
        raise ZeroDivisionError
    return np.asarray(vector / length)


def _of_axes(x: Array, y: Array) -> Array:
    """Build the rotation whose first column is x and whose second lies in the half plane of y, (3, 3)."""
    x = _unit(x)
    y = _unit(y - (x @ y) * x)
    return np.column_stack([x, y, np.cross(x, y)])


def _of_z(z: Array) -> Array:
    """Build the shortest rotation that takes the z axis to a direction; about x where that is -z."""
    across = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(across))
    axis = np.array([1.0, 0.0, 0.0]) if sine < MIN_DIRECTION_LENGTH else across / sine
    return np.asarray(pin.AngleAxis(float(np.arctan2(sine, z[2])), axis).matrix())
