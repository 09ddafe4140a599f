"""Plans: what their rows tell against the library, what stays hidden, feasible, certified, kept promises."""

import re
from dataclasses import replace
from functools import partial
from itertools import combinations_with_replacement
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import wishart

from testbench import BenchError, Load, PlanSettings, deflections, least_squares, reduce, with_prior
from testbench.arm.mjcf import GRAVITY
from testbench.design import absolute
from testbench.design import rows as plans
from testbench.design.criteria import CRITERIA, criterion_by_name, gains_at_root
from testbench.design.exchange import (
    Feasibility,
    Gauges,
    PoseSearch,
    _add_to_gains,
    exchange_poses,
    gauge_rows,
    greedy_plan,
)
from testbench.design.forecast import forecast, forecast_fit, linear_fit
from testbench.design.planning import (
    COLLISION_SURCHARGE,
    _measuring_order,
    candidate_set,
    choose_greedily,
    forecast_errors,
    make_plan,
    plan_with_gauges,
    prediction_error_function,
)
from testbench.identify.absolute.evidence import moved_mount
from testbench.identify.absolute.fit import CalibrationOptions, calibrate
from testbench.identify.absolute.posterior import further_information
from testbench.identify.absolute.posterior import information_of_series as told_by
from testbench.identify.absolute.state import moved_frame, series_equilibrium
from testbench.identify.equations import distance_directions
from testbench.identify.observability import undetermined_quantities
from testbench.identify.prior import (
    PriorUncertainty,
    cad_prior,
    prior_rows,
    rows_in_prior_units,
    scale_by_prior,
)
from testbench.model.structure import all153, joints_only, mgco68, template56
from testbench.model.vjm import WorkArea, marker_positions, random_poses, tool_points
from testbench.plant.rigid_cell import collision_free
from testbench.plant.tracker import Gauge
from testbench.runs.rows import trial_rng
from testbench.workflows import predicted_error
from testbench.workflows.absolute import quantities, unobservable
from testbench.workflows.absolute_campaign import AbsoluteCampaign, simulate_series
from testbench.workflows.campaign import Scenario, measure_markers, poses_with_weight, read_instruments
from testbench.workflows.instruments import Mounted, mounted, poses_on_planes, unit_normal
from testbench.workflows.plan import (
    absolute_setup,
    absolute_setup_after_readings,
    plan_absolute,
    undetermined_by,
)
from testbench.workflows.plan_input import PoseConditions, build_checks, find_feasible_poses
from testbench.workflows.plan_numbers import joint_coverage, numbers
from testbench.workflows.predicted_error import open_laws

AREA = WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0))


def feasibility(kr500):
    return Feasibility(lambda q: collision_free(kr500.room, q))


@pytest.fixture(scope="module")
def poses(kr500):
    return random_poses(kr500.vjm, AREA, 170, lambda q: collision_free(kr500.room, q), trial_rng(3))


@pytest.fixture(scope="module")
def spec(kr500, poses):
    own = scale_by_prior(cad_prior(kr500.arm), kr500.vjm, mgco68(kr500.arm))
    load = Load(np.array([0, 0, -460.3 * GRAVITY, 0, 0, 0]), kr500.vjm.load_point)
    return plans.PlanSpecification(
        setup=plans.MeasurementSetup(kr500.vjm, own, kr500.vjm.markers, 50e-6),
        loads=(load,),
        tasks=plans.Tasks(poses[120:130], load),
        workspace_poses=poses[130:],
        prior_uncertainty=0.3,
        n_poses=9,
    )


@pytest.fixture(scope="module")
def plan(kr500, spec, poses):
    return make_plan(spec, "test", poses[:120], feasibility(kr500), trial_rng(1))


def promise_of(spec, q, load):
    """Errors to expect at the tasks after any poses were measured, such as those of a plan made by hand."""
    rows = plans.whitened_rows_by_load(spec, q, load)
    problem = plans.build_design_problem(spec.setup, rows, spec.prior_uncertainty)
    return forecast(problem, plans.information(problem, np.arange(len(q))), plans.task_rows(spec))


def test_a_plan_names_the_laws_of_joints_that_its_readings_leave_open(kr500, spec, poses):
    """Fewer with a lighter load beside; of exact readings in many poses joint 1's, which nothing turns."""
    prior, heavy = cad_prior(kr500.arm), spec.loads[0]
    light = Load(heavy.wrench / 3, heavy.point)
    own = scale_by_prior(prior, kr500.vjm, all153(kr500.arm))
    whole = replace(spec, setup=replace(spec.setup, scaling=own), loads=(heavy, light))

    def left(poses, loads, spec=whole):
        q, load = np.tile(poses, (loads, 1)), np.repeat(np.arange(loads), len(poses))
        read = partial(plans.whitened_rows_by_load, q=q, load_index=load)
        made = SimpleNamespace(specification=spec, q=q, load_index=load, whitened_rows=read)
        return {law.kind: law for law in open_laws(made, prior)}

    one, two = (left(poses[:11], loads) for loads in (1, 2))
    assert {"stiffening", "backlash", "friction"} == set(one)
    assert sum(len(law.joints) for law in two.values()) < sum(len(law.joints) for law in one.values())
    friction = one["friction"]
    assert "a row with loading off" in friction.by
    assert "joint_3" in friction.told
    assert set(friction.told) | set(friction.never) <= set(friction.joints)
    assert not set(friction.told) & set(friction.never)
    exact = replace(whole, setup=replace(whole.setup, sigma=1e-9))
    every = left(poses, 2, exact)
    assert {kind: law.joints for kind, law in every.items()} == {kind: ["joint_1"] for kind in one}
    assert all(law.by.startswith("a pull") and law.told == ["joint_1"] for law in every.values())
    assert left(poses[:11], 1, replace(whole, prior_uncertainty=None)) == left(poses[:11], 1, spec) == {}


def test_information_is_that_of_the_regression_and_variance_that_of_all_unknowns(spec, poses, kr500):
    """A side force asks for directions that gravity does not show: the prior's part must come in whole."""
    rows = plans.whitened_rows(spec.setup, poses, spec.loads[0])
    problem = plans.build_design_problem(spec.setup, rows, 0.3)
    assert problem.n_directions == 49
    assert plans.build_design_problem(spec.setup, rows, None).unobservable_directions.shape == (68, 19)
    chosen = np.arange(9)
    side = Load(np.array([0, 3000.0, 0, 0, 0, 0]), spec.loads[0].point)
    wanted = plans.deflection_rows(spec.setup, poses[120:123], side)
    B, _ = prior_rows(spec.setup.scaling, PriorUncertainty(0.3, 10.0))
    A = rows[chosen].reshape(-1, 68)
    whole = np.linalg.inv(B.T @ B + A.T @ A)
    seen, lift = plans.information(problem, chosen), problem.lift
    inside = lift @ np.linalg.solve(seen, lift.T) + problem.remaining_covariance
    by_hand, ours = (np.einsum("pkn,nl,pkl->p", wanted, C, wanted) for C in (whole, inside))
    np.testing.assert_allclose(ours, by_hand, rtol=1e-6)
    q, setup = poses[:7], Scenario(arm=kr500.arm.name, truth="linear")
    data = measure_markers(kr500, setup, poses_with_weight(kr500, q, np.arange(7) + 1, 460.3), trial_rng(2))
    rows = plans.whitened_rows(spec.setup, q, spec.loads[0]).reshape(-1, 68)
    A, _ = rows_in_prior_units(reduce(kr500.vjm, mgco68(kr500.arm), data), spec.setup.scaling)
    np.testing.assert_allclose(rows.T @ rows, A.T @ A, atol=1e-9 * np.abs(A.T @ A).max())


def test_plan_is_feasible_certified_and_better_than_chance(kr500, spec, plan, poses):
    assert plan.q.shape == (9, 6)
    assert collision_free(kr500.room, plan.q).all()
    lower, upper = kr500.arm.limits
    assert ((plan.q >= lower) & (plan.q <= upper)).all()
    assert 0.7 < plan.efficiency <= 1
    np.testing.assert_array_equal(plan.candidates.q[plan.chosen_indices], plan.q)
    load, some = np.zeros(9, dtype=int), poses[: 13 * 9].reshape(13, 9, 6)
    chance = [promise_of(spec, q, load).overall_rms_error for q in some]
    assert forecast_errors(plan, plans.task_rows(spec)).overall_rms_error < min(chance)


@pytest.mark.parametrize(
    "name", [pytest.param(own, marks=[pytest.mark.study] * (own in "DAEG")) for own in CRITERIA]
)
def test_every_criterion_makes_a_plan_with_a_certificate(kr500, spec, poses, name):
    few = replace(spec, n_poses=3)
    found = make_plan(few, name, poses[:12], feasibility(kr500), trial_rng(1))
    assert 0 < found.efficiency <= 1


@pytest.mark.study
def test_two_loads_are_chosen_pose_by_pose_and_hung_one_after_the_other_by_the_seed(kr500, spec, poses):
    side = Load(np.array([0, 4500.0, 0, 0, 0, 0]), spec.loads[0].point)  # loads joint 1, as no weight does
    both, reach = replace(spec, loads=(spec.loads[0], side)), feasibility(kr500)
    found, again = (make_plan(both, "D", poses[:20], reach, trial_rng(1)) for _ in range(2))
    assert set(found.load_index) == {0, 1}
    assert (np.diff(found.load_index) >= 0).all()
    np.testing.assert_array_equal(again.q, found.q)


def test_too_few_poses_without_prior_and_unknown_criteria_are_refused(spec, poses):
    with pytest.raises(BenchError, match="no criterion 'X'; criteria are D, A, E, G, I, test"):
        make_plan(spec, "X", poses, Feasibility(lambda q: q), trial_rng(1))
    bare = replace(spec, prior_uncertainty=None, n_poses=6)
    with pytest.raises(
        BenchError,
        match=r"of the 49 directions .* at most 36; .* 9 poses, or a prior",
    ):
        candidate_set(bare, poses)


def test_order_avoids_a_way_that_collides():
    q = np.zeros((3, 6))
    q[:, 0] = [0.0, 1.0, 2.1]
    load = np.zeros(3, dtype=int)

    def way(a, b):
        return {a[0], b[0]} != {0.0, 1.0}

    assert _measuring_order(q, load, Feasibility(lambda q: q)).tolist() in ([0, 1, 2], [2, 1, 0])
    assert _measuring_order(q, load, Feasibility(lambda q: q, way)).tolist() in ([0, 2, 1], [1, 2, 0])
    assert COLLISION_SURCHARGE > 2.1


def draw(own, uncertainty, rng):
    """Compliances of an arm that the prior could have drawn, conservative, (n_theta, n_theta).

    X of every block is Wishart with 2 / u^2 degrees of freedom and mean one: x then has the mean and the
    covariance u^2 of the prior, u its relative uncertainty [1], and C = P^1/2 X P^1/2 is positive definite.
    """
    freedom, parts = 2 / uncertainty**2, []
    for n in own.block_orders:
        X = np.reshape(wishart(freedom, np.eye(n) / freedom).rvs(random_state=rng), (n, n))
        column, row = np.tril_indices(n)
        parts.append(X[row, column] * np.where(row == column, 1, np.sqrt(2)))
    return own.structure.C_theta_of(own.L @ np.concatenate(parts))


def with_compliance(plant, C_theta):
    """The plant with other springs, for its linear truth."""
    C = np.zeros_like(plant.C_qpos)
    C[np.ix_(plant.theta_indices, plant.theta_indices)] = C_theta
    return replace(plant, C_qpos=C)


@pytest.mark.study
def test_errors_on_the_whole_arm_are_those_of_arms_drawn_measured_and_identified(kr500, spec, poses):
    """Arms of 153 compliances, MuJoCo's first-order deflections: least squares, and MGCO68 with its prior."""
    prior = cad_prior(kr500.arm)
    whole, joints = (scale_by_prior(prior, kr500.vjm, s(kr500.arm)) for s in (all153, joints_only))
    alone = replace(spec, setup=replace(spec.setup, scaling=joints), prior_uncertainty=None)
    q, load = poses[:9], np.zeros(9, dtype=int)
    links = template56(kr500.arm, name="MLS56")
    fits = {
        "joints": (alone, joints_only(kr500.arm), least_squares),
        "links": (predicted_error.least_squares(spec, prior, links), links, least_squares),
        "planned": (spec, mgco68(kr500.arm), with_prior(least_squares, prior, PriorUncertainty(0.3))),
    }
    setup, rng = Scenario(arm=kr500.arm.name, truth="linear"), trial_rng(8)
    squares = {name: [] for name in fits}
    for _ in range(200):
        own = replace(kr500, truth=with_compliance(kr500.plant, draw(whole, 0.3, rng)))
        runs = measure_markers(own, setup, poses_with_weight(own, q, np.arange(9) + 1, 460.3), rng)
        true = measure_markers(own, setup, poses_with_weight(own, spec.tasks.q, np.arange(10) + 1, 460.3))
        for name, (_, structure, method) in fits.items():
            off = deflections(kr500.vjm, method(kr500.vjm, structure, runs), true) - true.deflection
            squares[name].append(np.square(off).sum(axis=2).mean())
    for name, (model, *_) in fits.items():
        read = partial(plans.whitened_rows_by_load, q=q, load_index=load)
        fit = linear_fit(replace(spec.setup, scaling=whole), 0.3, model, read)
        promised = forecast_fit(fit, spec.tasks.q, spec.tasks.load)
        found, errors = promised.overall_rms_error**2, np.sqrt(squares[name])
        inside = np.mean((promised.overall_percentile_5 < errors) & (errors < promised.overall_percentile_95))
        assert inside == pytest.approx(0.9, abs=0.08), name  # four standard errors of 200 arms
        scatter = np.std(squares[name]) / np.sqrt(200)
        assert np.mean(squares[name]) == pytest.approx(found, abs=5 * scatter), name
        assert scatter < 0.1 * found, name  # so that a factor of two would show


POSES = 12
ASKED = PlanSettings(absolute=True, criterion="I", model="Joints", poses=POSES, orders=1, loads_kg=(300.0,))
ALONE = replace(ASKED, loads_kg=())


@pytest.fixture(scope="module")
def union(kr500):
    return absolute_setup(kr500, ASKED)


@pytest.fixture(scope="module")
def places(kr500):
    return find_feasible_poses(build_checks(kr500, PoseConditions()), 120, trial_rng(11)).q


def test_what_joints_do_beyond_the_model_is_one_noise_of_a_pose(union, places):
    """Drawn joints move the targets, by finite differences of the arm itself; rows are whitened by that."""
    q, rng = places[:1], np.random.default_rng(0)
    series, state = absolute.series_in_poses(union.pose_readings, q), union.state
    draws = rng.normal(0, union.unmodelled_joint_deviation, (4000, len(union.unmodelled_joint_deviation)))

    def targets(moved):
        where = series_equilibrium(state, replace(series, q=series.q + moved)).chain
        return where.tool_points_in_world(state.mount(series).points).ravel()

    still = targets(0 * draws[0])
    J = np.stack(
        [(targets(h) - still) / 1e-6 for h in 1e-6 * np.eye(len(union.unmodelled_joint_deviation))], axis=1
    )
    V = np.cov((draws @ J.T).T) + series.sigma**2 * np.eye(len(still))
    A = np.linalg.solve(np.linalg.cholesky(V), absolute.position_rows(union, q)[0])
    ours, drawn = (rows.T @ rows for rows in (absolute.whitened_rows(union, q)[0], A))
    # 4000 draws: 2 % of a variance, and some more over many entries
    assert np.linalg.norm(ours - drawn) < 0.1 * np.linalg.norm(ours)
    rms = np.sqrt(np.square(draws @ J.T).sum(axis=1).mean() / (2 * len(series.markers)))
    assert absolute.unmodelled_displacement(union, q) == pytest.approx(rms, rel=0.03)


@pytest.mark.parametrize("order", ["turned", "reversed"])
def test_readings_turned_by_a_rotation_or_in_another_order_give_the_same_plan(
    kr500, places, rng, monkeypatch, order
):
    """Only rounding differs: 1e-16 times a condition of about 1e3 where unknowns have one size."""
    setup = absolute_setup(kr500, PlanSettings(absolute=True, criterion="I"))
    whitened_rows = absolute.whitened_rows
    k = whitened_rows(setup, places[:1]).shape[1]
    turn = np.linalg.qr(rng.standard_normal((k, k)))[0] if order == "turned" else np.eye(k)[::-1]
    chosen, values = [], []
    for change in (np.eye(k), turn):
        monkeypatch.setattr(
            absolute, "whitened_rows", lambda *a, change=change, **b: change @ whitened_rows(*a, **b)
        )
        problem = absolute.candidate_set(setup, places, POSES).problem
        criterion = criterion_by_name("I", problem, absolute.position_rows(setup, places[-20:]))
        chosen.append(exchange_poses(problem, criterion, problem.rows, np.arange(POSES)).tolist())
        values.append([criterion.phi(plans.information(problem, own)) for own in (range(POSES), chosen[0])])
    assert values[1] == pytest.approx(values[0], rel=1e-11)
    assert chosen[1] == chosen[0]


def absolute_design(kr500, _spec, places):
    """Frame and mount are known to 1 m, readings to 50 um: K reaches 1e10."""
    setup = absolute_setup(kr500, PlanSettings(absolute=True, criterion="I"))
    return absolute.candidate_set(setup, places, POSES).problem, absolute.position_rows(setup, places[-20:])


def design_without_prior(_kr500, spec, places):
    """Only a ridge of 1e-13 of the readings' information keeps M invertible."""
    bare = replace(spec, prior_uncertainty=None, n_poses=POSES)
    return candidate_set(bare, places).problem, plans.task_rows(bare)


@pytest.mark.parametrize("design", [absolute_design, design_without_prior])
def test_gains_of_the_first_greedy_poses_are_those_of_all_rows(kr500, spec, places, design):
    """Every candidate's Phi by the triangular factor of all rows, whose rounding is 1e-16 sqrt(K)."""
    problem, wanted = design(kr500, spec, places)
    criterion = criterion_by_name("I", problem, wanted)
    root, (size, V) = np.linalg.cholesky(problem.prior_information).T, np.linalg.eigh(criterion.W)
    half = V * np.sqrt(np.maximum(size, 0))  # W = half half^T
    chosen = greedy_plan(problem, criterion, problem.rows, 5)
    gains, M = gains_at_root(root, problem.rows, criterion.W), np.eye(len(root))
    for best in chosen:
        every = [np.linalg.qr(np.vstack([root, F]), mode="r") for F in problem.rows]
        phi = np.array([1 / np.square(np.linalg.solve(R.T, half)).sum() for R in every])
        assert gains.phi_with_candidate() == pytest.approx(phi, rel=1e-6)
        assert phi[best] == pytest.approx(phi.max(), rel=1e-6)
        gains, M = _add_to_gains(gains, M, gains.rows[best])
        root = every[best]


FACES = ("plane:P1:z:1.9,0.3,0.6", "plane:P1:-x:2.3,0,1.4", "plane:P1:-y:1.5,1.2,1.4")
BOX = tuple(f"{face}:box" for face in (*FACES, "plane:P1:y:1.5,-1.2,1.4"))
WITH_BAR = (*BOX[1:], "bar:P2:2.2,0,0.1")
TOUCHED = replace(
    ASKED, gear_urad=1.0, orders=0, poses=24, candidates_wanted=200, sling_m=0.2, instruments=FACES
)


@pytest.mark.parametrize("kind", [0, 2])
def test_rows_of_touches_and_distances_are_finite_differences_over_their_noise(kr500, rng, kind):
    """Of a rigid arm: columns of geometry leave out that a bent arm's loads move with it."""
    union = absolute_setup(kr500, replace(TOUCHED, instruments=WITH_BAR, gear_urad=1e-6, orders=1))
    union = replace(union, state=replace(union.state, C_theta=0 * union.state.C_theta))
    planes = [*map(mounted, WITH_BAR[:3])]
    q = poses_on_planes(kr500, planes, 6, rng)[kind::3]
    unknowns = union.unknowns
    rows = absolute.whitened_rows(replace(union, L=np.eye(unknowns.size)), q, pose_kind=np.full(2, kind))
    readers = union.readings_by_kind[kind]
    assert [one.plane_normal is None for one in readers] == [False, True]
    assert len({one.frame for own in union.readings_by_kind for one in own[:1]}) == 1  # a block

    def read(way):
        own, at = union.state, unknowns.columns
        theta_0, n = own.theta_0.copy(), own.error_coefficients
        theta_0[unknowns.geometry_slice] += way[at("geometry")]
        state = replace(
            own,
            theta_0=theta_0,
            error_coefficients=n + way[at("errors")].reshape(n.shape),
            C_theta=own.C_theta + unknowns.structure.C_theta_of(way[at("elastic")]),
            frames={k: moved_frame(frame, way[at(f"frame {k}")]) for k, frame in own.frames.items()},
            mounts={k: moved_mount(mount, way[at(f"mount {k}")]) for k, mount in own.mounts.items()},
        )
        parts = []
        for one in readers:
            series = absolute.series_in_poses(one, q)
            [k] = np.flatnonzero(one.is_measured[0])
            _, length = distance_directions(state, series, series_equilibrium(state, series))
            parts.append(length[k].reshape(2, -1) / one.sigma)
        return np.concatenate(parts, axis=1)

    for k in np.setdiff1d(np.arange(unknowns.size), unknowns.unused_rotations):
        step = 1e-9 if k >= unknowns.first_columns["elastic"] else 1e-5
        way = step * np.eye(unknowns.size)[k]
        slope = (read(way) - read(-way)) / (2 * step)
        largest = np.abs(slope).max() + 1.0
        np.testing.assert_allclose(rows[:, :, k] / largest, slope / largest, atol=1e-6)


@pytest.mark.parametrize(("instruments", "left"), [(FACES, True), (BOX, False)], ids=["faces", "box"])
def test_a_plan_touches_every_face_and_says_if_the_scale_stays_unknown(kr500, instruments, left):
    made = plan_absolute(kr500, replace(TOUCHED, instruments=instruments))
    f = numbers(made)
    planes = [*map(mounted, instruments)]
    count = np.bincount(made.plan.load_index)
    assert (count >= 6).all()  # fewer leave a face open to calibrate
    assert len(count) == len(instruments)
    for q, k, row in zip(made.plan.q, made.plan.load_index, f.plan, strict=True):
        at = tool_points(kr500.vjm, q[None], marker_positions(kr500.vjm, ("P1",)))[0, 0]
        assert abs(unit_normal(planes[k]) @ (at - planes[k].fixed)) < 1e-6
        assert row.face == f"plane {k + 1}"
    assert any("scale of the arm" in words for words in f.hidden) == left
    assert any("Where the base is along a plane" in words for words in f.hidden) == left
    assert (f.scale.after_mm_per_m > 0.5 * f.scale.before_mm_per_m) == left
    assert f.error_mm.expected < f.random_plans.median_mm


def test_bars_are_planned_in_range_and_show_the_scale(kr500):
    bars = ("bar:P1:2.2,0,0.1", "bar:P1:0.5,2,0.8")
    made = plan_absolute(kr500, replace(TOUCHED, instruments=bars, candidates_wanted=60))
    at = tool_points(kr500.vjm, made.plan.q, marker_positions(kr500.vjm, ("P1",)))
    fixed = np.array([mounted(text).fixed for text in bars])
    length = np.linalg.norm(at - fixed, axis=2)
    assert (np.ptp(length, axis=0) <= 2.0).all()  # a metre to either side
    assert not numbers(made).hidden


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"absolute": False, "criterion": "test"}, "instruments are only for --absolute"),
        ({"tracker_m": (4.5, -2.5, 1.6)}, "instruments: cannot be combined with tracker_m"),
        ({"orientations": True}, "instruments: cannot be combined with orientations"),
        ({"instruments": ("gauge:P1:z",)}, "instruments: expected ballbar, bar, wire or plane"),
        ({"instruments": ("plane:P1:z",)}, "--instrument: expected gauge:MARKER:z"),
    ],
)
def test_instruments_that_no_plan_of_absolute_readings_has_are_refused(changed, words):
    with pytest.raises(BenchError, match=words):
        replace(TOUCHED, **changed)


def test_too_few_poses_or_faces_out_of_reach_are_refused(kr500):
    with pytest.raises(BenchError, match="--poses: expected at least 18, 6 for each plane"):
        plan_absolute(kr500, replace(TOUCHED, poses=17))
    low = replace(TOUCHED, loads_kg=(460.0,), sling_m=3.0)
    with pytest.raises(BenchError, match="touch plane 1, expected at least 6: payload does not hang clear"):
        plan_absolute(kr500, low)
    # a plane has its number among all instruments, as everywhere else
    with pytest.raises(BenchError, match="touch plane 2, expected at least 6"):
        plan_absolute(kr500, replace(low, instruments=("bar:P1:2.2,0,0.1", *TOUCHED.instruments)))
    alone = replace(TOUCHED, instruments=BOX[:1])
    with pytest.raises(BenchError, match="block 'box' has one face"):
        plan_absolute(kr500, alone)
    other = replace(TOUCHED, instruments=("plane:P9:z:1.9,0.3,0.6",))
    with pytest.raises(BenchError, match="no marker 'P9'"):
        plan_absolute(kr500, other)


def test_a_joint_that_never_turns_hides_what_a_plan_shows_but_for_structural_directions(union, places):
    """Of an arm of n hinges with m free targets 4 n + 3 m are found of 6 n + 3 m numbers (Everett 1987)."""
    stuck = places[:POSES].copy()
    stuck[:, 4] = 0.3
    hides = "joint_4's offset cannot be separated from"
    [said] = [words for words in undetermined_by(union, stuck) if words.startswith(hides)]
    assert "link_4's turn" in said
    assert said.endswith("turn joint_5 more")
    problem = absolute.candidate_set(union, places, POSES).problem
    criterion = criterion_by_name("I", problem, absolute.position_rows(union, places[-20:]))
    greedy = greedy_plan(problem, criterion, problem.rows, POSES)
    plan = exchange_poses(problem, criterion, problem.rows, greedy)
    assert not [words for words in undetermined_by(union, places[plan]) if "offset" in words]
    first, *_ = undetermined_by(union, places[:POSES])
    assert first.startswith("12 directions")


def test_two_quantities_of_which_only_the_sum_is_read_hide_behind_each_other_no_zero_does(union, places):
    """Information k of the sum of two unit normals: each keeps (1 + k) / (1 + 2 k) of its variance."""
    unknowns, k = union.unknowns, 50.0
    names = "joint_3's offset", "joint_6's compliance"
    pair = [own for own in quantities(unknowns) if own.name in names]
    L = np.diag(np.sqrt(np.diag(union.L @ union.L.T)))
    both = sum(own.jacobian[0] @ L / np.linalg.norm(own.jacobian @ union.L) for own in pair)
    found = undetermined_quantities(quantities(unknowns), L, k * np.outer(both, both), np.zeros((len(L), 0)))
    [hidden] = [own for own in found if own.confounded_with]
    assert {hidden.name, *hidden.confounded_with} == {*names}
    prior = np.diag(np.diag(union.L @ union.L.T))
    prior[unknowns.columns("errors")] = 0
    series = absolute.series_in_poses(union.pose_readings, places[:POSES])
    pull = further_information(unknowns, union.state, (series,))
    tells = told_by(unknowns, union.state, series)
    said = " ".join(unobservable(unknowns, tells, prior, pull))
    assert "12 directions" in said
    assert "error" not in said
    said = " ".join(unobservable(unknowns, 0 * tells, prior, pull))
    assert re.search(r"joint_6's compliance|compliance \([^)]*joint_6", said)


@pytest.fixture(scope="module")
def before(kr500):
    """Readings of 250 poses with joint_1 on one side, and the arm by them."""
    q = find_feasible_poses(build_checks(kr500, PoseConditions()), 250, trial_rng(5)).q
    q[:, 0] = np.abs(q[:, 0])
    series, _ = simulate_series(kr500, AbsoluteCampaign(poses=250), 5, q)
    on = frozenset({"joint springs", "joint errors"})
    return series, calibrate(
        kr500.vjm, series, cad_prior(kr500.arm), CalibrationOptions(max_order=30, used_errors=on)
    )


def test_what_earlier_readings_tell_adds_to_what_a_plan_tells(before, places):
    """The error by roots of covariances is that by sums of precisions in SI units."""
    model = before[1].model()
    own, q = replace(absolute_setup_after_readings(model, ALONE), min_information=0.0), places[:6]
    first, across = own.unknowns.first_columns["geometry"], replace(own, L=np.eye(own.unknowns.size))
    on = np.r_[:first, first + model.uncertain_columns]
    P = np.eye(len(on)) / absolute.FRAME_DEVIATION**2
    P[first:, first:] = np.linalg.inv(model.posterior.covariance_root.T @ model.posterior.covariance_root)
    P += absolute.position_information(own, q)[np.ix_(on, on)]
    A = absolute.position_rows(across, places[-20:])[:, :, on].reshape(-1, len(on))
    error = np.sqrt(3 * np.einsum("ki,ik->k", A, np.linalg.solve(P, A.T)).mean())
    problem = absolute.candidate_set(own, q, len(q)).problem
    found = prediction_error_function(problem, absolute.position_rows(own, places[-20:]))
    assert found(np.arange(6)) == pytest.approx(error)


def test_further_poses_lower_the_error_that_is_left_after_realignment(before, places, rng):
    """Errors of a new frame are in neither error: with them, more poses would seem to make an arm worse."""
    own = absolute_setup_after_readings(before[1].model(), ALONE)
    rows = absolute.position_rows(own, places[-20:])
    left, first = absolute.without_frame_and_mount(own, rows), own.unknowns.first_columns["geometry"]
    A = rows.reshape(-1, rows.shape[2])
    b = A[:, first:] @ rng.standard_normal(A.shape[1] - first)
    fitted = np.linalg.lstsq(A[:, :first], b, rcond=None)[0]
    x = np.r_[np.zeros(first), np.linalg.lstsq(A[:, first:], b, rcond=None)[0]]
    np.testing.assert_allclose(left.reshape(A.shape) @ x, b - A[:, :first] @ fitted, atol=1e-8 * abs(b).max())
    error = prediction_error_function(absolute.candidate_set(own, places[:40], 40).problem, left)
    errors = [error(np.arange(k)) for k in (0, 5, 10, 20, 40)]
    assert errors[0] == pytest.approx(absolute.prior_error_after_alignment(own, rows), rel=1e-6)
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.9 * errors[0]


def test_a_plan_after_readings_goes_where_a_joint_was_not_read(kr500, before, places):
    """Asked for the other side of joint_1, to which one in five candidates turns it."""
    series, found = before
    own, other = absolute_setup_after_readings(found.model(), ALONE), places[:, 0] < 0
    q = np.vstack([places[~other][:40], places[other][:10]])
    wanted = absolute.position_rows(own, places[other][-20:])
    examined = absolute.candidate_set(own, q, 8)
    problem, criterion = examined.problem, criterion_by_name("I", examined.problem, wanted)
    search = PoseSearch(
        partial(absolute.whitened_rows, own), 8, kr500.arm.limits, Feasibility(lambda q: q), trial_rng(1)
    )
    plan = choose_greedily(search, criterion, examined).chosen_indices
    alone = absolute.candidate_set(own, q[:1], 8)  # of one candidate there is one plan, which is its bound
    criterion = criterion_by_name("I", alone.problem, wanted)
    assert choose_greedily(search, criterion, alone).efficiency == pytest.approx(1)
    assert (plan >= 40).sum() >= 4
    [row, *_] = joint_coverage(kr500.arm, series, q[plan])
    assert (row.joint, row.poses) == ("joint_1", pytest.approx((plan >= 40).sum(), abs=1))
    error = prediction_error_function(problem, wanted)
    assert error(plan) < min(error(trial_rng(k).choice(50, 8, replace=False)) for k in range(10))


def test_poses_and_gauges_chosen_together_are_the_best_of_all_places(kr500, spec, poses):
    """Of four poses and the nine places of one gauge in each, by trying all pairs of places."""
    few, nowhere = replace(spec, n_poses=2), Feasibility(lambda q: np.zeros(len(q), dtype=bool))
    given = make_plan(few, "I", poses[:4], nowhere, trial_rng(1))
    gauges = Gauges(1, 5e-6, 0.01)
    found = plan_with_gauges(given, gauges, nowhere, trial_rng(1))
    problem, criterion = given.candidates.problem, found.criterion
    rows = gauge_rows(spec, poses[:4], np.zeros(4, dtype=int), gauges, problem.lift).reshape(36, 1, -1)
    every = [
        criterion.phi(plans.add_information(problem.prior_information, rows[[a, b]]))
        for a, b in combinations_with_replacement(range(36), 2)
    ]
    assert found.criterion_value == pytest.approx(max(every), rel=1e-9)
    assert max(every) <= found.relaxed_design.bound * (1 + 1e-9)
    twice = replace(given, q=given.q[[0, 0]], chosen_indices=given.chosen_indices[[0, 0]])
    alone = plan_with_gauges(twice, gauges, nowhere, trial_rng(1))
    assert alone.criterion_value == pytest.approx(found.criterion_value)  # wherever the tracker would read
    read, chosen = plans.row_products(found.whitened_rows(few), problem.lift), found.chosen_indices
    np.testing.assert_allclose(found.candidates.problem.rows[chosen], read, atol=1e-9 * abs(read).max())


@pytest.mark.study
def test_refined_places_of_gauges_are_better_and_within_their_bound(kr500, spec, poses):
    given = make_plan(spec, "test", poses[:40], feasibility(kr500), trial_rng(1))
    nowhere = Feasibility(lambda q: np.zeros(len(q), dtype=bool))
    refined, kept = (
        plan_with_gauges(given, Gauges(3, 5e-6, 0.01), reach, trial_rng(1))
        for reach in (feasibility(kr500), nowhere)
    )
    assert kept.criterion_value < refined.criterion_value <= refined.relaxed_design.bound
    assert collision_free(kr500.room, refined.q).all()
    assert (np.diff(refined.gauges.marker, axis=1) > 0).all()


def test_rows_of_gauges_are_those_of_readings_along_lines(kr500, spec, poses):
    """What a plan counts with is what a fit makes of gauges there: the same information, by another way."""
    light = Load(np.array([0, 0, -1.0, 0, 0, 0]), kr500.vjm.load_point)
    q, own = poses[:3], replace(spec, loads=(light,), tasks=replace(spec.tasks, load=light))
    lift = np.eye(mgco68(kr500.arm).n_parameters)
    rows = gauge_rows(own, q, np.zeros(3, dtype=int), Gauges(3, 5e-6, 0.01), lift)
    loaded, fine = (
        poses_with_weight(kr500, q, np.arange(3), 1 / GRAVITY),
        Gauge(resolution=0.0, tilt_sigma=0.01),
    )
    gauges = [Mounted(fine, f"P{k + 1}", np.eye(3)[(k + 1) % 3]) for k in range(3)]
    data = read_instruments(kr500, "linear", loaded, gauges, trial_rng(1))
    A, _ = reduce(kr500.vjm, mgco68(kr500.arm), data).weighted_equations
    A = A @ own.setup.scaling.L
    told = np.array([rows[:, k, (k + 1) % 3] for k in range(3)]).reshape(9, -1)
    np.testing.assert_allclose(A.T @ A, told.T @ told, rtol=0, atol=1e-4 * np.abs(told.T @ told).max())
