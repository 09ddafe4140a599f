"""Any serial arm: any pose of any body in any notation, hinges and slides, 3 to 9 joints; the UR10."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from loads import random_q
from serial_arms import turned_arm, write_arm

from testbench import cad_prior, least_squares, read_series
from testbench.errors import BenchError, InputError
from testbench.identify.absolute.align import align_all, residuals
from testbench.identify.absolute.state import nominal_state
from testbench.model.load import read_body_masses
from testbench.model.structure import mgco147
from testbench.plant.disturbance import NOMINAL_DISTURBANCES, TYPICAL_DISTURBANCES
from testbench.plant.equilibrium import solve_equilibrium, solve_unloaded_and_loaded
from testbench.plant.true_arms import disturb
from testbench.workflows.campaign import Scenario, measure_markers, poses_with_weight, simulate
from testbench.workflows.cell import build_cell
from testbench.workflows.fits import MeasuredRuns, fit_models
from testbench.workflows.models import default_models, default_name, named_models, plain_name


@pytest.mark.parametrize("turned", ['zaxis="0 0 -1"', 'xyaxes="0 0 2 0 -1 0"', 'euler="0 0 1.57"', ""])
def test_the_shortest_turn_and_special_poses_are_mujocos(turned, tmp_path):
    folder = write_arm(tmp_path / "arm", "zyyxyx", pose=lambda _: turned)
    assert build_cell(folder).arm.n_joints == 6


def test_what_truth_and_model_read_differently_is_refused_by_name(kr500, tmp_path, monkeypatch):
    """Seeded: the model takes its euler angles in the wrong order."""
    folder = shutil.copytree(kr500.arm.mjcf_path.parent, tmp_path / "arm")
    text = (folder / "rigid.xml").read_text("utf-8")
    turned = text.replace('<body name="tool"', '<body name="tool" euler="0.3 0.2 0.1"')
    (folder / "rigid.xml").write_text(turned, "utf-8")
    build_cell(folder)
    rotate, other = pin.utils.rotate, dict(zip("xyz", "zyx", strict=True))
    monkeypatch.setattr(pin.utils, "rotate", lambda axis, angle: rotate(other[axis], angle))
    said = r"rigid\.xml: <body name='tool'>: MuJoCo and Pinocchio place it .* apart"
    with pytest.raises(InputError, match=said):
        build_cell(folder)


@pytest.mark.parametrize(
    ("turned", "words"),
    [('quat="0 0 0 0"', "quat: expected directions"), ('zaxis="0 0 1" euler="0 0 0"', "expected one orient")],
)
def test_a_pose_that_is_none_names_its_body(turned, words, tmp_path):
    folder = write_arm(tmp_path / "arm", "zyy", pose=lambda name: turned if name == "link_2" else "")
    with pytest.raises(InputError, match=words) as info:
        build_cell(folder)
    assert "<body name='link_2'>" in str(info.value)


@pytest.mark.parametrize("joints", ["y", "Z", "zzZ", "zyyxyx", "zyzyzyz", "XYZzyxzyx"])
def test_a_gravity_campaign_of_any_arm_is_identified_to_rounding(joints, tmp_path):
    rng = np.random.default_rng(3)
    cell = build_cell(turned_arm(tmp_path / "arm", rng, joints))
    q = random_q(cell, rng, 12)
    setup = Scenario(arm=cell.arm.name, truth="linear", payload=10.0, noise=False)
    data = measure_markers(cell, setup, poses_with_weight(cell, q, np.arange(12) + 1, 10.0))
    found = least_squares(cell.vjm, mgco147(cell.arm), data)
    assert np.abs(data.deflection).max() > 3e-5
    assert found.f_m < 1e-10  # in sigmas of 50 um: deflections of millimetres round at 1e-16 m


@pytest.mark.parametrize(
    ("joints", "turned", "names"),
    [
        ("zzZ", "", "Joints MLS32 MGCO32 MGCO84 ALL87"),
        ("zyzyzyz", "", "Joints MLS64 MGCO64 MGCO168 ALL175"),
        ("zyzyzyzXY", "", "Joints MLS80 MGCO80 MGCO210 ALL219"),
        ("zyyxyx", "", "Joints MLS56 MGCO68 MGCO147 ALL153"),
        # below a ceiling joint 1 is upright as well
        ("zyyxyx", 'euler="3.14159265358979 0 0.3"', "Joints MLS56 MGCO68 MGCO147 ALL153"),
        ("zyyxyx", 'euler="0.3 0 0"', "Joints MLS56 MGCO69 MGCO147 ALL153"),
        ("XyyxyZ", "", "Joints MLS56 MGCO68 MGCO147 ALL153"),
        ("ZyyxyZ", "", "Joints MLS56 MGCO69 MGCO147 ALL153"),
    ],
)
def test_models_are_called_by_their_unknowns_joint_1_among_them_where_gravity_loads_it(
    joints, turned, names, tmp_path
):
    folder = write_arm(tmp_path / "arm", joints, pose=lambda body: turned if body == "link_0" else "")
    cell, names = build_cell(folder), names.split()
    models, cad = named_models(cell, names), cad_prior(cell.arm)
    assert [m.name for m in models] == [m.structure.name for m in models] == names
    assert [int(m.name.strip("MLSGCOA")) for m in models[1:]] == [
        m.structure.n_parameters for m in models[1:]
    ]
    assert named_models(cell, ["all"])[0].name == names[-1]
    plain, default = [[m.name for m in default_models(cell, prior)] for prior in (None, cad)]
    assert plain_name(cell) == names[2]
    assert {names[2], f"{names[2]} + prior"} <= set(default)
    assert default[-1] == default_name(cell) == f"{names[-1]} + prior"
    assert len(set(plain)) == len(plain)
    of = "" if len(joints) == 6 else r" of arm, \d joints"
    with pytest.raises(BenchError, match=f"no model 'MGCO70'{of}; models are Joints, MLS"):
        named_models(cell, ["MGCO70"])


def test_slides_have_friction_and_play_and_come_to_rest_with_them(slides):
    rng = np.random.default_rng(2)
    q = random_q(slides, rng, 10)
    wrench = np.tile([0, 0, -9.81 * 10, 0, 0, 0], (10, 1))
    disturbed = disturb(slides.plant, replace(TYPICAL_DISTURBANCES, compensator=None), rng)
    _, after = solve_unloaded_and_loaded(disturbed, q, wrench, np.tile(slides.vjm.load_point, (10, 1)))
    second = 6 * len(slides.arm.links) + 1
    plain = replace(disturbed, disturbances=NOMINAL_DISTURBANCES, load_point_error=np.zeros(3))
    linear = solve_equilibrium(plain, q, wrench, np.tile(slides.vjm.load_point, (10, 1)))
    play = np.abs(after.theta - linear.theta)[:, second]
    assert (play > 0).all()
    assert play.max() < 2e-4  # play, friction and stiffening of a slide: 50, 30 and some um
    with pytest.raises(BenchError, match="expected a hinge between links 1 and 2 of slides, got a slide"):
        disturb(slides.plant, TYPICAL_DISTURBANCES, rng)


def test_a_campaign_of_any_arm_is_under_its_payload_in_all_its_reach(tmp_path):
    cell = build_cell(write_arm(tmp_path / "arm", "zyyZ"))
    campaign = simulate(cell, seed=3)
    asked = campaign.scenario
    assert (asked.payload, asked.station, asked.workspace) == (10.0, None, None)
    np.testing.assert_allclose(campaign.measured.wrench[:, 2], -98.1)
    q = campaign.truth.q
    assert np.ptp(q, axis=0) == pytest.approx(np.ptp(cell.arm.limits, axis=0), rel=0.1)  # 200 poses
    bare = replace(cell, arm=replace(cell.arm, payload=None))
    with pytest.raises(BenchError, match=r"payload \[kg\]: expected a payload, as arm states none"):
        simulate(bare, seed=3)
    section_6 = Scenario(arm="kr500_l480")
    assert section_6.payload == 460.3
    assert section_6.station.lower == (1.7, -0.9, 1.1)


@pytest.mark.study
def test_an_arm_whose_joints_no_load_turns_is_identified_by_its_links(tmp_path):
    """Hinges about z and slides along y: a hung weight bends the links alone."""
    cell = build_cell(write_arm(tmp_path / "arm", "zYzYzY", mount='euler="0 0 0.7"'))
    data = simulate(cell, seed=1).identification
    models = default_models(cell, cad_prior(cell.arm))
    found = fit_models(cell, models, MeasuredRuns("runs.csv", data, data, None), lambda: 0.0).fits
    assert found.recommended == default_name(cell)
    assert "Joints" not in [model.name for model in found.models]
    assert "Joints is left out: no load deflects its links and joints" in found.notes
    with pytest.raises(
        BenchError, match=r"expected loads that deflect a part of the model; these deflect none of Joints$"
    ):
        fit_models(
            cell, named_models(cell, ["Joints"]), MeasuredRuns("runs.csv", data, data, None), lambda: 0.0
        )


READINGS = Path(__file__).parents[2] / "models" / "ur10" / "readings"


@pytest.fixture(scope="module", params=[("series_A_every_8th", 1489), ("series_C", 2773)], ids=["A", "C"])
def readings(request, ur10):
    name, rows = request.param
    [series] = read_series(READINGS / f"{name}.csv", ur10.arm).series
    assert series.n_rows == rows
    return series


def test_frame_and_mount_alone_explain_what_a_tracker_read_to_a_millimetre(ur10, readings):
    """A joint's sign, zero or place in the order, or a length, would leave centimetres and degrees."""
    state = align_all(nominal_state(ur10.vjm, read_body_masses(ur10.arm), np.ones(6)), (readings,))
    position, rotation = np.linalg.norm(residuals(state, readings), axis=1)
    assert position.mean() < 1e-3  # 0.8 and 0.9 mm; the geometry of the arm is nominal
    assert np.rad2deg(np.sqrt(np.mean(rotation**2))) < 0.15
    np.testing.assert_allclose(state.mount(readings).points, ur10.vjm.markers, rtol=0, atol=2e-3)
    # gravity: both trackers were levelled, so the arm stood upright
    assert np.rad2deg(np.arccos(state.frame(readings).rotation[2, 2])) < 1
