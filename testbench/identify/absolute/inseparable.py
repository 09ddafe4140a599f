"""Frames and mounts that readings cannot separate, and the prior that then determines them.

A target m on the tool is read at R_s (R_r m + p_r) + t_s. If the tool keeps one orientation R_r, along a line
or a surface, only the sum of R_s R_r m and t_s matters: three directions of frame and mount change no
reading. If the line is straight, neither does a rotation of the frame about it. A prior determines what is
undetermined. Another series of the same mount or frame, in which the tool rotates, makes the prior
unnecessary.
"""

from collections.abc import Sequence

import numpy as np

from testbench.data.series import Series
from testbench.errors import Array
from testbench.identify.closed_form import kabsch
from testbench.identify.registration import ASSUMED_NOISE, NOMINAL_DEVIATION, Frame
from testbench.model.vjm import Vjm, tool_pose

MAX_ROWS = 300
"""Rows of a series that are evaluated, evenly spaced."""
PRIOR_DEVIATIONS = 10.0, 1.0, 100.0
"""Prior standard deviations of a target, of rotations, and of a frame's origin [m, rad, m]."""
LEVEL = 0.05
"""Standard deviation of a tracker from upright, and the largest one of a frame's rotation that counts as
determined [rad]."""


def undetermined_frames(vjm: Vjm, series: Sequence[Series]) -> frozenset[str]:
    """Find the frames and mounts that the readings leave undetermined, for the nominal geometry.

    A mount is undetermined if a target's standard deviation exceeds `NOMINAL_DEVIATION`, a frame if that of
    its rotation exceeds `LEVEL`.

    Mathematics: `abs-7`.

    Args:
        vjm: The arm.
        series: All readings; they may share frames and mounts.

    Returns:
        Names, "frame NAME" and "mount NAME".
    """
    frames = tuple(dict.fromkeys(one.frame for one in series))
    mounts: dict[str, int] = {}
    read: dict[str, set[int]] = {}  # targets of every mount that were ever read: others have no information
    for one in series:
        mounts[one.target] = max(len(one.markers), mounts.get(one.target, 0))
        read.setdefault(one.target, set()).update(np.flatnonzero(one.seen.any(axis=0)).tolist())
    starts = np.cumsum([6 * len(frames), *(3 * m + 3 for m in mounts.values())])
    first = dict(zip(mounts, starts.tolist(), strict=False))
    # Information of all readings about frames, then mounts.
    M = np.zeros((starts[-1],) * 2)
    for one in series:
        f, m = 6 * frames.index(one.frame), first[one.target]
        at = np.r_[f : f + 6, m : m + 3 * len(one.markers), m + 3 * mounts[one.target] + np.arange(3)]
        J = _rows(vjm, one)
        M[np.ix_(at, at)] += J.T @ J / ASSUMED_NOISE**2
    # Posterior covariance with wide priors.
    before = np.full(len(M), PRIOR_DEVIATIONS[0])
    for k in range(len(frames)):
        before[6 * k : 6 * k + 6] = np.repeat(PRIOR_DEVIATIONS[1:], 3)
    for name, m in mounts.items():
        before[first[name] + 3 * m :][:3] = PRIOR_DEVIATIONS[1]
    covariance = np.linalg.inv(M + np.diag(before**-2.0))
    turns = [covariance[6 * k :, 6 * k :][:3, :3] for k in range(len(frames))]
    found = {f"frame {name}" for name, own in zip(frames, turns, strict=True) if _largest(own) > LEVEL}
    for name, some in read.items():
        ends = [first[name] + 3 * k for k in some]
        if any(_largest(covariance[k : k + 3, k : k + 3]) > NOMINAL_DEVIATION for k in ends):
            found.add(f"mount {name}")
    return frozenset(found)


def _largest(covariance: Array) -> float:
    """Compute the largest standard deviation along any direction of a covariance, (3, 3)."""
    return float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))


def _rows(vjm: Vjm, series: Series) -> Array:
    """Differentiate readings by frame (rotation, origin), targets and rotation of the mount, (e, k)."""
    seen = np.flatnonzero(series.seen.any(axis=1))
    some = seen[np.linspace(0, len(seen) - 1, min(MAX_ROWS, len(seen))).astype(int)]
    position, rotation = tool_pose(vjm, series.q[some])
    m, n = len(series.markers), len(some)
    J = np.zeros((n, m + 1, 3, 6 + 3 * m + 3))
    for k in range(m):
        J[:, k, :, :3] = np.cross(np.eye(3), position[:, None]).swapaxes(1, 2)
        J[:, k, :, 3:6] = np.eye(3)
        J[:, k, :, 6 + 3 * k : 9 + 3 * k] = rotation
    J[:, m, :, :3], J[:, m, :, 6 + 3 * m :] = np.eye(3), rotation
    there = np.column_stack([series.seen[some], series.turned[some]])
    return np.asarray(J[there].reshape(-1, J.shape[3]))


def level_frame(points: Array, read: Array) -> Frame:
    """Fit the frame that takes points to readings; the frame is upright as far as the points leave that open.

    Least squares (Kabsch) with two further points along the vertical: they count as much as a direction known
    to `LEVEL` in comparison with readings known to `ASSUMED_NOISE`.

    Args:
        points: Points in base axes, (n, 3) [m].
        read: Their readings in tracker axes, (n, 3) [m].

    Returns:
        The frame: tracker from base.
    """
    up = (ASSUMED_NOISE / LEVEL) * np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]) / np.sqrt(2)
    R, _ = kabsch(np.vstack([points - points.mean(axis=0), up]), np.vstack([read - read.mean(axis=0), up]))
    return Frame(R, read.mean(axis=0) - R @ points.mean(axis=0))
