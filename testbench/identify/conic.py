"""Gramian-constrained optimisation as a conic program with a certificate.

Over C_i = V_i^T V_i, F_M(b) of Eq. (19) is not convex; over C_i positive semi-definite it is, and the two
sets are one (Theorem 1). Solved in scaled units by Clarabel, the last digits by Newton's method.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.certify import (
    TRACE_WEIGHT,
    bound,
    gradient_dual,
    scaled_units,
    shortened,
    total_trace,
    trace_weight,
)
from testbench.identify.estimate import Dual, Estimate, make_estimate
from testbench.identify.metric import clipped
from testbench.identify.projected import Start, follow, groups_of
from testbench.identify.regression import Ids, Regression, Term, check_symmetric, f_m
from testbench.model.structure import Structure

PENALTY_TOLD = 1e-4  #: Share of F_M that the trace term may cost before the advice tells of it.
GAP_TOLERANCE = 1e-5
"""Proven distance of F_M + trace term from its optimum, relative to F_M, below which it is solved."""
DATA_TOLERANCE = 1e-6
"""The same relative to F_M at C = 0: where the data are noise-free, F_M has no scale of its own, and rounding
ends Clarabel at 1e-7 or so."""
EXACT = 1e-9  #: Share of F_M at C = 0 below which the fit is exact: noise-free data.
FITS = 1e-5
"""The same below which a fit is solved whatever is proven: F_M cannot be negative, and without noise rounding
ends Clarabel anywhere between the two."""
REGULARISATIONS = (cone.REGULARISATION, 1e-7)
"""Of the solver's linear systems: the second is for data without noise, where rounding may end the first."""
LAST = (1e-10, 1e-11, 1e-12)  #: Gaps in the unit of F_M: the end of a path of `projected`.
TINY = 1e-300
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

    def cost(self, regression: Regression, pi: Array) -> float:
        """F_M and the trace term of parameters, (n,)."""
        return f_m(regression, pi) + self.trace_weight * total_trace(regression.structure, pi)


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
    for regularisation in REGULARISATIONS:
        answer = by_clarabel(regression, program, regularisation)
        certificate, left = bound(regression, answer.pi, answer.dual), f_m(regression, answer.pi)
        near = GAP_TOLERANCE * left + DATA_TOLERANCE * program.unit
        reached = certificate.duality_gap <= near or left <= FITS * program.unit
        if reached:
            break
    exact = left <= EXACT * program.unit
    held = not exact and _held(regression, program, answer.pi)
    advice = _advice(regression, held)
    estimate = make_estimate(
        regression, answer.pi, method="GCO (conic program)", constraint="psd", advice=advice
    )
    return replace(
        estimate,
        status="solved" if reached and estimate.conservative else answer.failure,
        certificate=certificate,
        solver_seconds=answer.seconds,
        held_by_trace_weight=held,
    )


@dataclass(frozen=True)
class Answer:
    """What the solver found."""

    pi: Array  #: Parameters, (n,).
    seconds: float  #: Time inside the solver.
    failure: str  #: What is said where it is not proven to be near the optimum.
    dual: Dual  #: Its proof.


def by_clarabel(
    regression: Regression, program: Program, regularisation: float = cone.REGULARISATION
) -> Answer:
    """Minimise sum t + trace term, every block positive semi-definite, with the solver's own proof."""
    s, terms, pi = program.structure, regression.terms, np.zeros(regression.structure.n)
    if f_m(regression, pi) == 0:  # nothing moves: a rigid arm
        return Answer(pi, 0.0, "", gradient_dual(regression, pi))
    count = len(terms)
    rows = [term.R[:, program.columns] * (program.scale / program.unit) for term in terms]
    solution = cone.solve(
        cone.Problem(
            cost=np.r_[np.ones(count), trace_cost(program)],
            blocks=(cone.free_block(0, count), *psd_blocks(s, count)),
            rows=f_m_norms(terms, rows, program.unit),
        ),
        regularisation=regularisation,
    )
    x = solution.x[count:]
    if s.whole and s.n:
        x = _ended(program, terms, rows, x, np.concatenate(solution.duals[count:]))
    pi[program.columns] = program.scale * clip(s, x)
    z = np.array(solution.duals[:count])
    z /= np.maximum(z[:, :1], TINY)  # a dual of the cone: zero where its head is
    return Answer(pi, solution.seconds, solution.failure, shortened(z[:, 1:-1], -z[:, -1]))


def _ended(program: Program, terms: tuple[Term, ...], rows: list[Array], x: Array, s: Array) -> Array:
    """The optimum to the last digits, from near it and its multipliers; x itself where that leads nowhere.

    A solver that ends at a gap of 1e-10 leaves what the data hardly see loose: predictions elsewhere would
    move by 1e-5 with the last digits of the readings. Newton's steps on the projection take that back.
    """
    structure = program.structure
    order, sizes = structure.parameter, [len(block) for block in structure.blocks]
    own = np.where(structure.mirrored[order], math.sqrt(0.5), 1.0)  # parameters over svec
    trace, parts = trace_cost(program)[order] * own, []
    for R, term in zip((R[:, order] * own for R in rows), terms, strict=True):
        parts.append((R, R.T @ R, term.z / program.unit, term.rest / program.unit**2))

    def cost(x: Array) -> tuple[Array, Array]:
        gradient, second = trace.copy(), np.zeros((len(x), len(x)))
        for R, gram, z, rest in parts:
            left = R @ x - z
            norm = math.sqrt(left @ left + rest) or TINY
            pull = R.T @ left / norm
            gradient += pull
            second += (gram - np.outer(pull, pull)) / norm
        return gradient, second

    at, groups = x[order] / own, groups_of(sizes)
    with np.errstate(all="ignore"):  # a step that is not finite ends it
        for unit in (float(np.linalg.norm(at) / (np.linalg.norm(s) + TINY)), float(at @ at) / sum(sizes)):
            start = Start(u=at - unit * s, unit=unit, square=unit / sum(sizes), size=1.0)
            found = follow(LAST, start, cost, groups)
            if found is not None:
                x = x.copy()
                x[order] = own * found[0]
                break
    return x


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
