"""The robot's own URDF: its chain matched by the names of its joints, its origins as identified.

A robot's file and the arm's folder may draw one robot with other frames: another base, other axes of the
links, another zero along a joint's axis. The joint axes are the same lines: the lines of one drawing are
fitted to the other's.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from pathlib import Path
from xml.parsers import expat

import numpy as np

from testbench.arm.folder import Arm
from testbench.errors import Array, InputError, read_text
from testbench.files.robot.chain import fit_names
from testbench.files.robot.robot import (
    MAX_BYTES,
    Body,
    ImportedJoint,
    find_tip,
    in_order,
    path_to,
    pose_of,
    read_xml,
)
from testbench.files.robot.urdf import read_tree
from testbench.identify.absolute.state import ArmState
from testbench.model.kinematics import urdf_link_poses
from testbench.model.vjm import Vjm, evaluate_chain, move_virtual_joint, rotation_matrices, skew

# --- A robot's URDF as text: only the origins of joints are replaced, every other character stays -----------

DECIMALS = 12  #: Decimals of a metre or radian.
BESIDE = "what a URDF cannot hold is in the JSON beside it -->\n"
STAMP = f"<!-- testbench export: origins as identified; {BESIDE}"
NEW_STAMP = f"<!-- testbench export: a new URDF of an identified arm; {BESIDE}"
"""First line of every URDF that we write: into a robot's own, and from scratch."""
HEAD = rb"\s*(<\?xml[^>]*\?>)?\s*"
TAG = re.compile(rb"""<(?:[^>"']|"[^"]*"|'[^']*')*>""")  #: A tag; values in quotes may hold a `>` too.
BEGINS, BEGINS_NEW = HEAD + rb"<!-- testbench export: ", HEAD + rb"<!-- testbench export: a new URDF"


def rpy_of(R: Array) -> Array:
    """Compute roll, pitch and yaw of a rotation R = Rz Ry Rx, accurate near a pitch of 90 degrees too.

    Args:
        R: Rotation matrix, (3, 3) [1].

    Returns:
        Roll, pitch, yaw, (3,) [rad].
    """
    yaw = np.arctan2(R[1, 0], R[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw])


def words(values: Array) -> str:
    """Write numbers as a URDF has them, with at most `DECIMALS` decimals and no needless zeros.

    Args:
        values: Numbers, (k,).

    Returns:
        The numbers with a space between them.
    """
    texts = (f"{x:.{DECIMALS}f}".rstrip("0").rstrip(".") for x in np.round(values, DECIMALS) + 0.0)
    return " ".join(texts)


def origin_of(pose: Array) -> dict[str, str]:
    """Write the attributes xyz and rpy of an <origin> element.

    Args:
        pose: Homogeneous transform, (4, 4) [1, m].

    Returns:
        Texts by attribute.
    """
    return {"xyz": words(pose[:3, 3]), "rpy": words(rpy_of(pose[:3, :3]))}


def with_origins(path: Path, text: str, poses: Mapping[str, Array]) -> str:
    """Replace the origins of some joints in the text of a URDF, and add our stamp.

    Args:
        path: The file, for messages.
        text: A well-formed URDF.
        poses: New pose of a joint in the link before it, (4, 4) [1, m], by the joint's name.

    Returns:
        The new text.

    Raises:
        InputError: When a joint is not in the URDF.
    """
    data = text.encode()
    spans = _origins(data)
    if missing := [name for name in poses if name not in spans]:
        raise InputError(path, "", f"no joint {missing[0]!r}")
    # from the end of the text on, so that earlier places stay where they are
    for name in sorted(poses, key=spans.__getitem__, reverse=True):
        start, end = spans[name]
        closes = b">" if start < end and data[end - 2 : end - 1] != b"/" else b"/>"
        said = "".join(f' {key}="{value}"' for key, value in origin_of(poses[name]).items())
        data = data[:start] + b"<origin" + said.encode() + closes + data[end:]
    head = data.index(b"?>") + 2 if data.startswith(b"<?xml") else 0
    return (data[:head] + b"\n" * (head > 0) + STAMP.encode() + data[head:].lstrip(b"\r\n")).decode()


def _origins(data: bytes) -> dict[str, tuple[int, int]]:
    """Find the bytes of the <origin> of every joint, or where one can stand if there is none."""
    ends: dict[str, tuple[int, int]] = {}
    origins: dict[str, tuple[int, int]] = {}
    above: list[tuple[str, str]] = []
    parser = expat.ParserCreate("utf-8")

    def start(tag: str, attributes: dict[str, str]) -> None:
        """Record where an origin begins and ends.

        Args:
            tag: Name of the element that begins.
            attributes: Its attributes.
        """
        within = [name for name, _ in above]
        name = attributes.get("name", "")
        at, end = next(TAG.finditer(data, parser.CurrentByteIndex)).span()
        if within == ["robot"] and tag == "joint":
            ends.setdefault(name, (end, end))
        elif within == ["robot", "joint"] and tag == "origin":
            origins.setdefault(above[-1][1], (at, end))
        above.append((tag, name))

    def end_of(_: str) -> None:
        above.pop()

    parser.StartElementHandler = start
    parser.EndElementHandler = end_of
    parser.Parse(data, True)
    return ends | origins


# --- Identified geometry: constants of the virtual joints included in the poses of the joints ---------------

RANDOM_POSES = 1000
"""Random poses in which an export is compared."""


@dataclass(frozen=True)
class Rigid:
    """Describe a rigid chain: base, then a step and a turn or slide for every joint, then the tool."""

    base: Array  #: Pose of the base link in the world, (4, 4) [m].
    steps: Array  #: Pose of each joint's body in the body before it at q = 0, (n, 4, 4) [m].
    tool: Array  #: Pose of the tool in the last body, (4, 4) [m].

    @property
    def bodies(self) -> list[Array]:
        """Compute the poses of the links' bodies in the world at q = 0, (n + 1) of (4, 4) [m]."""
        found = [self.base]
        for step in self.steps:
            found.append(found[-1] @ step)
        return found


@dataclass(frozen=True)
class UrdfFrames:
    """Hold the places of a URDF's frames in the model, the same for every q and every geometry."""

    names: Sequence[str]  #: Links of the URDF: the first, those behind the joints, the tip; n + 2.
    root: Array  #: First link in the model's world, (4, 4) [m].
    links: Sequence[Array]  #: Links in the model's bodies, the base's first, (n + 1) of (4, 4) [m].
    tip: Array  #: Tip in the model's tool, (4, 4) [m].


def relative_pose(frame: Array, pose: Array) -> Array:
    """Express a pose in a frame, both given in a third frame.

    Args:
        frame: The frame, (4, 4) [m].
        pose: The pose, (4, 4) [m].

    Returns:
        The pose in the frame, (4, 4) [m].
    """
    back = frame[:3, :3].T
    return pose_of(back @ pose[:3, :3], back @ (pose[:3, 3] - frame[:3, 3]))


def nominal_rigid(vjm: Vjm) -> Rigid:
    """Return the nominal geometry of an arm.

    Args:
        vjm: The arm's virtual joint model.

    Returns:
        Base, joint steps and tool of its rigid chain.
    """
    return Rigid(vjm.base_pose, vjm.joint_placements, vjm.tool_placement)


def identified_rigid(state: ArmState) -> Rigid:
    """Compute the geometry with its identified errors: `evaluate_chain` at theta_0, for every q.

    Args:
        state: The calibrated arm.

    Returns:
        Base, joint steps and tool of its rigid chain.
    """
    vjm, n = state.vjm, state.vjm.arm.n_joints
    links, offsets = state.theta_0[: 6 * n + 6].reshape(-1, 6), state.theta_0[6 * n + 6 :]
    poses = [*vjm.joint_placements, vjm.tool_placement]
    bent = [
        _bent(x, link.beam_axes, theta) for x, link, theta in zip(poses, vjm.arm.links, links, strict=True)
    ]
    steps = [
        step @ _moved(axis, offset, prismatic=joint.prismatic)
        for step, axis, offset, joint in zip(bent, vjm.joint_axes, offsets, vjm.arm.joints, strict=False)
    ]
    return Rigid(vjm.base_pose, np.array(steps).reshape(-1, 4, 4), bent[-1])


def _bent(pose: Array, frame: Array, theta: Array) -> Array:
    """Compute the pose behind a link whose end is moved by constants, (6,) [m, rad]."""
    p, _, beam = move_virtual_joint(pose[:3, 3:], frame[..., None], theta[None])
    return pose_of(beam[..., 0] @ frame.T @ pose[:3, :3], p[:, 0])


def _moved(axis: Array, by: float, *, prismatic: bool) -> Array:
    return pose_of(np.eye(3), by * axis) if prismatic else pose_of(rotation_matrices(by * axis), np.zeros(3))


def random_joints(vjm: Vjm) -> Array:
    """Draw poses over the joints' ranges, the same for every export.

    Args:
        vjm: The arm's virtual joint model, n joints.

    Returns:
        Actuated joints, (RANDOM_POSES, n) [rad, m].
    """
    return vjm.arm.draw_poses(np.random.default_rng(0), RANDOM_POSES)


def tool_poses(vjm: Vjm, q: Array, theta_0: Array | None = None) -> Array:
    """Compute the poses of the model's tool in the world, rigid.

    Args:
        vjm: The arm.
        q: Actuated joints, (poses, n) [rad, m].
        theta_0: Constants of the virtual joints, (n_theta,) [m, rad]; None for zero.

    Returns:
        Poses, (poses, 4, 4) [m].
    """
    where = evaluate_chain(vjm, q, None if theta_0 is None else np.tile(theta_0, (len(q), 1)))
    return pose_of(where.tool_rotation, where.tool_position)


def frame_distance(a: Array, b: Array) -> tuple[float, float]:
    """Compute the largest difference between poses.

    Args:
        a: Poses, (poses, 4, 4) [m].
        b: Other poses, (poses, 4, 4) [m].

    Returns:
        Difference of position [m], and of an axis [rad].
    """
    position = np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1).max()
    return float(position), float(np.abs(a[:, :3, :3] - b[:, :3, :3]).max())


def displacement_statistics(off: Array) -> tuple[float, float]:
    """Compute RMS and largest length of displacements.

    Args:
        off: Displacements, (poses, 3) [m].

    Returns:
        RMS and maximum [mm].
    """
    mm = 1e3 * np.linalg.norm(off, axis=1)
    return float(np.sqrt(np.mean(mm**2))), float(mm.max())


# --- The robot's own URDF: its chain matched by the names of its joints, its origins as identified ----------

MAX_DIFFERENCE = 1e-4
"""Largest difference of a robot's own drawing from the arm's [m, rad]: that of a right angle with five
digits."""
ROUNDING = 1e-12
"""Size below which a number is rounding [m, 1]."""
UNTOLD = 1e-4
"""Least singular value that counts, over the largest [1]: rounding does not determine where parallel axes
end."""


@dataclass(frozen=True)
class RobotChain:
    """Hold the arm's chain in a robot's URDF."""

    file: Path
    text: str  #: Text of the file.
    bodies: tuple[Body, ...]  #: From the first link to the tip, which carries the tool; fixed ones too.
    names: tuple[str, ...]  #: Name of the joint before each body; "" for the first.
    loose_meshes: bool  #: Whether it names meshes by relative paths.

    @property
    def moving(self) -> list[int]:
        """List the places of the moving joints, in `bodies`."""
        return [k for k, body in enumerate(self.bodies) if body.joint]

    @property
    def joints(self) -> list[ImportedJoint]:
        """List the moving joints."""
        return [body.joint for body in self.bodies if body.joint]

    @property
    def rigid(self) -> Rigid:
        """Combine the chain to one step per joint; the base is the first link."""
        cuts = [1, *(k + 1 for k in self.moving)]
        steps = [in_order([b.pose for b in self.bodies[i:j]]) for i, j in pairwise(cuts)]
        return Rigid(np.eye(4), np.array(steps), in_order([b.pose for b in self.bodies[cuts[-1] :]]))


def read_robot_chain(file: Path, arm: Arm, tip: str | None = None) -> RobotChain:
    """Read the chain of an arm in a robot's own URDF.

    Args:
        file: The URDF.
        arm: The arm.
        tip: Link that carries the tool; None for the link with the name of the arm's tool, else the usual
            one.

    Returns:
        The chain.

    Raises:
        InputError: If its joints up to the tip are not the arm's.
    """
    root, text = read_xml(file), read_text(file, MAX_BYTES)
    if re.match(BEGINS, text.encode()) and not re.match(BEGINS_NEW, text.encode()):
        raise InputError(file, "", "testbench export wrote it; expected the robot's own URDF")
    if root.tag != "robot":
        raise InputError(file, "", f"expected URDF (<robot>) at the top, got <{root.tag}>")
    return chain_of(file, text, root, arm, tip)


def chain_of(file: Path, text: str, root: ET.Element, arm: Arm, tip: str | None = None) -> RobotChain:
    """Find the chain of an arm in a URDF that was read.

    Args:
        file: The URDF, for messages.
        text: Its text.
        root: Its root element.
        arm: The arm.
        tip: Link that carries the tool; None for the link with the name of the arm's tool, else the usual
            one.

    Returns:
        The chain.

    Raises:
        InputError: If its joints up to the tip are not the arm's.
    """
    loose = any("://" not in mesh.get("filename", "") for mesh in root.iter("mesh"))
    tree = read_tree(file, root)
    has_tool = any(body.name == arm.tool for body in tree.bodies)
    end = find_tip(file, tree, arm.tool if tip is None and has_tool else tip)
    path = path_to(tree.bodies, end.body)
    bodies = tuple(tree.bodies[k] for k in path)
    pairs = [(joint.find("child"), joint.get("name", "")) for joint in root.findall("joint")]
    before = {child.get("link", ""): name for child, name in pairs if child is not None}
    names = ("", *(before[body.name] for body in bodies[1:]))
    _check_joints(file, bodies, names, arm)
    return RobotChain(file, text, bodies, names, loose)


def _check_joints(file: Path, bodies: tuple[Body, ...], names: tuple[str, ...], arm: Arm) -> None:
    """Check that the moving joints are the arm's by name, order and kind."""
    moving = [(name, body) for name, body in zip(names, bodies, strict=True) if body.moves]
    for name, body in moving:
        if body.odd:
            raise InputError(file, f"<joint name={name!r}>", f"it {body.odd}")
    have, wanted = [name for name, _ in moving], [joint.name for joint in arm.joints]
    if wanted not in (have, fit_names(have)):
        got = f"got {', '.join(have) or 'none'} up to {bodies[-1].name!r}; --tip names another end"
        raise InputError(file, "", f"expected the joints of {arm.name}, {', '.join(wanted)}, {got}")
    for (name, body), joint in zip(moving, arm.joints, strict=True):
        if body.joint and body.joint.prismatic != joint.prismatic:
            kinds = ("turns", "slides")
            problem = f"it {kinds[body.joint.prismatic]}; in {arm.name} it {kinds[joint.prismatic]}"
            raise InputError(file, f"<joint name={name!r}>", problem)


def place_frames(robot_chain: RobotChain, state: ArmState) -> tuple[UrdfFrames, float]:
    """Find the places of a robot's own frames in the model, and the difference of the two drawings.

    Args:
        robot_chain: The robot's chain.
        state: The identified arm.

    Returns:
        The frames, and the largest difference [m, rad].

    Raises:
        InputError: If the drawings differ by more than `MAX_DIFFERENCE`.
    """
    vjm = state.vjm
    rigid = robot_chain.rigid
    model = nominal_rigid(state.vjm)
    slides = [joint.prismatic for joint in vjm.arm.joints]
    axes = np.array([joint.axis for joint in robot_chain.joints])
    lines = axis_lines(rigid.bodies[1:], axes, slides), axis_lines(model.bodies[1:], vjm.joint_axes, slides)
    root = align_frames(*lines)
    links = [relative_pose(a, root @ u) for a, u in zip(model.bodies, rigid.bodies, strict=True)]
    tip = relative_pose(model.tool, links[-1] @ rigid.tool)
    q = random_joints(vjm)
    names = [robot_chain.bodies[k].name for k in (0, *robot_chain.moving, -1)]
    theirs = urdf_link_poses(
        robot_chain.file, robot_chain.text, [joint.name for joint in robot_chain.joints], names[-1], q
    )
    far = frame_distance(root @ theirs, tool_poses(vjm, q) @ tip)
    if not max(far) <= MAX_DIFFERENCE:
        problem = f"its tip is up to {1e3 * far[0]:.4g} mm and {1e3 * far[1]:.4g} mrad from the tool of"
        limits = f"{1e3 * MAX_DIFFERENCE:g} mm and mrad"
        why = "it is another robot, or has other joint zeros or signs"
        if re.match(BEGINS_NEW, robot_chain.text.encode()):
            why = "testbench export wrote it from scratch, with the geometry of a calibration"
        raise InputError(
            robot_chain.file, "", f"{problem} the nominal {vjm.arm.name}; expected {limits}: {why}"
        )
    exact = [
        onto_axis(link, theirs, ours, slide=slide)
        for link, theirs, ours, slide in zip(links[1:], axes, vjm.joint_axes, slides, strict=True)
    ]
    return UrdfFrames(
        names, root, (links[0], *exact), relative_pose(model.tool, exact[-1] @ rigid.tool)
    ), max(far)


def robot_origins(robot_chain: RobotChain, placed: UrdfFrames, geometry: Rigid) -> dict[str, Array]:
    """Compute the identified poses of the URDF's joints.

    Args:
        robot_chain: The robot's chain.
        placed: Places of its frames in the model.
        geometry: The identified geometry.

    Returns:
        Poses by the joints' names, (4, 4) [m].

    Raises:
        InputError: If the tool has moved and no fixed joint carries it.
    """
    poses: dict[str, Array] = {}
    cuts = [1, *(k + 1 for k in robot_chain.moving)]
    for i, step in enumerate(geometry.steps):
        fixed = in_order([body.pose for body in robot_chain.bodies[cuts[i] : cuts[i + 1] - 1]])
        wanted = relative_pose(placed.links[i], step @ placed.links[i + 1])
        poses[robot_chain.names[cuts[i + 1] - 1]] = relative_pose(fixed, wanted)
    behind = robot_chain.bodies[cuts[-1] :]
    have = in_order([body.pose for body in behind])
    wanted = relative_pose(placed.links[-1], geometry.tool @ placed.tip)
    moved = np.abs(have - wanted).max() > ROUNDING
    if moved and not behind:
        end = robot_chain.bodies[-1].name
        problem = f"expected a fixed joint that leads to {end!r}: the calibration moved the tool"
        raise InputError(robot_chain.file, "", problem)
    if moved:
        poses[robot_chain.names[cuts[-1]]] = wanted @ relative_pose(
            in_order([body.pose for body in behind[1:]]), np.eye(4)
        )
    return poses


def axis_lines(bodies: Sequence[Array], axes: Array, slides: Sequence[bool]) -> Array:
    """Compute the twists of the joints at q = 0 in the frame of the poses.

    Args:
        bodies: Poses of the joints' bodies, (4, 4) each [m].
        axes: Unit axes in these bodies, (n, 3) [1].
        slides: Which joints slide.

    Returns:
        Angular velocity, then velocity at the origin, (n, 6) [1, m].
    """
    found = []
    for pose, axis, slide in zip(bodies, axes, slides, strict=True):
        d = pose[:3, :3] @ axis
        found.append([*np.zeros(3), *d] if slide else [*d, *np.cross(pose[:3, 3], d)])
    return np.array(found)


def align_frames(theirs: Array, ours: Array) -> Array:
    """Fit the pose of their frame in ours so that their twists match ours, see `axis_lines`.

    The rotation is a least-squares fit (Kabsch 1976) of the axes' directions and of the distances between the
    lines; the translation is then linear. If the axes leave it undetermined, such as a base's height below
    parallel axes, it is the shortest one.

    Args:
        theirs: Twists in their frame, (n, 6).
        ours: Twists in ours, (n, 6).

    Returns:
        The pose, (4, 4) [m].
    """
    U, _, V = np.linalg.svd(ROUNDING * np.eye(3) + _vectors(ours).T @ _vectors(theirs))
    R = U @ np.diag([1, 1, np.linalg.det(U @ V)]) @ V
    turn, speed = theirs[:, :3] @ R.T, theirs[:, 3:] @ R.T
    J = np.vstack([-skew(w) for w in turn])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, np.linalg.lstsq(J, (ours[:, 3:] - speed).ravel(), rcond=UNTOLD)[0]
    return pose


def _vectors(lines: Array) -> Array:
    """Compute directions of axes, and common perpendiculars of every two turning ones, (k, 3) [1, m]."""
    turns = np.asarray(lines[:, :3].any(axis=1))
    d = np.where(turns[:, None], lines[:, :3], lines[:, 3:])
    points, ways = np.cross(d, lines[:, 3:]), []  # of the lines, nearest to the origin
    for i, j in combinations(np.nonzero(turns)[0].tolist(), 2):
        both, way = d[[i, j]], points[j] - points[i]
        ways.append(way - np.linalg.pinv(both, rcond=UNTOLD) @ (both @ way))
    return np.vstack([d, *ways])


def onto_axis(frame: Array, theirs: Array, ours: Array, *, slide: bool) -> Array:
    """Move a link's frame in the model's body so that its axis is exactly the model's.

    Args:
        frame: The link's frame, (4, 4) [m].
        theirs: Unit axis in the link, (3,) [1].
        ours: Unit axis in the body, (3,) [1].
        slide: Whether the joint slides: its axis then has a direction only.

    Returns:
        The moved frame, (4, 4) [m].
    """
    d = frame[:3, :3] @ theirs
    across = np.cross(d, ours)
    sine = float(np.linalg.norm(across))
    found = frame.copy()
    if sine > 0:
        found[:3, :3] = rotation_matrices(np.arctan2(sine, d @ ours) * across / sine) @ found[:3, :3]
    if not slide:
        found[:3, 3] = (ours @ found[:3, 3]) * ours
    return found
