"""How far apart orientations are, as rotation vectors."""

import numpy as np

from testbench.errors import Array


def turn_between(start: Array, end: Array) -> Array:
    """Rotation vectors in the world that take orientations (points, 3, 3) to others, (points, 3) [rad]."""
    R = end @ start.swapaxes(1, 2)
    sine = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    return _vectors(sine, (np.trace(R, axis1=1, axis2=2) - 1) / 2)


def turned(turn: Array) -> Array:
    """Rotations (points, 3, 3) of rotation vectors (points, 3) [rad], by Rodrigues' formula."""
    angle = np.linalg.norm(turn, axis=1)[:, None, None]
    K = np.cross(np.eye(3), turn[:, None])
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
