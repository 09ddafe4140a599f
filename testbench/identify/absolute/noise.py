"""Noise of readings about a model: noise of the instrument, and the model error.

The model error is common to the readings of one pose. k of them are replaced by their mean, of variance
sigma^2 + k s^2, and by k - 1 differences, of variance sigma^2 (Helmert's transformation).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import helmert

from testbench.data.series import Series
from testbench.errors import Array, Ids
from testbench.identify.robust_loss import READINGS, Loss

EQUATION_KINDS = ("position", "orientation", "position within a pose", "orientation within a pose")
"""Kinds of equations, each with its own noise factor."""
POSITIONS = (0, 2)
"""Kinds that are positions."""


@dataclass(frozen=True)
class Noise:
    """Hold standard deviations along an axis, and noise factors."""

    open_position: float = 0.0  #: Model error s of positions [m].
    open_rotation: float = 0.0  #: Model error s of orientations [rad].
    #: Noise over expected noise, of every kind of equations, (kinds,) [1].
    factor: Array = field(default_factory=lambda: np.ones(len(EQUATION_KINDS)))


def repeated_rows(series: Series) -> tuple[Ids, ...]:
    """Group the rows of a pose that read the same targets: for every number k > 1 of them, (groups, k)."""
    read = np.column_stack([series.pose, series.seen, series.turned])
    code = np.unique(read, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(code, kind="stable")
    _, first, count = np.unique(code[order], return_index=True, return_counts=True)
    sizes = [k for k in np.unique(count) if k > 1]
    return tuple(np.array([order[f : f + k] for f in first[count == k]]) for k in sizes)


def kinds_of(series: Sequence[Series]) -> tuple[int, ...]:
    """List the kinds of equations that some series have, as places in `EQUATION_KINDS`."""
    turned = any(one.rotation is not None for one in series)
    again = any(repeated_rows(one) for one in series)
    return tuple(k for k in range(len(EQUATION_KINDS)) if (turned or k in POSITIONS) and (again or k < 2))


def combine_rows(groups: Sequence[Ids], rows: Array) -> Array:
    """Replace the readings of every group by their mean and differences (Helmert's transformation).

    Args:
        groups: Rows that are combined, (groups, k) for every number k of rows.
        rows: Values of all rows, (..., runs).

    Returns:
        The combined values, (..., runs); the first row of a group holds sqrt(k) times their mean.
    """
    if groups:
        rows = rows.copy()
    for group in groups:
        rows[..., group] = rows[..., group] @ helmert(group.shape[1], full=True).T
    return rows


def multiplicity(groups: Sequence[Ids], runs: int) -> Ids:
    """Count the readings behind each combined row.

    Args:
        groups: Rows that are combined, (groups, k) for every number k of rows.
        runs: Number of rows.

    Returns:
        k for a mean of k readings, 1 for a single reading, 0 for a difference, (runs,).
    """
    found = np.ones(runs, dtype=int)
    for group in groups:
        found[group[:, 0]], found[group[:, 1:]] = group.shape[1], 0
    return found


def inverse_noise_roots(
    series: Series, noise: Noise, rotation: Array, groups: Sequence[Ids] = ()
) -> tuple[Array, Ids]:
    """Compute the whitening matrices W = (covariance)^-1/2 of combined rows, and their kinds.

    Mathematics: `abs-4`.

    Args:
        series: The readings, s per row.
        noise: Their noise.
        rotation: Tracker from base, (3, 3).
        groups: Rows that are combined; none if each row counts by itself.

    Returns:
        W, in base axes, with W times the residual of variance 1, (s, runs, 3, 3) [1/m, 1/rad]; kinds, (s,
        runs).
    """
    m, times = len(series.markers), multiplicity(groups, series.rows)
    s = m + (series.rotation is not None)
    W = np.zeros((s, series.rows, 3, 3))
    kinds = np.where(times > 0, 0, 2) * np.ones((s, 1), dtype=int)
    kinds[m:] += 1
    # Covariance of positions: the instrument's, averaged over a group, plus the model error.
    opened = times * noise.open_position**2
    if series.precision is None:
        W[:m] = np.eye(3) / np.sqrt(series.sigma**2 + opened)[:, None, None]
    else:
        own = np.linalg.inv(np.where(series.seen[..., None, None], series.precision, np.eye(3)))
        own = rotation.T @ own @ rotation
        for group in groups:
            own[group] = own[group].mean(axis=1, keepdims=True)
        own = own + opened[:, None, None, None] * np.eye(3)
        W[:m] = np.linalg.inv(np.linalg.cholesky(own)).swapaxes(0, 1)
    if series.sigma_rotation is not None:
        deviation = np.sqrt(series.sigma_rotation**2 + times * noise.open_rotation**2)
        W[m:] = np.eye(3) / deviation[:, None, None]
    return W / noise.factor[kinds][..., None, None], kinds


def weights(
    series: Series, noise: Noise, rotation: Array, left: Array, loss: Loss = READINGS
) -> tuple[Array, Array]:
    """Compute whitening matrices of single readings, and the robust weight of each from its own residual.

    Args:
        series: The readings, s per row.
        noise: Their noise.
        rotation: Tracker from base, (3, 3).
        left: Residuals in base axes, (s, 3, runs) [m, rad].
        loss: The robust loss.

    Returns:
        W as from `inverse_noise_roots`, (s, runs, 3, 3) [1/m, 1/rad], and the weights, (s, runs) [1].
    """
    W, _ = inverse_noise_roots(series, noise, rotation)
    return W, loss.influence(np.linalg.norm(np.einsum("srxy,syr->sxr", W, left), axis=1))
