"""Five ways to the least F_M of Eq. (19) on the same data: the paper's optimiser against a certificate.

"A proof of global convergence" is unviable for the paper's search over b. Over compliances the problem is
convex, and the dual of one conic program tells how far any other solution can be from the least F_M.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Annotated

import numpy as np
import typer

from testbench.arm.folder import find_arm
from testbench.campaign.campaign import Campaign, Cell, build_cell, stream
from testbench.campaign.evaluation import CampaignRow, campaign_rows, judge
from testbench.campaign.models import Model, named_models
from testbench.campaign.pose_campaign import FullPose, simulate
from testbench.data.write import csv_text
from testbench.errors import Array, BenchError
from testbench.identify import Estimate, Estimator, certify, gco, make_estimate, paper_gco, reduce
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
from testbench.studies.six_dof_arm.trial import TUBES

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
    """Flags of the study."""

    model: Annotated[str, typer.Option(help="A GCO model of the paper.")] = "MGCO69"
    m: Annotated[int, typer.Option(min=1, max=6, help="Order of the vector space.")] = LARGEST_ORDER
    generations: Annotated[int, typer.Option(min=1, help="Most, of the genetic algorithm.")] = 1000
    trial_points: Annotated[int, typer.Option(min=1, help="Of the global search.")] = 1000
    starts: Annotated[int, typer.Option(min=1, help="Local solves of the multistart.")] = 10
    scs: Annotated[bool, typer.Option("--scs", help="SCS by way of cvxpy too (make bench has it).")] = False


@dataclass(frozen=True)
class Settings(Options):
    """What is tried."""

    first: int = 1  #: The first seed: its runs are kept.


@dataclass(frozen=True)
class SolverRow(CampaignRow):
    """What one solver found in one seed: the model, and its way down."""

    key: str = ""  #: Letter of the solver.
    excess_f_m: float = 0.0  #: F_M over that of the conic program.
    relative_excess: float = 0.0  #: The same, relative.
    relative_excess_bound: float = 0.0  #: F_M over its certified lower bound, relative to the bound.
    seconds_to_1_percent: float | None = None  #: Until F_M was within 1 % of the conic program's.
    ratio_to_conic: float | None = None  #: The same over the conic program's whole time.
    whole_ratio_to_conic: float = 1.0  #: Whole time over the conic program's.
    evaluations: int | None = None  #: Of F_M; None where nobody counts them.
    local_solves: int | None = None  #: How many; None where there are none.
    local_solves_elsewhere: int | None = None  #: Those that ended more than CLOSE above the conic program.
    data_file: str | None = None  #: dataset.csv, in a row of the first seed.


@dataclass(frozen=True)
class Solved:
    """What one solver found."""

    key: str  #: Its letter.
    estimate: Estimate  #: The model.
    way: list[tuple[float, float]]  #: Seconds and F_M of every improvement.
    seconds: float  #: Wall time of the whole call, reduction of the dataset included.
    evaluations: int | None = None  #: Of F_M; None where nobody counts them.
    solves: Sequence[float] = ()  #: F_M of its local solves.


Found = tuple[Array, int, list[float]]
"""The vectors b, (size,), evaluations of F_M, and F_M that the local solves ended with."""
OverB = Callable[[Factorised, np.random.Generator, Observe], Found]
"""A solver over b: problem, source of its starts, who is told of every least F_M."""


def search(budget: Budget, problem: Factorised, rng: np.random.Generator, observe: Observe) -> Found:
    """The paper's optimiser, run through its whole budget: no threshold stops it."""
    found = explore(problem, budget, rng, observe)
    return found.best, found.evaluations, found.descents


def local_solves(starts: int, problem: Factorised, rng: np.random.Generator, observe: Observe) -> Found:
    """Local solves on the analytic gradient, from random starts."""
    found = descents(problem, rng, starts=starts, observe=observe)
    best = min(found, key=lambda descent: descent.f_m)
    return best.b, sum(d.evaluations for d in found), [d.f_m for d in found]


def differences(problem: Factorised, rng: np.random.Generator, observe: Observe) -> Found:
    """One local solve that knows F_M alone and takes its gradient by finite differences."""
    end = descend(problem, random_start(problem, rng), evaluate=forward_differences, observe=observe)
    return end.b, (problem.size + 1) * end.evaluations, [end.f_m]


def forward_differences(problem: Factorised, b: Array) -> tuple[float, Array]:
    """F_M(b) and its gradient by finite differences, all points at once, (size,)."""
    values = costs(problem, np.hstack([b[:, None], b[:, None] + DIFFERENCE * np.eye(problem.size)]))
    return float(values[0]), (values[1:] - values[0]) / DIFFERENCE


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


def settings(options: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for.

    Raises:
        BenchError: When the model is none that GCO identifies, or SCS is not installed.
    """
    gco_model(build_cell(find_arm(ARM)), options.model)
    if options.scs:
        cvxpy("SCS")
    most = (QUICK_GENERATIONS, QUICK_STARTS) if quick else (options.generations, options.starts)
    generations, starts = map(min, zip((options.generations, options.starts), most, strict=True))
    return Settings(**vars(options) | {"generations": generations, "starts": starts}, first=seeds[0])


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[SolverRow]]:
    """Rows of some seeds, one a solver."""
    cell = build_cell(find_arm(ARM))
    model = gco_model(cell, asked.model)
    return [_trial(cell, model, asked, seed) for seed in seeds]


def _trial(cell: Cell, model: Model, asked: Settings, seed: int) -> list[SolverRow]:
    campaign = simulate(cell, SCENARIO, seed)
    conic = _repeated("d", paper_gco, cell, model, campaign)
    found = [*_factor_solvers(cell, model, asked, campaign), conic]
    if asked.scs:
        found.append(_repeated("e", modelled, cell, model, campaign))
    proof = conic.estimate.certificate
    assert proof is not None
    proofs = [proof if own is conic else certify(own.estimate, dual=proof.dual) for own in found]
    results = [
        judge(cell, campaign, model, replace(own.estimate, certificate=proven), own.seconds)
        for own, proven in zip(found, proofs, strict=True)
    ]
    data = csv_text(campaign.identification, cell.arm) if seed == asked.first else None
    rows = campaign_rows(cell, campaign, results, TUBES, placed=False)
    return [
        replace(_row(row, own, conic, proven.f_m_excess_bound), data_file=data if own is conic else None)
        for row, own, proven in zip(rows, found, proofs, strict=True)
    ]


def _repeated(key: str, estimator: Estimator, cell: Cell, model: Model, campaign: Campaign) -> Solved:
    """A solver without chance, certificate included where it makes one: median time of several calls."""
    calls = []
    for _ in range(1 + REPEATS):
        start = perf_counter()
        estimate = estimator(cell.vjm, model.structure, campaign.identification)
        seconds = perf_counter() - start
        calls.append(Solved(key, estimate, [(seconds, estimate.f_m)], seconds))
    return sorted(calls[1:], key=lambda call: call.seconds)[REPEATS // 2]


def _factor_solvers(cell: Cell, model: Model, asked: Options, campaign: Campaign) -> Iterator[Solved]:
    """The solvers over b: the paper's, long and short, and local solves from random starts."""
    points = asked.trial_points
    first = min(Budget().stage_one_points, points)
    budgets = [
        Budget(generations=n, trial_points=points, stage_one_points=first)
        for n in (asked.generations, SHORT_GENERATIONS)
    ]
    runs: tuple[tuple[str, OverB, int], ...] = (  # the last is the number of its stream of random starts
        ("a", partial(search, budgets[0]), 10),
        ("a'", partial(search, budgets[1]), 10),
        ("b", partial(local_solves, 1), 11),
        ("b'", differences, 11),  # from the same start
        ("c", partial(local_solves, asked.starts), 12),
    )
    for key, solver, random in runs:
        way: list[tuple[float, float]] = []
        start = perf_counter()
        problem = factorise(reduce(cell.vjm, model.structure, campaign.identification), asked.m)
        note = partial(_note, way, start)
        b, evaluations, solves = solver(problem, stream(campaign.seed, random), note)
        pi, method = parameters(problem, b), f"GCO over b, m = {asked.m}"
        estimate = make_estimate(problem.regression, pi, method=method, constraint="psd")
        estimate = replace(estimate, status="budget spent" if key in PAPERS else "local optimum")
        yield Solved(key, estimate, way, perf_counter() - start, evaluations, solves)


def _note(way: list[tuple[float, float]], start: float, f_m: float) -> None:
    way.append((perf_counter() - start, f_m))


def _row(row: CampaignRow, own: Solved, conic: Solved, excess: float) -> SolverRow:
    f_m, best = own.estimate.f_m, conic.estimate.f_m
    there = next((seconds for seconds, value in own.way if value <= WITHIN * best), None)
    elsewhere = [value > best * (1 + CLOSE) for value in own.solves]
    return SolverRow(
        **vars(row),
        key=own.key,
        excess_f_m=f_m - best,
        relative_excess=f_m / best - 1,
        relative_excess_bound=excess / (f_m - excess),
        seconds_to_1_percent=there,
        ratio_to_conic=None if there is None else there / conic.seconds,
        whole_ratio_to_conic=own.seconds / conic.seconds,
        evaluations=own.evaluations,
        local_solves=len(elsewhere) or None,
        local_solves_elsewhere=sum(elsewhere) if elsewhere else None,
    )
