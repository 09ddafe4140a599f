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
from functools import lru_cache

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
from testbench.identify.interior import TINY, BlockProgram, solve_program
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
    """Return units s, (n_theta,), in which traces and eigenvalues are taken: C = s X s^T.

    A translation counts as the rotation that causes it on an arm of `LEVER_LENGTH`, so that X and its trace
    are in rad/(N m) whatever mixture of metres and radians C holds: s is `LEVER_LENGTH` [m/rad] for
    translations of links, 1 for all else.
    """
    index = np.arange(structure.n_theta)
    return np.where((index < 6 * structure.n_links) & (index % 6 < 3), LEVER_LENGTH, 1.0)


def tie_break_penalty(regression: Regression) -> TracePenalty:
    """Make the trace term w <W, C> of the paper's GCO.

    It is so light that it only selects among models of equal fit: w is `TIE_BREAK_WEIGHT` times the largest
    sensitivity.
    """
    s, weight = regression.structure, TIE_BREAK_WEIGHT * (regression.diagonal_sensitivity.max() or 1.0)
    return TracePenalty(float(weight), trace_units(s) ** -2.0, s, np.eye(s.n_parameters))


def certify(estimate: Estimate, dual: Dual | None = None) -> Certificate:
    """Bound how far a conservative estimate is from the best one, by the dual bound of this module.

    Args:
        estimate: Any conservative estimate, from any method.
        dual: Vectors y_k that prove the bound, such as those of a better estimate; None for the unit
            residuals of the estimate itself, which prove much only near an optimum.

    Returns:
        Upper bounds of F_M, and of F_M + w <W, C>, above their least values [1]; both hold for traces within
        `default_trace_bounds`.

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
    """Scale dual vectors that are longer than one to length one.

    Args:
        y: Their components against the rows of every term's R, (terms, n) [1].
        y_unexplained: Their components against the unexplained residual, (terms,) [1].

    Returns:
        The dual, every vector of length one at most.
    """
    length = np.maximum(1.0, np.hypot(np.linalg.norm(y, axis=1), y_unexplained))
    return Dual(y / length[:, None], y_unexplained / length)


def gradient_dual(regression: Regression, pi: Array) -> Dual:
    """Compute the unit residuals y_k = r_k / |r_k| of parameters; their S_i are the gradient of F_M there.

    Mathematics: `est-13`.

    Args:
        regression: The reduced dataset.
        pi: Parameters, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        The dual, one vector per term of F_M; zero where the residual is zero.
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
    """Bound F_M(pi), and F_M(pi) + w <W, C>, above their least values by a dual.

    Mathematics: `est-12`.

    Args:
        regression: The reduced dataset, by the parameters of the penalty's own structure.
        pi: Parameters of a conservative model in that structure, (n,) [m/N, rad/(N m), rad/N].
        dual: Vectors y_k, none longer than one.
        trace_bounds: Bound t_i of every block's trace in scaled units, (blocks,) [rad/(N m)]; None for
            `default_trace_bounds`.
        penalty: The trace term w <W, C>.

    Returns:
        The certificate, all costs in units of F_M [1].
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

    def over(cost: float, trace_gradient: Array) -> float:
        """Bound how far a cost lies above the least value of its program.

        Args:
            cost: F_M, or F_M with the trace term [1].
            trace_gradient: Gradient of the trace term that the cost includes, (n,).

        Returns:
            Upper bound of the distance [1].
        """
        # A negative eigenvalue of S_i can lower the cost by at most -lambda_min t_i.
        least = constant - float(np.maximum(0, -_smallest_eigenvalues(regression, g, trace_gradient)) @ t)
        return max(0.0, cost - max(0.0, least))  # the cost is a sum of norms and traces

    return Certificate(
        duality_gap=over(cost + float(penalty.gradient @ pi), penalty.gradient),
        f_m_excess_bound=over(cost, free),
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
    """Compute the traces up to which a certificate holds, as far as the data bound them, axis by axis.

    An axis d is allowed c_d = 2 F_M(0) / |R e_d|, with R e_d the weighted readings that a unit of C_dd causes
    in all terms; a block is allowed the sum over its axes. By the triangle inequality a model with C_dd = c
    and nothing else has F_M >= sum_k (c |R_k e_d| - |z_k|) >= c |R e_d| - F_M(0): with c above c_d it fits
    worse than a rigid arm. This holds for every axis that a reading observes, however little.

    It is proven for one axis at a time and assumed for several: compliances whose deflections cancel may be
    larger and still fit. An axis that no reading observes is treated as if its sensitivity were
    `UNOBSERVED_SENSITIVITY` of the largest. A block is allowed twice the trace of pi if that is more.

    Mathematics: `est-14`.

    Args:
        regression: The reduced dataset.
        pi: Parameters of the model that is certified, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        Bound t_i of every block's trace in scaled units, (blocks,) [rad/(N m)].
    """
    s = regression.structure
    used = s.block_of_row >= 0
    unit = trace_units(s)[used] ** 2
    sensitivity = regression.diagonal_sensitivity[used] * unit
    sensitivity[sensitivity == 0] = UNOBSERVED_SENSITIVITY * (sensitivity.max() or 1.0)
    allowed = 2 * f_m(regression, np.zeros(s.n_parameters)) / sensitivity
    doubled = 2 * np.diag(s.matrix(pi))[used] / unit
    return np.maximum(*(np.bincount(s.block_of_row[used], weights=trace) for trace in (allowed, doubled)))


def total_trace(structure: Structure, pi: Array) -> float:
    """Compute the trace of C_theta in scaled units.

    Args:
        structure: The unknowns.
        pi: Parameters, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        tr(s^-1 C_theta s^-1) [rad/(N m)], with s of `trace_units`.
    """
    diagonal = structure.rows == structure.columns
    return float((pi[diagonal] / trace_units(structure)[structure.rows[diagonal]] ** 2).sum())


# --- Gramian-constrained optimisation as a conic program with a certificate ---------------------------------

REPORTED_TIE_BREAK_COST = 1e-4
"""Share of F_M that the tie-break may cost before the advice mentions it."""
RELATIVE_GAP_TOLERANCE = 1e-5
"""Proven distance of F_M + trace term from its optimum, relative to F_M, below which it is solved."""
NOISE_FREE_GAP_TOLERANCE = 1e-7
"""Proven distance relative to F_M at C = 0: where the data are noise-free, F_M has no scale of its own.

Without noise the tie-break alone costs 0.3 to 2 times as much and F_M a tenth at most, so that F_M decides:
what rounding changes in the trace does not.
"""
EXACT_FIT_SHARE = 1e-9  #: Share of F_M at C = 0 below which the fit is exact: noise-free data.
MAX_INTERIOR_POINT_GAP = (
    1e-9  #: Gap in the unit of F_M up to which the dense answer is taken; most are far nearer.
)
#: Residuals in their squares, over the unit of F_M: so that squares decide, not the trace.
SQUARED_RESIDUAL_SCALE = 100.0


@dataclass(frozen=True)
class ConicProgram:
    """Hold the conic program of GCO in units where the data are of order one.

    A block of C_theta that no data touch is no part of it: its least trace is zero.
    """

    parameter_indices: Ids  #: Parameters of the blocks that the data touch, (k,).
    touched_structure: Structure  #: Those blocks.
    f_m_unit: float  #: F_M at C = 0: the unit of F_M [1].
    parameter_units: Array  #: pi[columns] = scale * x, (k,).
    R: Array  #: Factor R of every term of F_M in these units, (terms, n, k).
    z: Array  #: Readings z of every term in these units, (terms, n).
    unexplained: Array  #: Norm of the readings that no parameter can explain, (terms,).
    trace_cost: Array  #: The trace term per unit of x, in the unit of F_M, (k,).
    penalty: TracePenalty  #: The trace term.

    def to_pi(self, x: Array, n_parameters: int) -> Array:
        """Return all parameters of the structure from the unknowns of the program.

        Args:
            x: Unknowns of the program, (k,) [1].
            n_parameters: Number of parameters of the structure.

        Returns:
            pi, (n,) [m/N, rad/(N m), rad/N]; zero for blocks that no data touch.
        """
        pi = np.zeros(n_parameters)
        pi[self.parameter_indices] = self.parameter_units * x
        return pi


@dataclass(frozen=True)
class ConicSolution:
    """Hold the parameters that a solver found, with their dual."""

    pi: Array  #: Parameters, (n,).
    seconds: float  #: Time inside the solver.
    failure: str  #: Status if it is not proven to be close to the optimum.
    dual: Dual  #: Dual vectors that prove the distance from the optimum.


def solve_gco(regression: Regression, penalty: TracePenalty | None = None) -> Estimate:
    """Minimise F_M + w <W, C>, Eq. (19) and a trace term, over conservative compliances, to the optimum.

    The data rarely see all of C: without the trace term the optimum is not unique, or is only approached as
    an unseen entry grows without end. The certificate bounds what is left of the program, and what the trace
    term costs in F_M.

    Mathematics: `est-7`.

    Args:
        regression: The reduced dataset.
        penalty: The trace term; None for `tie_break_penalty`, so light that it only chooses among models that
            fit alike: the paper's GCO.

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
    left, cost = f_m(split_regression, pi), float(penalty.gradient @ pi)
    method = PAPER_GCO_METHOD if papers else "GCO (conic program)"
    estimate = make_estimate(regression, penalty.pi_per_split_parameter @ pi, method=method, constraint="psd")
    return replace(
        estimate,
        status="solved" if reached and estimate.conservative else answer.failure,
        certificate=certificate,
        solver_seconds=answer.seconds,
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
        regression: The equations, in the parameters of the penalty's structure.
        program: The scaled program.

    Returns:
        The answer; None where a block is not whole, nothing moves, or the answer is not proven.
    """
    s, n = program.touched_structure, regression.structure.n_parameters
    if not s.has_full_blocks or not len(program.parameter_indices) or f_m(regression, np.zeros(n)) == 0:
        return None
    start, order = time.perf_counter(), s.parameter_of_entry
    unit = np.where(s.fills_two_entries[order], math.sqrt(0.5), 1.0)  # parameters over svec
    sizes, x = tuple(len(block) for block in s.blocks), np.empty(len(order))
    norms = BlockProgram(
        program.R[:, :, order] * unit, program.z, program.unexplained, program.trace_cost[order] * unit, sizes
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
    """Minimise the squares of F_M's residuals and the trace term; for data without noise.

    At an exact fit the norms of F_M have no slope, so that their program cannot be solved to its last digits.

    Args:
        regression: The equations, in the parameters of the penalty's structure.
        program: The scaled program.

    Returns:
        Parameters, (n,) [m/N, rad/(N m), rad/N].
    """
    s = program.touched_structure
    R = SQUARED_RESIDUAL_SCALE * program.R.reshape(-1, len(program.parameter_units))
    k, n = R.shape
    solution = cone.solve(
        cone.ConeProgram(
            cost=np.r_[np.zeros(k), program.trace_cost],
            blocks=(cone.free_block(0, k), *compliance_blocks(s, k)),
            constraints=(
                cone.ConeConstraint(
                    "zero", np.c_[np.eye(k), -R], -SQUARED_RESIDUAL_SCALE * program.z.ravel()
                ),
            ),
            quadratic_diagonal=np.r_[np.ones(k), np.zeros(n)],
        )
    )
    return program.to_pi(clip_negative_eigenvalues(s, solution.x[k:]), regression.structure.n_parameters)


def solve_gco_by_clarabel(regression: Regression, program: ConicProgram) -> ConicSolution:
    """Solve the scaled GCO program by Clarabel, with Clarabel's dual as its proof.

    Args:
        regression: The equations, in the parameters of the penalty's structure.
        program: The scaled program.

    Returns:
        Parameters and dual; all parameters are zero where no marker moves.
    """
    s = program.touched_structure
    n = regression.structure.n_parameters
    count = len(program.z)
    if f_m(regression, np.zeros(n)) == 0:
        return ConicSolution(np.zeros(n), 0.0, "", gradient_dual(regression, np.zeros(n)))
    solution = cone.solve(
        cone.ConeProgram(
            cost=np.r_[np.ones(count), program.trace_cost],
            blocks=(cone.free_block(0, count), *compliance_blocks(s, count)),
            constraints=norm_constraints(program.R, program.z, program.unexplained),
        )
    )
    pi = program.to_pi(clip_negative_eigenvalues(s, solution.x[count:]), n)
    z = np.array(solution.duals[:count])
    z /= np.maximum(z[:, :1], TINY)  # a dual of the cone: zero where its head is
    return ConicSolution(pi, solution.seconds, solution.failure, normalise_dual(z[:, 1:-1], -z[:, -1]))


def scaled_gco_program(regression: Regression, penalty: TracePenalty) -> ConicProgram:
    """Scale data, trace term and parameters of GCO to order one.

    Args:
        regression: The equations, in the parameters of the penalty's structure.
        penalty: The trace term.

    Returns:
        The scaled program of the blocks that the data touch.
    """
    s = regression.structure
    block, seen = s.block_of_row[s.rows], np.zeros(len(s.blocks), dtype=bool)
    seen[block[regression.column_norms > 0]] = True
    # Blocks that no reading shows stay zero.
    columns = np.flatnonzero(seen[block])
    kept = _restricted(s, columns.tobytes())
    unit = f_m(regression, np.zeros(s.n_parameters)) or 1.0
    scale = sensitivity_units(regression, unit, penalty)[columns]
    return ConicProgram(
        parameter_indices=columns,
        touched_structure=kept,
        f_m_unit=unit,
        parameter_units=scale,
        R=np.array([term.R[:, columns] for term in regression.terms]) * (scale / unit),
        z=np.array([term.z for term in regression.terms]) / unit,
        unexplained=np.sqrt([term.unexplained for term in regression.terms]) / unit,
        trace_cost=penalty.gradient[columns] * scale / unit,
        penalty=penalty,
    )


@lru_cache(maxsize=64)
def _restricted(structure: Structure, columns: bytes) -> Structure:
    """Restrict a structure to some parameters; cached, because its properties are computed only once."""
    return structure.select_parameters(np.frombuffer(columns, dtype=int), structure.name)


def norm_constraints(R: Array, z: Array, unexplained: Array) -> tuple[cone.ConeConstraint, ...]:
    """Make the constraints |(R_k x - z_k, rest_k)| <= t_k; the unknowns are all t_k, then x.

    Args:
        R: Rows of every term, (terms, rows, n) [1].
        z: Their right-hand side, (terms, rows) [1].
        unexplained: Norm that no x explains, (terms,) [1].

    Returns:
        One second-order cone per term.
    """
    head = np.zeros((len(R), R.shape[1] + 1, len(R)))
    body = np.concatenate([R, np.zeros((len(R), 1, R.shape[2]))], axis=1)
    A, b = np.concatenate([head, body], axis=2), np.c_[z, unexplained]
    return tuple(cone.norm_constraint(k, A[k], b[k]) for k in range(len(R)))


def clip_negative_eigenvalues(structure: Structure, parameters: Array) -> Array:
    """Set the negative eigenvalues of every block to zero.

    Args:
        structure: The unknowns.
        parameters: Parameters, (n,).

    Returns:
        Parameters of the nearest positive semi-definite blocks, (n,).
    """
    X = structure.matrix(parameters)
    for group in structure.block_groups:
        X[group.index_arrays] = cone.nearest_psd(X[group.index_arrays])
    return structure.entries(X)


@lru_cache(maxsize=64)
def compliance_blocks(structure: Structure, first_index: int) -> tuple[cone.Block, ...]:
    """Make the positive semi-definite blocks of C_theta as unknowns of a conic program.

    Args:
        structure: The unknowns.
        first_index: Place of the first parameter among the unknowns of the program.

    Returns:
        One block per block of C_theta.
    """
    blocks = [(block_parameters(structure, block), len(block)) for block in structure.blocks]
    return tuple(cone.Block(first_index + entries, size, svec) for (entries, svec), size in blocks)


def block_parameters(structure: Structure, block_rows: Ids) -> tuple[Ids, Array]:
    """Find the parameters inside one block of C_theta.

    Args:
        structure: The unknowns.
        block_rows: Rows of the block, (size,).

    Returns:
        Places of its parameters, (k,), and the block's svec per unit of them, (size (size + 1) / 2, k).
    """
    position = np.full(structure.n_theta, -1)
    position[block_rows] = np.arange(len(block_rows))
    k = np.flatnonzero(position[structure.rows] >= 0)
    i, j = np.sort([position[structure.rows[k]], position[structure.columns[k]]], axis=0)
    svec = np.zeros((cone.svec_length(len(block_rows)), len(k)))
    svec[j * (j + 1) // 2 + i, np.arange(len(k))] = np.where(i == j, 1.0, math.sqrt(2))
    return k, svec
