"""What columns are taken for, and what is said of those that are not read."""

import tracemalloc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from run_here import fine
from test_samples import ARM, FOLDER, WEIGHT, Q, brought

from testbench.errors import InputError
from testbench.files import columns, read_unknown
from testbench.files.mapping import FileLayout
from testbench.files.names import joint_family, unread_column_warnings
from testbench.files.propose_map import map_text, propose
from testbench.files.read_pairs import read_export
from testbench.files.read_series import read_series
from testbench.files.rearranged import read_log
from testbench.files.table import read_table

BODY_WORDS = [f"shoulder_{k}" for k in "abcdef"]
NAMED = replace(ARM, joints=tuple(replace(j, name=n) for j, n in zip(ARM.joints, BODY_WORDS, strict=True)))
SEVEN = replace(ARM, joints=(*ARM.joints, replace(ARM.joints[-1], name="joint_7")))
TWO_FAMILIES = [*(f"R{k}" for k in range(1, 7)), *(f"J{k} [deg]" for k in range(7))]


@pytest.mark.parametrize(
    ("names", "arm", "expected"),
    [
        (["Q0", "Q1", "Q2", "Q3", *TWO_FAMILIES], SEVEN, [*range(10, 17)]),
        (["Q0", "Q1", "Q2", "Q3", "A1", "A2", "J3", "A4", "A5", "A6"], ARM, []),
        ([f"{x}/{n}" for n in BODY_WORDS[::-1] for x in ("effort", "position")], NAMED, [11, 9, 7, 5, 3, 1]),
        (["Pose", *"SLURBT", "X"], ARM, [*range(1, 7)]),
        (["Pose", *"SLURB", "X"], ARM, []),
        (["Wrist 3 [deg]", "Base [deg]", "Shoulder", "Elbow", "Wrist 1", "Wrist 2"], ARM, [1, 2, 3, 4, 5, 0]),
    ],
)
def test_joints_are_one_family_of_columns(names, arm, expected):
    assert joint_family(names, arm) == expected


UNREAD = {
    "orientations": [
        "A B C", "O;A;T", "W P R", "Rx [deg];Ry [deg];Rz [deg]", "Roll Pitch Yaw", "q0 q1 q2 q3",
        "Q1 Q2 Q3 Q4", "qw qx qy qz", "quat_x quat_y", "TCP_RX TCP_RY TCP_RZ", "rot_x", "Orientation.x",
        "Euler1", "Nick Gier",
    ],
    "joints": ["A1 A2 A3", "J1_cmd J2_cmd", "E1", "target_q_1", "Axis 7 [mm];", "Gelenkwinkel",
        "joint angles;", "q1 q2 q5"],
    "times": ["Time", "Timestamp", "time_s", "Date;Uhrzeit", "Zeit [ms];"],
    "loads": ["Fx Fy Fz", "Mx My Mz", "Force_x", "Torque Z;", "Kraft [kN];", "F [lbf];", "effort_1",
        "Tx [Nm];", "Load [kg];"],
}  # fmt: skip


@pytest.mark.parametrize(("kind", "header"), [(kind, own) for kind, every in UNREAD.items() for own in every])
def test_columns_of_a_kind_that_are_not_read_are_listed(kind, header):
    names = [name for name in header.split(";" if ";" in header else " ") if name]
    said = f"warning: these columns look like {kind} and are not read: {', '.join(names)}"
    assert unread_column_warnings(["Comment", *names, "T1 x"]) == [said]


def test_other_columns_raise_no_warning():
    names = "Comment;A;B [T];Operator;Nr;Temp;RMS;Nominal X;dX;Vibration [g];T"
    assert unread_column_warnings(names.split(";")) == []


def test_times_beside_pairs_are_said_as_not_read_where_pairs_are_read_as_positions(tmp_path):
    file = brought("pairs_with_columns_that_are_not_read.csv", tmp_path)
    assert "warning: these columns are not read beside pairs: Time" in read_series(file, ARM).notes


def test_a_log_that_lost_a_row_since_its_map_was_written_is_refused(tmp_path):
    file = brought("targets_without_poses.csv", tmp_path)
    log = brought("axes_row_by_row.robot", tmp_path)
    (map_ := tmp_path / "map.toml").write_text(map_text(propose(file, ARM, log, tmp_path).entries))
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:-1]))
    with pytest.raises(InputError, match="expected 3 rows for each of 3 rows of axes_row_by_row"):
        read_series(file, ARM, map_)


def test_a_log_of_fewer_rows_than_the_readings_need_is_not_joined_by_order(tmp_path):
    """Of 24 readings of three targets in turn seven rows are too few."""
    files = []
    for name, rows in (("targets_without_poses.csv", 24), ("axes_row_by_row.robot", 7)):
        header, *lines = (FOLDER / name).read_text().splitlines(keepends=True)
        files.append(tmp_path / name)
        files[-1].write_text("".join([header, *(2 * lines)[:rows]]))
    with pytest.raises(InputError, match="equally many rows or poses in both, got 24 readings and 7 rows"):
        propose(files[0], ARM, files[1], tmp_path)


@pytest.mark.parametrize(
    ("program", "names", "cells"),
    [
        ("DEF cal()\nPTP {E1 7.5,A1 1,A2 2,A3 3,A4 4,A5 5,A6 6,E2 0.0}\nEND\n", [], [*"123456", "7.5"]),
        (
            "MODULE m\n\n VAR jointtarget a:=[[1,2,3,4,5,6],[-30,9E9,9E9,9E9,9E9,9E9]];\nENDMODULE\n",
            ["a"],
            [*"123456", "-30"],
        ),
    ],
    ids=["KRL", "RAPID"],
)
def test_external_axes_of_a_program_are_joints_beyond_the_sixth(program, names, cells, tmp_path):
    (file := tmp_path / "program").write_text(program)
    found = read_log(file, bool)
    assert found.names[len(names) :] == (*(f"A{k} [deg]" for k in range(1, 7)), "A7")
    assert [found.texts(k) for k in range(len(found.names))] == [[cell] for cell in [*names, *cells]]


def test_a_long_table_is_not_divided_to_see_whether_its_rows_are_columns(tmp_path, monkeypatch):
    """Dividing 200,000 rows by four delimiters took 15 s."""
    header, rows = (FOLDER / "pairs_in_columns.csv").read_text().split("\n", 1)
    (file := tmp_path / "long.csv").write_text(f"{header}\n" + rows * 90)
    monkeypatch.setattr(read_unknown, "even_rows", lambda *_: pytest.fail("divided"))
    assert propose(file, ARM, None, tmp_path).entries


@pytest.mark.parametrize("start", [b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0"])
def test_a_picture_in_place_of_a_table_is_refused_as_one(tmp_path, start):
    (file := tmp_path / "file.csv").write_bytes(start + bytes(range(256)))
    with pytest.raises(InputError, match="expected a table, got a picture"):
        propose(file, ARM, None, tmp_path)


def test_numbers_of_poses_and_of_targets_are_no_states(tmp_path):
    rows = "".join(f"{pose},{target},1,2,3\n" for pose in "01" for target in "01")
    (file := tmp_path / "points.csv").write_text(f"Pose,Point,X,Y,Z\n{rows}")
    (log := tmp_path / "log.csv").write_text("Pose,J1,J2,J3,J4,J5,J6\n0,1,2,3,4,5,6\n1,2,3,4,5,6,7\n")
    assert not {"state", "before", "after"} & {own.key for own in propose(file, ARM, log, tmp_path).entries}


def test_grad_is_gon_where_degrees_would_exceed_a_limit_which_is_said(tmp_path):
    header = ",".join([*(f"J{k} [grad]" for k in range(1, 7)), *"XYZ"])
    (file := tmp_path / "far.csv").write_text(f"{header}\n" + 2 * "10,-90,90,380,0,0,1,2,3\n")
    found = read_series(file, ARM, propose(file, ARM, None, tmp_path).map())
    np.testing.assert_allclose(found.series[0].q[0], np.radians([9, -81, 81, 342, 0, 0]), atol=1e-12)
    said = "warning: grad is read as gon, because degrees would exceed a limit: J1 [grad], "
    assert any(note.startswith(said) for note in found.notes)


def test_a_map_says_which_columns_hold_names_and_values(tmp_path):
    file = brought("a_quantity_per_row.csv", tmp_path)
    found = read_table(file, bool, FileLayout(tidy=["variable", "value"]))
    assert found.names == ("Point", *(f"A{k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]")
    np.testing.assert_allclose(np.radians(found.numbers(1)), Q[:, 0], rtol=0, atol=1e-15)
    for columns_, said in (
        ('["variable"]', r'expected tidy = \["name", "value"\]'),
        ('["variable", "number"]', "no column 'number'; columns are"),
    ):
        (map_ := tmp_path / "tidy.toml").write_text(f"[file]\ntidy = {columns_}\n")
        with pytest.raises(InputError, match=said):
            read_series(file, ARM, map_)


# --- Loads --------------------------------------------------------------------------------------------------


def test_a_row_of_a_plan_may_have_a_force_in_place_of_a_mass(tmp_path):
    found = read_export(brought("plan_with_a_force.csv", tmp_path), ARM).data
    np.testing.assert_allclose(found.wrench[:, :3], [[0, 0, -WEIGHT]] * 3 + [[30, 0, -50]])


@pytest.mark.parametrize(
    ("loads", "warns"),
    [("100 100 1000 100", True), ("100 100 100 100", False), ("100 200 300 100", False)],
)
def test_a_load_that_only_one_pose_has_raises_a_warning(loads, warns, tmp_path):
    head, *rows = (FOLDER / "plan_with_readings.csv").read_text().splitlines()
    rows = [row.replace(",100,", f",{load},", 1) for row, load in zip(rows, loads.split(), strict=True)]
    (file := tmp_path / "plan.csv").write_text("\n".join([head, *rows, ""]))
    warnings = [note for note in read_export(file, ARM).notes if note.startswith("warning: only")]
    said = "warning: only pose 3 (line 4) has a load of 1000 kg; all other poses have 100 kg: a typo?"
    assert warnings == [said] * warns


def test_the_search_for_an_odd_load_takes_memory_of_the_number_of_rows():
    """Each of 3,000 poses has a load of its own: a table of loads by poses would have 9 MB."""
    pose = np.arange(3000)
    wrench = np.zeros((len(pose), 6))
    wrench[:, 2] = -1.0 - pose
    lines = SimpleNamespace(lines=pose)
    tracemalloc.start()
    assert columns._odd_loads(lines, pose, wrench) == []
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1000 * len(pose)


# --- Gauges -------------------------------------------------------------------------------------------------


def test_data_map_shows_the_runs_of_gauges(tmp_path):
    file = brought("gauges_wide_a_row_per_state.csv", tmp_path)
    said = fine("data", "map", ARM.name, file)
    assert said.endswith(f"{len(Q)} runs")
    assert "travel" in said


def test_gauges_that_touch_one_target_in_turn_are_paired_each_with_itself(tmp_path):
    """All unloaded readings stand before all loaded ones."""
    rows = [
        [f"p{k + 1}", "P1", *map(str, np.degrees(q)), str(100 * loaded), str(2 + n + loaded * (n + 1)), axis]
        for k, q in enumerate(Q)
        for loaded in (0, 1)
        for n, axis in enumerate(("+X", "+Y", "+Z"))
    ]
    header = ["Pose", "Target", *(f"A{k} [deg]" for k in range(1, 7)), "Load [kg]", "Gauge [mm]", "Direction"]
    (file := tmp_path / "gauges.csv").write_text("\n".join(map(",".join, [header, *rows])))
    mapping = propose(file, ARM, None, tmp_path).map()
    found = read_export(file, ARM, mapping).data
    moved = 1e-3 * np.tile([1, 2, 3], len(Q))[:, None] * found.line_direction[:, 0]
    np.testing.assert_allclose(found.deflection[:, 0], moved, rtol=0, atol=1e-12)
    file.write_text(file.read_text().replace("+X", "-X", 1))
    with pytest.raises(InputError, match="expected an unloaded reading in pose 1"):
        read_export(file, ARM, mapping)
