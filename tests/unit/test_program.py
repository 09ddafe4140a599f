"""Programs as tables: every notation says the same points, and what is wrong is named by its line."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tables import write_table

from testbench.correct.compensated import joints_along_path
from testbench.correct.predicted import process_wrench
from testbench.errors import InputError
from testbench.files.program import read_program, unread_columns
from testbench.files.write import write_program
from testbench.model.vjm import tool_poses
from testbench.plant.rigid_cell import find_collisions

ROOT = Path(__file__).parents[2]

DEG = ",".join(f"joint_{k}_deg" for k in range(1, 7))
PLACE = "x_mm,y_mm,z_mm"
Q = np.radians([[10, -80, 100, 5, 60, 0], [12, -81, 101, 5, 61, -3], [15, -83, 102, 6, 62, -5]])


@pytest.fixture
def write(tmp_path):
    return partial(write_table, tmp_path / "program.csv")


def test_joints_loads_labels_and_other_columns_are_read(kr500, write):
    """Missing parts of a vector are zero, jumps are read where they are allowed."""
    header = f"speed,point,{DEG},force_z_kN,moment_x_Nm,point_x_mm,point_z_mm,feed_N,axial_N,mass_kg,comment"
    there = Q + [[0], [1], [0]] * np.array([1, 0, 0, 0, 0, 0])
    rows = [
        ["fast", f"P{k}", *q, -1.5, 5, 40, -5, 100, -2, 7, "cut"] for k, q in enumerate(np.degrees(there))
    ]
    program = read_program(write(header, rows), kr500.arm, jumps=True)
    np.testing.assert_allclose(program.q, there, rtol=0, atol=1e-15)
    assert program.position is None
    assert program.rotation is None
    assert program.labels == ("P0", "P1", "P2")
    assert program.line.tolist() == [2, 3, 4]
    assert program.other == ("speed", "comment")
    assert program.wrench.tolist() == [[0, 0, -1500, 5, 0, 0]] * 3
    assert program.along.tolist() == [[100, 0, -2]] * 3
    assert program.mass.tolist() == [7] * 3
    np.testing.assert_allclose(program.point, [[0.04, 0, -0.005]] * 3)


def test_columns_that_were_not_read_are_said_and_louder_where_they_look_like_loads(kr500, write):
    """What our own corrections stand in is no surprise; a load behind them is."""
    header = (
        f"speed_mm_s,{DEG},axail_N,torque_Nm,payloads_kg,comment,correction_joint_1_deg,before_x_mm,pull_N,Fz"
    )
    rows = [["20", *q, 900, 1, 2, "cut", 0.1, 1, 5, 8] for q in np.degrees(Q)]
    program = read_program(write(header, rows), kr500.arm)
    assert program.corrected
    loud = [
        f"Not used, although it looks like a load: {name}"
        for name in ("axail_N (axial_N?)", "torque_Nm", "payloads_kg (payload_kg?)", "pull_N", "Fz")
    ]
    assert unread_columns(program) == (*loud, "These columns are not read: speed_mm_s, comment")
    plain = read_program(write(f"{DEG},axial_N", [[*q, 9] for q in np.degrees(Q)]), kr500.arm)
    assert unread_columns(plain) == ()
    assert not plain.corrected


MAP = """
columns = { rotation_1_deg = "A", rotation_2_deg = "B", rotation_3_deg = "C" }
series.rotation = "intrinsic zyx"
values.mass_kg = 12
"""


def test_poses_of_the_tool_are_read_in_the_notation_of_a_controller_which_a_map_names(kr500, write, tmp_path):
    position, rotation = tool_poses(kr500.vjm, Q)
    rows = np.hstack([1e3 * position, Rotation.from_matrix(rotation).as_euler("ZYX", degrees=True)])
    (tmp_path / "map.toml").write_text(MAP, encoding="utf-8")
    program = read_program(write("X [mm],Y [mm],Z [mm],A,B,C", rows), kr500.arm, tmp_path / "map.toml")
    assert program.q is None
    np.testing.assert_allclose(program.position, position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(program.rotation, rotation, rtol=0, atol=1e-14)
    assert program.labels == ("1", "2", "3")
    assert program.mass.tolist() == [12] * 3


def changed(row, column, value):
    rows = [[*q, 100.0] for q in np.degrees(Q).round(6).tolist()]
    rows[row][column] = value
    return rows


POSE = [2000.0, 0.0, 1200.0, 1.0, 0.0, 0.0, 0.0]
FEED, POSES = f"{DEG},feed_N", f"{PLACE},qw,qx,qy,qz"
JUMP = "lines 2 and 3: the path jumps,"
WRONG = {
    "line 4, column joint_3_deg: expected .* deg, got 220": (FEED, changed(2, 2, 220)),
    f"{JUMP} joint_1 from 10 to 60 deg: expected at most 45 deg .*unless --jumps .in Python: jumps=True": (
        FEED,
        changed(1, 0, 60),
    ),
    "line 2, column feed_N: expected -1e.06 to 1e.06 N, got 2e.06": (FEED, changed(0, 6, 2e6)),
    "line 2, column mass_kg: expected 0 to 100000 kg": (f"{DEG},mass_kg", changed(0, 6, -1)),
    r"missing columns: joint_6_deg$": (DEG.removesuffix(",joint_6_deg"), [changed(0, 6, 1)[0][:5]]),
    r"missing columns: joint_1_deg, .*or x_mm": ("feed_N,axial_N", [[1, 2]]),
    "line 2: expected 1 to 1000000 points, got 0": (DEG, []),
    "line 2, column x_mm: expected -100 to 100 m, got 2000": (POSES, [[2e6, *POSE[1:]]]),
    "line 3, column force_x_N: expected a finite number, got ''; write 0 if none acts$": (
        f"{DEG},force_x_N",
        changed(1, 6, ""),
    ),
    "line 3, column qw: expected a unit quaternion, got one of no": (POSES, [POSE, [*POSE[:3], 0, 0, 0, 0]]),
    "line 2, column qw: expected an orientation": (POSES, [[*POSE[:3], "", "", "", ""]]),
    f"{JUMP} the tool by 1.5 m": (POSES, [POSE, [POSE[0], 1500, *POSE[2:]]]),
    f"{JUMP} the tool by 90 deg": (POSES, [POSE, [*POSE[:3], 0.70710678, 0.70710678, 0, 0]]),
    r"missing columns: quaternion_w": (PLACE, [POSE[:3]]),
    r"joints with other names go into \[columns\] of a map, as \"joint_\{n\}_deg\" = \"A\{n\}": (
        f"{PLACE},{','.join(f'A{k}' for k in range(1, 7))}",
        [[*POSE[:3], *[0] * 6]],
    ),
}


@pytest.mark.parametrize("message", WRONG)
def test_what_is_wrong_is_named(kr500, write, message):
    header, rows = WRONG[message]
    with pytest.raises(InputError, match=message):
        read_program(write(header, rows), kr500.arm)


def test_a_corrected_program_keeps_what_it_was_and_gives_its_joints_back(kr500, write, tmp_path):
    """In the file's units and order; every cell but the joints is as it was."""
    header = f"speed,{DEG.replace('joint_3_deg', 'joint_3_rad')},comment"
    shown = np.degrees(Q)
    shown[:, 2] = Q[:, 2]
    program = read_program(write(header, [["100", *row, '"a, b"'] for row in shown]), kr500.arm)
    q, out = program.q + np.pi * 1e-4, tmp_path / "corrected.csv"
    write_program(out, program, q, {"left_mm": np.array([0.1, np.nan, 1 / 3]), "why": ["a", "", "b"]})
    back = read_program(out, kr500.arm)
    np.testing.assert_allclose(back.q, q, rtol=0, atol=1e-15)
    assert back.content.table.names == (*program.content.table.names, "left_mm", "why")
    assert back.content.table.texts(7) == ["a, b"] * 3
    assert back.content.table.texts(8) == ["0.1", "", repr(1 / 3)]
    with pytest.raises(InputError, match="line 1: there is a column 'left_mm' already; was"):
        write_program(out, back, q, {"left_mm": np.zeros(3)})
    assert read_program(out, kr500.arm).labels == ("1", "2", "3")


def test_a_corrected_program_of_a_spreadsheet_is_read_by_it(kr500, tmp_path):
    """Decimal commas and a line of units stay; poses of the tool get joints beside them."""
    path = tmp_path / "sheet.csv"
    position = tool_poses(kr500.vjm, Q)[0]
    rows = [[*map(str, p), "1,0", "0", "0", "0", "12,5"] for p in np.round(1e3 * position, 3)]
    text = "\n".join([";".join(row).replace(".", ",") for row in rows])
    path.write_text(f"X;Y;Z;qw;qx;qy;qz;v\nmm;mm;mm;;;;;\n{text}\n", encoding="utf-8")
    program = read_program(path, kr500.arm)
    out = tmp_path / "corrected.csv"
    write_program(out, program, Q)
    back = read_program(out, kr500.arm)
    np.testing.assert_allclose(back.q, Q, rtol=0, atol=1e-15)
    assert (back.position == program.position).all()
    assert back.content.table.units[:3] == program.content.table.units[:3]
    assert back.content.table.names == (*program.content.table.names, *DEG.split(","))


MINUS = """
[columns]
joint_1_rad = "-A1"
joint_2_deg = "-A2"
joint_3_deg = "A3"
[scale]
joint_1_rad = 0.001
joint_3_deg = 0.01
"""


def test_a_corrected_program_is_read_back_through_the_map_that_it_was_read_with(kr500, write, tmp_path):
    """Units, scales and signs of the map, alone and together, both ways."""
    rows = np.degrees(Q) * [-1, -1, 100, 1, 1, 1]
    rows[:, 0] = -1000 * Q[:, 0]
    (tmp_path / "map.toml").write_text(MINUS, encoding="utf-8")
    header = ",".join(["A1,A2,A3", *DEG.split(",")[3:]])
    program = read_program(write(header, rows), kr500.arm, tmp_path / "map.toml")
    np.testing.assert_allclose(program.q, Q, rtol=0, atol=1e-12)
    q, out = Q + 0.01 * np.arange(1, 7), tmp_path / "corrected.csv"
    write_program(out, program, q)
    np.testing.assert_allclose(read_program(out, kr500.arm, tmp_path / "map.toml").q, q, rtol=0, atol=1e-12)


def test_the_program_of_the_documentation_can_be_run(kr500):
    """In reach, clear of collisions, with a direction for every force, nearly across the spindle."""
    program = read_program(ROOT / "docs" / "program.csv", kr500.arm)
    found = joints_along_path(kr500.vjm, program.position, program.rotation)
    assert found.converged.all()
    assert find_collisions(kr500.room, found.q) == [None] * program.points
    wrench = process_wrench(program.along, program.position, program.rotation[:, :, 0])
    np.testing.assert_allclose(
        np.linalg.norm(wrench, axis=1), np.linalg.norm(program.along, axis=1), rtol=5e-3
    )


def test_programs_that_are_no_tables_say_what_they_are(kr500, tmp_path):
    krl = "&ACCESS RVP\nDEFDAT CELL\nDECL E6AXIS XP1={A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 0.0,A6 0.0}\nENDDAT\n"
    for name, content, said in (
        ("cell.dat", krl, "this is KUKA KRL, which has the points of a .src: expected the suffix .src"),
        ("cell.txt", "MODULE m\nENDMODULE\n", "this is ABB RAPID: expected the suffix .mod"),
        (
            "cell.as",
            ".PROGRAM a()\nJMOVE #p1\n.END\n",
            r"in another language; testbench reads FANUC LS \(.ls\), ",
        ),
        ("cell.pdl", "PROGRAM cell\nBEGIN\nMOVE LINEAR TO p1\nEND cell\n", "a program in another language"),
        ("cell.nc", "%\nG21 G90\nN10 G1 X0 Y0\nM30\n", "a program in another language"),
        ("cell.cls", "TOOL PATH/CUT\nGOTO/1.0,0.0,5.0\n", "a program in another language"),
        ("cell.csv", "A1 [deg],A2,A3,A4,A5,A6\n0,0,0,0,0,0\n", r'of a map, as "joint_{n}_deg" = "A{n}"'),
        ("pose.csv", "mass_kg,J1,J2,J3,J4,J5,J6\n1,0,0,0,0,0,0\n", "or x_mm, y_mm, z_mm and an orientation"),
    ):
        (file := tmp_path / name).write_text(content)
        with pytest.raises(InputError, match=said):
            read_program(file, kr500.arm)


def test_poses_of_a_program_name_the_tool_and_base_that_it_states(kr500, tmp_path):
    (file := tmp_path / "cell.script").write_text("""def cell():
  set_tcp(p[0, 0, 0.1, 0, 0, 0])
  movej([0, -1.57, 1.57, 0, 0.7, 0])
  movel(p[1.5, 0.1, 1.2, 0, 1.57, 0])
end
""")
    [note] = read_program(file, kr500.arm).content.notes
    assert note.startswith(
        "The program states tool p[0, 0, 0.1, 0, 0, 0]. Its poses are taken as poses of the "
    )
    file.write_text(file.read_text().replace("movel(p[1.5, 0.1, 1.2, 0, 1.57, 0])", ""))
    assert read_program(file, kr500.arm).content.text.notes == ()
