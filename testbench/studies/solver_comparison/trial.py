"""Five ways to the least F_M of Eq. (19) on the same data: the paper's optimiser against a certificate.

"A proof of global convergence" is unviable for the paper's search over b. Over compliances the problem is
convex, and the dual of one conic program tells how far any other solution can be from the least F_M.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from testbench.bench.campaign import Cell, Model, build_cell, named_models, stream
from testbench.bench.full_pose import Campaign, FullPose, judge, simulate
from testbench.errors import Array, BenchError
from testbench.identify import Budget, Estimate, Estimator, certify, gco, make_estimate, reduce
from testbench.identify.factorised import (
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
from testbench.identify.modelled import modelled
from testbench.identify.search import explore
from testbench.views.report import MM, UM, Report, estimate_report, score_report

NAME = "solver_comparison"
WITHIN = 1.01
"""F_M over the least one at which a solver is called there: within 1 %."""
REPEATS = 5
"""Calls of a conic program, of which the median time counts; one more comes first, not timed."""
DIFFERENCE = math.sqrt(np.finfo(float).eps)
"""Step of the finite differences, where the entries of b are of order one; as MATLAB and scipy take it."""
ORDERS = (6, 4, 3)
"""Orders m of the vector space whose local minima are counted."""
CURVE_POINTS = 150
"""Points kept of a solver's way down."""

Way = list[tuple[float, float]]
"""Least F_M so far: seconds, F_M."""


class Study(BaseModel):
    """The study as data: what a manifest must hold to run it again.

    Attributes:
        scenario: What is measured.
        model: A GCO model by its name in the paper.
        m: Order of the vector space of the solvers over b.
        generations: Most generations of the paper's optimiser.
        short_generations: The same of its short variant.
        trial_points: Trial points of its global search.
        starts: Local solves of the multistart.
        scs: Whether SCS solves it too, by way of cvxpy.
        minima_starts: Local solves from random starts, for every order, to count local minima.
        minima_seeds: Seeds in which that is done, from the first.
    """

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)

    scenario: FullPose
    model: str = "MGCO69"
    m: int = Field(default=LARGEST_ORDER, ge=1, le=LARGEST_ORDER)
    generations: int = Field(default=1000, ge=1)
    short_generations: int = Field(default=20, ge=1)
    trial_points: int = Field(default=1000, ge=1)
    starts: int = Field(default=10, ge=1)
    scs: bool = False
    minima_starts: int = Field(default=50, ge=1)
    minima_seeds: int = Field(default=3, ge=1)

    def budget(self, generations: int) -> Budget:
        """The search with that many generations."""
        stage_one = min(Budget().stage_one_points, self.trial_points)
        return Budget(generations=generations, trial_points=self.trial_points, stage_one_points=stage_one)


@dataclass(frozen=True)
class Solved:
    """What one solver found.

    Attributes:
        key: Its letter.
        estimate: The model.
        way: How it came down.
        seconds: Wall time of the whole call, reduction of the dataset included.
        evaluations: Of F_M; None where nobody counts them.
        solves: F_M of its local solves; None where there are none.
    """

    key: str
    estimate: Estimate
    way: Way
    seconds: float
    evaluations: int | None = None
    solves: Sequence[float] | None = None


@dataclass(frozen=True)
class Found:
    """What a solver over b found.

    Attributes:
        b: The vectors, (size,).
        evaluations: Of F_M.
        solves: F_M that its local solves ended with.
    """

    b: Array
    evaluations: int
    solves: list[float]


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


def gco_model(cell: Cell, name: str) -> Model:
    """A model of the paper that GCO identifies.

    Raises:
        BenchError: When there is none of that name, or least squares identifies it.
    """
    [model] = named_models(cell, [name])
    if model.estimator != gco:
        raise BenchError(f"model: expected one that GCO identifies, such as MGCO69, got {name}")
    return model


def trials(
    folder: Path, study: Study, first: int, clock: Callable[[], float], seeds: Sequence[int]
) -> list[Report]:
    """Reports of some seeds.

    Args:
        folder: The arm's.
        study: What to do.
        first: The first seed of all.
        clock: Wall time [s].
        seeds: Roots of randomness.
    """
    cell = build_cell(folder)
    model = gco_model(cell, study.model)
    return [_trial(cell, model, study, clock, seed, seed - first < study.minima_seeds) for seed in seeds]


def _trial(
    cell: Cell, model: Model, study: Study, clock: Callable[[], float], seed: int, minima: bool
) -> Report:
    campaign = simulate(cell, study.scenario, seed)
    conic = _repeated("d", gco, cell, model, campaign, clock)
    rows = [*_over_b(cell, model, study, campaign, clock), conic]
    if study.scs:
        rows.append(_repeated("e", modelled("SCS"), cell, model, campaign, clock))
    size = MM * np.linalg.norm(campaign.truth.deflection, axis=-1)
    problem = factorise(conic.estimate.regression, study.m)
    report: Report = {
        "seed": seed,
        "dataset": {
            "runs": campaign.identification.runs,
            "points": campaign.identification.points,
            "poses": study.scenario.poses,
            "check_runs": campaign.truth.runs,
            "deflection_min_mm": float(size.min()),
            "deflection_max_mm": float(size.max()),
            "sigma_um": UM * study.scenario.sigma,
            "sigma_urad": UM * study.scenario.sigma_rotation,
        },
        "microseconds_f_m": _microseconds(problem, study, clock),
        "models": [_model(cell, model, campaign, conic)],
        "solvers": [_row(cell, model, campaign, row, conic) for row in rows],
        "ways": {row.key: _thin(row.way, _lower(conic)) for row in rows},
    }
    if minima:
        report["minima"] = {m: _minima(conic.estimate, study, seed, m) for m in ORDERS}
    return report


def _repeated(
    key: str, estimator: Estimator, cell: Cell, model: Model, campaign: Campaign, clock: Callable[[], float]
) -> Solved:
    """A solver without chance, certificate included where it makes one: median time of several calls."""
    calls = []
    for _ in range(1 + REPEATS):
        start = clock()
        estimate = estimator(cell.vjm, model.structure, campaign.identification)
        seconds = clock() - start
        calls.append(Solved(key, estimate, [(seconds, estimate.f_m)], seconds))
    return sorted(calls[1:], key=lambda call: call.seconds)[REPEATS // 2]


def _over_b(
    cell: Cell, model: Model, study: Study, campaign: Campaign, clock: Callable[[], float]
) -> list[Solved]:
    """The solvers over b: the paper's, long and short, and local solves from random starts."""
    seed = campaign.seed
    runs: tuple[tuple[str, OverB, int], ...] = (
        ("a", search(study.budget(study.generations)), 10),
        ("a'", search(study.budget(study.short_generations)), 10),
        ("b", local_solves(1), 11),
        ("b'", differences, 11),  # from the same start
        ("c", local_solves(study.starts), 12),
    )
    rows = []
    for key, solver, random in runs:
        stamps = Stamps(clock)
        problem = factorise(reduce(cell.vjm, model.structure, campaign.identification), study.m)
        found = solver(problem, stream(seed, random), stamps.add)
        method = f"GCO over b, m = {study.m}"
        status = "budget spent" if key.startswith("a") else "local optimum"
        pi = parameters(problem, found.b)
        estimate = replace(
            make_estimate(problem.regression, pi, method=method, constraint="psd"), status=status
        )
        rows.append(
            Solved(key, estimate, stamps.way, clock() - stamps.start, found.evaluations, found.solves)
        )
    return rows


class Stamps:
    """When a solver reached which F_M, from now on."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock, self.start = clock, clock()
        self.way: Way = []

    def add(self, value: float) -> None:
        """Note an F_M."""
        self.way.append((self.clock() - self.start, value))


def _microseconds(problem: Factorised, study: Study, clock: Callable[[], float]) -> float:
    """Time of one F_M within a population of the genetic algorithm [us]."""
    population = stream(0).uniform(-1, 1, (problem.size, study.budget(1).population * problem.size))
    costs(problem, population)
    start = clock()
    count = len(costs(problem, population))
    return UM * (clock() - start) / count


def _lower(conic: Solved) -> float:
    """Lower bound of F_M that the conic program proves."""
    assert conic.estimate.certificate is not None
    return conic.estimate.f_m - conic.estimate.certificate.gap


def _row(cell: Cell, model: Model, campaign: Campaign, row: Solved, conic: Solved) -> Report:
    assert conic.estimate.certificate is not None
    estimate, best = row.estimate, conic.estimate.f_m
    gap = certify(estimate, dual=conic.estimate.certificate.dual).gap
    there = next((seconds for seconds, value in row.way if value <= WITHIN * best), None)
    result = judge(cell, campaign, model, estimate, row.seconds)
    elsewhere = [value > best * (1 + CLOSE) for value in row.solves or ()]
    return {
        "key": row.key,
        "f_m": estimate.f_m,
        "excess_f_m": estimate.f_m - best,
        "relative_excess": estimate.f_m / best - 1,
        "duality_gap": gap,
        "relative_gap": gap / (estimate.f_m - gap),
        "seconds": row.seconds,
        "seconds_to_1_percent": there,
        "ratio_to_conic": None if there is None else there / conic.seconds,
        "whole_ratio_to_conic": row.seconds / conic.seconds,
        "evaluations": row.evaluations,
        "local_solves": len(row.solves) if row.solves else None,
        "local_solves_elsewhere": int(sum(elsewhere)) if row.solves else None,
        "conservative": estimate.conservative,
        "status": estimate.status,
        "check": score_report(result.check),
    }


def _model(cell: Cell, model: Model, campaign: Campaign, conic: Solved) -> Report:
    result = judge(cell, campaign, model, conic.estimate, conic.seconds)
    return {
        **estimate_report(model.name, conic.estimate, conic.seconds),
        "identification": score_report(result.identification),
        "check": score_report(result.check),
        "readings": score_report(result.readings),
        "paper": None,
    }


def _thin(way: Way, lower: float) -> list[list[float]]:
    """Seconds and gap F_M / lower - 1 of a way down, evenly spread over the logarithm of the gap."""
    gaps = np.array([value / lower - 1 for _, value in way])
    level = np.log(np.maximum(gaps, 1e-12))
    wanted = np.linspace(level[0], level[-1], CURVE_POINTS)
    kept = np.unique(np.r_[np.searchsorted(-level, -wanted), len(way) - 1])
    return [[way[k][0], float(gaps[k])] for k in kept if k < len(way)]


def _minima(conic: Estimate, study: Study, seed: int, m: int) -> Report:
    """F_M of local solves from many random starts, as excess over the conic optimum."""
    found = descents(factorise(conic.regression, m), stream(seed, 20 + m), starts=study.minima_starts)
    values = [descent.f_m for descent in found]
    return {"f_m": values, "conic_f_m": conic.f_m, "unfinished": sum(not d.finished for d in found)}
