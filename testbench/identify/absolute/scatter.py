"""Residuals of readings, their noise about a state, and outliers.

Noise of readings about a model: noise of the instrument, and the model error.

The model error is common to the readings of one pose. k of them are replaced by their mean, of variance
sigma^2 + k s^2, and by k - 1 differences, of variance sigma^2 (Helmert's transformation).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import helmert

from testbench.data.series import Series, select_rows
from testbench.errors import Array, Ids
from testbench.identify.absolute.state import ROWS_AT_ONCE, ArmState, series_equilibrium
from testbench.identify.robust_loss import READINGS, Loss
from testbench.identify.rows import series_residuals

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
    """Group the rows of a pose that read the same targets.

    Args:
        series: The readings.

    Returns:
        Rows, (groups, k), for every number k > 1 of rows in a group.
    """
    read = np.column_stack([series.pose, series.seen, series.turned])
    code = np.unique(read, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(code, kind="stable")
    _, first, count = np.unique(code[order], return_index=True, return_counts=True)
    sizes = [k for k in np.unique(count) if k > 1]
    return tuple(np.array([order[f : f + k] for f in first[count == k]]) for k in sizes)


def kinds_of(series: Sequence[Series]) -> tuple[int, ...]:
    """List the kinds of equations that some series have.

    Args:
        series: The readings.

    Returns:
        Places in `EQUATION_KINDS`.
    """
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


def residuals(state: ArmState, series: Series) -> Array:
    """Compute residuals, readings minus model, in base axes.

    Args:
        state: The model.
        series: The readings.

    Returns:
        (s, 3, rows) [m, rad]; zero where nothing was read.
    """
    starts = range(0, max(series.rows, 1), ROWS_AT_ONCE)
    some = (select_rows(series, np.arange(k, min(k + ROWS_AT_ONCE, series.rows))) for k in starts)
    return np.concatenate(
        [series_residuals(state, one, series_equilibrium(state, one)) for one in some], axis=2
    )


def pulls_of(state: ArmState, series: Series, noise: Noise) -> Array:
    """Compute the robust weight of every reading from its own residual.

    Args:
        state: The model.
        series: The readings.
        noise: Their noise.

    Returns:
        Weights, (s, rows) [1].
    """
    return weights(series, noise, state.frame(series).rotation, residuals(state, series))[1]


def scatter(state: ArmState, series: Sequence[Series], share: float) -> Noise:
    """Estimate the model error: the deviation that the noise of the readings does not explain.

    Args:
        state: The arm.
        series: The readings.
        share: Degrees of freedom over number of equations [1].

    Returns:
        The model error of positions and of orientations.
    """
    none = np.zeros(0)
    position, rotation = [(none, none)], [(none, none)]  # lengths of what is left, variances of readings
    for one in series:
        left, m, seen = np.linalg.norm(residuals(state, one), axis=1).T, len(one.markers), one.seen
        variance = np.full((one.rows, m), one.sigma**2)
        if one.precision is not None:
            precision = np.where(seen[..., None, None], one.precision, np.eye(3))
            variance = np.trace(np.linalg.inv(precision), axis1=2, axis2=3) / 3
        position.append((left[:, :m][seen], variance[seen]))
        if one.sigma_rotation is not None:
            rotation.append((left[one.turned, m], np.full(one.turned.sum(), one.sigma_rotation**2)))
    found = []
    for kind in (position, rotation):
        length, own = (np.concatenate(part)[:, None] for part in zip(*kind, strict=True))
        found.append(READINGS.scatter(length, own, share))
    return Noise(found[0], found[1])


def single_reading_noise(noise: Noise, expected: tuple[Array, float]) -> Noise:
    """Convert the noise of combined readings to that of a reading that is alone in its pose.

    A factor below 1 was estimated from means of k readings, whose variance is factor^2 (sigma^2 + k s^2). It
    first lowers the model error s; only if s = 0 is still too much does it lower the noise of the readings.

    Args:
        noise: Noise of the combined readings.
        expected: Mean variances sigma^2 and number k of readings behind a mean, from `expected_of`.

    Returns:
        The noise of single readings.
    """
    own, k = expected
    factor, opened = noise.factor.copy(), [noise.open_position, noise.open_rotation]
    for kind in np.flatnonzero((factor[:2] < 1) & (own > 0)):
        whole = factor[kind] ** 2 * (own[kind] + k * opened[kind] ** 2)
        opened[kind] = float(np.sqrt(max(0.0, whole - own[kind]) / k))
        factor[kind] = np.sqrt(whole / (own[kind] + k * opened[kind] ** 2))
    return Noise(opened[0], opened[1], factor)


def expected_of(series: Sequence[Series]) -> tuple[Array, float]:
    """Average the stated variances of positions and orientations, and the number of combined readings.

    Args:
        series: The readings.

    Returns:
        Variances, (2,) [m^2, rad^2], and the number of readings behind a mean [1].
    """
    behind = [multiplicity(repeated_rows(one), one.rows) for one in series]
    position = np.mean([one.sigma**2 for one in series])
    turns = [one.sigma_rotation**2 for one in series if one.sigma_rotation is not None]
    k = float(np.concatenate([x[x > 0] for x in behind]).mean())
    return np.array([position, np.mean(turns) if turns else 0.0]), k


def whitening_units(expected: tuple[Array, float], noise: Noise) -> Array:
    """Compute the standard deviations of whitened equations, sqrt(sigma^2 + k s^2) or sigma, of every kind.

    Args:
        expected: Mean variances sigma^2 and number k of readings behind a mean, from `expected_of`.
        noise: The model error s.

    Returns:
        (kinds,) [m, rad].
    """
    own, k = expected
    opened = np.array([noise.open_position, noise.open_rotation])
    return np.asarray(np.sqrt(np.r_[own + k * opened**2, own]))


def distance(before: ArmState, after: ArmState, series: Sequence[Series]) -> float:
    """Compute how far the targets moved between two states.

    Args:
        before: The first state.
        after: The second state.
        series: Readings whose poses are compared.

    Returns:
        Root mean square distance [m].
    """
    total, count = 0.0, 0
    for one in series:
        m = len(one.markers)
        d = residuals(before, one)[:m] - residuals(after, one)[:m]
        total, count = total + float((d**2).sum()), count + int(one.seen.sum())
    return float(np.sqrt(total / max(count, 1)))


OUTLIER_WEIGHT = 0.5
"""Robust weight below which a reading is an outlier [1]."""


@dataclass(frozen=True)
class Outliers:
    """Summarise positions whose robust weight is below `OUTLIER_WEIGHT`, and the worst of them."""

    count: int  #: Number of outliers.
    of: int  #: Number of positions that were read.
    series: str  #: Series of the worst outlier.
    row: int  #: Its row's identifier.
    distance: float  #: Its distance from the model [m].


def outliers(state: ArmState, series: Sequence[Series], pulls: Sequence[Array]) -> Outliers | None:
    """Find positions whose robust weight is below one half.

    Args:
        state: The calibrated arm.
        series: The readings.
        pulls: Robust weight of each reading, for every series (s, rows) [1].

    Returns:
        Their number and the worst of them; None if there are none.
    """
    found, count = [], 0
    for one, counts in zip(series, pulls, strict=True):
        m = len(one.markers)
        wild = (counts[:m].T < OUTLIER_WEIGHT) & one.seen
        far = np.where(wild, np.linalg.norm(residuals(state, one)[:m], axis=1).T, 0.0).max(axis=1)
        k, count = int(far.argmax()), count + int(wild.sum())
        found.append((float(far[k]), one.name, int(one.row[k])))
    if not count:
        return None
    distance, name, row = max(found)
    return Outliers(count, sum(int(one.seen.sum()) for one in series), name, row, distance)
