"""Gramian-constrained optimisation as a conic program, with a certificate of optimality.

Over C_i = V_i^T V_i, F_M(b) of Eq. (19) is not convex; over positive semi-definite C_i it is, and both sets
are equal (Theorem 1). `solve_gco` solves it in scaled units: by our dense interior-point method where blocks
are whole, which determines unobservable directions more precisely; by Clarabel otherwise, or where the dense
answer is not proven.

The certificate holds for any conservative estimate, whatever its method. F_M is a sum of norms |r_k| of
affine residuals r_k = R_k pi - z_k. For vectors y_k of length at most one, |r_k| >= y_k . r_k. So with S_i
the gradient of sum y_k . r_k with respect to block i, and any trace term w <W, C>, every conservative C
whose blocks have a trace of at most t_i obeys

    F(C) + w <W, C> >= -sum y_k . z_k - sum max(0, -lambda_min(S_i + w W_i)) t_i.

With y_k = r_k / |r_k| of an estimate, S_i is the gradient of F_M there. The bound is used twice:

- with the trace term of GCO it bounds the program that is solved: the duality gap;
- without it, it bounds F_M alone: F_M exceeds its minimum by at most the cost of the trace term plus the
  duality gap.
"""

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array, BenchError, Ids, check_array, check_type
from testbench.identify import cone
from testbench.identify.estimate import (
    Certificate,
    Dual,
    Estimate,
    TracePenalty,
    make_estimate,
    sensitivity_units,
)
from testbench.identify.interior import SMALLEST_DIVISOR, BlockProgram, solve_program
from testbench.identify.regression import Regression, check_symmetric, f_m
from testbench.model.structure import PAPER_GCO_METHOD, Structure

# --- Certificate of optimality for any conservative estimate ------------------------------------------------

TIE_BREAK_WEIGHT = 1e-8
"""Weight of the trace in `paper_gco`, as a share of the largest sensitivity of F_M to a compliance [1].

The paper has no such term. It selects the least trace among models of equal fit. If the fit keeps improving
as an unobservable compliance grows, no such model exists; then this weight decides where the growth stops,
and the advice reports it.
"""
LEVER_LENGTH = 0.5
"""Length that turns a translation into a rotation in scaled units [m]: L / sqrt(3) of a link of 0.9 m."""

UNOBSERVED_SENSITIVITY = 1e-2
"""Sensitivity assumed of an axis that no reading observes, as a share of the largest sensitivity [1]."""

MAX_DUAL_LENGTH = 1 + 1e-9
"""Length up to which a dual vector counts as a unit vector; the excess is rounding [1]."""
EIGENVALUE_ROUNDING = 4 * np.finfo(float).eps
"""Rounding error of an eigenvalue of S_i, relative to the size of the terms of S_i.

The bounds are exact up to it, and to 1e-12 of F_M at C = 0.
"""


def trace_units(structure: Structure) -> Array:
    """Return the units s, (n_theta,), in which traces and eigenvalues are taken: C = s X s^T.

    A translation counts as the rotation that causes it on a lever of `LEVER_LENGTH`, so that X and its trace
    are in rad/(N m): s is `LEVER_LENGTH` [m/rad] for translations of links, 1 for all else.
    """
    index = np.arange(structure.n_theta)
    return np.where((index < 6 * structure.n_links) & (index % 6 < 3), LEVER_LENGTH, 1.0)


def tie_break_penalty(regression: Regression) -> TracePenalty:
    """Make the trace term w <W, C> of the paper's GCO.

    It is so light that it only selects among models of equal fit: w is `TIE_BREAK_WEIGHT` times the largest
    sensitivity of F_M to a compliance. W is s^-2, see `trace_units`.
    """
    s, weight = regression.structure, TIE_BREAK_WEIGHT * (regression.diagonal_sensitivity.max() or 1.0)
    return TracePenalty(float(weight), trace_units(s) ** -2.0, s, np.eye(s.n_parameters))


def certify(estimate: Estimate, dual: Dual | None = None) -> Certificate:
    """Bound how far F_M of a conservative estimate is above its least value, by a dual of GCO.

    Args:
        estimate: Any estimate with positive semi-definite compliances, from any method.
        dual: Vectors y_k that prove the bound, such as those of a better estimate; None for the unit
            residuals of the estimate itself, which prove a close bound only near an optimum.

    Returns:
        Upper bounds of F_M, and of F_M + w <W, C>, above their least values [1]; both hold for compliances
        whose traces are within `default_trace_bounds`.

    Raises:
        BenchError: When the estimate is not conservative (the bound would prove nothing), or the dual has
            another shape, is not finite, or has a vector longer than one by more than rounding.
    """
    check_type(estimate, Estimate, "estimate")
    if not estimate.conservative:
        raise BenchError(
            f"certify: expected a conservative estimate, {estimate.method} has smallest eigenvalue "
            f"{estimate.min_eigenvalue:.3g}"
        )
    regression = estimate.regression
    dual = gradient_dual(regression, estimate.pi) if dual is None else _checked_dual(regression, dual)
    if estimate.penalty is None or estimate.split_parameters is None:
        return lower_bound_certificate(regression, estimate.pi, dual, penalty=tie_break_penalty(regression))
    return lower_bound_certificate(
        estimate.penalty.in_split_parameters(regression),
        estimate.split_parameters,
        dual,
        penalty=estimate.penalty,
    )


def _checked_dual(regression: Regression, dual: Dual) -> Dual:
    """Check a dual from outside: its vectors may be longer than one only by rounding."""
    terms = len(regression.terms)
    y = check_array(dual.y, (terms, regression.structure.n_parameters), "dual.y")
    rest = check_array(dual.y_unexplained, (terms,), "dual.y_unexplained")
    longest = float(np.hypot(np.linalg.norm(y, axis=1), rest).max())
    if longest > MAX_DUAL_LENGTH:
        raise BenchError(f"dual: expected vectors of length 1 at most, got one of {longest:.9g}")
    return normalise_dual(y, rest)


def normalise_dual(y: Array, y_unexplained: Array) -> Dual:
    """Scale the vectors y_k of a dual of GCO to length one if they are longer.

    Args:
        y: Components of every y_k along the residual R_k pi - z_k, (terms, n) [1].
        y_unexplained: Component of every y_k along the unexplained residual, (terms,) [1].

    Returns:
        The dual, every vector of length one at most.
    """
    length = np.maximum(1.0, np.hypot(np.linalg.norm(y, axis=1), y_unexplained))
    return Dual(y / length[:, None], y_unexplained / length)


def gradient_dual(regression: Regression, pi: Array) -> Dual:
    """Compute the dual y_k = r_k / |r_k| of GCO from the residuals r_k = R_k pi - z_k of parameters pi.

    The gradient of sum y_k . r_k is then the gradient of F_M at pi.

    Mathematics: `est-13`.

    Args:
        regression: The reduced dataset.
        pi: Parameters, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        The dual, one unit vector per term of F_M; zero where the residual is zero.
    """
    y, rest = [], []
    for term in regression.terms:
        residual = np.r_[term.R @ pi - term.z, math.sqrt(term.unexplained)]
        norm = np.linalg.norm(residual)
        residual = residual / norm if norm > 0 else residual
        y.append(residual[:-1])
        rest.append(residual[-1])
    return Dual(np.array(y), np.array(rest))


def lower_bound_certificate(
    regression: Regression, pi: Array, dual: Dual, trace_bounds: Array | None = None, *, penalty: TracePenalty
) -> Certificate:
    """Bound F_M(pi), and F_M(pi) + w <W, C>, above their least values by a dual of GCO.

    Mathematics: `est-12`.

    Args:
        regression: The reduced dataset, in the parameters of the penalty's structure.
        pi: Parameters of a conservative model in that structure, (n,) [m/N, rad/(N m), rad/N].
        dual: Vectors y_k that prove the bound, none longer than one.
        trace_bounds: Bound t_i of the trace of every block, in the units of `trace_units`, (blocks,)
            [rad/(N m)]; None for `default_trace_bounds`.
        penalty: The trace term w <W, C>.

    Returns:
        The bounds [1]; they hold for compliances whose blocks have traces of at most t_i.
    """
    s, t = regression.structure, trace_bounds
    t = default_trace_bounds(regression, pi) if t is None else t
    # Lagrangian of the dual: gradient sum R_k^T y_k and constant sum (rest_k |rest| - y_k . z_k).
    g = np.zeros(s.n_parameters)
    constant = 0.0
    for term, y, rest in zip(regression.terms, dual.y, dual.y_unexplained, strict=True):
        g += term.R.T @ y
        constant += rest * math.sqrt(term.unexplained) - y @ term.z
    cost, free = f_m(regression, pi), np.zeros(s.n_parameters)

    def excess_over_bound(cost: float, trace_gradient: Array) -> float:
        """Bound how far a cost lies above its least value over positive semi-definite compliances.

        Args:
            cost: F_M of pi, or F_M plus the trace term [1].
            trace_gradient: Gradient of the trace term that the cost includes; zero for F_M alone, (n,).

        Returns:
            Upper bound of the distance [1].
        """
        # A negative eigenvalue of S_i can lower the cost by at most -lambda_min t_i.
        least = constant - float(np.maximum(0, -_smallest_eigenvalues(regression, g, trace_gradient)) @ t)
        return max(0.0, cost - max(0.0, least))  # the cost is a sum of norms and traces

    return Certificate(
        duality_gap=excess_over_bound(cost + float(penalty.trace_gradient @ pi), penalty.trace_gradient),
        f_m_excess_bound=excess_over_bound(cost, free),
        trace_bounds=t,
        dual=dual,
    )


def _smallest_eigenvalues(regression: Regression, g: Array, trace_gradient: Array) -> Array:
    """Compute the smallest eigenvalue of every S_i + w W_i in scaled units, less its rounding, (blocks,)."""
    s, unit = regression.structure, trace_units(regression.structure)
    scale = np.outer(unit, unit)
    S, size = (
        s.gradient_matrix(g + trace_gradient) * scale,
        s.gradient_matrix(regression.column_norms + np.abs(trace_gradient)) * scale,
    )
    smallest = np.empty(len(s.blocks))
    for group in s.block_groups:
        # The eigenvalue is lowered by its rounding error, so that the bound stays rigorous.
        lost = EIGENVALUE_ROUNDING * np.linalg.norm(size[group.index_arrays], axis=(1, 2))
        smallest[group.block_indices] = np.linalg.eigvalsh(S[group.index_arrays])[:, 0] - lost
    return smallest


def default_trace_bounds(regression: Regression, pi: Array) -> Array:
    """Compute upper bounds of the traces of C_theta's blocks, within which a certificate of GCO holds.

    The diagonal entry C_dd of an axis d is at most c_d = 2 F_M(0) / |R e_d|, with R e_d the weighted readings
    that a unit of C_dd causes. The bound of a block is the sum over its axes. By the triangle inequality a
    model with C_dd = c and nothing else has F_M >= sum_k (c |R_k e_d| - |z_k|) >= c |R e_d| - F_M(0). So with
    c above c_d it fits worse than a rigid arm.

    This is proven for one axis at a time and assumed for several: compliances whose deflections cancel may be
    larger and still fit. An axis that no reading observes is treated as if its sensitivity were
    `UNOBSERVED_SENSITIVITY` of the largest. The bound of a block is twice its trace at pi if that is more.

    Mathematics: `est-14`.

    Args:
        regression: The reduced dataset.
        pi: Parameters of the model that is certified, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        Bound t_i of the trace of every block, in the units of `trace_units`, (blocks,) [rad/(N m)].
    """
    s = regression.structure
    used = s.block_of_row >= 0
    unit = trace_units(s)[used] ** 2
    sensitivity = regression.diagonal_sensitivity[used] * unit
    sensitivity[sensitivity == 0] = UNOBSERVED_SENSITIVITY * (sensitivity.max() or 1.0)
    allowed = 2 * f_m(regression, np.zeros(s.n_parameters)) / sensitivity
    doubled = 2 * np.diag(s.C_theta_of(pi))[used] / unit
    return np.maximum(*(np.bincount(s.block_of_row[used], weights=trace) for trace in (allowed, doubled)))


def total_trace(structure: Structure, pi: Array) -> float:
    """Compute the trace of C_theta in the units s of `trace_units`, tr(s^-1 C_theta s^-1).

    Args:
        structure: The unknowns.
        pi: Parameters, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        Trace [rad/(N m)].
    """
    diagonal = structure.rows == structure.columns
    return float((pi[diagonal] / trace_units(structure)[structure.rows[diagonal]] ** 2).sum())


# --- Gramian-constrained optimisation as a conic program with a certificate ---------------------------------

REPORTED_TIE_BREAK_COST = 1e-4
"""Trace term over F_M of a solution, above which the advice mentions that the tie-break bounds it [1]."""
RELATIVE_GAP_TOLERANCE = 1e-5
"""Proven distance of F_M + trace term from its optimum, over F_M, up to which the program is solved [1]."""
NOISE_FREE_GAP_TOLERANCE = 1e-7
"""Proven distance over F_M at C = 0 up to which the program is solved [1]; for data without noise.

Without noise the tie-break alone costs 0.3 to 2 times as much, and F_M a tenth at most.
"""
EXACT_FIT_SHARE = 1e-9  #: F_M of a solution over F_M at C = 0, below which the fit is exact [1].
MAX_INTERIOR_POINT_GAP = 1e-9
"""Duality gap over F_M at C = 0 up to which the answer of our interior-point method is taken [1]."""
SQUARED_RESIDUAL_SCALE = 100.0
"""Factor on residuals whose squares are minimised: with it the squares decide, not the trace term [1]."""


@dataclass(frozen=True)
class ConicProgram:
    """Hold the conic program of GCO in unknowns x, in units where the data are of order one.

    It minimises sum_k |(R_k x - z_k, unexplained_k)| + trace_cost . x over positive semi-definite blocks. A
    block of C_theta that changes no reading is left out: with least trace it is zero.
    """

    parameter_indices: Ids  #: Indices of the parameters in blocks that change a reading, (k,).
    observed_structure: Structure  #: These blocks, with the parameters `parameter_indices`.
    f_m_unit: float  #: F_M at C = 0, the unit of the cost [1].
    parameter_units: Array  #: Units of the parameters, pi[parameter_indices] = parameter_units * x, (k,).
    R: Array  #: Factor R_k of every term of F_M per unit of x, over `f_m_unit`, (terms, n, k) [1].
    z: Array  #: Readings z_k of every term of F_M, over `f_m_unit`, (terms, n) [1].
    unexplained: Array  #: Norm of the readings that no parameter can explain, (terms,) [1].
    trace_cost: Array  #: The trace term per unit of x, over `f_m_unit`, (k,) [1].
    penalty: TracePenalty  #: The trace term in the parameters.

    def to_pi(self, x: Array, n_parameters: int) -> Array:
        """Compute the parameters pi of the whole structure from the unknowns x of the program.

        Args:
            x: Unknowns of the program, (k,) [1].
            n_parameters: Number n of parameters of the whole structure.

        Returns:
            pi, (n,) [m/N, rad/(N m), rad/N]; zero in blocks that change no reading.
        """
        pi = np.zeros(n_parameters)
        pi[self.parameter_indices] = self.parameter_units * x
        return pi

    def psd_constraints(self, n_first: int) -> tuple[cone.ConeConstraint, ...]:
        """Make the constraints that all blocks are positive semi-definite.

        Args:
            n_first: Number of unknowns of the conic program before x.
        """
        svecs = svecs_per_parameter(self.observed_structure)
        return cone.psd_constraints(
            self.observed_structure.block_orders, np.c_[np.zeros((len(svecs), n_first)), svecs]
        )


@dataclass(frozen=True)
class ConicSolution:
    """Hold the parameters that a solver of GCO found, with a dual that bounds their cost over the optimum."""

    pi: Array  #: Parameters, (n,) [m/N, rad/(N m), rad/N].
    solver_seconds: float  #: Time inside the solver [s].
    failure: str  #: Status to report if the dual does not prove that pi is close to the optimum.
    dual: Dual  #: Dual vectors y_k of GCO.


def solve_gco(regression: Regression, penalty: TracePenalty | None = None) -> Estimate:
    """Minimise F_M of Eq. (19) plus a trace term w <W, C> over positive semi-definite compliances.

    The data rarely determine all of C: without the trace term the optimum is not unique, or is only
    approached as an unobservable entry grows without end. The certificate of the estimate bounds the distance
    from the optimum, and what the trace term costs in F_M.

    Mathematics: `est-7`.

    Args:
        regression: The reduced dataset.
        penalty: The trace term; None for the paper's GCO, with `tie_break_penalty`, which only selects among
            models of equal fit.

    Raises:
        BenchError: When the structure is not symmetric.
    """
    check_symmetric(regression.structure)
    papers, penalty = penalty is None, penalty or tie_break_penalty(regression)
    split_regression = penalty.in_split_parameters(regression)
    program = scaled_gco_program(split_regression, penalty)
    # Own solver, else Clarabel; an answer without proof is solved again by the sum of squares.
    answer = solve_gco_by_interior_point(split_regression, program) or solve_gco_by_clarabel(
        split_regression, program
    )
    pi = answer.pi
    certificate, reached = _certified(split_regression, program, pi, answer.dual)
    if not reached:
        other = solve_noise_free_gco(split_regression, program)
        proof, better = _certified(split_regression, program, other, gradient_dual(split_regression, other))
        if better or proof.duality_gap < certificate.duality_gap:
            pi = other
            certificate = proof
            reached = better
    # Convert back to the requested unknowns.
    left, cost = f_m(split_regression, pi), float(penalty.trace_gradient @ pi)
    method = PAPER_GCO_METHOD if papers else "GCO (conic program)"
    estimate = make_estimate(regression, penalty.pi_per_split_parameter @ pi, method=method, constraint="psd")
    return replace(
        estimate,
        status="solved" if reached and estimate.conservative else answer.failure,
        certificate=certificate,
        solver_seconds=answer.solver_seconds,
        penalty=penalty,
        split_parameters=pi,
        bounded_by_tie_break=bool(
            papers
            and cost
            > REPORTED_TIE_BREAK_COST * left
            > REPORTED_TIE_BREAK_COST * EXACT_FIT_SHARE * program.f_m_unit
        ),
    )


def _certified(
    regression: Regression, program: ConicProgram, pi: Array, dual: Dual
) -> tuple[Certificate, bool]:
    """Certify parameters by a dual, and return whether they are near enough to the optimum."""
    certificate, left = (
        lower_bound_certificate(regression, pi, dual, penalty=program.penalty),
        f_m(regression, pi),
    )
    over = min(certificate.duality_gap, left)  # F_M cannot be negative
    return certificate, over <= RELATIVE_GAP_TOLERANCE * left + NOISE_FREE_GAP_TOLERANCE * program.f_m_unit


def solve_gco_by_interior_point(regression: Regression, program: ConicProgram) -> ConicSolution | None:
    """Solve the scaled GCO program by our dense interior-point method.

    Args:
        regression: The reduced dataset, in the parameters of the penalty's structure.
        program: The scaled program of the regression.

    Returns:
        The solution; None if a block lacks entries, no reading changes, or the solution is not proven to be
        within `MAX_INTERIOR_POINT_GAP` of the optimum.
    """
    s, n = program.observed_structure, regression.structure.n_parameters
    if not s.has_full_blocks or not len(program.parameter_indices) or f_m(regression, np.zeros(n)) == 0:
        return None
    start, order = time.perf_counter(), s.parameter_of_entry
    unit = np.where(s.fills_two_entries[order], math.sqrt(0.5), 1.0)  # parameters over svec
    x = np.empty(len(order))
    norms = BlockProgram(
        program.R[:, :, order] * unit,
        program.z,
        program.unexplained,
        program.trace_cost[order] * unit,
        s.block_orders,
    )
    x[order] = unit * solve_program(norms).x
    pi = program.to_pi(x, n)
    dual = gradient_dual(regression, pi)
    gap = (
        lower_bound_certificate(regression, pi, dual, penalty=program.penalty).duality_gap / program.f_m_unit
    )
    if gap > MAX_INTERIOR_POINT_GAP:
        return None
    return ConicSolution(pi, time.perf_counter() - start, f"proven to {gap:.1g} of F_M without a model", dual)


def solve_noise_free_gco(regression: Regression, program: ConicProgram) -> Array:
    """Minimise the squared residuals of F_M plus the trace term, for data without noise.

    At an exact fit the norms in F_M have no gradient, so that their program cannot be solved to all digits.

    Args:
        regression: The reduced dataset, in the parameters of the penalty's structure.
        program: The scaled program of the regression.

    Returns:
        Parameters pi, (n,) [m/N, rad/(N m), rad/N].
    """
    s = program.observed_structure
    R = SQUARED_RESIDUAL_SCALE * program.R.reshape(-1, len(program.parameter_units))
    k, n = R.shape
    solution = cone.solve(
        cone.ConeProgram(
            cost=np.r_[np.zeros(k), program.trace_cost],
            constraints=(
                cone.ConeConstraint(
                    "zero", np.c_[np.eye(k), -R], -SQUARED_RESIDUAL_SCALE * program.z.ravel()
                ),
                *program.psd_constraints(k),
            ),
            quadratic_diagonal=np.r_[np.ones(k), np.zeros(n)],
        )
    )
    return program.to_pi(
        clip_negative_eigenvalues(s, solution.unknowns[k:]), regression.structure.n_parameters
    )


def solve_gco_by_clarabel(regression: Regression, program: ConicProgram) -> ConicSolution:
    """Solve the scaled GCO program by Clarabel, with Clarabel's dual as proof.

    Args:
        regression: The reduced dataset, in the parameters of the penalty's structure.
        program: The scaled program of the regression.

    Returns:
        The solution; all parameters are zero if all readings are.
    """
    s = program.observed_structure
    n = regression.structure.n_parameters
    count = len(program.z)
    if f_m(regression, np.zeros(n)) == 0:
        return ConicSolution(np.zeros(n), 0.0, "", gradient_dual(regression, np.zeros(n)))
    solution = cone.solve(
        cone.ConeProgram(
            cost=np.r_[np.ones(count), program.trace_cost],
            constraints=(
                *norm_constraints(program.R, program.z, program.unexplained),
                *program.psd_constraints(count),
            ),
        )
    )
    pi = program.to_pi(clip_negative_eigenvalues(s, solution.unknowns[count:]), n)
    z = np.array(solution.duals[:count])
    z /= np.maximum(z[:, :1], SMALLEST_DIVISOR)  # a dual of the cone: zero where its head is
    return ConicSolution(pi, solution.seconds, solution.failure, normalise_dual(z[:, 1:-1], -z[:, -1]))


def scaled_gco_program(regression: Regression, penalty: TracePenalty) -> ConicProgram:
    """Build the conic program of GCO with data, trace term and parameters scaled to order one.

    Args:
        regression: The reduced dataset, in the parameters of the penalty's structure.
        penalty: The trace term.

    Returns:
        The program of the blocks that change a reading.
    """
    s = regression.structure
    block, seen = s.block_of_row[s.rows], np.zeros(len(s.blocks), dtype=bool)
    seen[block[regression.column_norms > 0]] = True
    # Blocks that change no reading stay zero.
    columns = np.flatnonzero(seen[block])
    unit = f_m(regression, np.zeros(s.n_parameters)) or 1.0
    scale = sensitivity_units(regression, unit, penalty)[columns]
    return ConicProgram(
        parameter_indices=columns,
        observed_structure=s.select_parameters(columns, s.name),
        f_m_unit=unit,
        parameter_units=scale,
        R=np.array([term.R[:, columns] for term in regression.terms]) * (scale / unit),
        z=np.array([term.z for term in regression.terms]) / unit,
        unexplained=np.sqrt([term.unexplained for term in regression.terms]) / unit,
        trace_cost=penalty.trace_gradient[columns] * scale / unit,
        penalty=penalty,
    )


def norm_constraints(R: Array, z: Array, unexplained: Array) -> tuple[cone.ConeConstraint, ...]:
    """Make the constraints |(R_k x - z_k, unexplained_k)| <= t_k; the unknowns are all t_k, then x.

    Args:
        R: Matrix R_k of every term, (terms, rows, n) [1].
        z: Right-hand side z_k of every term, (terms, rows) [1].
        unexplained: Component of every residual that does not depend on x, (terms,) [1].

    Returns:
        The constraints, one second-order cone per term.
    """
    head = np.zeros((len(R), R.shape[1] + 1, len(R)))
    body = np.concatenate([R, np.zeros((len(R), 1, R.shape[2]))], axis=1)
    A, b = np.concatenate([head, body], axis=2), np.c_[z, unexplained]
    return tuple(cone.norm_constraint(k, A[k], b[k]) for k in range(len(R)))


def clip_negative_eigenvalues(structure: Structure, parameters: Array) -> Array:
    """Find the nearest positive semi-definite blocks of C_theta: negative eigenvalues become zero.

    Args:
        structure: The unknowns.
        parameters: Parameters pi of the blocks, or pi in other units, (n,).

    Returns:
        Parameters of the nearest blocks in the same units, (n,).
    """
    X = structure.C_theta_of(parameters)
    for group in structure.block_groups:
        X[group.index_arrays] = cone.nearest_psd(X[group.index_arrays])
    return structure.parameters_of(X)


def svecs_per_parameter(structure: Structure) -> Array:
    """Compute how the parameters of C_theta make up the svecs of its blocks.

    Args:
        structure: The n unknowns.

    Returns:
        svecs of all blocks, one after the other, per unit of the parameters, (entries, n) [1].
    """
    row, column = structure.upper_triangles
    parameter = structure.parameter_of_entry
    entry = np.flatnonzero(parameter >= 0)
    svecs = np.zeros((len(row), structure.n_parameters))
    svecs[entry, parameter[entry]] = np.where(row == column, 1.0, math.sqrt(2))[entry]
    return svecs
