"""Kinds of files that strangers brought: by the map that is proposed they are read to their last digit."""

from dataclasses import replace

import numpy as np
import pytest
from workbooks import packed, parts

from testbench.arm.folder import find_arm, load_arm
from testbench.errors import InputError
from testbench.files import read_unknown
from testbench.files.names import joint_family, unread_column_warnings
from testbench.files.propose_map import map_text, propose
from testbench.files.read_pairs import read_export
from testbench.files.read_series import read_series
from testbench.files.rearranged import read_log

ARM = load_arm(find_arm("kr500_l480"))
N = 12
RNG = np.random.default_rng(48)
Q = np.round(np.degrees(RNG.uniform(*ARM.limits, (N, 6))) * 0.9, 3) + 0.0  #: Joints [deg].
X = np.round(RNG.uniform(500, 3000, (N, 3, 3)) * RNG.choice([-1, 1], (N, 3, 3)), 3)  #: Three targets [mm].
NAMES = [f"p{k + 1}" for k in range(N)]
TIMES = [f"{k / 10:.3f}" for k in range(N)]


def numbers(values, digits=3, mark="."):
    return [f"{x:.{digits}f}".replace(".", mark) for x in np.ravel(values)]


def table(header, rows, between=","):
    return "".join(between.join(row) + "\n" for row in [header, *rows])


def long(joints=None, between=";", mark=".", names=True, extra=()):
    """A row a target, with the pose's name and what `joints` says of a pose."""
    header = ["Pose"] * names + [
        "Point",
        "X [mm]",
        "Y [mm]",
        "Z [mm]",
        *([joints[0]] if joints else []),
        *extra,
    ]
    rows = [
        [NAMES[k]] * names
        + [f"P{m + 1}", *numbers(X[k, m], mark=mark), *([joints[1](k)] if joints else []), *extra]
        for k in range(N)
        for m in range(3)
    ]
    return table(header, rows, between)


def wide(
    form,
    joint="joint_{}",
    length=1e-3,
    angle=np.pi / 180,
    digits=(6, 9),
    between=",",
    mark=".",
    targets=(1, 2, 3),
):
    """A row a pose: targets side by side, then the joints."""
    header = [form.format(n=n, x=x, X=x.upper()) for n in targets for x in "xyz"]
    rows = [
        numbers(length * X[k, np.array(targets) - 1], digits[0], mark)
        + numbers(angle * Q[k], digits[1], mark)
        for k in range(N)
    ]
    return table([*header, *(joint.format(k) for k in range(1, 7))], rows, between)


def capture(above, units=None, between=",", length=1e-3, digits=6, turned=False, target="{0}{1}{0}{1}{0}"):
    """Motion capture: targets in a line above the axes, a rigid body's quaternion before them."""
    body = 4 * turned
    targets = [*["Body"] * body, *(target.format(f"P{m}", between) for m in (1, 2, 3))]
    lines = [line.format(targets=between.join(targets)) for line in above]
    lines += [between.join(["Frame", "Time (Seconds)", *"XYZW"[:body], *"XYZ" * 3])]
    lines += [between.join(["", "", *[units] * 9])] if units else []
    rows = [[str(k), TIMES[k], *["0.5"] * body, *numbers(length * X[k], digits)] for k in range(N)]
    return "\n".join([*lines, *map(between.join, rows), ""])


def log(form="A{}", key=None, between=","):
    """The robot's log: joints in degrees, beside names or times."""
    header = ([key[0]] if key else []) + [form.format(k) for k in range(1, 7)]
    return table(header, [([key[1][k]] if key else []) + numbers(Q[k]) for k in range(N)], between)


def joined(k, between=", ", mark=".", digits=3, scale=1.0):
    return between.join(numbers(scale * Q[k], digits, mark))


OPTITRACK = [
    "Format Version,1.23,Take Name,Take 1,Rotation Type,XYZ,Length Units,{unit}",
    "",
    ",,{{targets}}",
]
MOTIVE = [line.format(unit="Meters") for line in OPTITRACK]
TYPED = [
    *MOTIVE[:2],
    ",," + ",".join(["Rigid Body"] * 4 + ["Marker"] * 9),
    MOTIVE[2],
    ",," + ",".join(["Rotation"] * 4 + ["Position"] * 9),
]
RAPID = "MODULE Cal\n  ! CONST jointtarget p1:=[[0,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n{}ENDMODULE\n"
RAPID_LINE = "  CONST jointtarget {}:=[[{}],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
KRL_LINE = "DECL E6AXIS X{}={{{},E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}}\n"
TIMED = log(key=("Time (Seconds)", [f"{float(t) + 0.01:.3f}" for t in TIMES]))


def krl(k):
    return ",".join(f"A{n} {x}" for n, x in enumerate(numbers(Q[k]), start=1))


UNREAD = "warning: these columns look like {} and are not read: "
KINDS = {
    # targets side by side, numbered
    "figaroh": (wide("{x}{n}"),),
    "numbered in cm, German": (wide("Marke {n} {X} [cm]", "Achse {} [°]", 0.1, 1, (4, 3), ";", ","),),
    "numbered in mm, no units": (wide("m{n}.{x}", "q{}", 1, 1, (3, 3), "\t"),),
    "the arm's markers, axis first": (wide("{x}_P{n} [mm]", "J{} [deg]", 1, 1, (3, 3), ";"),),
    "the markers in another order": (wide("P{n} {x} (m)", targets=(3, 1, 2)),),
    # several numbers in a cell
    "cells": (long(("Joints [deg]", lambda k: f'"[{joined(k)}]"')),),
    "cells of a controller, rad": (
        long(("joint positions", lambda k: "(" + joined(k, "; ", digits=9, scale=np.pi / 180) + ")"), "\t"),
    ),
    "cells with names of axes": (long(("Pos", lambda k: f'"{{{krl(k)}}}"'), ","),),
    "cells with decimal commas": (long(("Gelenkwinkel", lambda k: joined(k, " / ", ",")), ";", ","),),
    "cells of blanks": (long(("q", lambda k: joined(k, "   " if k % 2 else " "))),),
    "cells of jointtargets": (long(("Target", lambda k: f"[[{joined(k, ',')}],[9E9,9E9,9E9,9E9,9E9,9E9]]")),),
    "positions in cells too": (
        table(
            ["Pose", "Point", "Position [mm]", "Joints [deg]"],
            [
                [NAMES[k], f"P{m + 1}", "[" + ", ".join(numbers(X[k, m])) + "]", f"[{joined(k)}]"]
                for k in range(N)
                for m in range(3)
            ],
            ";",
        ),
    ),
    "cells beside a time with six numbers": (
        long(("Stamp;Joints", lambda k: f"2026-09-14 09:{k:02}:30;({joined(k)})")),
    ),
    # motion capture
    "optitrack": (capture(MOTIVE), TIMED),
    "optitrack with a rigid body": (capture(TYPED, turned=True), TIMED),
    "optitrack in cm": (
        capture([line.format(unit="Centimeters") for line in OPTITRACK], length=0.1, digits=4),
        TIMED,
    ),
    "vicon": (capture(["Trajectories", "100", ",,{targets}"], "mm", ",", 1, 3, target="Arm:{0},,"), TIMED),
    "tabs": (capture(["Units:\tmillimeters", "\t\t{targets}"], between="\t", length=1, digits=3), TIMED),
    # robot programs
    "RAPID": (long(), RAPID.format("".join(RAPID_LINE.format(NAMES[k], joined(k, ",")) for k in range(N)))),
    "KRL": (
        long(),
        "&ACCESS RVP\nDEFDAT CAL\n"
        + "".join(KRL_LINE.format(NAMES[k].upper(), krl(k)) for k in range(N))
        + "ENDDAT\n",
    ),
    "KRL moves": (
        long(names=False),
        "DEF cal()\n" + "".join(f"PTP {{{krl(k)}}}\n" for k in range(N)) + "END\n",
    ),
    "RAPID moves": (
        long(),
        "MODULE m\n"
        + "".join(
            f"MoveAbsJ [[{joined(k)}],[9E9,9E9,9E9,9E9,9E9,9E9]]\\NoEOffs,v,fine,tool0;\n" for k in range(N)
        )
        + "ENDMODULE\n",
    ),
    "URScript": (
        long(),
        "def cal():\n"
        + "".join(
            f"  {NAMES[k]} = [{joined(k, digits=9, scale=np.pi / 180)}] # [1,2,3,4,5,6]\n" for k in range(N)
        )
        + "end\n",
    ),
    # logs without a key
    "row by row": (wide("{x}{n}").replace("joint_", "volts_"), log("A{} [deg]")),
    "a row of the log for three targets": (long(names=False), log("J{}")),
    "more poses in the log, by number": (
        long().replace("p", ""),
        log(key=("Pose", [str(k + 1) for k in range(N)])) + "13,1,2,3,4,5,6\n",
    ),
    "poses by number": (long().replace("p", ""), log(key=("Pose", [str(k + 1) for k in range(N)]))),
    # one family of joints
    "quaternions": (long(("A1;A2;A3;A4;A5;A6", lambda k: joined(k, ";")), extra=("Q0", "Q1", "Q2", "Q3")),),
    "set points of joints beside": (
        "\n".join(
            f"J1_soll,J2_soll,J3_soll,{line}" if line[0] == "x" else f"1,2,3,{line}"
            for line in wide("{x}{n}", "J{}").splitlines()
        ),
    ),
    "ROS names": (wide("{x}{n}", "/joint_states/joint_{}/position"),),
}


def read(name, folder, content, beside=None):
    """A file, and its log if it has one, by the map that is proposed."""
    (file := folder / "export.csv").write_text(content)
    other = None
    if beside is not None:
        (other := folder / "robot.dat").write_text(beside)
    entries = propose(file, ARM, other, folder).entries
    (map_ := folder / "export.toml").write_text(map_text(entries))
    return read_series(file, ARM, map_), entries


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_of_file_is_read_to_the_last_digit(name, tmp_path):
    found, _ = read(name, tmp_path, *KINDS[name])
    [series] = found.series
    order = [series.markers.index(marker) for marker in ("P1", "P2", "P3")]
    np.testing.assert_allclose(series.position[:, order], 1e-3 * X, rtol=0, atol=1e-12)
    np.testing.assert_allclose(series.q, np.radians(Q), rtol=0, atol=6e-10)  # of 9 digits in radians


def test_targets_and_joints_of_several_families_are_named_and_none_is_mixed(tmp_path):
    """Quaternions Q0 to Q3 are no joints; set points beside joints are listed."""
    found, _ = read("quaternions", tmp_path, *KINDS["quaternions"])
    assert f"{UNREAD.format('orientations')}Q0, Q1, Q2, Q3" in found.notes
    found, _ = read("set points", tmp_path, *KINDS["set points of joints beside"])
    assert (
        "warning: these columns look like joints and are not read: J1_soll, J2_soll, J3_soll" in found.notes
    )
    seven = replace(ARM, joints=(*ARM.joints, replace(ARM.joints[-1], name="joint_7")))
    names = ["Q0", "Q1", "Q2", "Q3", *(f"R{k}" for k in range(1, 7)), *(f"J{k} [deg]" for k in range(7))]
    assert joint_family(names, seven) == [*range(10, 17)]
    assert joint_family([*names[:4], "A1", "A2", "J3", "A4", "A5", "A6"], ARM) == []
    joints = [*(f"shoulder_{k}" for k in "abcdef")]
    named = replace(ARM, joints=tuple(replace(j, name=n) for j, n in zip(ARM.joints, joints, strict=True)))
    columns = [f"{x}/{n}" for n in reversed(joints) for x in ("effort", "position")]
    assert joint_family(columns, named) == [11, 9, 7, 5, 3, 1]
    assert joint_family(["Pose", *"SLURBT", "X"], ARM) == [*range(1, 7)]
    spoken = ["Wrist 3 [deg]", "Base [deg]", "Shoulder", "Elbow", "Wrist 1", "Wrist 2"]
    assert joint_family(spoken, ARM) == [1, 2, 3, 4, 5, 0]
    assert joint_family(["Pose", *"SLURB", "X"], ARM) == []


LIKE = {
    "orientations": [
        "A B C", "O;A;T", "W P R", "Rx [deg];Ry [deg];Rz [deg]", "Roll Pitch Yaw", "q0 q1 q2 q3",
        "Q1 Q2 Q3 Q4", "qw qx qy qz", "quat_x quat_y", "TCP_RX TCP_RY TCP_RZ", "rot_x", "Orientation.x",
        "Euler1", "Nick Gier",
    ],
    "joints": ["A1 A2 A3", "J1_cmd J2_cmd", "E1", "target_q_1", "Axis 7 [mm]", "Gelenkwinkel",
        "joint angles", "q1 q2 q5"],
    "times": ["Time", "Timestamp", "time_s", "Date;Uhrzeit", "Zeit [ms]"],
    "loads": ["Fx Fy Fz", "Mx My Mz", "Force_x", "Torque Z", "Kraft [kN]", "F [lbf]", "effort_1",
        "Tx [Nm]", "Load [kg]"],
}  # fmt: skip


@pytest.mark.parametrize(("kind", "header"), [(kind, own) for kind, every in LIKE.items() for own in every])
def test_columns_of_a_kind_that_are_not_read_are_listed(kind, header):
    names = header.split(";") if ";" in header or "[" in header or "angles" in header else header.split(" ")
    names = [header] if header in ("Axis 7 [mm]", "Torque Z") else names
    assert unread_column_warnings(["Comment", *names, "T1 x"]) == [UNREAD.format(kind) + ", ".join(names)]


def test_other_columns_raise_no_warning():
    assert (
        unread_column_warnings(
            [
                "Comment",
                "A",
                "B [T]",
                "Operator",
                "Nr",
                "Temp",
                "RMS",
                "Nominal X",
                "dX",
                "Vibration [g]",
                "T",
            ]
        )
        == []
    )


def test_readers_of_pairs_and_of_readings_list_what_they_do_not_read(tmp_path):
    axes = [f"P{m} {when} {x} [mm]" for m in (1, 2, 3) for when in ("before", "after") for x in "xyz"]
    header = [*(f"joint_{k}_deg" for k in range(1, 7)), "mass_kg", *axes, "A", "B", "C", "Fz [N]", "Time"]
    rows = [
        [*numbers(Q[k]), "100", *numbers(np.repeat(X[k][:, None], 2, axis=1)), "1", "2", "3", "9", TIMES[k]]
        for k in range(N)
    ]
    (file := tmp_path / "pairs.csv").write_text(table(header, rows))
    said = [
        "warning: these columns look like orientations and are not read: A, B, C",
        "warning: these columns look like times and are not read: Time",
        "warning: these columns look like loads and are not read: Fz [N]",
    ]
    for notes in (read_export(file, ARM).notes, read_series(file, ARM).notes):
        assert next(note for note in notes if note.startswith("warning")) == said[0]
        assert {*said[::2]} <= {*notes}
    assert said[1] in read_export(file, ARM).notes
    assert "warning: these columns are not read beside pairs: Time" in read_series(file, ARM).notes


def test_a_log_that_is_joined_by_order_says_so_and_is_refused_where_the_counts_differ(tmp_path):
    export, other = KINDS["a row of the log for three targets"]
    found, entries = read("", tmp_path, export, other)
    [by] = [own for own in entries if own.key == "rows"]
    assert by.value == 3
    assert by.why == "no names or times in common, but these counts agree"
    assert (
        "warning: the rows of robot.dat are joined in their order, each to 3 rows of readings" in found.notes
    )
    fewer = "".join(other.splitlines(keepends=True)[:-1])
    with pytest.raises(
        InputError, match="or equally many rows or poses in both, got 36 readings and 11 rows"
    ):
        read("", tmp_path, export, fewer)
    lines = export.splitlines(keepends=True)
    by_target = "".join([lines[0], *(line for m in range(3) for line in lines[1 + m :: 3])])
    with pytest.raises(
        InputError, match="or equally many rows or poses in both, got 36 readings and 12 rows"
    ):
        read("", tmp_path, by_target, other)
    (tmp_path / "robot.dat").write_text(fewer)
    with pytest.raises(InputError, match="expected 3 rows for each of 11 rows of robot"):
        read_series(tmp_path / "export.csv", ARM, tmp_path / "export.toml")


def test_a_row_of_the_log_belongs_to_the_readings_whose_names_share_a_part(tmp_path):
    lines = [line.split(";") for line in long(names=False).splitlines()]
    lines = [[*lines[0]], *([f"Pt{k // 3 + 1}_{row[0]}", *row[1:]] for k, row in enumerate(lines[1:]))]
    found, _ = read("", tmp_path, "\n".join(map(";".join, lines)), log("J{}"))
    np.testing.assert_allclose(found.series[0].q, np.radians(Q), rtol=0, atol=1e-9)


def test_programs_without_joints_or_in_other_languages_ask_for_a_table(tmp_path):
    fanuc = "/PROG CAL\n/POS\nP[1]{\n GP1:\n J1= -87.750 deg, J2= 1.0 deg\n};\n/END\n"
    kawasaki = ".PROGRAM cal()\nJAPPRO #p1, 100\n.END\n"
    pulses = "/JOB\n//NAME CAL\n//POS\n///POSTYPE PULSE\n///PULSE\nC00000=1,2,3,4,5,6\n"
    poses = "[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    rapid = f"MODULE m\nCONST robtarget p1:={poses};\nENDMODULE\n"
    krl = "DEFDAT CAL\nDECL E6POS XP1={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}\nENDDAT\n"
    for content, said in (
        (pulses, "got pulses, whose number per degree"),
        (kawasaki, "or one of FANUC LS program, .*URScript program, got a program in another language"),
        *(
            (own, "got no joint target; save a table with a row for every pose")
            for own in (fanuc, rapid, krl)
        ),
    ):
        with pytest.raises(InputError, match=said):
            read("", tmp_path, long(), content)


def test_external_axes_of_a_program_are_joints_beyond_the_sixth(tmp_path):
    (file := tmp_path / "cal.src").write_text(
        "DEF cal()\nPTP {E1 7.5,A1 1,A2 2,A3 3,A4 4,A5 5,A6 6,E2 0.0}\nEND\n"
    )
    found = read_log(file, bool)
    assert found.names == (*(f"A{k} [deg]" for k in range(1, 7)), "A7")
    assert [found.texts(k) for k in range(7)] == [["1"], ["2"], ["3"], ["4"], ["5"], ["6"], ["7.5"]]
    assert found.lines.tolist() == [2]
    (file := tmp_path / "cal.mod").write_text(
        "MODULE m\n\n VAR jointtarget a:=[[1,2,3,4,5,6],[-30,9E9,9E9,9E9,9E9,9E9]];\nENDMODULE\n"
    )
    found = read_log(file, bool)
    assert found.names[-2:] == ("A6 [deg]", "A7")
    assert found.texts(found.names.index("name")) == ["a"]
    assert found.texts(7) == ["-30"]


def log_of(form, **say):
    """A log by padded numbers of the poses, the last one first."""
    head, *rows = log(form, key=("Name", [f"P{k + 1:03}" for k in range(N)]), **say).splitlines(keepends=True)
    return "".join([head, *rows[::-1]])


STRANGE = {
    "KUKA RSI": (wide("{x}{n}"), log("AIPos.A{}")),
    "KUKA variables": (wide("{x}{n}"), log("$AXIS_ACT.A{}")),
    "FANUC groups": (wide("{x}{n}"), log("GRP1.J{}")),
    "ABB signals": (wide("{x}{n}"), log("ROB_1 Joint {} position (deg)", between="\t")),
    "PlotJuggler, other names": (
        wide("{x}{n}"),
        "\n".join(
            line + (",/joint_states/joint_a1/velocity" if "joint" in line else ",0.5")
            for line in log("/joint_states/joint_a{}/position").splitlines()
        ),
    ),
    "names of poses in names of points, newest first": (
        table(
            ["Point", "X [mm]", "Y [mm]", "Z [mm]"],
            [[f"A::P{k + 1:02}::T{m + 1}", *numbers(X[k, m])] for k in range(N) for m in range(3)],
            ";",
        ),
        log_of("A{} [deg]"),
    ),
    "gon and thou": (wide("T{n} {X} [thou]", "A{} [gon]", 1 / 0.0254, 10 / 9, (9, 9)).replace(".,", ".0,"),),
    "thousands": (
        "\n".join(
            [
                "Point;X [mm];Y [mm];Z [mm];" + ";".join(f"J{k} [deg]" for k in range(1, 7)),
                *(
                    ";".join([f"P{m + 1}", *(f"{x:,.3f}" for x in X[k, m]), *numbers(Q[k])])
                    for k in range(N)
                    for m in range(3)
                ),
                "",
            ]
        ),
    ),
    "a last column without a name": (
        capture(MOTIVE).replace("X,Y,Z\n", "X,Y,Z,\n").replace("\n", ",0.1\n").replace("Z,,0.1", "Z,"),
        TIMED,
    ),
}


@pytest.mark.parametrize("name", STRANGE)
def test_a_strange_file_is_read_to_the_last_digit(name, tmp_path):
    found, _ = read(name, tmp_path, *STRANGE[name])
    [series] = found.series
    order = [series.markers.index(marker) for marker in ("P1", "P2", "P3")]
    np.testing.assert_allclose(series.position[:, order], 1e-3 * X, rtol=0, atol=1e-12)
    np.testing.assert_allclose(series.q, np.radians(Q), rtol=0, atol=6e-10)


DOWN = np.array([0.25, -0.5, -3.0])  #: How far every target moves under load [mm].


def states(header, words, encoding="utf-8"):
    """A row a target and state, in a language and its encoding."""
    names, mark = header.split("|"), "," if "État" in header else "."
    rows = [
        [str(k + 1), f"T{m + 1}", word, *numbers(X[k, m] + down, mark=mark), *numbers(Q[k], mark=mark)]
        for k in range(N)
        for word, down in zip(words.split("|"), (0, DOWN), strict=True)
        for m in range(3)
    ]
    return table([*names[:6], *(names[6].format(k) for k in range(1, 7))], rows, ";").encode(encoding)


PAIRS = {
    "French": ("Pose|Cible|État|X (mm)|Y (mm)|Z (mm)|Axe {} (deg)", "à vide|en charge", "cp1252"),
    "Spanish": ("Posición|Punto|Carga|X [mm]|Y [mm]|Z [mm]|Eje {} [grados]", "sin carga|con carga"),
    "Italian": ("Posa|Riflettore|Stato|X [mm]|Y [mm]|Z [mm]|Asse {} [gradi]", "scarico|carico"),
    "Portuguese": ("Posição|Alvo|Estado|X [mm]|Y [mm]|Z [mm]|Eixo {} [graus]", "sem carga|com carga"),
    "Chinese": ("姿态|靶球|状态|X(毫米)|Y(毫米)|Z(毫米)|关节{}(度)", "空载|满载", "gb18030"),
    "Japanese": (
        "姿勢|ターゲット|負荷|X座標[mm]|Y座標[mm]|Z座標[mm]|J{}[度]",
        "無負荷|負荷あり",
        "cp932",
    ),
    "Korean": ("자세|목표|상태|X [mm]|Y [mm]|Z [mm]|축{} [deg]", "무부하|부하"),
    "Russian": ("поза|мишень|состояние|X [мм]|Y [мм]|Z [мм]|ось {} [град]", "без нагрузки|с нагрузкой"),
    "yes and no": ("Pose|Target|Load|X [mm]|Y [mm]|Z [mm]|J{} [deg]", "no|yes"),
    "masses in words": ("Pose|Target|Weight|X [mm]|Y [mm]|Z [mm]|J{} [deg]", "without|100 kg"),
    "a weight in newtons": ("Pose|Target|Load [N]|X [mm]|Y [mm]|Z [mm]|J{} [deg]", "0|981"),
}


def fits(found):
    """Whether runs are those of this file, with their last digit."""
    order = [found.markers.index(marker) for marker in ("P1", "P2", "P3")]
    np.testing.assert_allclose(found.before[:, order], 1e-3 * X, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.after[:, order], 1e-3 * (X + DOWN), rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.q, np.radians(Q), rtol=0, atol=6e-10)
    np.testing.assert_allclose(found.wrench[:, 2], -981, rtol=0, atol=1e-9)


def pairs(file, **say):
    entries = propose(file, ARM, None, file.parent, **say).entries
    (map_ := file.with_suffix(".toml")).write_text(map_text(entries))
    masses = any(own.key.startswith(("mass", "force")) for own in entries)
    return read_export(file, ARM, map_, load=None if masses else 100).data


@pytest.mark.parametrize("name", PAIRS)
def test_states_in_words_of_a_language_are_read_to_the_last_digit(name, tmp_path):
    (file := tmp_path / "pairs.csv").write_bytes(states(*PAIRS[name]))
    fits(pairs(file))


def side_by_side(down, between=","):
    header = [f"T{m + 1} {x} [mm]" for m in range(3) for x in "XYZ"] + [f"A{k} [°]" for k in range(1, 7)]
    return table(
        ["Pose", *header], [[NAMES[k], *numbers(X[k] + down), *numbers(Q[k])] for k in range(N)], between
    )


def test_unloaded_and_loaded_readings_in_two_files_or_sheets_are_pairs(tmp_path):
    (file := tmp_path / "unloaded.csv").write_text(side_by_side(0))
    (loaded := tmp_path / "loaded.csv").write_text(side_by_side(DOWN))
    fits(pairs(file, loaded=loaded))
    text = loaded.read_text()
    loaded.write_text(text.replace("T3 Z", "T3 Q"))
    said = "loaded.csv: line 1: expected the same columns as in unloaded.csv; missing here: T3 Z"
    with pytest.raises(InputError, match=said):
        pairs(file, loaded=loaded)
    loaded.write_text(text.replace(numbers(X[4] + DOWN)[4], "4,5,6", 1))
    with pytest.raises(InputError, match=r"loaded.csv: line 6: expected 16 fields, got 18"):
        pairs(file, loaded=loaded)
    loaded.write_text(text)
    map_ = file.with_suffix(".toml")
    loaded.write_text(text.replace(numbers(X[4] + DOWN)[4], "four", 1))
    with pytest.raises(InputError, match=r"loaded.csv: line 6, column T2 Y \[mm\]: expected a finite number"):
        read_export(file, ARM, map_, load=100)
    loaded.write_text(text)
    book = tmp_path / "both.xlsx"
    sheets = {
        name: [[float(x) if x[-1].isdigit() and x[0] != "p" else x for x in row.split(",")] for row in lines]
        for name, lines in (("empty", side_by_side(0).splitlines()), ("full", text.splitlines()))
    }
    book.write_bytes(packed(parts(sheets)))
    fits(pairs(tmp_path / "both.xlsx#empty", loaded=tmp_path / "both.xlsx#full"))


def test_lines_that_name_the_rows_below_tell_unloaded_from_loaded(tmp_path):
    both = [f"{title}\n{side_by_side(down)}\n" for title, down in (("Unloaded", 0), ("Loaded, 100 kg", DOWN))]
    (file := tmp_path / "blocks.csv").write_text("".join(both))
    fits(pairs(file))
    file.write_text("".join(both).replace("Loaded, 100 kg", "Tuesday"))
    said = "expected 16 fields, got 1; .*if such lines name the rows below, sections = true"
    with pytest.raises(InputError, match=said):
        pairs(file)


def steps(*words):
    """A row a target and step of a pose, the second one loaded."""
    rows = [
        [str(k + 1), f"P{m + 1}", word, *numbers(X[k, m] + DOWN * (n == 1)), *numbers(Q[k])]
        for k in range(N)
        for n, word in enumerate(words)
        for m in range(3)
    ]
    header = ["Pose", "Target", "Stage", "X [mm]", "Y [mm]", "Z [mm]", *(f"J{k} [deg]" for k in range(1, 7))]
    return table(header, rows)


def test_an_unloaded_reading_may_follow_the_loaded_one(tmp_path):
    (file := tmp_path / "pairs.csv").write_text(steps("unloaded 1", "loaded", "unloaded 2"))
    fits(pairs(file))


def cell(text):
    """A cell of a workbook: numbers are none of words."""
    return float(text) if text and text[-1].isdigit() and text[0] in "-0123456789" else text or None


def book(**sheets):
    """A workbook of tables, each of lines with commas."""
    own = {
        name.replace("_", " "): [[*map(cell, row.split(","))] for row in text.splitlines()]
        for name, text in sheets.items()
    }
    return packed(parts(own))


def by_target(down, targets=(0, 1, 2), joints=numbers):
    """Rows of a pose's targets, its joints in the first of them or in all."""
    header = ["Pose", "Target", *(f"A{k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]"]
    rows = [
        [f"Pos {k + 1}", f"P{m + 1}", *joints(Q[k]), *numbers(X[k, m] + down)]
        for k in range(N)
        for m in targets
    ]
    return table(header, rows)


def both(form="{when} {x} [mm]", unit="", load="100", joint="A{} [deg]", turn=1.0, more=()):
    """Both readings of a target in one row, with its load."""
    axes = [form.format(when=when, x=x) for when in ("Unloaded", "Loaded") for x in "XYZ"]
    rows = [
        [f"Pos {k + 1}", f"P{m + 1}", *numbers(turn * Q[k], 9), load]
        + [f"{x}{unit}" for x in numbers([X[k, m], X[k, m] + DOWN])]
        for k in range(N)
        for m in range(3)
    ]
    return table(
        ["Pose", "Target", *(joint.format(k) for k in range(1, 7)), "Load [kg]", *axes], [*rows, *more]
    )


def merged(text):
    """Cells that are blank below the first of three rows."""
    rows = [line.split(",") for line in text.splitlines()]
    return "\n".join(
        ",".join("" if k and (k - 1) % 3 and n != 1 and n < 9 else x for n, x in enumerate(row))
        for k, row in enumerate(rows)
    )


def test_a_long_table_is_not_divided_to_see_whether_its_rows_are_columns(tmp_path, monkeypatch):
    """Dividing 200,000 rows by four delimiters took 15 s."""
    header, rows = both().split("\n", 1)
    (file := tmp_path / "long.csv").write_text(f"{header}\n" + f"{rows.rstrip()}\n" * 30)
    monkeypatch.setattr(read_unknown, "even_rows", lambda *_: pytest.fail("divided"))
    assert propose(file, ARM, None, tmp_path).entries


MEANS = [[word, "", *["0.5"] * 13] for word in ("Mean", "Std. Dev.")]
HEADS = (
    "Pose,Target,Joints [deg],,,,,,Load [kg],Unloaded [mm],,,Loaded [mm],,\n"
    ",,A1,A2,A3,A4,A5,A6,,X,Y,Z,X,Y,Z\n"
)
BY_AXIS = [
    [f"Pos {k + 1}", f"P{m + 1}", x, *numbers(Q[k]), "100", *numbers([X[k, m, n], X[k, m, n] + DOWN[n]])]
    for k in range(N)
    for m in range(3)
    for n, x in enumerate("XYZ")
]


def by_load(*forms):
    """Both readings of a target in one row, called as forms of an axis say, without a column of loads."""
    axes = [form.format(x=x) for form in forms for x in "XYZ"]
    rows = [
        [f"Pos {k + 1}", f"P{m + 1}", *numbers(Q[k]), *numbers([X[k, m], X[k, m] + DOWN])]
        for k in range(N)
        for m in range(3)
    ]
    return table(["Pose", "Target", *(f"A{k} [deg]" for k in range(1, 7)), *axes], rows)


def exchanged(text, between=";"):
    """A table whose rows are columns."""
    return "\n".join(map(between.join, zip(*(row.split(",") for row in text.splitlines()), strict=True)))


SIDES = table(
    ["Pose", *(f"A{k} [°]" for k in range(1, 7)), "Load [kg]"]
    + [f"P{m} {x} {when} [mm]" for when in ("before", "after") for m in (1, 2, 3) for x in "XYZ"],
    [[str(k + 1), *numbers(Q[k]), "100", *numbers([X[k], X[k] + DOWN])] for k in range(N)],
)
PLACED = [
    [f"Pos {k + 1}", load, f"({joined(k)})", *(f"({', '.join(numbers(X[k, m] + down))})" for m in range(3))]
    for k in range(N)
    for load, down in (("0", 0), ("100", DOWN))
]
FIVE = "Pose|Target|{}|X [mm]|Y [mm]|Z [mm]|J{{}} [deg]"
TOGETHER = {
    "rows and columns exchanged": f"Report\n{exchanged(SIDES)}".encode(),
    "rows and columns exchanged, a column of units": exchanged(
        SIDES.replace(" [°]", "")
        .replace(" [mm]", "")
        .replace("Load [kg]", "Load")
        .replace("\n1,", f"\nUnit,{','.join(['deg'] * 6 + ['kg'] + ['mm'] * 18)}\n1,", 1)
    ).encode(),
    "a load in the names of columns": by_load("{x} 0 kg [mm]", "{x} 100 kg [mm]").encode(),
    "a load in the names of some columns": by_load("{x} [mm]", "{x} (100kg) [mm]").encode(),
    "a load in a line above": book(
        A="Pose,Target,Joints [deg],,,,,,empty [mm],,,100 kg [mm],,\n,,A1,A2,A3,A4,A5,A6,X,Y,Z,X,Y,Z\n"
        + by_load("{x} a", "{x} b").partition("\n")[2]
    ),
    "states by 0 and 1": both(form="{x}{when} [mm]").replace("Unloaded", "0").replace("Loaded", "1").encode(),
    "a legend": states(FIVE.format("Load"), "L0|L1") + b"\nL0 = empty\nL1: 2 x 40 kg + 20 kg\n",
    "a mass behind the numbers of a state": states(FIVE.format("Zustand"), "0 kg|100 kg"),
    "a state in a column of another name": states(FIVE.format("Etappe"), "unloaded|under load"),
    "a mass in a column of another name": states(FIVE.format("Hung kg [kg]"), "0|100"),
    "a marker in a column of another name": both().replace("Target", "Kugel").encode(),
    "sections by marker": "".join(
        f"Marker P{m + 1}\n"
        + "".join(
            f"{row}\n" for k, row in enumerate(both().splitlines()) if not k or (k - 1) % 3 == m
        ).replace("Target", "No")
        for m in range(3)
    ).encode(),
    "a cell of every target": table(
        ["Pose", "Load [kg]", "Joints [deg]", *(f"P{m} (x/y/z) mm" for m in (1, 2, 3))], PLACED, ";"
    ).encode(),
    "a pose called Max": both().replace("Pos 2,", "Max,").encode(),
    "a drawn table": both().replace(",", " | ").replace("\n", "\n---|---|---\n", 1).encode(),
    "means of readings": both(form="{when} {x} mean [mm]").encode(),
    "sheets by state, a cover first": book(
        Cover="Report\nRobot,KR 500", Unloaded=f"Cell 4\n\n{by_target(0)}", Loaded=by_target(DOWN)
    ),
    "German sheets, means below": book(
        ohne_Last=f"{side_by_side(0)}Mittelwert,{','.join(['1.5'] * 15)}", mit_Last=side_by_side(DOWN)
    ),
    "sheets by load": book(**{"0_kg": by_target(0), "100_kg": by_target(DOWN)}),
    "sheets by target": book(
        **{
            f"P{m + 1}": "\n".join(
                row for k, row in enumerate(both().splitlines()) if not k or (k - 1) % 3 == m
            )
            for m in range(3)
        }
    ),
    "text with decimal commas beside numbers": packed(
        parts(
            {
                "A": [
                    [x.replace(".", ",") if n % 2 and k else cell(x) for n, x in enumerate(row.split(","))]
                    for k, row in enumerate(both().splitlines())
                ]
            }
        )
    ),
    "sections by load": f"No load\n{side_by_side(0)}\nLoaded, 100 kg\n{side_by_side(DOWN)}".encode(),
    "merged joints": book(A=merged(both())),
    "merged heads": book(A=HEADS + both().partition("\n")[2]),
    "means and a remark below": f"{both(more=MEANS)}\nSignature: M. Mueller\n".encode(),
    "units behind numbers": both(form="{when} {x}", unit=" mm").encode(),
    "a row an axis": table(
        [
            "Pose",
            "Target",
            "Axis",
            *(f"J{k}" for k in range(1, 7)),
            "Load [kg]",
            "Unloaded [mm]",
            "Loaded [mm]",
        ],
        BY_AXIS,
    ).encode(),
    "grad of an axis called Achse": both(joint="Achse {} [Grad]").encode(),
}


@pytest.mark.parametrize("name", TOGETHER)
def test_a_table_as_people_make_it_is_read_to_the_last_digit(name, tmp_path):
    content = TOGETHER[name]
    (file := tmp_path / ("own.xlsx" if content.startswith(b"PK") else "own.csv")).write_bytes(content)
    fits(pairs(file))


@pytest.mark.parametrize(
    "words", ["0|1", "FALSE|TRUE", "no load|with 100 kg", "w/o load|w/ load", "Before load|After load"]
)
def test_a_state_in_other_words_is_read_to_the_last_digit(words, tmp_path):
    name = "Loaded" if "TRUE" in words else "State"
    (file := tmp_path / "pairs.csv").write_bytes(
        states(f"Pose|Target|{name}|X [mm]|Y [mm]|Z [mm]|J{{}} [deg]", words)
    )
    fits(pairs(file))


def test_what_a_table_does_not_say_is_asked_or_said(tmp_path):
    """Another unit, another sheet, a state that nobody knows, a number that a cell hides."""
    for content, said in (
        (
            both(joint="J{} [grad]"),
            "grad means degrees in German, Spanish and Russian, gon in English; state which in",
        ),
        (
            both(form="{when} {x}", unit=" mm").replace(" mm", " mm?", 1),
            r"expected a finite number, got '-?[0-9.]+ mm",
        ),
        (
            states("Pose|Target|State|X [mm]|Y [mm]|Z [mm]|J{} [deg]", "unloaded|not loaded").decode(),
            "all are unloaded",
        ),
        (
            states("Pose|Target|State|X [mm]|Y [mm]|Z [mm]|J{} [deg]", "L0|L1").decode(),
            "no state 'L0' is known",
        ),
        (
            steps("before", "under load", "after"),
            "column Stage: readings of one point differ only in this column .'before', 'under load', ",
        ),
        (
            states(FIVE.format("Stan"), "nieobciążony|obciążony").decode(),
            "column Stan: readings of one point differ only in this column .'nieobciążony', ",
        ),
        (states(FIVE.format("Load [%]"), "0|100").decode(), "expected a unit of mass or force, got '%'"),
        (
            states(FIVE.format("Load"), "none|2 plates of 50 kg").decode(),
            "expected a finite number, got '2 plates of 50 kg'",
        ),
        (
            table(
                ["Target", *(f"A{k}" for k in range(1, 7)), *"XYZ", "Unit"],
                [["P1", *numbers(Q[k]), *numbers(X[k, 0]), ("mm", "in")[k == 5]] for k in range(N)],
            ),
            "column Unit: expected one unit of length, got ",
        ),
        (
            table(
                ["Name", *(f"A{k}" for k in range(1, 7)), *"XYZ"],
                [[f"{NAMES[k]}_{w}", *numbers(Q[k]), *numbers(X[k, 0])] for k in range(N) for w in "UL"],
            ),
            "column Name: the meaning of 'U' and 'L' in names such as 'p1_U'",
        ),
        *(
            (
                states("Pose|Target|Load|X [mm]|Y [mm]|Z [mm]|J{} [deg]", f"none|{mass}").decode(),
                f"expected masses without a thousands separator, such as 1000 kg, got '{mass}'",
            )
            for mass in ("1,000 lb", "with 1.000 kg", "1 000.5 kg")
        ),
    ):
        (file := tmp_path / "pairs.csv").write_text(content)
        with pytest.raises(InputError, match=said):
            pairs(file)
    for words in ("Loaded 1|Loaded 2", "unloaded|with 100 kg and 20 kg", "0 kg|without 100 kg"):
        (file := tmp_path / "steps.csv").write_bytes(
            states("Pose|Target|State|X [mm]|Y [mm]|Z [mm]|J{} [deg]", words)
        )
        with pytest.raises(InputError, match="no state '"):
            pairs(file)
    rows = table(["Pose", "Point", *"XYZ"], [[p, m, "1", "2", "3"] for p in "01" for m in "01"])
    (file := tmp_path / "points.csv").write_text(rows)
    (other := tmp_path / "log.csv").write_text(
        table(["Pose", *(f"J{k}" for k in range(1, 7))], [["0", *"123456"], ["1", *"234567"]])
    )
    assert not {"state", "before", "after"} & {own.key for own in propose(file, ARM, other, tmp_path).entries}
    (file := tmp_path / "book.xlsx").write_bytes(book(May=both(), June=both()))
    assert "warning: other sheets with tables are not read: June" in notes_of(file)
    names = [f"J{k} [grad]" for k in range(1, 7)]
    (file := tmp_path / "far.csv").write_text(
        table([*names, *"XYZ"], [["10", "-90", "90", "380", "0", "0", "1", "2", "3"]] * 2)
    )
    far = read("far", tmp_path, file.read_text())[0]
    q, said = (
        far.series[0].q,
        "warning: grad is read as gon, because degrees would exceed a limit: J1 [grad], ",
    )
    assert any(note.startswith(said) for note in far.notes)
    np.testing.assert_allclose(q[0], np.radians([9, -81, 81, 342, 0, 0]), atol=1e-12)
    (file := tmp_path / "cog.csv").write_text(
        both(joint="joint_{}_deg")
        .replace("Load [kg]", "mass_kg,CoG x [mm],CoG y [mm],CoG z [mm]")
        .replace(",100,", ",100,1,2,3,")
    )
    warning = "warning: these columns look like centres of mass and are not read: "
    assert f"{warning}CoG x [mm], CoG y [mm], CoG z [mm]" in notes_of(file)


def test_a_column_that_is_not_read_but_tells_repeated_pairs_apart_is_named(tmp_path):
    visits = [
        [*line.split(","), who]
        for who in ("Ann", "Bob")
        for load in ("0", "100")
        for line in by_target(DOWN * (load == "100")).replace("\n", f",{load}\n").splitlines()[1:]
    ]
    header = [*by_target(0).splitlines()[0].split(","), "Load [kg]", "Operator"]
    (file := tmp_path / "visits.csv").write_text(table(header, visits))
    assert "warning: readings of one point differ in Operator ('Ann', 'Bob'), which is not read" in notes_of(
        file
    )


def notes_of(file):
    (map_ := file.with_suffix(".toml")).write_text(map_text(propose(file, ARM, None, file.parent).entries))
    return read_export(file, ARM, map_).notes


LINES = {
    "gauges": (
        "Reading unloaded (mm),Reading loaded (mm),Direction x,Direction y,Direction z",
        "10.0,9.5,0,0,1",
        -0.5e-3,
    ),
    "a gauge in hundredths along -Z": (
        "Gauge unloaded [0.01 mm],Gauge loaded [1/100 mm],Direction",
        "1000,950,-Z",
        -0.5e-3,
    ),
    "a gauge that was at zero": (
        "Gauge reading [mm],Direction x,Direction y,Direction z",
        "-0.5,0,0,1",
        -0.5e-3,
    ),
    "a draw-wire": (
        "Wire length unloaded [mm],Wire length loaded [mm],Anchor x [mm],Anchor y [mm],Anchor z [mm]",
        "2345.0,2345.5,2200,0,100",
        0.5e-3,
    ),
}


@pytest.mark.parametrize("name", LINES)
def test_gauges_and_wires_are_known_by_their_names(name, tmp_path):
    header, row, moved = LINES[name]
    rows = [[str(k + 1), "P1", *numbers(Q[k]), "100", row] for k in range(N)]
    (file := tmp_path / "lines.csv").write_text(
        table(["Run", "Target", *(f"J{k} (deg)" for k in range(1, 7)), "Load (kg)", header], rows)
    )
    found = pairs(file)
    assert found.is_line_reading[:, found.markers.index("P1")].all()
    along = np.einsum("ri,ri->r", found.deflection[:, 0], found.line_direction[:, 0])
    np.testing.assert_allclose(along, moved, rtol=0, atol=1e-12)


@pytest.mark.parametrize("start", [b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0"])
def test_a_picture_in_place_of_a_table_is_refused_as_one(tmp_path, start):
    (file := tmp_path / "file.csv").write_bytes(start + bytes(range(256)))
    with pytest.raises(InputError, match="expected a table, got a picture"):
        propose(file, ARM, None, tmp_path)


def test_what_is_no_table_or_does_not_say_what_is_meant_is_refused(tmp_path):
    good = side_by_side(0)
    twice = [*"XYZ", *(f"A{k}" for k in range(1, 7)), *"XYZ"]
    deflections = good.replace("T1 ", "d").replace("T2", "U2").replace("T3", "U3")
    for content, said in (
        ('[{"q": [1, 2]}]', "expected a table, got JSON; save it as CSV or as a workbook"),
        ("<html><table></table></html>", "expected a table, got XML or HTML"),
        ("%PDF-1.7 ...", "expected a table, got a PDF"),
        (log("J{}"), "no column looks like a position"),
        (good.replace("A1 [°]", "Comment"), r"or in \[values\], as joint_1_deg = 0, if one never moves"),
        (deflections, "deflections alone do not show where the targets are"),
        ("Messuhr 1 [mm],A1,A2,A3,A4,A5,A6\n0.1,1,2,3,4,5,6\n", "a gauge's readings are travel_before_mm"),
        (table(twice, [["1"] * 12]), "got 'X' again; state"),
        (by_load("{x} 0 kg", "{x} 9 kg").replace("Y 9", "X 9"), "got 'X 9 kg' again; state"),
        (
            by_load("{x} 0 kg", "{x} 9 kg").replace("\n", "\n,,,,,,,,mm,mm,mm,in,mm,mm\n", 1),
            r"expected one unit of all columns 'X \{mass_kg\}', got in, mm",
        ),
    ):
        (file := tmp_path / "file.csv").write_text(content)
        with pytest.raises(InputError, match=said):
            propose(file, ARM, None, tmp_path)
