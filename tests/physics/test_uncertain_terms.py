"""Terms of uncertainty by the book: dense covariances, hat matrices, differences, turned frames."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag, helmert
from scipy.spatial.transform import Rotation
from scipy.stats import norm
from scipy.stats import t as student

from testbench.campaign.absolute_truth import REAL_ARM, AbsoluteCampaign, simulate_series
from testbench.campaign.campaign import Scenario, simulate
from testbench.correct.arm_model import About, bending, of_compliances
from testbench.correct.beyond import extent
from testbench.correct.rest import rest
from testbench.correct.sure import Stand, rows_between
from testbench.data.series import Series
from testbench.identify import reduce
from testbench.identify.absolute import evidence as sizes
from testbench.identify.absolute.fit import Options, calibrate
from testbench.identify.absolute.inner import Inner, _compliances, eliminate
from testbench.identify.absolute.intervals import deviations_root, placed
from testbench.identify.absolute.noise import Noise, plan_of, roots
from testbench.identify.absolute.scatter import single
from testbench.identify.absolute.state import loads, nominal, tell
from testbench.identify.doubts.loads import allowed, learnt
from testbench.identify.hierarchy import _left_open, _mean, _scales, evidence, weigh
from testbench.identify.in_base import in_base
from testbench.identify.intervals import Linearised, linearise
from testbench.identify.metric import Belief, metric
from testbench.identify.prior import Strength, cad_prior
from testbench.identify.registration import Frame
from testbench.identify.regularised import fit_reduced
from testbench.identify.weighed import marker_points
from testbench.model.joint_errors import JointErrors, basis
from testbench.model.load import Load
from testbench.model.structure import all153, joints_only, mgco68
from testbench.model.vjm import chain, observation, tool_pose
from testbench.model.weights import read_weights

K, SIGMA, OPEN = 4, 20e-6, 35e-6
Q = np.array([0.3, -1.2, 1.6, 0.3, -0.5, 0.1])


@pytest.fixture(scope="module")
def campaign(kr500):
    return simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=2), 5)


@pytest.fixture(scope="module")
def calibrated(kr500):
    """By readings of one arm in 60 poses."""
    asked = AbsoluteCampaign(poses=60, disturbances=REAL_ARM)
    series, _ = simulate_series(kr500, asked, 11)
    return calibrate(kr500.vjm, series, cad_prior(kr500.arm), Options(orders=2))


def readings(poses=3, again=K):
    """So many readings of every pose, one target."""
    rows = poses * again
    still = {"wrench": np.zeros((rows, 6)), "point": np.zeros((rows, 3)), "q": np.zeros((rows, 6))}
    pose = np.repeat(np.arange(poses), again)
    return Series(
        "s", ("P1",), "f", "t", np.arange(rows), pose, position=np.ones((rows, 1, 3)), sigma=SIGMA, **still
    )


def test_readings_of_a_pose_are_whitened_by_their_joint_covariance():
    """k readings share what the model leaves open: sigma^2 I + s^2 1 1^T, by Helmert's rows."""
    series = readings()
    plan = plan_of(series)
    W, _ = roots(series, Noise(OPEN), plan, np.eye(3))
    H = helmert(K, full=True)
    dense = H @ (SIGMA**2 * np.eye(K) + OPEN**2) @ H.T
    [group] = plan.groups
    for rows in group:
        own = np.diag(W[0, rows, 0, 0])
        np.testing.assert_allclose(own @ dense @ own, np.eye(K), atol=1e-12)


@pytest.mark.parametrize("factor", [0.95, 0.8, 0.5, 0.2])
def test_a_scatter_learnt_from_means_is_the_same_variance_for_readings_alone(factor):
    """What means were seen to scatter by stays; readings are better than said only where nothing is open."""
    found = single(Noise(OPEN, factor=np.array([factor, 1, 1, 1])), [readings()])
    whole = factor**2 * (SIGMA**2 + K * OPEN**2)
    own = found.factor[0] ** 2 * (SIGMA**2 + K * found.open_position**2)
    assert own == pytest.approx(whole, rel=1e-12)
    assert found.factor[0] == pytest.approx(1.0 if whole >= SIGMA**2 else np.sqrt(whole) / SIGMA)


@pytest.mark.parametrize(("count", "share"), [(20, 1.0), (60, 1 / 6)])
def test_a_group_of_which_nothing_is_seen_keeps_the_size_that_is_imagined(count, share):
    """A small one the usual size; a large one a sixth of it, so that absent orders are drawn to nothing."""
    usual = sizes.USUAL["harmonics"]
    columns = np.arange(count)
    own = SimpleNamespace(
        unknowns=SimpleNamespace(groups=[("harmonics", columns)], size=count), columns=columns
    )
    before = np.full(count, 2 * usual)
    after = sizes._sizes(own, np.zeros(count), np.diag(before**2), before)
    np.testing.assert_allclose(after, share * usual)


def rigid(rng, equations=40, free=3, held=5):
    """A linear problem of one kind: A, y, deviations."""
    A, y = rng.normal(size=(equations, free + held)), rng.normal(size=equations)
    return A, y, np.r_[np.full(free, np.inf), rng.uniform(0.1, 2, held)]


def test_what_unknowns_spend_is_the_trace_of_the_hat_matrix(rng):
    """Free ones a whole equation each, held ones what the readings tell of them."""
    A, y, deviation = rigid(rng)
    count = A.shape[1]
    own = SimpleNamespace(
        rigid=count, columns=np.arange(count), elastic=None, unknowns=SimpleNamespace(size=count)
    )
    R = np.linalg.qr(np.column_stack([A, y]), mode="r")
    reduced = SimpleNamespace(factors={0: R}, counts=np.array([len(A)]))
    factor = 1.7
    found = eliminate(own, reduced, sizes.Learnt(deviation, np.array([factor])), Inner())
    P = A.T @ A / factor**2 + np.diag(deviation**-2.0)
    assert found.spent == pytest.approx(np.trace(A @ np.linalg.solve(P, A.T)) / factor**2)
    np.testing.assert_allclose(found.x, np.linalg.solve(P, A.T @ y / factor**2))


def test_the_cost_of_compliances_counts_all_that_is_left(kr500, campaign, rng):
    """F_M of a solution is the length of all rows that were eliminated to, over the same share."""
    own = metric(cad_prior(kr500.arm), kr500.vjm, joints_only(kr500.arm))
    term = reduce(kr500.vjm, own.structure, campaign.identification).terms[0]
    n, equations, share = own.structure.n, 90, np.sqrt(30)
    T = share * np.zeros((n + 3, n + 1))
    T[:n, :n], T[:n, n], T[n:, n] = share * term.R, share * term.z, rng.normal(size=3)
    estimate, _ = _compliances(own, T, Inner("none", Strength(0.5)), equations)
    whole = np.linalg.norm(T[:, :n] @ estimate.pi - T[:, n])
    assert estimate.f_m == pytest.approx(whole / share)


def test_a_calibrations_covariance_and_information_are_those_of_its_rows(calibrated):
    """The root's rigid part is information and priors; compliances are told in the metric of their prior."""
    own, r = calibrated.own, calibrated.own.rigid
    root = calibrated.root
    precision = calibrated.information[np.ix_(own.columns[:r], own.columns[:r])]
    held = calibrated.chosen.learnt.deviation[own.columns[:r]] ** -2.0
    whole = precision + np.diag(held)
    size = np.sqrt(np.diag(whole))
    inside = root[:r, :r].T @ root[:r, :r]
    np.testing.assert_allclose(inside / size / size[:, None], whole / size / size[:, None], atol=1e-6)
    M = block_diag(np.eye(r), own.elastic.L)
    back = np.linalg.solve(M, np.eye(len(M)))
    dense = np.linalg.inv(back.T @ (root.T @ root) @ back)
    W = deviations_root(calibrated)
    scale = np.sqrt(np.diag(dense))
    np.testing.assert_allclose(W @ W.T / scale / scale[:, None], dense / scale / scale[:, None], atol=1e-6)


def test_a_frame_goes_with_the_arm_as_the_precision_of_a_calibration_couples_them(calibrated):
    """Given the arm its covariance is P_ff^-1, and it moves by P_ff^-1 P_fa with what the arm is off."""
    f, root = calibrated.own.unknowns.starts["geometry"], calibrated.root
    P = root.T @ root
    found = placed(calibrated, calibrated.series[0])
    size = np.sqrt(np.diag(P)[:f])
    dense = np.linalg.inv(P[:f, :f] / size / size[:, None]) / size / size[:, None]
    scale = np.sqrt(np.diag(dense))
    np.testing.assert_allclose(
        found.covariance / scale / scale[:, None], dense / scale / scale[:, None], atol=1e-6
    )
    taken = dense @ P[:f, f:]
    np.testing.assert_allclose(found.taken, taken, rtol=1e-4, atol=1e-6 * np.abs(taken).max())


def errors_of(kr500):
    """A state whose joints have play and stiffen, and its torques."""
    weights = read_weights(kr500.arm)
    errors = JointErrors(play=True, stiffening=True)
    state = nominal(kr500.vjm, weights, np.array([9e3, 8e3, 3e3, 5e2, 4e2, 2e2]))
    return replace(state, errors=errors, n=np.tile([3e-5, 2e-5], (6, 1)), C_theta=kr500.arm.C_theta)


def test_play_and_stiffening_follow_the_torque_of_their_own_joint(kr500):
    state = errors_of(kr500)
    q, wrench, point = Q[None], np.array([[900.0, -700, 400, 50, 60, 70]]), np.array([[0.1, 0.2, 0.3]])
    bent = chain(kr500.vjm, q)
    own = loads(bent, state.weights, wrench, point)[-6:]
    phi = basis(state.errors, kr500.arm, q, own, state.torque_scale)
    assert np.ptp(phi, axis=0).min() > 0.01  # no two joints alike
    np.testing.assert_allclose(tell(state, q, wrench, point).phi, phi, rtol=1e-6)


@pytest.mark.parametrize("joint", range(6))
def test_rows_of_errors_that_follow_torque_are_differences_of_the_bent_arm(kr500, joint):
    """Sizes of play and stiffening are unsure: the tip moves as the rows of the interval say."""
    structure = all153(kr500.arm)
    own = errors_of(kr500)
    spread = Linearised(
        structure.entries(own.C_theta), np.eye(153), np.zeros((0, 153)), np.ones(153), np.inf, 0.0,
        on_boundary=False,
    )  # fmt: skip
    base = of_compliances(bending(kr500.vjm, own.C_theta, own.weights), structure, spread, About("made up"))
    model = replace(base, state=own, absolute=True)
    model = replace(model, columns=np.arange(model.unknowns.size))
    load, tip = (
        Load(np.array([900.0, 1500, -700, 0, 0, 0]), np.array([0.2, 0.0, 0.1])),
        np.array([0.2, 0, 0.1]),
    )
    found = rows_between(model, Stand(Q[None], [load]), None, tip[None])[0, 0]
    for k in range(2):
        column, step = model.unknowns.starts["errors"] + 2 * joint + k, 1e-5
        tips = []
        for sign in (1, -1):
            n = own.n.copy()
            n[joint, k] += sign * step
            tips.append(rest(replace(own, n=n), Q[None], [load]).at(tip)[0])
        slope = (tips[0] - tips[1]) / (2 * step)
        assert np.abs(slope - found[:, column]).max() < 0.03 * np.abs(slope).max() + 1e-6


def test_a_force_at_a_lever_is_the_force_and_its_moment_at_the_tool(kr500):
    structure = all153(kr500.arm)
    spread = Linearised(
        structure.entries(kr500.arm.C_theta), np.eye(153), np.zeros((0, 153)), np.ones(153), np.inf, 0.0,
        on_boundary=False,
    )  # fmt: skip
    state = bending(kr500.vjm, kr500.arm.C_theta, read_weights(kr500.arm))
    model = of_compliances(state, structure, spread, About("made up"))
    force, at = np.array([900.0, 1500, -700]), np.array([0.2, -0.3, 0.1])
    _, R = tool_pose(kr500.vjm, Q[None])
    moment = np.cross(R[0] @ at, force)
    there = extent(model, Q[None], [Load(np.r_[force, 0, 0, 0], at)])
    here = extent(model, Q[None], [Load(np.r_[force, moment], np.zeros(3))])
    assert there.moment == pytest.approx(here.moment)
    assert there.moment == pytest.approx(np.linalg.norm(moment))


def test_readings_are_doubted_by_the_covariance_of_their_prior(kr500, campaign):
    """Template entries by u, couplings by c, what joints do beyond springs, noise: all rows as they are."""
    own = metric(cad_prior(kr500.arm), kr500.vjm, mgco68(kr500.arm))
    found = learnt(kr500.vjm, own, campaign.identification)
    G = found.read.A.reshape(-1, own.structure.n) @ found.metric.L
    seen = evidence(reduce(kr500.vjm, own.structure, campaign.identification), own)
    s, (u, c, kappa) = np.exp(found.h[: seen.blocks])[seen.block], np.exp(found.h[-3:])
    D = s * np.where(found.metric.couplings, c, u)
    assert abs(u / c - 1) > 0.1
    A = allowed(kr500.vjm, campaign.identification, own.structure.matrix(found.pi))
    dense = G * D**2 @ G.T + A @ A.T + kappa**2 * np.eye(len(G))
    inverse = np.eye(len(G)) / found.misfit**2 - found.shared @ found.shared.T
    np.testing.assert_allclose(inverse @ dense, np.eye(len(G)), atol=1e-5)


def test_what_is_unsure_turns_with_the_readings_into_the_base(campaign, rng):
    """The soft direction of a reading lies where a shift of the reading along it goes."""
    R = Rotation.from_euler("xyz", [0.4, -0.9, 2.1]).as_matrix()
    data = campaign.identification
    soft = rng.normal(size=3)
    soft /= np.linalg.norm(soft)
    C = SIGMA**2 * (np.eye(3) + 50 * np.outer(soft, soft))
    precision = np.tile(np.linalg.inv(C), (data.runs, len(data.markers), 1, 1))
    there = replace(data, precision=precision)
    station = 1 if data.station is None else int(data.station[0])
    move, sure = np.array([1.0, 2, 3]), np.zeros((6, 6))
    found = SimpleNamespace(frames=(Frame(station, R, move, sure),))
    here, shifted = (in_base(found, replace(there, after=there.after + by * soft)) for by in (0, 1e-3))
    way = (shifted.after - here.after)[0, 0] / 1e-3
    values, vectors = np.linalg.eigh(np.linalg.inv(here.precision[0, 0]))
    assert abs(vectors[:, -1] @ way) == pytest.approx(1, abs=1e-9)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(C), rtol=1e-9)
    A = rng.normal(size=(6, 6))
    about = 1e-10 * A @ A.T  # turn, then move, of the frame
    doubted = in_base(SimpleNamespace(frames=(Frame(station, R, move, about),)), there)
    d = here.deflection[0, 0]
    turns = np.column_stack([np.cross(axis, d) for axis in np.eye(3)])  # a turn moves what is seen across it
    more = np.linalg.inv(doubted.precision[0, 0]) - np.linalg.inv(here.precision[0, 0])
    wanted = turns @ about[:3, :3] @ turns.T
    np.testing.assert_allclose(more, wanted, atol=1e-6 * np.abs(wanted).max())


def test_moves_of_a_learnt_prior_are_differences_of_its_fit(kr500, campaign):
    """How far a standard deviation of what is learnt moves the fit: by steps of another size."""
    own = metric(cad_prior(kr500.arm), kr500.vjm, mgco68(kr500.arm))
    seen = evidence(reduce(kr500.vjm, own.structure, campaign.identification), own)
    h, step = seen.start, 1e-3
    covariance, moves = _left_open(seen, h)
    J = []
    for e in np.eye(len(h))[: len(h) - 1]:
        further, nearer = (_mean(seen, end, weigh(seen, end)) for end in (h + step * e, h - step * e))
        J.append((further - nearer) / (2 * step))
    dense = np.transpose(J) @ covariance @ np.array(J)
    np.testing.assert_allclose(moves.T @ moves, dense, atol=1e-3 * np.abs(dense).max())


def test_the_fit_of_a_learnt_prior_is_the_posterior_mean_of_its_widths(kr500, campaign):
    """x = s e + D A^T (kappa^2 + A D A^T)^-1 (y - A s e), D of templates by u and of couplings by c."""
    own = metric(cad_prior(kr500.arm), kr500.vjm, mgco68(kr500.arm))
    seen = evidence(reduce(kr500.vjm, own.structure, campaign.identification), own)
    h = seen.start + np.linspace(-0.5, 0.5, len(seen.start))
    s, (u, c, kappa) = np.exp(h[: seen.blocks])[seen.block], np.exp(h[-3:])
    D, expected = np.diag((s * np.where(own.couplings, c, u)) ** 2), s * own.expected
    S = kappa**2 * np.eye(len(seen.y)) + seen.A @ D @ seen.A.T
    mean = expected + D @ seen.A.T @ np.linalg.solve(S, seen.y - seen.A @ expected)
    np.testing.assert_allclose(_mean(seen, h, weigh(seen, h)), mean, rtol=1e-6, atol=1e-9)


def test_scales_are_ratios_to_their_kind_as_sure_as_the_difference_of_their_logarithms(kr500, campaign, rng):
    own = metric(cad_prior(kr500.arm), kr500.vjm, mgco68(kr500.arm))
    seen = evidence(reduce(kr500.vjm, own.structure, campaign.identification), own)
    h, A = rng.normal(size=len(seen.start)), rng.normal(size=(len(seen.start) - 1,) * 2)
    C, K = A @ A.T, seen.blocks
    of = [(k, K + kind) for k, kind in enumerate(seen.kind)] + [(K + 1, K)]  # last the joints over the links
    for scale, (i, j) in zip(_scales(seen, h, C), of, strict=True):
        assert scale.factor == pytest.approx(np.exp(h[i]) / np.exp(h[j]))
        assert scale.deviation == pytest.approx(np.sqrt(C[i, i] + C[j, j] - 2 * C[i, j]))


def test_compliances_of_a_coupled_prior_vary_as_their_metric_says(rng):
    """x = M z with M of the rigid unknowns and of the metric: covariance M (root^T root)^-1 M^T."""
    root, L = (
        np.triu(rng.normal(size=(7, 7))) + 3 * np.eye(7),
        np.tril(rng.normal(size=(4, 4))) + 2 * np.eye(4),
    )
    own = SimpleNamespace(rigid=3, columns=np.arange(7), elastic=SimpleNamespace(L=L))
    W = deviations_root(SimpleNamespace(own=own, root=root))
    M = block_diag(np.eye(3), L)
    np.testing.assert_allclose(W @ W.T, M @ np.linalg.inv(root.T @ root) @ M.T, rtol=1e-9)


def test_a_prior_that_is_hardly_believed_takes_no_bound_from_what_readings_show(kr500, campaign, rng):
    """Directions that neither tells have none; deflections of the runs that were read have one."""
    data = replace(campaign.identification, sigma=1e-8)
    own = metric(cad_prior(kr500.arm), kr500.vjm, all153(kr500.arm))
    regression = reduce(kr500.vjm, own.structure, data)
    found = linearise(fit_reduced(regression, "none", Belief(own, Strength(1e6))))
    where, points = chain(kr500.vjm, data.q), marker_points(kr500.vjm, data.markers)
    rows = observation(where, own.structure, data.wrench, data.point, points).reshape(-1, own.structure.n)
    assert len(found.unseen) > 0
    assert np.isfinite(found.deviations(rows)).all()
    assert np.isinf(found.deviations(rng.normal(size=(5, own.structure.n)) / found.scale)).all()


def test_an_interval_is_as_wide_as_noise_by_the_normal_and_the_prior_by_students_distribution(rng):
    """In quadrature: neither hides the other, and each alone is its own quantile."""
    noise, prior = rng.normal(size=(2, 4, 6))
    own = Linearised(
        np.zeros(6),
        np.vstack([noise, prior]),
        np.zeros((0, 6)),
        np.ones(6),
        3.0,
        0.0,
        on_boundary=False,
        heavy=4,
    )
    a = rng.normal(size=(5, 6))
    widths = [f.ppf(0.95) * np.linalg.norm(a @ x.T, axis=1) for f, x in ((norm, noise), (student(3), prior))]
    np.testing.assert_allclose(own.half_widths(a, 0.9), np.hypot(*widths))
