"""The model side: the virtual joint method on Pinocchio's reading of the rigid arm, batched over runs.

Pinocchio reads the MJCF into joint placements and axes; from there on every quantity is a product of arrays
over all runs at once. Virtual joints are at zero: the model is linear (Eq. 5-6, 10-13).
"""

import tempfile
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from testbench.arm import Arm
from testbench.errors import Array, BenchError, InputError, check_array
from testbench.mjcf import read_mjcf
from testbench.structure import Structure


@dataclass(frozen=True)
class Vjm:
    """Kinematics of the extended chain at theta = 0.

    Attributes:
        arm: Its description.
        base: Pose of the base link's body in the world, (4, 4).
        placements: Pose of each joint's body in the body before it at q = 0, (n, 4, 4).
        axes: Unit axis of each joint in its body, (n, 3).
        tool: Pose of the tool in the last link's body, (4, 4) [m].
        load: Load point in the tool's frame, (3,) [m].
        markers: Marker positions in the tool's frame, (m, 3) [m].
    """

    arm: Arm
    base: Array
    placements: Array
    axes: Array
    tool: Array
    load: Array
    markers: Array


@dataclass(frozen=True)
class Chain:
    """Where the virtual joints of every run are, in world axes.

    Attributes:
        origins: Origin of every link's virtual joint, then of every joint, (runs, 2 n + 1, 3) [m].
        translations: Translation per unit of each virtual joint about its own origin, (runs, 3, n_theta).
        rotations: Rotation per unit of each virtual joint, (runs, 3, n_theta).
        position: Tool position, (runs, 3) [m].
        rotation: Tool orientation, world from tool, (runs, 3, 3).
    """

    origins: Array
    translations: Array
    rotations: Array
    position: Array
    rotation: Array


def build_vjm(arm: Arm) -> Vjm:
    """Read the rigid arm with Pinocchio.

    Args:
        arm: The arm.

    Raises:
        InputError: When Pinocchio refuses the MJCF or reads another chain than the arm's.
    """
    model = _read_kinematics(arm)
    names = list(model.names)[1:]
    expected = [j.name for j in arm.joints]
    if names != expected:
        raise InputError(arm.rigid, "", f"expected the joints {expected}, Pinocchio reads {names}")
    data = model.createData()
    q0 = pin.neutral(model)
    pin.framesForwardKinematics(model, data, q0)

    def pose(body: str) -> pin.SE3:
        frame = model.getFrameId(body, pin.FrameType.BODY)
        if frame >= model.nframes:
            raise InputError(arm.rigid, f"<body name={body!r}>", "not found by Pinocchio")
        return data.oMf[frame]

    bodies = [pose(link.name) for link in arm.links]
    tool = pose(arm.tool)
    local = [tool.actInv(pose(name).translation) for name in (arm.load, *arm.markers)]
    axes = [pin.computeJointJacobian(model, data, q0, i + 1)[3:, i] for i in range(arm.n_joints)]
    return Vjm(
        arm=arm,
        base=bodies[0].homogeneous,
        placements=np.array(
            [a.actInv(b).homogeneous for a, b in zip(bodies, bodies[1:], strict=False)]
        ).reshape(-1, 4, 4),
        axes=np.array(axes).reshape(-1, 3),
        tool=bodies[-1].actInv(tool).homogeneous,
        load=local[0],
        markers=np.array(local[1:]),
    )


def _read_kinematics(arm: Arm) -> pin.Model:
    """Pinocchio's model of bodies and joints alone.

    Its reader wants an inertia in every body, even in a marker, and reads meshes that nobody asked for; so
    it is given the bodies and joints, and a negligible inertia in each.
    """
    root = read_mjcf(arm.rigid)
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag not in ("compiler", "worldbody", "body", "joint"):
                parent.remove(child)
    for body in root.iter("body"):
        ET.SubElement(body, "inertial", pos="0 0 0", mass="1e-9", diaginertia="1e-9 1e-9 1e-9")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "kinematics.xml"
        file.write_bytes(ET.tostring(root))
        try:
            return pin.buildModelFromMJCF(str(file))
        except (ValueError, RuntimeError) as err:
            problem = " ".join(str(err).split())
            raise InputError(arm.rigid, "", f"Pinocchio refuses it: {problem}") from err


def rotate(axis: Array, angle: Array) -> Array:
    """Rotation matrices about a fixed unit axis (Rodrigues), (runs, 3, 3).

    Args:
        axis: Unit axis, (3,).
        angle: Angles, (runs,) [rad].
    """
    x, y, z = axis
    W = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * W + (1 - c) * (W @ W)


def chain(vjm: Vjm, q: Array) -> Chain:
    """Virtual joints of every run, Eq. (1) at theta = 0.

    Args:
        vjm: The model.
        q: Actuated joint angles, (runs, n) [rad].
    """
    q = check_array(q, (None, vjm.arm.n_joints), "q [rad]")
    runs, n = len(q), vjm.arm.n_joints
    links = 6 * (n + 1)
    origins = np.empty((runs, 2 * n + 1, 3))
    translations = np.zeros((runs, 3, vjm.arm.n_theta))
    rotations = np.zeros((runs, 3, vjm.arm.n_theta))
    R = np.broadcast_to(vjm.base[:3, :3], (runs, 3, 3))
    p = np.broadcast_to(vjm.base[:3, 3], (runs, 3))
    for i, link in enumerate(vjm.arm.links):
        placement = vjm.placements[i] if i < n else vjm.tool
        p = p + R @ placement[:3, 3]
        beam = R @ link.frame
        origins[:, i] = p
        translations[:, :, 6 * i : 6 * i + 3] = beam
        rotations[:, :, 6 * i + 3 : 6 * i + 6] = beam
        if i < n:
            R = R @ placement[:3, :3]
            rotations[:, :, links + i] = R @ vjm.axes[i]
            R = R @ rotate(vjm.axes[i], q[:, i])
            origins[:, n + 1 + i] = p
    return Chain(origins, translations, rotations, p, R @ vjm.tool[:3, :3])


def owners(n_joints: int) -> Array:
    """Which origin of a Chain each virtual joint turns about, (n_theta,)."""
    return np.concatenate([np.repeat(np.arange(n_joints + 1), 6), n_joints + 1 + np.arange(n_joints)])


def translation_rows(where: Chain, n_joints: int, point: Array) -> Array:
    """Translational rows of J_theta at points fixed in the tool.

    Args:
        where: The chain of every run.
        n_joints: Number of actuated joints.
        point: Points in the tool's frame, (p, 3), or one for every run, (runs, 1, 3) [m].

    Returns:
        (runs, p, 3, n_theta) [1, m].
    """
    world = where.position[:, None] + point @ where.rotation.transpose(0, 2, 1)
    arms = (world[:, :, None] - where.origins[:, None])[:, :, owners(n_joints)]
    turn = np.cross(where.rotations.transpose(0, 2, 1)[:, None], arms)
    return where.translations[:, None] + turn.swapaxes(2, 3)


def jacobian(vjm: Vjm, q: Array, point: Array | None = None) -> Array:
    """Jacobian J_theta of the virtual joints at a point fixed in the tool, Eq. (3).

    Args:
        vjm: The model.
        q: Actuated joint angles, (runs, n) [rad].
        point: In the tool's frame, (3,) [m]; None for its origin.

    Returns:
        Translation rows first, world axes, (runs, 6, n_theta) [1, m].
    """
    at = np.zeros(3) if point is None else check_array(point, (3,), "point [m]")
    where = chain(vjm, q)
    moved = translation_rows(where, vjm.arm.n_joints, at[None])[:, 0]
    return np.concatenate([moved, where.rotations], axis=1)


def cartesian_compliance(J_theta: Array, C_theta: Array) -> Array:
    """Cartesian compliance of the arm, Eq. (6).

    Args:
        J_theta: Jacobian of the virtual joints, (..., 6, n_theta) [1, m].
        C_theta: Aggregated joint compliance, (n_theta, n_theta) [m/N, rad/(N m)].

    Returns:
        Compliance C with twist = C @ wrench, (..., 6, 6).
    """
    return np.asarray(J_theta @ C_theta @ J_theta.swapaxes(-1, -2))


def generalised_load(vjm: Vjm, where: Chain, wrench: Array, point: Array) -> Array:
    """Load J_F^T w of every virtual joint.

    Args:
        vjm: The model.
        where: The chain of every run.
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Where it acts, in the tool's frame, (runs, 3) [m].

    Returns:
        (runs, n_theta) [N, N m].
    """
    moved = translation_rows(where, vjm.arm.n_joints, point[:, None])[:, 0]
    force = np.einsum("rx,rxt->rt", wrench[:, :3], moved)
    return force + np.einsum("rx,rxt->rt", wrench[:, 3:], where.rotations)


def observation(
    vjm: Vjm,
    structure: Structure,
    q: Array,
    wrench: Array,
    point: Array,
    *,
    targets: Array,
    rotation: bool = False,
) -> Array:
    """Observation matrix A of Eq. (12), so that deflection = A @ pi.

    A row is linear in the load u = J_F^T w: the parameter C_theta[a, b] moves the target by
    J[:, a] u[b] + J[:, b] u[a] (once on the diagonal).

    Args:
        vjm: The model.
        structure: The unknown entries, n_par of them.
        q: Actuated joint angles, (runs, n) [rad].
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Where it acts, in the tool's frame, (runs, 3) [m].
        targets: Points whose deflection is read, in the tool's frame, (m, 3) [m].
        rotation: Rows of the tool's rotation instead of the targets' translation.

    Returns:
        (runs, m, 3, n_par); with rotation m is 1.

    Raises:
        BenchError: When an argument has the wrong shape or is not finite.
    """
    A = parameter_rows(vjm, structure, q, wrench, point, targets=targets, rotation=rotation)
    return A.transpose(3, 1, 2, 0)


def parameter_rows(
    vjm: Vjm,
    structure: Structure,
    q: Array,
    wrench: Array,
    point: Array,
    *,
    targets: Array,
    rotation: bool = False,
) -> Array:
    """The observation matrix of `observation` with runs innermost: (n_par, m, 3, runs).

    Contiguous over runs, and so the transpose that LAPACK wants: this is the hot path of large datasets.
    """
    where = chain(vjm, q)
    runs = len(where.position)
    wrench = check_array(wrench, (runs, 6), "wrench [N, N m]")
    point = check_array(point, (runs, 3), "point [m]")
    if structure.n_theta != vjm.arm.n_theta:
        raise BenchError(
            f"structure {structure.name}: expected {vjm.arm.n_theta} virtual joints, "
            f"got {structure.n_theta}"
        )
    u = np.ascontiguousarray(generalised_load(vjm, where, wrench, point).T)
    if rotation:
        J = where.rotations[:, None]
    else:
        J = translation_rows(where, vjm.arm.n_joints, check_array(targets, (None, 3), "targets [m]"))
    J = np.ascontiguousarray(J.transpose(3, 1, 2, 0))
    A = np.empty((structure.n, *J.shape[1:]))
    other = np.empty(J.shape[1:])
    for k, (a, b) in enumerate(zip(structure.a, structure.b, strict=True)):
        np.multiply(J[a], u[b], out=A[k])
        if a != b:
            np.multiply(J[b], u[a], out=other)
            A[k] += other
    return A
