"""Absolute readings as a plan sees them: frame, mount, geometry, joint errors and compliances, all unknown.

Unknowns are in units of what is expected of them, x ~ N(e, 1). A pose is read under every load without a move
in between. What its joints do beyond the model is one more noise, common to the readings of a pose: their
covariance is that of the tracker and J diag(rest^2) J^T.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from testbench.data.series import Series
from testbench.design.planning import CandidateSet
from testbench.design.rows import SCALE_UNCERTAINTY, Problem
from testbench.errors import Array, BenchError
from testbench.identify.absolute.state import State, forward
from testbench.identify.absolute.unknowns import Unknowns
from testbench.identify.metric import Metric, precision_root
from testbench.identify.prior import Strength
from testbench.identify.rows import rows_of
from testbench.model.vjm import chain, translation_rows

BATCH = 250  #: Poses whose rows of all unknowns are in memory at a time.
LOOSE = 1.0
"""Standard deviation that is expected of frames and mounts, which a few poses find [m, rad]."""
LITTLE = 1e-3  #: Information of a plan of average poses, over the prior's, below which nothing is seen [1].
LITTLE_MORE = 0.5
"""The same after other readings: a quarter of a thousand unknowns are left, those that more of them tell."""


@dataclass(frozen=True)
class Union:
    """What is unknown, and how every pose is read."""

    unknowns: Unknowns
    state: State  #: Where the unknowns are expected.
    L: Array  #: Unknowns per unit of what is expected of them, (size, r).
    #: One pose: a row a load, in the order of reading; its targets and its noise.
    pose: Series
    rest: Array  #: What each joint does beyond the model, standard deviation, (n,) [rad, m].
    little: float = LITTLE  #: Information of a plan of average poses, as `LITTLE`.

    @property
    def loads(self) -> int:
        """Readings of a pose."""
        return self.pose.rows


def expected_root(
    unknowns: Unknowns, metric: Metric, uncertainty: float, geometry: float, error: float
) -> Array:
    """Unknowns per unit of what is expected of them, (size, size): a root of the prior's covariance.

    Args:
        unknowns: What is unknown.
        metric: Of the compliances' prior.
        uncertainty: Of it, relative [1].
        geometry: Standard deviation of an error of geometry along an axis and about one [m, rad].
        error: Of a coefficient of the joints' errors [rad, m].
    """
    d = np.full(unknowns.starts["elastic"], LOOSE)
    d[unknowns.columns("geometry")], d[unknowns.columns("errors")] = geometry, error
    B, _ = precision_root(metric, Strength(uncertainty, SCALE_UNCERTAINTY))
    return np.asarray(block_diag(np.diag(d), np.linalg.solve(B.T, metric.L.T).T))


def at(union: Union, q: Array) -> Series:
    """The readings of poses, (poses, n) [rad, m], none of them taken yet: a row a pose and load."""
    one, loads = union.pose, union.loads
    rows = len(q) * loads
    return replace(
        one,
        row=np.arange(rows),
        pose=np.arange(rows) // loads,
        q=np.repeat(q, loads, axis=0),
        wrench=np.tile(one.wrench, (len(q), 1)),
        point=np.tile(one.point, (len(q), 1)),
        position=np.zeros((rows, len(one.markers), 3)),
        rotation=None if one.rotation is None else np.tile(np.eye(3), (rows, 1, 1)),
    )


def measured_rows(union: Union, q: Array) -> Array:
    """Whitened rows of poses (poses, n) [rad, m] per unit of x, (poses, k, r) [1]."""
    return np.concatenate([_whitened(union, some) @ union.L for some in _batches(q)])


def position_rows(union: Union, q: Array) -> Array:
    """Positions under one load after the other per unit of x, (poses, 3 loads m, r) [m]."""
    m = len(union.pose.markers)

    def rows(some: Array) -> Array:
        A = rows_of(union.unknowns, union.state, at(union, some))[:m, :, :-1]
        return np.asarray(A.transpose(3, 0, 1, 2).reshape(len(some), -1, A.shape[2]) @ union.L)

    return np.concatenate([rows(some) for some in _batches(q)])


def realigned(union: Union, rows: Array) -> float:
    """RMS error of `position_rows` before any of the poses is read, frame and mount fitted to them [m]."""
    first = union.unknowns.starts["geometry"]
    A = rows.reshape(-1, rows.shape[2])
    Q = np.linalg.svd(A[:, :first], full_matrices=False)[0]
    arm = A[:, first:] - Q @ (Q.T @ A[:, first:])
    return float(np.sqrt(3 * np.square(arm).sum() / len(arm)))


def joint_rest(union: Union, q: Array) -> Array:
    """RMS distance that targets are off by what joints do beyond the model, (poses,) [m]."""
    m = len(union.pose.markers)
    return np.asarray(np.sqrt(np.square(_joint_rows(union, q)[:, : 3 * m]).sum(axis=(1, 2)) / m))


def sag(union: Union, q: Array) -> Array:
    """RMS distance that own weight and the last load are expected to move targets, (poses,) [m]."""
    series, state = at(union, q), union.state
    rigid = replace(state, C_theta=np.zeros_like(state.C_theta))
    points = state.mount(series).points
    bent, straight = (forward(one, series).where.points(points) for one in (state, rigid))
    moved = np.square(bent - straight).sum(axis=2).mean(axis=1)
    return np.asarray(np.sqrt(moved.reshape(len(q), -1)[:, -1]))


def candidate_set(union: Union, q: Array, poses: int) -> CandidateSet:
    """Poses (candidates, n) [rad, m] to choose so many from, in the directions that such a plan can see."""
    mean = np.zeros((union.L.shape[1],) * 2)
    for some in _batches(q):
        A = measured_rows(union, some).reshape(-1, len(mean))
        mean += A.T @ A / len(q)
    values, V = np.linalg.eigh(mean)
    seen = poses * values > union.little
    if not seen.any():
        raise BenchError("candidates: expected poses that move a target")
    lift, rest = V[:, seen], V[:, ~seen]
    rows = np.concatenate([measured_rows(union, some) @ lift for some in _batches(q)])
    problem = Problem(rows, np.eye(lift.shape[1]), lift, rest @ rest.T, np.zeros((len(V), 0)))
    return CandidateSet(q, np.zeros(len(q), dtype=int), problem)


def information_of(union: Union, q: Array) -> Array:
    """What readings in poses (poses, n) [rad, m] tell of the unknowns, no prior, (size, size)."""
    rows = (_whitened(union, some).reshape(-1, union.unknowns.size) for some in _batches(q))
    return np.asarray(sum(A.T @ A for A in rows))


def _batches(q: Array) -> Iterator[Array]:
    yield from np.array_split(q, max(1, -(-len(q) // BATCH)))


def _whitened(union: Union, q: Array) -> Array:
    """Rows over the root of their covariance, (poses, k, size) [1/m, 1/rad]."""
    one = union.pose
    A = rows_of(union.unknowns, union.state, at(union, q))[:, :, :-1]
    A = A.transpose(3, 0, 1, 2).reshape(len(q), -1, A.shape[2])
    sigma = np.full((union.loads, A.shape[1] // union.loads), one.sigma)
    sigma[:, 3 * len(one.markers) :] = one.sigma_rotation or one.sigma
    G = np.tile(_joint_rows(union, q), (1, union.loads, 1))
    root = np.linalg.cholesky(G @ G.swapaxes(1, 2) + np.diag(sigma.ravel() ** 2))
    return np.asarray(np.linalg.solve(root, A))


def _joint_rows(union: Union, q: Array) -> Array:
    """Readings of poses per unit of what joints do beyond the model, the arm rigid, (poses, 3 s, n) [m, rad].

    Under every load they are the same.
    """
    n, state = union.unknowns.vjm.arm.n_joints, union.state
    where = chain(state.vjm, q)
    J = translation_rows(where, state.mount(union.pose).points)[:, -n:]
    if union.pose.rotation is not None:
        J = np.concatenate([J, where.J_theta[3:, -n:]])
    return np.asarray(J.transpose(2, 0, 1) * union.rest)
