"""A measurement plan: from candidates to the poses that pay, with certificate, promise and order."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from testbench.design.criteria import Criterion, Determinant, Linear, criterion_e, criterion_g, mean_square
from testbench.design.exchange import select
from testbench.design.forecast import Forecast, forecast
from testbench.design.order import joint_travel, shortest_path
from testbench.design.refine import Neighbourhood, Reach, ascend, refine
from testbench.design.relaxation import Relaxed, relax, sensitivity
from testbench.design.rows import Ids, Problem, information, more, times
from testbench.design.specification import Specification, measured_rows, problem_of, task_rows, workspace_rows
from testbench.errors import Array, BenchError

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


CRITERIA: dict[str, Callable[[Specification, Problem], Criterion]] = {
    "D": lambda _spec, _problem: Determinant(),
    "A": lambda _spec, problem: Linear("A", np.eye(problem.r) / problem.r),
    "E": lambda _spec, _problem: criterion_e(),
    "G": lambda spec, problem: criterion_g(workspace_rows(spec) @ problem.lift),
    "I": lambda spec, problem: Linear("I", mean_square(workspace_rows(spec) @ problem.lift)),
    "test": lambda spec, problem: Linear("test", mean_square(task_rows(spec) @ problem.lift)),
}
"""Criteria by name."""

Measured = Callable[[Array, Ids], Array]
"""Whitened rows (poses, k, n) of poses (poses, n joints) [rad, m], each under its own load (poses,)."""


@dataclass(frozen=True)
class Search:
    """How poses are looked for, whatever they are measured for."""

    measured: Measured  #: What a pose tells.
    poses: int  #: How many may be measured.
    limits: Array  #: Lower and upper joint limits, (2, n joints) [rad, m].
    reach: Reach  #: Which poses near the candidates are feasible, and which ways between them are clear.
    rng: np.random.Generator  #: Source of starts and steps.


def check_criterion(name: str) -> None:
    """Refuse what is no key of `CRITERIA`."""
    if name not in CRITERIA:
        raise BenchError(f"no criterion {name!r}; criteria are {', '.join(CRITERIA)}")


def candidate_set(spec: Specification, q: Array) -> CandidateSet:
    """Every pose (poses, n) [rad, m] under every load.

    Raises:
        BenchError: When no load moves a target, or without a prior there are fewer poses than directions to
            see: says what is lost.
    """
    load = np.repeat(np.arange(len(spec.loads)), len(q))
    every = np.tile(q, (len(spec.loads), 1))
    found = CandidateSet(every, load, problem_of(spec, every, load))
    if spec.uncertainty is None:
        _check_enough(spec, found.problem)
    return found


def seen_at_most(spec: Specification, problem: Problem) -> int:
    """Directions that the plan's poses can see at most; the candidates show problem.r."""
    return min(problem.r, spec.poses * int(np.linalg.matrix_rank(problem.rows[0])))


def _check_enough(spec: Specification, problem: Problem) -> None:
    seen, r = seen_at_most(spec, problem), problem.r
    if seen < r:
        raise BenchError(
            f"poses: {spec.poses} poses see at most {seen} of the {r} directions of "
            f"{spec.experiment.metric.structure.name} that these loads can show, {r - seen} would be lost; "
            f"expected at least {-(-r * spec.poses // seen)} poses, or a prior that fills the rest"
        )


def make_plan(spec: Specification, name: str, q: Array, reach: Reach, rng: np.random.Generator) -> Plan:
    """The best plan by a key of `CRITERIA`, certified against all poses examined.

    Args:
        spec: What the plan is for.
        name: Key of CRITERIA; BenchError for any other, and for too few poses without a prior.
        q: Feasible poses, (candidates, n) [rad, m].
        reach: Which poses near the candidates are feasible, and which ways between them are clear.
        rng: Source of starts and steps.
    """
    check_criterion(name)
    examined = candidate_set(spec, q)
    search = Search(
        measured=lambda q, load: measured_rows(spec, q, load),
        poses=spec.poses,
        limits=spec.experiment.vjm.arm.limits,
        reach=reach,
        rng=rng,
    )
    chosen = choose(search, CRITERIA[name](spec, examined.problem), examined)
    return Plan(specification=spec, **vars(chosen))


def choose(search: Search, criterion: Criterion, examined: CandidateSet) -> Chosen:
    """The best poses by a criterion, certified against all poses examined."""
    near = Neighbourhood(search.reach.feasible, search.limits, search.rng)
    relaxed = relax(examined.problem, criterion, search.poses)
    for _ in range(ASCENTS):
        examined = _climb(search.measured, examined, relaxed, near)
        relaxed = relax(examined.problem, criterion, search.poses, relaxed)
    chosen = select(examined.problem, criterion, search.poses, relaxed, search.rng)
    q, load = _refined(search.measured, examined, chosen, criterion, near)
    order = _order(q, load, search.reach)
    q, load = q[order], load[order]
    examined = _add(search.measured, examined, q, load)
    chosen = np.arange(len(examined.q) - search.poses, len(examined.q))
    return Chosen(
        criterion=criterion,
        q=q,
        load=load,
        clear=tuple(search.reach.clear(start, end) for start, end in pairwise(q)),
        examined=examined,
        chosen=chosen,
        value=criterion.information(information(examined.problem, chosen)),
        relaxed=relax(examined.problem, criterion, search.poses, relaxed),
    )


def _refined(
    measured: Measured, examined: CandidateSet, chosen: Ids, criterion: Criterion, near: Neighbourhood
) -> tuple[Array, Ids]:
    """Better angles for the chosen candidates, (poses, n) [rad, m], and their loads, (poses,)."""
    load = examined.load[chosen]

    def rows(trial: Array, places: Ids) -> Array:
        return times(measured(trial, load[places]), examined.problem.lift)

    return refine(examined.q[chosen], examined.problem.prior, criterion, rows, near), load


def _climb(measured: Measured, examined: CandidateSet, relaxed: Relaxed, near: Neighbourhood) -> CandidateSet:
    """The poses that carry the relaxed optimum, improved, as further candidates."""
    top = relaxed.support[np.argsort(-relaxed.weights, kind="stable")[:CLIMBERS]]
    load = examined.load[top]

    def usefulness(q: Array) -> Array:
        rows = times(measured(q, np.resize(load, len(q))), examined.problem.lift)
        return sensitivity(rows, relaxed.dual)

    return _add(measured, examined, ascend(examined.q[top], usefulness, near), load)


def _add(measured: Measured, examined: CandidateSet, q: Array, load: Ids) -> CandidateSet:
    problem = more(examined.problem, measured(q, load))
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
