"""Gramian-constrained optimisation as a conic program with a certificate.

Over C_i = V_i^T V_i, F_M(b) of Eq. (19) is not convex; over C_i positive semi-definite it is, and the two
sets are one (Theorem 1). Solved by Clarabel's interior-point method in scaled units.
"""

import math
from dataclasses import dataclass

import clarabel
import numpy as np
import numpy.typing as npt
from scipy import sparse

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.identify.certify import bound_gap, scaled_units, total_trace
from testbench.identify.estimate import Dual, Estimate, make_estimate
from testbench.identify.regression import Regression, f_m, reduce
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

TRACE_WEIGHT = 1e-8
"""Weight of the trace beside F_M, both as shares of what the data span.

It picks the least trace among models that fit alike. Where the fit goes on improving as unseen compliance
grows without end, there is no such model, and the weight decides where to stop: the advice says so.
"""
PENALTY_TOLD = 1e-4
"""Share of F_M that the trace term may cost before the advice tells of it."""
HELD = "only the trace weight holds unseen compliance, which fits a little better as it grows"
SOLVER_TOLERANCE = 1e-10
"""Feasibility and gap asked of Clarabel, in units where the data are of order one."""
GAP_TOLERANCE = 1e-5
"""Proven distance of F_M + trace term from its optimum, relative to F_M, below which it is solved."""
DATA_TOLERANCE = 1e-7
"""The same relative to F_M at C = 0: where the data are noise-free, F_M has no scale of its own."""
EXACT = 1e-9
"""Share of F_M at C = 0 below which the fit is exact: noise-free data."""
UNSEEN_WEIGHT = 1e-3
"""Sensitivity of an axis that the data do not load, as a share of the largest: for scaling only."""


@dataclass(frozen=True)
class Program:
    """The conic program in units where the data are of order one.

    A block of C_theta that no data touch is no part of it: its least trace is zero.

    Attributes:
        columns: Parameters of the blocks that the data touch, (k,).
        structure: Those blocks.
        unit: F_M at C = 0: the unit of F_M [1].
        scale: pi[columns] = scale * x, (k,).
        trace_weight: Weight of the total trace in scaled units beside F_M [N m/rad].
    """

    columns: npt.NDArray[np.int_]
    structure: Structure
    unit: float
    scale: Array
    trace_weight: float


def gco(vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
    """GCO to global optimality: minimise F_M, Eq. (19), over conservative compliances.

    The data rarely see all of C: then the optimum is not unique, or is only approached as an unseen entry
    grows without end. So the trace in scaled units is minimised beside F_M with a small weight: among models
    that fit alike it takes the one of least trace. The certificate bounds the gap of F_M itself.

    Args:
        vjm: The model.
        structure: The unknowns.
        data: The runs.

    Raises:
        BenchError: When the dataset is empty or names a marker that the arm lacks, or the structure is not
            symmetric.
    """
    return optimum(reduce(vjm, structure, data))


def optimum(regression: Regression) -> Estimate:
    """The conservative model of least F_M on a reduced dataset, as in `gco`.

    Raises:
        BenchError: When the structure is not symmetric.
    """
    structure = regression.structure
    check_symmetric(structure)
    program = scale_program(regression)
    solution = _solve(regression, program)
    terms = len(regression.terms)
    pi = np.zeros(structure.n)
    pi[program.columns] = program.scale * _project(program.structure, np.array(solution.x)[terms:])
    z = np.array(solution.z)[: terms * (structure.n + 2)].reshape(terms, -1)
    dual = Dual(z[:, 1:-1] / z[:, :1], -z[:, -1] / z[:, 0])
    certificate = bound_gap(regression, pi, dual)
    t = certificate.trace_bounds
    reached = bound_gap(regression, pi, dual, t, trace_weight=program.trace_weight).gap
    cost = f_m(regression, pi)
    exact = cost <= EXACT * program.unit  # and F_M cannot be negative
    solved = exact or reached <= GAP_TOLERANCE * cost + DATA_TOLERANCE * program.unit
    advice: tuple[str, ...] = ()
    if regression.rank < structure.n:
        advice = (f"GCO filled the free directions with the least trace, weight {TRACE_WEIGHT:g}",)
    held = not exact and bool(program.trace_weight * total_trace(structure, pi) > PENALTY_TOLD * cost)
    if held:
        advice += (f"{structure.name}: {HELD}; predictions away from the measured poses hang on it",)
    return make_estimate(
        regression,
        pi,
        method="GCO (conic program)",
        status="solved" if solved else f"not solved: Clarabel says {solution.status}",
        certificate=certificate,
        solver_seconds=solution.solve_time,
        advice=advice,
        constraint="psd",
        held_by_trace_weight=held,
    )


def check_symmetric(structure: Structure) -> None:
    """Refuse a structure that no Gramian has.

    Raises:
        BenchError: When it leaves the symmetry open.
    """
    if not structure.symmetric:
        raise BenchError(f"GCO: expected a symmetric structure, {structure.name} leaves the symmetry open")


def scale_program(regression: Regression) -> Program:
    """Units in which data and parameters are of order one.

    C = d X d^T with d^-2 the F_M that a unit of each diagonal entry causes: a congruence, so that X is
    positive semi-definite where C is.

    Args:
        regression: The reduced dataset.
    """
    s, weight = regression.structure, regression.weight
    touched = np.flatnonzero(regression.columns)
    seen = [block for block in s.blocks if np.isin(s.a[touched], block).any()]
    columns = np.flatnonzero(np.isin(s.a, np.concatenate([[-1], *seen])))
    kept = s.keep(columns, s.name)
    largest = weight.max() or 1.0
    d = 1 / np.sqrt(np.maximum(weight, UNSEEN_WEIGHT * largest))
    unit = f_m(regression, np.zeros(s.n)) or 1.0
    return Program(columns, kept, unit, unit * d[kept.a] * d[kept.b], TRACE_WEIGHT * largest)


def _solve(regression: Regression, program: Program) -> clarabel.DefaultSolution:
    """Minimise sum t + trace term, |(R x - z, sqrt(rest))| <= t, every block positive semi-definite."""
    s, terms = program.structure, regression.terms
    A: list[Array] = []
    b: list[Array] = []
    cones: list[object] = []
    for k, term in enumerate(terms):
        rows = np.zeros((len(term.z) + 2, len(terms) + s.n))
        rows[0, k] = -1
        rows[1:-1, len(terms) :] = term.R[:, program.columns] * (program.scale / program.unit)
        A.append(rows)
        b.append(np.r_[0.0, term.z, math.sqrt(term.rest)] / program.unit)
        cones.append(clarabel.SecondOrderConeT(len(rows)))
    for block in s.blocks:
        rows = _svec_rows(s, block)
        A.append(np.hstack([np.zeros((len(rows), len(terms))), -rows]))
        b.append(np.zeros(len(rows)))
        cones.append(clarabel.PSDTriangleConeT(len(block)))
    trace = np.where(s.a == s.b, program.scale / scaled_units(s)[s.a] ** 2, 0.0)
    cost = np.r_[np.ones(len(terms)), program.trace_weight * trace / program.unit]
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix((len(cost), len(cost))),
        cost,
        sparse.csc_matrix(np.vstack(A)),
        np.concatenate(b),
        cones,
        solver_settings(),
    )
    return solver.solve()


def solver_settings() -> clarabel.DefaultSettings:
    """Clarabel as every conic program of ours calls it: one thread, tight tolerances."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.direct_solve_method = "qdldl"  # a fifth faster here than the default, with the same digits
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = SOLVER_TOLERANCE
    return settings


def _svec_rows(s: Structure, block: npt.NDArray[np.int_]) -> Array:
    """Rows that take parameters to the upper triangle of a block, by column, off-diagonals * sqrt 2."""
    position = np.full(s.n_theta, -1)
    position[block] = np.arange(len(block))
    k = np.flatnonzero(position[s.a] >= 0)
    i, j = np.sort([position[s.a[k]], position[s.b[k]]], axis=0)
    value = np.where(i == j, 1.0, math.sqrt(2))
    size = len(block) * (len(block) + 1) // 2
    rows = np.zeros((size, s.n))
    rows[j * (j + 1) // 2 + i, k] = value
    return rows


def _project(s: Structure, x: Array) -> Array:
    """Scaled parameters with every block's negative eigenvalues, the solver's last digits, set to zero."""
    X = s.matrix(x)
    for block in s.blocks:
        i = np.ix_(block, block)
        values, Q = np.linalg.eigh(X[i])
        X[i] = (Q * np.maximum(values, 0)) @ Q.T
    return s.entries(X)
