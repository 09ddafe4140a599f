"""Terms of uncertainty by the book: dense covariances, hat matrices, differences, turned frames."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import norm
from scipy.stats import t as student

from testbench.campaign.absolute_truth import REAL_ARM, AbsoluteCampaign, simulate_series
from testbench.campaign.campaign import Scenario, simulate
from testbench.identify import reduce
from testbench.identify.absolute import evidence as sizes
from testbench.identify.absolute.fit import Options, calibrate
from testbench.identify.absolute.inner import Inner, eliminate
from testbench.identify.absolute.intervals import deviations_root, placed
from testbench.identify.hierarchy import _scales, evidence
from testbench.identify.intervals import Linearised, linearise
from testbench.identify.metric import Belief, metric
from testbench.identify.prior import Strength, cad_prior
from testbench.identify.regularised import fit_reduced
from testbench.identify.weighed import marker_points
from testbench.model.structure import all153, mgco68
from testbench.model.vjm import chain, observation


@pytest.fixture(scope="module")
def campaign(kr500):
    return simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=2), 5)


@pytest.fixture(scope="module")
def calibrated(kr500):
    """By readings of one arm in 60 poses."""
    asked = AbsoluteCampaign(poses=60, disturbances=REAL_ARM)
    series, _ = simulate_series(kr500, asked, 11)
    return calibrate(kr500.vjm, series, cad_prior(kr500.arm), Options(orders=2))


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
