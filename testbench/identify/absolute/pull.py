"""What poses that were not read would tell: each joint turned by itself, and all of them anywhere."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Ids
from testbench.data.series import Series, select_rows
from testbench.errors import Array
from testbench.identify.absolute.state import State
from testbench.identify.absolute.unknowns import Unknowns
from testbench.identify.rows import rows_of

POSES = 40  #: Further rows in which a joint is turned.
AMPLE = 2  #: Equations of poses anywhere, over the number of unknowns.


@dataclass(frozen=True)
class Pull:
    """Information that further readings would add."""

    turned: Array  #: Of rows as those read, but one joint turned through its range, (n, size, size).
    everywhere: Array  #: Of poses all over the joints' ranges, more than there are unknowns, (size, size).
    rigid: Array  #: The same were the arm as drawn and rigid, which says what is structural in geometry.


def pull_of(
    unknowns: Unknowns,
    state: State,
    series: tuple[Series, ...],
    tells: Callable[[Series], Array] | None = None,
) -> Pull:
    """What would be added to some series, under their loads.

    Args:
        unknowns: What is unknown.
        state: Where it is expected.
        series: What was read, or is to be.
        tells: Information of any series, no prior, (size, size); None for `information` at the state.
    """
    lower, upper = unknowns.vjm.arm.limits
    rng = np.random.Generator(np.random.Philox(0))
    some = [(one, _spread(one.rows, -(-POSES // len(series)))) for one in series]
    told = tells or (lambda one: information(unknowns, state, one))

    def turned(j: int) -> Array:
        total = np.zeros((unknowns.size,) * 2)
        for one, rows in some:
            q = one.q[rows].copy()
            q[:, j] = _stratified(len(q), rng) * (upper[j] - lower[j]) + lower[j]
            total += told(_moved(one, rows, q))
        return total

    everywhere = [_anywhere(unknowns, one, len(series), rng) for one in series]
    drawn = replace(
        state,
        theta_0=np.zeros_like(state.theta_0),
        C_theta=np.zeros_like(state.C_theta),
        n=np.zeros_like(state.n),
    )
    rigid = np.sum([information(unknowns, drawn, one) for one in everywhere], axis=0)
    every = np.stack([turned(j) for j in range(len(lower))])
    return Pull(every, np.sum([told(one) for one in everywhere], axis=0), rigid)


def _anywhere(unknowns: Unknowns, series: Series, of: int, rng: np.random.Generator) -> Series:
    """A series of so many in poses all over, under its loads."""
    lower, upper = unknowns.vjm.arm.limits
    count = -(-AMPLE * unknowns.size // (3 * len(series.markers) * of))
    return _moved(series, np.arange(count) % series.rows, rng.uniform(lower, upper, (count, len(lower))))


def information(unknowns: Unknowns, state: State, series: Series) -> Array:
    """What a series tells of the unknowns by its positions and orientations, no prior, (size, size)."""
    m = len(series.markers)
    A = rows_of(unknowns, state, series)[:, :, :-1]
    A[:m] /= series.sigma
    if series.sigma_rotation is not None:
        A[m:] /= series.sigma_rotation
    flat = A.transpose(2, 0, 1, 3).reshape(unknowns.size, -1)
    return np.asarray(flat @ flat.T)


def _moved(series: Series, rows: Ids, q: Array) -> Series:
    """Rows of a series in other poses, every target read; (count,) places and (count, n) [rad, m]."""
    plain = replace(
        series,
        precision=None,
        rotation=None if series.rotation is None else np.tile(np.eye(3), (series.rows, 1, 1)),
    )
    return replace(select_rows(plain, rows), q=q)


def _spread(rows: int, count: int) -> Ids:
    """So many places among rows, or all of them, evenly spaced."""
    return np.linspace(0, rows - 1, min(rows, count)).round().astype(int)


def _stratified(count: int, rng: np.random.Generator) -> Array:
    """Numbers from 0 to 1, one in each of so many equal parts, in random order, (count,)."""
    return (rng.permutation(count) + rng.random(count)) / count
