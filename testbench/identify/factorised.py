"""GCO as the paper writes it: F_M as a function of b, the vectors whose Gramians the compliances are.

Eq. (16)-(19). The vectors v_j of R^m, one for every row of C_theta that is unknown, are the columns of V;
the parameter C_theta[a, b] is the product v_a . v_b. F_M(b) is not convex, and a local solve finds a point
that is best nearby.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from testbench.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.identify.certify import certify
from testbench.identify.conic import Program, check_symmetric, scale_program
from testbench.identify.estimate import Estimate, make_estimate
from testbench.identify.regression import Regression, f_m, f_m_gradient, reduce
from testbench.structure import Structure
from testbench.vjm import Vjm

Observe = Callable[[float], None]
"""Told of every F_M that is the least so far; a clock or a plot may listen."""

LARGEST_ORDER = 6
"""Order of the vector space that reaches every conservative 6x6 matrix."""
BLOCK_POINTS = 64
"""Points evaluated at a time: their vectors stay in the cache."""
FIRST_STEP = 0.3
"""Standard deviation of the entries of a random b: its compliances explain about the size of the data."""
MEMORY = 50
"""Steps that the local solver's model of the curvature remembers: ten stall where a block loses rank."""
MAX_STEPS = 20_000
TOLERANCE = 1e-12
"""Relative gain of a step at which a local solve ends; it stops on the gradient at a thousandth of it."""
CLOSE = 1e-5
"""Certified gap, relative to F_M, below which a local solution counts as the global one."""


@dataclass(frozen=True)
class Factorised:
    """F_M(b) of Eq. (19) in units where the entries of b are of order one.

    Attributes:
        regression: The reduced dataset.
        program: The same problem over compliances, and its units.
        m: Order of the vector space, 1 to 6.
        rows: Rows of C_theta that are unknown and touched by data, (k,).
        free: Which entries of V are in b, (m, k): a block of size n needs vectors of R^min(m, n).
    """

    regression: Regression
    program: Program
    m: int
    rows: npt.NDArray[np.int_]
    free: npt.NDArray[np.bool_]

    @property
    def size(self) -> int:
        """Length of b."""
        return int(self.free.sum())


def factorise(regression: Regression, m: int = LARGEST_ORDER) -> Factorised:
    """The factorised problem of a reduced dataset.

    Args:
        regression: The reduced dataset.
        m: Order of the vector space of Eq. (16); no compliance of a rank above m is reached.

    Raises:
        BenchError: When m is not 1 to 6, or the structure is not symmetric.
    """
    if not 1 <= m <= LARGEST_ORDER:
        raise BenchError(f"m: expected an order of the vector space of 1 to {LARGEST_ORDER}, got {m}")
    check_symmetric(regression.structure)
    program = scale_program(regression)
    blocks = program.structure.blocks
    rows = np.concatenate(blocks)
    size = np.repeat([len(block) for block in blocks], [len(block) for block in blocks])
    order = np.argsort(rows)
    return Factorised(regression, program, m, rows[order], np.arange(m)[:, None] < size[order])


def vectors(problem: Factorised, b: Array) -> Array:
    """The vectors v_j as columns, (m, n_theta), zero where C_theta is known."""
    V = np.zeros((problem.m, problem.program.structure.n_theta))
    part = np.zeros(problem.free.shape)
    part[problem.free] = b
    V[:, problem.rows] = part
    return V


def parameters(problem: Factorised, b: Array) -> Array:
    """Parameters pi of the compliances that b generates, Eq. (16), (n,) [m/N, rad/(N m), rad/N]."""
    s, V = problem.program.structure, vectors(problem, b)
    pi = np.zeros(problem.regression.structure.n)
    pi[problem.program.columns] = problem.program.scale * (V[:, s.a] * V[:, s.b]).sum(axis=0)
    return pi


def cost(problem: Factorised, b: Array) -> tuple[float, Array]:
    """F_M(b), Eq. (19), and its gradient, (size,).

    Args:
        problem: The problem.
        b: The vectors, (size,), in the problem's units.
    """
    regression, program = problem.regression, problem.program
    pi = parameters(problem, b)
    g = (f_m_gradient(regression, pi)[program.columns]) * program.scale
    S = program.structure.gradient(g)
    return f_m(regression, pi), (2 * vectors(problem, b) @ S)[:, problem.rows][problem.free]


def costs(problem: Factorised, population: Array) -> Array:
    """F_M of many b at once, (points,).

    Args:
        problem: The problem.
        population: One b a column, (size, points).
    """
    points = population.shape[1]
    blocks = [population[:, k : k + BLOCK_POINTS] for k in range(0, points, BLOCK_POINTS)]
    return np.concatenate([_costs(problem, block) for block in blocks])


def _costs(problem: Factorised, population: Array) -> Array:
    s, program = problem.program.structure, problem.program
    V = np.zeros((problem.m, s.n_theta, population.shape[1]))
    part = np.zeros((*problem.free.shape, population.shape[1]))
    part[problem.free] = population
    V[:, problem.rows] = part
    x = program.scale[:, None] * np.einsum("mns,mns->ns", V[:, s.a], V[:, s.b])
    squares = [
        ((term.R[:, program.columns] @ x - term.z[:, None]) ** 2).sum(axis=0) + term.rest
        for term in problem.regression.terms
    ]
    return np.asarray(np.sqrt(squares).sum(axis=0))


def random_start(problem: Factorised, rng: np.random.Generator) -> Array:
    """A random b, (size,), of the size that the data ask for."""
    return FIRST_STEP * rng.standard_normal(problem.size)


def local_solve(
    problem: Factorised, start: Array, *, threshold: float = 0.0, observe: Observe | None = None
) -> tuple[Array, float]:
    """The b that is best near a start, by L-BFGS on the analytic gradient, and its F_M.

    Args:
        problem: The problem.
        start: Where to begin, (size,).
        threshold: F_M at which to stop early.
        observe: Told of every least F_M.
    """
    best, least = start, np.inf

    def counted(b: Array) -> tuple[float, Array]:
        nonlocal best, least
        value, gradient = cost(problem, b)
        if value < least:
            best, least = b.copy(), value
            if observe is not None:
                observe(value)
        return value, gradient

    def stop(_: Array) -> None:
        if least <= threshold:
            raise StopIteration

    options = {"maxcor": MEMORY, "maxiter": MAX_STEPS, "maxfun": MAX_STEPS, "ftol": TOLERANCE, "gtol": 1e-9}
    solver: Any = minimize  # its stubs know no cost that comes with its gradient
    solver(counted, start, jac=True, method="L-BFGS-B", callback=stop, options=options)
    return best, least


def gco_factorised(
    vjm: Vjm,
    structure: Structure,
    data: Dataset,
    *,
    rng: np.random.Generator,
    m: int = LARGEST_ORDER,
    starts: int = 1,
) -> Estimate:
    """GCO by local solves of Eq. (19) over b from random starts; the best of them.

    For m = 6 a point where no direction of b goes down, to second order, is global (Journee, Bach, Absil,
    Sepulchre 2010): the certificate, made from the solution's own gradient, shows it. For m < 6 the rank of
    every compliance is capped and the certificate, which knows of no cap, tells what the cap costs.

    Args:
        vjm: The model.
        structure: The unknowns.
        data: The runs.
        rng: Source of the starts.
        m: Order of the vector space, 1 to 6.
        starts: Number of local solves.

    Raises:
        BenchError: When m is not 1 to 6, starts is below 1, the dataset is empty or names a marker that the
            arm lacks, or the structure is not symmetric.
    """
    return best_of(factorise(reduce(vjm, structure, data), m), rng, starts=starts)


def best_of(
    problem: Factorised, rng: np.random.Generator, *, starts: int, observe: Observe | None = None
) -> Estimate:
    """The best of several local solves, as in `gco_factorised`.

    Raises:
        BenchError: When starts is below 1.
    """
    if starts < 1:
        raise BenchError(f"starts: expected at least 1 local solve, got {starts}")
    solutions = [local_solve(problem, random_start(problem, rng), observe=observe) for _ in range(starts)]
    best, _ = min(solutions, key=lambda solution: solution[1])
    pi = parameters(problem, best)
    word = "one local solve" if starts == 1 else f"best of {starts} local solves"
    estimate = make_estimate(problem.regression, pi, method=f"GCO (factorised, m = {problem.m}, {word})")
    certificate = certify(estimate)
    proven = certificate.gap <= CLOSE * estimate.f_m
    return replace(estimate, certificate=certificate, status="solved" if proven else "local optimum")


def order_range(structure: Structure, runs: int) -> tuple[float, float]:
    """Least and greatest order m of the vector space by counting, Eq. (20).

    (n + 1) / 2 <= m <= 6 N / (n n_theta), with n the size of a compliance and n_theta their number. The
    lower bound counts parameters; a smaller order than n still caps the rank.

    Args:
        structure: The unknowns; the larger blocks are counted, joints are of size one.
        runs: Number of measured runs N.
    """
    sizes = [len(block) for block in structure.blocks]
    n = max(sizes)
    return (n + 1) / 2, 6 * runs / (n * sizes.count(n))
