"""The equations of a calibration and how sure they leave it, by the book: dense covariances, evidence."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation
from unsure import unsure_everywhere

from testbench.data.dataset import Series, select_rows
from testbench.identify.absolute import evidence as sizes
from testbench.identify.absolute.align import (
    Noise,
    align_all,
    combine_repeated_rows,
    estimate_model_error,
    mean_stated_variances,
    repeated_rows,
    single_reading_noise,
    unknowns_of,
    whitening_matrices,
)
from testbench.identify.absolute.choose import predictive_deviance
from testbench.identify.absolute.evidence import ErrorScales, moved_mount, solve_step
from testbench.identify.absolute.fit import (
    MAX_INTERMEDIATE_ROWS,
    MIN_SERIES_ROWS,
    CalibrationOptions,
    calibrate,
    posterior_of_calibration,
    thin_series,
)
from testbench.identify.absolute.posterior import (
    covariance_root,
    fit_frame_and_mount,
    predict_series,
    register_with_known_frame,
)
from testbench.identify.absolute.state import (
    ErrorPattern,
    Mount,
    Unknowns,
    error_pattern_basis,
    error_pattern_coefficients,
    find_error_pattern,
    joint_equilibrium,
    moved_frame,
    nominal_state,
    series_equilibrium,
    shift_fourier_coefficients,
)
from testbench.identify.equations import series_equations
from testbench.identify.hierarchy import STUDENT_DOF, STUDENT_SCALE, solve_normal_equations
from testbench.identify.posterior import ArmModel, ModelOrigin, Posterior
from testbench.identify.prior import PriorUncertainty, cad_prior
from testbench.identify.registration import READING_LOSS, SQUARED_LOSS, Frame
from testbench.identify.regression import Linearisation, ReducedReadings, SeriesBlock, whitened_rows
from testbench.model.kinematics import BACKLASH_SMOOTHING, ORDER_BANDS, JointErrorTerms
from testbench.model.kinematics import joint_error_basis as errors_of
from testbench.model.load import Load, read_body_masses
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import tool_poses
from testbench.workflows.absolute import DRIFT, with_drift
from testbench.workflows.absolute_campaign import REAL_ARM, AbsoluteCampaign, simulate_series
from testbench.workflows.calibration_numbers import joint_compliances

PAIRS = AbsoluteCampaign(
    poses=25, masses=(0.0, 230.0, 460.0), orientations=True, sigma_rotation=1e-4, disturbances=REAL_ARM
)
S = 2e-4  #: What a model leaves open [m, rad].
SIGMA, TURN, OPEN, OPEN_TURN = 20e-6, 3e-5, 35e-6, 5e-5
R = Rotation.from_euler("xyz", [0.4, -0.9, 2.1]).as_matrix()


@pytest.fixture(scope="module")
def series(kr500):
    """25 poses of an arm, three loads in each."""
    return simulate_series(kr500, PAIRS, 11)[0]


def test_a_step_of_frame_and_mount_takes_away_what_its_columns_say(kr500, series, rng):
    """Of a target that is turned on the tool by any angle."""
    W = Rotation.from_rotvec((0.4, -1.2, 0.7)).as_matrix()
    one = replace(series[0], rotation=series[0].rotation @ W)
    state = align_all(nominal_state(kr500.vjm, read_body_masses(kr500.arm), np.ones(6)), (one,))
    unknowns = unknowns_of(kr500.vjm, (one,), JointErrorTerms(), joints_only(kr500.arm))
    step = 1e-5 * rng.standard_normal(unknowns.first_columns["geometry"])
    frame, mount = moved_frame(state.frame(one), step[:6]), moved_mount(state.mount(one), step[6:])
    rows = series_equations(unknowns, state, one)
    after = series_equations(
        unknowns, replace(state, frames={one.frame: frame}, mounts={one.mount: mount}), one
    )
    left = rows[:, :, -1] - np.einsum("sxcr,c->sxr", rows[:, :, : len(step)], step)
    np.testing.assert_allclose(after[:, :, -1], left, rtol=0, atol=1e-7)  # of 1e-5


@pytest.mark.parametrize("factor", [0.7, 0.2])
def test_a_reading_alone_scatters_as_the_mean_of_its_pose_says(series, factor):
    """Less may be left open than was thought; readings are better than said only where nothing is."""
    one = replace(series[0], sigma=SIGMA, sigma_rotation=TURN)
    found = single_reading_noise(
        Noise(S, S, np.array([factor, factor, 1.0, 1.0])), *mean_stated_variances([one])
    )
    for kind, (own, opened) in enumerate(
        ((SIGMA, found.position_model_error), (TURN, found.rotation_model_error))
    ):
        of_means = factor**2 * (own**2 + 3 * S**2)
        if of_means > own**2:
            assert found.factor[kind] == pytest.approx(1)
            assert own**2 + 3 * opened**2 == pytest.approx(of_means)
        else:
            assert (opened, found.factor[kind]) == (0, pytest.approx(np.sqrt(of_means) / own))


@pytest.mark.parametrize("kind", ["play", "stiffening"])
def test_a_joint_gives_way_to_its_own_torque(kr500, kind, rng):
    """Torques from the joints' axes and a force at the tool, of an arm without weight that does not bend."""
    vjm = kr500.vjm
    n = 1e-3 * (1 + np.arange(6.0))
    bare = nominal_state(vjm, read_body_masses(kr500.arm), np.full(6, 1000.0))
    light = replace(bare.body_masses, mass=np.zeros_like(bare.body_masses.mass))
    state = replace(
        bare, body_masses=light, error_terms=JointErrorTerms(**{kind: True}), error_coefficients=n[:, None]
    )
    q = np.array([[0.3, -1.2, 1.6, 0.3, -0.5, 0.1]])
    wrench = np.concatenate([rng.normal(0, 2e3, (1, 3)), np.zeros((1, 3))], axis=1)
    step = 1e-6 * np.eye(6)
    tip = [np.array([tool_poses(vjm, q + sign * one)[0][0] for one in step]) for sign in (1, -1)]
    torque = (tip[0] - tip[1]) @ wrench[0, :3] / 2e-6 / 1000
    turned = n * (np.tanh(torque / 0.1) if kind == "play" else torque * np.abs(torque))
    where = joint_equilibrium(state, q, [Load(wrench, np.zeros((1, 3)))]).chain
    np.testing.assert_allclose(where.tool_position, tool_poses(vjm, q + turned)[0], rtol=0, atol=1e-6)


def test_a_posterior_is_what_the_readings_tell_and_a_prior_which_ties_geometry_to_nothing(kr500, series):
    """So is the covariance of which intervals are made, in the units of the arm."""
    options = CalibrationOptions(
        max_order=2,
        used_errors=frozenset({"joint springs", "links"}),
        prior_uncertainty=PriorUncertainty(3.0),
    )
    found = calibrate(kr500.vjm, [series[0]], cad_prior(kr500.arm), options)
    # Or nothing would tell it from its square.
    assert np.abs(found.selection.error_scales.noise_factor - 1).max() > 0.02
    own, root = found.active_unknowns, posterior_of_calibration(found).covariance_root
    precision, r = np.linalg.inv(root.T @ root), own.n_rigid
    size = np.sqrt(np.diag(precision))
    prior = (precision - found.information[np.ix_(own.columns, own.columns)]) / size / size[:, None]
    expected = np.diag((found.selection.error_scales.deviation[own.columns[:r]] * size[:r]) ** -2.0)
    np.testing.assert_allclose(prior[:r, :r], expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose(prior[:r, r:], 0, atol=1e-6)


def covariances(rng, *shape):
    """Of readings, one axis much softer than the others [m^2]."""
    A = rng.normal(size=(*shape, 3, 3))
    return SIGMA**2 * (A @ A.swapaxes(-1, -2) + 0.2 * np.eye(3))


def still(rows, rng, **more):
    """Readings of an arm that rests anywhere, a pose a row."""
    every, own = np.arange(rows), {"q": rng.uniform(-1.5, 1.5, (rows, 6))}
    own |= {"wrench": np.zeros((rows, 6)), "point": np.zeros((rows, 3))}
    own |= {"position": np.ones((rows, 1, 3)), "sigma": SIGMA, "pose_id": every}
    return Series("s", ("P1",), "f", "t", every, **(own | more))


@pytest.mark.parametrize("alike", [True, False], ids=["one sigma", "a covariance each"])
def test_readings_with_covariances_and_orientations_are_whitened_in_base_axes(rng, alike):
    """Of one pose the mean of its covariances; k s^2 of what the model leaves open on the mean of k alone."""
    k, poses = 3, 4
    C = np.tile(SIGMA**2 * np.eye(3), (poses * k, 1, 1, 1)) if alike else covariances(rng, poses * k, 1)
    turned = {"rotation": np.tile(np.eye(3), (poses * k, 1, 1)), "sigma_rotation": TURN}
    pose = np.repeat(np.arange(poses), k)
    series = still(
        poses * k, rng, pose_id=pose, **turned, **({} if alike else {"precision": np.linalg.inv(C)})
    )
    noise = Noise(OPEN, OPEN_TURN, np.array([1.1, 1.2, 1.3, 1.4]))
    W, kinds = whitening_matrices(series, noise, R, repeated_rows(series))
    H = combine_repeated_rows([np.arange(k)[None]], np.eye(k)).T
    np.testing.assert_allclose(H @ H.T, np.eye(k), atol=1e-12)
    open_ = np.diag(H @ np.ones((k, k)) @ H.T)
    for p in range(poses):
        rows = np.flatnonzero(pose == p)
        own = R.T @ C[rows, 0].mean(axis=0) @ R
        for row, times in zip(rows, open_, strict=True):
            position, turn = noise.factor[kinds[:, row]]
            dense = position**2 * (own + times * OPEN**2 * np.eye(3))
            np.testing.assert_allclose(W[0, row] @ dense @ W[0, row].T, np.eye(3), atol=1e-9)
            dense = turn**2 * (TURN**2 + times * OPEN_TURN**2) * np.eye(3)
            np.testing.assert_allclose(W[1, row] @ dense @ W[1, row].T, np.eye(3), atol=1e-9)


def test_readings_of_a_pose_pull_no_harder_than_the_wildest_of_them(state, kr500, rng):
    """Each by its distance in its own covariance; means and differences mix those of a pose."""
    C, noise = covariances(rng, 6, 1), Noise(OPEN, OPEN_TURN, np.array([1.1, 1, 1, 1]))
    series = read_by(state, still(6, rng, pose_id=np.repeat([0, 1], 3), precision=np.linalg.inv(C)))
    unknowns = unknowns_of(kr500.vjm, (series,), JointErrorTerms(), joints_only(kr500.arm))
    far, own = rng.normal(size=(6, 3, 1)), noise.factor[0] ** 2 * (C[:, 0] + OPEN**2 * np.eye(3))
    far /= np.sqrt((far * np.linalg.solve(own, far)).sum(axis=1, keepdims=True))
    far *= READING_LOSS.threshold / np.array([1.0, 0.2, 0.6, 0.9, 1.0, 1.0])[:, None, None]
    series = replace(series, position=series.position + far.swapaxes(1, 2))
    held, whole = (
        whitened_rows(Linearisation(unknowns, state, noise, loss), series)
        for loss in (READING_LOSS, SQUARED_LOSS)
    )
    np.testing.assert_array_equal(held[1], [[0, 2, 2, 0, 2, 2]])
    np.testing.assert_allclose(held[0], whole[0] * np.sqrt(np.repeat([0.2, 0.9], 3)))


def drawn_at_random(rng, free=2, small=6, large=50, equations=(120, 80)):
    """A linear problem of two kinds of equations, and of three groups of unknowns beside free ones."""
    count = free + small + 2 * large
    play = sizes.DEFAULT_ERROR_SCALES["play"]
    band = sizes.DEFAULT_ERROR_SCALES["harmonics"]
    groups = [("play", free + np.arange(small))]
    groups += [("harmonics", free + small + k * large + np.arange(large)) for k in range(2)]
    unknowns = SimpleNamespace(
        prior_groups=groups,
        size=count,
        undetermined_frames=frozenset(),
        frame_deviations={},
        first_columns={"geometry": free},
    )
    own = SimpleNamespace(n_rigid=count, columns=np.arange(count), compliance_prior=None, unknowns=unknowns)
    unit = np.r_[np.ones(free), np.full(small, play), np.full(2 * large, band)]
    x = unit * rng.normal(size=count) * np.repeat([1, 3, 0.4, 1.5], (free, small, large, large))
    A = [rng.normal(size=(n, count)) / unit for n in equations]
    y = [a @ x + s * rng.normal(size=len(a)) for a, s in zip(A, (1.6, 0.7), strict=True)]
    return own, A, y


def test_learnt_sizes_and_scatters_are_those_of_greatest_evidence(rng):
    """The marginal likelihood of all equations, and of what is imagined beside them, is flat there."""
    own, A, y = drawn_at_random(rng)
    groups, counts = own.unknowns.prior_groups, np.array([len(a) for a in A])
    lines = [np.column_stack(pair) for pair in zip(A, y, strict=True)]
    S, learnt = np.array([one.T @ one for one in lines]), sizes.default_error_scales(own.unknowns, 2)
    reduced = SimpleNamespace(total_gram_matrices=S, n_equations=counts)
    learnt = sizes.learn_error_scales(own, reduced, learnt)
    a, b = np.vstack(A), np.concatenate(y)

    def loss(h):
        factor, size = np.exp(h[:2]), np.exp(h[2:])
        deviation = np.full(a.shape[1], 30.0)  # of the free ones, which are of order one
        found = sizes.PSEUDO_EQUATIONS * (np.log(factor) + 1 / (2 * factor**2)).sum()
        for d, (kind, at) in zip(size, groups, strict=True):
            large = len(at) > sizes.MAX_SMALL_GROUP
            usual = sizes.DEFAULT_ERROR_SCALES[kind] * (sizes.LARGE_GROUP_SIZE_RATIO if large else 1.0)
            found += (1.0 if large else sizes.PSEUDO_OBSERVATIONS) * (np.log(d) + usual**2 / (2 * d**2))
            deviation[at] = d
        found += (
            (STUDENT_DOF + 1) / 2 * np.log1p((np.log(size[2] / size[1]) / STUDENT_SCALE) ** 2 / STUDENT_DOF)
        )
        C = np.diag(np.repeat(factor**2, counts)) + a * deviation**2 @ a.T
        return found + np.linalg.slogdet(C)[1] / 2 + b @ np.linalg.solve(C, b) / 2

    h = np.log(np.r_[learnt.noise_factor, [learnt.deviation[at[0]] for _, at in groups]])
    step = 1e-3
    slope, bend = np.transpose(
        [
            ((loss(h + e) - loss(h - e)) / (2 * step), (loss(h + e) - 2 * loss(h) + loss(h - e)) / step**2)
            for e in step * np.eye(5)
        ]
    )
    assert (bend > 1).all()
    assert np.abs(slope / bend).max() < 1e-3  # a step to where it is flat, of logarithms


@pytest.fixture(scope="module")
def state(kr500):
    """The arm as drawn, which a tracker sees turned and far away."""
    found = nominal_state(kr500.vjm, read_body_masses(kr500.arm), np.ones(6))
    mount = Mount(np.array([[0.2, -0.1, 0.3]]), np.eye(3), ("P1",))
    return replace(found, frames={"f": Frame(R, np.array([3.0, -2, 1]))}, mounts={"t": mount})


def read_by(state, series):
    """The series with the targets where the state has them."""
    told = series_equilibrium(state, series)
    frame = state.frame(series)
    x = told.chain.tool_points_in_world(state.mount(series).points) @ frame.rotation.T + frame.translation
    return replace(series, position=x)


@pytest.mark.parametrize("share", [1.0, 0.7])
def test_what_is_left_open_is_found_beside_readings_of_any_covariance(state, rng, share):
    """Of 4000 readings within 5 %: it is known to 1.5 %. Unknowns that spend equations shorten residuals."""
    rows, s = 4000, 60e-6
    C = covariances(rng, rows, 1)
    series = read_by(state, still(rows, rng, precision=np.linalg.inv(C)))
    noise = (np.linalg.cholesky(C) @ rng.normal(size=(rows, 1, 3, 1)))[..., 0]
    noise = np.sqrt(share) * (noise + s * rng.normal(size=noise.shape))
    found = estimate_model_error(state, [replace(series, position=series.position + noise)], share)
    assert found.position_model_error == pytest.approx(s, rel=0.05)


@pytest.mark.parametrize("alike", [True, False], ids=["one sigma", "a covariance each"])
def test_a_new_series_is_as_sure_as_its_rows_and_the_arm_leave_it(state, kr500, rng, alike):
    """Readings minus model are linear in what nobody knows: the arm, and noise here and before."""
    structure = joints_only(kr500.arm)
    L = 1e-7 * (np.tril(rng.normal(size=(6, 6))) + 2 * np.eye(6))  # joints give way together
    root = np.triu(rng.normal(size=(36, 36))) + 4 * np.eye(36)
    noise = Noise(OPEN, OPEN_TURN, np.array([0.8, 1, 1, 1]))
    arm = Posterior.from_covariance_root(np.zeros(36), covariance_root(1e4 * root, L))
    model = ArmModel(state, structure, np.arange(36), arm, ModelOrigin("made up"), noise)
    C = np.tile(SIGMA**2 * np.eye(3), (20, 1, 1, 1)) if alike else covariances(rng, 20, 1)
    series = read_by(state, still(20, rng, **({} if alike else {"precision": np.linalg.inv(C)})))
    told, rest = np.arange(9), np.arange(9, 20)
    placed = fit_frame_and_mount(model, series, told)
    # the frame was there before
    again = register_with_known_frame(replace(model, state=placed.state), select_rows(series, told))
    np.testing.assert_allclose(
        again.posterior.covariance_root, placed.posterior.covariance_root, rtol=1e-6, atol=1e-12
    )
    left, covariance = predict_series(model, placed, series)
    np.testing.assert_allclose(left, 0, atol=1e-9)
    every = unknowns_of(kr500.vjm, (series,), JointErrorTerms(), structure)
    A = series_equations(every, state, series)[0, :, :-1].transpose(2, 0, 1)  # row, axis, unknown
    F, M = A[:, :, :9], A[:, :, 9:] @ block_diag(np.eye(30), L)
    S = noise.factor[0] ** 2 * (R.T @ C[:, 0] @ R + OPEN**2 * np.eye(3))
    P = np.linalg.inv(S[told])
    frame = np.linalg.inv(np.einsum("rxa,rxy,ryb->ab", F[told], P, F[told]))
    taken = frame @ np.einsum("rxa,rxy,ryb->ab", F[told], P, M[told])  # of the arm's moves, by the frame
    V = np.linalg.inv(1e8 * root.T @ root)
    for row in rest:
        arm = M[row] - F[row] @ taken
        dense = arm @ V @ arm.T + F[row] @ frame @ F[row].T + S[row]
        np.testing.assert_allclose(covariance[row, 0], dense, rtol=1e-6, atol=1e-3 * np.trace(S[row]) / 3)


def test_of_a_series_to_come_a_model_is_less_sure_by_how_far_geometry_moves(kr500, rng):
    """Of the 30 numbers of geometry alone, each by itself."""
    model = unsure_everywhere(kr500)
    a = rng.standard_normal((3, len(model.uncertain_columns)))
    before, after = (one.posterior.covariance(a) for one in (model, with_drift(model)))
    np.testing.assert_allclose(after - before, DRIFT**2 * a[:, :30] @ a[:, :30].T, atol=1e-6 * DRIFT**2)


def test_compliances_of_joints_are_shown_in_the_units_of_their_axes(slides, rng):
    """A joint's with that of the link before it about, or along, its axis, which points anywhere."""
    vjm, structure, arm = slides.vjm, all153(slides.arm), slides.arm
    unknowns = Unknowns(vjm, (), {}, JointErrorTerms(), structure)
    C = structure.C_theta_of(rng.normal(size=structure.n_parameters))
    x = np.r_[np.zeros(unknowns.first_columns["elastic"]), structure.parameters_of(C)]
    links, shown = 6 * len(arm.links), joint_compliances(SimpleNamespace(unknowns=unknowns))
    for k, (joint, (name, unit, functional)) in enumerate(zip(arm.joints, shown, strict=True)):
        first = 6 * k + (0 if joint.prismatic else 3)
        at, v = slice(first, first + 3), vjm.joint_axes_in_beam_frame[k]
        assert (name, unit) == (joint.name, "um/N" if joint.prismatic else "urad/(N m)")
        assert functional @ x == pytest.approx(C[links + k, links + k] + v @ C[at, at] @ v)
    assert np.abs(vjm.joint_axes_in_beam_frame).max() < 0.999  # no axis is one of the link's


ORDERS = tuple(range(1, 21))
ERRORS = JointErrorTerms(ORDERS, play=True)
HIGH = np.arange(3, 21)  #: Orders that a pattern may have.
K = len(HIGH)
READ, NOISE, SIZE, OWN = 200, 50e-6, 60e-6, 20e-6
PLACED = {0: (0.0, 1), 2: (1.9, -1), 3: (-2.4, 1)}  #: Turn [rad] and sense of the joints that share it.


def phi(q):
    """Sines, then cosines of all high orders, (rows, 2 K)."""
    return np.hstack([np.sin(np.outer(q, HIGH)), np.cos(np.outer(q, HIGH))])


def test_held_out_readings_are_as_probable_as_by_their_dense_covariance(rng):
    A, y, L = rng.normal(size=(9, 4)), rng.normal(size=9), rng.normal(size=(4, 4))
    x_0, V = rng.normal(size=4), L @ L.T
    H = np.linalg.inv(V)
    others = solve_normal_equations(np.block([[H, (H @ x_0)[:, None]], [(H @ x_0)[None], np.zeros((1, 1))]]))
    rows = np.column_stack([A, y])
    C, r = np.eye(9) + A @ V @ A.T, y - A @ x_0
    dense = r @ np.linalg.solve(C, r) + np.linalg.slogdet(C)[1]
    assert predictive_deviance(rows.T @ rows, np.r_[others.x, -1.0], others) == pytest.approx(dense, rel=1e-9)


def test_waves_are_the_pattern_turned_and_mirrored_and_differences_that_add_up_to_none(rng):
    """Whatever joints without the pattern, low orders and other unknowns are."""
    pattern = ErrorPattern(tuple(PLACED), *map(tuple, zip(*PLACED.values(), strict=True)))
    first, size = 7, 7 + 4 * ERRORS.n_coefficients + 5
    B, z = error_pattern_basis(pattern, ERRORS, first, size).toarray(), rng.normal(size=size)
    np.testing.assert_allclose((B.T @ B) / np.diag(B.T @ B), np.eye(size), atol=1e-12)
    at = first + ERRORS.n_coefficients * np.arange(4)[:, None] + error_pattern_coefficients(ERRORS)
    x, rest = B @ z, np.setdiff1d(np.arange(size), at[list(PLACED)])
    np.testing.assert_allclose(x[rest], z[rest])
    # its inverse is its transpose
    off = [shift_fourier_coefficients(np.eye(2 * K), *PLACED[j], HIGH) @ x[at[j]] for j in PLACED]
    np.testing.assert_allclose(np.mean(off, axis=0), z[at[0]], atol=1e-12)
    assert np.sum((off - z[at[0]]) ** 2) == pytest.approx(np.sum(z[at[[2, 3]]] ** 2))
    f, q = rng.normal(size=2 * K), rng.uniform(-3, 3, 30)
    for turn, sense in PLACED.values():
        np.testing.assert_allclose(
            phi(q) @ shift_fourier_coefficients(f, turn, sense, HIGH), sense * phi(sense * q + turn) @ f
        )


def told(errors, ranges, rng):
    """What readings of joints in these ranges tell of their waves."""
    found = []
    for x, (low, high) in zip(errors, ranges, strict=True):
        A = phi(rng.uniform(low, high, READ)) / NOISE
        found.append((A.T @ A, A.T @ (A @ x + rng.standard_normal(READ))))
    return found


def sought(readings):
    return find_error_pattern(readings, np.full(2 * K, OWN**2), np.full(2 * K, SIZE**2), HIGH)


@pytest.mark.parametrize("seed", [1000, 1001])
def test_joints_that_share_a_pattern_are_found_with_their_turns_and_no_others(seed):
    """The one with errors of its own, and the one that was hardly turned, are left out."""
    rng = np.random.default_rng(seed)
    f = SIZE * rng.standard_normal(2 * K)
    errors = [
        shift_fourier_coefficients(f, *PLACED.get(j, (1.0, 1)), HIGH) + OWN * rng.standard_normal(2 * K)
        for j in range(5)
    ]
    errors[1] = SIZE * rng.standard_normal(2 * K)
    pattern = sought(told(errors, [(-2.5, 2.5), (-2.5, 2.5), (-1.5, 3.5), (-3.5, 1.5), (0.5, 0.6)], rng))
    assert pattern.joints == tuple(PLACED)
    assert pattern.signs == tuple(sense for _, sense in PLACED.values())
    np.testing.assert_allclose(pattern.shifts, [turn for turn, _ in PLACED.values()], atol=np.radians(3))
    rng = np.random.default_rng(seed)
    errors = SIZE * rng.standard_normal((4, 2 * K))
    assert sought(told(errors, [(-3, 3)] * 4, rng)) is None
    lines = errors * np.isin(np.tile(HIGH, 2), (5, 10))  # a gear's own orders look alike at many turns
    assert sought(told(lines, [(-3, 3)] * 4, rng)) is None


def test_what_is_found_by_a_pattern_is_as_sure_in_si_units(rng):
    """Unknowns and precision by normal equations in which the prior alone knows the pattern.

    They spend the trace of the hat matrix: free ones a whole equation each.
    """
    pattern = ErrorPattern((0, 1), (0.0, 1.1), (1, -1))
    errors = JointErrorTerms(tuple(range(1, 5)))
    size = 2 * errors.n_coefficients
    B, A, y = error_pattern_basis(pattern, errors, 0, size), rng.normal(size=(40, size)), rng.normal(size=40)
    deviation, factor = np.r_[rng.uniform(0.5, 2.0, size - 3), [np.inf] * 3], 1.7
    own = SimpleNamespace(
        n_rigid=size,
        columns=np.arange(size),
        compliance_prior=None,
        unknowns=SimpleNamespace(size=size, equation_basis=B),
    )
    R = np.linalg.qr(np.column_stack([A, y]), mode="r")
    plain = ReducedReadings((0,), (SeriesBlock(0, (R.T @ R)[None], np.array([40])),), {0: R})
    found = solve_step(own, plain.in_basis(B), ErrorScales(deviation, np.array([factor])))
    back = np.linalg.inv(B.toarray())
    P = A.T @ A / factor**2 + back.T @ np.diag(deviation**-2.0) @ back
    np.testing.assert_allclose(found.precision_root.T @ found.precision_root, P, atol=1e-9)
    np.testing.assert_allclose(found.x, np.linalg.solve(P, A.T @ y / factor**2))
    assert found.degrees_of_freedom == pytest.approx(np.trace(A @ np.linalg.solve(P, A.T)) / factor**2)
    assert not np.tril(found.precision_root, -1).any()
    [part] = plain.in_basis(B).blocks
    np.testing.assert_allclose(part.gram_matrices[0][:-1, :-1], B.T @ (A.T @ A) @ B, atol=1e-9)


def longer(one, times):
    """The same readings again and again, two a pose."""
    tiled = {x: np.concatenate([getattr(one, x)] * times) for x in ("q", "wrench", "position", "rotation")}
    row = np.arange(times * one.n_rows)
    return replace(one, row_id=row, pose_id=row // 2, point=np.zeros((len(row), 3)), **tiled)


def test_steps_on_the_way_take_few_rows_all_of_a_pose_and_enough_of_every_series(series):
    [one] = series
    many, huge = longer(one, 40), longer(one, 200)
    few, short = thin_series((many, one))
    assert short is one
    assert MAX_INTERMEDIATE_ROWS / 2 < few.n_rows <= MAX_INTERMEDIATE_ROWS or few.n_rows == many.n_rows
    _, count = np.unique(few.pose_id, return_counts=True)
    assert (count == 2).all()
    few, short = thin_series((huge, many))
    assert MIN_SERIES_ROWS <= short.n_rows < many.n_rows
    assert few.n_rows + short.n_rows <= 1.05 * MAX_INTERMEDIATE_ROWS
    assert set(np.unique(few.pose_id)) < set(huge.pose_id)


def test_errors_of_a_joint_together_are_those_of_every_kind_alone_in_their_order(slides, rng):
    """Against the formulas; an order belongs to the last band that begins at or below it."""
    orders, arm, runs = (1, 2, 4, 5, 7, 8, 1000), slides.arm, 9
    errors = JointErrorTerms(orders, ratio=True, play=True, stiffening=True)
    band = [max(k for k, first in enumerate(ORDER_BANDS) if first <= order) for order in orders]
    assert errors.coefficient_bands.tolist() == [*band, *band, -1, -1, -1]
    q, torque = rng.normal(size=(runs, arm.n_joints)), 100 * rng.normal(size=(arm.n_joints, runs))
    scale = np.array([50.0, 0.0, 10.0, 20.0, 30.0])
    found = errors_of(errors, arm, q, torque, scale)
    hinge = np.array([not joint.prismatic for joint in arm.joints])
    turns = np.array(orders)[:, None, None] * q.T
    pull = torque / np.where(scale > 0, scale, 1.0)[:, None]
    harmonics = np.concatenate([np.sin(turns), np.cos(turns)]) * hinge[:, None]
    expected = {
        "harmonics": harmonics,
        "ratio": q.T[None],
        "play": np.tanh(pull / BACKLASH_SMOOTHING)[None],
        "stiffening": (pull * np.abs(pull))[None],
    }
    for kind, own in expected.items():
        some = [k for k, name in enumerate(errors.coefficient_kinds) if name == kind]
        np.testing.assert_allclose(found[:, some].swapaxes(0, 1), own, rtol=0, atol=1e-9)
