"""The rigid arm as a kinematic tree of Pinocchio, built joint by joint from the poses in its MJCF.

Pinocchio's own reader of MJCF (4.1.0) puts a root body without a joint at the world's origin, whatever pose
the file gives it, and takes the axis of an axisangle as it stands, not as a direction. So it is given frames
and joints only, each with the pose that is read here. MuJoCo reads the file itself: the two share no code.
Its reader of URDF serves to read back what we write.
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
PLACED = ("origin", "parent", "child", "axis")  #: What places a joint of a URDF.
LEAST = 1e-10  #: A direction shorter than this is none.


def build_vjm(arm: Arm) -> Vjm:
    """The kinematics of an arm, by Pinocchio.

    Raises:
        InputError: When a body of the MJCF has no pose that can be read.
    """
    model = build_tree(arm)
    data, q0 = model.createData(), pin.neutral(model)
    pin.framesForwardKinematics(model, data, q0)

    def pose(body: str) -> pin.SE3:
        return data.oMf[model.getFrameId(body, pin.FrameType.BODY)]

    bodies = [pose(link.name) for link in arm.links]
    tool = pose(arm.tool)
    local = [tool.actInv(pose(name).translation) for name in (arm.load, *arm.markers)]
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
    """Pinocchio's model of an arm: its joints, and a frame in every link, tool, load point and marker.

    Raises:
        InputError: When a body of the MJCF has no orientation that can be read.
    """
    root = read_mjcf(arm.rigid)
    unit, model = angle_unit(root), pin.Model()
    above = {child: parent for parent in root.iter() for child in parent}

    def pose(body: ET.Element) -> pin.SE3:
        return pin.SE3(body_pose(arm, body, unit))

    def add(name: str, joint: int, placement: pin.SE3) -> None:
        model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.BODY))

    base = find_body(arm.rigid, root, arm.links[0].name)
    placement, mount = pose(base), above[base]
    while mount.tag == "body":
        placement, mount = pose(mount) * placement, above[mount]
    add(arm.links[0].name, 0, placement)
    last = 0
    for joint, link in zip(arm.joints, arm.links[1:], strict=True):
        body = find_body(arm.rigid, root, link.name)
        [actuated] = body.findall("joint")
        kind = pin.JointModelPrismaticUnaligned if joint.prismatic else pin.JointModelRevoluteUnaligned
        axis = np.array(numbers(arm.rigid, actuated, "axis", 3))
        last = model.addJoint(last, kind(axis / np.linalg.norm(axis)), placement * pose(body), joint.name)
        placement = pin.SE3.Identity()
        add(link.name, last, placement)
    tool = placement * pose(find_body(arm.rigid, root, arm.tool))
    add(arm.tool, last, tool)
    for name in {arm.load: None, **dict.fromkeys(arm.markers)}:
        add(name, last, tool * pose(find_body(arm.rigid, root, name)))
    return model


def urdf_poses(file: Path, text: str, joints: Sequence[str], link: str, q: Array) -> Array:
    """Poses of a link in the first one, by Pinocchio's own reader of URDF, (poses, 4, 4) [m].

    Args:
        file: The URDF, for messages.
        text: Its text; its links and joints are known to be a tree.
        joints: Names of the joints that move; all others stand at zero.
        link: The link.
        q: Joints, (poses, n) [rad, m].

    Raises:
        InputError: When Pinocchio refuses it, or finds no such joint or link.
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
    """A URDF's links and joints alone: shapes, masses and limits are no matter here, and may be wrong."""
    bare = ET.Element("robot", name="bare")
    for link in root.findall("link"):
        ET.SubElement(bare, "link", name=link.get("name", ""))
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        kind = joint.get("type", "") if name in joints else "fixed"
        e = ET.SubElement(bare, "joint", name=name, type=kind)
        e.extend(child for child in joint if child.tag in PLACED)
        ET.SubElement(e, "limit", dict.fromkeys(("lower", "upper", "effort", "velocity"), "0"))
    return ET.tostring(bare, encoding="unicode")


def body_pose(arm: Arm, body: ET.Element, unit: float) -> Array:
    """Pose of a body in its parent, (4, 4) [1, m].

    Args:
        arm: For messages.
        body: The element.
        unit: Radians in one unit of the file's angles.

    Raises:
        InputError: When its orientation cannot be read.
    """
    pose = np.eye(4)
    pose[:3, :3] = _rotation(arm, body, unit)
    if "pos" in body.attrib:
        pose[:3, 3] = numbers(arm.rigid, body, "pos", 3)
    return pose


def _rotation(arm: Arm, body: ET.Element, unit: float) -> Array:
    """Parent from body, (3, 3), of MJCF's five notations.

    Args:
        arm: For messages.
        body: The element.
        unit: Radians in one unit of the file's angles.
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
    if length < LEAST:
        raise ZeroDivisionError
    return np.asarray(vector / length)


def _of_axes(x: Array, y: Array) -> Array:
    """Of the new x axis and a vector in the half plane of the new y axis."""
    x = _unit(x)
    y = _unit(y - (x @ y) * x)
    return np.column_stack([x, y, np.cross(x, y)])


def _of_z(z: Array) -> Array:
    """The shortest turn that takes the z axis to a direction; about x where it is the opposite one."""
    across = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(across))
    axis = np.array([1.0, 0.0, 0.0]) if sine < LEAST else across / sine
    return np.asarray(pin.AngleAxis(float(np.arctan2(sine, z[2])), axis).matrix())
