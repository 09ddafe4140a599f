"""The trace weight of GCO without a prior: what it does to a model, what teaches it, what is proven of it."""

from dataclasses import replace

import numpy as np
import pytest

from testbench import BenchError, Scenario, deflections, score, simulate
from testbench.identify import interior, trace
from testbench.identify.conic import certify
from testbench.identify.method import gco, least_squares, paper_gco
from testbench.identify.regression import reduce, reduce_by_group
from testbench.identify.trace import _strongest_weight, cross_validation_groups, learn_trace_penalty
from testbench.model.structure import all153, joints_only, mgco68, mgco147, template56
from testbench.workflows.campaign import true_cell


@pytest.fixture(scope="module")
def campaign(kr500):
    return simulate(kr500, Scenario(arm=kr500.arm.name, workspace_poses=40), 1)


def moved(cell, estimate, campaign):
    return deflections(cell.vjm, estimate, campaign.truth)


@pytest.mark.parametrize("structure", [mgco147, all153])
def test_a_heavy_weight_is_joint_stiffness_only(kr500, campaign, structure):
    """Whether joints are unknowns of their own or counted in the link before them."""
    heavy = replace(gco, trace_weight=1e9)(kr500.vjm, structure(kr500.arm), campaign.identification)
    joints = least_squares(kr500.vjm, joints_only(kr500.arm), campaign.identification)
    apart = moved(kr500, heavy, campaign) - moved(kr500, joints, campaign)
    assert heavy.status == "solved"
    assert np.abs(apart).max() < 1e-4 * np.abs(moved(kr500, joints, campaign)).max()


@pytest.mark.parametrize("structure", [template56, mgco68])
def test_the_weighted_problem_is_solved_and_proven_and_its_certificate_made_again(kr500, campaign, structure):
    found = gco(kr500.vjm, structure(kr500.arm), campaign.identification)
    assert found.status == "solved"
    assert found.conservative
    assert found.certificate.duality_gap < 1e-6 * found.f_m
    again = certify(found, dual=found.certificate.dual).duality_gap
    assert again == pytest.approx(found.certificate.duality_gap, abs=1e-12)  # rounding of F_M


def test_the_paper_s_gco_has_no_weight_and_says_so(kr500, campaign):
    s, data = mgco68(kr500.arm), campaign.identification
    papers, ours = (method(kr500.vjm, s, data) for method in (paper_gco, gco))
    assert (papers.method, ours.method) == ("GCO (paper)", "GCO (conic program)")
    assert papers.f_m < ours.f_m
    error = [score(moved(kr500, own, campaign), campaign.truth.deflection).rms for own in (papers, ours)]
    assert error[1] < error[0] / 10  # what no reading sees is millimetres wrong


def test_links_that_hardly_bend_are_left_to_the_joints(kr500):
    """Their readings teach the strongest weight: the model is joint stiffness only, to its digits."""
    stiff = true_cell(kr500, "stiffer_100", 3)
    own = simulate(stiff, Scenario(arm=kr500.arm.name, workspace_poses=40), 3)
    found = gco(stiff.vjm, template56(kr500.arm), own.identification)
    joints = least_squares(stiff.vjm, joints_only(kr500.arm), own.identification)
    ours, theirs = (moved(stiff, e, own) for e in (found, joints))
    assert np.abs(ours - theirs).max() < 1e-4 * np.abs(theirs).max()


def test_readings_that_joints_explain_exactly_have_a_weight_too(kr500, monkeypatch):
    """Neither noise nor links: nothing is left, not even rounding, that a weight could be over."""
    monkeypatch.setattr(trace, "_squared_residuals", lambda _, pi: np.zeros(pi.shape[:-1]))
    rigid = true_cell(kr500, "tubes", 1, stiffer=1e9)
    exact = simulate(rigid, Scenario(arm=kr500.arm.name, noise=False, truth="linear", workspace_poses=5), 1)
    found = gco(kr500.vjm, template56(kr500.arm), exact.identification)
    assert 0 < found.penalty.weight < np.inf
    apart = moved(kr500, found, exact) - exact.truth.deflection
    assert np.abs(apart).max() < 1e-5 * np.abs(exact.truth.deflection).max()


def test_a_weaker_weight_has_to_predict_better_in_pose_after_pose():
    """By factors, not by sums: one hard pose neither decides nor hides what all others say."""
    strong, ripple = np.geomspace(1, 20, 8), 1 + 0.02 * np.cos(np.arange(8))
    for weak, chosen in (
        (0.95 * strong * ripple, 1),  # a little better everywhere
        (strong * np.r_[np.ones(7), 0.1], 0),  # better in the hardest pose alone
        (strong * np.r_[0.7 * ripple[:7], 1.02], 1),  # better but in the hardest
        (0.999 * strong * (1 + 0.1 * np.cos(np.arange(8))), 0),  # by chance
    ):
        assert _strongest_weight(np.c_[strong, weak]) == chosen
    assert _strongest_weight(np.c_[strong, np.full(8, np.nan)]) == 0  # not solved


def test_all_folds_and_weights_are_solved_as_if_one_by_one(kr500, campaign, monkeypatch):
    """And all readings with the chosen weight alone; coarse answers fit the readings as proven ones do."""
    s, calls, whole = all153(kr500.arm), [], interior.solve_batch

    def spied(problems, weights):
        calls.append((problems, weights, whole(problems, weights)))
        return calls[-1][2]

    monkeypatch.setattr(interior, "solve_batch", spied)
    [parts] = reduce_by_group(
        kr500.vjm, [s], campaign.identification, cross_validation_groups(campaign.identification)
    )
    taken = learn_trace_penalty(kr500.vjm, parts)
    (folds, weights, (x, _)), (_, [rate], _) = calls
    assert x.shape[:2] == (8, 5)  # joint stiffness only needs no program
    assert np.isfinite(x).all()
    for k, i in ((0, 4), (3, 0), (7, 2)):
        own = interior.BatchedProblems(
            folds.R[k : k + 1],
            folds.g[k : k + 1],
            folds.half_squares[k : k + 1],
            folds.trace_cost,
            folds.block_orders,
        )
        [[alone]], _ = whole(own, weights[i : i + 1])
        np.testing.assert_allclose(alone, x[k, i], rtol=0, atol=1e-6 * np.abs(alone).max())
    assert rate in weights
    exact = replace(gco, trace_weight=taken.weight)(kr500.vjm, s, campaign.identification)
    # w is of the rate whose fit leaves this F_M
    assert taken.weight * exact.f_m * exact.regression.n_equations / 3 == pytest.approx(rate, rel=0.02)


def test_without_poses_to_hold_out_generalised_cross_validation_chooses(kr500, campaign):
    regression = reduce(kr500.vjm, template56(kr500.arm), campaign.identification)
    found = gco(kr500.vjm, template56(kr500.arm), regression)
    assert found.status == "solved"
    assert found.penalty.weight > 0


def test_a_weight_is_refused_that_is_none(kr500):
    with pytest.raises(BenchError, match=r"trace_weight \[N m/rad\]: expected 0 or more, got -1"):
        replace(gco, trace_weight=-1)
