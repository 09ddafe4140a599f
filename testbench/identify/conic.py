"""Gramian-constrained optimisation as a conic program with a certificate.

Over C_i = V_i^T V_i, F_M(b) of Eq. (19) is not convex; over C_i positive semi-definite it is, and the two
sets are one (Theorem 1). Solved in scaled units, by our dense method where blocks are whole, which holds
unseen directions far firmer; by Clarabel where they are not, or where the dense answer is not proven.
"""

import math
import time
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy import sparse

from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.certify import (
    bound,
    gradient_dual,
    scaled_units,
    shortened,
    total_trace,
    trace_weight,
)
from testbench.identify.estimate import Certificate, Dual, Estimate, make_estimate
from testbench.identify.interior import TINY, Programs, least_norms
from testbench.identify.interior import Term as Norm
from testbench.identify.metric import clipped
from testbench.identify.regression import Ids, Regression, Term, check_symmetric, f_m
from testbench.model.structure import Structure

PENALTY_TOLD = 1e-4  #: Share of F_M that the trace term may cost before the advice tells of it.
GAP_TOLERANCE = 1e-5
"""Proven distance of F_M + trace term from its optimum, relative to F_M, below which it is solved."""
DATA_TOLERANCE = 1e-7
"""The same relative to F_M at C = 0: where the data are noise-free, F_M has no scale of its own.

Without noise the trace term alone costs 0.3 to 2 times as much and F_M a tenth at most, so that F_M decides:
what rounding changes in the trace does not.
"""
EXACT = 1e-9  #: Share of F_M at C = 0 below which the fit is exact: noise-free data.
PROVEN = 1e-9  #: Gap in the unit of F_M up to which the dense answer is taken; most are far nearer.
SHARP = 100.0  #: Residuals in their squares, over the unit of F_M: so that squares decide, not the trace.
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


@dataclass(frozen=True)
class Answer:
    """What a solver found."""

    pi: Array  #: Parameters, (n,).
    seconds: float  #: Time inside the solver.
    failure: str  #: What is said where it is not proven to be near the optimum.
    dual: Dual  #: Its proof.


def optimum(regression: Regression) -> Estimate:
    """GCO to global optimality: minimise F_M, Eq. (19), over conservative compliances.

    The data rarely see all of C: then the optimum is not unique, or is only approached as an unseen entry
    grows without end. So the trace in scaled units is minimised beside F_M with a small weight: among models
    that fit alike it takes the one of least trace. The certificate bounds what is left of the program, and
    what the weight costs in F_M.

    Raises:
        BenchError: When the structure is not symmetric.
    """
    check_symmetric(regression.structure)
    program = scale_program(regression)
    answer = by_interior(regression, program) or by_clarabel(regression, program)
    pi = answer.pi
    certificate, reached = _judged(regression, program, pi, answer.dual)
    if not reached:
        other = by_squares(regression, program)
        proof, better = _judged(regression, program, other, gradient_dual(regression, other))
        if better or proof.duality_gap < certificate.duality_gap:
            pi, certificate, reached = other, proof, better
    left = f_m(regression, pi)
    held = left > EXACT * program.unit and _held(regression, program, pi)
    estimate = make_estimate(regression, pi, method="GCO (conic program)", constraint="psd")
    return replace(
        estimate,
        status="solved" if reached and estimate.conservative else answer.failure,
        certificate=certificate,
        solver_seconds=answer.seconds,
        held_by_trace_weight=held,
    )


def _judged(regression: Regression, program: Program, pi: Array, dual: Dual) -> tuple[Certificate, bool]:
    """What a dual proves of parameters, and whether they are so near the optimum that they are solved."""
    certificate, left = bound(regression, pi, dual), f_m(regression, pi)
    over = min(certificate.duality_gap, left)  # F_M cannot be negative
    return certificate, over <= GAP_TOLERANCE * left + DATA_TOLERANCE * program.unit


def by_interior(regression: Regression, program: Program) -> Answer | None:
    """Our own answer; None where a block is not whole, nothing moves, or the answer is not proven."""
    s, pi = program.structure, np.zeros(regression.structure.n)
    if not s.whole or not len(program.columns) or f_m(regression, pi) == 0:
        return None
    start, order = time.perf_counter(), s.parameter
    unit = np.where(s.mirrored[order], math.sqrt(0.5), 1.0)  # parameters over svec
    scale = program.scale[order] * unit
    norms = tuple(_norm(term, program, scale) for term in regression.terms)
    sizes = tuple(len(block) for block in s.blocks)
    x, gap = least_norms(Programs(norms, (trace_cost(program)[order] * unit)[None], sizes), PROVEN)
    if gap[0] > PROVEN:
        return None
    pi[program.columns[order]] = scale * x[0]
    failure = f"proven to {gap[0]:.1g} of F_M without a model"
    return Answer(pi, time.perf_counter() - start, failure, gradient_dual(regression, pi))


def _norm(term: Term, program: Program, scale: Array) -> Norm:
    """A term of F_M in coordinates of the blocks, over the unit of F_M, which cancels in its rows."""
    R = (term.R[:, program.columns[program.structure.parameter]] * (scale / program.unit))[None]
    rest = np.array([math.sqrt(term.rest) / program.unit])
    return Norm(R, R.swapaxes(1, 2) @ R, term.z[None] / program.unit, rest)


def by_squares(regression: Regression, program: Program) -> Array:
    """Parameters of least squares and trace term: without noise norms have no slope at their optimum."""
    s, pi = program.structure, np.zeros(regression.structure.n)
    R = np.vstack([term.R[:, program.columns] * (program.scale / program.unit) for term in regression.terms])
    z = np.concatenate([term.z for term in regression.terms]) / program.unit
    k, n = R.shape
    solution = cone.solve(
        cone.Problem(
            cost=np.r_[np.zeros(k), trace_cost(program)],
            blocks=(cone.free_block(0, k), *psd_blocks(s, k)),
            rows=(cone.Rows("zero", np.c_[np.eye(k), -SHARP * R], -SHARP * z),),
            quadratic=sparse.csc_matrix(sparse.block_diag([sparse.eye(k), sparse.csc_matrix((n, n))])),
        )
    )
    pi[program.columns] = program.scale * clip(s, solution.x[k:])
    return pi


def by_clarabel(regression: Regression, program: Program) -> Answer:
    """Clarabel's answer and its own proof; where nothing moves, a rigid arm."""
    s, terms, pi = program.structure, regression.terms, np.zeros(regression.structure.n)
    if f_m(regression, pi) == 0:
        return Answer(pi, 0.0, "", gradient_dual(regression, pi))
    count = len(terms)
    rows = [term.R[:, program.columns] * (program.scale / program.unit) for term in terms]
    solution = cone.solve(
        cone.Problem(
            cost=np.r_[np.ones(count), trace_cost(program)],
            blocks=(cone.free_block(0, count), *psd_blocks(s, count)),
            rows=f_m_norms(terms, rows, program.unit),
        )
    )
    pi[program.columns] = program.scale * clip(s, solution.x[count:])
    z = np.array(solution.duals[:count])
    z /= np.maximum(z[:, :1], TINY)  # a dual of the cone: zero where its head is
    return Answer(pi, solution.seconds, solution.failure, shortened(z[:, 1:-1], -z[:, -1]))


def _held(regression: Regression, program: Program, pi: Array) -> bool:
    """Whether the trace term costs so much that only its weight holds unseen compliance."""
    cost = program.trace_weight * total_trace(regression.structure, pi)
    return bool(cost > PENALTY_TOLD * f_m(regression, pi))  # which JSON can write


def scale_program(regression: Regression) -> Program:
    """Units in which data and parameters are of order one."""
    s = regression.structure
    block, seen = s.block_of[s.a], np.zeros(len(s.blocks), dtype=bool)
    seen[block[regression.columns > 0]] = True
    columns = np.flatnonzero(seen[block])
    kept = _kept(s, columns.tobytes())
    unit = f_m(regression, np.zeros(s.n)) or 1.0
    scale = sensitivity_units(regression, unit)[columns]
    return Program(columns, kept, unit, scale, trace_weight(regression))


@lru_cache(maxsize=64)
def _kept(structure: Structure, columns: bytes) -> Structure:
    """The structure with these parameters only: what follows from it is found once, not once a fit."""
    return structure.keep(np.frombuffer(columns, dtype=int), structure.name)


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


@lru_cache(maxsize=64)
def psd_blocks(s: Structure, first: int) -> tuple[cone.Block, ...]:
    """The blocks of C_theta as unknowns of a program, the parameters standing there from `first` on."""
    found = [(psd_entries(s, block), len(block)) for block in s.blocks]
    return tuple(cone.Block(first + entries, size, svec) for (entries, svec), size in found)


def psd_entries(s: Structure, block: Ids) -> tuple[Ids, Array]:
    """The parameters in a block of C_theta, (k,), and its svec per unit of them; other entries are zero."""
    position = np.full(s.n_theta, -1)
    position[block] = np.arange(len(block))
    k = np.flatnonzero(position[s.a] >= 0)
    i, j = np.sort([position[s.a[k]], position[s.b[k]]], axis=0)
    svec = np.zeros((cone.triangle(len(block)), len(k)))
    svec[j * (j + 1) // 2 + i, np.arange(len(k))] = np.where(i == j, 1.0, math.sqrt(2))
    return k, svec
