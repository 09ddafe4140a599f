"""The equations of a calibration, one by one, against what they stand for: covariances, sums, torques."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from testbench.campaign.absolute_truth import REAL_ARM, AbsoluteCampaign, simulate_series
from testbench.data.series import select_rows
from testbench.identify.absolute.align import aligned
from testbench.identify.absolute.evidence import Learnt, choice, usual
from testbench.identify.absolute.fit import Options, calibrate
from testbench.identify.absolute.inner import eliminate, moved_frame, moved_mount
from testbench.identify.absolute.noise import Noise
from testbench.identify.absolute.posterior import posterior_of
from testbench.identify.absolute.scatter import expected_of, single
from testbench.identify.absolute.state import equilibrium, nominal
from testbench.identify.absolute.unknowns import unknowns_of
from testbench.identify.fold import Point, reduce_series
from testbench.identify.metric import metric
from testbench.identify.prior import Strength, cad_prior
from testbench.identify.robust_loss import SQUARE
from testbench.identify.rows import rows_of
from testbench.model.joint_errors import JointErrors
from testbench.model.load import Load
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import tool_pose
from testbench.model.weights import read_weights
from testbench.studies.absolute_calibration.beside import registered

PAIRS = AbsoluteCampaign(
    poses=25, masses=(0.0, 230.0, 460.0), orientations=True, sigma_rotation=1e-4, disturbances=REAL_ARM
)
S, SIGMA, TURN = 2e-4, 5e-5, 1e-4  #: What a model leaves open, and scatter of readings [m, m, rad].


@pytest.fixture(scope="module")
def series(kr500):
    """25 poses of an arm, three loads in each."""
    return simulate_series(kr500, PAIRS, 11)[0]


@pytest.fixture(scope="module")
def reduced(kr500, series):
    """Their equations about the drawn arm, in all unknowns there might be, and these."""
    state = aligned(nominal(kr500.vjm, read_weights(kr500.arm), np.ones(6)), series)
    unknowns = unknowns_of(kr500.vjm, series, JointErrors(), all153(kr500.arm))
    point = Point(unknowns, state, Noise(S, S), SQUARE)
    return reduce_series(point, series), unknowns


def test_blocks_and_series_add_up_to_all_equations(kr500, series, reduced):
    """A part of few rows keeps them as they are, one of many its triangle; poses are never parted."""
    whole, unknowns = reduced
    one, state = series[0], aligned(nominal(kr500.vjm, read_weights(kr500.arm), np.ones(6)), series)
    first = np.unique(one.pose, return_inverse=True)[1] < 3
    block = np.where(first, 0, 1 + one.pose % 2)
    rows = [np.flatnonzero(block == k) for k in range(3)]
    halves = [np.concatenate(rows[:2]), rows[2]]  # as two series of the same frame and mount
    point, cut = Point(unknowns, state, Noise(S, S), SQUARE), [select_rows(one, own) for own in halves]
    parts = reduce_series(point, cut, [block[own] for own in halves])
    assert [part.series for part in parts.parts] == [0, 0, 1]
    size = np.sqrt(np.maximum(np.diag(whole.gram.sum(axis=0)), 1e-300))

    def check_same(found, expected):
        scale = size * size[:, None]
        np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=1e-9)

    check_same(parts.gram, whole.gram)
    check_same(np.array([T.T @ T for T in parts.factors.values()]), whole.gram)
    np.testing.assert_array_equal(parts.counts, whole.counts)
    for part, own in zip(parts.parts, rows, strict=True):
        alone = reduce_series(point, [select_rows(one, own)])
        check_same(part.gram, alone.gram)
        np.testing.assert_array_equal(part.counts, alone.counts)


def test_a_step_of_frame_and_mount_takes_away_what_its_columns_say(kr500, series, rng):
    """Of a target that is turned on the tool by any angle."""
    W = Rotation.from_rotvec((0.4, -1.2, 0.7)).as_matrix()
    one = replace(series[0], rotation=series[0].rotation @ W)
    state = aligned(nominal(kr500.vjm, read_weights(kr500.arm), np.ones(6)), (one,))
    unknowns = unknowns_of(kr500.vjm, (one,), JointErrors(), joints_only(kr500.arm))
    step = 1e-5 * rng.standard_normal(unknowns.starts["geometry"])
    frame, mount = moved_frame(state.frame(one), step[:6]), moved_mount(state.mount(one), step[6:])
    rows = rows_of(unknowns, state, one)
    after = rows_of(unknowns, replace(state, frames={one.frame: frame}, mounts={one.target: mount}), one)
    left = rows[:, :, -1] - np.einsum("sxcr,c->sxr", rows[:, :, : len(step)], step)
    np.testing.assert_allclose(after[:, :, -1], left, rtol=0, atol=1e-7)  # of 1e-5


@pytest.mark.parametrize("factor", [0.7, 0.2])
def test_a_reading_alone_scatters_as_the_mean_of_its_pose_says(series, factor):
    """Less may be left open than was thought; readings are better than said only where nothing is."""
    one = replace(series[0], sigma=SIGMA, sigma_rotation=TURN)
    found = single(Noise(S, S, np.array([factor, factor, 1.0, 1.0])), expected_of([one]))
    for kind, (own, opened) in enumerate(((SIGMA, found.open_position), (TURN, found.open_rotation))):
        of_means = factor**2 * (own**2 + 3 * S**2)
        if of_means > own**2:
            assert found.factor[kind] == pytest.approx(1)
            assert own**2 + 3 * opened**2 == pytest.approx(of_means)
        else:
            assert (opened, found.factor[kind]) == (0, pytest.approx(np.sqrt(of_means) / own))


def test_a_solution_counts_what_is_left_and_what_it_spends(kr500, reduced):
    equations, unknowns = reduced
    elastic = metric(cad_prior(kr500.arm), kr500.vjm, all153(kr500.arm))
    own = choice(unknowns, frozenset({"geometry shift", "geometry turn"}), elastic)
    learnt = usual(unknowns, len(equations.kinds))
    solved = eliminate(own, equations, learnt, "none", Strength(3.0))
    v, held = np.r_[solved.x, -1.0], learnt.deviation[own.columns[: own.rigid]]
    some = np.r_[own.columns, unknowns.size]
    left = v @ equations.gram.sum(axis=0)[np.ix_(some, some)] @ v + np.sum((v[: own.rigid] / held) ** 2)
    n = equations.counts.sum()
    assert solved.estimate.f_m == pytest.approx(np.sqrt(left / (n / 3)), rel=1e-6)
    sure = replace(learnt, deviation=np.where(np.isfinite(learnt.deviation), 1e-12, np.inf))
    free = np.isinf(learnt.deviation[own.columns[: own.rigid]]).sum()
    assert eliminate(own, equations, sure, "none", Strength(3.0)).spent == pytest.approx(free + 153)


@pytest.mark.parametrize("kind", ["play", "stiffening"])
def test_a_joint_gives_way_to_its_own_torque(kr500, kind, rng):
    """Torques from the joints' axes and a force at the tool, of an arm without weight that does not bend."""
    vjm = kr500.vjm
    n = 1e-3 * (1 + np.arange(6.0))
    bare = nominal(vjm, read_weights(kr500.arm), np.full(6, 1000.0))
    light = replace(bare.weights, mass=np.zeros_like(bare.weights.mass))
    state = replace(bare, weights=light, errors=JointErrors(**{kind: True}), n=n[:, None])
    q = np.array([[0.3, -1.2, 1.6, 0.3, -0.5, 0.1]])
    wrench = np.concatenate([rng.normal(0, 2e3, (1, 3)), np.zeros((1, 3))], axis=1)
    step = 1e-6 * np.eye(6)
    tip = [np.array([tool_pose(vjm, q + sign * one)[0][0] for one in step]) for sign in (1, -1)]
    torque = (tip[0] - tip[1]) @ wrench[0, :3] / 2e-6 / 1000
    turned = n * (np.tanh(torque / 0.1) if kind == "play" else torque * np.abs(torque))
    where = equilibrium(state, q, [Load(wrench, np.zeros((1, 3)))]).where
    np.testing.assert_allclose(where.position, tool_pose(vjm, q + turned)[0], rtol=0, atol=1e-6)


def rigid(rng, equations=40, free=3, held=5):
    """A linear problem of one kind: A, y, deviations."""
    A, y = rng.normal(size=(equations, free + held)), rng.normal(size=equations)
    return A, y, np.r_[np.full(free, np.inf), rng.uniform(0.1, 2, held)]


def test_what_unknowns_spend_is_the_trace_of_the_hat_matrix(rng):
    """Free ones a whole equation each, held ones what the readings tell of them."""
    A, y, deviation = rigid(rng)
    count = A.shape[1]
    own = SimpleNamespace(
        rigid=count, columns=np.arange(count), elastic=None, unknowns=SimpleNamespace(size=count, basis=None)
    )
    R = np.linalg.qr(np.column_stack([A, y]), mode="r")
    reduced = SimpleNamespace(factors={0: R}, counts=np.array([len(A)]))
    factor = 1.7
    found = eliminate(own, reduced, Learnt(deviation, np.array([factor])))
    P = A.T @ A / factor**2 + np.diag(deviation**-2.0)
    assert found.spent == pytest.approx(np.trace(A @ np.linalg.solve(P, A.T)) / factor**2)
    np.testing.assert_allclose(found.x, np.linalg.solve(P, A.T @ y / factor**2))


@pytest.fixture(scope="module")
def calibrated(kr500, series):
    options = Options(orders=2, only=frozenset({"joint springs", "links"}), strength=Strength(3.0))
    return calibrate(kr500.vjm, [series[0]], cad_prior(kr500.arm), options)


def test_a_posterior_is_what_the_readings_tell_and_the_prior_which_ties_geometry_to_nothing(calibrated):
    """So is the covariance of which intervals are made, in the units of the arm."""
    found = calibrated
    assert np.abs(found.chosen.learnt.factor - 1).max() > 0.02  # or nothing would tell it from its square
    own, root = found.own, posterior_of(found).root.T
    information = found.information[np.ix_(own.columns, own.columns)]
    size = np.sqrt(np.diag(np.linalg.inv(root @ root.T)))
    prior = (np.linalg.inv(root @ root.T) - information) / size / size[:, None]
    r, deviation = own.rigid, found.chosen.learnt.deviation[own.columns[: own.rigid]]
    expected = np.diag((deviation * size[:r]) ** -2.0)
    np.testing.assert_allclose(prior[:r, :r], expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose(prior[:r, r:], 0, atol=1e-6)


def test_a_frame_goes_with_the_arm_as_the_precision_of_a_calibration_couples_them(calibrated):
    """Given the arm its covariance is P_ff^-1, and it moves by -P_ff^-1 P_fa with what the arm is off."""
    f, root = calibrated.own.unknowns.starts["geometry"], calibrated.root
    P = root.T @ root
    W = registered(calibrated, calibrated.series[0]).posterior.root
    back = np.linalg.solve(calibrated.own.elastic.L, W[:, calibrated.own.rigid :].T).T
    W = np.hstack([W[:, : calibrated.own.rigid], back])  # compliances in the metric
    size = np.sqrt(np.diag(P)[:f])
    dense = np.linalg.inv(P[:f, :f] / size / size[:, None]) / size / size[:, None]
    taken = np.linalg.lstsq(W[:, f:], W[:, :f])[0].T
    np.testing.assert_allclose(taken, -dense @ P[:f, f:], rtol=1e-4, atol=1e-6 * np.abs(taken).max())
    left, scale = W[:, :f] - W[:, f:] @ taken.T, np.sqrt(np.diag(dense))
    np.testing.assert_allclose(
        left.T @ left / scale / scale[:, None], dense / scale / scale[:, None], atol=1e-6
    )
