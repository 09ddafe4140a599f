"""Where the base stands in the tracker's frame, and where the targets sit on the tool: the closed form.

A reading of target k in pose r by station s, unloaded, is p_rk = R_s (R_r m_k + p_r) + t_s. The tool's pose
R_r, p_r is the arm's; R_s, t_s and the target m_k are unknown. With R_s^T and R_s^T t_s as unknowns it is
linear. Where m_k is about known, Kabsch's rotation between two sets of points does with fewer poses.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset, Ids
from testbench.errors import Array
from testbench.model.vjm import Vjm, tool_pose

LEAST_POINTS = 3  #: That fix a frame, as long as they are on no line.
MOST = (
    3000  #: Readings that are used, drawn at random where there are more: noise is not what limits a frame.
)
BLIND = 1e-6
"""Least singular value of the linear form over its largest, below which it is not taken."""


@dataclass(frozen=True)
class Unloaded:
    """Unloaded readings, one of each target in each pose by each station: the mean where it was read again.

    What the geometry of the arm does to a reading is the same in every run of a pose: more runs there say no
    more of it.
    """

    station: Ids  #: Index of the station, (n,).
    target: Ids  #: Index of the target, (n,).
    y: Array  #: Position, the station's axes, (n, 3) [m].
    covariance: Array  #: Of its noise, the station's axes, (n, 3, 3) [m^2].
    rotation: Array  #: Tool's orientation by the arm's kinematics, (n, 3, 3).
    position: Array  #: Tool's position by the arm's kinematics, (n, 3) [m].


@dataclass(frozen=True)
class Found:
    """Frames and targets; NaN where one is not known yet."""

    rotation: Array  #: R_s, station from base, (stations, 3, 3).
    translation: Array  #: t_s, base in the station's frame, (stations, 3) [m].
    targets: Array  #: m_k in the tool's frame, (targets, 3) [m].


def unloaded(vjm: Vjm, data: Dataset) -> Unloaded:
    """The unloaded readings of a dataset, MOST at most; stations and targets by their place in order."""
    seen = data.seen
    run, target = np.nonzero(seen)
    station = np.zeros(len(run), dtype=int)
    if data.station is not None:
        station = np.unique(data.station[run], return_inverse=True)[1].ravel()
    keys = np.column_stack([station, data.q[run], target])
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    group, count = group.ravel(), np.bincount(group.ravel())[:, None]
    y, C = np.zeros((len(first), 3)), np.zeros((len(first), 3, 3))
    np.add.at(y, group, data.before[seen])
    np.add.at(C, group, data.covariance[seen] / 2)  # one reading has half of a deflection's
    some = np.sort(np.random.Generator(np.random.Philox(0)).permutation(len(first))[:MOST])
    first, count = first[some], count[some]
    position, rotation = tool_pose(vjm, data.q[run[first]])
    C = C[some] / count[..., None] ** 2
    return Unloaded(station[first], target[first], y[some] / count, C, rotation, position)


def starts(seen: Unloaded, known: Found) -> Iterator[Found]:
    """Complete sets of frames and targets to refine, from the targets that are known and from none."""
    for targets in (known.targets, _linear(seen, len(known.targets))):
        found = _complete(seen, replace(known, targets=targets))
        if all(np.isfinite(part).all() for part in (found.rotation, found.translation, found.targets)):
            yield found


def _linear(seen: Unloaded, targets: int) -> Array:
    """Targets by the linear form in the station with most readings, (targets, 3) [m]; NaN for all others.

    Its equations are R_s^T p_rk - R_s^T t_s - R_r m_k = p_r.
    """
    found = np.full((targets, 3), np.nan)
    own = seen.station == np.bincount(seen.station).argmax()
    names, column = np.unique(seen.target[own], return_inverse=True)
    n, at, R = own.sum(), column.ravel(), seen.rotation[own]
    if 3 * n < 12 + 3 * len(names):
        return found
    rows = np.zeros((n, 3, 13))
    for axis in range(3):
        rows[:, axis, 3 * axis : 3 * axis + 3] = seen.y[own]
        rows[:, axis, 9 + axis] = -1
    rows[:, :, 12] = seen.position[own]
    mean = np.zeros((len(names), 3, 13))  # what of the rows a target takes up: R_r is orthogonal
    np.add.at(mean, at, R.swapaxes(1, 2) @ rows)
    mean /= np.bincount(at)[:, None, None]
    A = (rows - R @ mean[at]).reshape(-1, 13)
    U, s, Vt = np.linalg.svd(A[:, :12], full_matrices=False)
    if s[-1] > BLIND * s[0]:
        x = Vt.T @ ((U.T @ A[:, 12]) / s)
        found[names] = mean[:, :, :12] @ x - mean[:, :, 12]
    return found


def _complete(seen: Unloaded, found: Found) -> Found:
    """Frames by the known targets and targets by the known frames, in turn, until neither finds more."""
    rotation, translation, targets = (
        part.copy() for part in (found.rotation, found.translation, found.targets)
    )
    while True:
        missing = np.isnan(translation).sum() + np.isnan(targets).sum()
        for s in np.flatnonzero(np.isnan(translation[:, 0])):
            use = (seen.station == s) & np.isfinite(targets[seen.target, 0])
            if use.sum() >= LEAST_POINTS:
                rotation[s], translation[s] = kabsch(points(seen, targets)[use], seen.y[use])
        for k in np.flatnonzero(np.isnan(targets[:, 0])):
            use = (seen.target == k) & np.isfinite(translation[seen.station, 0])
            if use.any():
                at = seen.station[use]
                base = np.einsum("nyx,ny->nx", rotation[at], seen.y[use] - translation[at])
                tool = np.einsum("nyx,ny->nx", seen.rotation[use], base - seen.position[use])
                targets[k] = np.median(tool, axis=0)
        if missing == np.isnan(translation).sum() + np.isnan(targets).sum():
            return Found(rotation, translation, targets)


def points(seen: Unloaded, targets: Array) -> Array:
    """Where the arm has the targets, base axes, (n, 3) [m]."""
    return np.asarray(seen.position + np.einsum("nxy,ny->nx", seen.rotation, targets[seen.target]))


def kabsch(points: Array, read: Array, *, mirrored: bool = False) -> tuple[Array, Array]:
    """Rotation, (3, 3), and translation, (3,) [m], that take points to readings with the least squares.

    Both are (n, 3) [m]; `mirrored` asks for a determinant of -1 (Kabsch 1976; Arun, Huang, Blostein 1987;
    Umeyama 1991).
    """
    centre, seen = points.mean(axis=0), read.mean(axis=0)
    U, _, Vt = np.linalg.svd((read - seen).T @ (points - centre))
    sign = (-1 if mirrored else 1) * np.sign(np.linalg.det(U @ Vt))
    R = U @ np.diag([1, 1, sign]) @ Vt
    return R, seen - R @ centre
