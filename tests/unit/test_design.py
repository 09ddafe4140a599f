"""Optimal design against textbook optima, brute force and the definitions."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from testbench.design.criteria import (
    DeterminantCriterion,
    LinearCriterion,
    candidate_gains,
    criterion_by_name,
    criterion_e,
    criterion_g,
    mean_square_weight,
    update_gains,
)
from testbench.design.exchange import (
    Feasibility,
    Gauges,
    PoseSearch,
    choose_poses_and_gauges,
    exchange_poses,
    greedy_plan,
    improve_single_poses,
    place_gauges,
    refine_plan,
    sensitivity,
    solve_relaxed_design,
)
from testbench.design.forecast import forecast
from testbench.design.planning import (
    CandidateSet,
    choose_greedily,
    joint_travel,
    observability,
    prior_influence,
    round_trip,
    shortest_path,
)
from testbench.design.rows import CANDIDATES_PER_BLOCK, DesignProblem, information
from testbench.errors import BenchError

R, K = 5, 2
A_OPTIMAL = LinearCriterion(np.eye(R) / R)


def rng(seed=0):
    return np.random.default_rng(seed)


def random_problem(candidates=40, seed=0, prior=0.1):
    rows = rng(seed).normal(size=(candidates, K, R))
    return DesignProblem(rows, prior * np.eye(R), np.eye(R), np.zeros((R, R)), np.zeros((R, 0)))


def criteria():
    W = mean_square_weight(rng(5).normal(size=(4, 3, R)))
    worst = criterion_g(rng(6).normal(size=(7, 3, R)))
    return [DeterminantCriterion(), A_OPTIMAL, criterion_e(), worst, LinearCriterion(W)]


def parabola():
    x = np.linspace(-1, 1, 201)
    rows = np.stack([np.ones_like(x), x, x**2], axis=1)[:, None]
    return x, DesignProblem(rows, 1e-12 * np.eye(3), np.eye(3), np.zeros((3, 3)), np.zeros((3, 0)))


@pytest.mark.parametrize(
    ("criterion", "weights"),
    [
        (DeterminantCriterion(), (1 / 3, 1 / 3, 1 / 3)),
        (LinearCriterion(np.eye(3) / 3), (1 / 4, 1 / 2, 1 / 4)),
    ],
    ids=["D", "A"],
)
def test_relaxed_design_of_a_parabola_is_the_textbook_one(criterion, weights):
    # Kiefer and Wolfowitz: quadratic regression on [-1, 1] wants -1, 0 and 1 alone
    x, problem = parabola()
    relaxed = solve_relaxed_design(problem, criterion, 1)
    mass = [relaxed.weights[np.abs(x[relaxed.support] - at) < 0.06].sum() for at in (-1, 0, 1)]
    np.testing.assert_allclose(mass, weights, atol=0.03)
    rows = problem.rows[relaxed.support]
    M = problem.prior_information + np.einsum("p,pkr,pks->rs", relaxed.weights, rows, rows)
    assert relaxed.bound <= 1.002 * criterion.phi(M)


def by_trying_everything(problem, criterion, plan, poses):
    """The best candidate in every place of a plan, again and again."""
    every, plan = range(len(problem.rows)), list(plan)

    def phi(chosen):
        return criterion.phi(information(problem, chosen))

    before = 0.0
    while phi(plan) > (1 + 1e-7) * before:
        before = phi(plan)
        for k in range(poses):
            best = max(every, key=lambda j: phi([*plan[:k], j, *plan[k + 1 :]]))
            if phi([*plan[:k], best, *plan[k + 1 :]]) > (1 + 1e-7) * phi(plan):
                plan[k] = best
    return plan


@pytest.mark.parametrize("prior", [0.1, 1e-9], ids=["prior", "next to none"])
@pytest.mark.parametrize("criterion", criteria(), ids="DAEGI")
def test_bounds_and_updates_exchange_what_trying_everything_does(criterion, prior):
    for seed in range(2):
        problem, start = random_problem(50, seed, prior), rng(seed).integers(0, 50, 6)
        found = exchange_poses(problem, criterion, problem.rows, start)
        assert found.tolist() == by_trying_everything(problem, criterion, start, 6)


@pytest.mark.parametrize(
    ("criterion", "prior"),
    [(DeterminantCriterion(), 1e-9), *itertools.product([criteria()[k] for k in (0, 1, 4)], [0.1, 1e-4])],
)
def test_greedy_takes_the_best_next_one(criterion, prior):
    problem, plan = random_problem(50, 7, prior), []
    for best in greedy_plan(problem, criterion, problem.rows, 12):
        phi = [criterion.phi(information(problem, [*plan, j])) for j in range(50)]
        assert phi[best] == pytest.approx(max(phi), rel=1e-9)
        plan.append(best)


@pytest.mark.parametrize("prior", [0.1, 1e-9], ids=["prior", "next to none"])
def test_gains_that_follow_the_information_are_those_computed_from_it(prior):
    """Poses are added one by one, exchanged for others, and removed down to the last three."""
    problem, W, (first, second) = (
        random_problem(30, 3, prior),
        criteria()[4].W,
        rng(1).integers(0, 30, (2, 8)),
    )
    gains, plan, one = candidate_gains(problem.prior_information, problem.rows, W), [], np.ones(K)
    steps = [*(([j], []) for j in first), *(([j], [i]) for i, j in zip(first, second, strict=True))]
    for added, removed in [*steps, *(([], [j]) for j in second[:5])]:
        plan = [*plan, *added]
        for j in removed:
            plan.remove(j)
        rows = np.concatenate([np.zeros((0, R)), *problem.rows[added], *problem.rows[removed]])
        M = information(problem, plan)
        gains = update_gains(gains, M, rows, np.r_[np.tile(one, len(added)), np.tile(-one, len(removed))])
        if len(plan) >= 3:  # fewer do not show all directions: rounding of the direct sum shows
            left = [np.trace(W @ np.linalg.inv(M + F.T @ F)) for F in problem.rows]
            np.testing.assert_allclose(gains.phi_with_candidate(), 1 / np.array(left), rtol=1e-8)


def test_candidates_in_several_blocks_are_judged_as_each_alone():
    rng = np.random.default_rng(1)
    rows, root = rng.standard_normal((2 * CANDIDATES_PER_BLOCK + 5, 2, 4)), rng.standard_normal((4, 4))
    M, W = np.eye(4) + root.T @ root, np.diag([1.0, 2.0, 3.0, 4.0])
    cost = np.trace(np.linalg.solve(M, W))
    gains = [cost - np.trace(np.linalg.solve(M + F.T @ F, W)) for F in rows]
    assert candidate_gains(M, rows, W).cost_reductions() == pytest.approx(
        np.array(gains), rel=1e-9
    )  # rounding
    assert sensitivity(rows, W) == pytest.approx(np.array([np.trace(W @ F.T @ F) for F in rows]), rel=1e-12)


def test_forecast_is_the_spread_of_least_squares():
    problem, targets = random_problem(8, prior=1e-9), rng(4).normal(size=(6, 3, R))
    A = problem.rows.reshape(-1, R)
    M = information(problem, range(8))
    promised = forecast(problem, M, targets)
    noise = rng(5).normal(size=(4000, len(A)))
    errors = np.einsum("pkr,nr->npk", targets, noise @ np.linalg.pinv(A).T)
    square = np.square(errors).sum(axis=2)
    np.testing.assert_allclose(promised.rms_error, np.sqrt(square.mean(axis=0)), rtol=0.05)
    assert promised.overall_rms_error == pytest.approx(np.sqrt(square.mean()), rel=0.04)
    whole = np.sqrt(square.mean(axis=1))
    ends = promised.overall_percentile_5, promised.overall_percentile_95
    np.testing.assert_allclose(ends, np.percentile(whole, [5, 95]), rtol=0.08)
    low, high = np.percentile(np.sqrt(square), [5, 95], axis=0)
    np.testing.assert_allclose(promised.percentile_5, low, rtol=0.15)
    np.testing.assert_allclose(promised.percentile_95, high, rtol=0.08)


def test_observability_indices_are_those_of_the_definitions():
    problem, plan = random_problem(), np.array([3, 5, 8, 13])
    s = np.linalg.svd(problem.rows[plan].reshape(-1, R))[1]
    found = observability(problem, plan)
    assert (found.seen, found.of) == (R, R)
    by_hand = [np.prod(s) ** (1 / R) / 2, s.min() / s.max(), s.min(), s.min() ** 2 / s.max(), 1 / sum(1 / s)]
    np.testing.assert_allclose((found.o1, found.o2, found.o3, found.o4, found.o5), by_hand)
    little = observability(problem, np.array([0, 0]))
    assert (little.seen, little.o1, little.o3) == (K, 0, 0)


def held_karp(cost):
    """Length of the shortest way through all places, by dynamic programming over sets of places."""
    n = len(cost)
    best = {(1 << k, k): 0.0 for k in range(n)}
    for size in range(2, n + 1):
        for places in itertools.combinations(range(n), size):
            all_of = sum(1 << k for k in places)
            for k in places:
                best[all_of, k] = min(best[all_of ^ (1 << k), i] + cost[i, k] for i in places if i != k)
    return min(best[2**n - 1, k] for k in range(n))


@pytest.mark.parametrize("seed", range(5))
def test_shortest_path_is_that_of_held_and_karp_though_few_legs_were_asked_what_they_cost(seed):
    q = rng(seed).uniform(-3, 3, (10, 6))
    travel = joint_travel(q)
    np.testing.assert_allclose(travel, np.abs(q[:, None] - q[None]).max(axis=2))  # the slowest joint's
    blocked = np.triu(rng(seed + 50).random((10, 10)) < 0.4, 1)
    blocked |= blocked.T
    asked = []

    def surcharge(a, b):
        asked.append((a, b))
        return 4.0 * blocked[a, b]

    path = shortest_path(travel, surcharge)
    cost = travel + 4.0 * blocked
    assert sorted(path) == list(range(10))
    assert cost[path[:-1], path[1:]].sum() == pytest.approx(held_karp(cost))
    assert len(set(asked)) == len(asked) < 45


def test_equal_places_are_one_stop():
    cost = joint_travel(np.repeat(rng(1).uniform(-3, 3, (9, 6)), 4, axis=0)[rng(2).permutation(36)])
    path = shortest_path(cost)
    assert sorted(path) == list(range(36))
    assert (cost[path[:-1], path[1:]] > 0).sum() == 8


def test_round_trip_goes_around_and_not_across():
    angle = rng(2).permutation(20) * 2 * np.pi / 20
    points = np.column_stack([np.cos(angle), np.sin(angle)])
    cost = np.linalg.norm(points[:, None] - points[None], axis=2)
    trip = round_trip(cost)
    legs = cost[trip, np.roll(trip, -1)]
    np.testing.assert_allclose(legs, 2 * np.sin(np.pi / 20))


LIMITS = np.array([[-3.0], [3.0]])


def circle_rows(q, _k=0):
    """Rows that see the direction of an angle: the best pair is at right angles."""
    return np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])], axis=1)[:, None]


def near(feasible):
    return PoseSearch(circle_rows, 2, LIMITS, Feasibility(feasible), rng(0))


def test_refinement_turns_a_pair_to_right_angles():
    start, anywhere = np.array([[0.0], [0.4]]), near(lambda q: np.ones(len(q), dtype=bool))
    q = refine_plan(start, 1e-6 * np.eye(2), DeterminantCriterion(), circle_rows, anywhere)
    assert abs(np.cos(q[1, 0] - q[0, 0])) < 0.05


def test_ascent_climbs_within_limits_and_feasible():
    start = np.array([[0.0], [2.5], [-1.0]])
    q = improve_single_poses(start, lambda q: 1 / (1 + (q[:, 0] - 1) ** 2), near(lambda q: q[:, 0] < 0.9))
    assert 0.7 < q[0, 0] < 0.9
    assert 0.7 < q[2, 0] < 0.9
    assert (q[1, 0] == 2.5) or (q[1, 0] < 0.9)  # an infeasible start stays or comes home


@pytest.mark.parametrize("name", ["I", "G", "test"])
def test_i_and_g_judge_the_workspace_and_the_test_criterion_the_tasks(name):
    """Against the mean square error of every pose, by the definition."""
    problem, M = random_problem(), information(random_problem(), range(8))
    workspace, tasks = rng(1).normal(size=(6, 6, R)), 3 * rng(2).normal(size=(4, 6, R))
    wanted = tasks if name == "test" else workspace
    cost = np.einsum("pkr,rs,pks->p", wanted, np.linalg.inv(M), wanted) / 2  # of two targets
    expected = cost.max() if name == "G" else cost.mean()
    for given in ((workspace, tasks), *([(workspace,)] if name != "test" else [])):
        assert criterion_by_name(name, problem, *given).phi(M) == pytest.approx(1 / expected)


def test_what_rests_on_the_prior_is_its_share_of_the_error_and_the_directions_that_it_holds():
    """The error of x is M^-1 (readings' noise) + M^-1 prior (what the prior leaves open): by hand."""
    prior, M, hidden = np.diag([4.0, 4.0, 4.0]), np.diag([16.0, 7.9, 5.0]), np.diag([0, 0, 0, 0.5])
    problem = DesignProblem(np.zeros((1, 1, 3)), prior, np.eye(4, 3), hidden, np.zeros((4, 0)))
    plan = SimpleNamespace(candidates=SimpleNamespace(problem=problem), information=M)
    rows = np.zeros((1, 3, 4))
    rows[0, 0, 0] = rows[0, 1, 2] = rows[0, 2, 3] = 1.0
    found = prior_influence(plan, rows)
    assert found.directions_from_readings == 1
    noise, kept = 12 / 16**2 + 1 / 5**2, 4 / 16**2 + 4 / 5**2
    assert found.unobservable_mean_square == pytest.approx(0.5)
    assert found.prior_share == pytest.approx((kept + 0.5) / (noise + kept + 0.5))


@pytest.mark.parametrize("criterion", criteria(), ids="DAEGI")
def test_the_bound_of_a_greedy_plan_is_that_of_its_tangent_above_every_plan(criterion):
    """Prior and readings alike in weight; the best of all plans of three of eight candidates, by trying."""
    problem = random_problem(8, 3, prior=4.0)
    anywhere = Feasibility(lambda q: np.ones(len(q), dtype=bool))
    search = PoseSearch(lambda _q, _k: problem.rows, 3, LIMITS, anywhere, rng(0))
    examined = CandidateSet(np.linspace(-2, 2, 8)[:, None], np.zeros(8, dtype=int), problem)
    found = choose_greedily(search, criterion, examined)
    every = [information(problem, plan) for plan in itertools.combinations_with_replacement(range(8), 3)]
    best = max(map(criterion.phi, every))
    assert best <= found.relaxed_design.bound * (1 + 1e-9)
    assert found.relaxed_design.bound == pytest.approx(
        max((found.relaxed_design.dual * M).sum() for M in every)
    )
    assert found.efficiency == pytest.approx(criterion.phi(found.information) / found.relaxed_design.bound)


GAUGES = Gauges(2, 5e-6, 0.01)


def gauge_problem(seed):
    """Rows of gauges at three markers in five poses, and a criterion."""
    rows = rng(seed).normal(size=(5, 3, 3, R))
    problem = DesignProblem(
        rows.reshape(5, 9, R), 0.1 * np.eye(R), np.eye(R), np.zeros((R, R)), np.zeros((R, 0))
    )
    return rows, problem


def phi_of(rows, problem, criterion, places):
    """Phi of gauges by pose, marker and axis."""
    A = np.array([rows[p, m, a] for p, m, a in places])
    return criterion.phi(problem.prior_information + A.T @ A)


@pytest.mark.parametrize("seed", range(3))
def test_no_other_gauges_in_one_pose_are_better_than_those_chosen(seed):
    rows, problem = gauge_problem(seed)
    found = place_gauges(rows, problem, A_OPTIMAL, GAUGES)
    chosen = [[(p, *own) for own in zip(found.marker[p], found.axis[p], strict=True)] for p in range(5)]
    own = phi_of(rows, problem, A_OPTIMAL, list(itertools.chain.from_iterable(chosen)))
    assert own == pytest.approx(A_OPTIMAL.phi(found.information))
    for p, (a, b) in itertools.product(range(5), itertools.combinations(range(3), 2)):
        for axes in itertools.product(range(3), repeat=2):
            others = [place for k, places in enumerate(chosen) if k != p for place in places]
            other = [*others, (p, a, axes[0]), (p, b, axes[1])]
            assert phi_of(rows, problem, A_OPTIMAL, other) <= own * (1 + 1e-5)


def test_places_chosen_together_with_their_gauges_beat_any_given_ones():
    rows, problem = gauge_problem(7)
    free = choose_poses_and_gauges(rows, problem, A_OPTIMAL, GAUGES, 3)
    for some in itertools.combinations(range(5), 3):
        given = place_gauges(rows[list(some)], problem, A_OPTIMAL, GAUGES)
        assert A_OPTIMAL.phi(given.information) <= A_OPTIMAL.phi(free.information) * 1.03
    with pytest.raises(BenchError, match="gauges: expected 1 to 3"):
        place_gauges(rows, problem, A_OPTIMAL, Gauges(4, 5e-6, 0.0))
