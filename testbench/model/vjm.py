"""The virtual joint method on the kinematics of the rigid arm, Eq. (1) to (13), batched over runs.

`kinematics.py` gives joint placements and axes; from there every quantity is a product of arrays over all
runs at once. Without theta the virtual joints are at zero: the linear model of Eq. (5), (6) and (10) to (13).
Away from zero they serve the loaded stiffness of Eq. (7) in `load.py`.

Below are rotation vectors and the motion of the rigid tool, which `correct` uses for inverse kinematics, and
random poses within the joint limits, from which simulations and measurement plans draw.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from testbench.arm.folder import Arm
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, Mask, PoseError, check_array
from testbench.model.structure import Structure

# --- The virtual joint method on the kinematics of the rigid arm, batched over runs, Eq. (1) to (13) --------


class JointLawSet(Protocol):
    """Define the interface of an arm's joint laws: virtual joints in series with the joints' springs."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Name the kind of every joint law, (laws,)."""

    @property
    def joint_indices(self) -> Ids:
        """Return the index of the actuated joint that each joint law deflects, (laws,)."""

    def unit_deflections(self, chain: "ChainState", load_torques: Array) -> Array:
        """Compute the deflection that every joint law adds to its joint, per unit of the law's size.

        Args:
            chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.
            load_torques: Torques of the load at the actuated joints, (n, runs) [N m, N].

        Returns:
            Deflection per unit of size, (laws, runs) [rad, m].
        """

    def unit_slopes(self, chain: "ChainState", load_torques: Array) -> Array:
        """Compute the derivative of the laws' deflections with respect to the torque of their joint.

        Args:
            chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.
            load_torques: Torques of the load at the actuated joints, (n, runs) [N m, N].

        Returns:
            Deflection per unit of size and torque, (laws, runs) [rad/(N m), m/N].
        """


@dataclass(frozen=True, eq=False, repr=False)
class Vjm(Displayed):
    """Hold the kinematics of the extended chain, Eq. (1): base, joints, links with virtual joints, tool.

    The arm has n actuated joints and n + 1 elastic links. Virtual joints theta are ordered: six per link from
    the base on, three slides and three hinges in its beam frame; then one per actuated joint; then those of
    the joint laws.
    """

    arm: Arm  #: Description of the arm.
    base_pose: Array  #: Pose of the base link's body in the world, (4, 4) [1, m].
    joint_placements: Array  #: Pose of each joint's body in the body before it at q = 0, (n, 4, 4) [1, m].
    joint_axes: Array  #: Unit axis of each joint in its body, about or along which it moves, (n, 3) [1].
    tool_placement: Array  #: Pose of the tool in the last link's body, (4, 4) [1, m].
    load_point: Array  #: Load point in the tool's frame, (3,) [m].
    markers: Array  #: Marker positions in the tool's frame, (m, 3) [m].
    joint_laws: JointLawSet | None = None  #: Joint laws; None if all joints are linear springs.

    @property
    def n_theta(self) -> int:
        """Return the number of virtual joints, 7 n + 6 and one per joint law."""
        return self.arm.n_theta + (len(self.joint_laws.joint_indices) if self.joint_laws else 0)

    @property
    def joint_spring_slice(self) -> slice:
        """Return the slice of the virtual joints theta that holds the springs of the actuated joints."""
        return slice(6 * len(self.arm.links), self.arm.n_theta)

    def summary(self) -> dict[str, object]:
        """Summarise the model by the arm's name and its number of virtual joints."""
        return {"arm": self.arm.name, "virtual_joints": self.arm.n_theta}

    @cached_property
    def joint_axes_in_beam_frame(self) -> Array:
        """Compute the unit axis of each joint in the beam frame of the link before it, (n, 3) [1]."""
        frames = np.array([link.beam_axes for link in self.arm.links[:-1]]).reshape(-1, 3, 3)
        return np.asarray(
            np.einsum("jxb,jxy,jy->jb", frames, self.joint_placements[:, :3, :3], self.joint_axes)
        )

    @cached_property
    def body_offsets(self) -> Array:
        """Return vectors from each body to the next, base to tool, in the former's axes, (n + 1, 3) [m]."""
        return np.array([pose[:3, 3] for pose in (*self.joint_placements, self.tool_placement)])

    @property
    def reach(self) -> float:
        """Compute the stretched length from the first joint to the tool [m]; without joints, of the link."""
        lengths = np.linalg.norm(self.body_offsets, axis=1)
        return float(lengths[1:].sum() or lengths.sum())

    @cached_property
    def link_transforms(self) -> tuple[tuple[Array, Array, Array], ...]:
        """Precompute the constant transforms of every link, a tuple of three arrays per link.

        They are the beam axes as rows in the body's axes, (3, 3); the vector from the body's origin to the
        next body's, or to the tool, in the body's axes, (3,) [m]; and the rotation next body from beam frame,
        (3, 3).
        """
        poses = (*self.joint_placements, self.tool_placement)
        frames = [link.beam_axes for link in self.arm.links]
        return tuple((f.T, x[:3, 3], x[:3, :3].T @ f) for f, x in zip(frames, poses, strict=True))

    @cached_property
    def rodrigues_factors(self) -> tuple[Array, ...]:
        """Precompute the factors of Rodrigues' formula of every joint, (7, 3) each.

        Rows 0 to 2 are multiplied by sin(q), rows 3 to 5 by 1 - cos(q), and row 6 is the joint's axis. A
        slide uses the axis alone.
        """
        turns = [skew(axis) for axis in self.joint_axes]
        return tuple(
            np.vstack([W.T, (W @ W).T, axis]) for W, axis in zip(turns, self.joint_axes, strict=True)
        )


@dataclass(frozen=True)
class ChainState:
    """Hold the poses of all bodies and the Jacobian of the virtual joints in every run, in world axes."""

    #: Jacobian dg / d theta of Eq. (2) at the tool's origin, translation rows first, (6, n_theta, runs)
    #: [1, m]. Runs are last in all arrays of the hot path: every product is one long loop.
    J_theta: Array
    tool_position: Array  #: Tool position, (runs, 3) [m].
    tool_rotation: Array  #: Tool orientation, world from tool, (runs, 3, 3).
    #: Origin, (3, runs) [m], and axes, world from body, (3, 3, runs), of the links' bodies from the base on
    #: and of the tool, n + 2 of them.
    body_frames: tuple[tuple[Array, Array], ...]
    joint_laws: JointLawSet | None = None  #: Joint laws of the model; None for linear springs.

    def tool_points_in_world(self, points: Array) -> Array:
        """Transform points from the tool's frame to the world.

        Args:
            points: Points in the tool's frame, (k, 3) [m].

        Returns:
            Points in the world, (runs, k, 3) [m].
        """
        return transform_tool_points((self.tool_position, self.tool_rotation), points)


# --- Kinematics, Eq. (1) to (3) -----------------------------------------------------------------------------


def evaluate_chain(vjm: Vjm, q: Array, theta: Array | None = None) -> ChainState:
    """Evaluate the extended chain: tool pose X = g(q, theta) of Eq. (1) and (2), and J_theta = dg / d theta.

    Mathematics: `vjm-1`, `vjm-3`.

    Args:
        vjm: Kinematics of the extended chain.
        q: Actuated joints, (runs, n) [rad, m].
        theta: Virtual joint coordinates, (runs, n_theta) [m, rad]: per link its slides x, y, z and its hinges
            phi_x, phi_y, phi_z in the beam frame, then one per joint, then those of joint laws; None if all
            are zero.

    Returns:
        Pose, Jacobian and bodies of every run.

    Raises:
        BenchError: When an array has another shape or is not finite.
    """
    q = check_array(q, (None, vjm.arm.n_joints), "q [rad, m]")
    runs, n = len(q), vjm.arm.n_joints
    links = 6 * (n + 1)
    bent = (
        None
        if theta is None
        else add_law_deflections(vjm, check_array(theta, (runs, vjm.n_theta), "theta [m, rad]"))
    )
    moved = (q if bent is None else q + bent[:, links:]).T
    sine, less = np.sin(moved), 1 - np.cos(moved)
    J = np.zeros((6, vjm.n_theta, runs))
    of_links, of_joints = np.empty((3, n + 1, 1, runs)), np.empty((3, n, runs))  # where they turn about
    R = np.tile(vjm.base_pose[:3, :3, None], runs)  # world axis, body axis, run
    p = np.tile(vjm.base_pose[:3, 3:], runs)
    bodies = []
    for i, (frame, arm, behind) in enumerate(vjm.link_transforms):
        bodies.append((p, R))
        # the link's virtual joint sits at its end: slides move along the beam axes, hinges turn about them
        p = p + arm @ R
        beam = hinges = J[:3, 6 * i : 6 * i + 3] = frame @ R
        if bent is not None:
            p, hinges, beam = move_virtual_joint(p, beam, bent[:, 6 * i : 6 * i + 6])
        J[3:, 6 * i + 3 : 6 * i + 6] = hinges
        of_links[:, i, 0] = p
        R = behind @ beam
        if i < n:  # the actuated joint: R (1 + sin W + (1 - cos) W^2), or a way along its axis
            of = vjm.rodrigues_factors[i] @ R
            of_joints[:, i] = p
            if vjm.arm.joints[i].prismatic:
                J[:3, links + i] = of[:, 6]
                p = p + moved[i] * of[:, 6]
                continue
            J[3:, links + i] = of[:, 6]
            R = R + sine[i] * of[:, :3] + less[i] * of[:, 3:6]
    _add_lever_arms(J, p[:, None, None] - of_links, p[:, None] - of_joints)
    # a joint law turns with its joint: the same column
    if vjm.joint_laws is not None:
        J[:, links + n :] = J[:, links + vjm.joint_laws.joint_indices]
    return ChainState(J, p.T, R.transpose(2, 0, 1), (*bodies, (p, R)), vjm.joint_laws)


def _add_lever_arms(J: Array, from_links: Array, from_joints: Array) -> None:
    """Add the motion of the tool's origin by all hinges, v = omega x (p - place of the hinge), in place.

    J is (6, n_theta, runs). The vectors lead to the origin from the hinges of links, (3, n + 1, 1, runs) [m],
    and of joints, (3, n, runs) [m].
    """
    n, runs = from_joints.shape[1:]
    links = 6 * (n + 1)
    turning = J[:, :links].reshape(6, n + 1, 6, runs)[:, :, 3:]
    turning[:3] = cross(turning[3:], from_links)
    joints = J[:, links : links + n]
    joints[:3] += cross(joints[3:], from_joints)


def add_law_deflections(vjm: Vjm, theta: Array) -> Array:
    """Add the deflections of joint laws to the virtual joint coordinates of their joints.

    Args:
        vjm: Kinematics, with or without laws.
        theta: Virtual joint coordinates, (runs, n_theta) [m, rad].

    Returns:
        Coordinates of links and joints, (runs, 7 n + 6) [m, rad].
    """
    if vjm.joint_laws is None:
        return theta
    plain, links = theta[:, : vjm.arm.n_theta].copy(), 6 * len(vjm.arm.links)
    np.add.at(plain.T, links + vjm.joint_laws.joint_indices, theta[:, vjm.arm.n_theta :].T)
    return plain


def tool_poses(vjm: Vjm, q: Array) -> tuple[Array, Array]:
    """Compute poses of the tool of the rigid arm.

    Args:
        vjm: Kinematics of the arm.
        q: Actuated joints, (runs, n) [rad, m].

    Returns:
        Positions, world, (runs, 3) [m], and orientations, world from tool, (runs, 3, 3) [1].

    Raises:
        BenchError: When q has another shape or is not finite.
    """
    return body_poses(vjm, q)[-1]


def tool_points(vjm: Vjm, q: Array, points: Array) -> Array:
    """Compute world positions of points of the tool, with the arm rigid.

    Args:
        vjm: Kinematics of the arm.
        q: Actuated joints, (runs, n) [rad, m].
        points: Points in the tool's frame, (k, 3) [m].

    Returns:
        Points in the world, (runs, k, 3) [m].

    Raises:
        BenchError: When q has another shape or is not finite.
    """
    return transform_tool_points(tool_poses(vjm, q), points)


def transform_tool_points(tool_pose: tuple[Array, Array], points: Array) -> Array:
    """Compute world positions of points of the tool from the tool's poses.

    Args:
        tool_pose: Tool positions, world, (runs, 3) [m], and orientations, world from tool, (runs, 3, 3) [1].
        points: Points in the tool's frame, (k, 3) [m].

    Returns:
        Points in the world, (runs, k, 3) [m].
    """
    position, rotation = tool_pose
    return np.asarray(position[:, None] + points @ rotation.transpose(0, 2, 1))


def marker_positions(vjm: Vjm, names: tuple[str, ...]) -> Array:
    """Return the positions of named markers in the tool's frame.

    Args:
        vjm: Kinematics of the arm.
        names: Names of the markers, m.

    Returns:
        Marker positions, (m, 3) [m], in the order of the names.

    Raises:
        BenchError: When the arm has no marker of that name.
    """
    have = vjm.arm.markers
    for name in names:
        if name not in have:
            raise BenchError(f"no marker {name!r} in {vjm.arm.name}; markers are {', '.join(have)}")
    return vjm.markers[[have.index(name) for name in names]]


def body_poses(vjm: Vjm, q: Array) -> list[tuple[Array, Array]]:
    """Compute poses of all links' bodies, from the base on, and of the tool, with the arm rigid.

    Args:
        vjm: Kinematics of the arm.
        q: Actuated joints, (runs, n) [rad, m].

    Returns:
        n + 2 pairs of origins, world, (runs, 3) [m], and orientations, world from body, (runs, 3, 3) [1].

    Raises:
        BenchError: When q has another shape or is not finite.
    """
    q = check_array(q, (None, vjm.arm.n_joints), "q [rad, m]")
    R = np.tile(vjm.base_pose[:3, :3, None], len(q))
    p = np.tile(vjm.base_pose[:3, 3:], len(q))
    bodies = [(p, R)]
    steps = zip(vjm.arm.joints, vjm.joint_placements, vjm.rodrigues_factors, q.T, strict=True)
    for joint, placement, factors, moved in steps:
        p = p + placement[:3, 3] @ R
        R = placement[:3, :3].T @ R
        of = factors @ R
        if joint.prismatic:
            p = p + moved * of[:, 6]
        else:
            R = R + np.sin(moved) * of[:, :3] + (1 - np.cos(moved)) * of[:, 3:6]
        bodies.append((p, R))
    bodies.append((p + vjm.tool_placement[:3, 3] @ R, vjm.tool_placement[:3, :3].T @ R))
    return [(p.T, R.transpose(2, 0, 1)) for p, R in bodies]


# --- Rotations of frames ------------------------------------------------------------------------------------


def move_virtual_joint(position: Array, beam_axes: Array, theta: Array) -> tuple[Array, Array, Array]:
    """Move a link's virtual joint away from zero: slides x, y, z, then hinges x, y, z in series.

    Mathematics: `vjm-2`.

    Args:
        position: World position of the virtual joint, (3, runs) [m].
        beam_axes: Beam frame, world from beam, (3, 3, runs) [1].
        theta: Coordinates of this link, (runs, 6) [m, rad].

    Returns:
        Position behind the slides, (3, runs) [m]; axes of the hinges in the world as columns, (3, 3, runs)
        [1]; and the beam frame behind the hinges, world from beam, (3, 3, runs) [1].
    """
    position = position + np.einsum("xbr,rb->xr", beam_axes, theta[:, :3])
    hinges = np.empty_like(beam_axes)
    beam_axes = beam_axes.copy()
    sine = np.sin(theta[:, 3:])
    cosine = np.cos(theta[:, 3:])
    for k in range(3):
        s = sine[:, k]
        c = cosine[:, k]
        y = (k + 1) % 3
        z = (k + 2) % 3
        hinges[:, k] = beam_axes[:, k]
        beam_axes[:, y], beam_axes[:, z] = (
            c * beam_axes[:, y] + s * beam_axes[:, z],
            c * beam_axes[:, z] - s * beam_axes[:, y],
        )
    return position, hinges, beam_axes


def skew(vectors: Array) -> Array:
    """Build the matrices W of vector products, W x = v x x, (..., 3, 3), of vectors v, (..., 3).

    Row k of W is the k-th unit axis times v.
    """
    W = np.zeros((*vectors.shape, 3))
    for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        W[..., x, y], W[..., x, z] = -vectors[..., z], vectors[..., y]
    return W


def rigid_motion_matrix(points: Array) -> Array:
    """Compute G with dp = G @ twist: how points of a rigid tool move with the tool, in the tool's frame.

    Mathematics: `vjm-4`.

    Args:
        points: Points in the tool's frame, (m, 3) [m].

    Returns:
        G, three rows per point, (3 m, 6) [1, m]; the twist is translation, then rotation.
    """
    turns = np.array([skew(point).T for point in points])
    return np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2).reshape(-1, 6)


def cross(a: Array, b: Array) -> Array:
    """Compute vector products along the first axis; np.cross is four times slower there.

    Args:
        a: First vectors, (3, ...).
        b: Second vectors, (3, ...), which broadcast with the first.

    Returns:
        a x b, (3, ...).
    """
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


# --- Loads, Eq. (3), and the observation matrix, Eq. (12) ---------------------------------------------------


def translational_jacobian(chain: ChainState, points: Array) -> Array:
    """Compute the translational rows J_p of J_theta at points fixed to the tool.

    Mathematics: `vjm-4`.

    Args:
        chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.
        points: Points in the tool's frame, (p, 3) [m].

    Returns:
        J_p, world axes, three rows per point, (3 p, n_theta, runs) [1, m].
    """
    v, omega = chain.J_theta[:3], chain.J_theta[3:]
    arms = [(chain.tool_rotation @ point).T[:, None] for point in points]
    return np.concatenate([v + cross(omega, arm) for arm in arms])


def generalised_load(chain: ChainState, wrench: Array, point: Array) -> Array:
    """Compute the load J_F^T w of every virtual joint, Eq. (10), J_F the Jacobian where the wrench acts.

    Args:
        chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Where the wrench acts, in the tool's frame, (runs, 3) [m].

    Returns:
        Load of links and joints [N, N m], then the deflection per unit of size of joint laws [rad, m],
        (n_theta, runs).

    Raises:
        BenchError: When an array has another shape or is not finite.
    """
    return append_law_unit_deflections(chain, generalised_load_without_laws(chain, wrench, point))


def generalised_load_without_laws(chain: ChainState, wrench: Array, point: Array) -> Array:
    """Compute the load J_F^T w of the virtual joints of links and joints, joint laws left out.

    Mathematics: `obs-7`, `vjm-5`.

    Args:
        chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Where the wrench acts, in the tool's frame, (runs, 3) [m].

    Returns:
        Generalised loads, (7 n + 6, runs) [N, N m].

    Raises:
        BenchError: When an array has another shape or is not finite.
    """
    runs, plain = len(chain.tool_position), 7 * len(chain.body_frames) - 8
    wrench = check_array(wrench, (runs, 6), "wrench [N, N m]")
    point = check_array(point, (runs, 3), "point [m]")
    # the wrench moved to the tool's origin, then J_theta^T w
    force, arm = wrench[:, :3].T, np.einsum("rxy,ry->xr", chain.tool_rotation, point)
    at_tool = np.concatenate([force, wrench[:, 3:].T + cross(arm, force)])
    return np.asarray(np.einsum("xtr,xr->tr", chain.J_theta[:, :plain], at_tool))


def append_law_unit_deflections(chain: ChainState, loads_without_laws: Array) -> Array:
    """Append the deflections of joint laws, per unit of size, to the generalised loads of links and joints.

    Args:
        chain: Chain in every run, from `evaluate_chain`, with the joint laws of the model.
        loads_without_laws: Generalised loads of links and joints, (7 n + 6, runs) [N, N m].

    Returns:
        Generalised loads, then the deflection per unit of size of every joint law, (n_theta, runs) [N, N m;
        rad, m for laws]; `loads_without_laws` itself without joint laws.
    """
    if chain.joint_laws is None:
        return loads_without_laws
    return np.concatenate(
        [
            loads_without_laws,
            chain.joint_laws.unit_deflections(chain, loads_without_laws[6 * (len(chain.body_frames) - 1) :]),
        ]
    )


def observation_matrix(
    chain: ChainState, structure: Structure, wrench: Array, point: Array, targets: Array
) -> Array:
    """Compute the observation matrix A of Eq. (12), so that the deflection of Eq. (11) is A @ pi.

    Mathematics: `obs-1`.

    Args:
        chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.
        structure: Structure of the unknowns, n_par of them.
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Where the wrench acts, in the tool's frame, (runs, 3) [m].
        targets: Points that are read, in the tool's frame, (m, 3) [m].

    Returns:
        A, world axes, (runs, m, 3, n_par) [m per unit of pi].

    Raises:
        BenchError: When an array has another shape or is not finite, or the structure is of another arm.
    """
    targets = check_array(targets, (None, 3), "targets [m]")
    J, u = translational_jacobian(chain, targets), generalised_load(chain, wrench, point)
    A = np.stack([*observation_rows(structure, J, u)])
    return A.reshape(-1, 3, structure.n_parameters, A.shape[-1]).transpose(3, 0, 1, 2)


def observation_rows(
    structure: Structure, reading_jacobian: Array, generalised_loads: Array
) -> Iterator[Array]:
    """Compute the observation matrix of readings that are linear in the virtual joints, Eq. (12), row by row.

    A row is linear in the load u = J_F^T w. The parameter C_theta[a, b] moves the reading by J[a] u[b] + J[b]
    u[a]; the second term is absent on the diagonal, and where C_theta[b, a] is another parameter or zero.

    Mathematics: `obs-1`.

    Args:
        structure: Structure of the unknowns, n_par of them.
        reading_jacobian: Readings per unit of each virtual joint, (rows, n_theta, runs).
        generalised_loads: Generalised load of each virtual joint, (n_theta, runs) [N, N m; rad, m for laws].

    Yields:
        One row of every run, (n_par, runs): transposed for LAPACK.

    Raises:
        BenchError: When the structure is of another arm.
    """
    if structure.n_theta != len(generalised_loads):
        raise BenchError(
            f"structure {structure.name}: expected {len(generalised_loads)} virtual joints, "
            f"got {structure.n_theta}"
        )
    a, b = structure.rows, structure.columns
    u_b, u_a = generalised_loads[b], generalised_loads[a] * structure.fills_two_entries[:, None]
    for row in reading_jacobian:
        yield row[a] * u_b + row[b] * u_a


# --- Rigid tool motion and rotation vectors -----------------------------------------------------------------


def rotation_vectors_between(start: Array, end: Array) -> Array:
    """Compute rotation vectors that take orientations to others, log(R_end R_start^T).

    Args:
        start: First orientations, world from tool, (points, 3, 3) [1].
        end: Second orientations, world from tool, (points, 3, 3) [1].

    Returns:
        Rotation vectors, world axes, (points, 3) [rad]; zero for a rotation by exactly 180 degrees, whose
        axis the formula loses.
    """
    R = end @ start.swapaxes(1, 2)
    sine = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    return _vectors(sine, (np.trace(R, axis1=1, axis2=2) - 1) / 2)


def rotation_matrices(rotation_vectors: Array) -> Array:
    """Compute rotation matrices exp([r]_x) of rotation vectors by Rodrigues' formula.

    Args:
        rotation_vectors: Rotation vectors r, (..., 3) [rad].

    Returns:
        Rotation matrices, (..., 3, 3) [1].
    """
    angle = np.linalg.norm(rotation_vectors, axis=-1)[..., None, None]
    K = skew(rotation_vectors)
    half = np.sinc(angle / (2 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + half**2 / 2 * K @ K)


def rotation_vectors_between_axes(start: Array, end: Array) -> Array:
    """Compute rotation vectors of the shortest rotations that take unit vectors to others.

    Args:
        start: First unit vectors, (points, 3) [1].
        end: Second unit vectors, (points, 3) [1].

    Returns:
        Rotation vectors, (points, 3) [rad]; zero for opposite vectors, whose axis is undefined.
    """
    return _vectors(np.cross(start, end), np.einsum("px,px->p", start, end))


def _vectors(sine: Array, cosine: Array) -> Array:
    """Compute rotation vectors from axes times sines, (points, 3), and cosines, (points,)."""
    size = np.linalg.norm(sine, axis=1)
    angle = np.arctan2(size, cosine)
    return np.asarray(sine * np.where(size > 0, angle / np.where(size > 0, size, 1), 1)[:, None])


# --- Random poses inside the joint limits -------------------------------------------------------------------

POSES_PER_BATCH = 4096  #: Poses drawn at a time.
POSES_PER_CHECK = 512  #: Poses checked at a time; drawing stops with the check that completes the count.
MAX_POSE_BATCHES = 400  #: Batches drawn before the search is given up.


@dataclass(frozen=True)
class WorkArea:
    """Describe the box in which the tool must be, and the cone in which its x axis must point."""

    lower: tuple[float, float, float]  #: Lower corner of the tool's position, world, (3,) [m].
    upper: tuple[float, float, float]  #: Upper corner, (3,) [m].
    #: Axis of the cone, world, unit vector, (3,) [1].
    cone_axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    cone_half_angle: float = np.pi  #: Largest angle between the tool's x axis and that axis [rad].


def in_work_area(vjm: Vjm, work_area: WorkArea, q: Array) -> Mask:
    """Tell which poses have their tool in a work area, with the arm rigid.

    Args:
        vjm: Kinematics of the arm.
        work_area: The work area.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        True where the tool is inside the box and its x axis inside the cone, (poses,).

    Raises:
        BenchError: When q has another shape or is not finite.
    """
    position, rotation = tool_poses(vjm, q)
    inside = ((position >= work_area.lower) & (position <= work_area.upper)).all(axis=1)
    cosine = rotation[:, :, 0] @ np.array(work_area.cone_axis)
    return np.asarray(inside & (cosine >= np.cos(work_area.cone_half_angle)))


def random_poses(
    vjm: Vjm,
    work_area: WorkArea | None,
    count: int,
    is_collision_free: Callable[[Array], Mask],
    rng: np.random.Generator,
) -> Array:
    """Draw random poses within the joint limits, in a work area and free of collisions.

    Args:
        vjm: Nominal kinematics of the arm.
        work_area: Where the tool must be; None for anywhere.
        count: Number of poses to return.
        is_collision_free: Function that tells which poses, (poses, n) [rad, m], are free of collision,
            (poses,).
        rng: Random number generator.

    Returns:
        Actuated joints, (count, n) [rad, m], in the order in which they were drawn.

    Raises:
        PoseError: When `MAX_POSE_BATCHES` times `POSES_PER_BATCH` draws yield too few; the message counts
            what each condition left.
    """
    kept: list[Array] = []
    drawn = reached = 0
    for _ in range(MAX_POSE_BATCHES):
        q = vjm.arm.draw_poses(rng, POSES_PER_BATCH)
        drawn += len(q)
        for piece in np.split(q, range(POSES_PER_CHECK, POSES_PER_BATCH, POSES_PER_CHECK)):
            inside = piece if work_area is None else piece[in_work_area(vjm, work_area, piece)]
            reached += len(inside)
            kept.extend(inside[is_collision_free(inside)])
            if len(kept) >= count:
                return np.array(kept[:count])
    raise PoseError(
        f"found {len(kept)} of {count} poses: of {drawn} drawn {reached} put the tool in the work area "
        f"and {len(kept)} are clear of collision; widen the area"
    )
