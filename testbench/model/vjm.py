"""The model side: the virtual joint method on Pinocchio's kinematics of the rigid arm, batched over runs.

`kinematics.py` has joint placements and axes; from there on every quantity is a product of arrays over all
runs at once. Where nothing else is said virtual joints are at zero: the model is linear (Eq. 5-6,
10-13). Away from zero they serve the loaded stiffness of Eq. (7), `loaded.py`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from testbench.arm.folder import Arm
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, check_array
from testbench.model.structure import Structure


class Laws(Protocol):
    """What joints do beyond a linear spring: virtual joints in series with each joint's own (`laws.py`)."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """What each does, (laws,)."""

    @property
    def joints(self) -> Ids:
        """Joint that each turns with, (laws,)."""

    def load(self, where: "Chain", u: Array) -> Array:
        """Turn of each per unit of its size, (laws, runs) [rad, m], under torques u, (n, runs)."""

    def slope(self, where: "Chain", u: Array) -> Array:
        """Change of these with the torques, (laws, runs) [rad/(N m), m/N]."""


@dataclass(frozen=True, eq=False, repr=False)
class Vjm(Displayed):
    """Kinematics of the extended chain."""

    arm: Arm  #: Its description.
    base: Array  #: Pose of the base link's body in the world, (4, 4).
    placements: Array  #: Pose of each joint's body in the body before it at q = 0, (n, 4, 4).
    axes: Array  #: Unit axis of each joint in its body, about or along which it moves, (n, 3).
    tool: Array  #: Pose of the tool in the last link's body, (4, 4) [m].
    load: Array  #: Load point in the tool's frame, (3,) [m].
    markers: Array  #: Marker positions in the tool's frame, (m, 3) [m].
    laws: Laws | None = None  #: What joints do beyond a linear spring; None for nothing.

    @property
    def n_theta(self) -> int:
        """Number of virtual joints, those of the laws last."""
        return self.arm.n_theta + (len(self.laws.joints) if self.laws else 0)

    @property
    def own(self) -> slice:
        """Where the virtual joints of joints are among all."""
        return slice(6 * len(self.arm.links), self.arm.n_theta)

    def about(self) -> dict[str, object]:
        """The arm, and how many virtual joints it has."""
        return {"arm": self.arm.name, "virtual_joints": self.arm.n_theta}

    @cached_property
    def beam_axes(self) -> Array:
        """Unit axis of each joint in the beam frame of the link before it, (n, 3)."""
        frames = np.array([link.frame for link in self.arm.links[:-1]]).reshape(-1, 3, 3)
        return np.asarray(np.einsum("jxb,jxy,jy->jb", frames, self.placements[:, :3, :3], self.axes))

    @cached_property
    def steps(self) -> Array:
        """From each joint to the next one, to the tool at last, in the link's axes, (n + 1, 3) [m]."""
        return np.array([pose[:3, 3] for pose in (*self.placements, self.tool)])

    @property
    def reach(self) -> float:
        """Stretched length from the first joint to the tool; of an arm without joints, of its link [m]."""
        lengths = np.linalg.norm(self.steps, axis=1)
        return float(lengths[1:].sum() or lengths.sum())

    @cached_property
    def links(self) -> tuple[tuple[Array, Array, Array], ...]:
        """Of every link its beam axes in those of its body, (3, 3), the arm to the next body, (3,) [m].

        Last the axes of that body in the beam's, (3, 3).
        """
        poses = (*self.placements, self.tool)
        frames = [link.frame for link in self.arm.links]
        return tuple((f.T, x[:3, 3], x[:3, :3].T @ f) for f, x in zip(frames, poses, strict=True))

    @cached_property
    def joints(self) -> tuple[Array, ...]:
        """Of every hinge what turns with the sine, what with one less the cosine, and its axis, (7, 3).

        All are products with the axes of its body (Rodrigues). Of a slide the axis alone counts.
        """
        turns = [skew(axis) for axis in self.axes]
        return tuple(np.vstack([W.T, (W @ W).T, axis]) for W, axis in zip(turns, self.axes, strict=True))


@dataclass(frozen=True)
class Chain:
    """Where the tool of every run is, and how the virtual joints move it, in world axes."""

    #: Jacobian of the virtual joints at the tool's origin, Eq. (3), (6, n_theta, runs) [1, m]. Runs are last
    #: in all arrays of the hot path: every product is one long loop.
    J_theta: Array
    position: Array  #: Tool position, (runs, 3) [m].
    rotation: Array  #: Tool orientation, world from tool, (runs, 3, 3).
    #: Of the links' bodies from the base on and of the tool: origin, (3, runs) [m], and axes, (3, 3, runs).
    bodies: tuple[tuple[Array, Array], ...]
    laws: Laws | None = None  #: As of the model.

    def points(self, points: Array) -> Array:
        """Points of the tool's frame, (k, 3) [m], in the world, (runs, k, 3) [m]."""
        return on_tool((self.position, self.rotation), points)


def chain(vjm: Vjm, q: Array, theta: Array | None = None) -> Chain:
    """Tool and virtual joints of every run, Eq. (1) and (3).

    Args:
        vjm: The model.
        q: Actuated joints, (runs, n) [rad, m].
        theta: Virtual joint coordinates, (runs, n_theta) [m, rad]: of each link its slides x, y, z and its
            hinges phi_x, phi_y, phi_z in the beam frame, then one a joint; None for zero.
    """
    q = check_array(q, (None, vjm.arm.n_joints), "q [rad, m]")
    runs, n = len(q), vjm.arm.n_joints
    links = 6 * (n + 1)
    bent = None if theta is None else turns(vjm, check_array(theta, (runs, vjm.n_theta), "theta [m, rad]"))
    moved = (q if bent is None else q + bent[:, links:]).T
    sine, less = np.sin(moved), 1 - np.cos(moved)
    J = np.zeros((6, vjm.n_theta, runs))
    of_links, of_joints = np.empty((3, n + 1, 1, runs)), np.empty((3, n, runs))  # where they turn about
    R = np.tile(vjm.base[:3, :3, None], runs)  # world axis, body axis, run
    p = np.tile(vjm.base[:3, 3:], runs)
    bodies = []
    for i, (frame, arm, behind) in enumerate(vjm.links):
        bodies.append((p, R))
        p = p + arm @ R
        beam = hinges = J[:3, 6 * i : 6 * i + 3] = frame @ R
        if bent is not None:
            p, hinges, beam = bend(p, beam, bent[:, 6 * i : 6 * i + 6])
        J[3:, 6 * i + 3 : 6 * i + 6] = hinges
        of_links[:, i, 0] = p
        R = behind @ beam
        if i < n:
            of = vjm.joints[i] @ R
            of_joints[:, i] = p
            if vjm.arm.joints[i].prismatic:
                J[:3, links + i] = of[:, 6]
                p = p + moved[i] * of[:, 6]
                continue
            J[3:, links + i] = of[:, 6]
            R = R + sine[i] * of[:, :3] + less[i] * of[:, 3:6]
    turning = J[:, :links].reshape(6, n + 1, 6, runs)[:, :, 3:]
    turning[:3] = cross(turning[3:], p[:, None, None] - of_links)
    joints = J[:, links : links + n]
    joints[:3] += cross(joints[3:], p[:, None] - of_joints)
    if vjm.laws is not None:
        J[:, links + n :] = J[:, links + vjm.laws.joints]
    return Chain(J, p.T, R.transpose(2, 0, 1), (*bodies, (p, R)), vjm.laws)


def turns(vjm: Vjm, theta: Array) -> Array:
    """Coordinates of links and joints, (runs, 7 n + 6), the turns of laws added to those of their joints."""
    if vjm.laws is None:
        return theta
    plain, links = theta[:, : vjm.arm.n_theta].copy(), 6 * len(vjm.arm.links)
    np.add.at(plain.T, links + vjm.laws.joints, theta[:, vjm.arm.n_theta :].T)
    return plain


def tool_pose(vjm: Vjm, q: Array) -> tuple[Array, Array]:
    """Tool positions, (runs, 3) [m], and orientations, world from tool, (runs, 3, 3), as of `chain`."""
    return body_poses(vjm, q)[-1]


def tool_points(vjm: Vjm, q: Array, points: Array) -> Array:
    """Points of the tool's frame, (k, 3) [m], in the world, the arm rigid, (runs, k, 3) [m]."""
    return on_tool(tool_pose(vjm, q), points)


def on_tool(pose: tuple[Array, Array], points: Array) -> Array:
    """The same of tool positions, (runs, 3) [m], and orientations, (runs, 3, 3)."""
    position, rotation = pose
    return np.asarray(position[:, None] + points @ rotation.transpose(0, 2, 1))


def marker_points(vjm: Vjm, names: tuple[str, ...]) -> Array:
    """Positions of these markers in the tool's frame, (m, 3) [m]; BenchError when the arm lacks one."""
    have = vjm.arm.markers
    for name in names:
        if name not in have:
            raise BenchError(f"no marker {name!r} in {vjm.arm.name}; markers are {', '.join(have)}")
    return vjm.markers[[have.index(name) for name in names]]


def body_poses(vjm: Vjm, q: Array) -> list[tuple[Array, Array]]:
    """Poses of the links' bodies from the base on and of the tool, each as of `tool_pose`, theta zero."""
    q = check_array(q, (None, vjm.arm.n_joints), "q [rad, m]")
    R = np.tile(vjm.base[:3, :3, None], len(q))
    p = np.tile(vjm.base[:3, 3:], len(q))
    bodies = [(p, R)]
    for joint, placement, axis, moved in zip(vjm.arm.joints, vjm.placements, vjm.axes, q.T, strict=True):
        p = p + placement[:3, 3] @ R
        R = placement[:3, :3].T @ R
        if joint.prismatic:
            p = p + moved * (axis @ R)
        else:
            R = turn(R, axis, moved)
        bodies.append((p, R))
    bodies.append((p + vjm.tool[:3, 3] @ R, vjm.tool[:3, :3].T @ R))
    return [(p.T, R.transpose(2, 0, 1)) for p, R in bodies]


def bend(p: Array, beam: Array, theta: Array) -> tuple[Array, Array, Array]:
    """A link's virtual joint away from zero: three slides, then three hinges, each carried by those before.

    Args:
        p: World position of the virtual joint, (3, runs) [m].
        beam: World from beam, (3, 3, runs).
        theta: Of this link, (runs, 6) [m, rad].

    Returns:
        Position behind the slides, axes of the hinges in the world as columns, beam behind the hinges.
    """
    p = p + np.einsum("xbr,rb->xr", beam, theta[:, :3])
    beam, hinges, sine, cosine = beam.copy(), np.empty_like(beam), np.sin(theta[:, 3:]), np.cos(theta[:, 3:])
    for k in range(3):
        s, c, y, z = sine[:, k], cosine[:, k], (k + 1) % 3, (k + 2) % 3
        hinges[:, k] = beam[:, k]
        beam[:, y], beam[:, z] = c * beam[:, y] + s * beam[:, z], c * beam[:, z] - s * beam[:, y]
    return p, hinges, beam


def turn(R: Array, axis: Array, angle: Array) -> Array:
    """Frames turned about an axis of their own (Rodrigues), (3, 3, runs).

    Args:
        R: World from body, (3, 3, runs).
        axis: Unit axis in the body, (3,).
        angle: Angles, (runs,) [rad].
    """
    W = skew(axis)
    return np.asarray(R + np.sin(angle) * (W.T @ R) + (1 - np.cos(angle)) * ((W @ W).T @ R))


def rotation(axis: Array, angle: float) -> Array:
    """Turn by an angle [rad] about a unit axis (Rodrigues), (3, 3)."""
    W = skew(axis)
    return np.asarray(np.eye(3) + np.sin(angle) * W + (1 - np.cos(angle)) * W @ W)


def skew(vectors: Array) -> Array:
    """Return W with W v = vectors x v, (..., 3, 3), of (..., 3); its rows are the axes times vectors."""
    W = np.zeros((*vectors.shape, 3))
    for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        W[..., x, y], W[..., x, z] = -vectors[..., z], vectors[..., y]
    return W


def cross(a: Array, b: Array) -> Array:
    """Vector products along the first axis; np.cross is four times slower there."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def translation_rows(where: Chain, points: Array) -> Array:
    """Translational rows of J_theta at points fixed in the tool, world axes, (3 p, n_theta, runs) [1, m]."""
    v, omega = where.J_theta[:3], where.J_theta[3:]
    arms = [(where.rotation @ point).T[:, None] for point in points]
    return np.concatenate([v + cross(omega, arm) for arm in arms])


def generalised_load(where: Chain, wrench: Array, point: Array) -> Array:
    """Load J_F^T w of every virtual joint, (n_theta, runs) [N, N m]; of laws what turns per unit of size."""
    return with_laws(where, plain_load(where, wrench, point))


def plain_load(where: Chain, wrench: Array, point: Array) -> Array:
    """Load J_F^T w of the virtual joints of links and joints, (7 n + 6, runs) [N, N m]."""
    runs, plain = len(where.position), 7 * len(where.bodies) - 8
    wrench = check_array(wrench, (runs, 6), "wrench [N, N m]")
    point = check_array(point, (runs, 3), "point [m]")
    force, arm = wrench[:, :3].T, np.einsum("rxy,ry->xr", where.rotation, point)
    at_tool = np.concatenate([force, wrench[:, 3:].T + cross(arm, force)])
    return np.asarray(np.einsum("xtr,xr->tr", where.J_theta[:, :plain], at_tool))


def with_laws(where: Chain, u: Array) -> Array:
    """Loads of all virtual joints, (n_theta, runs), from those of links and joints, (7 n + 6, runs)."""
    if where.laws is None:
        return u
    return np.concatenate([u, where.laws.load(where, u[6 * (len(where.bodies) - 1) :])])


def observation(where: Chain, structure: Structure, wrench: Array, point: Array, targets: Array) -> Array:
    """Observation matrix A of Eq. (12), so that deflection = A @ pi, (runs, m, 3, n_par)."""
    targets = check_array(targets, (None, 3), "targets [m]")
    J, u = translation_rows(where, targets), generalised_load(where, wrench, point)
    A = np.stack([*parameter_rows(structure, J, u)])
    return A.reshape(-1, 3, structure.n, A.shape[-1]).transpose(3, 0, 1, 2)


def parameter_rows(structure: Structure, J: Array, u: Array) -> Iterator[Array]:
    """Observation matrix of readings that are linear in the virtual joints, Eq. (12), row by row.

    A row is linear in the load u = J_F^T w: the parameter C_theta[a, b] moves the reading by
    J[a] u[b] + J[b] u[a] (once on the diagonal, and where C_theta[b, a] is another one).

    Args:
        structure: The unknown entries, n_par of them.
        J: Readings per unit of each virtual joint, (rows, n_theta, runs).
        u: Load of each virtual joint, (n_theta, runs) [N, N m].

    Yields:
        One row of every run, (n_par, runs): the transpose of what LAPACK wants.

    Raises:
        BenchError: When the structure is of another arm.
    """
    if structure.n_theta != len(u):
        raise BenchError(
            f"structure {structure.name}: expected {len(u)} virtual joints, got {structure.n_theta}"
        )
    a, b = structure.a, structure.b
    u_b, u_a = u[b], u[a] * structure.mirrored[:, None]
    for row in J:
        yield row[a] * u_b + row[b] * u_a
