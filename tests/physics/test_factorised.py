"""GCO over b as the paper writes it: gradients, ranks, where local solves end, and the paper's search."""

import numpy as np
import pytest

from testbench.campaign.campaign import stream
from testbench.campaign.pose_campaign import FullPose, simulate
from testbench.errors import BenchError
from testbench.identify import gco, reduce
from testbench.identify.regression import f_m
from testbench.model.structure import free36, mgco69, mgco147, template56
from testbench.studies.estimators.factorised import (
    LocalSolves,
    cost,
    costs,
    descend,
    descents,
    factorise,
    order_range,
    parameters,
    random_start,
)
from testbench.studies.estimators.search import BOX, Budget, explore, trial_points

NOISE = {"sigma": 25e-6 / 2**0.5, "sigma_rotation": 250e-6 / 2**0.5}
SECTION_5_2 = FullPose(arm="arm_6r", least=9e-3, most=41e-3, **NOISE)
TINY = Budget(population=2, generations=3, trial_points=40, stage_one_points=10)


@pytest.fixture(scope="module")
def data(arm_6r):
    return simulate(arm_6r, SECTION_5_2, 1).identification


@pytest.fixture(scope="module")
def regression(arm_6r, data):
    return reduce(arm_6r.vjm, mgco69(arm_6r.arm), data)


@pytest.fixture(scope="module")
def best(arm_6r, data):
    return gco(arm_6r.vjm, mgco69(arm_6r.arm), data)


@pytest.mark.parametrize("m", [1, 3, 6])
def test_gradient_of_the_cost_is_its_finite_difference(regression, rng, m):
    problem = factorise(regression, m)
    b = random_start(problem, rng)
    _, gradient = cost(problem, b)
    h = 1e-5
    steps = h * np.eye(problem.size)
    numeric = [(cost(problem, b + step)[0] - cost(problem, b - step)[0]) / (2 * h) for step in steps]
    # truncation h^2 and rounding 1e-16 F_M / h, both about 1e-10 of the gradient
    np.testing.assert_allclose(gradient, numeric, rtol=0, atol=1e-7 * np.abs(gradient).max())


@pytest.mark.parametrize("structure", [mgco69, mgco147, template56])
def test_costs_of_a_population_are_the_cost_of_each_and_f_m_of_its_parameters(arm_6r, data, rng, structure):
    problem = factorise(reduce(arm_6r.vjm, structure(arm_6r.arm), data), 4)
    population = rng.uniform(-1, 1, (problem.size, 70))  # more than one block of points
    each = [cost(problem, b)[0] for b in population.T]
    by_parameters = [f_m(problem.regression, parameters(problem, b)) for b in population.T]
    np.testing.assert_allclose(costs(problem, population), each, rtol=1e-12)
    np.testing.assert_allclose(by_parameters, each, rtol=1e-12)


@pytest.mark.parametrize("m", [1, 3, 6])
def test_parameters_are_gramians_of_at_most_rank_m(regression, rng, m):
    problem = factorise(regression, m)
    C = regression.structure.matrix(parameters(problem, random_start(problem, rng)))
    for block in regression.structure.blocks:
        part = C[np.ix_(block, block)]
        unit = np.sqrt(np.diag(part))
        values = np.linalg.eigvalsh(part / np.outer(unit, unit))
        assert values[0] > -1e-12  # rounding of a matrix of unit diagonal
        assert (values > 1e-9).sum() == min(m, len(block))


def test_a_local_solve_of_full_order_reaches_the_conic_optimum(best):
    problem = factorise(best.regression)
    value = descend(problem, random_start(problem, stream(1))).f_m
    # solves end where a step gains less than 1e-12; in flat valleys that leaves up to some 1e-6
    assert value == pytest.approx(best.f_m, rel=1e-5)


def test_what_cannot_be_searched_is_refused(arm_6r, data):
    for m in (0, 7):
        with pytest.raises(BenchError, match=f"m: expected an order of the vector space of 1 to 6, got {m}"):
            LocalSolves(stream(1), m)(arm_6r.vjm, mgco69(arm_6r.arm), data)
    with pytest.raises(BenchError, match="starts: expected at least 1 local solve, got 0"):
        LocalSolves(stream(1), starts=0)(arm_6r.vjm, mgco69(arm_6r.arm), data)
    with pytest.raises(BenchError, match="expected a symmetric structure"):
        factorise(reduce(arm_6r.vjm, free36(arm_6r.arm), data))
    for numbers in ({"population": 0}, {"trial_points": 100}):
        with pytest.raises(BenchError, match="expected numbers of at least 1, stage one within"):
            Budget(**numbers)


def test_the_papers_search_ends_at_the_conic_optimum_and_f_m_falls_until_there(best):
    """By the same random numbers at the same place; local solves are seen to fall too."""
    problem, seen, of_several = factorise(best.regression), [], []
    one, two = (explore(problem, TINY, stream(1), observe=to) for to in (seen.append, lambda _: None))
    np.testing.assert_array_equal(one.best, two.best)
    assert one.f_m == pytest.approx(best.f_m, rel=1e-5)
    solves = descents(factorise(best.regression, 3), stream(4), starts=3, observe=of_several.append)
    for values, end in ((seen, one.f_m), (of_several, min(d.f_m for d in solves))):
        assert len(values) > 10
        assert (np.diff(values) < 0).all()
        assert values[-1] == pytest.approx(end, rel=1e-12)


def test_order_of_the_vector_space_by_counting_is_that_of_eq_20(arm_6r):
    # n = 6; 108 runs: seven links bound m by 6 * 108 / (6 * 7), three by 6 * 108 / (6 * 3)
    assert order_range(mgco147(arm_6r.arm), 108) == (3.5, pytest.approx(108 / 7))
    assert order_range(mgco69(arm_6r.arm), 108) == (3.5, 36.0)
    assert order_range(template56(arm_6r.arm), 108) == (1.5, pytest.approx(648 / (2 * 14)))


def test_trial_points_lie_inside_the_box_and_differ(regression):
    problem = factorise(regression)
    points = trial_points(problem, np.zeros(problem.size), 700, stream(3))
    assert points.shape == (700, problem.size)
    assert np.abs(points).max() <= BOX
    assert len(np.unique(points, axis=0)) == 700
    assert not np.isin(points, trial_points(problem, np.zeros(problem.size), 700, stream(4))).all()
    from_outside = trial_points(problem, np.full(problem.size, 2 * BOX), 100, stream(3))
    assert np.abs(from_outside).max() <= BOX
