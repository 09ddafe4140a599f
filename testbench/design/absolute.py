"""Absolute readings as a plan sees them: frame, mount, geometry, joint errors, compliances are unknown.

Unknowns are in units of what the prior expects, x ~ N(e, 1). Each pose is read under every load without a
move in between. Joint errors that the model does not explain are one more noise, common to all readings of a
pose. So the covariance of a pose's readings is that of the tracker plus J diag(rest^2) J^T. `candidate_set`
turns this into a problem for `planning`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from testbench.data.dataset import Series
from testbench.design.planning import CandidateSet
from testbench.design.rows import SCALE_UNCERTAINTY, DesignProblem, row_products
from testbench.errors import Array, BenchError
from testbench.identify.absolute.state import ArmState, Unknowns, series_equilibrium
from testbench.identify.metric import PriorScaling, Strength, precision_root
from testbench.identify.rows import series_rows
from testbench.model.vjm import chain, translation_rows

POSES_AT_ONCE = 250  #: Poses whose rows of all unknowns are in memory at a time.
FRAME_DEVIATION = 1.0
"""Standard deviation that is expected of frames and mounts, which a few poses find [m, rad]."""
LITTLE_INFORMATION = 1e-3
"""Information of a plan of average poses, over the prior's, below which a direction counts as unseen [1]."""
LITTLE_INFORMATION_LATER = 0.5
"""Value of `LITTLE_INFORMATION` for a plan that follows earlier readings [1].

It leaves about a quarter of a thousand unknowns: those about which further readings tell enough.
"""


@dataclass(frozen=True)
class JointUnknowns:
    """Describe all unknowns of an absolute calibration together, and how every pose is read."""

    unknowns: Unknowns  #: Layout of the unknowns.
    state: ArmState  #: Arm with its unknowns at their expected values.
    L: Array  #: Unknowns per unit x of what the prior expects, (size, r).
    #: Readings of one pose: a row per load in the order of reading, with targets and noise.
    pose: Series
    unmodelled: Array  #: Standard deviation of each joint's error beyond the model, (n,) [rad, m].
    #: Threshold of information over the prior's, see `LITTLE_INFORMATION` [1].
    min_information: float = LITTLE_INFORMATION

    @property
    def loads(self) -> int:
        """Return the number of readings per pose, one under each load."""
        return self.pose.rows


def expected_root(
    unknowns: Unknowns, metric: PriorScaling, uncertainty: float, geometry: float, error: float
) -> Array:
    """Build a root of the prior's covariance: all unknowns per unit of what is expected of them.

    Args:
        unknowns: Layout of the unknowns: frames and mounts, geometry, joint errors, compliances.
        metric: Metric of the compliances' prior.
        uncertainty: Relative uncertainty of that prior [1].
        geometry: Standard deviation of a geometric error along an axis and about one [m, rad].
        error: Standard deviation of a coefficient of the joints' errors [rad, m].

    Returns:
        L with unknowns = L x, block diagonal, (size, size).
    """
    d = np.full(unknowns.starts["elastic"], FRAME_DEVIATION)
    d[unknowns.columns("geometry")], d[unknowns.columns("errors")] = geometry, error
    B, _ = precision_root(metric, Strength(uncertainty, SCALE_UNCERTAINTY))
    return np.asarray(block_diag(np.diag(d), np.linalg.solve(B.T, metric.L.T).T))


def series_at(union: JointUnknowns, q: Array) -> Series:
    """Build the series of readings that poses would give: one row per pose and load, positions still zero.

    Args:
        union: The unknowns and how a pose is read.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        The series, poses times loads rows.
    """
    series, loads = union.pose, union.loads
    rows = len(q) * loads
    return replace(
        series,
        row=np.arange(rows),
        pose=np.arange(rows) // loads,
        q=np.repeat(q, loads, axis=0),
        wrench=np.tile(series.wrench, (len(q), 1)),
        point=np.tile(series.point, (len(q), 1)),
        position=np.zeros((rows, len(series.markers), 3)),
        rotation=None if series.rotation is None else np.tile(np.eye(3), (rows, 1, 1)),
    )


def measured_rows(union: JointUnknowns, q: Array, onto: Array | None = None) -> Array:
    """Compute whitened rows of poses per unit of x.

    Args:
        union: The unknowns and how a pose is read.
        q: Actuated joints, (poses, n) [rad, m].
        onto: Coordinates in place of x, x = onto @ a, (size, r); None for x itself.

    Returns:
        Rows in standard deviations of the readings, (poses, k, size) or (poses, k, r) [1].
    """
    rows = (_whitened(union, batch) for batch in _batches(q))
    if onto is None:
        return np.concatenate([whitened @ union.L for whitened in rows])
    scale = union.L @ onto
    return np.concatenate([row_products(whitened, scale) for whitened in rows])


def position_rows(union: JointUnknowns, q: Array) -> Array:
    """Compute positions of all targets per unit of x, under one load after the other.

    Args:
        union: The unknowns and how a pose is read.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        Rows, (poses, 3 loads m, r) [m].
    """
    m = len(union.pose.markers)

    def rows(batch: Array) -> Array:
        A = series_rows(union.unknowns, union.state, series_at(union, batch))[:m, :, :-1]
        return np.asarray(A.transpose(3, 0, 1, 2).reshape(len(batch), -1, A.shape[2]) @ union.L)

    return np.concatenate([rows(batch) for batch in _batches(q)])


def realignment_loss(union: JointUnknowns, rows: Array) -> float:
    """Compute the RMS error of positions before any pose is read, with frame and mount fitted to them.

    Args:
        union: The unknowns; frame and mount are its first columns.
        rows: Positions per unit of x, such as `position_rows`, (poses, 3 loads m, r) [m].

    Returns:
        RMS distance of a target from its prediction [m].
    """
    first = union.unknowns.starts["geometry"]
    A = rows.reshape(-1, rows.shape[2])
    # remove what a frame and a mount, fitted to these positions, would take up
    Q = np.linalg.svd(A[:, :first], full_matrices=False)[0]
    arm = A[:, first:] - Q @ (Q.T @ A[:, first:])
    return float(np.sqrt(3 * np.square(arm).sum() / len(arm)))


def unmodelled_joint_error(union: JointUnknowns, q: Array) -> Array:
    """Compute the RMS displacement of targets by joint errors beyond the model, in every pose.

    Args:
        union: The unknowns; `unmodelled` holds the joints' standard deviations.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        RMS distance over the targets, (poses,) [m].
    """
    m = len(union.pose.markers)
    return np.asarray(np.sqrt(np.square(_joint_rows(union, q)[:, : 3 * m]).sum(axis=(1, 2)) / m))


def sag(union: JointUnknowns, q: Array) -> Array:
    """Compute the RMS displacement of targets by own weight and the last load, at the expected compliances.

    Args:
        union: The unknowns and where they are expected.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        RMS distance over the targets, (poses,) [m].
    """
    series, state = series_at(union, q), union.state
    rigid = replace(state, C_theta=np.zeros_like(state.C_theta))
    points = state.mount(series).points
    bent, straight = (
        series_equilibrium(arm_state, series).chain.points(points) for arm_state in (state, rigid)
    )
    moved = np.square(bent - straight).sum(axis=2).mean(axis=1)
    return np.asarray(np.sqrt(moved.reshape(len(q), -1)[:, -1]))


def candidate_set(union: JointUnknowns, q: Array, poses: int) -> CandidateSet:
    """Make poses the candidates of a plan, in the directions that such a plan can see.

    A direction counts as seen where `poses` average candidates tell more than `union.min_information` of it.

    Args:
        union: The unknowns and how a pose is read.
        q: Actuated joints, (candidates, n) [rad, m].
        poses: Number of poses of the plan.

    Returns:
        The candidates, one problem for all of them.

    Raises:
        BenchError: When no direction is seen.
    """
    mean = np.zeros((union.L.shape[1],) * 2)
    for batch in _batches(q):
        A = measured_rows(union, batch).reshape(-1, len(mean))
        mean += A.T @ A / len(q)
    # directions in which `poses` average candidates tell more than the threshold
    values, V = np.linalg.eigh(mean)
    seen = poses * values > union.min_information
    if not seen.any():
        raise BenchError("candidates: expected poses that move a target")
    lift, rest = V[:, seen], V[:, ~seen]
    rows = np.concatenate([measured_rows(union, batch) @ lift for batch in _batches(q)])
    problem = DesignProblem(rows, np.eye(lift.shape[1]), lift, rest @ rest.T, np.zeros((len(V), 0)))
    return CandidateSet(q, np.zeros(len(q), dtype=int), problem)


def information_of(union: JointUnknowns, q: Array) -> Array:
    """Compute the information matrix of readings in some poses, without a prior.

    Args:
        union: The unknowns and how a pose is read.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        Sum of A^T A of the whitened rows A per unit of the unknowns, (size, size).
    """
    rows = (_whitened(union, batch).reshape(-1, union.unknowns.size) for batch in _batches(q))
    return np.asarray(sum(A.T @ A for A in rows))


def _batches(q: Array) -> Iterator[Array]:
    yield from np.array_split(q, max(1, -(-len(q) // POSES_AT_ONCE)))


def _whitened(union: JointUnknowns, q: Array) -> Array:
    """Compute whitened rows of poses per unit of the unknowns, (poses, k, size) [1/m, 1/rad].

    The covariance of a pose's readings is that of the tracker plus that of joint errors beyond the model.
    """
    series = union.pose
    A = series_rows(union.unknowns, union.state, series_at(union, q))[:, :, :-1]
    A = A.transpose(3, 0, 1, 2).reshape(len(q), -1, A.shape[2])
    sigma = np.full((union.loads, A.shape[1] // union.loads), series.sigma)
    sigma[:, 3 * len(series.markers) :] = series.sigma_rotation or series.sigma
    G = np.tile(_joint_rows(union, q), (1, union.loads, 1))
    root = np.linalg.cholesky(G @ G.swapaxes(1, 2) + np.diag(sigma.ravel() ** 2))
    return np.asarray(np.linalg.solve(root, A))


def _joint_rows(union: JointUnknowns, q: Array) -> Array:
    """Compute readings per unit of joint errors beyond the model, the arm rigid, (poses, 3 s, n) [m, rad].

    They do not depend on the load.
    """
    n, state = union.unknowns.vjm.arm.n_joints, union.state
    where = chain(state.vjm, q)
    J = translation_rows(where, state.mount(union.pose).points)[:, -n:]
    if union.pose.rotation is not None:
        J = np.concatenate([J, where.J_theta[3:, -n:]])
    return np.asarray(J.transpose(2, 0, 1) * union.unmodelled)
