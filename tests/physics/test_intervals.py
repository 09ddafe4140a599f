"""Intervals are as wide as they say, for all commands that state some.

Truths are drawn, then their readings; where a truth lies in the law that is stated of it must be uniform.
"""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from loads import axis_loads, rows_of
from scipy.stats import kstest, norm
from scipy.stats import t as student
from unsure import AIM, FORCE, TIP, Q, drawn_state, unsure, unsure_everywhere

from testbench import BenchError, compensate, gco, intervals, least_squares, predict, reduce, with_prior
from testbench.correct.newton import equilibrium, programmed_target
from testbench.data.dataset import select_rows
from testbench.identify.absolute.fit import CalibrationOptions, calibrate, posterior_of_calibration
from testbench.identify.posterior import Posterior, posterior_of_estimate
from testbench.identify.prior import (
    Prior,
    PriorUncertainty,
    WeightedPrior,
    cad_prior,
    scale_by_prior,
)
from testbench.identify.solve import solve
from testbench.model.structure import Structure, all153, mgco68, template56
from testbench.model.vjm import evaluate_chain, marker_positions, observation_matrix
from testbench.plant.disturbance import GearErrors
from testbench.runs.rows import trial_rng
from testbench.studies.absolute.simulated import check, true_state
from testbench.studies.campaign.coverage import draw_conservative
from testbench.studies.intervals import bootstrap, resampler
from testbench.workflows import calibration_numbers
from testbench.workflows.absolute_campaign import REAL_ARM, AbsoluteCampaign, simulate_series
from testbench.workflows.campaign import FullPose, Scenario, simulate, simulate_full_pose
from testbench.workflows.cell import clear_poses
from testbench.workflows.fits import fit_models
from testbench.workflows.models import named_models
from testbench.workflows.read_runs import MeasuredRuns

LEVEL, DRAWS = 1e-6, 300  #: Of false alarms; truths drawn.
Z = norm.ppf(0.975)  #: Half of an interval of 95 % over a standard deviation.
SEEDS = range(501, 507)
ON = frozenset({"joint springs", "links", "joint errors"})
ASKED = AbsoluteCampaign(poses=100, disturbances=replace(REAL_ARM, gear_errors=GearErrors(max_order=4)))

EXACT = ASKED.model_copy(update={"noise": False})


@pytest.fixture(scope="module")
def arms(kr500):
    """Truth, readings and calibration of some arms."""
    found = []
    for seed in SEEDS:
        series, truth = simulate_series(kr500, ASKED, seed)
        own = calibrate(
            kr500.vjm, series, cad_prior(kr500.arm), CalibrationOptions(max_order=4, used_errors=ON)
        )
        found.append((seed, series[0], truth, own))
    return found


def check_ranks(z):
    """Errors over their deviations, (draws,): ranks of truths are uniform, from an end and from the middle.

    By Kolmogorov and Smirnov, false once in a million. The first sees a bias of half a deviation, the second
    a width that is 1.4 times off.
    """
    rank = norm.cdf(z)
    for own in (rank, np.abs(2 * rank - 1)):
        assert kstest(own, "uniform").pvalue > LEVEL


@pytest.mark.study
def test_identify_knows_how_far_fresh_readings_lead_it_astray(arm_6r, rng):
    """Least squares of section 5.2: poses, readings and what is asked for are drawn anew."""
    s, z = template56(arm_6r.arm), []
    for k in range(DRAWS):
        found = least_squares(arm_6r.vjm, s, axis_loads(arm_6r, rng, poses=6))
        there = axis_loads(arm_6r, rng, noise=0.0, poses=1)
        row, true = rows_of(arm_6r, s, there)[k % 18], there.deflection.ravel()[k % 18]
        z.append((row @ found.pi - true) / posterior_of_estimate(found).standard_deviations(row[None])[0])
    check_ranks(z)


@pytest.mark.parametrize(
    "uncertainty",
    [
        pytest.param(PriorUncertainty(0.1), marks=pytest.mark.study),
        PriorUncertainty(0.4, 0.2, link_coupling=0.1),
    ],
)
def test_identify_with_a_prior_is_as_sure_as_arms_of_the_prior_differ_from_it(kr500, uncertainty, rng):
    """Of a deflection, of any unknowns, of couplings, of the common scale, which may be left to the data."""
    s, asked = mgco68(kr500.arm), Scenario(arm="kr500_l480", truth="linear", workspace_poses=DRAWS // 3)
    campaign, own = simulate(kr500, asked, 1), scale_by_prior(cad_prior(kr500.arm), kr500.vjm, s)
    again = resampler(reduce(kr500.vjm, s, campaign.identification))
    coupling = uncertainty.relative if uncertainty.link_coupling is None else uncertainty.link_coupling
    size = np.where(own.is_link_coupling, coupling, uncertainty.relative)
    scale = uncertainty.scale if np.isfinite(uncertainty.scale) else 0.0
    back, z = np.linalg.inv(own.L), []
    for row in rows_of(kr500, s, campaign.truth):
        x = own.expected_x * (1 + scale * rng.standard_normal()) + size * rng.standard_normal(s.n_parameters)
        found = solve(again(own.L @ x, rng), "none", WeightedPrior(own, uncertainty))
        any_, some = rng.standard_normal((2, s.n_parameters)) * [
            np.ones(s.n_parameters),
            own.is_link_coupling,
        ]
        a = np.vstack([row, any_ @ back, some @ back, own.expected_x @ back])
        z.append(a @ (found.pi - own.L @ x) / posterior_of_estimate(found).standard_deviations(a))
    for found in np.transpose(z)[: 4 if scale else 3]:
        check_ranks(found)


@pytest.mark.study
def test_calibrate_is_as_sure_of_geometry_and_joints_as_its_errors_are_large(arms):
    """All 78 numbers of an arm, in independent directions; then those that the readings tell most of."""
    z, told = [], []
    for _, _, truth, own in arms:
        unknowns, columns = own.active_unknowns.unknowns, own.active_unknowns.columns
        true, found = unknowns.values(true_state(own.state, truth))[columns], posterior_of_calibration(own)
        rigid = np.r_[unknowns.columns("geometry"), unknowns.columns("errors")]
        some = np.isin(columns, rigid) & (true != 0)
        prior = own.selection.error_scales.deviation[columns[some]]
        W, off = found.covariance_root[:, some] / prior, (true - found.mean)[some] / prior
        left, V = np.linalg.eigh(W.T @ W)
        z.extend(V.T @ off / np.sqrt(left))
        told.extend(left < 0.5)
    assert len(z) == 78 * len(arms)
    check_ranks(z)
    assert 200 < np.sum(told) < len(z)
    check_ranks(np.array(z)[told])


@pytest.mark.study
@pytest.mark.parametrize("make", [unsure, unsure_everywhere])
def test_predict_and_compensate_are_as_sure_as_arms_of_their_doubts_differ_and_miss(kr500, make, rng):
    """A point of the tool: its deflection, where a calibrated arm has it, what a correction leaves."""
    model, q = make(kr500), Q + rng.uniform(-0.3, 0.3, (DRAWS, 6))
    told, meant = predict(model, q, [FORCE], points=TIP[None]), ("unloaded", "drawn")[: 1 + model.is_absolute]
    z, put = [], [compensate(model, q, [FORCE], replace(AIM, joint_meaning=how)) for how in meant]
    assert all(own.corrected.all() for own in put)
    for k in range(DRAWS):
        true, one, axis = drawn_state(model, rng), slice(k, k + 1), k % 3
        bent, free = (equilibrium(true, q[one], loads).position_of(TIP)[0] for loads in ([FORCE], []))
        off, half = [bent - free - told.deflection[k, 1]], [told.half_width[k, 1]]
        if model.is_absolute:
            off, half = [*off, bent - told.position[k, 1]], [*half, told.position_half_width[k, 1]]
        for own in put:
            target = programmed_target(true, q[one], own.joint_meaning, TIP).position[0]
            off.append(equilibrium(true, own.q[one], [FORCE]).position_of(TIP)[0] - target)
            half.append(own.error_half_width[k])
        z.append([Z * x[axis] / h[axis] for x, h in zip(off, half, strict=True)])
    for own in np.transpose(z):
        check_ranks(own)


@pytest.mark.study
def test_positions_lie_in_their_ellipsoids(arms, kr500):
    """Of readings in poses that were never measured; the error itself is below that of geometry."""
    inside, error = [], []
    for seed, series, _, own in arms:
        q = clear_poses(kr500, None, 50, trial_rng(seed, 900))
        [true], _ = simulate_series(kr500, EXACT, seed, q)
        assert true.frame == series.frame
        off, within = check(own, true, trial_rng(seed, 901))
        inside.append(within)
        error.append(np.linalg.norm(off, axis=-1))
    assert 0.9 < np.mean(inside) < 0.985
    assert np.sqrt(np.mean(np.square(error))) < 0.15e-3


def test_an_interval_is_as_wide_as_noise_by_the_normal_and_the_prior_by_students_distribution(rng):
    """In quadrature: neither hides the other, and each alone is its own quantile."""
    noise, prior = rng.normal(size=(2, 4, 6))
    root, none = np.vstack([noise, prior]), np.zeros((0, 6))
    own = Posterior(np.zeros(6), root, none, np.ones(6), student_dof=3.0, n_prior_rows=4)
    a = rng.normal(size=(5, 6))
    widths = [f.ppf(0.95) * np.linalg.norm(a @ x.T, axis=1) for f, x in ((norm, noise), (student(3), prior))]
    np.testing.assert_allclose(own.half_widths(a, 0.9), np.hypot(*widths))


@pytest.mark.study
def test_intervals_have_names_and_the_units_of_people(arms):
    *_, own = arms[0]
    active = own.active_unknowns
    rows = calibration_numbers.interval_rows(own, calibration_numbers.geometry_errors(active))
    by_name = {row.name: row for row in rows}
    shift = by_name["link_2 shift y"]
    assert (shift.unit, shift.value) == ("mm", pytest.approx(1e3 * own.state.theta_0[13]))
    at = active.columns.tolist().index(active.unknowns.first_columns["geometry"] + 13 - 6)
    root = posterior_of_calibration(own).covariance_root[:, at]
    assert shift.half_95 == pytest.approx(1e3 * Z * np.linalg.norm(root))
    assert by_name["link_2 turn z"].unit == "mrad"
    assert all(row.half_95 > 0 for row in rows)


@pytest.fixture(scope="module")
def campaign(kr500):
    return simulate(kr500, Scenario(arm="kr500_l480", truth="linear", workspace_poses=4), 1)


def test_bad_input_is_named(kr500, campaign):
    s, other = template56(kr500.arm), scale_by_prior(cad_prior(kr500.arm), kr500.vjm, mgco68(kr500.arm))
    estimate = least_squares(kr500.vjm, s, campaign.identification)
    linear, rng = posterior_of_estimate(estimate), np.random.default_rng(0)
    for confidence in (0.0, 1.0, -0.5, 95.0, np.nan):
        with pytest.raises(BenchError, match="confidence: expected a number between 0 and 1"):
            linear.intervals(np.eye(s.n_parameters), confidence)
    with pytest.raises(BenchError, match="expected shape"):
        scale_by_prior(Prior("small", np.eye(6)), kr500.vjm, s)
    for rows in (np.ones((1, 5)), np.ones(s.n_parameters), np.full((1, s.n_parameters), np.nan)):
        with pytest.raises(BenchError, match="functionals"):
            linear.standard_deviations(rows)
    with pytest.raises(BenchError, match="draws: expected at least 39 for 95 %, got 38"):
        bootstrap(estimate, np.eye(s.n_parameters), 0.95, draws=38, rng=rng)
    with pytest.raises(BenchError, match="expected a conservative model among"):
        draw_conservative(other, PriorUncertainty(50.0), rng)


@pytest.fixture(scope="module")
def full_pose(arm_6r):
    """Template of 56 unknowns from full poses: 32 directions, every deflection seen."""
    campaign = simulate_full_pose(arm_6r, FullPose(arm="arm_6r", check_runs=4), 1)
    s = template56(arm_6r.arm)
    return s, rows_of(arm_6r, s, campaign.check, np.zeros((1, 3))), campaign.identification


def test_what_nothing_shows_is_infinitely_uncertain_and_nothing_else(kr500, campaign, rng):
    """Joint 1 under a weight; a prior that is hardly believed takes no bound from what readings show."""
    joint_1 = Structure.of(kr500.arm, joints=["joint_1", "joint_2"])
    sd = posterior_of_estimate(
        least_squares(kr500.vjm, joint_1, campaign.identification)
    ).standard_deviations(np.eye(2))
    assert np.isinf(sd[0])
    assert 0 < sd[1] < 1e-7
    s = all153(kr500.arm)
    estimate = least_squares(kr500.vjm, s, campaign.identification)
    linear = posterior_of_estimate(estimate)
    assert np.isinf(
        linear.standard_deviations(np.eye(s.n_parameters))[s.row_labels.index("joint_1") - s.n_theta]
    )
    assert np.isinf(linear.standard_deviations(rows_of(kr500, s, campaign.truth))).mean() > 0.5
    data = campaign.identification
    seen = rows_of(kr500, s, data, kr500.vjm.markers)
    sd = linear.standard_deviations(seen)
    # the measured deflections themselves: never worse than one reading, better for what they share
    assert (sd < 1.001 * np.sqrt(2) * data.sigma).all()
    two = np.vstack([rows_of(kr500, s, campaign.truth)[:1], seen[:1]])
    found = bootstrap(estimate, two, 0.5, draws=3, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(np.isinf(found.upper), [True, False])
    campaign = simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=2), 5)
    data = replace(campaign.identification, sigma=1e-8)
    own = scale_by_prior(cad_prior(kr500.arm), kr500.vjm, all153(kr500.arm))
    regression = reduce(kr500.vjm, own.structure, data)
    found = posterior_of_estimate(solve(regression, "none", WeightedPrior(own, PriorUncertainty(1e6))))
    where, points = evaluate_chain(kr500.vjm, data.q), marker_positions(kr500.vjm, data.markers)
    rows = observation_matrix(where, own.structure, data.wrench, data.point, points).reshape(
        -1, own.structure.n_parameters
    )
    assert len(found.unobservable_directions) > 0
    assert np.isfinite(found.standard_deviations(rows)).all()
    assert np.isinf(
        found.standard_deviations(rng.normal(size=(5, own.structure.n_parameters)) / found.typical_sizes)
    ).all()


def test_bootstrap_is_near_linearised_where_the_cone_does_not_bind(arm_6r, full_pose):
    s, rows, data = full_pose
    for method, draws, rtol in ((least_squares, 199, 0.3), (gco, 39, 0.7)):
        estimate = method(arm_6r.vjm, s, data)
        linear = posterior_of_estimate(estimate).intervals(rows, 0.9)
        boot = bootstrap(estimate, rows, 0.9, draws=draws, rng=np.random.default_rng(1))
        # order statistics of 199 and of 39 draws: 7 and 17 % of the width; 4 standard errors
        np.testing.assert_allclose(boot.upper - boot.lower, linear.upper - linear.lower, rtol=rtol)
        np.testing.assert_array_equal(boot.centre, linear.centre)


@pytest.mark.study
def test_memory_of_intervals_grows_with_what_they_are_and_not_with_their_rows(kr500, campaign):
    s = all153(kr500.arm)
    estimate = with_prior(gco, cad_prior(kr500.arm), PriorUncertainty(0.3))(
        kr500.vjm, s, campaign.identification
    )

    def peak(times):
        where = select_rows(campaign.truth, np.tile(np.arange(campaign.truth.n_runs), times))
        tracemalloc.start()
        found = intervals(kr500.vjm, estimate, where)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most, found.centre.size

    few, many = peak(500), peak(1000)
    rows = 8 * s.n_parameters * (many[1] - few[1])
    assert many[0] - few[0] < rows / 10


def test_of_many_runs_some_have_intervals_evenly_and_the_notes_say_so(kr500, monkeypatch):
    data = simulate(kr500, Scenario(arm="kr500_l480", truth="linear", workspace_poses=1), 3).identification
    monkeypatch.setattr("testbench.workflows.fits.MAX_EVALUATED_RUNS", 4)
    runs = MeasuredRuns("runs.csv", data, data, None)
    fits = fit_models(kr500, named_models(kr500, ["Joints"]), runs, lambda: 0.0, widths=True).fits
    shown = [row["run"] for row in fits.models[0].intervals.deflections[:: len(data.markers)]]
    assert len(set(shown)) == 4
    assert (shown[0], shown[-1]) == (data.run_id[0], data.run_id[-1])
    assert f"intervals are computed for 4 of {data.n_runs} runs" in fits.notes[-1]
