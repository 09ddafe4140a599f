"""How the joints move the tool of the drawn arm, and how far apart orientations are, as rotation vectors."""

import numpy as np

from testbench.errors import Array
from testbench.model.vjm import Vjm, body_poses, cross, skew


def turn_between(start: Array, end: Array) -> Array:
    """Rotation vectors in the world that take orientations (points, 3, 3) to others, (points, 3) [rad]."""
    R = end @ start.swapaxes(1, 2)
    sine = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    return _vectors(sine, (np.trace(R, axis1=1, axis2=2) - 1) / 2)


def turned(turn: Array) -> Array:
    """Rotations (points, 3, 3) of rotation vectors (points, 3) [rad], by Rodrigues' formula."""
    angle = np.linalg.norm(turn, axis=1)[:, None, None]
    K = skew(turn)
    half = np.sinc(angle / (2 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + half**2 / 2 * K @ K)


def turn_of_axis(start: Array, end: Array) -> Array:
    """The same of the shortest turns that take unit vectors (points, 3) to others."""
    return _vectors(np.cross(start, end), np.einsum("px,px->p", start, end))


def _vectors(sine: Array, cosine: Array) -> Array:
    """Rotation vectors from axes times sines, (points, 3), and cosines, (points,)."""
    size = np.linalg.norm(sine, axis=1)
    angle = np.arctan2(size, cosine)
    return np.asarray(sine * np.where(size > 0, angle / np.where(size > 0, size, 1), 1)[:, None])


def tool_motion(vjm: Vjm, q: Array) -> tuple[Array, Array, Array]:
    """Where the tool is, and how every joint moves it, in world axes, all links and springs rigid.

    Args:
        vjm: The model.
        q: Actuated joints, (runs, n) [rad, m].

    Returns:
        Positions, (runs, 3) [m], orientations, world from tool, (runs, 3, 3), and Jacobians of the joints at
        the tool's origin, translation first, (runs, 6, n) [m, 1].
    """
    _, *bodies, (position, rotation) = body_poses(vjm, q)
    J = np.zeros((6, vjm.arm.n_joints, len(q)))
    for k, (joint, axis, (origin, R)) in enumerate(zip(vjm.arm.joints, vjm.axes, bodies, strict=True)):
        along = (R @ axis).T
        if joint.prismatic:
            J[:3, k] = along
        else:
            J[:3, k], J[3:, k] = cross(along, (position - origin).T), along
    return position, rotation, J.transpose(2, 0, 1)
