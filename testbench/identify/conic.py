"""Gramian-constrained optimisation as a conic program with a certificate.

Over C_i = V_i^T V_i, F_M(b) of Eq. (19) is not convex; over C_i positive semi-definite it is, and the two
sets are one (Theorem 1). Solved in scaled units, by our dense method where blocks are whole, all datasets of
a structure at once; by Clarabel where they are not, or where the dense answer is not proven.
"""

import math
import time
from collections.abc import Sequence
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
PROVEN = (
    1e-9  #: Gap in the unit of F_M up to which the dense answer is taken; most are a hundred times nearer.
)
TOGETHER = 500_000  #: Entries of the matrices of as many programs as go together: few enough for the cache.
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
    return optimum_each([regression])[0]


def optimum_each(regressions: Sequence[Regression]) -> list[Estimate]:
    """The same of many datasets of one structure."""
    check_symmetric(regressions[0].structure)
    programs = [scale_program(regression) for regression in regressions]
    found = zip(regressions, programs, answers(regressions, programs), strict=True)
    return [_estimate(*own) for own in found]


def _estimate(regression: Regression, program: Program, answer: "Answer") -> Estimate:
    """What is known of an answer."""
    pi = answer.pi
    certificate = bound(regression, pi, answer.dual or gradient_dual(regression, pi))
    left = f_m(regression, pi)
    over = min(certificate.duality_gap, left)  # F_M cannot be negative
    reached = over <= GAP_TOLERANCE * left + DATA_TOLERANCE * program.unit
    held = left > EXACT * program.unit and _held(regression, program, pi)
    estimate = make_estimate(
        regression, pi, method="GCO (conic program)", constraint="psd", advice=_advice(regression, held)
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
    """What a solver found."""

    pi: Array  #: Parameters, (n,).
    seconds: float  #: Time inside the solver.
    failure: str  #: What is said where it is not proven to be near the optimum.
    dual: Dual | None = None  #: Its proof; None for the gradient of F_M.


def optima(regressions: Sequence[Regression]) -> Array:
    """Parameters that `optimum` finds, of many datasets of one structure, (datasets, n)."""
    return np.array([a.pi for a in answers(regressions, [scale_program(r) for r in regressions])])


def answers(regressions: Sequence[Regression], programs: Sequence[Program]) -> list[Answer]:
    """The answers to the programs of some datasets of one structure, those of one shape together."""
    found: dict[int, Answer] = {}
    shapes: dict[bytes, list[int]] = {}
    for k, (regression, program) in enumerate(zip(regressions, programs, strict=True)):
        still = np.zeros(regression.structure.n)
        if f_m(regression, still) == 0:  # nothing moves: a rigid arm, and no unit
            found[k] = Answer(still, 0.0, "")
        elif program.structure.whole and len(program.columns):
            shapes.setdefault(bytes([len(regression.terms)]) + program.columns.tobytes(), []).append(k)
    for alike in shapes.values():
        each = max(1, TOGETHER // len(programs[alike[0]].columns) ** 2)
        for first in range(0, len(alike), each):
            share = alike[first : first + each]
            found |= zip(share, _dense([(regressions[k], programs[k]) for k in share]), strict=True)
    return [found.get(k) or by_clarabel(regressions[k], programs[k]) for k in range(len(programs))]


def _better(regression: Regression, program: Program, own: Answer) -> Answer:
    """Of an answer that is not proven and the referee's the one of which more is proven.

    Without noise F_M has no slope to speak of at its optimum, and both solvers end by rounding: which of them
    is nearer changes with the last digits of the readings, the better of both hardly.
    """
    referee = by_clarabel(regression, program)
    ways = [(own.pi, gradient_dual(regression, own.pi))]
    ways += [(answer.pi, referee.dual) for answer in (own, referee) if referee.dual]
    pi, dual = min(ways, key=lambda way: bound(regression, *way).duality_gap)
    return Answer(pi, own.seconds + referee.seconds, referee.failure, dual)


def _dense(some: Sequence[tuple[Regression, Program]]) -> list[Answer]:
    """Our own answers to programs of one shape; the referee is asked where one is not proven."""
    start = time.perf_counter()
    structure = some[0][1].structure
    order = structure.parameter
    unit = np.where(structure.mirrored[order], math.sqrt(0.5), 1.0)  # parameters over svec
    norms = [_norm(some, k, order, unit) for k in range(len(some[0][0].terms))]
    trace = np.array([trace_cost(program)[order] * unit for _, program in some])
    sizes = tuple(len(block) for block in structure.blocks)
    xs, gaps = least_norms(Programs(tuple(norms), trace, sizes), PROVEN)
    seconds = (time.perf_counter() - start) / len(some)
    result = []
    for (regression, program), x, gap in zip(some, xs, gaps, strict=True):
        pi = np.zeros(regression.structure.n)
        pi[program.columns[order]] = program.scale[order] * unit * x
        own = Answer(pi, seconds, f"proven to {gap:.1g} of F_M without a model")
        if gap > PROVEN:
            own = _better(regression, program, own) if gap < 1 else by_clarabel(regression, program)
        result.append(own)
    return result


def _norm(some: Sequence[tuple[Regression, Program]], k: int, order: Ids, unit: Array) -> Norm:
    """A term of F_M in coordinates of the blocks, in the programs' units of F_M, which cancel in its rows."""
    terms = [regression.terms[k] for regression, _ in some]
    shared = len({(id(regression.terms[k].R), id(regression.weight)) for regression, _ in some}) == 1
    R = np.array(
        [
            regression.terms[k].R[:, p.columns[order]] * (p.scale[order] * unit / p.unit)
            for regression, p in (some[:1] if shared else some)
        ]
    )
    return Norm(
        R=R,
        gram=R.swapaxes(1, 2) @ R,
        z=np.array([term.z / p.unit for term, (_, p) in zip(terms, some, strict=True)]),
        rest=np.array([math.sqrt(term.rest) / p.unit for term, (_, p) in zip(terms, some, strict=True)]),
    )


def by_clarabel(regression: Regression, program: Program) -> Answer:
    """The answer of an independent solver, with the proof that is its own."""
    s, terms, pi = program.structure, regression.terms, np.zeros(regression.structure.n)
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
