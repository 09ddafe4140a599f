"""What the data cannot see: ranks, words, shares and what would help, before any solve."""

import json
from dataclasses import replace

import numpy as np
import pytest
from loads import axis_loads

from testbench.campaign.campaign import Scenario, simulate
from testbench.campaign.identifiability import describe, tasks
from testbench.commands.identifiability import report as said
from testbench.errors import BenchError
from testbench.identify.fold import reduce
from testbench.identify.metric import metric, whitened
from testbench.identify.prior import Prior, Strength, cad_prior
from testbench.identify.regression import generic_rows, non_redundant, rank
from testbench.model.structure import Structure, all153, free36, mgco47, mgco68, mgco69, mgco147, template56

STRENGTH = Strength(0.3)


@pytest.fixture(scope="module")
def gravity(kr500):
    """Eight poses under 460 kg, three markers: section 6."""
    scenario = Scenario(arm="kr500_l480", truth="linear", workspace_poses=1)
    return simulate(kr500, scenario, 1).identification


@pytest.fixture(scope="module")
def full_pose(arm_6r):
    """Random poses, six axis loads each, full pose read: section 5.2."""
    return axis_loads(arm_6r, np.random.default_rng(52))


def report_of(cell, structure, data, strength=STRENGTH):
    return describe(cell.vjm, structure, data, cad_prior(cell.arm), strength)


def proposal(report, start):
    return next(p for p in report.proposals if p.words.startswith(start))


@pytest.mark.parametrize(
    ("structure", "many"),
    [(mgco147, [89]), (all153, [89]), (mgco69, [49]), (mgco68, [49]), (mgco47, [36]), (template56, [27, 28])],
)
def test_ranks_under_gravity_are_those_of_the_paper(kr500, gravity, structure, many):
    report = report_of(kr500, structure(kr500.arm), gravity)
    assert report.rank_of_loads in many
    assert report.rank == reduce(kr500.vjm, report.structure, gravity).rank
    assert report.rank <= report.equations == 48
    lost = len(report.lost_to_structure) + len(report.lost_to_loads) + report.lost_to_poses
    assert report.rank + lost == report.structure.n
    assert len(report.lost_to_structure) + report.rank_of_structure == report.structure.n
    # the spread is the diagonal of a projector: its trace is its dimension, up to rounding
    assert report.spread.sum() == pytest.approx(report.lost_to_poses, abs=1e-9)


@pytest.mark.parametrize(
    ("structure", "seen", "lost"),
    [(all153, 105, 48), (mgco147, 105, 42), (mgco69, 56, 13), (template56, 32, 24)],
)
def test_full_pose_and_full_wrench_lose_to_structure_alone(arm_6r, full_pose, structure, seen, lost):
    report = report_of(arm_6r, structure(arm_6r.arm), full_pose)
    assert report.rank == report.rank_of_loads == report.rank_of_structure == seen
    assert len(report.lost_to_structure) == lost
    assert report.rank_of_structure == report.rank


def test_every_joint_frees_seven_directions_between_its_two_links(kr500, gravity):
    report = report_of(kr500, mgco147(kr500.arm), gravity)
    pairs = [
        tuple(sorted({report.component[k] for k in (*d.parameters, *d.others)}))
        for d in report.lost_to_structure
    ]
    for j in range(6):
        between = {(f"link_{j}",), (f"link_{j + 1}",), (f"link_{j}", f"link_{j + 1}")}
        assert sum(pair == (f"link_{j}", f"link_{j + 1}") for pair in pairs) <= 7
        pairs = [pair for pair in pairs if pair not in between]
    assert pairs == []


def test_a_named_direction_is_really_not_seen(kr500, gravity):
    """Leaving one parameter of each structural direction out costs no rank."""
    structure = mgco68(kr500.arm)
    report = report_of(kr500, structure, gravity)
    A = generic_rows(kr500.vjm, structure)
    for d in report.lost_to_structure:
        part = A[:, [*d.parameters, *d.others]]
        assert rank(part) < part.shape[1]
        assert rank(np.delete(A, d.parameters[0], axis=1)) == rank(A)


def test_joint_1_is_not_loaded_by_gravity_and_a_side_load_restores_it(kr500, gravity):
    s = Structure.of(kr500.arm, joints=["joint_1", "joint_2"])
    report = report_of(kr500, s, gravity)
    assert (report.rank, report.rank_of_structure) == (1, 2)
    assert report.share[0] == 0.0
    assert "Not loaded in any pose: joint_1." in said(report).claims
    assert any(text.startswith("The prior decides") and "joint_1" in text for text in said(report).claims)
    assert proposal(report, "the force as a side load along world y").rank == 2
    side = np.zeros_like(gravity.wrench)
    side[:, 1] = 4500.0
    assert report_of(kr500, s, replace(gravity, wrench=side)).not_loaded == ()


def test_expected_error_is_that_of_draws_from_prior_and_noise(kr500, gravity):
    """Monte Carlo: compliance drawn from the prior, identified by regularised least squares."""
    structure = mgco47(kr500.arm)
    known = Strength(0.3, 1e-9)  # a known common scale: the prior's covariance is 0.3^2 times the identity
    report = report_of(kr500, structure, gravity, known)
    m = metric(cad_prior(kr500.arm), kr500.vjm, structure)
    A, _ = whitened(reduce(kr500.vjm, structure, gravity), m)
    rng, n, draws = np.random.default_rng(5), structure.n, 2000
    x = 0.3 * rng.standard_normal((draws, n))
    y = x @ A.T + rng.standard_normal((draws, len(A)))
    both = np.vstack([A, np.eye(n) / 0.3]), np.vstack([y.T, np.zeros((n, draws))])
    found = np.linalg.lstsq(*both, rcond=None)[0].T
    wrong = np.einsum("pmin,dn->dpmi", tasks(kr500.vjm, gravity, structure) @ m.L, found - x)
    rms = np.sqrt(3 * (wrong**2).mean())
    # 2000 draws of at least ten effective directions: relative sd of the RMS below 1 %; 4 sd
    assert report.error == pytest.approx(rms, rel=0.04)


def test_data_without_load_are_a_report_not_a_crash(kr500, gravity):
    idle = replace(gravity, wrench=np.zeros_like(gravity.wrench))
    report = report_of(kr500, mgco47(kr500.arm), idle)
    assert report.rank == 0
    assert not report.share.any()
    assert report.error == np.inf
    told = said(report)
    json.dumps(told.json(), allow_nan=False)
    assert told.numbers["expected_error_mm"] is None
    assert told.answer.startswith("These runs bound no prediction of MGCO47")


def test_bad_priors_and_a_structure_that_leaves_the_symmetry_open_are_refused(kr500, gravity):
    with pytest.raises(BenchError, match="symmetric structure"):
        report_of(kr500, free36(kr500.arm), gravity)
    C = kr500.arm.C_theta
    indefinite = C.copy()
    indefinite[13, 17] = indefinite[17, 13] = 2 * np.sqrt(C[13, 13] * C[17, 17])
    reduced = non_redundant(kr500.vjm, template56(kr500.arm), name="MLS32")
    for bad, problem in (
        (C[:-1, :-1], r"\(48, 48\)"),
        (indefinite, "positive definite"),
        (0 * C, "diagonal"),
    ):
        for s in (mgco68(kr500.arm), reduced):
            with pytest.raises(BenchError, match=problem):
                describe(kr500.vjm, s, gravity, Prior("bad", bad), STRENGTH)
