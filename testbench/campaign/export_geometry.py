"""The identified geometry folded into the poses of the joints, and what a file cannot hold, by its size."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from testbench.errors import Array
from testbench.identify.absolute.state import LOAD_STEPS, State, equilibrium
from testbench.model.load import Load, weight
from testbench.model.vjm import Vjm, bend, chain, rotation

POSES = 1000  #: Random poses in which an export is looked at.


@dataclass(frozen=True)
class Rigid:
    """A rigid chain: base, then for every joint a step and a turn or slide, then the tool."""

    base: Array  #: Pose of the base link in the world, (4, 4) [m].
    steps: Array  #: Pose of each joint's body in the body before it at q = 0, (n, 4, 4) [m].
    tool: Array  #: Pose of the tool in the last body, (4, 4) [m].

    @property
    def bodies(self) -> list[Array]:
        """Poses of the links' bodies in the world at q = 0, (n + 1) of (4, 4) [m]."""
        found = [self.base]
        for step in self.steps:
            found.append(found[-1] @ step)
        return found


@dataclass(frozen=True)
class Frames:
    """Where a URDF's frames stand in the model; they are there for every q and every geometry."""

    names: Sequence[str]  #: Links of the URDF: the first, those behind the joints, the tip; n + 2.
    root: Array  #: The first link in the model's world, (4, 4) [m].
    links: Sequence[Array]  #: Links in the model's bodies, the base's first, (n + 1) of (4, 4) [m].
    tip: Array  #: The tip in the model's tool, (4, 4) [m].


def in_order(poses: Iterable[Array]) -> Array:
    """The product of poses, (4, 4) [m]."""
    return np.asarray(reduce(np.matmul, poses, np.eye(4)))


def within(frame: Array, pose: Array) -> Array:
    """A pose in a frame, both in a third, (4, 4) [m]."""
    back = frame[:3, :3].T
    return _pose(back @ pose[:3, :3], back @ (pose[:3, 3] - frame[:3, 3]))


def drawn(vjm: Vjm) -> Rigid:
    """The arm as drawn."""
    return Rigid(vjm.base, vjm.placements, vjm.tool)


def identified(state: State) -> Rigid:
    """The arm with its errors of geometry: `chain` at theta_0, for every q."""
    vjm, n = state.vjm, state.vjm.arm.n_joints
    links, offsets = state.theta_0[: 6 * n + 6].reshape(-1, 6), state.theta_0[6 * n + 6 :]
    poses = [*vjm.placements, vjm.tool]
    bent = [_bent(x, link.frame, theta) for x, link, theta in zip(poses, vjm.arm.links, links, strict=True)]
    steps = [
        step @ _moved(axis, offset, prismatic=joint.prismatic)
        for step, axis, offset, joint in zip(bent, vjm.axes, offsets, vjm.arm.joints, strict=False)
    ]
    return Rigid(vjm.base, np.array(steps).reshape(-1, 4, 4), bent[-1])


def _bent(pose: Array, frame: Array, theta: Array) -> Array:
    """The pose behind a link whose end is moved by constants, (6,) [m, rad]."""
    p, _, R = bend(pose[:3, 3:], np.eye(3)[..., None], frame, theta[None])
    return _pose(R[..., 0] @ pose[:3, :3], p[:, 0])


def _moved(axis: Array, by: float, *, prismatic: bool) -> Array:
    return _pose(np.eye(3), by * axis) if prismatic else _pose(rotation(axis, by), np.zeros(3))


def _pose(R: Array, p: Array) -> Array:
    """Poses (..., 4, 4) of rotations (..., 3, 3) and positions (..., 3)."""
    found = np.zeros((*p.shape[:-1], 4, 4))
    found[..., :3, :3], found[..., :3, 3], found[..., 3, 3] = R, p, 1
    return found


def random_joints(vjm: Vjm) -> Array:
    """Poses over all of the joints' range, the same for every export, (POSES, n) [rad, m]."""
    return np.random.default_rng(0).uniform(vjm.arm.limits[0], vjm.arm.limits[1], (POSES, vjm.arm.n_joints))


def tool_poses(vjm: Vjm, q: Array, theta_0: Array | None = None) -> Array:
    """Poses of the model's tool in the world, rigid, (poses, 4, 4) [m]."""
    where = chain(vjm, q, None if theta_0 is None else np.tile(theta_0, (len(q), 1)))
    return _pose(where.rotation, where.position)


def apart(a: Array, b: Array) -> tuple[float, float]:
    """Most that poses, (poses, 4, 4), differ: in position [m], and in an axis [rad]."""
    position = np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1).max()
    return float(position), float(np.abs(a[:, :3, :3] - b[:, :3, :3]).max())


def far(off: Array) -> tuple[float, float]:
    """Lengths of displacements, (poses, 3) [m]: RMS and at most [mm]."""
    mm = 1e3 * np.linalg.norm(off, axis=1)
    return float(np.sqrt(np.mean(mm**2))), float(mm.max())


GEOMETRY, WEIGHT, PAYLOAD = "lengths and tilts of axes", "own weight", "payload, where there is one"
ERRORS = {"harmonics": "periodic errors of the joints", "ratio": "errors in proportion to the angle"}
"""What the kinds of joint errors are called, where their name does not say it."""
SEEN = 1e-6  #: Smallest singular value that counts, over the largest: the tool may lie on an axis.
Sizes = dict[str, tuple[float, float]]
"""What the kinds of errors do at the tool over random poses, RMS and at most [mm]."""


def displacements(state: State, q: Array) -> dict[str, Array]:
    """How every kind of error moves the tool's origin, (poses, 3) [m]."""
    rigid, still = tool_poses(state.vjm, q, state.theta_0)[:, :3, 3], replace(state, n=0 * state.n)
    sagged, payload = _rest(still, q), state.vjm.arm.payload
    found = {GEOMETRY: rigid - tool_poses(state.vjm, q)[:, :3, 3], WEIGHT: sagged - rigid}
    for kind in dict.fromkeys(state.errors.kinds):
        own = state.n * np.array([name == kind for name in state.errors.kinds])
        if own.any():
            found[ERRORS.get(kind, kind)] = _rest(replace(state, C_theta=0 * state.C_theta, n=own), q) - rigid
    if payload is not None:
        found[PAYLOAD] = _rest(still, q, [weight(state.vjm, np.full(len(q), payload))]) - sagged
    return found


def _rest(state: State, q: Array, loads: list[Load] | None = None) -> Array:
    return equilibrium(state, q, loads or [], LOAD_STEPS).where.position


def unloaded(moved: dict[str, Array]) -> Array:
    """All of them together but for the payload's."""
    return np.asarray(np.sum([rows for kind, rows in moved.items() if kind != PAYLOAD], axis=0))


@dataclass(frozen=True)
class BestOffsets:
    """Offsets of the joints of the arm as drawn that bring it nearest to the arm as identified, unloaded.

    Distances are RMS and at most, with base and tool where they fit best [mm].
    """

    offsets: Array  #: (n,) [rad]; none of the first and the last joint, which are turns of base and tool.
    drawn_mm: tuple[float, float]  #: Of the tool without them.
    corrected_mm: tuple[float, float]  #: With them.
    left: Sizes  #: What they leave of every kind.


def best_offsets(state: State, q: Array) -> BestOffsets:
    """The offsets, of least squares over the tool's origin in some poses, (poses, n) [rad]."""
    vjm, n, moved = state.vjm, state.vjm.arm.n_joints, displacements(state, q)
    wanted = tool_poses(vjm, q)[:, :3, 3] + unloaded(moved)

    def off(x: Array) -> Array:  # base, tool, inner joints
        T = tool_poses(vjm, q + np.r_[0, x[9:], 0])
        at = (T[:, :3, 3] + T[:, :3, :3] @ x[6:9]) @ Rotation.from_rotvec(x[3:6]).as_matrix().T + x[:3]
        return np.asarray((at - wanted).ravel())

    found = least_squares(off, np.zeros(n + 7), xtol=1e-12, ftol=1e-12)
    J, rest, offsets = np.asarray(found.jac), found.fun.reshape(-1, 3), np.r_[0, found.x[9:], 0]
    left = {kind: rows if kind == PAYLOAD else _beyond(J, rows) for kind, rows in moved.items()}
    left[GEOMETRY] -= rest + unloaded(left)  # exact at any size
    drawn = _beyond(J[:, :9], unloaded(moved))
    return BestOffsets(offsets, far(drawn), far(rest), {kind: far(rows) for kind, rows in left.items()})


def _beyond(J: Array, rows: Array) -> Array:
    """What the columns cannot do of displacements."""
    return np.asarray(rows - (J @ np.linalg.lstsq(J, rows.ravel(), rcond=SEEN)[0]).reshape(rows.shape))
