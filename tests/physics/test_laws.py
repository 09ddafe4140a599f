"""What joints do beyond a linear spring: shapes against MuJoCo's arm, and what readings tell of them."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from loads import GRAVITY, hung
from run_here import here

from testbench import Load, deflections, load_model, predict, read_csv, score, stiffness, write_csv
from testbench.cli.program import program
from testbench.correct.newton import assign_rows
from testbench.data.dataset import select_rows
from testbench.identify.hierarchy import prior_evidence_model
from testbench.identify.method import gco, least_squares, robust, with_prior
from testbench.identify.posterior import intervals, model_of_estimate
from testbench.identify.prior import Prior, cad_prior, scale_by_prior
from testbench.identify.regression import reduce
from testbench.model import laws
from testbench.model import laws as shapes
from testbench.model.laws import LAW_SIZE_PRIOR, joint_laws
from testbench.model.load import read_body_masses
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import evaluate_chain, generalised_load_without_laws
from testbench.plant.disturbance import KR500_COMPENSATOR, TYPICAL_DISTURBANCES, Disturbances
from testbench.plant.equilibrium import solve_equilibrium, solve_unloaded_and_loaded
from testbench.plant.true_arms import disturb
from testbench.runs.rows import trial_rng
from testbench.studies.campaign.model_error import disturbed
from testbench.workflows.campaign import Scenario, simulate
from testbench.workflows.models import named_models, with_priors

SCENARIO = Scenario(
    arm="kr500_l480", truth="linear", noise=False, identification_poses=8, identification_runs=16
)
LINKS = 42  #: Virtual joints of the links.


def loaded(kr500, seed, runs=12):
    q = np.random.default_rng(seed).uniform(*(0.7 * kr500.arm.limits), (runs, 6))
    return q, *hung(kr500, runs, 4500 / GRAVITY)


def taken_off_again(plant, q, wrench, point, off):
    """The arm unloaded and loaded; where `off`, (runs,), unloaded after the load was taken off again."""
    before, after = solve_unloaded_and_loaded(plant, q, wrench, point)
    assign_rows(
        before, np.flatnonzero(off), select_rows(solve_equilibrium(plant, q, equilibrium_before=after), off)
    )
    return before, after


def true_turns(kr500, what, q, wrench, point, off=()):
    """Turns of MuJoCo's joints under the load, (runs, 6) [rad]."""
    plant = disturb(kr500.plant, what, np.random.default_rng(0))
    before, after = taken_off_again(plant, q, wrench, point, np.isin(np.arange(len(q)), off))
    return (after.theta - before.theta)[:, LINKS:48]


@pytest.mark.parametrize("kind", ["stiffening", "backlash", "compensator"])
def test_a_law_of_size_one_turns_joints_as_the_true_arm_does(kr500, kind):
    """But for what the bent arm changes of the torques, a percent or two, and for link 1 under the strut."""
    q, wrench, point = loaded(kr500, 3)
    vjm, own_weight = kr500.vjm, Disturbances(own_weight=True)
    longest = np.linalg.norm(np.cross(vjm.joint_axes[1], kr500.arm.compensator.head))
    stiffness = laws.UNIT_COMPENSATOR_STIFFNESS / kr500.arm.joints[1].compliance / longest**2
    ends = {end: tuple(getattr(kr500.arm.compensator, end)) for end in ("foot", "head")}
    strut = replace(KR500_COMPENSATOR, **ends, stiffness=stiffness)
    without, what = {
        "stiffening": (own_weight, replace(own_weight, stiffening=shapes.UNIT_STIFFENING)),
        "backlash": (own_weight, replace(own_weight, backlash=shapes.UNIT_BACKLASH_RAD)),
        "compensator": (Disturbances(), Disturbances(compensator=strut)),
    }[kind]
    more = true_turns(kr500, what, q, wrench, point) - true_turns(kr500, without, q, wrench, point)
    if kind != "compensator":
        vjm = replace(vjm, arm=replace(kr500.arm, compensator=None))
    where = evaluate_chain(laws.add_joint_laws(vjm), q)
    own = where.joint_laws.unit_deflections(
        where, generalised_load_without_laws(where, wrench, point)[LINKS:]
    )
    if kind == "compensator":
        expected, more = own[-1], more[:, 1]
    else:
        k = list(joint_laws).index(kind)
        expected = own[6 * k : 6 * k + 6].T
    assert np.abs(expected).max() > 2e-5
    np.testing.assert_allclose(more, expected, rtol=0, atol=0.06 * np.abs(expected).max())


def test_friction_holds_back_a_load_taken_off_by_all_of_its_width(kr500):
    """On the way there by a half, on the way back by another: twice the one less the other has none."""
    q, wrench, point = loaded(kr500, 3)
    what, off = Disturbances(own_weight=True, hysteresis=shapes.UNIT_FRICTION_RAD), np.arange(len(q)) % 2 == 0
    clean = true_turns(kr500, replace(what, hysteresis=0.0), q, wrench, point)
    on, back = (true_turns(kr500, what, q, wrench, point, own) for own in ((), np.flatnonzero(off)))
    where = evaluate_chain(laws.set_load_history(laws.add_joint_laws(kr500.vjm), off), q)
    expected = where.joint_laws.unit_deflections(
        where, generalised_load_without_laws(where, wrench, point)[LINKS:]
    )[12:18].T
    np.testing.assert_allclose(back - clean, expected, rtol=0, atol=0.06 * shapes.UNIT_FRICTION_RAD)
    np.testing.assert_array_equal(back[~off], on[~off])
    far = off[:, None] & (np.abs(clean) > 3 * shapes.UNIT_FRICTION_RAD)
    assert far.any(axis=0).sum() >= 3
    np.testing.assert_allclose((2 * on - back)[far], clean[far], rtol=0, atol=0.1 * shapes.UNIT_FRICTION_RAD)
    assert np.abs(back - on)[far].min() > 0.9 * shapes.UNIT_FRICTION_RAD


def test_readings_of_loads_taken_off_are_of_use_where_they_say_so(kr500, campaigns):
    """Fits, predictions and intervals take friction as the run was read."""
    plain, truth = simulate(kr500, SCENARIO, 5).identification, campaigns["all"][1]
    off = np.arange(plain.n_runs) % 2 == 1
    arm = disturb(kr500.plant, TYPICAL_DISTURBANCES, trial_rng(5, 20))
    before, after = taken_off_again(arm, plain.q, plain.wrench, plain.point, off)
    silent = replace(plain, before=before.marker_positions, after=after.marker_positions)
    data = replace(silent, unloaded_after_load=off)
    found, wrong = (default(kr500, own) for own in (data, silent))
    ours, theirs = rms(kr500, truth, found, wrong)
    assert ours < 0.9 * theirs
    moved = deflections(kr500.vjm, found, data)
    np.testing.assert_allclose(intervals(kr500.vjm, found, data).centre, moved, rtol=0, atol=1e-12)
    less = np.abs(moved - deflections(kr500.vjm, found, silent)).max(axis=(1, 2))
    assert (less[off] > 1e-5).any()
    np.testing.assert_array_equal(less[~off], 0)


def test_slopes_are_the_change_of_the_turns_and_what_sticks_gives_nothing_to_a_small_load(kr500):
    q, wrench, point = loaded(kr500, 5)
    off = np.arange(len(q)) % 2 == 1  # loads that were taken off: friction's whole width
    for lawful in (
        laws.add_joint_laws(kr500.vjm),
        laws.set_load_history(laws.add_joint_laws(kr500.vjm), off),
    ):
        where = evaluate_chain(lawful, q)
        u = (
            0.02 * generalised_load_without_laws(where, wrench, point)[LINKS:]
        )  # some joints slip, some do not
        step = 1e-3
        own = where.joint_laws.unit_slopes(where, u)
        by_steps = (
            where.joint_laws.unit_deflections(where, u + step)
            - where.joint_laws.unit_deflections(where, u - step)
        ) / (2 * step)
        np.testing.assert_allclose(own, by_steps, rtol=0, atol=1e-5 * np.abs(own).max())
    vjm, joints = laws.add_joint_laws(kr500.vjm), slice(LINKS, 48)
    C = np.diag(np.r_[np.diag(kr500.arm.C_theta), np.repeat([0.0, 0.0, 3.0], 6), 0.0])
    where = evaluate_chain(vjm, loaded(kr500, 8, runs=2)[0])
    found = laws.tangent_C_theta(vjm, C, where, np.zeros((48, 2)))
    np.testing.assert_array_equal(found[:, joints, joints], np.zeros((2, 6, 6)))
    pushed = laws.tangent_C_theta(vjm, C, where, np.full((48, 2), 1e5))  # slipping: its spring alone
    np.testing.assert_array_equal(pushed[0, joints, joints], C[joints, joints])


def default(cell, data, structure=None):
    """Its estimate of runs, by its own structure or another."""
    [model] = with_priors(cell.arm, named_models(cell, ["ALL153"]), cad_prior(cell.arm))
    return model.estimator(cell.vjm, structure or model.structure, data)


def rms(cell, truth, *estimates):
    return [score(deflections(cell.vjm, e, truth), truth.deflection).rms for e in estimates]


@pytest.fixture(scope="module")
def campaigns(kr500):
    """Noise-free campaigns of an arm as drawn, and with every disturbance; readings and true deflections."""
    plain = simulate(kr500, SCENARIO, 5)
    return {
        "plain": (plain.identification, plain.truth),
        "all": disturbed(kr500, plain, TYPICAL_DISTURBANCES, 5),
    }


@pytest.fixture(scope="module")
def estimates(kr500, campaigns):
    """Of both campaigns those of the default, and of the same without laws."""
    runs, linear = {kind: data for kind, (data, _) in campaigns.items()}, all153(kr500.arm)
    return {kind: (default(kr500, own), default(kr500, own, linear)) for kind, own in runs.items()}


def test_where_joints_obey_laws_the_default_finds_them_and_elsewhere_none(kr500, campaigns, estimates):
    """Nearly: laws keep a small weight, and widths count that they are not ruled out."""
    (_, truth), (found, linear) = campaigns["all"], estimates["all"]
    assert found.averaged_models.joint_laws_weight == 1
    assert found.conservative
    ours, theirs = rms(kr500, truth, found, linear)
    assert ours < 0.7 * theirs
    own = intervals(kr500.vjm, found, truth)
    assert np.mean((own.lower <= truth.deflection) & (truth.deflection <= own.upper)) > 0.9
    (_, truth), (found, linear) = campaigns["plain"], estimates["plain"]
    assert found.averaged_models.joint_laws_weight == 0
    priors = found.averaged_models.interval_models
    assert 0.05 < sum(p * prior.averaged_models.interval_models[0][0] for p, prior in priors) < 0.5
    ours, theirs = (deflections(kr500.vjm, own, truth) for own in (found, linear))
    assert score(ours, theirs).rms < 3e-6
    half = [own.upper - own.lower for own in (intervals(kr500.vjm, e, truth) for e in (found, linear))]
    assert 1 < np.median(half[0] / half[1]) < 1.4


def test_laws_are_of_a_learnt_prior_alone(kr500, campaigns):
    data, _ = campaigns["all"]
    s = laws.add_law_parameters(all153(kr500.arm), kr500.arm)
    assert s.row_labels[48:50] == ("joint_1 stiffening", "joint_2 stiffening")
    assert s.row_labels[-1] == "joint_2 compensator"
    assert laws.add_law_parameters(s, kr500.arm) is s
    assert laws.remove_law_parameters(s) is laws.remove_law_parameters(
        s
    )  # what is remembered of a structure is of use
    assert laws.remove_law_parameters(laws.remove_law_parameters(s)) is laws.remove_law_parameters(s)
    for estimator in (least_squares, gco):
        assert estimator(kr500.vjm, s, data).structure.n_laws == 0
    [model] = with_priors(kr500.arm, named_models(kr500, ["Joints"]), cad_prior(kr500.arm))
    assert model.structure.n_laws == 0
    with_prior(gco, cad_prior(kr500.arm))(kr500.vjm, joints_only(kr500.arm), data)
    firm = robust(with_prior(gco, cad_prior(kr500.arm)))  # as cross-validation has it, reduced with laws
    found = firm.fit_reduced(kr500.vjm, reduce(kr500.vjm, s, data))
    linear = firm.fit_reduced(kr500.vjm, reduce(kr500.vjm, all153(kr500.arm), data))
    assert found.structure.n_laws == 0
    np.testing.assert_allclose(found.pi, linear.pi, rtol=0, atol=1e-6 * np.abs(linear.pi).max())


def test_predictions_and_stiffness_of_a_model_with_laws(kr500, campaigns, estimates):
    """The equilibrium is the linear prediction but for the bent arm, the tangent its change with the load."""
    data, found = campaigns["all"][0], estimates["all"][0]
    own = model_of_estimate(kr500.vjm, found, read_body_masses(kr500.arm))
    some = slice(0, 4)
    load = Load(data.wrench[some], data.point[some])
    by_rest, straight = (predict(own, data.q[some], [load], linear=linear) for linear in (False, True))
    np.testing.assert_allclose(by_rest.deflection, straight.deflection, rtol=0, atol=2.5e-4)
    expected = deflections(kr500.vjm, found, data)[some]
    np.testing.assert_allclose(straight.deflection[:, 1:], expected, rtol=0, atol=1e-5)
    ends = [Load(data.wrench[some] + step * np.eye(6)[2], 0 * load.point) for step in (0, 1e-1)]
    at_tool = [predict(own, data.q[some], [end]).deflection[:, 0] for end in ends]
    by_steps = (at_tool[1] - at_tool[0]) / 1e-1
    found = stiffness(own, data.q[some], ends[:1]).compliance[:, :3, 2]
    np.testing.assert_allclose(found, by_steps, rtol=0, atol=0.02 * np.abs(by_steps).max())


@pytest.mark.study
def test_a_model_with_laws_is_told_kept_and_read_again(kr500, campaigns, tmp_path):
    """From the command to the folder and back: sizes in its table, the same predictions."""
    data, out = tmp_path / "data.csv", tmp_path / "fit"
    write_csv(campaigns["all"][0], kr500.arm, data)
    done = here(program(["identify"]), "identify", "kr500_l480", data, "--model", "ALL153", "--out", out)
    assert done.returncode == 0, done.stderr
    said = json.loads((out / "report.json").read_text())
    assert [row["part"] for row in said["laws"]] == [f"joint_{k}" for k in range(1, 7)]
    own = load_model(out)
    sizes, scales = laws.law_sizes(own.vjm, own.state.C_theta), {"percent": 100, "urad": 1e6}
    columns = {"stiffening": "stiffer_percent", "backlash": "backlash_urad", "friction": "friction_urad"}
    for row in said["laws"]:
        for kind, size in sizes[row["part"]].items():
            key = columns.get(kind, "strut_percent")
            shown = scales[key.split("_")[1]] * laws.law_unit(kind) * size
            assert row[key] == pytest.approx(shown, rel=1e-3)
    assert said["laws"][0]["strut_percent"] is None
    fresh = model_of_estimate(
        kr500.vjm, default(kr500, read_csv(data, kr500.arm)), read_body_masses(kr500.arm)
    )
    some = campaigns["all"][0]
    ours, again = (predict(m, some.q, [Load(some.wrench, some.point)]).deflection for m in (fresh, own))
    np.testing.assert_allclose(again, ours, rtol=0, atol=2e-5)


def test_sizes_of_laws_scatter_as_the_prior_says_whose_scale_is_none_of_theirs(kr500, campaigns):
    data, s = campaigns["all"][0], laws.add_law_parameters(all153(kr500.arm), kr500.arm)
    priors = [Prior("scaled", scale * kr500.arm.C_theta) for scale in (1, 3)]
    found = [with_prior(gco, own)(kr500.vjm, s, data) for own in priors]
    np.testing.assert_allclose(found[1].pi, found[0].pi, rtol=1e-6, atol=1e-9 * np.abs(found[0].pi).max())
    vjm = laws.vjm_for_structure(kr500.vjm, s)
    own = prior_evidence_model(reduce(vjm, s, data), scale_by_prior(cad_prior(kr500.arm), kr500.vjm, s))
    normal, size = own.evidence.hyperpriors[0], math.log(LAW_SIZE_PRIOR[0])
    losses = []
    for steps in (0, 1, 2):
        h = np.zeros(len(own.hyperparameter_medians))
        h[own.n_scales + 2 : own.n_scales + 5] = size + steps * LAW_SIZE_PRIOR[1] * np.array([1, 0, 0])
        losses.append(normal.neg_log_density(normal.coefficients @ h - normal.offset)[0].sum())
    assert np.diff(losses) == pytest.approx([0.5, 1.5])
