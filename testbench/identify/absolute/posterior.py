"""Where a calibrated arm has its targets in a series, and how sure it is: of the arm, its frame and mount.

The frame and mount of a new series are fitted to a few of its rows, all else held. What the arm is unsure of
shows in these rows too; so much of it as a frame can take up does no harm elsewhere.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from testbench.data.series import Series, select_rows
from testbench.errors import Array, BenchError
from testbench.identify.absolute.align import aligned
from testbench.identify.absolute.evidence import Choice
from testbench.identify.absolute.inner import moved_frame, moved_mount
from testbench.identify.absolute.noise import Noise
from testbench.identify.absolute.rows import rows_of
from testbench.identify.absolute.scatter import pulls_of, residuals
from testbench.identify.absolute.state import State
from testbench.identify.absolute.unknowns import Unknowns, unknowns_of
from testbench.identify.registration import POSES
from testbench.model.structure import Ids

STEP, MOST_STEPS = 1e-9, 20  #: A step of a frame below this is the last [m, rad].
BATCH = 500  #: Rows whose columns are in memory at a time.


@dataclass(frozen=True)
class Belief:
    """What is known of an arm, whatever series it was learnt from."""

    own: Choice  #: The unknowns of the calibration.
    root: Array  #: Triangular root of the precision of those of the arm, (a, a).
    noise: Noise  #: How far readings scatter.

    @property
    def columns(self) -> Ids:
        """Those of the arm among all unknowns behind the frames and mounts, (a,)."""
        first = self.own.unknowns.starts["geometry"]
        return np.asarray(self.own.columns[self.own.columns >= first] - first)


@dataclass(frozen=True)
class Placed:
    """A series whose frame and mount are known."""

    state: State  #: With the frame and the mount.
    rows: Ids  #: Places of the rows that told them; none where the calibration had.
    taken: Array  #: How far frame and mount go with the unknowns of the arm, (f, a).
    covariance: Array  #: Of frame and mount by the scatter of these rows, (f, f).


@dataclass(frozen=True)
class Predicted:
    """Positions of targets by the model beside those read, and how sure it is."""

    left: Array  #: Reading minus model in base axes, (rows, m, 3) [m].
    covariance: Array  #: Of that, with the scatter of the reading, (rows, m, 3, 3) [m^2].


def evenly(series: Series, poses: int) -> Ids:
    """Places of evenly spaced rows, of those that were read."""
    seen = np.flatnonzero(series.seen.any(axis=1))
    if len(seen) < poses or poses < POSES:
        raise BenchError(
            f"{series.name}: expected at least {max(POSES, poses)} rows for its frame and target, got "
            f"{min(len(seen), poses)}"
        )
    return np.asarray(seen[np.unique(np.linspace(0, len(seen) - 1, poses).round().astype(int))])


def place(state: State, belief: Belief, series: Series, rows: Ids) -> Placed:
    """Frame and mount of a series by some of its rows, by Gauss-Newton; all else is held.

    Raises:
        BenchError: When these rows do not tell them.
    """
    some = select_rows(series, rows)
    state = aligned(without(state, some), (some,))
    unknowns = _unknowns(belief, some)
    f = unknowns.starts["geometry"]
    for _ in range(MOST_STEPS):
        F, M, y = _weighed(unknowns, belief, state, some)
        root = _root(F, some)
        step = solve_triangular(root, solve_triangular(root, F.T @ y, trans="T"))
        state = replace(
            state,
            frames={**state.frames, some.frame: moved_frame(state.frame(some), step[:6])},
            mounts={**state.mounts, some.target: moved_mount(state.mount(some), step[6:f])},
        )
        if np.abs(step).max() < STEP:
            break
    return _placed(state, rows, root, F.T @ M)


def _placed(state: State, rows: Ids, root: Array, with_arm: Array) -> Placed:
    inverse: Array = solve_triangular(root, np.eye(len(root)))
    spread = np.asarray(inverse @ inverse.T)
    return Placed(state, rows, spread @ with_arm, spread)


def known(state: State, belief: Belief, series: Series) -> Placed:
    """A series whose frame and mount the calibration found, by rows such as it has."""
    seen = np.flatnonzero(series.seen.any(axis=1))
    some = select_rows(series, seen[np.linspace(0, len(seen) - 1, min(BATCH, len(seen))).astype(int)])
    F, M, _ = _weighed(_unknowns(belief, some), belief, state, some)
    return _placed(state, np.zeros(0, dtype=int), _root(F, some), F.T @ M)


def without(state: State, series: Series) -> State:
    """The state without the frame and the mount of a series."""
    frames = {key: one for key, one in state.frames.items() if key != series.frame}
    mounts = {key: one for key, one in state.mounts.items() if key != series.target}
    return replace(state, frames=frames, mounts=mounts)


def predict(placed: Placed, belief: Belief, series: Series) -> Predicted:
    """Positions of all rows of a series."""
    unknowns, m = _unknowns(belief, series), len(series.markers)
    f = unknowns.starts["geometry"]
    told = min(f, len(placed.taken))  # positions do not depend on the turn of a target
    covariance: Array = np.zeros((series.rows, m, 3, 3))
    for first in range(0, series.rows, BATCH):
        some = slice(first, first + BATCH)
        A = rows_of(unknowns, placed.state, select_rows(series, np.arange(series.rows)[some])).A[:m]
        F, M = A[:, :, :told].transpose(3, 0, 1, 2), _arm(belief, A[:, :, f:]).transpose(3, 0, 1, 2)
        M = M - F @ placed.taken[:told]
        lines: Array = solve_triangular(belief.root, M.reshape(-1, M.shape[-1]).T, trans="T")
        white = lines.T.reshape(M.shape)
        covariance[some] = white @ white.swapaxes(2, 3) + F @ placed.covariance[:told, :told] @ F.swapaxes(
            2, 3
        )
    covariance += _scatter(belief.noise, series)
    left = residuals(placed.state, series)[:m].transpose(2, 0, 1)
    return Predicted(left, covariance)


def inside(predicted: Predicted, quantile: float = 7.8147) -> Array:
    """Which positions lie in their 95 % ellipsoid, by chi squared of three, (rows, m)."""
    solved = np.linalg.solve(predicted.covariance, predicted.left[..., None])[..., 0]
    return np.asarray((predicted.left * solved).sum(axis=-1) <= quantile)


def _unknowns(belief: Belief, series: Series) -> Unknowns:
    """The unknowns of a new series and of the arm."""
    own = belief.own.unknowns
    return unknowns_of(own.vjm, (series,), own.errors, own.structure)


def _arm(belief: Belief, A: Array) -> Array:
    """Columns of the arm that the calibration has, compliances in the metric, (s, 3, a, runs)."""
    A = A[:, :, belief.columns]
    if belief.own.elastic is None:
        return A
    L = belief.own.elastic.L
    first = A.shape[2] - len(L)
    return np.concatenate([A[:, :, :first], np.einsum("sxpr,pe->sxer", A[:, :, first:], L)], axis=2)


def _weighed(unknowns: Unknowns, belief: Belief, state: State, series: Series) -> tuple[Array, Array, Array]:
    """Whitened equations: columns of frame and mount, (e, f), of the arm, (e, a), and what is left, (e,)."""
    m, f = len(series.markers), unknowns.starts["geometry"]
    rows = rows_of(unknowns, state, series)
    pull = pulls_of(state, series, belief.noise)
    deviation = np.sqrt(np.trace(_scatter(belief.noise, series), axis1=2, axis2=3) / 3).T
    if series.sigma_rotation is not None:
        turn = np.hypot(series.sigma_rotation, belief.noise.open_rotation) * belief.noise.factor[1]
        deviation = np.concatenate([deviation, np.full((1, series.rows), turn)])
    w = (pull / deviation)[:, None]
    every = np.concatenate([rows.A[:, :, :f], _arm(belief, rows.A[:, :, f:])], axis=2) * w[:, :, None]
    lines = every.transpose(0, 1, 3, 2).reshape(-1, every.shape[2])
    assert len(every) == len(deviation) >= m
    return lines[:, :f], lines[:, f:], (rows.left * w).ravel()


def _root(F: Array, series: Series) -> Array:
    """Triangular factor of the columns of frame and mount."""
    R = np.asarray(np.linalg.qr(F, mode="r"))
    full = len(R) == F.shape[1] and (np.abs(np.diag(R)) > 1e-9 * np.linalg.norm(F, axis=0)).all()
    if not full:
        raise BenchError(f"{series.name}: its rows leave frame or target open; expected poses that turn more")
    return R


def _scatter(noise: Noise, series: Series) -> Array:
    """Covariance of a reading about the model, (rows, m, 3, 3) [m^2]."""
    own = np.full((series.rows, len(series.markers)), series.sigma**2)
    if series.precision is not None:
        precision = np.where(series.seen[..., None, None], series.precision, np.eye(3))
        own = np.trace(np.linalg.inv(precision), axis1=2, axis2=3) / 3
    variance = (own + noise.open_position**2) * noise.factor[0] ** 2
    return np.asarray(variance[..., None, None] * np.eye(3))
