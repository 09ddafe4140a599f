"""Residuals of readings, their noise about a state, and outliers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.data.series import Series, select_rows
from testbench.errors import Array
from testbench.identify.absolute.noise import Noise, multiplicity, repeated_rows, weights
from testbench.identify.absolute.state import ROWS_AT_ONCE, ArmState, series_equilibrium
from testbench.identify.robust_loss import READINGS
from testbench.identify.rows import series_residuals


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
