"""Robust identification: nothing lost without outliers, planted ones found, bad input refused."""

from dataclasses import replace

import numpy as np
import pytest
from loads import axis_loads

from testbench.campaign.advice import advice
from testbench.campaign.campaign import Scenario, simulate
from testbench.errors import BenchError
from testbench.identify import gco, huber, least_squares, reduce, weighed
from testbench.identify.estimate import TOOL
from testbench.identify.evaluate import deflections
from testbench.identify.huber import REJECT, search, without_outliers
from testbench.identify.metric import Belief, metric, precision_root
from testbench.identify.prior import Strength, cad_prior, distorted
from testbench.identify.projected import least_squares as psd_least_squares
from testbench.identify.regression import f_m
from testbench.identify.robust_loss import PAIRS
from testbench.identify.solve import answer, solve
from testbench.identify.weighed import one_by_one
from testbench.model.structure import all153, mgco68, template56
from testbench.studies.noise_sensitivity.spoiled import spoil

STRENGTH, DELTA = Strength(0.3), PAIRS.bend


def readings(cell, seed, truth="linear"):
    return simulate(cell, Scenario(arm="kr500_l480", truth=truth, workspace_poses=1), seed).identification


def rough(cell, structure, seed):
    """The CAD prior, 2 times wrong in scale and 30 % in shape."""
    wrong = distorted(cad_prior(cell.arm), scale=2, shape=0.3, rng=np.random.default_rng([seed, 7]))
    return metric(wrong, cell.vjm, structure)


def robustly(cell, structure, data, constraint="psd", units=None, strength=STRENGTH):
    """The fit without outliers, by a metric as it is where there is one."""
    belief = None if units is None else Belief(units, strength)
    return without_outliers(cell.vjm, data, reduce(cell.vjm, structure, data), constraint, belief)


def program(cell, structure, seed):
    """A spoiled campaign, its readings in the metric of a rough prior, and the prior's rows."""
    data, _ = spoil(readings(cell, seed), 0.05, 1e-3, np.random.default_rng(seed))
    units = rough(cell, structure, seed)
    own = one_by_one(cell.vjm, structure, data)
    return data, own.A @ units.L, own.y, *precision_root(units, STRENGTH), units


def cost(x, A, y, B, c):
    """Huber's loss of every reading's residual and the prior's penalty, with the gradient."""
    residual, off = A @ x - y, B @ x - c
    length = np.linalg.norm(residual, axis=1)
    loss = np.where(length <= DELTA, length**2 / 2, DELTA * (length - DELTA / 2))
    pull = np.minimum(1, DELTA / np.maximum(length, 1e-300))[:, None] * residual
    return loss.sum() + off @ off / 2, np.einsum("ikn,ik->n", A, pull) + B.T @ off


def found(fit):
    return {(reading.run, reading.marker) for reading in fit.rejected}


@pytest.mark.parametrize("constraint", ["none", "psd"])
def test_reweighing_ends_where_no_model_is_better(kr500, constraint):
    """Of least squares the gradient of the loss is zero; of GCO PSD in every block, and orthogonal to X."""
    s = mgco68(kr500.arm)
    data, A, y, B, c, units = program(kr500, s, 1)
    regression, belief = reduce(kr500.vjm, s, data), Belief(units, STRENGTH)
    length, status = search(kr500.vjm, one_by_one(kr500.vjm, s, data), regression, constraint, belief)
    assert status == "solved"
    weight = np.sqrt(np.minimum(1, DELTA / np.maximum(length, DELTA)))
    rows, right = np.vstack([(weight[:, None, None] * A).reshape(-1, s.n), B]), weight[:, None] * y
    x, _ = psd_least_squares(rows, np.r_[right.ravel(), c], units.sizes if constraint == "psd" else ())
    np.testing.assert_allclose(np.linalg.norm(y - A @ x, axis=1), length, rtol=0, atol=1e-4)
    value, gradient = cost(x, A, y, B, c)
    scale = 1e-5 * value
    if constraint == "none":
        assert np.abs(gradient).max() < scale
    for X, S in zip(units.matrices(units.project(x)), units.matrices(gradient), strict=True):
        assert np.linalg.eigvalsh(S)[0] > -scale
        assert abs((S * X).sum()) < scale


def test_where_nothing_is_rejected_the_robust_fit_is_the_plain_one_to_the_last_digit(kr500):
    s, pairs, same = template56(kr500.arm), [], 0
    for seed in range(3):
        data = readings(kr500, seed)
        units, regression = rough(kr500, s, seed), reduce(kr500.vjm, s, data)
        for constraint, method in (("psd", gco), ("none", least_squares)):
            pairs.append((robustly(kr500, s, data, constraint), method(kr500.vjm, s, data)))
            by_hand = solve(regression, constraint, Belief(units, STRENGTH))
            pairs.append((robustly(kr500, s, data, constraint, units), by_hand))
    for fit, plain in pairs:
        assert fit.method == f"{plain.method}, Huber loss"
        assert len(fit.rejected) <= 1
        if not fit.rejected:
            assert advice(fit) == advice(plain)
            np.testing.assert_array_equal(fit.pi, plain.pi)
            same += 1
    # 0.14 of 135 sound readings lie beyond the 99.9 % quantile: four times that, in all four fits
    assert same >= 10


def test_rejected_readings_are_listed_with_their_distance_and_runs_without_any_left_are_named(kr500):
    data, s = readings(kr500, 1), mgco68(kr500.arm)
    off = np.zeros_like(data.after)
    off[4, 1] = [0, 0, 3e-3]
    off[6] = [0, 0, 20e-3]  # the tracker was pushed between the two readings
    fit = robustly(kr500, s, replace(data, after=data.after + off), "psd", rough(kr500, s, 1))
    first, *others = fit.rejected
    assert (first.run, first.marker) == (data.run[4], data.markers[1])
    assert {(one.run, one.marker) for one in others} == {(data.run[6], name) for name in data.markers}
    assert first.residual == pytest.approx(3e-3, abs=4 * np.sqrt(3) * 50e-6)  # noise and fit: 4 sd
    assert first.sigmas == pytest.approx(first.residual / (np.sqrt(2) * 50e-6))
    assert fit.regression.equations == 3 * (45 - 4)
    said = advice(fit)
    assert f"4 of 45 readings rejected, beyond {REJECT} standard deviations" in said
    assert any(f"no reading is left of run {data.run[6]}:" in words for words in said)


def test_f_m_of_a_robust_fit_is_eq_19_over_the_readings_that_are_left(kr500):
    data, mask = spoil(readings(kr500, 3), 0.1, 1e-2, np.random.default_rng(3))
    fit = robustly(kr500, template56(kr500.arm), data, "none")
    assert found(fit) >= {(data.run[i], data.markers[j]) for i, j in np.argwhere(mask)}
    left = np.array([[(run, name) not in found(fit) for name in data.markers] for run in data.run])
    residual = (deflections(kr500.vjm, fit, data) - data.deflection)[left]
    expected = np.sqrt((residual**2).sum() / len(residual)) / (np.sqrt(2) * data.sigma)
    assert fit.f_m == pytest.approx(expected, rel=1e-9)
    assert fit.f_m == pytest.approx(f_m(fit.regression, fit.pi))
    assert fit.f_m < 1.5 * fit.f_m_floor


def test_too_many_rejections_are_no_outliers_and_too_few_left_is_an_error(kr500):
    data, s = readings(kr500, 2, "nonlinear"), mgco68(kr500.arm)
    units = rough(kr500, s, 2)
    fit = robustly(kr500, s, replace(data, sigma=20e-6), "psd", units)  # it is 50 um
    assert any("too many to be outliers: sigma too small" in said for said in advice(fit))
    with pytest.raises(BenchError, match=r"equations left for 4\d directions: sigma too small"):
        robustly(kr500, s, replace(data, sigma=1e-6), "psd", units)
    flipped = replace(data, before=data.after, after=data.before)  # no conservative model moves that way
    with pytest.raises(BenchError, match="45 of 45 readings rejected"):
        robustly(kr500, s, flipped, "psd", units)


def test_a_wild_orientation_is_rejected_as_such(arm_6r, rng):
    data = axis_loads(arm_6r, rng, poses=20)
    off = np.zeros_like(data.rotation_after)
    off[[10, 50]] = [5e-3, 0, 0]  # 14 standard deviations
    spoiled = replace(data, rotation_after=data.rotation_after + off)
    s = all153(arm_6r.arm)
    units = metric(cad_prior(arm_6r.arm), arm_6r.vjm, s)
    fit = robustly(arm_6r, s, spoiled, "psd", units)
    assert {(data.run[10], TOOL), (data.run[50], TOOL)} <= found(fit)
    assert len(fit.rejected) <= 4  # of 238 sound readings 0.2 lie beyond the 99.9 % quantile
    kinds = [term.equations for term in fit.regression.terms]
    assert sum(kinds) == 3 * (2 * data.runs - len(fit.rejected))
    assert fit.f_m < 1.2 * fit.f_m_floor  # the prior holds some of the rank


def test_a_search_that_did_not_converge_is_never_called_solved(kr500, monkeypatch):
    monkeypatch.setattr(huber, "answer", lambda *args: replace(answer(*args), status="not solved: why"))
    s = template56(kr500.arm)
    fit = robustly(kr500, s, readings(kr500, 4), "none", rough(kr500, s, 4))
    assert fit.status == "not solved: why (search for outliers)"


def test_bad_input_is_refused(kr500, monkeypatch):
    data, s = readings(kr500, 1), template56(kr500.arm)
    monkeypatch.setattr(weighed, "MOST_READINGS", 44)
    with pytest.raises(BenchError, match="expected at most 44 readings, got 45"):
        robustly(kr500, s, data, "none")
    with pytest.raises(BenchError, match="share: expected 0 to 1"):
        spoil(data, 1.2, 1e-3, np.random.default_rng(0))
    with pytest.raises(BenchError, match="size"):
        spoil(data, 0.1, np.inf, np.random.default_rng(0))


def test_spoiling_moves_as_many_readings_as_asked_by_as_much(kr500, rng):
    data = readings(kr500, 1)
    spoiled, mask = spoil(data, 0.1, 1e-3, rng)
    moved = np.linalg.norm(spoiled.deflection - data.deflection, axis=-1)
    assert mask.sum() == round(0.1 * 45)
    np.testing.assert_allclose(moved, 1e-3 * mask, atol=1e-15)
