"""GCO as the paper writes it: F_M as a function of b, the vectors whose Gramians the compliances are.

Eq. (16)-(19). The vectors v_j of R^m, one for every row of C_theta that is unknown, are the columns of V;
the parameter C_theta[a, b] is the product v_a . v_b. F_M(b) is not convex, and a local solve finds a point
that is best nearby.

Other optimisers of Eq. (19): the paper's genetic algorithm and global search.

The paper takes its own two from MATLAB's Optimization Toolbox and names no settings. In the role of the
genetic algorithm stands scipy's differential evolution with scipy's defaults. The global search (Ugray,
Lasdon, Plummer, Glover, Kelly, Marti 2007) has the defaults that MATLAB publishes for `GlobalSearch`: trial
points come from a scatter search (Glover 1998), and a local solve starts from those that pass two filters,
far from the basins known and better than a threshold that rises while nothing passes.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import OptimizeResult, differential_evolution, minimize
from scipy.stats import qmc

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.conic import ConicProgram, certify, scaled_gco_program, tie_break_penalty
from testbench.identify.estimate import Estimate, make_estimate
from testbench.identify.regression import Regression, ResidualTerm, check_symmetric, reduce
from testbench.model.structure import Structure
from testbench.runs.rows import trial_rng
from testbench.workflows.cell import Cell

# --- GCO as the paper writes it: F_M as a function of b, the vectors whose Gramians the compliances are -----

Observe = Callable[[float], None]
"""Told of every F_M below all before; a clock or a plot may listen."""

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
    terms: tuple[ResidualTerm, ...]  #: Terms of F_M over the parameters in the program's units.

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
        BenchError: When the structure is not symmetric.
    """
    check_symmetric(regression.structure)
    program = scaled_gco_program(regression, tie_break_penalty(regression))
    blocks = program.observed_structure.blocks
    rows = np.concatenate(blocks)
    size = np.repeat([len(block) for block in blocks], [len(block) for block in blocks])
    order = np.argsort(rows)
    scaled = [term.R[:, program.parameter_indices] * program.parameter_units for term in regression.terms]
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
    V = np.zeros((problem.m, problem.program.observed_structure.n_theta, *b.shape[1:]))
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
    return problem.program.to_pi(x, problem.regression.structure.n_parameters)


def _gramians(problem: Factorised, V: Array) -> Array:
    """Products v_a . v_b of every parameter, Eq. (16), in the program's units, (n, ...)."""
    s = problem.program.observed_structure
    return np.asarray(np.einsum("mn...,mn...->n...", V[:, s.rows], V[:, s.columns]))


def cost(problem: Factorised, b: Array) -> tuple[float, Array]:
    """Compute F_M(b), Eq. (19), and its gradient.

    Args:
        problem: The problem.
        b: Free entries in the problem's units, (size,).

    Returns:
        F_M and its gradient, (size,).
    """
    s, V = problem.program.observed_structure, vectors(problem, b)
    x = (V[:, s.rows] * V[:, s.columns]).sum(axis=0)
    value, g = 0.0, np.zeros(s.n_parameters)
    for term in problem.terms:
        residual = term.R @ x - term.z
        rms = math.sqrt(residual @ residual + term.unexplained)
        value += rms
        if rms > 0:
            g += residual @ term.R / rms
    return value, (2 * V @ s.gradient_matrix(g))[:, problem.rows][problem.free]


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
    problem: Factorised, start: Array, keep: Callable[[Array, float], None], evaluate: Evaluate
) -> Descent:
    """Find the best b near a start by L-BFGS on the gradient of `evaluate`.

    Args:
        problem: The problem.
        start: b, (size,).
        keep: Is called with every improvement, b and F_M.
        evaluate: Computes F_M and its gradient.

    Returns:
        The local solve.
    """
    best, least = start, np.inf

    def watched(b: Array) -> tuple[float, Array]:
        nonlocal best, least
        value, gradient = evaluate(problem, b)
        if value < least:
            best, least = b.copy(), value
            keep(best, value)
        return value, gradient

    options = {"maxcor": MEMORY, "maxiter": MAX_STEPS, "maxfun": MAX_STEPS, "ftol": TOLERANCE, "gtol": FLAT}
    solver: Any = minimize  # its stubs know no cost that comes with its gradient
    end = solver(watched, start, jac=True, method="L-BFGS-B", options=options)
    return Descent(best, least, int(end.nfev), end.status != OUT_OF_STEPS)


@dataclass(eq=False)  # arrays have no one truth value
class Basin:
    """Describe a ball around a local optimum from which local solves are believed to lead back to it.

    As any rotation of all vectors of a block gives the same compliance, no optimum is met twice: a basin is
    one point of many that are the same model, and is never widened.
    """

    centre: Array  #: The optimum, (size,).
    radius: float  #: Distance from the start that led there.
    waiting: int = 0  #: Trial points in a row that fell into it.

    def holds(self, b: Array) -> bool:
        """Tell whether a trial point is too close to start from."""
        return bool(np.linalg.norm(b - self.centre) <= DISTANCE_FACTOR * self.radius)


@dataclass
class Search:
    """Hold what is known of the least F_M so far, and run local solves."""

    problem: Factorised  #: F_M(b).
    observe: Observe = lambda _: None  #: Told of every least F_M.
    f_m: float = np.inf  #: The least F_M so far.
    basins: list[Basin] = field(default_factory=list)  #: Of the local optima found.
    descents: list[Descent] = field(default_factory=list)  #: The local solves.
    #: Of F_M, those of local solves with its gradient; without those that only rank the pool of the scatter
    #: search.
    evaluations: int = 0

    def __post_init__(self) -> None:
        """Begin at a rigid arm."""
        self.best: Array = np.zeros(self.problem.size)  #: The best b so far, (size,).

    def keep(self, b: Array, value: float) -> None:
        """Keep a point that is the best so far.

        Args:
            b: The point.
            value: F_M there.
        """
        if value < self.f_m:
            self.best, self.f_m = b.copy(), value
            self.observe(value)

    def solve(self, start: Array, evaluate: Evaluate = cost) -> None:
        """Run a local solve; its optimum becomes a basin.

        Args:
            start: b, (size,).
            evaluate: Computes F_M and its gradient.
        """
        descent = descend(self.problem, start, self.keep, evaluate)
        self.evaluations += descent.evaluations
        self.descents.append(descent)
        self.basins.append(Basin(descent.b, float(np.linalg.norm(start - descent.b))))


def local_solves(search: Search, rng: np.random.Generator, starts: int, evaluate: Evaluate = cost) -> None:
    """Run local solves from random starts, one after the other.

    For m = 6 a point where no direction of b goes down, to second order, is global (Journee, Bach, Absil,
    Sepulchre 2010): the certificate, made from the solution's own gradient, shows it. For m < 6 the rank of
    every compliance is capped and the certificate, which knows of no cap, tells what the cap costs.

    Args:
        search: State of the search; it is changed.
        rng: Source of the starts.
        starts: Number of local solves.
        evaluate: Computes F_M and its gradient.
    """
    for _ in range(starts):
        search.solve(random_start(search.problem, rng), evaluate)


def certified(search: Search) -> Estimate:
    """Certify the best of several local solves by its own gradient."""
    problem, starts = search.problem, len(search.descents)
    best = min(search.descents, key=lambda descent: descent.f_m)
    word = "one local solve" if starts == 1 else f"best of {starts} local solves"
    estimate = make_estimate(
        problem.regression,
        parameters(problem, best.b),
        method=f"GCO (factorised, m = {problem.m}, {word})",
        constraint="psd",
    )
    certificate = certify(estimate)
    if certificate.f_m_excess_bound <= CLOSE * estimate.f_m + DATA_TOLERANCE * problem.program.f_m_unit:
        status = "solved"
    else:
        status = "local optimum" if best.finished else f"not solved: {MAX_STEPS} steps were not enough"
    return replace(estimate, certificate=certificate, status=status)


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
    regression, found = reduce(cell.vjm, structure, data), []
    for m in range(1, MAX_ORDER + 1):
        search = Search(factorise(regression, m))
        local_solves(search, trial_rng(seed, 10 + m), starts)
        found.append(certified(search))
    return found


# --- Other optimisers of Eq. (19) ---------------------------------------------------------------------------

BOX = 1.0
"""Bound of the entries of b in trial points: one axis of that size explains all the data by itself."""
REFERENCE = 10  #: Points of quality, and as many of diversity, in the reference set of the scatter search.
DISTANCE_FACTOR = 0.75  #: Share of a basin's radius within which no local solve is started.
WAIT = 20  #: Trial points in a row inside one basin, or above the threshold, until that filter is relaxed.
SHRINK = 0.2  #: Share by which a basin's radius is then cut.
PENALTY = 0.2  #: Share of 1 + threshold by which the threshold is then raised.
POPULATION = 15  #: Points of a generation for every entry of b, as scipy has by default.
STAGE_ONE = (
    200  #: Trial points of which only the best starts a local solve, as `GlobalSearch` has by default.
)


def explore(search: Search, rng: np.random.Generator, generations: int, trials: int) -> None:
    """Run a genetic algorithm, then a global search, through the whole budget.

    The paper stops at an F_M "slightly higher or close to 2", its noise floor; whether any conservative model
    reaches that, the conic program tells.

    Args:
        search: State of the search; it is changed.
        rng: Source of randomness.
        generations: Most generations; fewer where the population agrees.
        trials: Number of trial points of the global search.
    """
    _genetic_algorithm(search, generations, rng)
    _global_search(search, trials, rng)


def _genetic_algorithm(search: Search, generations: int, rng: np.random.Generator) -> None:
    """Find the start b0 by differential evolution, in the role of the paper's genetic algorithm."""
    problem = search.problem

    def counted(population: Array) -> Array:
        search.evaluations += population.shape[1]  # scipy counts a whole population as one
        return costs(problem, population)

    def watch(intermediate_result: OptimizeResult) -> None:
        search.keep(intermediate_result.x, float(intermediate_result.fun))

    evolve: Any = differential_evolution  # its stubs know no costs of a whole population
    evolve(
        counted,
        [(-BOX, BOX)] * problem.size,
        popsize=POPULATION,
        maxiter=generations,
        callback=watch,
        polish=False,
        rng=rng,
        updating="deferred",
        vectorized=True,
    )


def _global_search(search: Search, trials: int, rng: np.random.Generator) -> None:
    """Run local solves from the best point and from the trial points that pass both filters."""
    search.solve(search.best)
    points = trial_points(search.problem, search.best, trials, rng)
    values = costs(search.problem, points.T)
    search.evaluations += len(values)
    first = min(STAGE_ONE, trials)
    search.solve(points[int(np.argmin(values[:first]))])
    threshold, waiting = search.f_m, 0
    for b, value in zip(points[first:], values[first:], strict=True):
        inside = [basin for basin in search.basins if basin.holds(b)]
        if value < threshold and not inside:
            search.solve(b)
            threshold, waiting = value, 0
            for basin in search.basins:
                basin.waiting = 0
            continue
        for basin in search.basins:
            _wait(basin, basin in inside)
        waiting = waiting + 1 if value >= threshold else 0
        if waiting == WAIT:
            threshold, waiting = threshold + PENALTY * (1 + threshold), 0


def _wait(basin: Basin, inside: bool) -> None:
    """Count trial points in a row that fell into a basin; shrink it when there were many."""
    basin.waiting = basin.waiting + 1 if inside else 0
    if basin.waiting == WAIT:
        basin.radius, basin.waiting = (1 - SHRINK) * basin.radius, 0


def trial_points(problem: Factorised, start: Array, count: int, rng: np.random.Generator) -> Array:
    """Choose trial points by scatter search (Glover 1998).

    Diverse points fill the box; of them and the start a reference set of the best and of the most distant
    is kept; its pairs are combined along their line, within and beyond the two.

    Args:
        problem: The problem.
        start: The best point, (size,).
        count: Number of points.
        rng: Source of randomness.

    Returns:
        The points, (count, size).
    """
    box = qmc.scale(qmc.LatinHypercube(problem.size, rng=rng).random(10 * REFERENCE), -BOX, BOX)
    pool = np.vstack([start, box])
    points: list[Array] = []
    while len(points) < count:
        made = np.array([*_combinations(_reference_set(problem, pool), rng)])
        points.extend(made)
        pool = np.vstack([pool, made])
    return np.array(points[:count])


def _reference_set(problem: Factorised, pool: Array) -> Array:
    """The best points of a pool, and those that lie farthest from all chosen so far."""
    order = np.argsort(costs(problem, pool.T))
    chosen = [*order[:REFERENCE]]
    distance = np.min([np.linalg.norm(pool - pool[i], axis=1) for i in chosen], axis=0)
    for _ in range(REFERENCE):
        farthest = int(np.argmax(distance))
        chosen.append(farthest)
        distance = np.minimum(distance, np.linalg.norm(pool - pool[farthest], axis=1))
    return np.asarray(pool[chosen])


def _combinations(reference: Array, rng: np.random.Generator) -> Iterator[Array]:
    """Three points a pair: before the first, between the two, beyond the second."""
    for i, x in enumerate(reference):
        for y in reference[i + 1 :]:
            for base, sign in ((x, -1), (x, 1), (y, 1)):
                step = rng.random(len(x)) * (y - x) / 2
                yield np.clip(base + sign * step, -BOX, BOX)
