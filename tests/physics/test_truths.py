"""The family of truths: as far from tubes as said, in agreement between MuJoCo and the model."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from testbench.arm.stiffness import Tube, check_compliance, eigenvalue_scale, tube_compliance, turned
from testbench.campaign.campaign import Scenario, simulate, stream
from testbench.campaign.models import MODELS
from testbench.campaign.perturbed_prior import FAR, PRIORS, TURN, prior_of, wrong_prior
from testbench.campaign.true_arms import (
    HELD_OUT,
    TRUTHS,
    UNEQUAL,
    coupled,
    deformed,
    distance_from_tubes,
    member,
    true_cell,
)
from testbench.errors import BenchError
from testbench.identify.evaluate import deflections
from testbench.identify.prior import cad_prior
from testbench.model.structure import TEMPLATE

TUBE = tube_compliance(Tube(1.3, 0.34, 0.31, 1.1e11, 0.26))
OFF = {"off_10": 0.1, "off_20": 0.2, "off_40": 0.4}
SEEDS = range(20)


def random_symmetric(rng):
    S = rng.standard_normal((6, 6))
    return S + S.T


def links(kr500, name, seed):
    return [link.compliance for link in TRUTHS[name](kr500.arm, stream(seed, 8)).links]


def test_the_distance_from_tubes_is_the_least_over_templates(rng):
    """By its definition |T^-1/2 C T^-1/2 - 1| / sqrt(6), searched from the tube that was deformed."""
    C = deformed(TUBE, random_symmetric(rng), 0.25)
    scale = np.array([np.sqrt(TUBE[a, a] * TUBE[b, b]) for a, b in TEMPLATE])

    def apart(x):
        T = np.zeros((6, 6))
        for (a, b), value in zip(TEMPLATE, x * scale, strict=True):
            T[a, b] = T[b, a] = value
        if np.linalg.eigvalsh(T)[0] <= 0:
            return np.inf
        root = np.linalg.cholesky(T)
        return np.linalg.norm(np.linalg.solve(root, np.linalg.solve(root, C).T) - np.eye(6)) / np.sqrt(6)

    start = np.array([TUBE[pair] for pair in TEMPLATE]) / scale
    settings = {"maxiter": 20_000, "maxfev": 20_000, "xatol": 1e-9, "fatol": 1e-12, "adaptive": True}
    found = minimize(apart, start, method="Nelder-Mead", options=settings)
    assert found.fun < 0.9 * apart(start)  # the tube itself is not the nearest
    assert found.fun == pytest.approx(distance_from_tubes(C), rel=1e-6)


@pytest.mark.parametrize("name", OFF)
def test_links_are_as_far_from_tubes_as_their_name_says(kr500, name):
    """In their own axes exactly so, in the model's, from which they are turned, further."""
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        for link in kr500.arm.links:
            C = deformed(link.compliance, random_symmetric(rng), OFF[name])
            assert distance_from_tubes(C) == pytest.approx(OFF[name], rel=1e-5)
    found = [distance_from_tubes(C) for seed in SEEDS for C in links(kr500, name, seed)]
    assert np.median(found) > 1.2 * OFF[name]


@pytest.mark.parametrize("name", TRUTHS)
def test_every_truth_is_conservative_and_new_for_every_seed_and_comes_again(kr500, name):
    seen = set()
    for seed in SEEDS:
        found = links(kr500, name, seed)
        for C in found:
            check_compliance(C, name)
        np.testing.assert_array_equal(found, links(kr500, name, seed))
        joints = TRUTHS[name](kr500.arm, stream(seed, 8)).joints
        seen.add((*np.ravel(found), *(j.compliance for j in joints)))
        assert (joints == kr500.arm.joints) == (name != "joints")
    assert len(seen) == (1 if name == "tubes" else len(SEEDS))


def test_unequal_joints_spread_as_said(kr500):
    drawn = [
        np.log(joint.compliance / own.compliance)
        for seed in range(200)
        for joint, own in zip(
            TRUTHS["joints"](kr500.arm, stream(seed, 8)).joints, kr500.arm.joints, strict=True
        )
    ]
    assert np.std(drawn) == pytest.approx(UNEQUAL, rel=0.1)  # 1200 draws: 2 % standard error
    assert abs(np.mean(drawn)) < 0.1 * UNEQUAL * 2


@pytest.mark.parametrize("name", TRUTHS)
def test_mujoco_and_the_model_agree_to_first_order_on_every_truth(kr500, name):
    """MuJoCo's linear deflections against those of the model with the true compliances."""
    cell = true_cell(kr500, name, 3)
    assert cell.arm is kr500.arm
    assert cell.vjm is kr500.vjm
    scenario = Scenario(arm=kr500.arm.name, truth="linear", noise=False, workspace_poses=20)
    campaign = simulate(cell, scenario, seed=3)
    model = MODELS["MGCO56"](cell)
    estimate = model.estimator(cell.vjm, model.structure, campaign.identification)
    true = replace(estimate, C_theta=cell.plant.arm.C_theta)
    moved = campaign.truth.deflection
    apart = np.abs(deflections(cell.vjm, true, campaign.truth) - moved).max()
    assert apart < 1e-8 * np.abs(moved).max()
    folders = replace(estimate, C_theta=kr500.arm.C_theta)
    differs = np.abs(deflections(cell.vjm, folders, campaign.truth) - moved).max()
    assert (differs > 1e-3 * np.abs(moved).max()) == (name != "tubes")


def blocks(C):
    return [C[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] for k in range(7)]


@pytest.mark.parametrize("seed", range(5))
def test_priors_are_wrong_as_their_names_say(kr500, seed):
    cad = cad_prior(kr500.arm).C_theta
    own = {name: prior_of(kr500, name, seed).C_theta for name in PRIORS}
    base = wrong_prior(kr500, seed).C_theta
    np.testing.assert_array_equal(own["right"], cad)
    np.testing.assert_array_equal(own["scaled"], base)
    factors = [a[0, 0] / b[0, 0] for a, b in zip(blocks(own["link"]), blocks(base), strict=True)]
    assert sorted(np.round(np.log10(np.array(factors) * 1.0), 9).tolist()) in (
        [0.0] * 6 + [1.0],
        [-1.0] + [0.0] * 6,
    )
    np.testing.assert_array_equal(own["link"][42:], base[42:])
    np.testing.assert_array_equal(own["joints"][:42], base[:42])
    factor = np.diag(own["joints"])[42:] / np.diag(base)[42:]
    np.testing.assert_allclose(factor, factor[0])
    assert factor[0] in (pytest.approx(FAR), pytest.approx(1 / FAR))
    np.testing.assert_array_equal(own["uncoupled"], np.diag(np.diag(base)))
    for mine, theirs in zip(blocks(own["axes"]), blocks(base), strict=True):
        np.testing.assert_allclose(np.linalg.eigvalsh(mine[:3, :3]), np.linalg.eigvalsh(theirs[:3, :3]))
        assert distance_from_tubes(mine) > 0.1
        assert distance_from_tubes(theirs) < 1e-12


def test_priors_far_off_are_as_often_too_soft_as_too_stiff(kr500):
    soft = [
        np.diag(prior_of(kr500, "joints", seed).C_theta)[42] > np.diag(wrong_prior(kr500, seed).C_theta)[42]
        for seed in range(100)
    ]
    assert 30 < sum(soft) < 70  # four standard deviations
    hit = {
        k
        for seed in range(100)
        for k, (a, b) in enumerate(
            zip(
                blocks(prior_of(kr500, "link", seed).C_theta),
                blocks(wrong_prior(kr500, seed).C_theta),
                strict=True,
            )
        )
        if not np.allclose(a, b)
    }
    assert hit == set(range(7))


def test_turning_a_beam_turns_its_compliance(rng):
    """About its own axis a tube does not change; there and back it is what it was."""
    scale = eigenvalue_scale(TUBE)
    axis = rng.standard_normal(3)
    about = turned(TUBE, np.array([1.0, 0, 0]), 0.7)
    back = turned(turned(TUBE, axis, TURN), axis, -TURN)
    for C in (about, back):
        np.testing.assert_allclose(C / np.outer(scale, scale), TUBE / np.outer(scale, scale), atol=1e-12)
    quarter = turned(TUBE, np.array([0, 0, 1.0]), np.pi / 2)  # along y now
    assert quarter[1, 1] == pytest.approx(TUBE[0, 0])
    assert quarter[2, 3] == pytest.approx(-TUBE[2, 4])  # phi_y of before is -phi_x


@pytest.mark.parametrize("name", HELD_OUT)
def test_kinds_held_out_can_be_built_are_new_for_every_seed_and_come_again(kr500, name):
    seen = set()
    for seed in SEEDS:
        plant, again = (true_cell(kr500, name, seed).plant.arm for _ in range(2))
        assert np.linalg.eigvalsh(plant.C_theta)[0] > 0
        np.testing.assert_array_equal(plant.C_theta, again.C_theta)
        seen.add(tuple(np.ravel(plant.C_theta)))
    alike = name not in ("coupled", "far_joints")  # one member in six is the folder's arm
    assert len(seen) >= (12 if alike else len(SEEDS))
    assert name not in {member("family", seed) for seed in SEEDS}


@pytest.mark.parametrize(
    ("name", "times"), [("stiffer_3", 3), ("stiffer_10", 10), ("stiffer_100", 100), ("soft_link", 0.2)]
)
def test_links_of_a_member_of_the_family_are_all_stiffer_or_one_of_them_is_softer(kr500, name, times):
    met, soft = set(), set()
    for seed in SEEDS:
        rng = stream(seed, 8)
        kind = list(TRUTHS)[rng.integers(len(TRUTHS))]  # the first draw of the stream
        own, found = TRUTHS[kind](kr500.arm, rng), HELD_OUT[name](kr500.arm, stream(seed, 8))
        met.add(kind)
        factors = np.full(7, 1 / times)
        if name == "soft_link":
            place = rng.integers(7)
            factors = np.where(np.arange(7) == place, 5.0, 1.0)
            soft.add(place)
        for link, whole, factor in zip(found.links, own.links, factors, strict=True):
            np.testing.assert_allclose(link.compliance, factor * whole.compliance, rtol=1e-12)
        assert found.joints == own.joints
    assert met == set(TRUTHS)
    assert len(soft) >= 5 or name != "soft_link"


def test_soft_bearings_tilt_and_shift_at_the_ends_of_links_before_joints(kr500):
    found = HELD_OUT["bearings"](kr500.arm, stream(5, 8))
    rng = stream(5, 8)
    own = TRUTHS[list(TRUTHS)[rng.integers(len(TRUTHS))]](kr500.arm, rng)
    pairs = zip(found.links, own.links, strict=True)
    *added, last = (soft.compliance - link.compliance for soft, link in pairs)
    assert not last.any()
    tilts = [C[3, 3] / joint.compliance for C, joint in zip(added, kr500.arm.joints, strict=True)]
    assert 0.1 <= min(tilts) < max(tilts) <= 1
    for C in added:
        shape = np.diag([0.15**2] * 3 + [1.0] * 3)
        np.testing.assert_allclose(C / C[3, 3], shape, rtol=0, atol=1e-6)


def test_random_couplings_keep_the_diagonal_and_are_uniform_over_correlation_matrices():
    """An entry of a uniform correlation matrix of order n is Beta(n/2, n/2) on -1 to 1, variance 1/(n+1)."""
    rng = np.random.default_rng(4)
    found = np.array([coupled(TUBE, rng) for _ in range(2000)])
    scale = np.sqrt(np.diag(TUBE))
    R = found / np.outer(scale, scale)
    np.testing.assert_allclose(R[:, range(6), range(6)], 1, rtol=1e-12)
    assert np.linalg.eigvalsh(R).min() > 0
    np.testing.assert_array_equal(R, R.swapaxes(1, 2))
    off = R[:, *np.triu_indices(6, 1)]
    assert np.mean(off**2) == pytest.approx(1 / 7, rel=0.03)  # 30,000 entries: standard error 0.8 %
    assert np.mean(np.abs(off) < 0.5) == pytest.approx(0.792969, abs=0.01)  # (15 x - 10 x^3 + 3 x^5) / 8


def test_joints_far_off_are_spread_evenly_in_the_logarithm(kr500):
    drawn = np.array(
        [
            [
                joint.compliance / own.compliance
                for joint, own in zip(
                    HELD_OUT["far_joints"](kr500.arm, stream(seed, 8)).joints, kr500.arm.joints, strict=True
                )
            ]
            for seed in range(200)
        ]
    )
    assert 0.3 <= drawn.min() < 0.31
    assert 2.9 < drawn.max() <= 3.0
    low, high = np.log([0.3, 3.0])
    assert np.log(drawn).mean() == pytest.approx((low + high) / 2, abs=0.06)  # 1200 draws: 0.02
    assert np.log(drawn).std() == pytest.approx((high - low) / np.sqrt(12), rel=0.05)
    assert np.std(np.log(drawn), axis=1).min() > 0.05  # each its own


def test_the_family_gives_every_seed_the_next_kindand_a_name_gives_itself():
    assert [member("family", 12 + k) for k in range(2 * len(TRUTHS))] == [*TRUTHS, *TRUTHS]
    assert {member("cast", seed) for seed in SEEDS} == {"cast"}


@pytest.mark.parametrize(("find", "names"), [(true_cell, TRUTHS), (prior_of, PRIORS)])
def test_an_unknown_name_is_answered_with_those_there_are(kr500, find, names):
    with pytest.raises(BenchError, match=", ".join(names)):
        find(kr500, "rubber", 1)
