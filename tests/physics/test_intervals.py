"""Intervals are as wide as they say: simulation-based calibration of all commands that state some.

Truths are drawn, then their readings; where a truth lies in the law that is stated of it must be uniform.
"""

from dataclasses import replace

import numpy as np
import pytest
from loads import axis_loads, rows_of
from scipy.stats import kstest, norm
from scipy.stats import t as student
from unsure import AIM, FORCE, TIP, Q, drawn_state, unsure, unsure_everywhere

from testbench.campaign.absolute_truth import REAL_ARM, AbsoluteCampaign, simulate_series
from testbench.campaign.campaign import Scenario, clear_poses, simulate, stream
from testbench.campaign.named_parameters import intervals
from testbench.correct.compensated import compensate
from testbench.correct.newton import asked
from testbench.correct.predicted import predict
from testbench.correct.rest import rest
from testbench.identify import least_squares, reduce
from testbench.identify.absolute.fit import Options, calibrate
from testbench.identify.absolute.posterior import posterior_of
from testbench.identify.metric import Belief, metric
from testbench.identify.posterior import Posterior, linearise
from testbench.identify.prior import Strength, cad_prior
from testbench.identify.solve import solve
from testbench.model.structure import all153, mgco68, template56
from testbench.model.vjm import chain, marker_points, observation
from testbench.plant.gear import GearErrors
from testbench.studies.absolute_calibration.beside import judged, true_state
from testbench.studies.absolute_calibration.trial import check
from testbench.studies.estimators.bootstrap import resampler

LEVEL, DRAWS = 1e-6, 300  #: Of false alarms; truths drawn.
Z = norm.ppf(0.975)  #: Half of an interval of 95 % over a standard deviation.
SEEDS = range(501, 507)
ON = frozenset({"joint springs", "links", "joint errors"})
ASKED = AbsoluteCampaign(poses=100, disturbances=replace(REAL_ARM, gear=GearErrors(orders=4)))

EXACT = ASKED.model_copy(update={"noise": False})


@pytest.fixture(scope="module")
def arms(kr500):
    """Truth, readings and calibration of some arms."""
    found = []
    for seed in SEEDS:
        series, truth = simulate_series(kr500, ASKED, seed)
        own = calibrate(kr500.vjm, series, cad_prior(kr500.arm), Options(orders=4, only=ON))
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


def test_identify_knows_how_far_fresh_readings_lead_it_astray(arm_6r, rng):
    """Least squares of section 5.2: poses, readings and what is asked for are drawn anew."""
    s, z = template56(arm_6r.arm), []
    for k in range(DRAWS):
        found = least_squares(arm_6r.vjm, s, axis_loads(arm_6r, rng, poses=6))
        there = axis_loads(arm_6r, rng, noise=0.0, poses=1)
        row, true = rows_of(arm_6r, s, there)[k % 18], there.deflection.ravel()[k % 18]
        z.append((row @ found.pi - true) / linearise(found).deviations(row[None])[0])
    check_ranks(z)


@pytest.mark.parametrize("strength", [Strength(0.1), Strength(0.4, 0.2, coupling=0.1)])
def test_identify_with_a_prior_is_as_sure_as_arms_of_the_prior_differ_from_it(kr500, strength, rng):
    """Of a deflection, of any unknowns, of couplings, of the common scale, which may be left to the data."""
    s, asked = mgco68(kr500.arm), Scenario(arm="kr500_l480", truth="linear", workspace_poses=DRAWS // 3)
    campaign, own = simulate(kr500, asked, 1), metric(cad_prior(kr500.arm), kr500.vjm, s)
    again = resampler(reduce(kr500.vjm, s, campaign.identification))
    coupling = strength.uncertainty if strength.coupling is None else strength.coupling
    size = np.where(own.couplings, coupling, strength.uncertainty)
    scale = strength.scale_uncertainty if np.isfinite(strength.scale_uncertainty) else 0.0
    back, z = np.linalg.inv(own.L), []
    for row in rows_of(kr500, s, campaign.truth):
        x = own.expected * (1 + scale * rng.standard_normal()) + size * rng.standard_normal(s.n)
        found = solve(again(own.L @ x, rng), "none", Belief(own, strength))
        any_, some = rng.standard_normal((2, s.n)) * [np.ones(s.n), own.couplings]
        a = np.vstack([row, any_ @ back, some @ back, own.expected @ back])
        z.append(a @ (found.pi - own.L @ x) / linearise(found).deviations(a))
    for found in np.transpose(z)[: 4 if scale else 3]:
        check_ranks(found)


def test_calibrate_is_as_sure_of_geometry_and_joints_as_its_errors_are_large(arms):
    """All 78 numbers of an arm, in independent directions; then those that the readings tell most of."""
    z, told = [], []
    for _, _, truth, own in arms:
        unknowns, columns = own.own.unknowns, own.own.columns
        true, found = unknowns.current(true_state(own.state, truth))[columns], posterior_of(own)
        rigid = np.r_[unknowns.columns("geometry"), unknowns.columns("errors")]
        some = np.isin(columns, rigid) & (true != 0)
        prior = own.chosen.learnt.deviation[columns[some]]
        W, off = found.root[:, some] / prior, (true - found.x)[some] / prior
        left, V = np.linalg.eigh(W.T @ W)
        z.extend(V.T @ off / np.sqrt(left))
        told.extend(left < 0.5)
    assert len(z) == 78 * len(arms)
    check_ranks(z)
    assert 200 < np.sum(told) < len(z)
    check_ranks(np.array(z)[told])


def test_intervals_of_joint_compliances_hold_the_truth(arms):
    """These are what the prior expects."""
    held = [judged(own, truth)[0]["joint compliances"] for _, _, truth, own in arms]
    assert sum(one.inside for one in held) > 0.88 * sum(one.of for one in held)


@pytest.mark.parametrize("make", [unsure, unsure_everywhere])
def test_predict_and_compensate_are_as_sure_as_arms_of_their_doubts_differ_and_miss(kr500, make, rng):
    """A point of the tool: its deflection, where a calibrated arm has it, what a correction leaves."""
    model, q = make(kr500), Q + rng.uniform(-0.3, 0.3, (DRAWS, 6))
    told, meant = predict(model, q, [FORCE], points=TIP[None]), ("unloaded", "drawn")[: 1 + model.absolute]
    z, put = [], [compensate(model, q, [FORCE], replace(AIM, asked=how)) for how in meant]
    assert all(own.corrected.all() for own in put)
    for k in range(DRAWS):
        true, one, axis = drawn_state(model, rng), slice(k, k + 1), k % 3
        bent, free = (rest(true, q[one], loads).at(TIP)[0] for loads in ([FORCE], []))
        off, half = [bent - free - told.deflection[k, 1]], [told.half[k, 1]]
        if model.absolute:
            off, half = [*off, bent - told.position[k, 1]], [*half, told.position_half[k, 1]]
        for own in put:
            target = asked(true, q[one], own.asked, TIP).position[0]
            off.append(rest(true, own.q[one], [FORCE]).at(TIP)[0] - target)
            half.append(own.half[k])
        z.append([Z * x[axis] / h[axis] for x, h in zip(off, half, strict=True)])
    for own in np.transpose(z):
        check_ranks(own)


def test_positions_lie_in_their_ellipsoids(arms, kr500):
    """Of readings in poses that were never measured; the error itself is below that of geometry."""
    inside, error = [], []
    for seed, series, _, own in arms:
        q = clear_poses(kr500, None, 50, stream(seed, 900))
        [true], _ = simulate_series(kr500, EXACT, seed, q)
        assert true.frame == series.frame
        off, within = check(own, true, stream(seed, 901))
        inside.append(within)
        error.append(np.linalg.norm(off, axis=-1))
    assert 0.9 < np.mean(inside) < 0.985
    assert np.sqrt(np.mean(np.square(error))) < 0.15e-3


def test_a_prior_that_is_hardly_believed_takes_no_bound_from_what_readings_show(kr500, rng):
    """Directions that neither tells have none; deflections of the runs that were read have one."""
    campaign = simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=2), 5)
    data = replace(campaign.identification, sigma=1e-8)
    own = metric(cad_prior(kr500.arm), kr500.vjm, all153(kr500.arm))
    regression = reduce(kr500.vjm, own.structure, data)
    found = linearise(solve(regression, "none", Belief(own, Strength(1e6))))
    where, points = chain(kr500.vjm, data.q), marker_points(kr500.vjm, data.markers)
    rows = observation(where, own.structure, data.wrench, data.point, points).reshape(-1, own.structure.n)
    assert len(found.unseen) > 0
    assert np.isfinite(found.deviations(rows)).all()
    assert np.isinf(found.deviations(rng.normal(size=(5, own.structure.n)) / found.scale)).all()


def test_an_interval_is_as_wide_as_noise_by_the_normal_and_the_prior_by_students_distribution(rng):
    """In quadrature: neither hides the other, and each alone is its own quantile."""
    noise, prior = rng.normal(size=(2, 4, 6))
    root, none = np.vstack([noise, prior]), np.zeros((0, 6))
    own = Posterior(np.zeros(6), root, none, np.ones(6), tail=3.0, heavy=4)
    a = rng.normal(size=(5, 6))
    widths = [f.ppf(0.95) * np.linalg.norm(a @ x.T, axis=1) for f, x in ((norm, noise), (student(3), prior))]
    np.testing.assert_allclose(own.half_widths(a, 0.9), np.hypot(*widths))


def test_intervals_have_names_and_the_units_of_people(arms):
    *_, own = arms[0]
    by_name = {(one.part, one.name): one for one in intervals(own)}
    shift = by_name["geometry", "link_2 shift y"]
    assert (shift.unit, shift.value) == ("mm", pytest.approx(1e3 * own.state.theta_0[13]))
    at = own.own.columns.tolist().index(own.own.unknowns.starts["geometry"] + 13 - 6)
    assert shift.half == pytest.approx(1e3 * Z * np.linalg.norm(posterior_of(own).root[:, at]))
    turned = by_name["joint errors", "joint_3 cos 2"]
    assert (turned.unit, turned.value) == ("urad", pytest.approx(1e6 * own.state.n[2, 5]))
    assert all(one.half > 0 for one in by_name.values())
