"""A measurement plan: from candidate poses to those that pay, with certificate, forecast and order.

`make_plan` joins the parts of this package: relaxation, exchange, local refinement, order of measuring. The
relaxed bound certifies how far the plan is from the best one over all poses examined.
"""

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from testbench.design.criteria import Criterion, check_criterion, criterion_of
from testbench.design.exchange import greedy, select_poses
from testbench.design.forecast import Forecast, forecast
from testbench.design.order import joint_travel, shortest_path
from testbench.design.refine import Feasibility, Search, ascend_poses, refine_plan
from testbench.design.relaxation import Relaxed, relax, sensitivity
from testbench.design.rows import (
    DesignProblem,
    Specification,
    information,
    measured_rows,
    problem_of,
    task_rows,
    workspace_rows,
)
from testbench.errors import Array, BenchError, Ids

MAX_ASCENTS, CLIMBERS = 2, 60
"""Rounds in which the poses with most relaxed weight are improved, and how many poses in a round."""
DETOUR = 10.0
"""Surcharge on the travel of a leg that would collide [rad]: it is used only where no other is left."""


@dataclass(frozen=True)
class CandidateSet:
    """Hold the candidates of a plan, one pose and one load each, and what their readings tell."""

    q: Array  #: Actuated joints, (candidates, n) [rad, m].
    load: Ids  #: Index into the specification's loads, (candidates,).
    problem: DesignProblem  #: Their whitened rows, and the prior.


@dataclass(frozen=True, kw_only=True)
class ChosenPoses:
    """Hold the chosen poses in the order of measuring, with the certificate of the choice."""

    criterion: Criterion  #: Information function Phi that the plan maximises.
    q: Array  #: Actuated joints, (poses, n) [rad, m].
    load: Ids  #: Index into the specification's loads, (poses,).
    #: Whether the arm can go straight to each pose from the one before, (poses - 1,).
    clear: tuple[bool, ...]
    examined: CandidateSet  #: All candidates examined, those of the plan among them.
    chosen: Ids  #: Indices of the plan's poses among the examined, (poses,).
    value: float  #: Phi of the plan.
    #: Relaxed optimum over all examined poses: its bound holds for all plans of as many poses.
    relaxed: Relaxed

    @property
    def efficiency(self) -> float:
        """Return a lower bound on Phi(plan) / Phi(best plan of as many of the examined poses) [1]."""
        return self.value / self.relaxed.bound

    @property
    def information(self) -> Array:
        """Compute the plan's information matrix M, prior included, (r, r)."""
        return information(self.examined.problem, self.chosen)


@dataclass(frozen=True, kw_only=True)
class Plan(ChosenPoses):
    """Hold the poses to measure under loads that are hung and taken off, and the specification they serve."""

    specification: Specification  #: Specification that the plan serves.


def candidate_set(spec: Specification, q: Array) -> CandidateSet:
    """Make every pose under every load a candidate.

    Args:
        spec: Loads, prior and number of poses of the plan.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        The candidates, poses times loads, all poses under the first load first.

    Raises:
        BenchError: When no load moves a target; or when without a prior the plan has too few poses for all
            directions that the loads can show: the message counts the directions that would be lost.
    """
    load = np.repeat(np.arange(len(spec.loads)), len(q))
    every = np.tile(q, (len(spec.loads), 1))
    problem = problem_of(spec, every, load)
    seen, r = min(problem.r, spec.poses * int(np.linalg.matrix_rank(problem.rows[0]))), problem.r
    if spec.uncertainty is None and seen < r:
        raise BenchError(
            f"poses: {spec.poses} poses see at most {seen} of the {r} directions of "
            f"{spec.experiment.scaling.structure.name} that these loads can show, {r - seen} would be lost; "
            f"expected at least {-(-r * spec.poses // seen)} poses, or a prior that fills the rest"
        )
    return CandidateSet(every, load, problem)


def make_plan(spec: Specification, name: str, q: Array, reach: Feasibility, rng: np.random.Generator) -> Plan:
    """Find the best plan by one of `CRITERIA`, certified against all poses examined.

    Args:
        spec: Specification of the plan.
        name: One of `CRITERIA`.
        q: Feasible poses, (candidates, n) [rad, m].
        reach: Tells which poses near the candidates are feasible, and which ways between them are clear.
        rng: Source of starts and steps.

    Returns:
        The plan in the order of measuring.

    Raises:
        BenchError: When the criterion is unknown, no load moves a target, or there are too few poses without
            a prior.
    """
    check_criterion(name)
    examined = candidate_set(spec, q)
    arm = spec.experiment.vjm.arm
    search = Search(partial(measured_rows, spec), spec.poses, arm.limits, reach, rng, arm.followed)
    criterion = criterion_of(name, examined.problem, workspace_rows(spec), task_rows(spec))
    return Plan(specification=spec, **vars(choose_poses(search, criterion, examined)))


def choose_poses(search: Search, criterion: Criterion, examined: CandidateSet) -> ChosenPoses:
    """Find the best poses by a criterion, certified against all poses examined.

    Args:
        search: Measurement, number of poses, limits and feasibility.
        criterion: Information function.
        examined: Candidates to begin with.

    Returns:
        The plan; its examined poses include those found on the way.
    """
    # relaxed optimum; its heaviest poses, improved locally, join the candidates
    relaxed = relax(examined.problem, criterion, search.poses)
    for _ in range(MAX_ASCENTS):
        examined = _climb(search, examined, relaxed)
        relaxed = relax(examined.problem, criterion, search.poses, relaxed)
    # whole poses by exchange, then a local search in their joint angles
    chosen = select_poses(examined.problem, criterion, search.poses, relaxed, search.rng)
    load = examined.load[chosen]

    def rows(trial: Array, places: Ids) -> Array:
        return search.measured(trial, load[places], examined.problem.lift)

    q = refine_plan(examined.q[chosen], examined.problem.prior, criterion, rows, search)
    # the order of measuring, and the bound over all poses examined, those of the plan among them
    order = _order(q, load, search.reach)
    found = _add(search, examined, q[order], load[order])
    chosen = np.arange(len(found.q) - search.poses, len(found.q))
    last = relax(found.problem, criterion, search.poses, relaxed)
    return _measured(search, criterion, found, chosen, last)


def choose_greedily(search: Search, criterion: Criterion, examined: CandidateSet) -> ChosenPoses:
    """Choose each pose as the best next one of those examined: fast for many unknowns, with a loose bound.

    Args:
        search: Number of poses and feasibility of ways.
        criterion: Information function.
        examined: Candidates.

    Returns:
        The plan in the order of measuring, with the bound of the tangent at the plan itself.
    """
    problem, poses = examined.problem, search.poses
    chosen = greedy(problem, criterion, problem.rows, poses)
    chosen = chosen[_order(examined.q[chosen], examined.load[chosen], search.reach)]
    M = information(problem, chosen)
    Z = criterion.tangent(M).Z
    bound = float((Z * problem.prior).sum() + poses * sensitivity(problem.rows, Z).max())
    return _measured(search, criterion, examined, chosen, Relaxed(chosen, np.ones(poses), bound, Z))


def _measured(
    search: Search, criterion: Criterion, examined: CandidateSet, chosen: Ids, relaxed: Relaxed
) -> ChosenPoses:
    """Assemble a plan from some of the poses examined, which are in the order of measuring."""
    q = examined.q[chosen]
    return ChosenPoses(
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
    """Improve the poses that carry most weight of the relaxed optimum, and add them as candidates."""
    top = relaxed.support[np.argsort(-relaxed.weights, kind="stable")[:CLIMBERS]]
    load = examined.load[top]

    def usefulness(q: Array) -> Array:
        rows = search.measured(q, np.resize(load, len(q)), examined.problem.lift)
        return sensitivity(rows, relaxed.dual)

    return _add(search, examined, ascend_poses(examined.q[top], usefulness, search), load)


def _add(search: Search, examined: CandidateSet, q: Array, load: Ids) -> CandidateSet:
    """Add candidates; directions that only they show are left out."""
    rows = search.measured(q, load, None) @ examined.problem.lift
    problem = replace(examined.problem, rows=np.concatenate([examined.problem.rows, rows]))
    return CandidateSet(np.vstack([examined.q, q]), np.r_[examined.load, load], problem)


def _order(q: Array, load: Ids, reach: Feasibility) -> Ids:
    """Order the poses: one load after the other, each on the shortest way through its poses, (poses,)."""
    found: list[int] = []
    for kind in np.unique(load):
        own = q[load == kind]

        def detour(a: int, b: int, own: Array = own) -> float:
            return 0.0 if reach.clear(own[a], own[b]) else DETOUR

        found += np.flatnonzero(load == kind)[shortest_path(joint_travel(own), detour)].tolist()
    return np.array(found)


def forecast_errors(plan: ChosenPoses, rows: Array) -> Forecast:
    """Forecast the errors of predictions after the plan was measured and the model identified.

    Args:
        plan: A chosen plan.
        rows: Predictions per unit of x, such as `task_rows`, (poses, 3 m, n) [m].

    Returns:
        The forecast of the linear model.
    """
    return forecast(plan.examined.problem, plan.information, rows)
