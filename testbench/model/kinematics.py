"""Kinematics of the rigid arm: joint placements and axes by Pinocchio, from the poses in the arm's MJCF.

`build_vjm` is where the model side begins: it converts an `Arm` to the `Vjm` that all later steps evaluate.
Bodies are placed by our own reading of MJCF, because Pinocchio's reader (4.1.0) moves a root body without a
joint to the world's origin and does not normalise the axis of an axisangle. MuJoCo reads the same file by
itself, so truth and model share no code. Pinocchio's reader of URDF checks the URDF files that we write.

`joint_error_basis` describes errors of the joints themselves. The coordinate of joint j differs from its
command by sum_k phi_jk(q_j, tau_j) n_jk, which is linear in the unknown coefficients n_jk. Errors of gears
and encoders are a Fourier series in the joint's angle; backlash is a step where the torque changes sign; a
stiffening spring adds a term in torque times its absolute value. Absolute calibration (`identify.absolute`)
fits the coefficients, and `correct` uses the same functions phi_jk for its intervals.
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin

from testbench.arm.document import parse_xml
from testbench.arm.folder import Arm
from testbench.arm.mjcf import ATTRIBUTE_SIZES, angle_unit, attribute_numbers, find_body, read_mjcf
from testbench.errors import Array, BenchError, Ids, InputError, check_array
from testbench.model.vjm import Vjm

# --- Kinematics of the rigid arm ----------------------------------------------------------------------------

ORIENTATION_ATTRIBUTES = ("quat", "axisangle", "euler", "xyaxes", "zaxis")  #: MJCF attributes of a rotation.
URDF_PLACEMENT_ELEMENTS = ("origin", "parent", "child", "axis")  #: Elements of a URDF's joint that place it.
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
    model = _build_pinocchio_model(arm)
    data, q0 = model.createData(), pin.neutral(model)
    pin.framesForwardKinematics(model, data, q0)

    def body_placement(body: str) -> pin.SE3:
        return data.oMf[model.getFrameId(body, pin.FrameType.BODY)]

    # poses of all bodies at q = 0; load point and markers in the tool's frame
    bodies = [body_placement(link.name) for link in arm.links]
    tool = body_placement(arm.tool)
    local = [tool.actInv(body_placement(name).translation) for name in (arm.load_point, *arm.markers)]
    # axis of every joint in its own body: the one column of its Jacobian
    jacobians = [pin.computeJointJacobian(model, data, q0, i + 1) for i in range(arm.n_joints)]
    motion = [J.reshape(6, -1)[:, i] for i, J in enumerate(jacobians)]  # of one joint a vector
    axes = [m[:3] if joint.prismatic else m[3:] for m, joint in zip(motion, arm.joints, strict=True)]
    return Vjm(
        arm=arm,
        base_pose=bodies[0].homogeneous,
        joint_placements=np.array([a.actInv(b).homogeneous for a, b in pairwise(bodies)]).reshape(-1, 4, 4),
        joint_axes=np.array(axes).reshape(-1, 3),
        tool_placement=bodies[-1].actInv(tool).homogeneous,
        load_point=local[0],
        markers=np.array(local[1:]),
    )


def _build_pinocchio_model(arm: Arm) -> pin.Model:
    """Build Pinocchio's model of the rigid arm: joints, and frames of links, tool, load point and markers.

    The model has no inertias and no joint limits.

    Args:
        arm: Description of the arm; its rigid.xml is read.

    Returns:
        Pinocchio's model; the frame of every body has the body's name.

    Raises:
        InputError: When the MJCF cannot be read, or a body has no orientation that can be read.
    """
    root = read_mjcf(arm.mjcf_path)
    unit, model = angle_unit(root), pin.Model()
    above = {child: parent for parent in root.iter() for child in parent}

    def body_placement(body: ET.Element) -> pin.SE3:
        return pin.SE3(body_pose(arm, body, unit))

    # pose of the base in the world, through all bodies above it
    base = find_body(arm.mjcf_path, root, arm.links[0].name)
    placement, mount = body_placement(base), above[base]
    while mount.tag == "body":
        placement, mount = body_placement(mount) * placement, above[mount]
    _add_frame(model, arm.links[0].name, 0, placement)
    # joints and links from the base on, each placed in the body before it
    last = 0
    for joint, link in zip(arm.joints, arm.links[1:], strict=True):
        body = find_body(arm.mjcf_path, root, link.name)
        [actuated] = body.findall("joint")
        kind = pin.JointModelPrismaticUnaligned if joint.prismatic else pin.JointModelRevoluteUnaligned
        axis = np.array(attribute_numbers(arm.mjcf_path, actuated, "axis", 3))
        last = model.addJoint(
            last, kind(axis / np.linalg.norm(axis)), placement * body_placement(body), joint.name
        )
        placement = pin.SE3.Identity()
        _add_frame(model, link.name, last, placement)
    # tool, load point and markers move with the last joint
    tool = placement * body_placement(find_body(arm.mjcf_path, root, arm.tool))
    _add_frame(model, arm.tool, last, tool)
    for name in {arm.load_point: None, **dict.fromkeys(arm.markers)}:
        _add_frame(model, name, last, tool * body_placement(find_body(arm.mjcf_path, root, name)))
    return model


def _add_frame(model: pin.Model, name: str, joint: int, placement: pin.SE3) -> None:
    """Add the frame of a body to the tree, placed in its joint."""
    model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.BODY))


def urdf_link_poses(file: Path, text: str, joints: Sequence[str], link: str, q: Array) -> Array:
    """Compute poses of a URDF's link in its root link, by Pinocchio's reader of URDF.

    Args:
        file: Path of the URDF, for messages.
        text: Text of the URDF; its links and joints must form a tree.
        joints: Names of the joints that move, n; all others are fixed at zero.
        link: Name of the link.
        q: Values of the joints that move, (poses, n) [rad, m].

    Returns:
        Homogeneous transforms, root link from link, (poses, 4, 4) [1, m].

    Raises:
        InputError: When Pinocchio refuses the text, or it has no such joint or link.
    """
    try:
        model = pin.buildModelFromXML(_joints_and_links(parse_xml(file, text), joints))
    except (RuntimeError, ValueError, IndexError) as err:
        raise InputError(file, "", f"Pinocchio refuses it: {err}") from err
    if missing := [name for name in joints if not model.existJointName(name)]:
        raise InputError(file, "", f"Pinocchio finds no joint {missing[0]!r}")
    if not model.existBodyName(link):
        raise InputError(file, "", f"Pinocchio finds no link {link!r}")
    data, end = model.createData(), model.getFrameId(link, pin.FrameType.BODY)
    moving = [model.joints[model.getJointId(name)] for name in joints]
    poses = []
    for row in q:
        x = pin.neutral(model)
        for joint, angle in zip(moving, row, strict=True):
            turns = joint.nq == 2  # without limits: on the unit circle
            x[joint.idx_q : joint.idx_q + joint.nq] = (np.cos(angle), np.sin(angle)) if turns else angle
        pin.framesForwardKinematics(model, data, x)
        poses.append(data.oMf[end].homogeneous)
    return np.array(poses)


def _joints_and_links(root: ET.Element, joints: Sequence[str]) -> str:
    """Keep only the links and joints of a URDF: shapes, masses and limits may be wrong here."""
    bare = ET.Element("robot", name="bare")
    for link in root.findall("link"):
        ET.SubElement(bare, "link", name=link.get("name", ""))
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        kind = joint.get("type", "") if name in joints else "fixed"
        e = ET.SubElement(bare, "joint", name=name, type=kind)
        e.extend(child for child in joint if child.tag in URDF_PLACEMENT_ELEMENTS)
        ET.SubElement(e, "limit", dict.fromkeys(("lower", "upper", "effort", "velocity"), "0"))
    return ET.tostring(bare, encoding="unicode")


def body_pose(arm: Arm, body: ET.Element, radians_per_unit: float) -> Array:
    """Read the pose of an MJCF body in its parent.

    Args:
        arm: The arm, for messages.
        body: The <body> element.
        radians_per_unit: Size of one unit of the file's angles [rad].

    Returns:
        Homogeneous transform, parent from body, (4, 4) [1, m].

    Raises:
        InputError: When its position or orientation cannot be read.
    """
    pose = np.eye(4)
    pose[:3, :3] = _rotation(arm, body, radians_per_unit)
    if "pos" in body.attrib:
        pose[:3, 3] = attribute_numbers(arm.mjcf_path, body, "pos", 3)
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
    named = [key for key in ORIENTATION_ATTRIBUTES if key in body.attrib]
    where = f"<body name={body.get('name')!r}>"
    if len(named) > 1:
        raise InputError(arm.mjcf_path, where, f"expected one orientation, got {' and '.join(named)}")
    if not named:
        return np.eye(3)
    [key] = named
    values = np.array(attribute_numbers(arm.mjcf_path, body, key, ATTRIBUTE_SIZES[key]))
    try:
        if key == "quat":
            return np.asarray(pin.Quaternion(*_unit_vector(values)).matrix())
        if key == "axisangle":
            return np.asarray(pin.AngleAxis(unit * values[3], _unit_vector(values[:3])).matrix())
        if key == "euler":  # about x, then the new y, then the new z
            x, y, z = map(pin.utils.rotate, "xyz", unit * values)
            return np.asarray(x @ y @ z)
        if key == "xyaxes":
            return _rotation_from_axes(values[:3], values[3:])
        shortest = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), _unit_vector(values))
        return np.asarray(shortest.matrix())
    except ZeroDivisionError:
        raise InputError(arm.mjcf_path, where, f"{key}: expected directions, got {body.get(key)!r}") from None


def _unit_vector(vector: Array) -> Array:
    length = np.linalg.norm(vector)
    if length < MIN_DIRECTION_LENGTH:
        raise ZeroDivisionError
    return np.asarray(vector / length)


def _rotation_from_axes(x: Array, y: Array) -> Array:
    """Build the rotation whose first column is x and whose second lies in the half plane of y, (3, 3)."""
    x = _unit_vector(x)
    y = _unit_vector(y - (x @ y) * x)
    return np.column_stack([x, y, np.cross(x, y)])


# --- Errors of the joints themselves: transmission errors that are linear in unknown coefficients -----------

#: First order of each band of Fourier orders [1]: the orders of a band share one expected size.
ORDER_BANDS = (1, 2, 3, 5, 8, 12, 16, 20, 24, 28, 32, 40, 50, 60, 75, 95, 120, 150, 190, 240, 300, 400)
BACKLASH_SMOOTHING = 0.1
"""Smoothing of backlash, over a joint's typical torque [1]: the step is tanh(torque / (BACKLASH_SMOOTHING
typical torque)).

At this torque the step has reached 76 % of one side, and at twice it 96 %. A sharp step has no derivative.
"""


@dataclass(frozen=True)
class JointErrorTerms:
    """Select the terms phi_jk of the joints' errors, the same selection for every joint.

    A joint has k coefficients in this order: sines of all orders, cosines of all orders, ratio, backlash,
    stiffening. Terms that are not selected are left out.
    """

    orders: tuple[int, ...] = ()  #: Fourier orders o of sin(o q) and cos(o q), per turn of a hinge [1].
    ratio: bool = False  #: An error in proportion to the angle, as of a wrong gear ratio.
    play: bool = False  #: Backlash: a step where the torque changes its sign.
    stiffening: bool = False  #: Torque times its absolute value: a spring that stiffens or softens.

    def __post_init__(self) -> None:
        """Refuse orders that are not different numbers above 0, by BenchError."""
        if len(set(self.orders)) != len(self.orders) or min(self.orders, default=1) < 1:
            raise BenchError(f"orders: expected different numbers above 0, got {self.orders}")

    @property
    def n_coefficients(self) -> int:
        """Count the coefficients per joint, k = 2 (number of orders) + 1 for each other term selected."""
        return 2 * len(self.orders) + self.ratio + self.play + self.stiffening

    @property
    def coefficient_kinds(self) -> tuple[str, ...]:
        """Name the kind of every coefficient of a joint, (k,): harmonics, ratio, play or stiffening."""
        single = (("ratio", self.ratio), ("play", self.play), ("stiffening", self.stiffening))
        return ("harmonics",) * (2 * len(self.orders)) + tuple(kind for kind, on in single if on)

    @property
    def coefficient_bands(self) -> Ids:
        """Return the index into `ORDER_BANDS` of every coefficient of a joint, (k,); -1 without an order."""
        order = np.tile(self.orders, 2)
        band = np.full(self.n_coefficients, -1)
        band[: len(order)] = np.searchsorted(ORDER_BANDS, order, "right") - 1
        return band


def joint_error_basis(
    terms: JointErrorTerms, arm: Arm, q: Array, torque: Array, typical_torque: Array
) -> Array:
    """Evaluate the basis functions phi_jk of the joint errors, sum_k phi_jk(q_j, tau_j) n_jk for joint j.

    They are sin(o q) for all orders o, cos(o q) for all orders o, q, tanh(tau / (BACKLASH_SMOOTHING tau_0))
    and tau abs(tau) / tau_0^2; terms that are not selected are left out. The harmonic terms of a slide are
    zero. A typical torque tau_0 of zero counts as one.

    Mathematics: `law-8`.

    Args:
        terms: Selection of the terms, k per joint.
        arm: Description of the arm: number of joints, and which of them are slides.
        q: Actuated joints, (runs, n) [rad, m].
        torque: Torque tau of every joint's spring, (n, runs) [N m, N].
        typical_torque: Typical torque tau_0 of every joint, (n,) [N m, N].

    Returns:
        Functions phi, (n, k, runs): harmonics, backlash and stiffening [1], ratio [rad, m].

    Raises:
        BenchError: When q has another shape or is not finite.
    """
    q = check_array(q, (None, arm.n_joints), "q [rad, m]")
    # exp(i o q) for o = 1, 2, ... by repeated products: imaginary part sin(o q), real part cos(o q)
    once = np.broadcast_to(np.exp(1j * q), (max(terms.orders, default=0), *q.shape))
    turns = np.cumprod(once, axis=0)[np.array(terms.orders, dtype=int) - 1] * arm.hinges
    parts = [turns.imag, turns.real]
    # torque over its typical size, (runs, n)
    pull = (torque / np.where(typical_torque > 0, typical_torque, 1.0)[:, None]).T
    if terms.ratio:
        parts.append(q[None])
    if terms.play:
        parts.append(np.tanh(pull / BACKLASH_SMOOTHING)[None])
    if terms.stiffening:
        parts.append((pull * np.abs(pull))[None])
    return np.ascontiguousarray(np.concatenate(parts).transpose(2, 0, 1))
