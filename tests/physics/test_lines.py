"""Readings along lines: exact rows of every instrument, the contact of a gauge, and tilts."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from testbench.data.dataset import line_precision, select_runs
from testbench.errors import BenchError
from testbench.identify.absolute.state import compliance_unknowns
from testbench.identify.equations import (
    deflection_equations,
    directions_under_load,
    predicted_motion,
    resolve_line_readings,
    undeflected_arm,
    weighted_readings,
)
from testbench.identify.method import least_squares
from testbench.identify.regression import reduce
from testbench.model.load import Load
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import marker_positions
from testbench.plant.tracker import GAUGE_PRELOAD_FRACTION, DistanceMeter, Gauge, IsotropicTracker, tip_travel
from testbench.runs.rows import trial_rng
from testbench.workflows.campaign import poses_with_weight, read_instruments
from testbench.workflows.instruments import Mounted

EXACT = Gauge(sigma=1e-9, tilt_sigma=0.0, resolution=0.0)
WIRE = DistanceMeter(sigma=1e-9, fixed_point_sigma=0.0, max_change=1.0)
XYZ = [Mounted(EXACT, f"P{k + 1}", axis) for k, axis in enumerate(np.eye(3))]
FIXED = np.array([1.5, -0.4, 0.2])


def measured(cell, mounted, seed=3, poses=4, mass=100.0, truth="linear", pose=None):
    """Runs of random poses under a weight, read by some instruments."""
    q = cell.arm.draw_poses(np.random.default_rng(seed), poses)
    pose = np.arange(poses) if pose is None else pose
    loaded = poses_with_weight(cell, q[pose], pose + 1, mass)
    return read_instruments(cell, truth, loaded, mounted, trial_rng(seed, 1))


def unresolved_rows(cell, data, structure):
    """Rows of a dataset in metres, its directions as they are stated."""
    still = replace(data, tilt_error=np.zeros_like(data.before))
    state = undeflected_arm(cell.vjm, data.q, [Load(data.wrench, data.point)])
    A, _ = deflection_equations(
        compliance_unknowns(cell.vjm, structure), state, still, np.arange(data.n_runs)
    )
    return A[:, 0, :-1] * np.sqrt(np.trace(data.covariance, axis1=2, axis2=3)).T[:, None]


@pytest.mark.parametrize("kind", ["gauge", "distance"])
def test_rows_of_readings_along_lines_are_the_derivatives_of_what_the_instruments_read(kr500, kind, rng):
    """Differences of the plant's own formulas; plant and model share no code."""
    mounted = XYZ if kind == "gauge" else [Mounted(WIRE, f"P{k}", fixed=FIXED) for k in (1, 2, 3)]
    data, structure = measured(kr500, mounted), all153(kr500.arm)
    A = unresolved_rows(kr500, data, structure)
    state = undeflected_arm(kr500.vjm, data.q, [Load(data.wrench, data.point)])
    points = marker_positions(kr500.vjm, data.markers)
    start = state.chain.tool_points_in_world(points)
    for n in rng.choice(structure.n_parameters, 20, replace=False):
        pi = np.eye(structure.n_parameters)[n]
        theta = structure.C_theta_of(pi) @ state.generalised_loads
        twist = np.einsum("xtr,tr->rx", state.chain.J_theta, theta)
        size = np.abs(twist).max()
        if size == 0:
            assert not A[:, n].any()
            continue
        read = []
        for h in (-1e-5 / size, 1e-5 / size):
            turn = Rotation.from_rotvec(h * twist[:, 3:]).as_matrix()
            arms = np.einsum("rxy,ky->rkx", state.chain.tool_rotation, points)
            end = (
                state.chain.tool_position[:, None]
                + h * twist[:, None, :3]
                + np.einsum("rxy,rky->rkx", turn, arms)
            )
            if kind == "gauge":
                u = data.line_direction
                read.append([tip_travel(u[:, k], u[:, k], start[:, k], end[:, k], turn) for k in range(3)])
            else:
                read.append(np.linalg.norm(end - FIXED, axis=2).T)
        slope = (np.array(read[1]) - np.array(read[0])) / (2e-5 / size)
        np.testing.assert_allclose(A[:, n], slope, rtol=0, atol=1e-6 * np.abs(slope).max())


def test_a_tip_travels_as_far_as_a_ray_in_mujoco_reaches_the_turned_face(rng):
    """An independent contact: a box of 2 m whose face at the origin is moved, turned and hit by a ray."""
    xml = """<mujoco><worldbody><body mocap="true"><geom type="box" size="1 1 1" pos="0 0 1"/></body>
    </worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    normal = np.array([[0.0, 0.0, -1.0]])  # of the face at the block's origin, out of the block
    for _ in range(5):
        turn = Rotation.from_rotvec(0.02 * rng.standard_normal(3))
        end = 5e-3 * rng.standard_normal((1, 3))
        axis = np.array([0.0, 0.0, -1.0]) + 0.02 * rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        data.mocap_pos[0], data.mocap_quat[0] = end[0], turn.as_quat(scalar_first=True)
        mujoco.mj_forward(model, data)
        stand, geom = 0.1 * axis, np.zeros(1, dtype=np.int32)
        hit = mujoco.mj_ray(model, data, stand, -axis, None, 1, -1, geom)
        travel = tip_travel(axis[None], normal, np.zeros((1, 3)), end, turn.as_matrix()[None])
        assert travel[0] == pytest.approx(0.1 - hit, abs=1e-12)


@pytest.mark.parametrize("way", [-1, 1])
def test_friction_holds_a_tip_back_against_its_motion(way, rng):
    """Loaded by the half width of the loop, unloaded from either side: by a half width at most."""
    gauge = Gauge(hysteresis=3e-6, tilt_sigma=0.0, sigma=0.0, resolution=0.0, stand_sigma=0.0)
    runs, up = 200, np.tile([0.0, 0.0, 1.0], (200, 1))
    places = np.zeros((2, runs, 3))
    places[1, :, 2] = way * 1e-4
    turns = np.tile(np.eye(3), (2, runs, 1, 1))
    before, after = gauge.read(up, places, turns, np.arange(runs), rng)
    held = after - gauge.measuring_range * GAUGE_PRELOAD_FRACTION - way * 1e-4
    np.testing.assert_allclose(held, -way * 3e-6, atol=1e-12)
    assert np.ptp(before) == pytest.approx(6e-6, rel=0.1)


@pytest.mark.parametrize("reach", [0.0, 0.4], ids=["gauge", "distance"])
def test_directions_of_the_loaded_arm_leave_an_error_of_third_order(reach, rng):
    """Half the motion leaves an eighth of the error; without them it is of second order."""
    u, d, w = (rng.standard_normal((50, 3)) for _ in range(3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    left = []
    for h in (0.01, 0.005):
        moved = directions_under_load(u[:, None], np.full((50, 1), reach), h * d[:, None], h * w)[:, 0]
        turn = Rotation.from_rotvec(h * w).as_matrix()
        gauge = tip_travel(u, u, np.zeros((50, 3)), h * d, turn)
        read = np.linalg.norm(reach * u + h * d, axis=1) - reach if reach else gauge
        left.append([np.abs(np.vecdot(own, h * d) - read).max() for own in (moved, u)])
    (own, plain), (own_half, plain_half) = left
    assert own / own_half == pytest.approx(8, rel=0.15)
    assert plain / plain_half == pytest.approx(4, rel=0.15)
    assert own < plain / 10


def test_scaled_joints_and_links_predict_the_motion_of_a_softer_arm(kr500):
    """Readings three times as large: the folder alone would predict a third of them."""
    data = measured(kr500, XYZ)
    three = replace(data, after=data.before + 3 * (data.after - data.before))
    once, thrice = (predicted_motion(kr500.vjm, own)[0] for own in (data, three))
    np.testing.assert_allclose(thrice, 3 * once, rtol=0.05, atol=2e-4)


def test_readings_of_one_set_up_share_their_tilt_and_no_others_do(kr500):
    """Whitened rows have the normal equations of the dense covariance, written down here again."""
    gauges = [replace(own, instrument=Gauge(sigma=5e-6, resolution=0.0)) for own in XYZ]
    data = resolve_line_readings(
        kr500.vjm, measured(kr500, gauges, poses=3, pose=np.array([0, 0, 1, 2, 2, 2]))
    )
    structure = joints_only(kr500.arm)
    A = unresolved_rows(kr500, data, structure)
    y = (data.line_direction * data.deflection).sum(axis=2).T
    rows = np.concatenate([A.transpose(0, 2, 1), y[..., None]], axis=2).reshape(
        -1, structure.n_parameters + 1
    )
    slide = data.tilt_error.swapaxes(0, 1).reshape(-1, 3)
    group = (np.arange(3)[:, None] * 10 + data.pose_id).ravel()
    C = np.where(group[:, None] == group, slide @ slide.T, 0.0) + 2 * 5e-6**2 * np.eye(len(slide))
    expected = rows.T @ np.linalg.solve(C, rows)
    A, y = reduce(kr500.vjm, structure, data).weighted_equations
    np.testing.assert_allclose(
        np.c_[A, y].T @ np.c_[A, y], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
    )


def test_a_reading_along_a_line_is_one_equation_and_finds_the_joints(kr500):
    data = measured(kr500, XYZ, poses=6, mass=1.0)
    regression = reduce(kr500.vjm, joints_only(kr500.arm), data)
    assert regression.n_equations == 18
    found = least_squares(kr500.vjm, joints_only(kr500.arm), data)
    assert found.regression.rank == 5  # a weight does not load joint 1
    assert reduce(kr500.vjm, joints_only(kr500.arm), select_runs(data, data.pose_id < 3)).n_equations == 6


def test_single_readings_have_the_deviation_of_their_number(kr500):
    data = measured(kr500, [replace(own, instrument=Gauge(sigma=5e-6)) for own in XYZ])
    read = weighted_readings(kr500.vjm, joints_only(kr500.arm), data)
    slide = np.linalg.norm(resolve_line_readings(kr500.vjm, data).tilt_error, axis=2).ravel()
    np.testing.assert_allclose(read.standard_deviation, np.sqrt(2 * 5e-6**2 + slide**2), rtol=1e-9)
    assert not read.y[:, 1:].any()


def test_a_gauge_out_of_range_and_a_ballbar_too_long_are_lost_readings(kr500):
    short = Gauge(measuring_range=1e-4)
    data = measured(kr500, [Mounted(short, "P1", np.eye(3)[2]), *XYZ[1:]], mass=400.0)
    assert not data.is_measured[:, 0].all()
    assert data.is_measured[:, 1:].all()
    assert not data.precision[~data.is_measured].any()
    lost = measured(kr500, [Mounted(replace(WIRE, max_change=1e-6), "P1", fixed=FIXED), XYZ[1]], mass=400.0)
    assert lost.is_measured.sum(axis=0).tolist() == [0, 4, 0]


def test_a_tracker_and_gauges_read_one_after_the_other_give_a_run_each(kr500):
    data = measured(kr500, [Mounted(IsotropicTracker(50e-6)), *XYZ])
    assert data.n_runs == 8
    assert data.is_line_reading.sum(axis=1).tolist() == [0, 3] * 4
    both = reduce(kr500.vjm, joints_only(kr500.arm), data)
    assert both.n_equations == 4 * 9 + 4 * 3


def test_wrong_readings_along_lines_are_refused(kr500):
    data = measured(kr500, XYZ)
    for change, words in (
        ({"line_direction_deviation": None}, "together"),
        ({"precision": None}, "expected their precision"),
        ({"line_direction": 2 * data.line_direction}, "unit vectors"),
        (
            {"line_direction_deviation": data.line_direction_deviation - 1},
            "line_direction_deviation .rad.: expected 0 or more",
        ),
        ({"precision": line_precision(np.roll(data.line_direction, 1, axis=2), 1e-6)}, "u u.T"),
    ):
        with pytest.raises(BenchError, match=words):
            replace(data, **change)
