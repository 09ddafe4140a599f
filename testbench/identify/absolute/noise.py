"""How far readings scatter about a model: by themselves, and by what the model leaves open.

What it leaves open is common to the readings of one pose. k of them are taken as one mean, of variance
sigma^2 + k s^2, and k - 1 differences, of variance sigma^2 alone (Helmert's transformation).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.linalg import helmert

from testbench.data.series import Series
from testbench.errors import Array
from testbench.model.structure import Ids

KINDS = ("position", "orientation", "position within a pose", "orientation within a pose")
"""Kinds of equations, each with a scatter of its own."""
POSITIONS = (0, 2)  #: Those that are positions.


@dataclass(frozen=True)
class Noise:
    """Standard deviations along an axis."""

    open_position: float = 0.0  #: s of positions: what the model leaves open [m].
    open_rotation: float = 0.0  #: s of orientations [rad].
    #: Scatter over what is expected, of every kind [1].
    factor: Array = field(default_factory=lambda: np.ones(len(KINDS)))


@dataclass(frozen=True)
class Plan:
    """How the rows of a series combine: groups of readings of one pose, of one size each."""

    groups: tuple[Ids, ...]  #: Of every size k > 1 the rows, (groups, k).


def plan_of(series: Series) -> Plan:
    """Rows of a pose that read the same targets."""
    read = np.column_stack([series.pose, series.seen, series.turned])
    code = np.unique(read, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(code, kind="stable")
    _, first, count = np.unique(code[order], return_index=True, return_counts=True)
    sizes = [k for k in np.unique(count) if k > 1]
    return Plan(tuple(np.array([order[f : f + k] for f in first[count == k]]) for k in sizes))


def kinds_of(series: Sequence[Series]) -> tuple[int, ...]:
    """Kinds of equations that some series have."""
    turned = any(one.rotation is not None for one in series)
    again = any(plan_of(one).groups for one in series)
    return tuple(k for k in range(len(KINDS)) if (turned or k in POSITIONS) and (again or k < 2))


def combine(plan: Plan, rows: Array) -> Array:
    """Rows of readings, (..., runs), poses read more than once as their mean and differences."""
    if not plan.groups:
        return rows
    rows = rows.copy()
    for group in plan.groups:
        H = helmert(group.shape[1], full=True)
        rows[..., group] = rows[..., group] @ H.T
    return rows


def multiplicity(plan: Plan, runs: int) -> Ids:
    """Readings behind the mean that a row stands for, (runs,); 0 of a difference."""
    found = np.ones(runs, dtype=int)
    for group in plan.groups:
        found[group[:, 0]], found[group[:, 1:]] = group.shape[1], 0
    return found


def roots(series: Series, noise: Noise, plan: Plan, rotation: Array) -> tuple[Array, npt.NDArray[np.int_]]:
    """Inverse roots of the covariances of combined rows, and their kinds.

    Args:
        series: The readings.
        noise: Their scatter.
        plan: How they combine.
        rotation: Tracker from base, (3, 3).

    Returns:
        W with W left of variance 1, (s, runs, 3, 3) [1/m, 1/rad], base axes; kinds, (s, runs).
    """
    m, times = len(series.markers), multiplicity(plan, series.rows)
    s = m + (series.rotation is not None)
    W = np.zeros((s, series.rows, 3, 3))
    kinds = np.where(times > 0, 0, 2) * np.ones((s, 1), dtype=int)
    kinds[m:] += 1
    opened = times * noise.open_position**2
    if series.precision is None:
        deviation = np.sqrt(series.sigma**2 + opened)
        W[:m] = np.eye(3) / deviation[:, None, None]
    else:
        lost = ~series.seen[..., None, None]
        own = np.linalg.inv(np.where(lost, np.eye(3), series.precision))
        own = rotation.T @ own @ rotation
        for group in plan.groups:
            own[group] = own[group].mean(axis=1, keepdims=True)
        own = own + opened[:, None, None, None] * np.eye(3)
        W[:m] = np.linalg.inv(np.linalg.cholesky(own)).swapaxes(0, 1)
    if series.sigma_rotation is not None:
        deviation = np.sqrt(series.sigma_rotation**2 + times * noise.open_rotation**2)
        W[m:] = np.eye(3) / deviation[:, None, None]
    return W / noise.factor[kinds][..., None, None], kinds


def lengths(white: Array) -> Array:
    """Lengths of whitened readings, (s, 3, runs) -> (s, runs) [1]."""
    return np.asarray(np.linalg.norm(white, axis=1))
