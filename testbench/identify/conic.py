"""Gramian-constrained optimisation as a conic program with a certificate.

Over C_i = V_i^T V_i, F_M(b) of Eq. (19) is not convex; over C_i positive semi-definite it is, and the two
sets are one (Theorem 1). Solved by Clarabel's interior-point method in scaled units.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.certify import bound_gap, scaled_units, total_trace
from testbench.identify.estimate import Certificate, Dual, Estimate, make_estimate
from testbench.identify.metric import clipped
from testbench.identify.regression import Ids, Regression, Term, check_symmetric, f_m
from testbench.model.structure import Structure

TRACE_WEIGHT = 1e-8
"""Weight of the trace beside F_M, both as shares of what the data span.

It picks the least trace among models that fit alike. Where the fit goes on improving as unseen compliance
grows without end, there is no such model, and the weight decides where to stop: the advice says so.
"""
PENALTY_TOLD = 1e-4  #: Share of F_M that the trace term may cost before the advice tells of it.
GAP_TOLERANCE = 1e-5
"""Proven distance of F_M + trace term from its optimum, relative to F_M, below which it is solved."""
DATA_TOLERANCE = 1e-7
"""The same relative to F_M at C = 0: where the data are noise-free, F_M has no scale of its own."""
EXACT = 1e-9  #: Share of F_M at C = 0 below which the fit is exact: noise-free data.
UNSEEN_WEIGHT = 1e-3
"""Sensitivity of an axis that the data do not load, as a share of the largest: for scaling only."""


@dataclass(frozen=True)
class Program:
    """The conic program in units where the data are of order one.

    A block of C_theta that no data touch is no part of it: its least trace is zero.
    """

    columns: Ids  #: Parameters of the blocks that the data touch, (k,).
    structure: Structure  #: Those blocks.
    unit: float  #: F_M at C = 0: the unit of F_M [1].
    scale: Array  #: pi[columns] = scale * x, (k,).
    trace_weight: float  #: Weight of the total trace in scaled units beside F_M [N m/rad].


def optimum(regression: Regression) -> Estimate:
    """GCO to global optimality: minimise F_M, Eq. (19), over conservative compliances.

    The data rarely see all of C: then the optimum is not unique, or is only approached as an unseen entry
    grows without end. So the trace in scaled units is minimised beside F_M with a small weight: among models
    that fit alike it takes the one of least trace. The certificate bounds the gap of F_M itself.

    Raises:
        BenchError: When the structure is not symmetric.
    """
    structure = regression.structure
    check_symmetric(structure)
    program = scale_program(regression)
    solution = _solve(regression, program)
    terms = len(regression.terms)
    pi = np.zeros(structure.n)
    pi[program.columns] = program.scale * clip(program.structure, solution.x[terms:])
    z = np.array(solution.duals[:terms])
    certificate = bound_gap(regression, pi, Dual(z[:, 1:-1] / z[:, :1], -z[:, -1] / z[:, 0]))
    exact = f_m(regression, pi) <= EXACT * program.unit  # and F_M cannot be negative
    solved = exact or _reached(regression, program, pi, certificate)
    held = not exact and _held(regression, program, pi)
    estimate = make_estimate(
        regression, pi, method="GCO (conic program)", constraint="psd", advice=_advice(regression, held)
    )
    return replace(
        estimate,
        status="solved" if solved else solution.failure,
        certificate=certificate,
        solver_seconds=solution.seconds,
        held_by_trace_weight=held,
    )


def _reached(regression: Regression, program: Program, pi: Array, certificate: Certificate) -> bool:
    """Whether F_M + trace term is proven to be as close to its optimum as asked."""
    t, weight = certificate.trace_bounds, program.trace_weight
    gap = bound_gap(regression, pi, certificate.dual, t, trace_weight=weight).gap
    return gap <= GAP_TOLERANCE * f_m(regression, pi) + DATA_TOLERANCE * program.unit


def _held(regression: Regression, program: Program, pi: Array) -> bool:
    """Whether the trace term costs so much that only its weight holds unseen compliance."""
    cost = program.trace_weight * total_trace(regression.structure, pi)
    return bool(cost > PENALTY_TOLD * f_m(regression, pi))  # which JSON can write


def _advice(regression: Regression, held: bool) -> tuple[str, ...]:
    advice: tuple[str, ...] = ()
    if regression.rank < regression.structure.n:
        advice = (f"GCO filled the free directions with the least trace, weight {TRACE_WEIGHT:g}",)
    if held:
        advice += (
            f"{regression.structure.name}: only the trace weight holds unseen compliance, which fits a "
            "little better as it grows; predictions away from the measured poses hang on it",
        )
    return advice


def scale_program(regression: Regression) -> Program:
    """Units in which data and parameters are of order one."""
    s, weight = regression.structure, regression.weight
    touched = np.flatnonzero(regression.columns)
    columns = np.flatnonzero(np.isin(s.block_of[s.a], s.block_of[s.a[touched]]))
    kept = s.keep(columns, s.name)
    unit = f_m(regression, np.zeros(s.n)) or 1.0
    scale = sensitivity_units(regression, unit)[columns]
    return Program(columns, kept, unit, scale, TRACE_WEIGHT * (weight.max() or 1.0))


def sensitivity_units(regression: Regression, unit: float = 1.0) -> Array:
    """Units of pi in which its parameters move F_M alike, by this unit of F_M, (n,): C = unit d X d^T.

    d^-2 is the F_M that a unit of each diagonal entry causes: a congruence, so that X is positive
    semi-definite where C is.
    """
    s, weight = regression.structure, regression.weight
    d = 1 / np.sqrt(np.maximum(weight, UNSEEN_WEIGHT * (weight.max() or 1.0)))
    return np.asarray(unit * d[s.a] * d[s.b])


def trace_cost(program: Program) -> Array:
    """Trace term per unit of x, in the program's unit of F_M, (k,)."""
    s = program.structure
    trace = np.where(s.a == s.b, program.scale / scaled_units(s)[s.a] ** 2, 0.0)
    return np.asarray(program.trace_weight * trace / program.unit)


def f_m_norms(terms: tuple[Term, ...], rows: list[Array], unit: float) -> tuple[cone.Rows, ...]:
    """|(R x - z, sqrt(rest))| <= t_k for every term of F_M; the unknowns are all t_k, then x.

    `rows` are R of each in units of x over that of F_M, (n, k); `unit` is that of F_M.
    """
    count = len(terms)
    found = []
    for k, (term, R) in enumerate(zip(terms, rows, strict=True)):
        A = np.zeros((len(R) + 1, count + R.shape[1]))
        A[:-1, count:] = R
        found.append(cone.norm_below(k, A, np.r_[term.z, math.sqrt(term.rest)] / unit))
    return tuple(found)


def clip(s: Structure, x: Array) -> Array:
    """Parameters with every block's negative eigenvalues set to zero."""
    return s.entries(clipped(s, s.matrix(x)))


def _solve(regression: Regression, program: Program) -> cone.Solution:
    """Minimise sum t + trace term, every block positive semi-definite."""
    s, terms = program.structure, regression.terms
    count = len(terms)
    rows = [term.R[:, program.columns] * (program.scale / program.unit) for term in terms]
    return cone.solve(
        cone.Problem(
            cost=np.r_[np.ones(count), trace_cost(program)],
            blocks=(cone.free_block(0, count), *(_block(s, block, count) for block in s.blocks)),
            rows=f_m_norms(terms, rows, program.unit),
        )
    )


def _block(s: Structure, block: Ids, first: int) -> cone.Block:
    """The unknown entries of a block of C_theta; the others are zero."""
    position = np.full(s.n_theta, -1)
    position[block] = np.arange(len(block))
    k = np.flatnonzero(position[s.a] >= 0)
    i, j = np.sort([position[s.a[k]], position[s.b[k]]], axis=0)
    svec = np.zeros((cone.triangle(len(block)), len(k)))
    svec[j * (j + 1) // 2 + i, np.arange(len(k))] = np.where(i == j, 1.0, math.sqrt(2))
    return cone.Block(first + k, len(block), svec)
