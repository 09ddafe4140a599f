"""The identified geometry: constants of the virtual joints folded into the poses of the joints."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array
from testbench.identify.absolute.state import State, tell
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


def in_order(poses: Iterable[Array]) -> Array:
    """The product of poses, (4, 4) [m]."""
    whole = np.eye(4)
    for pose in poses:
        whole = whole @ pose
    return whole


def within(frame: Array, pose: Array) -> Array:
    """A pose in a frame, both in a third, (4, 4) [m]."""
    back = frame[:3, :3].T
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = back @ pose[:3, :3], back @ (pose[:3, 3] - frame[:3, 3])
    return found


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
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = R[..., 0] @ pose[:3, :3], p[:, 0]
    return found


def _moved(axis: Array, by: float, *, prismatic: bool) -> Array:
    found = np.eye(4)
    if prismatic:
        found[:3, 3] = by * axis
    else:
        found[:3, :3] = rotation(axis, by)
    return found


def random_joints(vjm: Vjm) -> Array:
    """Poses over all of the joints' range, the same for every export, (POSES, n) [rad, m]."""
    lower, upper = vjm.arm.limits
    return np.random.default_rng(0).uniform(lower, upper, (POSES, vjm.arm.n_joints))


def tool_poses(vjm: Vjm, q: Array, theta_0: Array | None = None) -> Array:
    """Poses of the model's tool in the world, rigid, (poses, 4, 4) [m]."""
    where = chain(vjm, q, None if theta_0 is None else np.tile(theta_0, (len(q), 1)))
    found = np.tile(np.eye(4), (len(q), 1, 1))
    found[:, :3, :3], found[:, :3, 3] = where.rotation, where.position
    return found


def apart(a: Array, b: Array) -> tuple[float, float]:
    """Most that poses, (poses, 4, 4), differ: in position [m], and in an axis [rad]."""
    position = np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1).max()
    return float(position), float(np.abs(a[:, :3, :3] - b[:, :3, :3]).max())


@dataclass(frozen=True)
class Moved:
    """How far something moves the tool, over random poses."""

    rms_mm: float
    max_mm: float


def by_geometry(state: State, q: Array) -> Moved:
    """How far errors of geometry move the tool from the arm as drawn."""
    return _far(tool_poses(state.vjm, q, state.theta_0), tool_poses(state.vjm, q))


def by_the_rest(state: State, q: Array) -> Moved:
    """How far own weight and errors of the joints move it beside."""
    none = np.zeros((len(q), 6))
    told = tell(state, q, none, none[:, :3]).where
    rest = tool_poses(state.vjm, q, state.theta_0)
    rest[:, :3, 3] -= told.position
    return _far(rest, np.zeros_like(rest))


def _far(a: Array, b: Array) -> Moved:
    far = 1e3 * np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1)
    return Moved(float(np.sqrt(np.mean(far**2))), float(far.max()))
