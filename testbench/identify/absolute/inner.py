"""Linear problem of one Gauss-Newton step: all unknowns but the compliances are eliminated.

The remaining equations are a `Regression` of the compliances, for least squares or GCO.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from testbench.errors import Array, BenchError
from testbench.identify import hierarchy
from testbench.identify.absolute.evidence import LOOSE_STRENGTH, ActiveUnknowns, ErrorScales
from testbench.identify.absolute.state import ArmState, Mount
from testbench.identify.estimate import Constraint, Estimate
from testbench.identify.fold import ReducedReadings
from testbench.identify.metric import (
    PriorScaling,
    WeightedPrior,
    precision_root,
    rescale_to_data,
    with_prior_rows,
)
from testbench.identify.prior import Strength
from testbench.identify.registration import Frame
from testbench.identify.regression import Regression, regression_of, term_from_triangle
from testbench.identify.solve import solve
from testbench.model.tool_motion import rotation_matrices

INDEPENDENT_SHARE = 1e-10
"""Share of a column that is independent of all others below which it counts as undetermined [1]."""


@dataclass(frozen=True)
class StepSolution:
    """Hold the most probable unknowns."""

    x: Array  #: Values of the selected unknowns in SI units, (c,).
    root: Array  #: Root of the posterior's precision, compliances in the metric, (c, c).
    estimate: Estimate | None  #: Compliances; None for a rigid arm.
    spent: float  #: Degrees of freedom that the unknowns use.
    cone_pressure: float  #: Increase of chi squared by the cone [1]; 0 for a rigid arm.
    belief: WeightedPrior | None  #: Prior of the compliances; None for a rigid arm.


def solve_step(
    active: ActiveUnknowns,
    reduced: ReducedReadings,
    learnt: ErrorScales,
    constraint: Constraint = "psd",
    strength: Strength | None = None,
) -> StepSolution:
    """Solve for the most probable unknowns by QR.

    The other unknowns are eliminated, least squares or GCO solves for the compliances, and the other unknowns
    follow by back substitution.

    Mathematics: `abs-8`.

    Args:
        active: The unknowns.
        reduced: The equations, in the basis of the unknowns.
        learnt: Sizes of errors, and noise factors.
        constraint: "psd" for GCO, "none" for least squares.
        strength: Relative uncertainty of the expected compliances; None to learn it from the readings.

    Returns:
        The unknowns, the root of their precision, and the estimate of the compliances.

    Raises:
        BenchError: If the readings leave a frame or a target undetermined.
    """
    # Triangular factor of all equations: the r other unknowns first, compliances last.
    T = factor_of(active, reduced, learnt)
    r, c = active.rigid, len(active.columns)
    R = T[:r, :r]
    if active.elastic is None:
        x, root, estimate, pressed = solve_triangular(R, T[:r, c]), R, None, 0.0
        belief = None
    else:
        # Its lower rows are the equations of the compliances alone.
        regression = compliance_rows(T, active.elastic, int(reduced.counts.sum()))
        belief = (
            WeightedPrior(active.elastic, strength) if strength else _scaled_prior(regression, active.elastic)
        )
        estimate = solve(regression, constraint, belief)
        pressed = _pressed(regression, belief, estimate)
        # The other unknowns by back substitution.
        x = back_substitute(T, estimate.pi)
        # Posterior precision: likelihood and prior of the compliances, in the metric.
        L, B = active.elastic.L, precision_root(belief.scaling, belief.strength)[0]
        B = B @ np.linalg.solve(belief.scaling.L, L)
        below = np.asarray(np.linalg.qr(np.vstack([T[r:c, r:c] @ L, B]), mode="r"))
        if belief.hyperparameter_effect is not None:
            below = _widened(below, np.asarray(np.linalg.solve(L, belief.hyperparameter_effect.T)))
        root = np.block([[R, T[:r, r:c] @ L], [np.zeros((c - r, r)), below]])
    # Degrees of freedom: the share of each prior variance that the readings remove.
    inverse, deviation = solve_triangular(root[:r, :r], np.eye(r)), learnt.deviation[active.columns[:r]]
    held = np.isfinite(deviation)
    known = 1 - (inverse[held] ** 2).sum(axis=1) / deviation[held] ** 2
    spent = float(np.maximum(known, 0).sum() + (~held).sum() + c - r)
    if (basis := active.unknowns.basis) is not None:
        # From the basis of a shared pattern back to the joints.
        B = basis[active.columns][:, active.columns].toarray()  # its columns are orthogonal
        x, root = B @ x, np.asarray(np.linalg.qr(root / (B**2).sum(axis=0) @ B.T, mode="r"))
    return StepSolution(x, root, estimate, spent, pressed, belief)


def _pressed(regression: Regression, belief: WeightedPrior, estimate: Estimate) -> float:
    """Compute how far the cone raises chi squared with penalty above that of least squares with a prior."""
    if estimate.constraint == "none":
        return 0.0
    M, r = with_prior_rows(regression, belief.scaling, belief.strength)
    every = (estimate, solve(regression, "none", belief))
    mine, free = (float(np.sum((M @ np.linalg.solve(belief.scaling.L, e.pi) - r) ** 2)) for e in every)
    return mine - free


def compliance_rows(T: Array, elastic: PriorScaling, equations: int) -> Regression:
    """Eliminate all other unknowns, and return the equations of the compliances.

    Args:
        T: Triangular factor of all unknowns, compliances last, (c + 1, c + 1).
        elastic: Metric of the compliances.
        equations: Number of equations.

    Returns:
        The regression of the compliances.
    """
    r = len(T) - 1 - len(elastic.expected)
    term = term_from_triangle(T[r:, r:] / np.sqrt(equations / 3), 0.0, equations)
    return regression_of(elastic.structure, (term,))


def back_substitute(T: Array, pi: Array) -> Array:
    """Compute the most probable other unknowns for given compliances.

    Args:
        T: Triangular factor of all unknowns, compliances last, (c + 1, c + 1).
        pi: Compliances, (n,).

    Returns:
        All unknowns, (c,).
    """
    r = len(T) - 1 - len(pi)
    others: Array = solve_triangular(T[:r, :r], T[:r, -1] - T[:r, r:-1] @ pi)
    return np.concatenate([others, pi])


def _widened(root: Array, moves: Array) -> Array:
    """Update the triangular root of a precision, (e, e), for further covariance, the columns of moves."""
    deviations = np.hstack([solve_triangular(root, np.eye(len(root))), moves])
    R = np.linalg.qr(deviations.T, mode="r")
    return np.asarray(np.linalg.qr(solve_triangular(R, np.eye(len(R)), trans="T"), mode="r"))


def factor_of(active: ActiveUnknowns, reduced: ReducedReadings, learnt: ErrorScales) -> Array:
    """Compute the triangular factor of all equations and of all priors but the compliances'.

    Args:
        active: The choice, c columns.
        reduced: The reduced equations.
        learnt: Learnt sizes of errors and noise.

    Returns:
        The factor, (c + 1, c + 1).

    Raises:
        BenchError: If the readings do not determine a frame or a target.
    """
    some = np.r_[active.columns, active.unknowns.size]
    # Rows of the priors.
    deviation = learnt.deviation[active.columns[: active.rigid]]
    held = np.flatnonzero(np.isfinite(deviation))
    rows = np.zeros((len(held), len(some)))
    rows[np.arange(len(held)), held] = 1 / deviation[held]
    # Rows of the readings, by their noise.
    factors = zip(reduced.factors.values(), learnt.factor, strict=True)
    lines = [R[:, some] / factor for R, factor in factors]
    T = np.asarray(np.linalg.qr(np.vstack([*lines, rows, np.zeros((len(some), len(some)))]), mode="r"))
    free = np.abs(np.diag(T))[: active.rigid]
    if not (free > INDEPENDENT_SHARE * np.linalg.norm(T[:, : active.rigid], axis=0)).all():
        raise BenchError("calibration: the readings leave a frame or target open; expected more poses")
    return T


def _scaled_prior(regression: Regression, elastic: PriorScaling) -> WeightedPrior:
    """Learn the prior from the readings; if these require a negative scale, use the prior as it is."""
    try:
        rescale_to_data(elastic, regression)
    except BenchError:
        return WeightedPrior(elastic, LOOSE_STRENGTH)
    return hierarchy.learn_prior(regression, elastic)


def apply_step(state: ArmState, active: ActiveUnknowns, x: Array) -> ArmState:
    """Return the state with new values of the unknowns of a choice; all others are zero.

    Args:
        state: The state.
        active: The choice, c columns.
        x: Values, (c,).

    Returns:
        The new state.
    """
    unknowns = active.unknowns
    every = np.zeros(unknowns.size)
    every[active.columns] = x
    # Geometry, frames and mounts move; compliances and joint errors are replaced.
    theta_0 = state.theta_0.copy()
    theta_0[unknowns.inner] = every[unknowns.columns("geometry")]
    frames = {**state.frames}
    for name in unknowns.frames:
        frames[name] = moved_frame(frames[name], every[unknowns.columns(f"frame {name}")])
    mounts = {**state.mounts}
    for name in unknowns.mounts:
        mounts[name] = moved_mount(mounts[name], every[unknowns.columns(f"mount {name}")])
    return replace(
        state,
        theta_0=theta_0,
        C_theta=unknowns.structure.matrix(every[unknowns.columns("elastic")]),
        errors=unknowns.errors,
        n=every[unknowns.columns("errors")].reshape(state.vjm.arm.n_joints, unknowns.errors.size),
        frames=frames,
        mounts=mounts,
    )


def moved_frame(frame: Frame, step: Array) -> Frame:
    """Return a frame after the base moved: x + move + turn x x in base axes.

    Args:
        frame: The frame.
        step: Move, then turn, (6,) [m, rad].

    Returns:
        The new frame.
    """
    [turn] = rotation_matrices(step[None, 3:])
    return Frame(frame.rotation @ turn, frame.translation + frame.rotation @ step[:3])


def moved_mount(mount: Mount, step: Array) -> Mount:
    """Return a mount after a step: its targets moved in tool axes, and its oriented target rotated.

    Args:
        mount: The mount, m targets.
        step: Moves of the targets [m], then a rotation vector [rad], (3 m,) or (3 m + 3,).

    Returns:
        The new mount.
    """
    m = len(mount.points)
    points = mount.points + step[: 3 * m].reshape(m, 3)
    [turn] = rotation_matrices(step[None, 3 * m :]) if len(step) > 3 * m else np.eye(3)[None]
    return replace(mount, points=points, rotation=turn @ mount.rotation)
