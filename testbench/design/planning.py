"""A measurement plan: from candidates to the poses that pay, with certificate, promise and order."""

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from testbench.design.criteria import Criterion, check_criterion, criterion_of
from testbench.design.exchange import greedy, select
from testbench.design.forecast import Forecast, forecast
from testbench.design.order import joint_travel, shortest_path
from testbench.design.refine import Reach, Search, ascend, refine
from testbench.design.relaxation import Relaxed, relax, sensitivity
from testbench.design.rows import (
    Problem,
    Specification,
    information,
    measured_rows,
    problem_of,
    task_rows,
    times,
    workspace_rows,
)
from testbench.errors import Array, BenchError, Ids

ASCENTS, CLIMBERS = 2, 60
"""Rounds in which the poses that carry the bound are improved, and how many of them."""
DETOUR = 10.0
"""What a leg that would collide adds to its travel [rad]: it is taken only where nothing else is left."""


@dataclass(frozen=True)
class CandidateSet:
    """Candidates: a pose and a load each."""

    q: Array  #: Joint angles, (candidates, n) [rad, m].
    load: Ids  #: Index into the specification's loads, (candidates,).
    problem: Problem  #: What they tell.


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """Poses to measure, in the order of measuring."""

    criterion: Criterion  #: What was asked for.
    q: Array  #: Joint angles, (poses, n) [rad, m].
    load: Ids  #: Index into the specification's loads, (poses,).
    #: Whether the arm can go straight to each pose from the one before, (poses - 1,).
    clear: tuple[bool, ...]
    examined: CandidateSet  #: All candidates examined, those of the plan among them.
    chosen: Ids  #: Which of them the plan is, (poses,).
    value: float  #: Phi of the plan.
    #: The relaxed optimum over all examined: its bound is that of all plans of as many poses.
    relaxed: Relaxed

    @property
    def efficiency(self) -> float:
        """At least this share of the best Phi that as many of the examined poses reach [1]."""
        return self.value / self.relaxed.bound

    @property
    def information(self) -> Array:
        """Information matrix M, prior included, (r, r)."""
        return information(self.examined.problem, self.chosen)


@dataclass(frozen=True, kw_only=True)
class Plan(Chosen):
    """Poses under loads that are hung and taken off, and what they are for."""

    specification: Specification  #: What it is for.


def candidate_set(spec: Specification, q: Array) -> CandidateSet:
    """Every pose (poses, n) [rad, m] under every load.

    Raises:
        BenchError: When no load moves a target, or without a prior there are fewer poses than directions to
            see: says what is lost.
    """
    load = np.repeat(np.arange(len(spec.loads)), len(q))
    every = np.tile(q, (len(spec.loads), 1))
    problem = problem_of(spec, every, load)
    seen, r = min(problem.r, spec.poses * int(np.linalg.matrix_rank(problem.rows[0]))), problem.r
    if spec.uncertainty is None and seen < r:
        raise BenchError(
            f"poses: {spec.poses} poses see at most {seen} of the {r} directions of "
            f"{spec.experiment.metric.structure.name} that these loads can show, {r - seen} would be lost; "
            f"expected at least {-(-r * spec.poses // seen)} poses, or a prior that fills the rest"
        )
    return CandidateSet(every, load, problem)


def make_plan(spec: Specification, name: str, q: Array, reach: Reach, rng: np.random.Generator) -> Plan:
    """The best plan by one of `CRITERIA`, certified against all poses examined.

    Args:
        spec: What the plan is for.
        name: One of CRITERIA; BenchError for any other, and for too few poses without a prior.
        q: Feasible poses, (candidates, n) [rad, m].
        reach: Which poses near the candidates are feasible, and which ways between them are clear.
        rng: Source of starts and steps.
    """
    check_criterion(name)
    examined = candidate_set(spec, q)
    arm = spec.experiment.vjm.arm
    search = Search(partial(measured_rows, spec), spec.poses, arm.limits, reach, rng, arm.followed)
    criterion = criterion_of(name, examined.problem, workspace_rows(spec), task_rows(spec))
    return Plan(specification=spec, **vars(choose(search, criterion, examined)))


def choose(search: Search, criterion: Criterion, examined: CandidateSet) -> Chosen:
    """The best poses by a criterion, certified against all poses examined."""
    relaxed = relax(examined.problem, criterion, search.poses)
    for _ in range(ASCENTS):
        examined = _climb(search, examined, relaxed)
        relaxed = relax(examined.problem, criterion, search.poses, relaxed)
    chosen = select(examined.problem, criterion, search.poses, relaxed, search.rng)
    load = examined.load[chosen]

    def rows(trial: Array, places: Ids) -> Array:
        return times(search.measured(trial, load[places]), examined.problem.lift)

    q = refine(examined.q[chosen], examined.problem.prior, criterion, rows, search)
    order = _order(q, load, search.reach)
    found = _add(search, examined, q[order], load[order])
    chosen = np.arange(len(found.q) - search.poses, len(found.q))
    last = relax(found.problem, criterion, search.poses, relaxed)
    return _measured(search, criterion, found, chosen, last)


def choose_greedily(search: Search, criterion: Criterion, examined: CandidateSet) -> Chosen:
    """Each pose the best next one of those examined: quick for many unknowns, its bound is loose."""
    problem, poses = examined.problem, search.poses
    chosen = greedy(problem, criterion, problem.rows, poses)
    chosen = chosen[_order(examined.q[chosen], examined.load[chosen], search.reach)]
    M = information(problem, chosen)
    Z = criterion.tangent(M).Z
    bound = float((Z * problem.prior).sum() + poses * sensitivity(problem.rows, Z).max())
    return _measured(search, criterion, examined, chosen, Relaxed(chosen, np.ones(poses), bound, Z))


def _measured(
    search: Search, criterion: Criterion, examined: CandidateSet, chosen: Ids, relaxed: Relaxed
) -> Chosen:
    """Some of the poses examined, in the order of measuring."""
    q = examined.q[chosen]
    return Chosen(
        criterion=criterion,
        q=q,
        load=examined.load[chosen],
        clear=tuple(search.reach.clear(start, end) for start, end in pairwise(q)),
        examined=examined,
        chosen=chosen,
        value=criterion.information(information(examined.problem, chosen)),
        relaxed=relaxed,
    )


def _climb(search: Search, examined: CandidateSet, relaxed: Relaxed) -> CandidateSet:
    """The poses that carry the relaxed optimum, improved, as further candidates."""
    top = relaxed.support[np.argsort(-relaxed.weights, kind="stable")[:CLIMBERS]]
    load = examined.load[top]

    def usefulness(q: Array) -> Array:
        rows = times(search.measured(q, np.resize(load, len(q))), examined.problem.lift)
        return sensitivity(rows, relaxed.dual)

    return _add(search, examined, ascend(examined.q[top], usefulness, search), load)


def _add(search: Search, examined: CandidateSet, q: Array, load: Ids) -> CandidateSet:
    """More candidates; what only they show is left out."""
    rows = search.measured(q, load) @ examined.problem.lift
    problem = replace(examined.problem, rows=np.concatenate([examined.problem.rows, rows]))
    return CandidateSet(np.vstack([examined.q, q]), np.r_[examined.load, load], problem)


def _order(q: Array, load: Ids, reach: Reach) -> Ids:
    """Order of measuring: one load after the other, each on the shortest way through its poses."""
    found: list[int] = []
    for kind in np.unique(load):
        own = q[load == kind]

        def detour(a: int, b: int, own: Array = own) -> float:
            return 0.0 if reach.clear(own[a], own[b]) else DETOUR

        found += np.flatnonzero(load == kind)[shortest_path(joint_travel(own), detour)].tolist()
    return np.array(found)


def promise(plan: Chosen, rows: Array) -> Forecast:
    """Errors to expect after the plan was measured and identified, of predictions such as `task_rows`."""
    return forecast(plan.examined.problem, plan.information, rows)
