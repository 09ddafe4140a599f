"""Five ways to the least F_M of Eq. (19) on the same data: the paper's optimiser against a certificate.

"A proof of global convergence" is unviable for the paper's search over b. Over compliances the problem is
convex, and the dual of one conic program tells how far any other solution can be from the least F_M.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Annotated

import numpy as np
import typer

from testbench.arm.catalogue import find_arm
from testbench.campaign.campaign import Campaign, Cell, build_cell, stream
from testbench.campaign.evaluation import judge
from testbench.campaign.models import Model, named_models
from testbench.campaign.pose_campaign import FullPose, simulate
from testbench.campaign.rows import ErrorRow, error_row
from testbench.errors import Array, BenchError
from testbench.identify import Estimate, Estimator, certify, gco, make_estimate, reduce
from testbench.studies.estimators.factorised import (
    CLOSE,
    LARGEST_ORDER,
    Factorised,
    Observe,
    costs,
    descend,
    descents,
    factorise,
    parameters,
    random_start,
)
from testbench.studies.estimators.modelled import cvxpy, modelled
from testbench.studies.estimators.search import Budget, explore
from testbench.studies.six_dof_arm.trial import Judged, Measured, judged, measured

ARM = "arm_6r"
SIGMA = math.sqrt(0.5) * 25e-6  #: The paper's is that of a deflection, a difference of two readings [m].
SCENARIO = FullPose(arm=ARM, sigma=SIGMA, sigma_rotation=10 * SIGMA, least=9e-3, most=41e-3)
SHORT_GENERATIONS = 20  #: Of the short variant of the paper's optimiser.
QUICK_GENERATIONS, QUICK_STARTS = 60, 5
WITHIN = 1.01  #: F_M over the least one at which a solver is called there: within 1 %.
REPEATS = 5  #: Calls of a conic program, of which the median time counts; one more comes first, not timed.
DIFFERENCE = math.sqrt(np.finfo(float).eps)
"""Step of the finite differences, where the entries of b are of order one; as MATLAB and scipy take it."""


@dataclass(frozen=True)
class Options:
    """Flags of the study, and what is tried."""

    model: Annotated[str, typer.Option(help="A GCO model of the paper.")] = "MGCO69"
    m: Annotated[int, typer.Option(min=1, max=6, help="Order of the vector space.")] = LARGEST_ORDER
    generations: Annotated[int, typer.Option(min=1, help="Most, of the genetic algorithm.")] = 1000
    trial_points: Annotated[int, typer.Option(min=1, help="Of the global search.")] = 1000
    starts: Annotated[int, typer.Option(min=1, help="Local solves of the multistart.")] = 10
    scs: Annotated[bool, typer.Option("--scs", help="SCS by way of cvxpy too (make bench has it).")] = False


@dataclass(frozen=True)
class SolverRow:
    """What one solver found in one seed, with its way down."""

    f_m: float  #: Cost of Eq. (19).
    excess_f_m: float  #: Over that of the conic program.
    relative_excess: float  #: The same, relative.
    f_m_excess_bound: float  #: F_M over its certified lower bound.
    relative_excess_bound: float  #: The same, relative to the bound.
    seconds: float  #: Wall time of the whole call, reduction of the dataset included.
    #: Until F_M was within 1 % of the conic program's; None where it never was.
    seconds_to_1_percent: float | None
    ratio_to_conic: float | None  #: The same over the conic program's whole time.
    whole_ratio_to_conic: float  #: Whole time over the conic program's.
    evaluations: int | None  #: Of F_M; None where nobody counts them.
    local_solves: int | None  #: How many; None where there are none.
    local_solves_elsewhere: int | None  #: Those that ended more than CLOSE above the conic program.
    conservative: bool  #: Whether every block is positive semi-definite.
    status: str  #: What the solver says.
    check_true: ErrorRow  #: Errors of the check runs, without noise.


@dataclass(frozen=True)
class Data:
    """What every solver of a seed had: measurements, and what the conic program made of them."""

    measured: Measured
    model: Judged


@dataclass(frozen=True)
class TrialRow:
    """One line of a seed: its data, or a solver."""

    key: str = ""  #: Letter of the solver, empty for the others.
    data: Data | None = None  #: Of the seed, in its first line.
    solver: SolverRow | None = None  #: What a solver found.


@dataclass(frozen=True)
class Solved:
    """What one solver found."""

    key: str  #: Its letter.
    estimate: Estimate  #: The model.
    way: list[tuple[float, float]]  #: Seconds and F_M of every improvement.
    seconds: float  #: Wall time of the whole call, reduction of the dataset included.
    evaluations: int | None = None  #: Of F_M; None where nobody counts them.
    solves: Sequence[float] | None = None  #: F_M of its local solves; None where there are none.


@dataclass(frozen=True)
class Found:
    """What a solver over b found."""

    b: Array  #: The vectors, (size,).
    evaluations: int  #: Of F_M.
    solves: list[float]  #: F_M that its local solves ended with.


OverB = Callable[[Factorised, np.random.Generator, Observe], Found]
"""A solver over b: problem, source of its starts, who is told of every least F_M."""


def search(budget: Budget) -> OverB:
    """The paper's optimiser, run through its whole budget: no threshold stops it."""

    def solver(problem: Factorised, rng: np.random.Generator, observe: Observe) -> Found:
        found = explore(problem, budget, rng, observe)
        return Found(found.best, found.evaluations, found.descents)

    return solver


def local_solves(starts: int) -> OverB:
    """Local solves on the analytic gradient, from random starts."""

    def solver(problem: Factorised, rng: np.random.Generator, observe: Observe) -> Found:
        found = descents(problem, rng, starts=starts, observe=observe)
        best = min(found, key=lambda descent: descent.f_m)
        return Found(best.b, sum(d.evaluations for d in found), [d.f_m for d in found])

    return solver


def differences(problem: Factorised, rng: np.random.Generator, observe: Observe) -> Found:
    """One local solve that knows F_M alone and takes its gradient by finite differences."""
    end = descend(problem, random_start(problem, rng), evaluate=forward_differences, observe=observe)
    return Found(end.b, (problem.size + 1) * end.evaluations, [end.f_m])


def forward_differences(problem: Factorised, b: Array) -> tuple[float, Array]:
    """F_M(b) and its gradient by finite differences, all points at once, (size,)."""
    values = costs(problem, np.hstack([b[:, None], b[:, None] + DIFFERENCE * np.eye(problem.size)]))
    return float(values[0]), (values[1:] - values[0]) / DIFFERENCE


Search = tuple[str, OverB, int]  #: Letter of a solver, itself, and the number of its stream of random starts.
PAPERS = ("a", "a'")  #: Letters of the paper's optimiser.


def gco_model(cell: Cell, name: str) -> Model:
    """A model of the paper that GCO identifies.

    Raises:
        BenchError: When there is none of that name, or least squares identifies it.
    """
    [model] = named_models(cell, [name])
    if model.estimator != gco:
        raise BenchError(f"model: expected one that GCO identifies, such as MGCO69, got {name}")
    return model


def settings(options: Options, quick: bool, _: range) -> Options:
    """What the flags ask for.

    Raises:
        BenchError: When the model is none that GCO identifies, or SCS is not installed.
    """
    gco_model(build_cell(find_arm(ARM)), options.model)
    if options.scs:
        cvxpy("SCS")
    if not quick:
        return options
    generations, starts = min(options.generations, QUICK_GENERATIONS), min(options.starts, QUICK_STARTS)
    return replace(options, generations=generations, starts=starts)


def trials(asked: Options, seeds: Sequence[int]) -> list[list[TrialRow]]:
    """Rows of some seeds."""
    cell = build_cell(find_arm(ARM))
    model = gco_model(cell, asked.model)
    return [list(_trial(cell, model, asked, seed)) for seed in seeds]


def _trial(cell: Cell, model: Model, asked: Options, seed: int) -> Iterator[TrialRow]:
    campaign = simulate(cell, SCENARIO, seed)
    conic = _repeated("d", gco, cell, model, campaign)
    found = [*_factor_solvers(cell, model, asked, campaign), conic]
    if asked.scs:
        found.append(_repeated("e", modelled("SCS"), cell, model, campaign))
    own = judged(judge(cell, campaign, model, conic.estimate, conic.seconds))
    yield TrialRow(data=Data(measured(campaign), own))
    for solved in found:
        yield TrialRow(key=solved.key, solver=_row(cell, model, campaign, solved, conic))


def _repeated(key: str, estimator: Estimator, cell: Cell, model: Model, campaign: Campaign) -> Solved:
    """A solver without chance, certificate included where it makes one: median time of several calls."""
    calls = []
    for _ in range(1 + REPEATS):
        start = perf_counter()
        estimate = estimator(cell.vjm, model.structure, campaign.identification)
        seconds = perf_counter() - start
        calls.append(Solved(key, estimate, [(seconds, estimate.f_m)], seconds))
    return sorted(calls[1:], key=lambda call: call.seconds)[REPEATS // 2]


def _factor_solvers(cell: Cell, model: Model, asked: Options, campaign: Campaign) -> list[Solved]:
    """The solvers over b: the paper's, long and short, and local solves from random starts."""
    points = asked.trial_points
    first = min(Budget().stage_one_points, points)
    long, short = (
        search(Budget(generations=n, trial_points=points, stage_one_points=first))
        for n in (asked.generations, SHORT_GENERATIONS)
    )
    runs: tuple[Search, ...] = (
        ("a", long, 10),
        ("a'", short, 10),
        ("b", local_solves(1), 11),
        ("b'", differences, 11),  # from the same start
        ("c", local_solves(asked.starts), 12),
    )
    return [_searched(cell, model, asked, campaign, run) for run in runs]


def _searched(cell: Cell, model: Model, asked: Options, campaign: Campaign, run: Search) -> Solved:
    key, solver, random = run
    way: list[tuple[float, float]] = []
    start = perf_counter()
    problem = factorise(reduce(cell.vjm, model.structure, campaign.identification), asked.m)
    rng = stream(campaign.seed, random)
    found = solver(problem, rng, lambda f_m: way.append((perf_counter() - start, f_m)))
    pi, method = parameters(problem, found.b), f"GCO over b, m = {asked.m}"
    status = "budget spent" if key in PAPERS else "local optimum"
    estimate = replace(make_estimate(problem.regression, pi, method=method, constraint="psd"), status=status)
    return Solved(key, estimate, way, perf_counter() - start, found.evaluations, found.solves)


def _row(cell: Cell, model: Model, campaign: Campaign, row: Solved, conic: Solved) -> SolverRow:
    proof = conic.estimate.certificate
    assert proof is not None
    estimate, best = row.estimate, conic.estimate.f_m
    excess = certify(estimate, dual=proof.dual).f_m_excess_bound
    there = next((seconds for seconds, value in row.way if value <= WITHIN * best), None)
    elsewhere = [value > best * (1 + CLOSE) for value in row.solves or ()]
    return SolverRow(
        f_m=estimate.f_m,
        excess_f_m=estimate.f_m - best,
        relative_excess=estimate.f_m / best - 1,
        f_m_excess_bound=excess,
        relative_excess_bound=excess / (estimate.f_m - excess),
        seconds=row.seconds,
        seconds_to_1_percent=there,
        ratio_to_conic=None if there is None else there / conic.seconds,
        whole_ratio_to_conic=row.seconds / conic.seconds,
        evaluations=row.evaluations,
        local_solves=len(row.solves) if row.solves else None,
        local_solves_elsewhere=sum(elsewhere) if row.solves else None,
        conservative=estimate.conservative,
        status=estimate.status,
        check_true=error_row(judge(cell, campaign, model, estimate, row.seconds).check_true),
    )
