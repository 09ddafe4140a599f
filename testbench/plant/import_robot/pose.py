"""Poses of bodies: homogeneous matrices, (4, 4) [m]."""

import math

import numpy as np

from testbench.errors import Array


def pose_of(rotation: Array, position: Array) -> Array:
    """A pose, (4, 4), from its rotation, (3, 3), and its position, (3,)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def moved(points: Array, pose: Array) -> Array:
    """Points of a body, (n, 3) [m], in the frame that its pose is in."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def turned(rpy: Array) -> Array:
    """Rotation by roll, pitch, yaw [rad] about the fixed x, then y, then z, as URDF's rpy, (3, 3)."""
    (a, b, c), (u, v, w) = map(math.cos, rpy), map(math.sin, rpy)
    return np.array(
        [
            [b * c, u * v * c - a * w, a * v * c + u * w],
            [b * w, u * v * w + a * c, a * v * w - u * c],
            [-v, u * b, a * b],
        ]
    )
