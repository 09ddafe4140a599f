"""How sure a calibrated arm is, and where it has its targets in a series, whatever that was learnt from.

The frame and mount of a new series are fitted to a few of its rows, all else held. What the arm is unsure of
shows in these rows too; so much of it as a frame can take up does no harm elsewhere.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from testbench.data.series import Series, select_rows
from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.align import aligned, too_few
from testbench.identify.absolute.evidence import usual
from testbench.identify.absolute.inner import moved_frame, moved_mount
from testbench.identify.absolute.noise import KINDS, Noise, roots, weights
from testbench.identify.absolute.scatter import residuals
from testbench.identify.absolute.state import BATCH, State
from testbench.identify.absolute.unknowns import unknowns_of
from testbench.identify.arm_model import About, ArmModel
from testbench.identify.posterior import Posterior
from testbench.identify.rows import rows_of
from testbench.model.structure import joints_only

if TYPE_CHECKING:
    from testbench.identify.absolute.fit import Calibration

STEP, MOST_STEPS = 1e-9, 20  #: A step of a frame below this is the last [m, rad].


@dataclass(frozen=True, eq=False)
class RegisteredSeries:
    """A series whose frame and mount are known."""

    state: State  #: With the frame and the mount.
    rows: Ids  #: Places of the rows that told them; none where the calibration had.
    #: Of frame and mount, which are steps, and of the arm's unknowns, in this order, (f + a,).
    posterior: Posterior


def deviations_root(precision: Array, L: Array) -> Array:
    """Rows W with W^T W the covariance of unknowns in SI units, (c, c).

    Args:
        precision: Upper triangular root of the posterior's precision, compliances in the metric, (c, c).
        L: The last unknowns, compliances, per unit of the metric, (e, e).
    """
    back = block_diag(np.eye(len(precision) - len(L)), L)
    return np.asarray(solve_triangular(precision, back.T, trans="T"))


def posterior_of(calibration: "Calibration") -> Posterior:
    """Of all unknowns that a calibration has on, (c,); frames and mounts are steps from where they are.

    Mathematics: `abs-13`.
    """
    own = calibration.own
    L = np.zeros((0, 0)) if own.elastic is None else own.elastic.L
    x = own.unknowns.current(calibration.state)[own.columns]
    return Posterior.normal(x, deviations_root(calibration.root, L))


def model_of(calibration: "Calibration") -> ArmModel:
    """What a calibration knows of the arm, whatever series it was learnt from."""
    own, state, known = calibration.own, calibration.state, posterior_of(calibration)
    first = own.unknowns.starts["geometry"]
    f = int((own.columns < first).sum())
    structure = joints_only(state.vjm.arm) if own.elastic is None else own.elastic.structure
    arm = Posterior.normal(known.x[f:], known.root[f:, f:])
    model = ArmModel(state, structure, own.columns, arm, About("absolute calibration"), calibration.noise)
    elastic = model.unknowns.starts["elastic"] + np.arange(len(own.columns) - own.rigid)
    return replace(model, columns=np.concatenate([own.columns[f : own.rigid] - first, elastic]))


def place(model: ArmModel, series: Series, rows: Ids) -> RegisteredSeries:
    """Frame and mount of a series by some of its rows, by Gauss-Newton; all else is held.

    Mathematics: `abs-13`.

    Raises:
        BenchError: When these rows do not tell them.
    """
    some = select_rows(series, rows)
    state = aligned(without(model.state, some), (some,))
    for _ in range(MOST_STEPS):
        F, M, y = _whitened(model, state, some)
        root = _root(model, F, some)
        step = solve_triangular(root, solve_triangular(root, F.T @ y, trans="T"))
        state = replace(
            state,
            frames={**state.frames, some.frame: moved_frame(state.frame(some), step[:6])},
            mounts={**state.mounts, some.target: moved_mount(state.mount(some), step[6:])},
        )
        if np.abs(step).max() < STEP:
            break
    return RegisteredSeries(state, rows, _joint(model, root, F.T @ M))


def known(model: ArmModel, series: Series) -> RegisteredSeries:
    """A series whose frame and mount the calibration found, by rows such as it has."""
    seen = np.flatnonzero(series.seen.any(axis=1))
    some = select_rows(series, seen[np.linspace(0, len(seen) - 1, min(BATCH, len(seen))).astype(int)])
    F, M, _ = _whitened(model, model.state, some)
    return RegisteredSeries(
        model.state, np.zeros(0, dtype=int), _joint(model, _root(model, F, some), F.T @ M)
    )


def without(state: State, series: Series) -> State:
    """Return the state without the frame and the mount of a series.

    Args:
        state: The state.
        series: The series.

    Returns:
        The state.
    """
    frames = {key: one for key, one in state.frames.items() if key != series.frame}
    mounts = {key: one for key, one in state.mounts.items() if key != series.target}
    return replace(state, frames=frames, mounts=mounts)


def predict(model: ArmModel, placed: RegisteredSeries, series: Series) -> tuple[Array, Array]:
    """Predict positions of all rows of a series, with the uncertainty of the residual.

    Args:
        model: The calibrated arm.
        placed: The series' frame and mount.
        series: The readings.

    Returns:
        Reading minus model in base axes, (rows, m, 3) [m], and its covariance with the reading's noise,
        (rows, m, 3, 3) [m^2].
    """
    m, a = len(series.markers), len(model.columns)
    told = np.r_[: 6 + 3 * m, -a:0]  # positions do not depend on the turn of a target
    own = Posterior.normal(placed.posterior.x[told], placed.posterior.root[:, told])
    root = np.linalg.inv(roots(series, _noise(model), placed.state.frame(series).rotation)[0][:m])
    covariance: Array = (root @ root.swapaxes(2, 3)).swapaxes(0, 1)
    for first in range(0, series.rows, BATCH):
        some = np.arange(first, min(first + BATCH, series.rows))
        A = _columns(model, placed.state, select_rows(series, some))[0][:m]
        A = np.delete(A, np.s_[6 + 3 * m : A.shape[2] - a], axis=2)
        covariance[some] += own.covariance(A.transpose(3, 0, 1, 2))
    return residuals(placed.state, series)[:m].transpose(2, 0, 1), covariance


def inside(left: Array, covariance: Array, quantile: float = 7.8147) -> Array:
    """Which positions lie in their 95 % ellipsoid, by chi squared of three, (rows, m)."""
    solved = np.linalg.solve(covariance, left[..., None])[..., 0]
    return np.asarray((left * solved).sum(axis=-1) <= quantile)


def _joint(model: ArmModel, root: Array, with_arm: Array) -> Posterior:
    """Of frame, mount and arm: the former by rows of root^T root, which go with the arm's, (f, a)."""
    f, own = len(root), model.posterior
    inverse: Array = solve_triangular(root, np.eye(f))
    taken = inverse @ (inverse.T @ with_arm)
    both = [[inverse.T, np.zeros((f, len(own.x)))], [-own.root @ taken.T, own.root]]
    return Posterior.normal(np.r_[np.zeros(f), own.x], np.block(both))


def _columns(model: ArmModel, state: State, series: Series) -> tuple[Array, Array]:
    """Columns of frame, mount and the arm's unknowns, (s, 3, f + a, rows), and what is left, (s, 3, rows)."""
    unknowns = unknowns_of(model.vjm, (series,), state.errors, model.structure)
    rows, f = rows_of(unknowns, state, series), unknowns.starts["geometry"]
    return rows[:, :, np.r_[:f, f + model.columns]], rows[:, :, -1]


def _whitened(model: ArmModel, state: State, series: Series) -> tuple[Array, Array, Array]:
    """Whitened equations: columns of frame and mount, (e, f), of the arm, (e, a), and what is left, (e,)."""
    A, left = _columns(model, state, series)
    W, pull = weights(series, _noise(model), state.frame(series).rotation, left)
    W *= np.sqrt(pull)[..., None, None]
    rows = np.concatenate([A, left[:, :, None]], axis=2)
    lines = np.einsum("srxy,sycr->srxc", W, rows, optimize=True).reshape(-1, rows.shape[2])
    F, M, y = np.split(lines, [A.shape[2] - len(model.columns), -1], axis=1)
    return F, M, y[:, 0]


def _root(model: ArmModel, F: Array, series: Series) -> Array:
    """Triangular factor of the columns of frame and mount, and of the prior of what these rows leave open."""
    unknowns = unknowns_of(model.vjm, (series,), model.state.errors, model.structure)
    B = np.diag(1 / usual(unknowns, len(KINDS)).deviation[: unknowns.starts["geometry"]])
    B = B[B.any(axis=1) & (not too_few(model.vjm, series))]
    R = np.asarray(np.linalg.qr(np.vstack([F, B]), mode="r"))
    full = len(R) == F.shape[1] and (np.abs(np.diag(R)) > 1e-9 * np.linalg.norm(F, axis=0)).all()
    if not full:
        raise BenchError(f"{series.name}: its rows leave frame or target open; expected poses that turn more")
    return R


def _noise(model: ArmModel) -> Noise:
    if model.noise is None:
        raise BenchError("model: expected one of absolute readings; this one knows deflections")
    return model.noise
