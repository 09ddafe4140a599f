"""Readings along lines: a dial gauge, a ballbar or a draw-wire reads one number of a marker's motion.

A marker moves by d and the tool turns by w under a load. A gauge reads the plane face of the tool that its
tip touches. The face has the unit normal u and turns with the tool: to second order the gauge reads

    t = (u + w x u) . d

A distance to a fixed point, at the length r along the unit vector u, changes by

    t = (u + d' / (2 r)) . d,    d' = d - u (u . d)

Both are rows u . A of the observation matrix, Eq. (12), with a direction that moves by milliradians. If u is
known to a standard deviation a about each axis across it, a reading has the further variance a^2 |u x d|^2,
and readings of one set-up share it. The tilt itself is not estimated: it is marginalised.

d and w are predicted by the arm's folder after the readings have scaled its joints and its links. Any
readings determine these few unknowns. A prior may be wrong by a factor of two. This prediction is wrong by
about a tenth, which changes a standard deviation by a tenth and a direction by a part of a milliradian.
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from testbench.data.dataset import Dataset, along_lines
from testbench.errors import Array
from testbench.identify.rows import nominal_chain
from testbench.model.load import Load
from testbench.model.vjm import Vjm, marker_points, translation_rows

ROUGH = 0.1
"""Error of a model of scaled joints and links, over the RMS of the readings [1]."""
UNSURE = 1.0
"""Standard deviation of every scale about that of the arm's folder [1]."""
BLOCK_RUNS = 384  #: Runs whose Jacobians are in memory at a time.


def resolve_lines(vjm: Vjm, data: Dataset) -> Dataset:
    """Turn directions of readings along lines with the loaded arm, and count their tilt as noise.

    Mathematics: `obs-10`.

    Args:
        vjm: The arm's virtual joint model.
        data: The runs, in the base's frame.

    Returns:
        The runs with `slide`, directions and precisions; as they are if they have no readings along lines, or
        have their slide already.
    """
    if data.direction is None or data.tilt is None or data.reach is None or data.slide is not None:
        return data
    d, turn = predicted_motion(vjm, data)
    u, lines = data.direction, data.lines[..., None]
    moved = np.where(lines, directions_under_load(u, data.reach, d, turn), 0.0)
    # The reading, its variance and what its set-up shares of it.
    slide = data.tilt[..., None] * np.cross(moved, d)
    assert data.precision is not None
    weight = np.trace(data.precision, axis1=2, axis2=3)
    variance = np.where(data.lines, 1 / np.where(data.lines, weight, 1.0), 1.0) + (slide**2).sum(axis=2)
    number = (u * data.deflection).sum(axis=2, keepdims=True)
    return replace(
        data,
        direction=moved,
        after=np.where(lines, data.before + moved * number, data.after),
        precision=np.where(lines[..., None], along_lines(moved, np.sqrt(variance / 2)), data.precision),
        slide=slide,
    )


def directions_under_load(u: Array, reach: Array, d: Array, turn: Array) -> Array:
    """Compute the directions along which motions are read to second order.

    Mathematics: `obs-9`.

    Args:
        u: Directions at the unloaded arm, unit vectors, (runs, m, 3) [1].
        reach: Lengths of distances, 0 for a gauge on a face of the tool, (runs, m) [m].
        d: Motion of every marker, (runs, m, 3) [m].
        turn: Rotation of the tool, (runs, 3) [rad].

    Returns:
        u + w x u for a gauge, u + d' / (2 r) for a distance, as unit vectors, (runs, m, 3) [1].
    """
    across = d - (u * d).sum(axis=2, keepdims=True) * u
    r = np.where(reach > 0, reach, 1.0)[..., None]
    moved = np.where(reach[..., None] > 0, u + across / (2 * r), u + np.cross(turn[:, None], u))
    return np.asarray(moved / np.maximum(np.linalg.norm(moved, axis=2, keepdims=True), np.finfo(float).tiny))


def predicted_motion(vjm: Vjm, data: Dataset) -> tuple[Array, Array]:
    """Predict the motion of all markers by the arm's folder, its joints and its links scaled to the readings.

    With the motion D_j of the markers by joint j alone, and D_0 by all links, the scales s >= 0 minimise

        sum of |P (D s - y)|^2 / (ROUGH RMS(y))^2 + |s - 1|^2 / UNSURE^2

    over all readings y, P the projection on what was read.

    Args:
        vjm: The arm's virtual joint model.
        data: The runs.

    Returns:
        Displacement of every marker, (runs, m, 3) [m], and rotation of the tool, (runs, 3) [rad].
    """
    points, parts, turns = marker_points(vjm, data.markers), [], []
    for first in range(0, data.runs, BLOCK_RUNS):
        some = slice(first, first + BLOCK_RUNS)
        by_part = _parts(vjm, data, some, points)
        parts.append(by_part[0])
        turns.append(by_part[1])
    D, W = np.concatenate(parts, axis=1), np.concatenate(turns, axis=1)
    seen = data.seen
    read = np.array([data.as_read(own)[seen] for own in D]).reshape(len(D), -1)
    y = data.as_read(data.deflection)[seen].ravel()
    rough = ROUGH * float(np.sqrt((y**2).mean())) or 1.0
    rows = np.vstack([read.T / rough, np.eye(len(D)) / UNSURE])
    s, _ = nnls(rows, np.concatenate([y / rough, np.full(len(D), 1 / UNSURE)]))
    return np.tensordot(s, D, axes=1), np.tensordot(s, W, axes=1)


def _parts(vjm: Vjm, data: Dataset, some: slice, points: Array) -> tuple[Array, Array]:
    """Compute motions of markers, (n + 1, runs, m, 3) [m], and turns, (n + 1, runs, 3), of each part."""
    state = nominal_chain(vjm, data.q[some], [Load(data.wrench[some], data.point[some])])
    C, first = vjm.arm.C_theta, 6 * len(vjm.arm.links)
    theta = C @ state.u[: len(C)]
    J = translation_rows(state.chain, points)
    each = [slice(0, first), *(slice(k, k + 1) for k in range(first, len(C)))]
    runs = J.shape[-1]
    D = [np.einsum("xtr,tr->rx", J[:, own], theta[own]).reshape(runs, len(points), 3) for own in each]
    W = [np.einsum("xtr,tr->rx", state.chain.J_theta[3:, own], theta[own]) for own in each]
    return np.array(D), np.array(W)
