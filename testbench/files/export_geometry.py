"""Identified geometry: constants of the virtual joints included in the poses of the joints."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from testbench.errors import Array
from testbench.identify.absolute.state import ArmState
from testbench.model.vjm import Vjm, chain, displace_link, rotation

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


def in_order(poses: Iterable[Array]) -> Array:
    """Multiply poses in order, X_1 X_2 ... X_k.

    Args:
        poses: Homogeneous poses, (4, 4) [m] each.

    Returns:
        The product, (4, 4) [m]; the identity for no pose.
    """
    return np.asarray(reduce(np.matmul, poses, np.eye(4)))


def relative_pose(frame: Array, pose: Array) -> Array:
    """Express a pose in a frame, both given in a third frame.

    Args:
        frame: The frame, (4, 4) [m].
        pose: The pose, (4, 4) [m].

    Returns:
        The pose in the frame, (4, 4) [m].
    """
    back = frame[:3, :3].T
    return _pose(back @ pose[:3, :3], back @ (pose[:3, 3] - frame[:3, 3]))


def nominal_rigid(vjm: Vjm) -> Rigid:
    """Return the nominal geometry of an arm.

    Args:
        vjm: The arm's virtual joint model.

    Returns:
        Base, joint steps and tool of its rigid chain.
    """
    return Rigid(vjm.base, vjm.placements, vjm.tool)


def identified_rigid(state: ArmState) -> Rigid:
    """Compute the geometry with its identified errors: `chain` at theta_0, for every q.

    Args:
        state: The calibrated arm.

    Returns:
        Base, joint steps and tool of its rigid chain.
    """
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
    """Compute the pose behind a link whose end is moved by constants, (6,) [m, rad]."""
    p, _, beam = displace_link(pose[:3, 3:], frame[..., None], theta[None])
    return _pose(beam[..., 0] @ frame.T @ pose[:3, :3], p[:, 0])


def _moved(axis: Array, by: float, *, prismatic: bool) -> Array:
    return _pose(np.eye(3), by * axis) if prismatic else _pose(rotation(axis, by), np.zeros(3))


def _pose(R: Array, p: Array) -> Array:
    """Combine rotations (..., 3, 3) and positions (..., 3) to poses, (..., 4, 4)."""
    found = np.zeros((*p.shape[:-1], 4, 4))
    found[..., :3, :3], found[..., :3, 3], found[..., 3, 3] = R, p, 1
    return found


def random_joints(vjm: Vjm) -> Array:
    """Draw poses over the joints' ranges, the same for every export.

    Args:
        vjm: The arm's virtual joint model, n joints.

    Returns:
        Actuated joints, (RANDOM_POSES, n) [rad, m].
    """
    return vjm.arm.drawn(np.random.default_rng(0), RANDOM_POSES)


def tool_poses(vjm: Vjm, q: Array, theta_0: Array | None = None) -> Array:
    """Compute the poses of the model's tool in the world, rigid.

    Args:
        vjm: The arm.
        q: Actuated joints, (poses, n) [rad, m].
        theta_0: Constants of the virtual joints, (n_theta,) [m, rad]; None for zero.

    Returns:
        Poses, (poses, 4, 4) [m].
    """
    where = chain(vjm, q, None if theta_0 is None else np.tile(theta_0, (len(q), 1)))
    return _pose(where.rotation, where.position)


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
