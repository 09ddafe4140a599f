"""Design of an absolute calibration: frame, mount, geometry, joint errors and compliances are unknown.

Unknowns are in units of their prior, x ~ N(e, 1). Each pose is read under every load without a move in
between. Joint errors beyond the model are one more noise, common to all readings of a pose: the covariance of
a pose's readings is that of the tracker plus J diag(unmodelled^2) J^T. `candidate_set` makes a problem for
`planning` from this.

Instead of a tracker, instruments may read distances from fixed points and heights over planes. A pose is
then of one kind: all fixed points, and at most one plane, are read in it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from testbench.data.dataset import Series
from testbench.design.planning import CandidateSet
from testbench.design.rows import SCALE_UNCERTAINTY, DesignProblem, row_products
from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.state import ArmState, Unknowns, series_equilibrium
from testbench.identify.equations import distance_directions, series_equations
from testbench.identify.prior import PriorScaling, PriorUncertainty, prior_rows
from testbench.model.vjm import evaluate_chain, translational_jacobian

POSES_AT_ONCE = 250  #: Poses whose rows of all unknowns are in memory at a time.
FRAME_DEVIATION = 1.0
"""Prior standard deviation of tracker frames and mounts, so wide that a few poses determine them [m, rad]."""
MIN_INFORMATION_OVER_PRIOR = 1e-3
"""Information of a plan of average poses over the prior's, from which a direction is observable [1]."""
MIN_FOLLOW_UP_INFORMATION_OVER_PRIOR = 0.5
"""Value of `MIN_INFORMATION_OVER_PRIOR` for a plan that follows earlier readings [1].

It leaves about a quarter of a thousand unknowns: those on which further readings add enough information.
"""


@dataclass(frozen=True)
class AbsoluteSetup:
    """Describe the unknowns of an absolute calibration with their prior, and how every pose is read."""

    unknowns: Unknowns  #: Layout of the unknowns, `size` numbers.
    state: ArmState  #: Arm with its unknowns at their expected values.
    L: Array  #: Unknowns per unit of x, with x ~ N(e, 1) by the prior, (size, r).
    #: Readings of positions in one pose: one row per load in the order of reading, with targets and noise.
    pose_readings: Series
    #: Standard deviation of each joint's error that the unknowns do not model, (n,) [rad, m].
    unmodelled_joint_deviation: Array
    #: Information over the prior's, below which a direction counts as unobservable [1], see
    #: `MIN_INFORMATION_OVER_PRIOR`.
    min_information: float = MIN_INFORMATION_OVER_PRIOR
    #: Distances and heights that are read in place of positions in one pose, each of one target, for every
    #: kind of pose; empty if positions are read.
    readings_by_kind: tuple[tuple[Series, ...], ...] = ()


def prior_covariance_root(
    unknowns: Unknowns,
    scaling: PriorScaling,
    uncertainty: float,
    geometry_deviation: float,
    joint_error_deviation: float,
) -> Array:
    """Build a root L of the prior covariance L L^T of all unknowns of an absolute calibration.

    Args:
        unknowns: Layout of the unknowns: frames and mounts, geometry, joint errors, compliances.
        scaling: Compliances in units of their prior, pi = L_C x.
        uncertainty: Relative standard deviation of the prior of the compliances [1].
        geometry_deviation: Standard deviation of a geometric error along an axis or about one [m, rad].
        joint_error_deviation: Standard deviation of a coefficient of the joints' errors [rad, m].

    Returns:
        L with unknowns = L x, block diagonal, (size, size).
    """
    d = np.full(unknowns.first_columns["elastic"], FRAME_DEVIATION)
    for name, sizes in unknowns.frame_deviations.items():
        d[unknowns.columns(f"frame {name}")] = sizes
    d[unknowns.columns("geometry")], d[unknowns.columns("errors")] = geometry_deviation, joint_error_deviation
    B, _ = prior_rows(scaling, PriorUncertainty(uncertainty, SCALE_UNCERTAINTY))
    return np.asarray(block_diag(np.diag(d), np.linalg.solve(B.T, scaling.L.T).T))


def series_in_poses(pose_readings: Series, q: Array) -> Series:
    """Build the series of readings that poses would give, all readings zero.

    Args:
        pose_readings: Readings of one pose, one row per load.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        The series, one row per pose and load.
    """
    rows, times = len(q) * pose_readings.n_rows, len(q)
    return replace(
        pose_readings,
        row_id=np.arange(rows),
        pose_id=np.arange(rows) // pose_readings.n_rows,
        q=np.repeat(q, pose_readings.n_rows, axis=0),
        wrench=np.tile(pose_readings.wrench, (times, 1)),
        point=np.tile(pose_readings.point, (times, 1)),
        position=np.zeros((rows, len(pose_readings.markers), 3)),
        precision=None
        if pose_readings.precision is None
        else np.tile(pose_readings.precision, (times, 1, 1, 1)),
        rotation=None if pose_readings.rotation is None else np.tile(np.eye(3), (rows, 1, 1)),
        distance=None if pose_readings.distance is None else np.tile(pose_readings.distance, (times, 1)),
    )


def whitened_rows(
    setup: AbsoluteSetup, q: Array, basis: Array | None = None, pose_kind: Ids | None = None
) -> Array:
    """Compute whitened rows of all readings in some poses per unit of the unknowns x.

    Args:
        setup: Unknowns, and readings of a pose.
        q: Actuated joints, (poses, n) [rad, m].
        basis: Matrix of coordinates a in place of x, x = basis @ a, (r, k); None for x itself.
        pose_kind: Kind of every pose, an index into `readings_by_kind`, (poses,); None if all are of the
            first.

    Returns:
        Rows in standard deviations of the readings, (poses, rows, r), or (poses, rows, k) per unit of a [1].
    """
    rows = (_whitened(setup, *batch) for batch in _batches(q, pose_kind))
    if basis is None:
        return np.concatenate([whitened @ setup.L for whitened in rows])
    scale = setup.L @ basis
    return np.concatenate([row_products(whitened, scale) for whitened in rows])


def position_rows(setup: AbsoluteSetup, q: Array) -> Array:
    """Compute the change of all target positions per unit of the unknowns x, under one load after the other.

    Positions are those in the tracker's frame. Distances and heights have no such frame: then the arm's base
    is moved so that all positions together change least.

    Args:
        setup: Unknowns, and readings of a pose.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        Changes of m targets along three axes, (poses, 3 loads m, r) [m].
    """
    A = np.concatenate([_position_changes(setup, batch) for batch, _ in _batches(q, None)])
    if setup.readings_by_kind:
        # no tracker frame: its columns give way to the motion of the base that explains most
        frame = np.arange(A.shape[2])[setup.unknowns.columns(f"frame {setup.pose_readings.frame}")][:6]
        Q = np.linalg.qr(A[:, :, frame].reshape(-1, 6))[0]
        A[:, :, frame] = 0
        flat = A.reshape(-1, A.shape[2])
        A = (flat - Q @ (Q.T @ flat)).reshape(A.shape)
    return A @ setup.L


def _position_changes(setup: AbsoluteSetup, q: Array) -> Array:
    """Compute the change of all target positions per unit of the unknowns, (poses, 3 loads m, size) [m]."""
    A = series_equations(setup.unknowns, setup.state, series_in_poses(setup.pose_readings, q))
    positions = A[: len(setup.pose_readings.markers), :, :-1]
    return np.asarray(positions.transpose(3, 0, 1, 2).reshape(len(q), -1, positions.shape[2]))


def position_scale_jacobian(setup: AbsoluteSetup, rows: Array, q: Array) -> tuple[Array, float]:
    """Compute the relative change of the size of all target positions together per unit of the unknowns x.

    Args:
        setup: Unknowns, and readings of a pose.
        rows: Change of positions per unit of x, `position_rows`, (poses, 3 loads m, r) [m].
        q: Actuated joints of these poses, (poses, n) [rad, m].

    Returns:
        Relative change of the distances between positions, (r,) [1], and the RMS distance of a position from
        the mean of all [m].
    """
    series = series_in_poses(setup.pose_readings, q)
    at = series_equilibrium(setup.state, series).chain.tool_points_in_world(setup.state.mount(series).points)
    off = at - at.reshape(-1, 3).mean(axis=0)
    return off.ravel() @ rows.reshape(-1, rows.shape[2]) / (off**2).sum(), float(
        np.sqrt((off**2).sum(axis=2).mean())
    )


def without_frame_and_mount(setup: AbsoluteSetup, rows: Array) -> Array:
    """Remove the part of position changes that a fitted tracker frame and mount would explain.

    Args:
        setup: The r unknowns, of which frame and mount are the first.
        rows: Change of the positions of m targets per unit of the unknowns, from `position_rows`,
            (poses, 3 loads m, r) [m].

    Returns:
        Change of positions beyond frame and mount, (poses, 3 loads m, r) [m].
    """
    first = setup.unknowns.first_columns["geometry"]
    A = rows.reshape(-1, rows.shape[2])
    Q = np.linalg.svd(A[:, :first], full_matrices=False)[0]
    arm = A[:, first:] - Q @ (Q.T @ A[:, first:])
    return np.column_stack([np.zeros_like(A[:, :first]), arm]).reshape(rows.shape)


def prior_error_after_alignment(setup: AbsoluteSetup, rows: Array) -> float:
    """Compute the RMS error of predicted positions by the prior alone, with frame and mount fitted.

    Args:
        setup: Unknowns, of which frame and mount are the first.
        rows: Change of positions per unit of the unknowns x, `position_rows`, (poses, 3 loads m, r) [m].

    Returns:
        RMS distance of a target from its prediction [m].
    """
    left = without_frame_and_mount(setup, rows)
    return float(np.sqrt(3 * np.square(left).sum() / left[..., 0].size))


def unmodelled_displacement(setup: AbsoluteSetup, q: Array) -> Array:
    """Compute the RMS displacement of targets by joint errors that the unknowns do not model, in every pose.

    Args:
        setup: Targets, and standard deviations of these joint errors.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        RMS distance over the targets, (poses,) [m].
    """
    m = len(setup.pose_readings.markers)
    return np.asarray(
        np.sqrt(np.square(_joint_rows(setup, setup.pose_readings, q)[:, : 3 * m]).sum(axis=(1, 2)) / m)
    )


def sag(setup: AbsoluteSetup, q: Array) -> Array:
    """Compute the RMS displacement of targets by the arm's own weight and the last load of a pose.

    Args:
        setup: Arm with its expected compliances, and readings of a pose with their loads.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        RMS distance over the targets, (poses,) [m].
    """
    series, state = series_in_poses(setup.pose_readings, q), setup.state
    rigid = replace(state, C_theta=np.zeros_like(state.C_theta))
    points = state.mount(series).points
    bent, straight = (
        series_equilibrium(arm_state, series).chain.tool_points_in_world(points)
        for arm_state in (state, rigid)
    )
    moved = np.square(bent - straight).sum(axis=2).mean(axis=1)
    return np.asarray(np.sqrt(moved.reshape(len(q), -1)[:, -1]))


def candidate_set(setup: AbsoluteSetup, q: Array, n_poses: int, pose_kind: Ids | None = None) -> CandidateSet:
    """Compute the candidates of a plan, in the directions of the unknowns that such a plan can observe.

    A direction counts as observable if the information of `n_poses` average candidates on it is more than
    `setup.min_information` times the prior's.

    Args:
        setup: Unknowns, and readings of a pose.
        q: Actuated joints, (candidates, n) [rad, m].
        n_poses: Number of poses of the plan.
        pose_kind: Kind of every pose, an index into `readings_by_kind`, (candidates,); None if all are of the
            first.

    Returns:
        The candidates; their `load_index` holds the kinds of the poses.

    Raises:
        BenchError: When no direction is observable.
    """
    # directions of x by the triangular factor of all rows: squares of the rows would lose the weak directions
    # in the rounding of the strong ones
    n = setup.L.shape[1]
    parts = (whitened_rows(setup, batch, pose_kind=own) for batch, own in _batches(q, pose_kind))
    factors = [np.linalg.qr(part.reshape(-1, n), mode="r") for part in parts]
    _, s, Vt = np.linalg.svd(np.linalg.qr(np.concatenate(factors), mode="r"))
    # those in which the information of `n_poses` average candidates exceeds the threshold
    r = int((n_poses * s**2 / len(q) > setup.min_information).sum())
    if r == 0:
        raise BenchError("candidates: expected poses that move a target")
    lift, rest = Vt[:r].T, Vt[r:].T
    rows = np.concatenate(
        [whitened_rows(setup, batch, pose_kind=own) @ lift for batch, own in _batches(q, pose_kind)]
    )
    problem = DesignProblem(rows, np.eye(r), lift, rest @ rest.T, np.zeros((n, 0)))
    return CandidateSet(q, np.zeros(len(q), dtype=int) if pose_kind is None else pose_kind, problem)


def position_information(setup: AbsoluteSetup, q: Array) -> Array:
    """Compute the information matrix of the readings in some poses, sum of A^T A, without a prior.

    A are the whitened rows of the readings per unit of the unknowns.

    Args:
        setup: Unknowns, and readings of a pose.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        Information matrix, (size, size), in inverse squared units of the unknowns.
    """
    rows = (_whitened(setup, *batch).reshape(-1, setup.unknowns.size) for batch in _batches(q, None))
    return np.asarray(sum(A.T @ A for A in rows))


def _batches(q: Array, kind: Ids | None) -> Iterator[tuple[Array, Ids | None]]:
    parts = max(1, -(-len(q) // POSES_AT_ONCE))
    kinds = [None] * parts if kind is None else np.array_split(kind, parts)
    yield from zip(np.array_split(q, parts), kinds, strict=True)


def _whitened(setup: AbsoluteSetup, q: Array, kind: Ids | None = None) -> Array:
    """Compute whitened rows of poses per unit of the unknowns, (poses, k, size) [1/m, 1/rad].

    The covariance of a pose's readings is that of the instruments plus that of joint errors beyond the model.
    """
    kinds = setup.readings_by_kind or ((setup.pose_readings,),)
    own = np.zeros(len(q), dtype=int) if kind is None else kind
    rows = np.empty((len(q), 0, setup.unknowns.size))
    for k in np.unique(own):
        at = own == k
        parts = [_read(setup, one, q[at]) for one in kinds[k]]
        A, sigma, G = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
        noise = np.einsum("pk,kl->pkl", sigma**2, np.eye(sigma.shape[1]))
        whitened = np.linalg.solve(np.linalg.cholesky(G @ G.swapaxes(1, 2) + noise), A)
        if not rows.shape[1]:
            rows = np.empty((len(q), *whitened.shape[1:]))
        rows[at] = whitened
    return rows


def _read(setup: AbsoluteSetup, pose: Series, q: Array) -> tuple[Array, Array, Array]:
    """Compute the readings of one instrument, k of every pose.

    Returns:
        Readings per unit of the unknowns, (poses, k, size) [m, rad], their noise, (poses, k) [m, rad], and
        readings per unit of joint errors beyond the model, (poses, k, n) [m, rad].
    """
    series, G = series_in_poses(pose, q), np.repeat(_joint_rows(setup, pose, q)[:, None], pose.n_rows, axis=1)
    A = series_equations(setup.unknowns, setup.state, series)[:, :, :-1].transpose(3, 0, 1, 2)
    sigma = np.full((len(q), pose.n_rows, A.shape[1] * A.shape[2]), pose.sigma)
    sigma[:, :, 3 * len(pose.markers) :] = pose.sigma_rotation or pose.sigma
    if pose.distance is not None:  # of the rows of a position that along the beam
        [k] = np.flatnonzero(pose.is_measured[0])
        u = distance_directions(setup.state, series, series_equilibrium(setup.state, series))[0][k].T
        A, sigma = np.einsum("rx,rxc->rc", u, A[:, k])[:, None], sigma[:, :, :1]
        G = np.einsum("plx,plxn->pln", u.reshape(len(q), -1, 3), G[:, :, 3 * k : 3 * k + 3])[:, :, None]
    flat = (len(q), -1)
    return A.reshape(*flat, setup.unknowns.size), sigma.reshape(flat), G.reshape(*flat, G.shape[-1])


def _joint_rows(setup: AbsoluteSetup, pose: Series, q: Array) -> Array:
    """Compute positions and orientations per unit of joint errors beyond the model, (poses, 3 s, n) [m, rad].

    The arm is rigid: they do not depend on the load.
    """
    n, state = setup.unknowns.vjm.arm.n_joints, setup.state
    where = evaluate_chain(state.vjm, q)
    J = translational_jacobian(where, state.mount(pose).points)[:, -n:]
    if pose.rotation is not None:
        J = np.concatenate([J, where.J_theta[3:, -n:]])
    return np.asarray(J.transpose(2, 0, 1) * setup.unmodelled_joint_deviation)
