"""Other optimisers of Eq. (19): the paper's genetic algorithm and global search, and any solver of cvxpy.

The paper takes its own two from MATLAB's Optimization Toolbox and names no settings. In the role of the
genetic algorithm stands scipy's differential evolution with scipy's defaults. The global search (Ugray,
Lasdon, Plummer, Glover, Kelly, Marti 2007) has the defaults that MATLAB publishes for `GlobalSearch`: trial
points come from a scatter search (Glover 1998), and a local solve starts from those that pass two filters,
far from the basins known and better than a threshold that rises while nothing passes.

The conic program of GCO is written down in cvxpy too: any of its solvers may be the referee. cvxpy is no
dependency of the package: it is imported where it is used, and its absence is one line.
"""

import importlib
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.optimize import OptimizeResult, differential_evolution
from scipy.stats import qmc

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.identify.certify import tie_break
from testbench.identify.cone import psd_part
from testbench.identify.conic import scale_program
from testbench.identify.estimate import Estimate, make_estimate
from testbench.identify.fold import reduce
from testbench.identify.regression import Regression, check_symmetric
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm
from testbench.studies.paper.factorised import Factorised, Observe, costs, descend, falling

BOX = 1.0
"""Bound of the entries of b in trial points: one axis of that size explains all the data by itself."""
REFERENCE = 10  #: Points of quality, and as many of diversity, in the reference set of the scatter search.
DISTANCE_FACTOR = 0.75  #: Share of a basin's radius within which no local solve is started.
WAIT = 20  #: Trial points in a row inside one basin, or above the threshold, until that filter is relaxed.
SHRINK = 0.2  #: Share by which a basin's radius is then cut.
PENALTY = 0.2  #: Share of 1 + threshold by which the threshold is then raised.


@dataclass(frozen=True)
class Budget:
    """Limit how far the search goes; defaults are those of scipy and of MATLAB's `GlobalSearch`."""

    population: int = 15  #: Points of a generation for every entry of b.
    generations: int = 1000  #: Most generations; fewer where the population agrees.
    trial_points: int = 1000  #: Trial points of the global search.
    stage_one_points: int = 200  #: Of these, the ones of which only the best starts a local solve.

    def __post_init__(self) -> None:
        """Refuse a number below 1, and a stage one of more trial points than there are, by BenchError."""
        numbers = self.population, self.generations, self.trial_points, self.stage_one_points
        if min(numbers) < 1 or self.stage_one_points > self.trial_points:
            raise BenchError(f"expected numbers of at least 1, stage one within the trial points, got {self}")


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
class SearchState:
    """Hold what the search knows so far."""

    problem: Factorised  #: F_M(b).
    observe: Observe  #: Told of every least F_M.
    best: Array  #: The best b so far, (size,).
    f_m: float = np.inf  #: Its cost.
    basins: list[Basin] = field(default_factory=list)  #: Of the local optima found.
    descents: list[float] = field(default_factory=list)  #: F_M that the local solves ended with.
    #: Of F_M, those of local solves with its gradient; without those that only rank the pool of the scatter
    #: search.
    evaluations: int = 0

    def keep(self, b: Array, value: float) -> None:
        """Keep a point that is the best so far.

        Args:
            b: The point.
            value: F_M there.
        """
        if value < self.f_m:
            self.best, self.f_m = b.copy(), value
            self.observe(value)

    def solve(self, start: Array) -> None:
        """Run a local solve; its optimum becomes a basin."""
        descent = descend(self.problem, start, observe=self.observe)
        self.evaluations += descent.evaluations
        self.descents.append(descent.f_m)
        self.keep(descent.b, descent.f_m)
        self.basins.append(Basin(descent.b, float(np.linalg.norm(start - descent.b))))


def explore(
    problem: Factorised, budget: Budget, rng: np.random.Generator, observe: Observe | None = None
) -> SearchState:
    """Run a genetic algorithm, then a global search, through the whole budget.

    The paper stops at an F_M "slightly higher or close to 2", its noise floor; whether any conservative model
    reaches that, the conic program tells.

    Args:
        problem: The problem.
        budget: Limits of the search.
        rng: Source of randomness.
        observe: Is called with every improvement; None for nobody.

    Returns:
        The state at the end.
    """
    search = SearchState(problem, falling(observe), np.zeros(problem.size))
    genetic_algorithm(search, budget, rng)
    global_search(search, budget, rng)
    return search


def genetic_algorithm(search: SearchState, budget: Budget, rng: np.random.Generator) -> None:
    """Find the start b0 by differential evolution, in the role of the paper's genetic algorithm.

    Args:
        search: State of the search; it is changed.
        budget: Limits of the search.
        rng: Source of randomness.
    """
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
        popsize=budget.population,
        maxiter=budget.generations,
        callback=watch,
        polish=False,
        rng=rng,
        updating="deferred",
        vectorized=True,
    )


def global_search(search: SearchState, budget: Budget, rng: np.random.Generator) -> None:
    """Run local solves from the best point and from the trial points that pass both filters.

    Args:
        search: State of the search; it is changed.
        budget: Limits of the search.
        rng: Source of randomness.
    """
    search.solve(search.best)
    points = trial_points(search.problem, search.best, budget.trial_points, rng)
    values = costs(search.problem, points.T)
    search.evaluations += len(values)
    search.solve(points[int(np.argmin(values[: budget.stage_one_points]))])
    threshold, waiting = search.f_m, 0
    for b, value in zip(points[budget.stage_one_points :], values[budget.stage_one_points :], strict=True):
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


Entries = Callable[[Structure, list[Any]], Any]
"""How a model takes its parameters from its blocks, both expressions of cvxpy."""


def cvxpy(solver: str) -> Any:
    """Import cvxpy with this solver; BenchError where one of them is not installed."""
    try:
        module: Any = importlib.import_module("cvxpy")
    except ImportError:
        raise BenchError(f"{solver} is called through cvxpy, which is not installed: make bench") from None
    if solver not in module.installed_solvers():
        have = ", ".join(sorted(module.installed_solvers()))
        raise BenchError(f"cvxpy has no solver {solver!r} here; it has {have}")
    return module


def modelled(vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
    """Identify by GCO by way of cvxpy and SCS, at the solver's default settings.

    Args:
        vjm: Kinematics of the arm.
        structure: The unknowns.
        data: Measured runs.

    Returns:
        The estimate.
    """
    return solve_modelled(reduce(vjm, structure, data), "SCS")


def vectorised(s: Structure, blocks: list[Any]) -> Any:
    """Write parameters as sparse matrices times whole blocks, as a user of cvxpy does for speed.

    Args:
        s: The unknowns.
        blocks: Variables of the blocks.

    Returns:
        The expression.
    """
    cp = cvxpy("CLARABEL")
    return cp.sum(
        [_picking(s, block) @ cp.vec(X, order="F") for X, block in zip(blocks, s.blocks, strict=True)]
    )


def _picking(s: Structure, block: npt.NDArray[np.int_]) -> sparse.csr_array:
    position = np.full(s.n_theta, -1)
    position[block] = np.arange(len(block))
    k = np.flatnonzero(position[s.a] >= 0)
    entry = position[s.a[k]] + len(block) * position[s.b[k]]
    return sparse.csr_array((np.ones(len(k)), (k, entry)), shape=(s.n, len(block) ** 2))


def solve_modelled(
    regression: Regression, solver: str, *, entries: Entries = vectorised, **settings: float
) -> Estimate:
    """Solve the program of the paper's GCO in the same units, written down in cvxpy.

    Args:
        regression: The reduced dataset.
        solver: Name of the solver.
        entries: Writes parameters as an expression.
        settings: Settings of the solver.

    Returns:
        The estimate.

    Raises:
        BenchError: When cvxpy or the solver is not installed, or the structure is not symmetric.
    """
    cp = cvxpy(solver)
    check_symmetric(regression.structure)
    program = scale_program(regression, tie_break(regression))
    s = program.structure
    blocks = [cp.Variable((len(block), len(block)), PSD=True) for block in s.blocks]
    x = entries(s, blocks)
    cost = program.trace @ x
    for R, z, rest in zip(program.R, program.z, program.rest, strict=True):
        cost += cp.norm(cp.hstack([R @ x - z, rest]))
    problem = cp.Problem(cp.Minimize(cost))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Solution may be inaccurate")  # the status tells
        problem.solve(solver=solver, **settings)
    C = np.zeros((s.n_theta, s.n_theta))
    for i, X in zip(s.blocks, blocks, strict=True):
        C[np.ix_(i, i)] = psd_part((X.value + X.value.T) / 2)
    pi = program.parameters(s.entries(C), regression.structure.n)
    method, word = f"GCO (conic program, cvxpy with {solver})", str(problem.status)
    return replace(
        make_estimate(regression, pi, method=method, constraint="psd"),
        status="not certified" if word == "optimal" else f"not solved: {solver} says {word}",
        solver_seconds=float(problem.solver_stats.solve_time),
    )
