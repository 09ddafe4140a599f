"""A measurement plan: from candidate poses to the best ones, with certificate, forecast and order.

`make_plan` joins the parts of this package: relaxation, exchange, local refinement, order of measuring. The
relaxed bound certifies how far the plan is from the best one over all poses examined.

The order of measuring is the shortest way through all poses, an integer program (travelling salesman). Every
pose has two of the chosen legs, and subtours are forbidden as they appear (Dantzig, Fulkerson and Johnson
1954). A place at distance zero from all others is where the round trip is cut open. Programs over legs to
near places come first, and linear relaxations before integer ones: these cheaper programs reveal most
subtours and most surcharges. More than `MAX_EXACT_PLACES` places use legs to near places only. A surcharge
of a leg, such as a collision check, is expensive to compute. It is computed only for legs that a best trip
uses. A trip without its surcharges seems no longer than it is, so the best trip whose legs all have theirs
is the shortest.

`baselines` compares the plan with greedy and random plans, `prior_influence` computes the part of the
forecast that rests on the prior, and `observability` the indices O1: Borm and Menq (IJRR 1991); O2: Driels
and Pathre (J. Robotic Systems 1990); O3: Nahvi, Hollerbach and Hayward (ICRA 1994); O4: Nahvi and Hollerbach
(ICRA 1996); O5: Sun and Hollerbach (ICRA 2008).
"""

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, depth_first_order

from testbench.design.criteria import Criterion, check_criterion, criterion_by_name, mean_square_weight
from testbench.design.exchange import (
    Feasibility,
    GaugePlan,
    Gauges,
    PlacedGauges,
    PoseSearch,
    RelaxedDesign,
    choose_poses_and_gauges,
    collect_placed_gauges,
    gauge_rows,
    greedy_plan,
    improve_single_poses,
    most_informative_gauges,
    place_gauges,
    refine_plan,
    select_poses,
    sensitivity,
    solve_relaxed_design,
)
from testbench.design.forecast import Forecast, forecast
from testbench.design.rows import (
    DesignProblem,
    PlanSpecification,
    add_information,
    build_design_problem,
    candidate_rows,
    information,
    task_rows,
    whitened_rows_by_load,
    workspace_rows,
)
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, Mask
from testbench.identify.regression import RANK_TOLERANCE
from testbench.progress import stepwise

# --- The order of measuring: the shortest way through all poses ---------------------------------------------

N_NEAREST_PLACES = 12  #: Number of nearest places of each place, whose legs are tried first.
MIN_LEG_SHARE = 1e-7  #: Part of a leg in a linear relaxation above which the leg is used [1].
MAX_EXACT_PLACES = 101  #: Most places whose legs are all tried: 100 poses and the cut.

Surcharge = Callable[[int, int], float]
"""Function of the indices of two places to the cost of their leg beyond its length, 0 or more."""


def joint_travel(q: Array) -> Array:
    """Compute the largest motion of a joint between all pairs of poses, (poses, poses) [rad, m].

    Mathematics: `pose-14`.
    """
    return np.asarray(np.abs(q[:, None] - q[None]).max(axis=2))


def shortest_path(cost: Array, surcharge: Surcharge = lambda _a, _b: 0.0) -> Ids:
    """Find the shortest open path through all places, from any place to any other.

    Places at distance zero from each other are visited together.

    Args:
        cost: Length of every leg, symmetric, zero on the diagonal, (places, places).
        surcharge: Function of two places to the cost of their leg beyond its length, 0 or more.

    Returns:
        Indices of the places in order, (places,). Optimal up to `MAX_EXACT_PLACES` - 1 places.
    """
    first = (cost == 0).argmax(axis=1)
    stops = np.unique(first)

    # A round trip from an additional place 0, whose legs cost nothing, is an open path through all others.
    trip = round_trip(
        np.pad(cost[np.ix_(stops, stops)], (1, 0)),
        lambda a, b: surcharge(int(stops[a - 1]), int(stops[b - 1])) if a else 0.0,
    )
    return np.concatenate([np.flatnonzero(first == stop) for stop in stops[trip[1:] - 1]])


def round_trip(cost: Array, surcharge: Surcharge = lambda _a, _b: 0.0) -> Ids:
    """Find the shortest round trip through all places.

    Args:
        cost: Length of every leg, symmetric, (places, places).
        surcharge: Function of two places to the cost of their leg beyond its length, 0 or more.

    Returns:
        Indices of the places in order, from place 0 on, (places,). Optimal up to `MAX_EXACT_PLACES` places;
        for more places the shortest trip that uses legs to near places only.
    """
    n = len(cost)
    if n <= 3:
        return np.arange(n)
    every = np.stack(np.triu_indices(n, 1), axis=1)
    price, asked = cost[every[:, 0], every[:, 1]], np.zeros(len(every), dtype=bool)
    parts: list[Mask] = []  # places that no subtour may join, (places,) each
    near = _near_legs(cost)[every[:, 0], every[:, 1]]
    legs = (near, np.ones_like(near)) if n <= MAX_EXACT_PLACES else (near,)
    # near legs relaxed, then whole; all legs relaxed, then whole: each keeps the rules found before
    for chosen, whole in itertools.product(legs, (False, True)):
        while True:
            # the best trip under the subtours and surcharges known so far
            used = np.flatnonzero(chosen)[_best_legs(every[chosen], price[chosen], parts, n, whole)]
            before = price[used].sum()
            # compute the surcharges of its legs that have none yet
            for k in used[~asked[used]]:
                price[k] += surcharge(*map(int, every[k]))
            asked[used] = True
            # every part that is no round trip through all places becomes a forbidden subtour
            graph = coo_array((np.ones(len(used)), every[used].T), shape=(n, n))
            count, part = connected_components(graph, directed=False)
            parts += [part == k for k in range(count) if count > 1]
            # one trip whose surcharges were known: no other is shorter
            if count == 1 and price[used].sum() <= before:
                break
    return np.asarray(depth_first_order(graph, 0, directed=False, return_predecessors=False))


def _near_legs(cost: Array) -> Mask:
    """Select legs to the nearest places and, so that there is a round trip, from each place to the next."""
    n = len(cost)
    rank = np.argsort(np.where(np.eye(n, dtype=bool), np.inf, cost), axis=1, kind="stable")
    near = np.zeros((n, n), dtype=bool)
    near[np.arange(n)[:, None], rank[:, :N_NEAREST_PLACES]] = True
    near[np.arange(n), np.roll(np.arange(n), 1)] = True
    return np.asarray(near | near.T)


def _best_legs(legs: Ids, price: Array, parts: list[Mask], n: int, integer: bool) -> Ids:
    """Choose the cheapest legs, (legs, 2), two per place, without a subtour in any of the parts.

    Unless they are integer, legs may be used in part: the linear relaxation.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp  # here: it takes long to import

    ends = np.zeros((n, len(legs)))
    ends[legs.T, np.arange(len(legs))] = 1
    inside = np.array([part[legs].all(axis=1) for part in parts], dtype=float).reshape(-1, len(legs))
    rules = [LinearConstraint(ends, 2, 2), LinearConstraint(inside, ub=[part.sum() - 1 for part in parts])]
    integrality = np.full(len(legs), int(integer))
    result = milp(price, integrality=integrality, bounds=Bounds(0, 1), constraints=rules)
    assert result.x is not None, result.message  # from each place to the next is a trip
    return np.flatnonzero(result.x > (0.5 if integer else MIN_LEG_SHARE))


# --- A measurement plan: from candidate poses to the best ones, with certificate, forecast and order --------

IMPROVEMENT_ROUNDS, IMPROVED_POSES = 2, 60
"""Rounds in which the poses with most relaxed weight are improved, and number of these poses in a round."""
MAX_GAUGED_POSES = 1000
"""Most poses among which poses with gauges are exchanged: those with the most information."""
GAUGE_BOUND_ROUNDS = 2
"""Rounds of a bound for gauges: in each they are chosen by the relaxed optimum of the one before."""
COLLISION_SURCHARGE = 10.0
"""Surcharge on the travel of a leg that would collide [rad]: it is used only where no other is left."""


@dataclass(frozen=True)
class CandidateSet:
    """Hold the candidates of a plan, one pose and one load each, and the information of their readings."""

    q: Array  #: Actuated joints of every candidate, (candidates, n) [rad, m].
    load_index: Ids  #: Index of every candidate's load into the possible loads, (candidates,).
    problem: DesignProblem  #: Whitened rows of all candidates, and the prior.


@dataclass(frozen=True, kw_only=True, repr=False)
class ChosenPoses(Displayed):
    """Hold the chosen poses in the order of measuring, with the certificate of the choice."""

    criterion: Criterion  #: Information function Phi that the plan maximises.
    q: Array  #: Actuated joints of the chosen poses, (poses, n) [rad, m].
    load_index: Ids  #: Index of every pose's load into the possible loads, (poses,).
    #: Whether the arm can move straight to each pose from the one before, (poses - 1,).
    clear_paths: tuple[bool, ...]
    candidates: CandidateSet  #: All candidates that were examined, the chosen poses among them.
    chosen_indices: Ids  #: Indices of the chosen poses among the candidates, (poses,).
    criterion_value: float  #: Phi of the plan.
    relaxed_design: RelaxedDesign  #: Relaxed optimum over all candidates, with the bound on Phi of all plans.

    def summary(self) -> dict[str, object]:
        """Summarise the plan: numbers of poses and candidates, and efficiency."""
        return {
            "poses": len(self.q),
            "candidates": len(self.candidates.q),
            "efficiency": f"{self.efficiency:.3g}",
        }

    @property
    def efficiency(self) -> float:
        """Compute a lower bound on Phi of the plan over that of the best plan of as many candidates [1]."""
        return self.criterion_value / self.relaxed_design.bound

    @property
    def information(self) -> Array:
        """Compute the information matrix M of the plan, prior included, (r, r) [1]."""
        return information(self.candidates.problem, self.chosen_indices)


@dataclass(frozen=True, kw_only=True, repr=False)
class Plan(ChosenPoses):
    """Hold the poses in which deflections under hung loads are measured, and their specification."""

    specification: PlanSpecification  #: Specification of the plan.
    gauges: PlacedGauges | None = None  #: Gauges that are read in the poses; None if a tracker is read.

    def whitened_rows(self, spec: PlanSpecification) -> Array:
        """Compute whitened rows of all readings of the plan per unit of a specification's unknowns x.

        Args:
            spec: The plan's specification, or one with other unknowns, prior or loads.

        Returns:
            Rows, (poses, k, n) [1].
        """
        rows = whitened_rows_by_load if self.gauges is None else self.gauges.whitened_rows
        return rows(spec, self.q, self.load_index)


def candidate_set(spec: PlanSpecification, q: Array) -> CandidateSet:
    """Combine all poses with all possible loads to candidates, and compute the information of their readings.

    Args:
        spec: Specification with the possible loads, the prior and the number of poses.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        The candidates, poses times loads, all poses under the first load first.

    Raises:
        BenchError: When no load moves a target; or when without a prior the plan has too few poses for all
            directions that the candidates observe.
    """
    load = np.repeat(np.arange(len(spec.loads)), len(q))
    every = np.tile(q, (len(spec.loads), 1))
    problem = build_design_problem(spec.setup, candidate_rows(spec, every, load), spec.prior_uncertainty)
    seen, r = (
        min(problem.n_directions, spec.n_poses * int(np.linalg.matrix_rank(problem.rows[0]))),
        problem.n_directions,
    )
    if spec.prior_uncertainty is None and seen < r:
        raise BenchError(
            f"{spec.n_poses} poses are too few: of the {r} directions of {spec.setup.scaling.structure.name} "
            f"that these loads can determine, they determine at most {seen}; "
            f"expected at least {-(-r * spec.n_poses // seen)} poses, or a prior for the other directions"
        )
    return CandidateSet(every, load, problem)


def make_plan(
    spec: PlanSpecification, criterion_name: str, q: Array, feasibility: Feasibility, rng: np.random.Generator
) -> Plan:
    """Find the best poses for a specification by one of `CRITERIA`, certified against all poses examined.

    Args:
        spec: Specification of the plan.
        criterion_name: One of `CRITERIA`.
        q: Feasible poses to choose from and to improve, (candidates, n) [rad, m].
        feasibility: Checks of further poses, and of the motions between poses.
        rng: Source of random starts and steps.

    Returns:
        The plan in the order of measuring.

    Raises:
        BenchError: When the criterion is unknown, no load moves a target, or there are too few poses without
            a prior.
    """
    check_criterion(criterion_name)
    examined = candidate_set(spec, q)
    search = _pose_search(spec, feasibility, rng)
    criterion = criterion_by_name(criterion_name, examined.problem, workspace_rows(spec), task_rows(spec))
    return Plan(specification=spec, **vars(choose_poses(search, criterion, examined)))


def _pose_search(spec: PlanSpecification, feasibility: Feasibility, rng: np.random.Generator) -> PoseSearch:
    """Make the search for better joint angles of a plan."""
    arm = spec.setup.vjm.arm
    return PoseSearch(
        partial(whitened_rows_by_load, spec),
        spec.n_poses,
        arm.limits,
        feasibility,
        rng,
        arm.with_dependent_joints,
    )


def plan_with_gauges(plan: Plan, gauges: Gauges, feasibility: Feasibility, rng: np.random.Generator) -> Plan:
    """Plan measurements with dial gauges: poses, and the gauges that are read in each of them.

    Poses with their gauges are exchanged one by one by the plan's criterion. Then the joint angles are
    refined, and the gauges chosen anew. The certificate holds for all gauges in all poses examined.

    Args:
        plan: A plan for a tracker; its poses are among those that are tried.
        gauges: Number and accuracy of the gauges.
        feasibility: Checks of further poses, and of the motions between poses.
        rng: Source of random steps.

    Returns:
        The plan in the order of measuring; its certificate and its information are those of the gauges.

    Raises:
        BenchError: For more gauges than markers.
    """
    spec = plan.specification
    examined = plan.candidates
    criterion = plan.criterion
    problem = examined.problem
    search = _pose_search(spec, feasibility, rng)
    every = gauge_rows(spec, examined.q, examined.load_index, gauges, problem.lift)
    # poses with their gauges by exchange, then better joint angles with these gauges
    start, pose = _exchange_places(plan, gauges, every)
    load = examined.load_index[pose]
    q = _refine_places(plan, gauges, start, examined.q[pose], load, search)
    # the order of measuring, and other gauges where these are better now
    order = _measuring_order(q, load, feasibility)
    q, load = q[order], load[order]
    rows = gauge_rows(spec, q, load, gauges, problem.lift)
    chosen = _better_gauges(rows, problem, criterion, gauges, (start.marker[order], start.axis[order]))
    # the certificate over all gauges in all poses examined, those of the plan among them
    whole, relaxed = _gauge_bound(plan, gauges, np.concatenate([every, rows]), chosen)
    candidates = CandidateSet(np.vstack([examined.q, q]), np.r_[examined.load_index, load], whole)
    last = np.arange(len(candidates.q) - len(q), len(candidates.q))
    made = _assemble(search, criterion, candidates, last, relaxed)
    placed = collect_placed_gauges(spec, q, load, gauges, chosen)
    return Plan(specification=spec, gauges=placed, **vars(made))


def _exchange_places(plan: Plan, gauges: Gauges, every: Array) -> tuple[GaugePlan, Ids]:
    """Exchange poses with their gauges among the candidates of most information by the plan's tangent plane.

    Returns:
        The gauges, and the candidate of every pose, (poses,).
    """
    problem, criterion = plan.candidates.problem, plan.criterion
    start = place_gauges(every[plan.chosen_indices], problem, criterion, gauges)
    useful = most_informative_gauges(every, criterion.tangent(start.information).Z, gauges.count)[2]
    short = np.union1d(np.argsort(-useful, kind="stable")[:MAX_GAUGED_POSES], plan.chosen_indices)
    best = choose_poses_and_gauges(every[short], problem, criterion, gauges, plan.specification.n_poses)
    return best, short[best.pose_index]


def _refine_places(
    plan: Plan, gauges: Gauges, placed: GaugePlan, q: Array, load: Ids, search: PoseSearch
) -> Array:
    """Improve the joint angles of poses whose gauges and loads stay, (poses, n) [rad, m]."""
    problem = plan.candidates.problem

    def whitened_rows(trial: Array, places: Ids) -> Array:
        """Compute whitened rows of the gauges of a plan's poses at other joint angles.

        Args:
            trial: Joint angles, (trials, n) [rad, m].
            places: Index of the plan's pose whose gauges and load each trial has, (trials,).

        Returns:
            Whitened rows, (trials, gauges, r) [1].
        """
        touched = np.arange(len(trial))[:, None], placed.marker[places], placed.axis[places]
        return gauge_rows(plan.specification, trial, load[places], gauges, problem.lift)[touched]

    return refine_plan(q, problem.prior_information, plan.criterion, whitened_rows, search)


def _better_gauges(
    rows: Array, problem: DesignProblem, criterion: Criterion, gauges: Gauges, given: tuple[Ids, Ids]
) -> GaugePlan:
    """Choose the gauges of poses anew, unless the given markers and axes, (poses, count) each, are better."""
    marker, axis = given
    pose = np.arange(len(rows))
    kept = add_information(problem.prior_information, rows[pose[:, None], marker, axis])
    plans = GaugePlan(pose, marker, axis, kept), place_gauges(rows, problem, criterion, gauges)
    return max(plans, key=lambda gauge_plan: criterion.phi(gauge_plan.information))


def _gauge_bound(
    plan: Plan, gauges: Gauges, every: Array, chosen: GaugePlan
) -> tuple[DesignProblem, RelaxedDesign]:
    """Bound all plans of gauges in the poses examined, of which those of the plan are the last.

    Every pose has the gauges with the most information by a tangent plane near the optimum.
    """
    problem = plan.candidates.problem
    criterion = plan.criterion
    poses = plan.specification.n_poses
    Z = criterion.tangent(chosen.information).Z
    last = every[-len(chosen.marker) :]
    of_plan = last[np.arange(len(last))[:, None], chosen.marker, chosen.axis]
    for _ in range(GAUGE_BOUND_ROUNDS):
        marker, axis, _ = most_informative_gauges(every, Z, gauges.count)
        rows = every[np.arange(len(every))[:, None], marker, axis]
        rows[-len(last) :] = of_plan
        whole = replace(problem, rows=rows)
        relaxed = solve_relaxed_design(whole, criterion, poses)
        Z = relaxed.dual
    most = most_informative_gauges(every, Z, gauges.count)[2].max()
    return whole, replace(relaxed, bound=float((Z * problem.prior_information).sum() + poses * most))


def choose_poses(search: PoseSearch, criterion: Criterion, candidates: CandidateSet) -> ChosenPoses:
    """Find the best poses by a criterion, certified against all poses examined.

    Args:
        search: Whitened rows and number of poses, joint limits and feasibility.
        criterion: Information function Phi.
        candidates: Candidates to choose from and to improve.

    Returns:
        The plan in the order of measuring; its candidates include the improved ones.
    """
    # relaxed optimum; its heaviest poses, improved locally, join the candidates
    relaxed = solve_relaxed_design(candidates.problem, criterion, search.n_poses)
    for _ in range(IMPROVEMENT_ROUNDS):
        candidates = _improve_heaviest(search, candidates, relaxed)
        relaxed = solve_relaxed_design(candidates.problem, criterion, search.n_poses, relaxed)
    # whole poses by exchange, then a local search in their joint angles
    chosen = select_poses(candidates.problem, criterion, search.n_poses, relaxed, search.rng)
    load = candidates.load_index[chosen]

    q = refine_plan(
        candidates.q[chosen],
        candidates.problem.prior_information,
        criterion,
        lambda trial, places: search.whitened_rows(trial, load[places], candidates.problem.lift),
        search,
    )
    # the order of measuring, and the bound over all poses examined, those of the plan among them
    order = _measuring_order(q, load, search.feasibility)
    extended = _add_candidates(search, candidates, q[order], load[order])
    chosen = np.arange(len(extended.q) - search.n_poses, len(extended.q))
    last = solve_relaxed_design(extended.problem, criterion, search.n_poses, relaxed)
    return _assemble(search, criterion, extended, chosen, last)


def choose_greedily(
    search: PoseSearch, criterion: Criterion, candidates: CandidateSet, min_per_kind: int = 0
) -> ChosenPoses:
    """Choose poses one by one, each the best next candidate: fast for many unknowns, with a loose bound.

    Args:
        search: Number of poses, and checks of the motions between poses.
        criterion: Information function Phi.
        candidates: Candidates; of absolute readings their kinds are in place of loads.
        min_per_kind: Fewest poses of every kind; these are chosen first.

    Returns:
        The plan in the order of measuring, with the bound of the tangent plane at the plan itself.
    """
    problem, poses = candidates.problem, search.n_poses
    chosen, rest = np.zeros(0, dtype=int), problem
    # the fewest of every kind, then the best next ones of all
    for kind in np.unique(candidates.load_index) if min_per_kind else ():
        own = np.flatnonzero(candidates.load_index == kind)
        chosen = np.r_[chosen, own[greedy_plan(rest, criterion, problem.rows[own], min_per_kind)]]
        rest = replace(problem, prior_information=information(problem, chosen))
    chosen = np.r_[chosen, greedy_plan(rest, criterion, problem.rows, poses - len(chosen))]
    chosen = chosen[_measuring_order(candidates.q[chosen], candidates.load_index[chosen], search.feasibility)]
    M = information(problem, chosen)
    Z = criterion.tangent(M).Z
    bound = float((Z * problem.prior_information).sum() + poses * sensitivity(problem.rows, Z).max())
    return _assemble(search, criterion, candidates, chosen, RelaxedDesign(chosen, np.ones(poses), bound, Z))


def _assemble(
    search: PoseSearch, criterion: Criterion, examined: CandidateSet, chosen: Ids, relaxed: RelaxedDesign
) -> ChosenPoses:
    """Assemble a plan from some of the poses examined, which are in the order of measuring."""
    q = examined.q[chosen]
    return ChosenPoses(
        criterion=criterion,
        q=q,
        load_index=examined.load_index[chosen],
        clear_paths=tuple(search.feasibility.path_is_clear(start, end) for start, end in pairwise(q)),
        candidates=examined,
        chosen_indices=chosen,
        criterion_value=criterion.phi(information(examined.problem, chosen)),
        relaxed_design=relaxed,
    )


def _improve_heaviest(search: PoseSearch, examined: CandidateSet, relaxed: RelaxedDesign) -> CandidateSet:
    """Improve the poses that carry most weight of the relaxed optimum, and add them as candidates."""
    top = relaxed.support[np.argsort(-relaxed.weights, kind="stable")[:IMPROVED_POSES]]
    load = examined.load_index[top]
    # with Z = root root^T the sensitivity <Z, F^T F> is the sum of squares of F root
    values, V = np.linalg.eigh(relaxed.dual)
    basis = examined.problem.lift @ (V * np.sqrt(np.maximum(values, 0)))

    def usefulness(q: Array) -> Array:
        rows = search.whitened_rows(q, np.resize(load, len(q)), basis)
        return np.asarray(np.square(rows).sum(axis=(1, 2)))

    return _add_candidates(search, examined, improve_single_poses(examined.q[top], usefulness, search), load)


def _add_candidates(search: PoseSearch, examined: CandidateSet, q: Array, load: Ids) -> CandidateSet:
    """Add candidates; directions that only they show are left out."""
    rows = search.whitened_rows(q, load, None) @ examined.problem.lift
    problem = replace(examined.problem, rows=np.concatenate([examined.problem.rows, rows]))
    return CandidateSet(np.vstack([examined.q, q]), np.r_[examined.load_index, load], problem)


def _measuring_order(q: Array, load: Ids, feasibility: Feasibility) -> Ids:
    """Order the poses: one load after the other, each on the shortest way through its poses, (poses,)."""
    order: list[int] = []
    for kind in np.unique(load):
        poses = q[load == kind]
        path = shortest_path(joint_travel(poses), partial(_collision_detour, feasibility, poses))
        order += np.flatnonzero(load == kind)[path].tolist()
    return np.array(order)


def _collision_detour(feasibility: Feasibility, poses: Array, a: int, b: int) -> float:
    """Return the surcharge on the motion from pose a to pose b: not 0 if it would collide."""
    return 0.0 if feasibility.path_is_clear(poses[a], poses[b]) else COLLISION_SURCHARGE


def forecast_errors(plan: ChosenPoses, rows: Array) -> Forecast:
    """Forecast the errors of predictions after the poses of a plan were measured and the model identified.

    Args:
        plan: The plan.
        rows: Predicted deflections of m targets per unit of x, such as `task_rows`, (poses, 3 m, n) [m].
    """
    return forecast(plan.candidates.problem, plan.information, rows)


# --- Baselines of a plan ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Observability:
    """Hold the observability indices O1 to O5 of a plan, from the singular values s of its whitened rows.

    The unknowns are in units of the prior, so that s has no unit. All indices are zero if the plan does not
    observe a direction that the candidates can observe.
    """

    o1: float  #: (product of s)^(1/r) / sqrt(poses): volume [1].
    o2: float  #: s_min / s_max: inverse condition number [1].
    o3: float  #: s_min: noise amplification of the worst direction [1].
    o4: float  #: s_min^2 / s_max: noise amplification index [1].
    o5: float  #: 1 / sum(1 / s): harmonic mean of s over r [1].
    seen: int  #: Number of directions that the plan observes.
    of: int  #: Number r of directions that the candidates can observe.


def observability(problem: DesignProblem, chosen: Ids) -> Observability:
    """Compute the observability indices O1 to O5 of a plan.

    Mathematics: `pose-13`.

    Args:
        problem: Candidates.
        chosen: Indices of the candidates in the plan, (poses,).
    """
    s = np.linalg.svd(problem.rows[chosen].reshape(-1, problem.n_directions), compute_uv=False)
    seen = int((s > RANK_TOLERANCE * s[0]).sum())
    if seen < problem.n_directions:
        return Observability(0.0, 0.0, 0.0, 0.0, 0.0, seen, problem.n_directions)
    return Observability(
        o1=float(np.exp(np.log(s).mean()) / np.sqrt(len(chosen))),
        o2=float(s[-1] / s[0]),
        o3=float(s[-1]),
        o4=float(s[-1] ** 2 / s[0]),
        o5=float(1 / (1 / s).sum()),
        seen=seen,
        of=problem.n_directions,
    )


N_RANDOM_PLANS = 200  #: Number of random plans of every number of poses that a plan is compared with.
BASELINE_POSE_COUNTS = (4, 6, 8, 12, 16, 20, 30, 40)  #: Numbers of poses of greedy and random plans.


@dataclass(frozen=True)
class Baselines:
    """Hold RMS prediction errors at the tasks after greedy and random plans from the candidates of a plan.

    Without a prior an error is infinite if a plan does not observe all directions that the candidates can.
    """

    greedy_errors: Array  #: RMS errors after greedy plans of 1, 2, ... poses, (largest number,) [m].
    #: RMS errors after `N_RANDOM_PLANS` random plans, (N_RANDOM_PLANS,) [m], by number of poses.
    random_errors: dict[int, Array]


@dataclass(frozen=True)
class PriorInfluence:
    """Hold how much of a plan's forecast rests on the prior instead of its readings."""

    #: Number of directions of x that the readings of the plan determine better than the prior does.
    directions_from_readings: int
    #: Share of the mean square prediction error at the tasks that comes from the prior, not from noise [1].
    prior_share: float
    #: Mean square prediction error at the tasks in directions that no candidate observes [m^2].
    unobservable_mean_square: float


def prior_influence(plan: Plan, rows: Array) -> PriorInfluence:
    """Compute how much of a plan's forecast rests on the prior.

    The information M is that of the prior plus that of the readings. The covariance M^-1 of the error is a
    part from noise plus M^-1 prior M^-1, the part from the prior.

    Args:
        plan: The plan.
        rows: Predicted deflections at the tasks per unit of x, (tasks, 3 m, n) [m].
    """
    problem, M = plan.candidates.problem, plan.information
    I = np.linalg.inv(M)  # noqa: E741 - used on both sides
    W, hidden = mean_square_weight(rows @ problem.lift), unobservable_mean_square(problem, rows)
    left_open = hidden + float(np.trace(W @ I @ problem.prior_information @ I))
    # readings over the prior, direction by direction: generalised eigenvalues above one outweigh it
    half = np.linalg.inv(np.linalg.cholesky(problem.prior_information))
    against = np.linalg.eigvalsh(half @ (M - problem.prior_information) @ half.T)
    return PriorInfluence(
        directions_from_readings=int((against > 1).sum()),
        prior_share=left_open / (hidden + float(np.trace(W @ I))),
        unobservable_mean_square=hidden,
    )


def baselines(plan: Plan, rows: Array, *, n_random_candidates: int, rng: np.random.Generator) -> Baselines:
    """Compute RMS prediction errors at the tasks after greedy and random plans from a plan's candidates.

    Args:
        plan: The plan, with its candidates.
        rows: Predicted deflections at the tasks per unit of x, (tasks, 3 m, n) [m].
        n_random_candidates: Number of candidates, the first ones, that were drawn at random and not improved;
            random plans use these.
        rng: Source of the random plans.
    """
    spec, problem = plan.specification, plan.candidates.problem
    error = prediction_error_function(problem, rows)

    def rms_errors(plans: Iterable[Ids]) -> Array:
        whole = spec.prior_uncertainty is not None
        return np.array(
            [
                error(p) if whole or observability(problem, p).seen == problem.n_directions else np.inf
                for p in plans
            ]
        )

    counts = sorted({*BASELINE_POSE_COUNTS, spec.n_poses})
    order = greedy_plan(problem, plan.criterion, problem.rows, counts[-1])
    return Baselines(
        greedy_errors=rms_errors(order[: k + 1] for k in range(len(order))),
        random_errors={
            count: rms_errors(
                [
                    rng.choice(n_random_candidates, count, replace=n_random_candidates < count)
                    for _ in range(N_RANDOM_PLANS)
                ]
            )
            for count in stepwise(counts, "drawing random plans")
        },
    )


def prediction_error_function(problem: DesignProblem, rows: Array) -> Callable[[Ids], float]:
    """Make a function that computes the RMS error of some predictions after any plan of candidates.

    Args:
        problem: Candidates.
        rows: Predicted deflections of m targets per unit of x, (poses, 3 m, n) [m].

    Returns:
        Function of the indices of a plan's candidates, (poses,), to the RMS error of a target [m].
    """
    hidden, W = unobservable_mean_square(problem, rows), mean_square_weight(rows @ problem.lift)
    return lambda plan: math.sqrt(hidden + float((np.linalg.inv(information(problem, plan)) * W).sum()))


def unobservable_mean_square(problem: DesignProblem, rows: Array) -> float:
    """Compute the mean square prediction error in directions of x that no candidate observes.

    Args:
        problem: Candidates.
        rows: Predicted deflections of m targets per unit of x, (poses, 3 m, n) [m].

    Returns:
        Mean square error of a target, 0 or more [m^2].
    """
    return max(0.0, float(np.trace(mean_square_weight(rows) @ problem.remaining_covariance)))
