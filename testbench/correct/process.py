"""Process forces that turn with the tool's path: along the feed, across it, and along the spindle.

They become loads of `predict` and `compensate`.
"""

from collections.abc import Sequence

import numpy as np

from testbench.errors import Array, BenchError, Mask, check_array

SAME_POINT = 1e-7  #: Distance of points that count as one [m]: the tool waits there.
#: Length of a sum of unit vectors, or sine of feed and spindle, that defines no direction [1].
MIN_DIRECTION_LENGTH = 1e-3


def process_wrench(
    along: Array, position: Array, spindle: Array, names: Sequence[str] | None = None
) -> Array:
    """Compute the force of a process on the tool at every point of a path; its moment is zero.

    f = f_feed t + f_cross (s x t) / norm(s x t) + f_axial s, with the tangent t of the path and the spindle
    s. Seen against s, a positive cross force points to the left of the feed. Resistance to the feed is
    negative; so is the thrust of a drill whose s points into the work.

    Mathematics: `cor-6`.

    Args:
        along: Forces along the feed, across it, and along the spindle, (points, 3) [N].
        position: Points of the path, world, (points, 3) [m].
        spindle: Unit vector of the spindle's axis, world, (points, 3) [1].
        names: Names of the points for messages, or None.

    Returns:
        Force and zero moment, world axes, (points, 6) [N, N m].

    Raises:
        BenchError: When an array has another shape or is not finite; or at the first point with a force along
            or across a feed that the path does not define.
    """
    along = check_array(along, (None, 3), "forces along feed, across, axial [N]")
    position = check_array(position, (len(along), 3), "position [m]")
    spindle = check_array(spindle, (len(along), 3), "spindle [1]")
    feed = tangents(position, np.asarray(along[:, :2].any(axis=1)))
    across = np.cross(spindle, feed)
    sine = np.linalg.norm(across, axis=1)
    there = sine > MIN_DIRECTION_LENGTH
    across[there] /= sine[there, None]
    untold = (
        ("feed", ~feed.any(axis=1), "the path stands still or turns back"),
        ("cross", ~there, "the path stands still, turns back or runs along the spindle"),
    )
    for k, (name, lost, why) in enumerate(untold):
        bad = np.flatnonzero(lost & (along[:, k] != 0))
        if len(bad):
            place = names[bad[0]] if names else f"point {bad[0] + 1}"
            raise BenchError(f"{place}: no direction for its {name} force: {why}")
    force = along[:, :1] * feed + along[:, 1:2] * across + along[:, 2:] * spindle
    return np.hstack([force, np.zeros_like(force)])


def tangents(position: Array, acts: Mask) -> Array:
    """Compute the unit tangent of a path at every point; zero where the path defines none.

    The tangent is halfway between the directions to and from a point. Where the tool waits, the nearest
    points that differ count. A cut ends where its force does: path segments that lead into it and out of it
    do not count there.

    Args:
        position: Points of the path, (points, 3) [m].
        acts: Points at which a force acts, (points,).

    Returns:
        Unit tangents, (points, 3) [1].
    """
    step = np.diff(position, axis=0)
    length = np.linalg.norm(step, axis=1)
    moves = length > SAME_POINT
    group = np.concatenate([[0], np.cumsum(moves)])
    cut = np.bincount(group, acts) > 0
    unit = step[moves] / length[moves, None]
    inside = _halfway(unit * (cut[:-1] & cut[1:])[:, None])
    own = np.where(inside.any(axis=1, keepdims=True), inside, _halfway(unit))
    return np.asarray(own[group])


def _halfway(unit: Array) -> Array:
    """Compute directions between those before and behind, (points, 3); zero where opposite or missing."""
    both = np.zeros((len(unit) + 1, 3))
    both[:-1] += unit
    both[1:] += unit
    size = np.linalg.norm(both, axis=1, keepdims=True)
    return np.asarray(np.divide(both, size, out=np.zeros_like(both), where=size > MIN_DIRECTION_LENGTH))
