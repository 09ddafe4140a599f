"""Where a robot's own frames stand in the model: the axes of its joints laid onto those of the model.

A robot's file and the arm's folder draw one robot with other frames: another base, other axes of the links,
another zero along a joint's axis. The axes themselves are the same lines.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from testbench.errors import Array
from testbench.model.vjm import rotation, skew

STEPS = 30  #: Of Gauss-Newton from each start.
UNTOLD = 1e-4
"""Smallest singular value that counts, over the largest: rounding does not tell where parallel axes end."""


def axis_lines(bodies: Sequence[Array], axes: Array, slides: Sequence[bool]) -> Array:
    """Twists of the joints at q = 0 in the frame of the poses, (n, 6): turn, then speed at the origin [1, m].

    Args:
        bodies: Poses of the joints' bodies, (n) of (4, 4) [m].
        axes: Their unit axes in their bodies, (n, 3).
        slides: Which of them slide.
    """
    found = []
    for pose, axis, slide in zip(bodies, axes, slides, strict=True):
        d = pose[:3, :3] @ axis
        found.append([*np.zeros(3), *d] if slide else [*d, *np.cross(pose[:3, 3], d)])
    return np.array(found)


def align(theirs: Array, ours: Array) -> Array:
    """The pose of their frame in ours that lays their axes onto ours best, (4, 4) [m].

    Where axes leave it open, as the height of a base below parallel axes, it moves least.

    Args:
        theirs: Twists, (n, 6), see `axis_lines`.
        ours: The same of the model.
    """
    found = [_descend(theirs, ours, start) for start in Rotation.create_group("O").as_matrix()]
    return min(found, key=lambda one: one[0])[1]


def _descend(theirs: Array, ours: Array, R: Array) -> tuple[float, Array]:
    """Gauss-Newton from a rotation: the sum of squares that is left, and the pose."""
    t = np.zeros(3)
    for _ in range(STEPS):
        r, J = _residual(theirs, ours, R, t)
        step = np.asarray(np.linalg.lstsq(J, -r, rcond=UNTOLD)[0], dtype=float)
        angle = float(np.linalg.norm(step[:3]))
        if angle > 0:
            R = rotation(step[:3] / angle, angle) @ R
        t = t + step[3:]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, t
    left = float(np.sum(_residual(theirs, ours, R, t)[0] ** 2))
    return left if np.isfinite(left) else np.inf, pose


def _residual(theirs: Array, ours: Array, R: Array, t: Array) -> tuple[Array, Array]:
    """Differences of all twists, (6 n,), and their derivatives by a turn and a shift, (6 n, 6)."""
    turn, speed = theirs[:, :3] @ R.T, theirs[:, 3:] @ R.T
    r = np.hstack([turn, speed + np.cross(t, turn)]) - ours
    J = np.zeros((len(theirs), 6, 6))
    for k, (w, v) in enumerate(zip(turn, speed, strict=True)):
        J[k, :3, :3] = -skew(w)
        J[k, 3:, :3] = -skew(v) - skew(t) @ skew(w)
        J[k, 3:, 3:] = -skew(w)
    return r.ravel(), J.reshape(-1, 6)


def onto_axis(frame: Array, theirs: Array, ours: Array, *, slide: bool) -> Array:
    """A link's frame in the model's body, its axis exactly on the model's through the body's origin.

    Args:
        frame: About that, (4, 4) [m].
        theirs: Unit axis in the link, (3,).
        ours: Unit axis in the body, (3,).
        slide: Whether the joint slides: then the axis has no place.
    """
    d = frame[:3, :3] @ theirs
    across = np.cross(d, ours)
    sine = float(np.linalg.norm(across))
    found = frame.copy()
    if sine > 0:
        found[:3, :3] = rotation(across / sine, float(np.arctan2(sine, d @ ours))) @ found[:3, :3]
    if not slide:
        found[:3, 3] = (ours @ found[:3, 3]) * ours
    return found
