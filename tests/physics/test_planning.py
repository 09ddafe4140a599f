"""Plans of the KR 500: what their rows say against the library, feasibility, certificate, kept promises."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import wishart

from testbench.arm.mjcf import GRAVITY
from testbench.campaign import predicted_error
from testbench.campaign.campaign import Scenario, hanging, measure, stream
from testbench.campaign.open_laws import open_laws
from testbench.data.dataset import Dataset
from testbench.design.criteria import CRITERIA
from testbench.design.forecast import forecast
from testbench.design.planning import DETOUR, _order, candidate_set, make_plan, promise
from testbench.design.refine import Reach
from testbench.design.rows import (
    Experiment,
    Specification,
    Tasks,
    build_problem,
    deflection_rows,
    information,
    problem_of,
    reading_rows,
    task_rows,
)
from testbench.design.whole_arm import fit_of, promise_on
from testbench.errors import BenchError
from testbench.identify import least_squares, reduce, with_prior
from testbench.identify.evaluate import deflections
from testbench.identify.metric import metric, precision_root, whitened
from testbench.identify.prior import Strength, cad_prior
from testbench.model.load import Load
from testbench.model.poses import WorkArea, random_poses
from testbench.model.structure import all153, joints_only, mgco68, template56
from testbench.plant.site import collisions

AREA = WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0))


def clear(kr500, q):
    return np.array([pair is None for pair in collisions(kr500.room, q)], dtype=bool)


@pytest.fixture(scope="module")
def poses(kr500):
    return random_poses(kr500.vjm, AREA, 260, lambda q: clear(kr500, q), stream(3))


@pytest.fixture(scope="module")
def spec(kr500, poses):
    own = metric(cad_prior(kr500.arm), kr500.vjm, mgco68(kr500.arm))
    load = Load(np.array([0, 0, -460.3 * GRAVITY, 0, 0, 0]), kr500.vjm.load)
    return Specification(
        experiment=Experiment(kr500.vjm, own, kr500.vjm.markers, 50e-6),
        loads=(load,),
        tasks=Tasks(poses[200:210], load),
        workspace=poses[210:],
        uncertainty=0.3,
        poses=9,
    )


@pytest.fixture(scope="module")
def plan(kr500, spec, poses):
    return make_plan(spec, "test", poses[:200], Reach(lambda q: clear(kr500, q)), stream(1))


def promise_of(spec, q, load):
    """Errors to expect at the tasks after any poses were measured, such as those of a plan made by hand."""
    problem = problem_of(spec, q, load)
    return forecast(problem, information(problem, np.arange(len(q))), task_rows(spec))


def blank(kr500, q, load):
    """A dataset of runs not read yet."""
    runs, ids = len(q), np.arange(len(q))
    zero = np.zeros((runs, 3, 3))
    wrench, point = np.tile(load.wrench, (runs, 1)), np.tile(load.point, (runs, 1))
    return Dataset(kr500.arm.markers, ids, ids, q, wrench, point, zero, zero, 50e-6)


def test_information_is_that_of_the_reduced_regression(kr500, spec, poses):
    q, load = poses[:7], spec.loads[0]
    rows = reading_rows(spec.experiment, q, load).reshape(-1, 68)
    A, _ = whitened(reduce(kr500.vjm, mgco68(kr500.arm), blank(kr500, q, load)), spec.experiment.metric)
    np.testing.assert_allclose(rows.T @ rows, A.T @ A, atol=1e-9 * np.abs(A.T @ A).max())


def test_a_plan_names_the_laws_of_joints_that_its_readings_leave_open(kr500, spec, poses):
    """Fewer with a lighter load beside; of exact readings in many poses joint 1's, which nothing turns."""
    prior, heavy = cad_prior(kr500.arm), spec.loads[0]
    light = Load(heavy.wrench / 3, heavy.point)
    own = metric(prior, kr500.vjm, all153(kr500.arm))
    whole = replace(spec, experiment=replace(spec.experiment, metric=own), loads=(heavy, light))

    def left(poses, loads, spec=whole):
        q, load = np.tile(poses, (loads, 1)), np.repeat(np.arange(loads), len(poses))
        found = open_laws(SimpleNamespace(specification=spec, q=q, load=load), prior)
        return {law.kind: law for law in found}

    one, two = (left(poses[:11], loads) for loads in (1, 2))
    assert {"stiffening", "backlash", "friction"} == set(one)
    assert sum(len(law.joints) for law in two.values()) < sum(len(law.joints) for law in one.values())
    friction = one["friction"]
    assert "`loading` off" in friction.by
    assert "joint_3" in friction.told
    assert set(friction.told) | set(friction.never) <= set(friction.joints)
    assert not set(friction.told) & set(friction.never)
    exact = replace(whole, experiment=replace(whole.experiment, sigma=1e-9))
    every = left(poses, 2, exact)
    assert {kind: law.joints for kind, law in every.items()} == {kind: ["joint_1"] for kind in one}
    assert all(law.by.startswith("a pull") and law.told == ["joint_1"] for law in every.values())
    assert left(poses[:11], 1, replace(whole, uncertainty=None)) == left(poses[:11], 1, spec) == {}


def test_prediction_variance_in_seen_coordinates_is_that_of_all_unknowns(spec, poses):
    """A side force asks for directions that gravity does not show: the prior's part must come in whole."""
    rows = reading_rows(spec.experiment, poses, spec.loads[0])
    problem = build_problem(spec.experiment, rows, 0.3)
    assert problem.r == 49
    assert build_problem(spec.experiment, rows, None).unseen.shape == (68, 19)
    chosen = np.arange(9)
    side = Load(np.array([0, 3000.0, 0, 0, 0, 0]), spec.loads[0].point)
    wanted = deflection_rows(spec.experiment, poses[200:203], side)
    B, _ = precision_root(spec.experiment.metric, Strength(0.3, 10.0))
    A = rows[chosen].reshape(-1, 68)
    whole = np.linalg.inv(B.T @ B + A.T @ A)
    inside = problem.lift @ np.linalg.solve(information(problem, chosen), problem.lift.T) + problem.hidden
    by_hand, ours = (np.einsum("pkn,nl,pkl->p", wanted, C, wanted) for C in (whole, inside))
    np.testing.assert_allclose(ours, by_hand, rtol=1e-6)


def test_plan_is_feasible_certified_and_better_than_chance(kr500, spec, plan, poses):
    assert plan.q.shape == (9, 6)
    assert clear(kr500, plan.q).all()
    lower, upper = kr500.arm.limits
    assert ((plan.q >= lower) & (plan.q <= upper)).all()
    assert 0.7 < plan.efficiency <= 1
    np.testing.assert_array_equal(plan.examined.q[plan.chosen], plan.q)
    chance = [promise_of(spec, poses[k * 9 : k * 9 + 9], np.zeros(9, dtype=int)).overall for k in range(20)]
    assert promise(plan, task_rows(spec)).overall < min(chance)


@pytest.mark.parametrize("name", CRITERIA)
def test_every_criterion_makes_a_plan_with_a_certificate(kr500, spec, poses, name):
    few = replace(spec, poses=4)
    found = make_plan(few, name, poses[:25], Reach(lambda q: clear(kr500, q)), stream(1))
    assert 0 < found.efficiency <= 1


def test_two_loads_are_chosen_pose_by_pose_and_hung_one_after_the_other_by_the_seed(kr500, spec, poses):
    side = Load(np.array([0, 4500.0, 0, 0, 0, 0]), spec.loads[0].point)  # loads joint 1, as no weight does
    both, reach = replace(spec, loads=(spec.loads[0], side)), Reach(lambda q: clear(kr500, q))
    found, again = (make_plan(both, "D", poses[:40], reach, stream(1)) for _ in range(2))
    assert set(found.load) == {0, 1}
    assert (np.diff(found.load) >= 0).all()
    np.testing.assert_array_equal(again.q, found.q)


def test_too_few_poses_without_prior_and_unknown_criteria_are_refused(spec, poses):
    with pytest.raises(BenchError, match="no criterion 'X'; criteria are D, A, E, G, I, test"):
        make_plan(spec, "X", poses, Reach(lambda q: q), stream(1))
    bare = replace(spec, uncertainty=None, poses=6)
    with pytest.raises(BenchError, match=r"at most 36 of the 49 .* 13 would be lost; .* 9 poses, or a prior"):
        candidate_set(bare, poses)


def test_order_avoids_a_way_that_collides():
    q = np.zeros((3, 6))
    q[:, 0] = [0.0, 1.0, 2.1]
    load = np.zeros(3, dtype=int)

    def way(a, b):
        return {a[0], b[0]} != {0.0, 1.0}

    assert _order(q, load, Reach(lambda q: q)).tolist() in ([0, 1, 2], [2, 1, 0])
    assert _order(q, load, Reach(lambda q: q, way)).tolist() in ([0, 2, 1], [1, 2, 0])
    assert DETOUR > 2.1


def draw(own, uncertainty, rng):
    """Compliances of an arm that the prior could have drawn, conservative, (n_theta, n_theta).

    X of every block is Wishart with 2 / u^2 degrees of freedom and mean one: x then has the mean and the
    covariance u^2 of the prior, u its relative uncertainty [1], and C = P^1/2 X P^1/2 is positive definite.
    """
    freedom, parts = 2 / uncertainty**2, []
    for n in own.sizes:
        X = np.reshape(wishart(freedom, np.eye(n) / freedom).rvs(random_state=rng), (n, n))
        column, row = np.tril_indices(n)
        parts.append(X[row, column] * np.where(row == column, 1, np.sqrt(2)))
    return own.structure.matrix(own.L @ np.concatenate(parts))


def with_compliance(plant, C_theta):
    """The plant with other springs, for its linear truth."""
    C = np.zeros_like(plant.C)
    C[np.ix_(plant.theta, plant.theta)] = C_theta
    return replace(plant, C=C)


def test_errors_on_the_whole_arm_are_those_of_arms_drawn_measured_and_identified(kr500, spec, poses):
    """Arms of 153 compliances, MuJoCo's first-order deflections: least squares, and MGCO68 with its prior."""
    prior = cad_prior(kr500.arm)
    whole, joints = (metric(prior, kr500.vjm, s(kr500.arm)) for s in (all153, joints_only))
    alone = replace(spec, experiment=replace(spec.experiment, metric=joints), uncertainty=None)
    q, load = poses[:9], np.zeros(9, dtype=int)
    links = template56(kr500.arm, name="MLS56")
    fits = {
        "joints": (alone, joints_only(kr500.arm), least_squares),
        "links": (predicted_error.least_squares(spec, prior, links), links, least_squares),
        "planned": (spec, mgco68(kr500.arm), with_prior(least_squares, prior, Strength(0.3))),
    }
    setup, rng = Scenario(arm=kr500.arm.name, truth="linear"), stream(8)
    squares = {name: [] for name in fits}
    for _ in range(200):
        own = replace(kr500, truth=with_compliance(kr500.plant, draw(whole, 0.3, rng)))
        runs = measure(own, setup, hanging(own, q, np.arange(9) + 1, 460.3), rng)
        true = measure(own, setup, hanging(own, spec.tasks.q, np.arange(10) + 1, 460.3))
        for name, (_, structure, method) in fits.items():
            off = deflections(kr500.vjm, method(kr500.vjm, structure, runs), true) - true.deflection
            squares[name].append(np.square(off).sum(axis=2).mean())
    for name, (model, *_) in fits.items():
        fit = fit_of(replace(spec.experiment, metric=whole), 0.3, model, q, load)
        promised = promise_on(fit, spec.tasks.q, spec.tasks.load)
        found, errors = promised.overall**2, np.sqrt(squares[name])
        inside = np.mean((promised.overall_low < errors) & (errors < promised.overall_high))
        assert inside == pytest.approx(0.9, abs=0.08), name  # four standard errors of 200 arms
        scatter = np.std(squares[name]) / np.sqrt(200)
        assert np.mean(squares[name]) == pytest.approx(found, abs=5 * scatter), name
        assert scatter < 0.1 * found, name  # so that a factor of two would show
