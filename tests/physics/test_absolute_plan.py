"""Plans of absolute readings: what a pose tells, what stays hidden and is named, planned against random."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.campaign.absolute_truth import AbsoluteCampaign, simulate_series
from testbench.campaign.campaign import stream
from testbench.campaign.candidates import Conditions, build_checks, find
from testbench.campaign.plan import left_open, union_after, union_of
from testbench.campaign.plan_settings import PlanSettings
from testbench.campaign.unobservable import quantities, unobservable
from testbench.commands.plan_numbers import filled
from testbench.design import absolute
from testbench.design.baselines import error_after
from testbench.design.criteria import criterion_of
from testbench.design.exchange import exchange, greedy
from testbench.identify.absolute.fit import Options, calibrate
from testbench.identify.absolute.posterior import model_of
from testbench.identify.absolute.pull import information, pull_of
from testbench.identify.absolute.state import forward
from testbench.identify.observability import hidden
from testbench.identify.prior import cad_prior

POSES = 12
ASKED = PlanSettings(absolute=True, criterion="I", model="Joints", poses=POSES, orders=1, loads_kg=(300.0,))
ALONE = replace(ASKED, loads_kg=())


@pytest.fixture(scope="module")
def union(kr500):
    return union_of(kr500, ASKED)


@pytest.fixture(scope="module")
def poses(kr500):
    return find(build_checks(kr500, Conditions()), 120, stream(11)).q


def test_what_joints_do_beyond_the_model_is_one_noise_of_a_pose(union, poses):
    """Drawn joints move the targets, by finite differences of the arm itself; rows are whitened by that."""
    q, rng = poses[:1], np.random.default_rng(0)
    series, state = absolute.at(union, q), union.state
    draws = rng.normal(0, union.rest, (4000, len(union.rest)))

    def places(moved):
        where = forward(state, replace(series, q=series.q + moved)).where
        return where.points(state.mount(series).points).ravel()

    still = places(0 * draws[0])
    J = np.stack([(places(h) - still) / 1e-6 for h in 1e-6 * np.eye(len(union.rest))], axis=1)
    V = np.cov((draws @ J.T).T) + series.sigma**2 * np.eye(len(still))
    A = np.linalg.solve(np.linalg.cholesky(V), absolute.position_rows(union, q)[0])
    ours, drawn = (rows.T @ rows for rows in (absolute.measured_rows(union, q)[0], A))
    # 4000 draws: 2 % of a variance, and some more over many entries
    assert np.linalg.norm(ours - drawn) < 0.1 * np.linalg.norm(ours)
    rms = np.sqrt(np.square(draws @ J.T).sum(axis=1).mean() / (2 * len(series.markers)))
    assert absolute.joint_rest(union, q) == pytest.approx(rms, rel=0.03)


def test_a_joint_that_never_turns_hides_what_its_turning_would_show_and_a_plan_shows_it(union, poses):
    stuck = poses[:POSES].copy()
    stuck[:, 4] = 0.3
    said = [words for words in left_open(union, stuck) if words.startswith("joint_4's offset hides behind")]
    assert len(said) == 1
    assert "link_4's turn" in said[0]
    assert said[0].endswith("turn joint_5 more")
    problem = absolute.candidate_set(union, poses, POSES).problem
    criterion = criterion_of("I", problem, absolute.position_rows(union, poses[-20:]))
    plan = exchange(problem, criterion, problem.rows, greedy(problem, criterion, problem.rows, POSES))
    assert not [words for words in left_open(union, poses[plan]) if "offset" in words]


def test_structural_directions_are_as_many_as_theory_says(union, poses):
    """Of an arm of n hinges with m free targets 4 n + 3 m are found of 6 n + 3 m numbers (Everett 1987)."""
    first, *_ = left_open(union, poses[:POSES])
    joints = ", ".join(f"joint_{k} (2)" for k in range(1, 7))
    assert first.startswith("12 directions of geometry, frames and mounts are structural")
    assert first.endswith(joints)


def test_two_quantities_of_which_only_the_sum_is_read_hide_behind_each_other(union):
    """Information k of the sum of two unit normals: each keeps (1 + k) / (1 + 2 k) of its variance."""
    unknowns, k = union.unknowns, 50.0
    one, other = (
        next(i for i in quantities(unknowns) if i.name == name)
        for name in ("joint_3's offset", "joint_6's compliance")
    )
    L = np.diag(np.sqrt(np.diag(union.L @ union.L.T)))
    both = sum(i.H[0] @ L / np.linalg.norm(i.H @ union.L) for i in (one, other))
    found = hidden(quantities(unknowns), L, k * np.outer(both, both), np.zeros((len(L), 0)))
    assert [(i.name, i.behind) for i in found if i.behind] in (
        [("joint_3's offset", ("joint_6's compliance",))],
        [("joint_6's compliance", ("joint_3's offset",))],
    )


def test_what_is_taken_to_be_zero_is_not_spoken_of(union, poses):
    unknowns, q = union.unknowns, poses[:POSES]
    prior = np.diag(np.diag(union.L @ union.L.T))
    prior[unknowns.columns("errors")] = 0
    series = absolute.at(union, q)
    pull = pull_of(unknowns, union.state, (series,))
    tells = information(unknowns, union.state, series)
    said = " ".join(unobservable(unknowns, tells, prior, pull))
    assert "12 directions" in said
    assert "error" not in said
    assert "joint_6's compliance" in " ".join(unobservable(unknowns, 0 * tells, prior, pull))


@pytest.fixture(scope="module")
def before(kr500):
    """Readings of 250 poses with joint_1 on one side, and the arm by them."""
    q = find(build_checks(kr500, Conditions()), 250, stream(5)).q
    q[:, 0] = np.abs(q[:, 0])
    series, _ = simulate_series(kr500, AbsoluteCampaign(poses=250), 5, q)
    on = frozenset({"joint springs", "joint errors"})
    return series, calibrate(kr500.vjm, series, cad_prior(kr500.arm), Options(orders=30, only=on))


def test_what_earlier_readings_tell_adds_to_what_a_plan_tells(before, poses):
    """The error by roots of covariances is that by sums of precisions in SI units."""
    model = model_of(before[1])
    own, q = replace(union_after(model, ALONE), little=0.0), poses[:6]
    first, across = own.unknowns.starts["geometry"], replace(own, L=np.eye(own.unknowns.size))
    on = np.r_[:first, first + model.columns]
    P = np.eye(len(on)) / absolute.LOOSE**2
    P[first:, first:] = np.linalg.inv(model.posterior.root.T @ model.posterior.root)
    P += absolute.information_of(own, q)[np.ix_(on, on)]
    A = absolute.position_rows(across, poses[-20:])[:, :, on].reshape(-1, len(on))
    error = np.sqrt(3 * np.einsum("ki,ik->k", A, np.linalg.solve(P, A.T)).mean())
    problem = absolute.candidate_set(own, q, len(q)).problem
    assert error_after(problem, absolute.position_rows(own, poses[-20:]))(np.arange(6)) == pytest.approx(
        error
    )


def test_a_plan_after_readings_goes_where_a_joint_was_not_read(kr500, before, poses):
    """Asked for the other side of joint_1, to which one in five candidates turns it."""
    series, found = before
    own, other = union_after(model_of(found), ALONE), poses[:, 0] < 0
    q = np.vstack([poses[~other][:40], poses[other][:10]])
    wanted = absolute.position_rows(own, poses[other][-20:])
    problem = absolute.candidate_set(own, q, 8).problem
    plan = greedy(problem, criterion_of("I", problem, wanted), problem.rows, 8)
    assert (plan >= 40).sum() >= 4
    [row, *_] = filled(kr500.arm, series, q[plan])
    assert (row.joint, row.poses) == ("joint_1", pytest.approx((plan >= 40).sum(), abs=1))
    error = error_after(problem, wanted)
    assert error(plan) < min(error(stream(k).choice(50, 8, replace=False)) for k in range(10))
