"""Rigid tool motion and rotation vectors: how joints move the tool, and how far orientations are apart.

`correct` uses these for inverse kinematics and for the rotation part of its errors.
"""

import numpy as np

from testbench.errors import Array
from testbench.model.vjm import Vjm, body_poses, cross, skew


def turn_between(start: Array, end: Array) -> Array:
    """Compute rotation vectors that take orientations to others, log(R_end R_start^T).

    Args:
        start: First orientations, world from tool, (points, 3, 3) [1].
        end: Second orientations, world from tool, (points, 3, 3) [1].

    Returns:
        Rotation vectors, world axes, (points, 3) [rad]; zero for a turn of exactly 180 degrees, whose axis
        the formula loses.
    """
    R = end @ start.swapaxes(1, 2)
    sine = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    return _vectors(sine, (np.trace(R, axis1=1, axis2=2) - 1) / 2)


def rotation_matrices(turn: Array) -> Array:
    """Compute rotation matrices of rotation vectors by Rodrigues' formula, exp([r]_x).

    Args:
        turn: Rotation vectors r, (points, 3) [rad].

    Returns:
        Rotation matrices, (points, 3, 3) [1].
    """
    angle = np.linalg.norm(turn, axis=1)[:, None, None]
    K = skew(turn)
    half = np.sinc(angle / (2 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + half**2 / 2 * K @ K)


def turn_of_axis(start: Array, end: Array) -> Array:
    """Compute rotation vectors of the shortest turns that take unit vectors to others.

    Args:
        start: First unit vectors, (points, 3) [1].
        end: Second unit vectors, (points, 3) [1].

    Returns:
        Rotation vectors, (points, 3) [rad]; zero for opposite vectors, whose axis is undefined.
    """
    return _vectors(np.cross(start, end), np.einsum("px,px->p", start, end))


def _vectors(sine: Array, cosine: Array) -> Array:
    """Rotation vectors from axes times sines, (points, 3), and cosines, (points,)."""
    size = np.linalg.norm(sine, axis=1)
    angle = np.arctan2(size, cosine)
    return np.asarray(sine * np.where(size > 0, angle / np.where(size > 0, size, 1), 1)[:, None])


def tool_motion(vjm: Vjm, q: Array) -> tuple[Array, Array, Array]:
    """Compute the tool's pose and the Jacobian of the actuated joints at its origin, the arm rigid.

    Args:
        vjm: Kinematics of the arm.
        q: Actuated joints, (runs, n) [rad, m].

    Returns:
        Positions, world, (runs, 3) [m]; orientations, world from tool, (runs, 3, 3) [1]; and Jacobians,
        translation rows first, world axes, (runs, 6, n) [m, 1].

    Raises:
        BenchError: When q has another shape or is not finite.
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
