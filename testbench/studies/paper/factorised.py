"""GCO as the paper writes it: F_M as a function of b, the vectors whose Gramians the compliances are.

Eq. (16)-(19). The vectors v_j of R^m, one for every row of C_theta that is unknown, are the columns of V;
the parameter C_theta[a, b] is the product v_a . v_b. F_M(b) is not convex, and a local solve finds a point
that is best nearby.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.identify.certify import certify, tie_break
from testbench.identify.conic import ConicProgram, scale_program
from testbench.identify.estimate import Estimate, make_estimate
from testbench.identify.fold import reduce
from testbench.identify.regression import Regression, Term, check_symmetric
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm
from testbench.plant.tracker import trial_rng
from testbench.workflows.cell import Cell

Observe = Callable[[float], None]
"""Told of every F_M that is the least so far; a clock or a plot may listen."""

MAX_ORDER = 6  #: Order of the vector space that reaches every conservative 6x6 matrix.
BLOCK_POINTS = 64  #: Points evaluated at a time: their vectors stay in the cache.
FIRST_STEP = 0.3
"""Standard deviation of the entries of a random b: its compliances explain about the size of the data."""
MEMORY = 50
"""Steps that the local solver's model of the curvature remembers: ten stall where a block loses rank."""
MAX_STEPS = 20_000
TOLERANCE = 1e-12  #: Relative gain of a step at which a local solve ends.
FLAT = 1e-9  #: Largest entry of the gradient at which it ends too.
OUT_OF_STEPS = 1  #: Status of scipy's L-BFGS that spent all its steps.
DATA_TOLERANCE = 1e-7  #: Share of F_M at C = 0 to which a fit of data without noise is the best one.
CLOSE = 1e-5  #: Certified excess, relative to F_M, below which a local solution counts as the global one.


@dataclass(frozen=True)
class Factorised:
    """Evaluate F_M(b) of Eq. (19) in units where the entries of b are of order one."""

    regression: Regression  #: The reduced dataset.
    program: ConicProgram  #: The same problem over compliances, and its units.
    m: int  #: Order of the vector space, 1 to 6.
    rows: npt.NDArray[np.int_]  #: Rows of C_theta that are unknown and touched by data, (k,).
    #: Which entries of V are in b, (m, k): a block of size n needs vectors of R^min(m, n).
    free: npt.NDArray[np.bool_]
    terms: tuple[Term, ...]  #: Terms of F_M over the parameters in the program's units.

    @property
    def size(self) -> int:
        """Return the length of b."""
        return int(self.free.sum())


@dataclass(frozen=True)
class Descent:
    """Hold one local solve."""

    b: Array  #: Where it ended, (size,).
    f_m: float  #: Cost there.
    evaluations: int  #: Of F_M and its gradient.
    finished: bool  #: Whether it ended by itself, not for want of steps.


Evaluate = Callable[[Factorised, Array], tuple[float, Array]]  #: F_M and its gradient at a b, such as `cost`.


def factorise(regression: Regression, m: int = MAX_ORDER) -> Factorised:
    """Make the factorised problem of a reduced dataset, Eq. (16).

    Args:
        regression: The reduced dataset.
        m: Largest rank of a compliance.

    Returns:
        The problem.

    Raises:
        BenchError: When m is not 1 to 6, or the structure is not symmetric.
    """
    if not 1 <= m <= MAX_ORDER:
        raise BenchError(f"m: expected an order of the vector space of 1 to {MAX_ORDER}, got {m}")
    check_symmetric(regression.structure)
    program = scale_program(regression, tie_break(regression))
    blocks = program.structure.blocks
    rows = np.concatenate(blocks)
    size = np.repeat([len(block) for block in blocks], [len(block) for block in blocks])
    order = np.argsort(rows)
    scaled = [term.R[:, program.columns] * program.scale for term in regression.terms]
    terms = tuple(replace(term, R=R) for term, R in zip(regression.terms, scaled, strict=True))
    return Factorised(regression, program, m, rows[order], np.arange(m)[:, None] < size[order], terms)


def vectors(problem: Factorised, b: Array) -> Array:
    """Compute the vectors v_j as columns, zero where C_theta is known.

    Args:
        problem: The problem.
        b: Free entries, (size, ...).

    Returns:
        Vectors, (m, n_theta, ...).
    """
    V = np.zeros((problem.m, problem.program.structure.n_theta, *b.shape[1:]))
    part = np.zeros((*problem.free.shape, *b.shape[1:]))
    part[problem.free] = b
    V[:, problem.rows] = part
    return V


def parameters(problem: Factorised, b: Array) -> Array:
    """Compute parameters pi of the compliances that b generates, Eq. (16).

    Mathematics: `est-5`.

    Args:
        problem: The problem.
        b: Free entries, (size,).

    Returns:
        Parameters, (n,) [m/N, rad/(N m)].
    """
    x = _gramians(problem, vectors(problem, b))
    return problem.program.parameters(x, problem.regression.structure.n)


def _gramians(problem: Factorised, V: Array) -> Array:
    """Products v_a . v_b of every parameter, Eq. (16), in the program's units, (n, ...)."""
    s = problem.program.structure
    return np.asarray(np.einsum("mn...,mn...->n...", V[:, s.a], V[:, s.b]))


def cost(problem: Factorised, b: Array) -> tuple[float, Array]:
    """Compute F_M(b), Eq. (19), and its gradient.

    Args:
        problem: The problem.
        b: Free entries in the problem's units, (size,).

    Returns:
        F_M and its gradient, (size,).
    """
    s, V = problem.program.structure, vectors(problem, b)
    x = (V[:, s.a] * V[:, s.b]).sum(axis=0)
    value, g = 0.0, np.zeros(s.n)
    for term in problem.terms:
        residual = term.R @ x - term.z
        rms = math.sqrt(residual @ residual + term.unexplained)
        value += rms
        if rms > 0:
            g += residual @ term.R / rms
    return value, (2 * V @ s.gradient(g))[:, problem.rows][problem.free]


def costs(problem: Factorised, population: Array) -> Array:
    """Compute F_M of many b at once.

    Args:
        problem: The problem.
        population: One b per column, (size, points).

    Returns:
        F_M, (points,).
    """
    found = []
    for first in range(0, population.shape[1], BLOCK_POINTS):
        x = _gramians(problem, vectors(problem, population[:, first : first + BLOCK_POINTS]))
        rows = [(term.R @ x - term.z[:, None], term.unexplained) for term in problem.terms]
        found.append(sum(np.sqrt((residual**2).sum(axis=0) + rest) for residual, rest in rows))
    return np.concatenate(found)


def random_start(problem: Factorised, rng: np.random.Generator) -> Array:
    """Draw a random b of the size that the data ask for.

    Args:
        problem: The problem.
        rng: Source of randomness.

    Returns:
        b, (size,).
    """
    return FIRST_STEP * rng.standard_normal(problem.size)


def descend(
    problem: Factorised, start: Array, *, evaluate: Evaluate = cost, observe: Observe | None = None
) -> Descent:
    """Find the best b near a start by L-BFGS on the gradient of `evaluate`.

    Args:
        problem: The problem.
        start: b, (size,).
        evaluate: Computes F_M and its gradient.
        observe: Is called with every improvement; None for nobody.

    Returns:
        The local solve.
    """
    best, least = start, np.inf

    def watched(b: Array) -> tuple[float, Array]:
        nonlocal best, least
        value, gradient = evaluate(problem, b)
        if value < least:
            best, least = b.copy(), value
            if observe is not None:
                observe(value)
        return value, gradient

    options = {"maxcor": MEMORY, "maxiter": MAX_STEPS, "maxfun": MAX_STEPS, "ftol": TOLERANCE, "gtol": FLAT}
    solver: Any = minimize  # its stubs know no cost that comes with its gradient
    end = solver(watched, start, jac=True, method="L-BFGS-B", options=options)
    return Descent(best, least, int(end.nfev), end.status != OUT_OF_STEPS)


@dataclass(frozen=True)
class LocalSolves:
    """Identify by GCO by local solves of Eq. (19) over b from random starts; the best of them.

    For m = 6 a point where no direction of b goes down, to second order, is global (Journee, Bach, Absil,
    Sepulchre 2010): the certificate, made from the solution's own gradient, shows it. For m < 6 the rank of
    every compliance is capped and the certificate, which knows of no cap, tells what the cap costs.
    """

    rng: np.random.Generator  #: Source of the starts.
    m: int = MAX_ORDER  #: Order of the vector space, 1 to 6.
    starts: int = 1  #: Number of local solves.

    def __call__(self, vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
        """Identify a structure from a dataset.

        Raises:
            BenchError: When m is not 1 to 6, starts is below 1, or as `reduce` and `factorise` say.
        """
        return best_of(factorise(reduce(vjm, structure, data), self.m), self.rng, starts=self.starts)


def best_of(problem: Factorised, rng: np.random.Generator, *, starts: int) -> Estimate:
    """Certify the best of several local solves (1 at least, or BenchError) by its own gradient.

    Args:
        problem: The problem.
        rng: Source of randomness.
        starts: Number of starts.

    Returns:
        The estimate.
    """
    found = descents(problem, rng, starts=starts)
    best = min(found, key=lambda descent: descent.f_m)
    word = "one local solve" if starts == 1 else f"best of {starts} local solves"
    estimate = make_estimate(
        problem.regression,
        parameters(problem, best.b),
        method=f"GCO (factorised, m = {problem.m}, {word})",
        constraint="psd",
    )
    certificate = certify(estimate)
    if certificate.f_m_excess_bound <= CLOSE * estimate.f_m + DATA_TOLERANCE * problem.program.unit:
        status = "solved"
    else:
        status = "local optimum" if best.finished else f"not solved: {MAX_STEPS} steps were not enough"
    return replace(estimate, certificate=certificate, status=status)


def descents(
    problem: Factorised, rng: np.random.Generator, *, starts: int, observe: Observe | None = None
) -> list[Descent]:
    """Run local solves (1 at least, or BenchError) from random starts, one after the other.

    Args:
        problem: The problem.
        rng: Source of randomness.
        starts: Number of starts.
        observe: Is called with every improvement; None for nobody.

    Returns:
        The local solves.
    """
    if starts < 1:
        raise BenchError(f"starts: expected at least 1 local solve, got {starts}")
    tell = falling(observe)
    return [descend(problem, random_start(problem, rng), observe=tell) for _ in range(starts)]


def falling(observe: Observe | None) -> Observe:
    """Make an observer that is told only of an F_M below all before, whoever found it."""
    least = np.inf

    def tell(value: float) -> None:
        nonlocal least
        if observe is not None and value < least:
            least = value
            observe(value)

    return tell


def order_range(structure: Structure, runs: int) -> tuple[float, float]:
    """Count the least and greatest order m of the vector space, Eq. (20), for so many measured runs.

    (n + 1) / 2 <= m <= 6 N / (n n_theta), with n the size of a compliance and n_theta their number: the
    larger blocks are counted, joints are of size one. The lower bound counts parameters; a smaller order than
    n still caps the rank.

    Mathematics: `est-6`.

    Args:
        structure: The unknowns.
        runs: Number of measured runs N.

    Returns:
        Both orders.
    """
    sizes = [len(block) for block in structure.blocks]
    n = max(sizes)
    return (n + 1) / 2, 6 * runs / (n * sizes.count(n))


def every_order(cell: Cell, structure: Structure, data: Dataset, starts: int, seed: int) -> list[Estimate]:
    """Identify by vectors of Eq. (16) of every order m from 1 to 6, each the best of some local solves.

    Args:
        cell: The arm with its model and its truth.
        structure: The unknowns.
        data: Measured runs.
        starts: Number of starts.
        seed: Seed of the trial.

    Returns:
        An estimate per order.
    """
    return [
        LocalSolves(trial_rng(seed, 10 + m), m, starts)(cell.vjm, structure, data)
        for m in range(1, MAX_ORDER + 1)
    ]
