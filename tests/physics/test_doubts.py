"""Doubts: sound runs raise none, every planted mistake is named first, with its size."""

import re
import tracemalloc
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from loads import hung as hung_load
from loads import random_q
from mistakes import MISTAKES, named
from scipy.spatial.transform import Rotation
from scipy.stats import f as f_ratio
from scipy.stats import multivariate_normal
from sound_sets import sound

from testbench.data.dataset import Dataset, select_rows, select_runs
from testbench.identify.base_frame import RegisteredDataset, register_dataset
from testbench.identify.diagnosis import diagnose as diagnosis
from testbench.identify.diagnosis.deflections import (
    USUAL_BACKLASH,
    USUAL_STIFFENING,
    LoadedRuns,
    backlash_and_stiffening_columns,
    fit_residual_model,
)
from testbench.identify.diagnosis.diagnose import MAX_RUNS_PER_BATCH, diagnose
from testbench.identify.diagnosis.hypotheses import HYPOTHESES, describe
from testbench.identify.diagnosis.kinematics import (
    MAX_CORRECTION_ROUNDS,
    Issue,
    Observations,
    Submission,
    best_hypothesis,
    correct_one_by_one,
    score_test,
)
from testbench.identify.diagnosis.moves import p_value
from testbench.identify.prior import cad_prior, rescale_to_data, scale_by_prior
from testbench.identify.regression import reduce
from testbench.model.load import first_order_deflection
from testbench.model.structure import all153
from testbench.model.vjm import evaluate_chain, generalised_load, tool_points, tool_poses
from testbench.runs.rows import trial_rng

ROOT = Path(__file__).resolve().parents[2]
SEEDS = {"levels": 22, "pressed": 11, "tracker": 17}
"""A set of every kind, of a KR 500: three hung masses, forces in all directions, a tracker's frame."""


@pytest.fixture(scope="module")
def made(kr500, arm_6r):
    """The sound set of a seed."""
    return partial(sound, {"kr500_l480": kr500, "arm_6r": arm_6r})


@pytest.fixture(scope="module")
def sets(made):
    found = {kind: made(seed) for kind, seed in SEEDS.items()}
    assert [own.loads for own in found.values()] == ["levels", "pressed", "pressed"]
    assert [own.tracker for own in found.values()] == [False, False, True]
    return found


@pytest.mark.parametrize("kind", SEEDS)
def test_sound_runs_raise_no_doubt(sets, kind):
    assert named(sets[kind]) == []


FIRST = {mistake.names: name for name, mistake in reversed(MISTAKES.items())}
BELOW = set("noise hung swapped swapped_once force_zero load_point joint_zero tracker_moved".split())
SLOW = {"load_order", "payload", "kilograms", "force_axis", "one_reading", "frame_tilted"}
"""One mistake of each doubt, those planted below too, and those that take long: `make studies` plants all."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.study] * (name in BELOW | SLOW or name not in FIRST.values()))
        for name in MISTAKES
    ],
)
def test_a_planted_mistake_is_named_first(sets, name):
    mistake = MISTAKES[name]
    kind = "levels" if mistake.possible(sets["levels"]) else "pressed"
    [first, *_] = named(mistake.plant(sets[kind], trial_rng(1, 40)))
    assert first.name in mistake.names.split()
    assert len(first.sentence) < 300


@pytest.mark.parametrize(
    ("seed", "k", "shift"), [pytest.param(39, 8, -1, marks=pytest.mark.study), (20, None, 1)]
)
def test_rows_that_slipped_are_named_with_the_first(kr500, made, seed, k, shift):
    """Of 14 runs, of which half fit a frame that is none; and behind a sound station."""
    own = made(seed)
    assert own.tracker
    assert own.declared == (k is None)
    d = own.data
    if k is None:
        k, runs = np.flatnonzero(d.station == 2)[0] + 3, d.n_runs - 1
        assert k > 8
    else:
        own, runs = replace(own, cell=kr500), 14
    q = np.where(np.arange(d.n_runs)[:, None] < k, d.q, np.roll(d.q, shift, axis=0))
    [first, *_] = named(replace(own, data=select_runs(replace(d, q=q), np.arange(d.n_runs) < runs)))
    assert first.name == "order"
    assert f"belong to the {'next' if shift > 0 else 'previous'} pose from run {k + 1} on" in first.sentence


def test_readings_are_weighed_by_the_learnt_prior_and_what_sound_joints_do(sets):
    """Shapes and couplings have a width of their own: Bayes' formulas in the readings, dense."""
    own = sets["levels"]
    vjm, structure = own.cell.vjm, all153(own.cell.arm)
    prior = scale_by_prior(cad_prior(own.cell.arm), vjm, structure)
    fitted = fit_residual_model(LoadedRuns(vjm, prior, own.data))
    h, prior = fitted.hyperparameters, rescale_to_data(prior, reduce(vjm, structure, own.data))
    assert np.ptp(h[-3:-1]) > 0.2  # or nothing would tell shapes from couplings
    blocks = np.repeat(np.arange(len(prior.block_orders)), [n * (n + 1) // 2 for n in prior.block_orders])
    size = np.exp(h[blocks])
    D = size**2 * np.where(prior.is_link_coupling, np.exp(2 * h[-2]), np.exp(2 * h[-3]))
    G = fitted.readings.A.reshape(-1, structure.n_parameters) @ prior.L
    S = G @ (D[:, None] * G.T) + np.exp(2 * h[-1]) * np.eye(len(G))
    apart = fitted.readings.y.ravel() - G @ (size * prior.expected_x)
    mean = prior.L @ (size * prior.expected_x + D * (G.T @ np.linalg.solve(S, apart)))
    unit = np.sqrt(((prior.L * size) ** 2) @ np.ones(structure.n_parameters))
    np.testing.assert_allclose(fitted.pi / unit, mean / unit, rtol=0, atol=1e-6)
    joints = backlash_and_stiffening_columns(vjm, own.data, structure, fitted.pi)
    known = (
        np.eye(len(G)) / fitted.misfit**2
        - fitted.inverse_covariance_factor @ fitted.inverse_covariance_factor.T
    )
    np.testing.assert_allclose(known @ (S + joints @ joints.T), np.eye(len(G)), rtol=0, atol=1e-5)
    np.testing.assert_allclose(
        fitted.weighted_residual, known @ apart, rtol=0, atol=1e-6 * np.abs(apart).max()
    )


def test_sound_joints_play_and_stiffen_as_if_they_turned(sets):
    """By half the play in the sense of their torque, and by a share of the turn a radian of it."""
    own = sets["levels"]
    vjm, data, s = own.cell.vjm, own.data, all153(own.cell.arm)
    C = own.cell.arm.C_theta
    found = backlash_and_stiffening_columns(vjm, data, s, s.parameters_of(C)).reshape(
        data.n_runs, len(data.markers), 3, -1, 2
    )
    turn = (C @ generalised_load(evaluate_chain(vjm, data.q), data.wrench, data.point))[-len(data.q[0]) :].T
    for j in range(turn.shape[1]):
        for k, size in enumerate((USUAL_BACKLASH * np.sign(turn), USUAL_STIFFENING * turn * np.abs(turn))):
            q = data.q + size * np.eye(turn.shape[1])[j]
            moved = tool_points(vjm, q, vjm.markers) - tool_points(vjm, data.q, vjm.markers)
            moved /= np.sqrt(2) * data.sigma
            limit = 1e-3 * np.abs(moved).max() + 1e-9
            np.testing.assert_allclose(found[..., j, k], moved, rtol=0, atol=limit)


@pytest.mark.study
def test_a_reading_that_outweighs_all_others_or_is_the_only_one_is_named(sets, made):
    own = sets["levels"]
    after = own.data.after.copy()
    after[3, 1] = own.data.before[3, 1] + np.array([-3.0, 2.0, 8.0])  # metres, against the load
    [first, *_] = named(replace(own, data=replace(own.data, after=after)))
    marker, run = own.data.markers[1], own.data.run_id[3]
    assert f"{marker} in run {run}" in first.sentence or f"run {run}: {marker}" in first.sentence
    own = made(4)
    assert (own.cell.arm.name, own.tracker) == ("arm_6r", True)
    data = select_runs(own.data, own.data.run_id == 1)
    given = Submission(
        own.cell.vjm, data, RegisteredDataset(own.cell.vjm, data, None, "base", ()), frame_stated=False
    )
    assert [issue.name for issue in diagnose(given, own.prior)] == ["pose"]


@pytest.mark.study
def test_one_run_exchanged_among_few_is_named_and_no_noise(made):
    """It alone makes all ten scatter 40 times their noise, in which it hides."""
    seed = 1029
    own = made(seed)
    run = own.data.run_id[np.argmax(np.linalg.norm(own.data.deflection, axis=2).max(axis=1))]
    [doubt] = named(MISTAKES["swapped_once"].plant(own, trial_rng(seed, 40)))
    assert (doubt.name, doubt.sentence.split(":")[0]) == ("run", f"run {run}")
    assert named(MISTAKES["noise"].plant(own, trial_rng(seed, 40)))[0].name == "noise"


def test_the_example_of_the_docs_adds_a_mistake_that_is_named_first(sets):
    """Joint angles in gon that were read as degrees."""
    page = (ROOT / "docs" / "add_hypothesis.md").read_text()
    added: dict[str, Any] = {}
    exec(re.search(r"```python\n(.*?)```", page, re.DOTALL)[1], added)
    own, table = sets["levels"], added["TABLE"]
    vjm, data = own.cell.vjm, replace(own.data, q=own.data.q / 0.9)
    given = Submission(vjm, data, RegisteredDataset(vjm, data, None, "base", ()), frame_stated=False)
    [first, *_] = diagnose(given, own.prior, table)
    assert first.name == "gon"
    words = describe(first, vjm.arm, hypotheses=table).sentence
    assert "joint angles are gon, not degrees: which unit does the controller export? (median" in words


def test_mistakes_are_undone_one_after_the_other():
    """Each from data without those before; what cannot be undone is told once."""
    seen = []

    def correct_worst(case):
        seen.append(case)
        worst = max(case, default=0)
        rest = case if worst == 3 else tuple(x for x in case if x != worst)
        return ([Issue(str(worst))], rest) if worst else None

    for data, kinds in (((5, 4), ["5", "4"]), ((5, 3, 1), ["5", "3"]), (tuple(range(10, 20)), "")):
        seen.clear()
        found, rest = correct_one_by_one(data, correct_worst)
        assert [one.name for one in found] == kinds or len(found) == MAX_CORRECTION_ROUNDS
        assert len(set(seen)) == len(seen)
        assert not set(rest) & {int(one.name) for one in found if one.name != "3"}


def test_a_hanging_arm_with_the_orientation_that_is_told_raises_no_doubt(made):
    """In its base's frame: there own weight alone tells it from an exchange of before and after."""
    own = made(SEEDS["levels"]).mounted(np.diag([1.0, -1.0, -1.0]))
    [doubt, *_] = named(own)
    assert doubt.sentence.startswith("the readings fit if the arm hangs: gravity along +z of its base")
    assert named(MISTAKES["swapped"].plant(made(SEEDS["levels"]), trial_rng(1, 40)))[0].name == "sign"
    quat = [float(x) for x in re.search(r'quat="([^"]+)" of the body link_0', doubt.sentence)[1].split()]
    base = np.eye(4)
    base[:3, :3] = Rotation.from_quat(quat, scalar_first=True).as_matrix()
    cell = replace(own.cell, vjm=replace(own.cell.vjm, base_pose=base @ own.cell.vjm.base_pose))
    data = replace(own.data, before=own.data.before @ base[:3, :3].T, after=own.data.after @ base[:3, :3].T)
    assert named(replace(own, cell=cell, data=data)) == []


def test_sizes_are_told(sets):
    def said(kind, name, change):
        [first, *_] = named(replace(sets[kind], data=change(sets[kind].data)))
        assert first.name == name
        return first.sentence

    def pushed(data):
        return replace(data, wrench=data.wrench + np.array([0, 300.0, 0, 0, 0, 0]))

    def turned(data):
        q = data.q.copy()
        q[:, 2] -= np.deg2rad(2)
        return replace(data, q=q)

    words = said("pressed", "force_offset", pushed)
    force = float(words.split("(")[1].split(",")[1])
    assert force == pytest.approx(-300, abs=60)
    words = said("pressed", "load_point", lambda d: replace(d, point=d.point - np.array([0.3, 0, 0])))
    assert 100 < float(words.split("(")[1].split(",")[0]) < 500  # in part it looks like softer links
    shift = np.array([2e-3, -1e-3, 2e-3])
    words = said("pressed", "tracker_moved", lambda data: replace(data, after=data.after + shift))
    moved = [float(x) for x in words.split("moved by (")[1].split(")")[0].split(",")]
    assert moved == pytest.approx(1e3 * shift, abs=0.3)
    words = said("levels", "joint_zero", turned)
    assert "zero of joint_3" in words
    assert float(words.split("off by ")[1].split()[0]) == pytest.approx(2, abs=0.2)


def test_a_link_that_is_longer_is_told_in_its_own_axes(arm_6r):
    """Its beam frame is another one: no axis of it is an axis of the link."""
    frame = Rotation.from_rotvec((0.3, -0.7, 0.5)).as_matrix()
    links = [replace(link, beam_axes=frame) for link in arm_6r.arm.links]
    vjm = replace(arm_6r.vjm, arm=replace(arm_6r.arm, links=tuple(links)))
    q, step = np.random.default_rng(2).uniform(-1, 1, (20, 6)), np.array([0.06, 0.02, -0.04])
    placements = vjm.joint_placements.copy()
    placements[2, :3, 3] += step
    read = tool_points(replace(vjm, joint_placements=placements), q, vjm.markers)
    ids, there = np.arange(20), np.ones(read.shape[:2], dtype=bool)
    seen = Observations(vjm, q, vjm.markers, read, there, arm_6r.arm.markers, ids, ids, 3e-3)
    found, _ = best_hypothesis(seen, HYPOTHESES.kinematics)
    assert found is not None
    assert (found.name, found.where) == ("link", (vjm.arm.links[2].name,))
    np.testing.assert_allclose(found.size, step, atol=1e-6)


def test_the_score_test_is_a_bayes_factor_and_the_chance_of_a_step_that_of_fishers_ratio():
    """Of residuals N(0, 1) and N(0, 1 + Z Z^T), by the densities; b is the mean of what explains them."""
    rng = np.random.default_rng(1)
    Z, e = rng.standard_normal((3, 20, 4)), rng.standard_normal((3, 20))
    found = score_test(np.einsum("krz,kr->kz", Z, e), Z.swapaxes(1, 2) @ Z)
    for k in range(3):
        S = np.eye(20) + Z[k] @ Z[k].T
        wide, narrow = (multivariate_normal(np.zeros(20), C).logpdf(e[k]) for C in (S, np.eye(20)))
        assert found.log_bayes_factor[k] == pytest.approx(wide - narrow)
        np.testing.assert_allclose(found.expected_size[k], Z[k].T @ np.linalg.solve(S, e[k]))
    step = Issue("tracker_moved", size=np.zeros(3), details={"free": 40.0}, log_likelihood_gain=6.0)
    assert p_value(step) == pytest.approx(f_ratio.sf(12 / 3, 3, 40))


def told(vjm, data, frame="base"):
    given = Submission(vjm, data, register_dataset(vjm, data, frame), True)
    found = (describe(issue, vjm.arm) for issue in diagnose(given, cad_prior(vjm.arm)))
    return [(doubt.name, doubt.sentence) for doubt in found]


@pytest.mark.study
def test_single_runs_are_found_among_many(sets):
    """More runs than are weighed together."""
    once, rng = sets["levels"].data, np.random.default_rng(3)
    many = select_rows(once, np.tile(np.arange(once.n_runs), MAX_RUNS_PER_BATCH // once.n_runs + 1))
    before, after = (x + 1e-6 * rng.standard_normal(x.shape) for x in (many.before, many.after))
    run = np.arange(many.n_runs) + 1
    data = replace(
        many, run_id=run, pose_id=many.pose_id + 1000 * ((run - 1) // once.n_runs), before=before, after=after
    )
    assert data.n_runs > MAX_RUNS_PER_BATCH
    after[[3, data.n_runs - 2], 1] += 3e-3
    told = named(replace(sets["levels"], data=replace(data, after=after)))
    assert {(d.name, d.sentence.split(":")[0]) for d in told} == {
        ("reading", "run 4"),
        ("reading", f"run {data.n_runs - 1}"),
    }


def bumped(given, run, shift, *, loaded):
    """The tracker moved before a run or between its two readings."""
    d = given.data
    before, after = d.before.copy(), d.after.copy()
    before[d.run_id >= run + loaded] += shift
    after[d.run_id >= run] += shift
    return replace(given, data=replace(d, before=before, after=after))


@pytest.fixture(scope="module")
def hung(made):
    """One mass hung in every one of 20 poses, one reading of 20 um before and one after, a disturbed arm."""
    return made(3)


@pytest.mark.parametrize("loaded", [pytest.param(False, marks=pytest.mark.study), True])
def test_a_tracker_that_moved_between_two_readings_is_named_with_run_and_size(hung, loaded):
    """0.8 mm between runs 8 and 9 or inside run 9; the size is the targets' way."""
    moved = bumped(hung, 9, (0.6e-3, -0.4e-3, 0.35e-3), loaded=loaded)
    [first, *_] = named(moved)
    where = "the unloaded reading of run 9 and the loaded" if loaded else "run 8 and the unloaded"
    assert first.name == "tracker_moved"
    assert f"{where} reading of run 9" in first.sentence
    size = 1e3 * np.linalg.norm((moved.data.after - hung.data.after)[8:], axis=2)
    said = float(re.search(r"moved by (\S+) mm", first.sentence)[1])
    assert said == pytest.approx(np.sqrt(np.mean(size**2)), rel=0.3)
    assert ("runs with readings on both sides of the move have this error" in first.sentence) == loaded
    station = 1 + (moved.data.run_id >= 9)  # of their own
    assert loaded or named(replace(moved, data=replace(moved.data, station=station))) == []


def test_targets_that_slipped_on_the_tool_are_told_from_a_tracker_that_moved(hung):
    d, behind = hung.data, (hung.data.run_id >= 9)[:, None, None]
    slip = behind * (tool_poses(hung.cell.vjm, d.q)[1] @ [1.2e-3, -0.9e-3, 1.3e-3])[:, None]
    slipped = replace(hung, data=replace(d, before=d.before + slip, after=d.after + slip))
    [doubt] = named(slipped)
    assert doubt.name == "target_moved"
    assert doubt.sentence.startswith("the target moved by ")
    assert "run 8 and the unloaded reading of run 9" in doubt.sentence


def plate(cell, runs, targets):
    """An arm with so many targets on its tool, and sound readings of them in as many runs."""
    rng = np.random.default_rng(4)
    arm = replace(cell.arm, markers=tuple(f"T{k}" for k in range(targets)))
    vjm = replace(cell.vjm, arm=arm, markers=rng.uniform(-0.3, 0.3, (targets, 3)))
    q, (wrench, point), ids = random_q(cell, rng, runs) / 3, hung_load(cell, runs, 300.0), np.arange(runs) + 1
    where = evaluate_chain(vjm, q)
    theta = (arm.C_theta @ generalised_load(where, wrench, point)).T
    before, sigma = tool_points(vjm, q, vjm.markers), 3e-5
    after = before + first_order_deflection(where, theta, vjm.markers)
    before, after = (x + sigma * rng.standard_normal(x.shape) for x in (before, after))
    return vjm, Dataset(arm.markers, ids, ids, q, wrench, point, before, after, sigma)


def test_more_readings_than_are_weighed_together_raise_no_doubt(kr500, monkeypatch):
    monkeypatch.setattr(diagnosis, "MAX_ROBUST_READINGS", 40)
    assert told(*plate(kr500, runs=8, targets=12)) == []


def test_of_many_targets_two_that_have_each_others_names_are_named(kr500):
    vjm, data = plate(kr500, runs=8, targets=12)
    order = np.arange(12)
    order[[5, 9]] = 9, 5
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    data = replace(data, before=data.before @ turn.T + 2, after=data.after @ turn.T + 2)
    swapped = replace(data, before=data.before[:, order], after=data.after[:, order])
    assert told(vjm, data, "tracker") == []
    [(name, sentence), *_] = told(vjm, swapped, "tracker")
    assert name == "markers"
    assert "T5, T9" in sentence


@pytest.mark.study
def test_many_targets_take_little_memory(kr500):
    vjm, data = plate(kr500, runs=8, targets=150)
    tracemalloc.start()
    assert told(vjm, data) == []
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e8  # one matrix of every reading beside every other one has 104 MB
