"""How far readings are from a state, how they scatter about it, and which of them pull less."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.data.series import Series
from testbench.errors import Array
from testbench.identify.absolute.noise import KINDS, Noise, lengths, plan_of, pull, roots, spread
from testbench.identify.absolute.rows import left_over
from testbench.identify.absolute.state import State, tell


def residuals(state: State, series: Series) -> Array:
    """Readings minus model in base axes, (s, 3, rows) [m, rad]; zero where nothing was read."""
    return left_over(state, series, tell(state, series.q, series.wrench, series.point))


def pulls_of(state: State, series: Series, noise: Noise) -> Array:
    """How much every reading counts, by its own residual, (s, rows)."""
    alone = replace(series, pose=np.arange(series.rows))
    W, _ = roots(alone, noise, plan_of(alone), state.frame(series).rotation)
    return pull(lengths(np.einsum("srxy,syr->sxr", W, residuals(state, series))))


def scatter(state: State, series: Sequence[Series], share: float) -> Noise:
    """What a state leaves open beside the scatter of the readings.

    Args:
        state: The arm.
        series: The readings.
        share: Equations less what unknowns spend, over all equations [1].
    """
    position, rotation = [], []
    for one in series:
        left = residuals(state, one)
        m = len(one.markers)
        variance = np.full((one.rows, m), one.sigma**2)
        if one.precision is not None:
            own = np.linalg.inv(np.where(one.seen[..., None, None], one.precision, np.eye(3)))
            variance = np.trace(own, axis1=2, axis2=3) / 3
        seen = one.seen
        position.append((np.linalg.norm(left[:m], axis=1).T[seen], variance[seen]))
        if one.sigma_rotation is not None:
            turned = np.linalg.norm(left[m], axis=0)[one.turned]
            rotation.append((turned, np.full(len(turned), one.sigma_rotation**2)))
    found = []
    for kind in (position, rotation):
        length, own = (np.concatenate([part[k] for part in kind]) if kind else np.zeros(0) for k in (0, 1))
        found.append(spread(length, own, share))
    return Noise(found[0], found[1], np.ones(len(KINDS)))


def unit(series: Sequence[Series], noise: Noise) -> float:
    """Standard deviation of a whitened position [m]."""
    sigma = np.sqrt(np.mean([one.sigma**2 for one in series]))
    return float(np.hypot(sigma, noise.open_position))


def distance(before: State, after: State, series: Sequence[Series]) -> float:
    """How far targets are from where they were, root mean square [m]."""
    total, count = 0.0, 0
    for one in series:
        m = len(one.markers)
        d = residuals(before, one)[:m] - residuals(after, one)[:m]
        total, count = total + float((d**2).sum()), count + int(one.seen.sum())
    return float(np.sqrt(total / max(count, 1)))
