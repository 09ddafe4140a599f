"""Where gauges touch: in every pose of a plan, which markers are read and along which axes.

A gauge reads one number, so that a pose offers a choice that a tracker does not have. Candidates are all
markers along the axes of the world or of the tool. They are chosen by the criterion of the poses: one after
the other, each the best next one of all poses, then exchanged one by one as long as an exchange helps
(Fedorov 1972). A tilt of the direction counts as noise: gauges avoid directions across large deflections.
"""

from dataclasses import dataclass
from itertools import cycle, islice

import numpy as np

from testbench.design.criteria import Criterion
from testbench.design.rows import Specification, deflection_rows, loads_of, row_products
from testbench.errors import Array, BenchError, Ids
from testbench.model.vjm import tool_pose

MIN_GAIN, SWEEPS = 1e-6, 20
"""Relative gain of Phi below which an exchange does not count [1]; most passes over all gauges."""


@dataclass(frozen=True)
class Gauges:
    """Describe the gauges that are at hand."""

    count: int  #: How many are read in a pose, each at a marker of its own.
    sigma: float  #: Standard deviation of one reading [m].
    tilt: float  #: Standard deviation of a direction about each axis across it [rad].
    on_tool: bool = False  #: Whether faces are along the axes of the tool, not of the world.


@dataclass(frozen=True)
class GaugePlan:
    """Hold the gauges of every pose."""

    marker: Ids  #: Index of the marker of every gauge, (poses, count).
    axis: Ids  #: Axis of every gauge, 0 to 2 for x, y, z, (poses, count).
    value: float  #: Phi of all readings.
    information: Array  #: Information matrix M, prior included, (r, r).


def gauge_rows(spec: Specification, q: Array, load: Ids, gauges: Gauges, lift: Array) -> Array:
    """Compute whitened rows of a gauge at every marker along every axis.

    The row is u . J over sqrt(2 sigma^2 + tilt^2 |u x d|^2), d the deflection that the prior expects.

    Args:
        spec: Specification of the plan.
        q: Actuated joints, (poses, n) [rad, m].
        load: Index into the specification's loads, (poses,).
        gauges: The gauges.
        lift: Unknowns x per unit of the coordinates a, (n, r).

    Returns:
        Rows per unit of a, (poses, m, 3, r) [1].
    """
    D = deflection_rows(spec.experiment, q, loads_of(spec, load))  # tool axes
    poses, markers = len(q), len(spec.experiment.targets)
    D = D.reshape(poses, markers, 3, -1)
    if not gauges.on_tool:
        D = np.einsum("pxy,pmyn->pmxn", tool_pose(spec.experiment.vjm, q)[1], D)
    d = D @ spec.experiment.scaling.expected
    across = (d**2).sum(axis=2, keepdims=True) - d**2  # |u x d|^2 along each axis u
    deviation = np.sqrt(2 * gauges.sigma**2 + gauges.tilt**2 * across)
    rows = D.reshape(poses, markers * 3, -1) / deviation.reshape(poses, -1, 1)
    return row_products(rows, lift).reshape(poses, markers, 3, -1)


def choose_gauges(rows: Array, prior: Array, criterion: Criterion, count: int) -> GaugePlan:
    """Choose the gauges of all poses.

    Args:
        rows: Rows of all candidates, `gauge_rows`, (poses, m, 3, r) [1].
        prior: Information before any reading, (r, r).
        criterion: Information function.
        count: Gauges in a pose.

    Returns:
        The gauges; no single exchange of one improves them.

    Raises:
        BenchError: When there are more gauges than markers.
    """
    poses, markers = rows.shape[:2]
    if not 1 <= count <= markers:
        raise BenchError(f"gauges: expected 1 to {markers}, one per marker, got {count}")
    chosen = np.full((poses, count), -1)  # marker * 3 + axis
    M = prior
    every = rows.reshape(poses, markers * 3, 1, -1)
    # One after the other: the best next gauge of all poses that lack one.
    while (chosen < 0).any():
        open_ = _free(chosen, markers)
        worth = criterion.after(M, every.reshape(-1, 1, every.shape[-1])).reshape(open_.shape)
        worth = np.where(open_, worth, -1)
        pose, best = np.unravel_index(int(worth.argmax()), worth.shape)
        chosen[pose, int((chosen[pose] >= 0).sum())] = best
        M = M + every[pose, best].T @ every[pose, best]
    # Exchange one by one until all were tried in vain.
    left, value = chosen.size, criterion.information(M)
    places = cycle([(p, k) for p in range(poses) for k in range(count)])
    for p, k in islice(places, SWEEPS * chosen.size):
        own = every[p, chosen[p, k]]
        rest = M - own.T @ own
        others = np.delete(chosen[p], k) // 3
        allowed = ~np.isin(np.arange(markers * 3) // 3, others)
        reached = np.where(allowed, criterion.after(rest, every[p]), -1)
        left -= 1
        if reached.max() > (1 + MIN_GAIN) * value:
            chosen[p, k], value, left = int(reached.argmax()), float(reached.max()), chosen.size
            M = rest + every[p, chosen[p, k]].T @ every[p, chosen[p, k]]
        elif left == 0:
            break
    order = np.sort(chosen, axis=1)
    return GaugePlan(order // 3, order % 3, criterion.information(M), M)


def _free(chosen: Ids, markers: int) -> Array:
    """Tell which candidates may follow: in poses that lack a gauge, at markers without one, (poses, 3 m)."""
    full = (chosen >= 0).all(axis=1)
    taken = np.array([np.isin(np.arange(markers * 3) // 3, own[own >= 0] // 3) for own in chosen])
    return np.asarray(~taken & ~full[:, None])
