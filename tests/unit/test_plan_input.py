"""What a plan is asked for in files and flags."""

from dataclasses import replace

import numpy as np
import pytest
from refused import refused
from tables import write_table as write

from testbench.arm.folder import ArmJoint
from testbench.errors import BenchError
from testbench.files.program import read_poses
from testbench.files.read_pairs import read_export
from testbench.model.load import weight
from testbench.workflows.options import overload_warnings
from testbench.workflows.plan import nearest_turn
from testbench.workflows.plan_input import parse_point, parse_work_area, read_loads, read_tasks
from testbench.workflows.plan_settings import PlanSettings

NAMES = [f"joint_{k}" for k in range(1, 7)]
POSES = np.array([[0, -90, 90, 0, 20, 0], [20, -80, 95, 10, -30, 15]], dtype=float)
RAD, DEG = ([f"{name}_{unit}" for name in NAMES] for unit in ("rad", "deg"))
FORCE = ["force_x_N", "force_y_N", "force_z_N"]
MOMENT = ["moment_x_Nm", "moment_y_Nm", "moment_z_Nm"]
POINT = ["point_x_m", "point_y_m", "point_z_m"]


@pytest.fixture
def file(tmp_path):
    return tmp_path / "tasks.csv"


def test_loads_of_the_process_act_where_they_are_said_to(kr500, file):
    load = weight(kr500.vjm, 460.0)
    assert load.wrench.tolist() == [0, 0, pytest.approx(-460 * 9.81), 0, 0, 0]
    rows = np.hstack([POSES, [[1, 2, 3, 0.1, 0.2, 0.3], [4, 5, 6, 0.4, 0.5, 0.6]]])
    tasks = read_tasks(write(file, DEG + FORCE + POINT, rows), kr500, load)
    np.testing.assert_array_equal(tasks.load.wrench, [[1, 2, 3, 0, 0, 0], [4, 5, 6, 0, 0, 0]])
    np.testing.assert_array_equal(tasks.load.point, [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    tasks = read_tasks(write(file, DEG + MOMENT, rows[:, :9]), kr500, load)
    np.testing.assert_array_equal(tasks.load.wrench, [[0, 0, 0, 1, 2, 3], [0, 0, 0, 4, 5, 6]])
    assert (tasks.load.point == kr500.vjm.load_point).all()


BROKEN = [
    (DEG, [], "line 2: expected 1 to 1000 tasks, got 0"),
    (DEG, np.tile(POSES, (501, 1)), "line 1002: expected 1 to 1000 tasks, got 1002"),
    (DEG + POINT, np.c_[POSES, np.ones((2, 3))], "expected force_x_N, force_y_N, force_z_N if point_x"),
    (DEG, [POSES[0], [0, 60, 90, 0, 20, 0]], "joint_2_deg: expected -130.0000 to 20.0000 deg, got 60"),
    (DEG, [POSES[0], [0, 20, 60, 0, 0, 0]], "line 3: link_3 collides with world in this pose"),
    ([*DEG, "fx"], np.c_[POSES, np.ones((2, 1))], "(a weight: -9.81 N/kg along z), got fx"),
    ([*DEG, "mass_kg"], np.c_[POSES, np.ones((2, 1))], "line 1: expected loads of tasks in force_x_N,"),
    (DEG + FORCE, np.c_[POSES, np.zeros((2, 3))], "line 2: expected a load, got zero force and moment"),
    (DEG + FORCE, np.c_[POSES, 1e9 * np.ones((2, 3))], "column force_x_N: expected -1e+06 to 1e+06"),
]


@pytest.mark.parametrize(("header", "rows", "text"), BROKEN)
def test_wrong_tasks_name_line_and_column(kr500, file, header, rows, text):
    path = write(file, header, rows)
    assert text in refused(read_tasks, path, kr500, weight(kr500.vjm, 460.0))


def test_a_plan_is_read_like_any_poses_and_brings_its_loads(kr500, tmp_path):
    """An angle that was changed in one unit alone is noticed."""
    rows = [[*map(repr, np.deg2rad(q).tolist()), *q, "460.3"] for q in POSES]
    path = write(tmp_path / "plan.csv", [*RAD, *DEG, "load_kg"], rows)
    np.testing.assert_array_equal(read_poses(path, kr500.arm), np.deg2rad(POSES))
    np.testing.assert_array_equal(read_loads(path)[0], [460.3, 460.3])
    path.write_text(path.read_text().replace(",-80.0,", ",-85.0,"))
    said = "line 3, columns joint_2_rad and joint_2_deg: "
    assert said in refused(read_poses, path, kr500.arm)
    assert read_loads(write(tmp_path / "poses.csv", RAD, np.deg2rad(POSES))) == (None, None)


def test_the_travel_of_a_slide_in_a_plan_is_not_read_as_that_of_a_gauge(slides, tmp_path):
    joints = [joint.file_column for joint in slides.arm.file_joints]
    lower, upper = slides.arm.limits
    read = [
        f"{name}_{when}_{x}_mm" for name in slides.arm.markers for when in ("before", "after") for x in "xyz"
    ]
    header = [*joints, "load_kg", "travel_deg", "travel_mm", "way", *read]
    rows = [
        [
            *map(repr, (lower + share * (upper - lower)).tolist()),
            5,
            "3.00",
            "12.00",
            "clear",
            *range(len(read)),
        ]
        for share in (0.2, 0.4)
    ]
    export = read_export(write(tmp_path / "plan.csv", header, rows), slides.arm)
    np.testing.assert_allclose(export.data.before[0, 0], [0, 1e-3, 2e-3], rtol=0, atol=1e-15)
    assert {"travel_deg", "travel_mm", "way"} == {*export.columns.ignored}


def test_a_joint_that_the_arm_lacks_is_refused(kr500, tmp_path):
    path = write(tmp_path / "poses.csv", [*DEG, "joint_7_deg", "speed"], [[*POSES[0], 3, 9]])
    said = "line 1: expected the joints of kr500_l480 only, got also joint_7_deg; remove them"
    assert said in refused(read_poses, path, kr500.arm)


def test_a_slide_is_read_in_metres_or_millimetres(slides, tmp_path):
    """Of the arm's joints the second and fourth slide, by 0 to 0.4 m."""
    header = ["joint_1_deg", "joint_2_mm", "joint_3_rad", "joint_4_m", "joint_5_rad"]
    path = write(tmp_path / "poses.csv", header, [[30, 250, 0.1, 0.3, 0.2]])
    np.testing.assert_allclose(read_poses(path, slides.arm), [[np.pi / 6, 0.25, 0.1, 0.3, 0.2]], rtol=1e-15)
    path = write(tmp_path / "poses.csv", [*header[:3], "joint_4_m", header[4]], [[30, 250, 0.1, 300, 0.2]])
    said = "joint_4_m: expected 0.0000 to 0.4000 m, got 300; are these millim"
    assert said in refused(read_poses, path, slides.arm)


LOADS = ["load_kg", *FORCE]
PULLS = [
    (["load_kg"], ["0.0"], "line 2, column load_kg: expected 0.001 to 10000, got 0"),
    (LOADS, ["460", 0, 5, 0], "line 2, column load_kg: expected no mass beside a force, got 460 kg"),
    (LOADS, ["", "", 0, ""], "line 2, column load_kg: expected 0.001 to 10000 if no force acts, got nan"),
    (LOADS, ["", 0, 1e6, 0], "line 2: expected a force of 0.00981 to 98100 N, got 1e+06"),
    (["load_kg", *FORCE[:2]], ["", 0, 5], "line 1: expected force_z_N too"),
    (FORCE + POINT, [0, 5, 0, 0, 0, 1], "they act at the arm's load point, got point_x_m, point_y_m, point"),
]


@pytest.mark.parametrize(("header", "cells", "text"), PULLS)
def test_a_run_has_a_mass_or_a_force_at_the_load_point(file, header, cells, text):
    path = write(file, RAD + header, [[*np.deg2rad(POSES[0]), *cells]])
    assert text in refused(read_loads, path)


def test_forces_alone_are_read_without_a_column_of_masses(file):
    mass, pulls = read_loads(write(file, RAD + FORCE, np.c_[np.deg2rad(POSES), [[0, 5, 0], [7, 0, 0]]]))
    assert (mass.tolist(), pulls.tolist()) == ([0, 0], [[0, 5, 0], [7, 0, 0]])


def test_loads_far_beyond_the_stated_payload_are_said(kr500):
    """One and a half times 460.3 kg are 690.45 kg, or 6773 N."""
    assert overload_warnings(kr500.arm, [690.0], [(0.0, 0.0, 6770.0)]) == []
    assert overload_warnings(replace(kr500.arm, payload=None), [1e4], [(1e5, 0.0, 0.0)]) == []
    stated = "an arm that states a payload of 460.3 kg"
    found = overload_warnings(kr500.arm, [1.0, 700.0], [(0.0, 0.0, -6780.0)])
    assert found == [f"700 kg hang from {stated}", f"6780 N pull at {stated}"]


def test_the_nearest_turn_is_the_same_pose_within_the_limits(kr500):
    lower, upper = [-6.0, -1.0, 2.0, 2.0], [6.0, 1.0, 6.0, 6.0]
    joints = tuple(
        ArmJoint(f"joint_{k}", *ends, 1e-6, prismatic=k == 3)
        for k, ends in enumerate(zip(lower, upper, strict=True))
    )
    q = np.array([[5.0, 0.9, 5.9, 5.0], [-4.0, -1.0, 2.0, 4.0]])
    near = nearest_turn(q, replace(kr500.arm, joints=joints))
    np.testing.assert_allclose(np.exp(1j * near[:, :3]), np.exp(1j * q[:, :3]), atol=1e-15)
    expected = [[5.0 - 2 * np.pi, 0.9, 5.9, 5.0], [2 * np.pi - 4.0, -1.0, 2.0, 4.0]]  # a slide has no turns
    np.testing.assert_allclose(near, expected)


def test_places_in_flags_become_a_station_and_an_area():
    there = {"tracker_m": parse_point("4.5,-2.5,1.6e0"), "box_m": parse_work_area("1,2,3,4,5,6")}
    asked = PlanSettings(loads_kg=(460.0,), acceptance_deg=30.0, **there)
    assert asked.station.position == (4.5, -2.5, 1.6)
    assert asked.station.acceptance_angle == pytest.approx(np.pi / 6)
    assert (asked.area.lower, asked.area.upper, asked.area.cone_half_angle) == (
        (1.0, 2.0, 3.0),
        (4.0, 5.0, 6.0),
        np.pi,
    )
    assert asked.conditions.payload.mass == 460.0


def test_pulls_that_are_none_are_named():
    for pulls in (((0.0, 0.0, 0.0),), ((0.0, 5.0, 0.0),) * 2, ((0.0, 1e6, 0.0),)):
        with pytest.raises(BenchError, match=r"^pulls_n"):
            PlanSettings(loads_kg=(460.0,), pulls_n=pulls)
