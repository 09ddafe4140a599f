"""Simulated absolute readings: MuJoCo's true arm against the model with true parameters; what is chosen."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

from testbench import BenchError, cad_prior
from testbench.data.dataset import select_rows
from testbench.identify.absolute import choose
from testbench.identify.absolute import state as absolute
from testbench.identify.absolute.evidence import WIDE_PRIOR, ErrorScales, solve_active_unknowns
from testbench.identify.absolute.fit import CalibrationOptions, calibrate
from testbench.identify.absolute.state import nominal_state, series_equilibrium
from testbench.model.kinematics import JointErrorTerms
from testbench.model.load import read_body_masses
from testbench.model.vjm import evaluate_chain
from testbench.plant.build import build_plant
from testbench.plant.disturbance import Disturbances, GearErrors, GeometryErrors
from testbench.plant.equilibrium import solve_equilibrium
from testbench.workflows.absolute_campaign import OUTLIER_SIZE, REAL_ARM, AbsoluteCampaign, simulate_series
from testbench.workflows.cell import Cell

WEIGHT = Disturbances(own_weight=True)
EXACT = AbsoluteCampaign(poses=12, series=2, targets=3, orientations=True, noise=False, disturbances=WEIGHT)


def seen(truth, series, where):
    """Targets and mount of a chain as a tracker sees them: three frames, one after the other."""
    station, mount = truth.stations[series], truth.mounts[series]
    tool = where.tool_rotation @ mount.rotation
    targets = np.einsum("rxy,my->rmx", where.tool_rotation, truth.markers @ mount.rotation.T + mount.position)
    world = where.tool_position[:, None] + targets
    return world @ station.rotation.T + station.position, station.rotation @ tool


def true_poses(truth, series, *at):
    """The same of the true arm at rest, in poses under loads."""
    rest = solve_equilibrium(truth.arm, *at)
    return seen(
        truth, series, SimpleNamespace(tool_position=rest.tool_positions, tool_rotation=rest.tool_rotations)
    )


def rms(x):
    return np.sqrt((x**2).mean())


def same(one, other):
    pairs = ([np.asarray(getattr(x, f.name)).tobytes() for x in (one, other)] for f in fields(one))
    return all(a == b for a, b in pairs)


@pytest.mark.parametrize("name", ["kr500", "slides"])
def test_true_geometry_without_weight_is_the_chain_at_theta_0(name, request):
    """Errors of 5 mm and 10 mrad, of joints that slide too: not to first order, but exactly."""
    cell = request.getfixturevalue(name)
    errors = Disturbances(geometry=GeometryErrors(5e-3, 10e-3), joint_offset_sigma=1e-3)
    both, truth = simulate_series(cell, EXACT.model_copy(update={"disturbances": errors}), 3)
    for k, series in enumerate(both):
        where = evaluate_chain(cell.vjm, series.q, np.tile(truth.theta_0, (series.n_rows, 1)))
        position, rotation = seen(truth, k, where)
        np.testing.assert_allclose(series.position, position, rtol=0, atol=1e-12)  # rounding of 10 m
        np.testing.assert_allclose(series.rotation, rotation, rtol=0, atol=1e-12)
    assert np.abs(truth.theta_0).max() > 5e-3


def test_readings_come_from_the_seed_a_switch_leaves_all_else_and_too_much_is_refused(kr500):
    asked = EXACT.model_copy(update={"noise": True, "outliers": 0.2, "repeatability": 1e-5})
    (first, second), truth = simulate_series(kr500, asked, 7)
    (again, _), _ = simulate_series(kr500, asked, 7)
    (alone,), _ = simulate_series(kr500, asked.model_copy(update={"series": 1}), 7)
    (other, _), _ = simulate_series(kr500, asked, 8)
    assert same(first, again)
    assert same(first, alone)
    assert not same(first, other)
    assert not np.array_equal(first.q, second.q)
    off = {"noise": False, "outliers": 0.0, "repeatability": 0.0}
    (clean, _), _ = simulate_series(kr500, asked.model_copy(update=off), 7)
    (wild, _), _ = simulate_series(kr500, asked.model_copy(update={**off, "outliers": 0.2}), 7)
    np.testing.assert_array_equal(clean.q, first.q)
    size = np.linalg.norm(wild.position - clean.position, axis=2)
    np.testing.assert_allclose(size, OUTLIER_SIZE * truth.outliers[0], rtol=0, atol=1e-12)
    with pytest.raises(BenchError, match="targets: expected at most 3, as kr500_l480 has P1, P2, P3"):
        simulate_series(kr500, AbsoluteCampaign(targets=4))
    with pytest.raises(BenchError, match="masses: expected different ones"):
        AbsoluteCampaign(masses=(1.0, 1.0))


def test_noise_is_as_large_as_the_series_says(kr500):
    asked = EXACT.model_copy(update={"noise": True, "poses": 300, "series": 1, "sigma_rotation": 1e-4})
    (read,), truth = simulate_series(kr500, asked, 3)
    position, rotation = true_poses(truth, 0, read.q)
    assert rms(read.position - position) == pytest.approx(50e-6, rel=0.06)  # 2,700 numbers: 1.4 %
    turn = read.rotation @ rotation.swapaxes(1, 2)
    assert rms(turn[:, [2, 0, 1], [1, 2, 0]]) == pytest.approx(1e-4, rel=0.1)  # 900 numbers: 2.4 %


def test_loads_hang_one_after_the_other_in_the_pose_that_was_approached(kr500):
    """A pair bends as the arm does from where it stands; scatter of the approach is common to it."""
    update = {"masses": (0.0, 460.3), "loaded_poses": 5, "repeatability": 1e-3, "series": 1}
    (pairs,), truth = simulate_series(kr500, EXACT.model_copy(update=update), 3)
    assert pairs.n_rows == 12 + 5
    assert pairs.pose_id.tolist() == sorted([*range(1, 13), *range(1, 6)])
    first, loaded = pairs.wrench[:, 2] == 0, pairs.wrench[:, 2] < 0
    assert np.unique(pairs.pose_id[loaded]).tolist() == [1, 2, 3, 4, 5]
    at = [(pairs.q[some], pairs.wrench[some], pairs.point[some]) for some in (first, loaded)]
    no_scatter = [true_poses(truth, 0, *some)[0] for some in at]
    moved = pairs.position[loaded] - pairs.position[first][:5]
    expected = no_scatter[1] - no_scatter[0][:5]
    assert rms(pairs.position[first] - no_scatter[0]) > 1e-3
    assert rms(moved - expected) < 5e-3 * rms(expected)  # a milliradian turns a deflection by 1e-3


def softer(cell, **scales):
    """An arm whose links or joints give way so many times as much, in truth."""
    own = {
        kind: tuple(replace(part, compliance=scale * part.compliance) for part in getattr(cell.arm, kind))
        for kind, scale in scales.items()
    }
    return Cell(cell.arm, cell.vjm, build_plant(replace(cell.arm, **own)))


def off(cell, disturbances, mass):
    """How far a state with the parameters of the true arm is from its exact readings, (rows,) [m]."""
    asked = AbsoluteCampaign(poses=30, masses=(mass,), noise=False, disturbances=disturbances)
    (series,), truth = simulate_series(cell, asked, 3)
    mount, station = truth.mounts[0], truth.stations[0]
    state = replace(
        nominal_state(cell.vjm, read_body_masses(cell.arm), np.ones(cell.arm.n_joints)),
        theta_0=truth.theta_0,
        C_theta=truth.C_theta,
    )
    if (gears := truth.arm.gear_errors) is not None:
        orders = tuple(range(1, len(gears.sine) + 1))
        n = np.concatenate([gears.sine, gears.cosine, gears.ratio_error[None]]).T
        state = replace(state, error_terms=JointErrorTerms(orders=orders, ratio=True), error_coefficients=n)
    tool = series_equilibrium(state, series).chain
    points = truth.markers @ mount.rotation.T + mount.position
    seen = tool.tool_points_in_world(points) @ station.rotation.T + station.position
    return np.linalg.norm(seen - series.position, axis=2)[:, 0]


@pytest.mark.parametrize(("name", "steps"), [("kr500", 0), ("kr500", 2), ("slides", 1)])
def test_every_load_step_gains_an_order_in_the_compliance(name, steps, request, monkeypatch):
    """Half the compliance leaves a quarter of the error of loads on the straight arm, then 1/8 and 1/16."""
    cell = request.getfixturevalue(name)
    monkeypatch.setattr(absolute, "CALIBRATION_EQUILIBRIUM_STEPS", steps)
    mass = cell.arm.payload or 20.0
    whole, half = (off(softer(cell, links=scale, joints=scale), WEIGHT, mass).mean() for scale in (4.0, 2.0))
    assert whole / half == pytest.approx(2 ** (2 + steps), rel=0.01)
    assert half > 1e-10  # more than where MuJoCo's equilibrium ends


@pytest.mark.parametrize("mass", [0.0, 460.3])
def test_true_parameters_leave_less_than_a_micrometre(kr500, mass):
    """What is left of millimetres of sag: the sag turns the errors of geometry, which the model adds."""
    assert off(kr500, replace(REAL_ARM, gear_errors=GearErrors(ratio_sigma=1e-4)), mass).mean() < 1e-6


@pytest.mark.study
def test_joint_errors_that_stand_in_for_soft_links_are_declined_once_links_are_known(kr500):
    """Without joint errors in the truth: of four such arms one where they pay beside rigid links."""
    asked = AbsoluteCampaign(poses=60, disturbances=replace(REAL_ARM, gear_errors=None))
    series, _ = simulate_series(softer(kr500, links=6), asked, 4)
    prior = cad_prior(kr500.arm)
    rigid = calibrate(
        kr500.vjm, series, prior, CalibrationOptions(max_order=8, excluded_errors=frozenset({"links"}))
    )
    found = calibrate(kr500.vjm, series, prior, CalibrationOptions(max_order=8))
    assert {"joint springs", "joint errors"} <= {step.name for step in rigid.selection.steps if step.kept}
    steps = {step.name: step.kept for step in found.selection.steps}
    assert (steps["joint errors"], steps["links"]) == (False, True)
    assert not found.state.error_coefficients.any()


@pytest.mark.study
def test_a_series_is_foretold_only_by_a_fair_share_of_the_readings(kr500, monkeypatch):
    """What 12 readings in one corner tell of an arm must not decide which errors it has."""
    (long, short), _ = simulate_series(kr500, AbsoluteCampaign(series=2, poses=100), 21)
    held, left = [], choose._held_out

    def noted(own, S, parts, *more, faces):
        held.append(parts)
        return left(own, S, parts, *more, faces=faces)

    monkeypatch.setattr(choose, "_held_out", noted)
    far = np.linalg.norm(short.q - short.q[0], axis=1)
    near = select_rows(short, np.sort(np.argsort(far)[:12]))
    for some, series in (((long, short), {0, 1}), ((long, near), {1})):
        held.clear()
        found = calibrate(kr500.vjm, some, cad_prior(kr500.arm), CalibrationOptions(max_order=2))
        assert {parts[0].series_index for parts in held if len(parts) > 1} == series
        assert max(step.rms_after for step in found.selection.steps) < 1e-3


def test_a_block_whose_frame_the_others_hardly_tell_is_fitted_to_it(rng):
    """Two columns, the first told by the block alone but for a trace: left is what no frame explains."""
    block, others = rng.normal(size=(30, 3)), rng.normal(size=(30, 3))
    others[:, 0] *= 1e-4
    T = block.T @ block
    S = T + others.T @ others
    own = SimpleNamespace(columns=np.arange(2), n_rigid=2, compliance_prior=None)
    part = SimpleNamespace(gram_matrices=T[None], n_equations=np.array([30]))
    learnt = ErrorScales(np.array([np.inf, 1.0]), np.ones(1))
    own.unknowns = SimpleNamespace(size=2)
    whole = solve_active_unknowns(own, S[None], learnt, WIDE_PRIOR).variances(np.arange(1))
    rules = choose.SelectionRules(np.ones(1))
    [left], _ = choose._held_out(own, S[None], [part], (learnt, rules), whole, faces=False)
    [_, second] = solve_active_unknowns(own, (S - T)[None], learnt, WIDE_PRIOR).x
    rest = block[:, 2] - block[:, 1] * second
    first = block[:, :1]
    assert left == pytest.approx(np.sum((rest - first @ np.linalg.lstsq(first, rest, rcond=None)[0]) ** 2))
