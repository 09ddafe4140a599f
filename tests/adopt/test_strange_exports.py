"""Exports that strangers would bring: each is read to its last digit, or refused in a line that says why."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
from run_here import fine
from test_kinds_of_files import ARM, DOWN, NAMES, TIMES, N, Q, X, fits, numbers, pairs, read, table

from testbench.errors import InputError
from testbench.files import columns
from testbench.files.mapping import FileLayout
from testbench.files.propose_map import propose
from testbench.files.read_pairs import read_export
from testbench.files.read_series import read_series
from testbench.files.table import read_table

DEG = [f"A{k} [deg]" for k in range(1, 7)]
MM = [f"{x} [mm]" for x in "XYZ"]
RAD = np.radians(Q)


def six(form, first=1):
    """Six names of joints."""
    return [form.format(k) for k in range(first, first + 6)]


# --- Absolute readings of one target ------------------------------------------------------------------------


def beside(joints=DEG, place=MM, turn=1.0, scale=1.0, digits=(9, 6), between=",", mark="."):
    """One row per pose: the point, its joints and its position."""
    rows = [
        [NAMES[k], *numbers(turn * Q[k], digits[0], mark), *numbers(scale * X[k, 0], digits[1], mark)]
        for k in range(N)
    ]
    return table(["Point", *joints, *place], rows, between)


def grouped(thousands, mark):
    """Positions whose thousands are divided."""
    cells = [
        [f"{x:,.3f}".replace(",", "T").replace(".", mark).replace("T", thousands) for x in X[k, 0]]
        for k in range(N)
    ]
    rows = [[NAMES[k], *numbers(Q[k], 3, mark), *cells[k]] for k in range(N)]
    return table(["Punkt", *six("Achse {} [°]"), *MM], rows, ";")


def points(place=MM, scale=1.0, key=("Point", NAMES)):
    """Points whose joints are in a log."""
    return table([key[0], *place], [[key[1][k], *numbers(scale * X[k, 0], 6)] for k in range(N)])


def log(joints, turn=1.0, key=("Point", NAMES), beside=((), ())):
    """The log of a robot, newest first."""
    rows = [[key[1][k], *beside[1], *numbers(turn * Q[k], 9)] for k in range(N)]
    return table([key[0], *beside[0], *joints], rows[::-1])


STATED = np.round(X[:, 0])  #: Drawn places [mm].
TIMED = ("Time", TIMES)
SHUFFLED = [2, 1, 0, 3, 4, 5]  #: Joints in the order of a message.
BAG = table(
    [*TIMED[:1], *six("name_{}", 0), *six("position_{}", 0), *six("velocity_{}", 0)],
    [
        [TIMES[k], *(f"joint_{j + 1}" for j in SHUFFLED), *numbers(RAD[k, SHUFFLED], 9), *["0.0"] * 6]
        for k in range(N)
    ],
)
COMPARED = [f"{x} {what}" for what in ("Nominal", "Measured", "Dev") for x in "XYZ"]
LISTS = [[NAMES[k], *numbers(Q[k]), *numbers(X[k, 0])] for k in range(N)]
KEYED = [*DEG, *MM]
TIDY_POINTS = [[row[0], name, cell] for row in LISTS for name, cell in zip(KEYED, row[1:], strict=True)]
RADIANS = np.pi / 180
READ = {
    # trackers and measuring machines
    "PolyWorks, nominal, measured, deviation": (
        table(
            ["Name", *COMPARED, *DEG],
            [
                [NAMES[k], *numbers([STATED[k], X[k, 0], X[k, 0] - STATED[k]]), *numbers(Q[k])]
                for k in range(N)
            ],
        ),
    ),
    "Verisurf": (
        table(
            ["Feature", "Nominal X", "Nominal Y", "Nominal Z", "Actual X", "Actual Y", "Actual Z", "3D Dev"],
            [[NAMES[k], *numbers([STATED[k], X[k, 0]]), "0.5"] for k in range(N)],
        ),
        log(DEG),
    ),
    "GOM, rows of properties": (
        table(
            ["Element", "Property", "Nominal", "Actual", "Dev.", "Check"],
            [
                [NAMES[k], "XYZ"[i], *numbers([STATED[k, i], X[k, 0, i], X[k, 0, i] - STATED[k, i]]), "ok"]
                for k in range(N)
                for i in range(3)
            ],
            ";",
        ),
        log(DEG, key=("Element", NAMES)),
    ),
    "units with a full stop": (beside(place=[f"{x} (in.)" for x in "XYZ"], scale=1 / 25.4, digits=(9, 12)),),
    "joints with letters, as a Motoman": (beside(joints=[*"SLURBT"]),),
    "FARO with coordinates": (
        "Vantage\nUnits,mm\n\n" + points([f"{x} Coord (mm)" for x in "XYZ"]),
        log(DEG),
    ),
    "rows of axes with nominal values": (
        table(
            ["Feature", "Axis", "Nominal", "Measured", "Deviation", *DEG],
            [
                [NAMES[k], "XYZ"[i], "0", *numbers(X[k, 0, i]), "0", *numbers(Q[k])]
                for k in range(N)
                for i in range(3)
            ],
        ),
    ),
    "deviations from drawn places beside": (
        table(
            ["Point", *MM, *(f"d{x}" for x in MM), *DEG],
            [[NAMES[k], *numbers([X[k, 0], X[k, 0] - STATED[k]]), *numbers(Q[k])] for k in range(N)],
        ),
    ),
    # units
    "revolutions": (beside(six("Axis {} [rev]"), turn=1 / 360, digits=(12, 6)),),
    "turns": (beside(six("J{} (turns)"), turn=1 / 360, digits=(12, 6)),),
    "gradians": (beside(six("J{} [gradians]"), turn=1 / 0.9),),
    "millidegrees": (beside(six("J{} [mdeg]"), turn=1000.0),),
    "minutes of arc": (beside(six("J{} [arcmin]"), turn=60.0),),
    "seconds of arc": (beside(six("J{} (arcsec)"), turn=3600.0),),
    "thousands divided by points": (grouped(".", ","),),
    "thousands divided by apostrophes": (grouped("'", "."),),
    "thousands divided by thin blanks": (grouped("\u202f", ","),),
    "a typesetter's minus": (beside(digits=(3, 3)).replace("-", "\u2212"),),
    # tables of programs
    "R, rows with numbers and no name": (
        table([f'"{name}"' for name in ["Point", *DEG, *MM]], [], " ")
        + "".join(f'"{k + 1}" ' + " ".join(row) + "\n" for k, row in enumerate(LISTS)),
    ),
    "R, an index": (
        table(['""', "Point", *DEG, *MM], [[f'"{k + 1}"', *row] for k, row in enumerate(LISTS)]),
    ),
    "pandas, an index": (
        table(["Unnamed: 0", "Point", *DEG, *MM], [[str(k), *row] for k, row in enumerate(LISTS)]),
    ),
    "MATLAB, columns of vectors": (beside(six("q_{}"), ["pos_1", "pos_2", "pos_3"], RADIANS, 1e-3, (12, 9)),),
    "MATLAB, places of vectors": (
        beside(six("theta({})"), ["pos(1)", "pos(2)", "pos(3)"], RADIANS, 1e-3, (12, 9)),
    ),
    "Python, places from 0": (beside(six("q[{}]", 0), six("position[{}]", 0)[:3], RADIANS, 1e-3, (12, 9)),),
    "px, py, pz": (beside(six("q{}"), ["px", "py", "pz"], RADIANS, 1e-3, (12, 9)),),
    "a quantity per row": (table(["Point", "variable", "value"], TIDY_POINTS),),
    "a quantity per row, numbered": (
        table(["", "Point", "variable", "value"], [[str(n), *row] for n, row in enumerate(TIDY_POINTS)]),
    ),
    "lists in cells": (
        table(
            ["q", "tcp"],
            [
                [f"[{', '.join(numbers(RAD[k], 9))}]", f"[{', '.join(numbers(1e-3 * X[k, 0], 6))}]"]
                for k in range(N)
            ],
            ";",
        ),
    ),
    "circles of single joints": (
        table(
            ["Circle", *DEG, *MM],
            [[f"A{k % 6 + 1}", *numbers(Q[k]), *numbers(X[k, 0])] for k in range(N)],
        ),
    ),
    # logs of robots
    "Kawasaki": (points(), log(six("JT{} [deg]"))),
    "orientations that never turn": (
        table(["Point", *MM, "RX", "RY", "RZ"], [[NAMES[k], *numbers(X[k, 0]), *"123"] for k in range(N)]),
        log(DEG),
    ),
    "KUKA, trace": (points(), log(six("AxisAct[{}]"))),
    "KUKA, measured axes": (points(), log(six("$AXIS_ACT_MEAS.A{}"))),
    "ABB, robax": (points(), log(six("robax.rax_{}"))),
    "FANUC, group": (points(), log(six("GP1_J{}"))),
    "Stäubli": (points(), log(six("joint({})"))),
    "Doosan": (points(), log(six("posj_{}"))),
    "Siemens": (points(), log(six("$AA_IM[A{}]"))),
    "Beckhoff": (points(), log(six("GVL.Axis{}.ActPos"))),
    "feedback of axes": (points(), log(six("Axis {} feedback"))),
    "Universal Robots": (points(), log(six("actual_q_{}", 0), RADIANS)),
    "Igus": (points(), log(six("A{}_pos"))),
    "Rokae": (points(), log(six("jointPos{}"))),
    "a place of the controller beside": (
        points(),
        log(DEG, beside=(("TCP X", "TCP Y", "TCP Z"), ("1", "2", "3"))),
    ),
    # ROS
    "bag, joints named beside": (points(key=TIMED), BAG),
    "bag, names in brackets": (
        points(key=TIMED),
        BAG.replace("name_", "/joint_states/name_").replace("position_", "/joint_states/position_"),
    ),
    "bag, no names": (points(key=TIMED), log(six("/joint_states/position[{}]", 0), RADIANS, TIMED)),
    "stamped poses": (
        points([f"pose.position.{x}" for x in "xyz"], 1e-3, TIMED),
        log(six("joint_{}"), RADIANS, TIMED),
    ),
    # programs
    "KRL without E": (
        points(),
        "DEFDAT CAL PUBLIC\nDECL PDAT PPDAT1={VEL 100}\n"
        + "".join(
            f"DECL AXIS X{NAMES[k]}={{{','.join(f'A{j + 1} {x}' for j, x in enumerate(numbers(Q[k])))}}}\n"
            for k in range(N)
        )
        + "ENDDAT\n",
    ),
    "RAPID, local, beside poses": (
        points(),
        "MODULE Cal\n  CONST robtarget h:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
        + "".join(
            f"  LOCAL PERS jointtarget {NAMES[k]} := [[{','.join(numbers(Q[k]))}],"
            "[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];\n"
            for k in range(N)
        )
        + "ENDMODULE\n",
    ),
    "FANUC, numbered points": (
        table(MM, [numbers(X[k, 0]) for k in range(N)]),
        "/PROG CAL\n/MN\n 1:J P[1] 10% FINE ;\n/POS\n"
        + "".join(
            f"P[{k + 1}]{{\n   GP1:\n\tUF : 0, UT : 1,\n\t"
            + ",\t".join(f"J{j + 1}= {x} deg" for j, x in enumerate(numbers(Q[k])))
            + "\n};\n"
            for k in range(N)
        )
        + "/END\n",
    ),
}


@pytest.mark.parametrize("name", READ)
def test_absolute_readings_are_read_to_the_last_digit(name, tmp_path):
    found, _ = read(name, tmp_path, *READ[name])
    [series] = found.series
    np.testing.assert_allclose(series.position[:, 0], 1e-3 * X[:, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(series.q, RAD, rtol=0, atol=1e-9)


# --- Unloaded and loaded readings of three targets ----------------------------------------------------------


def by_state(word, columns=("Load [kg]",), between=","):
    """One row per pose, state and target; a function of the state says what the columns hold."""
    rows = [
        [NAMES[k], f"P{m + 1}", *word(loaded), *numbers(Q[k]), *numbers(X[k, m] + loaded * DOWN)]
        for k in range(N)
        for loaded in (0, 1)
        for m in range(3)
    ]
    return table(["Pose", "Target", *columns, *DEG, *MM], rows, between)


def both(unloaded, loaded, moved=False, load=("Load [kg]", "100"), scale=1.0):
    """One row per pose and target; names of the columns of an axis in both states."""
    axes = [form.format(x) for form in (unloaded, loaded) for x in "XYZ"]
    rows = [
        [
            *(NAMES[k], f"P{m + 1}", *numbers(Q[k]), load[1], *numbers(X[k, m])),
            *numbers(scale * DOWN if moved else X[k, m] + DOWN),
        ]
        for k in range(N)
        for m in range(3)
    ]
    return table(["Pose", "Target", *DEG, load[0], *axes], rows)


STATE_WORDS = ("unloaded", "loaded")
QUANTITIES = [*six("joint_{}_deg"), "mass_kg", "x_mm", "y_mm", "z_mm"]
WHOLE = [
    [NAMES[k], f"P{m + 1}", STATE_WORDS[loaded], *numbers(Q[k]), "100", *numbers(X[k, m] + loaded * DOWN)]
    for k in range(N)
    for loaded in (0, 1)
    for m in range(3)
]
WEIGHT = 100 * 9.81  #: [N]


def weighs(unit, amount, name="Load"):
    return by_state(lambda loaded: [f"{loaded * amount:.16g}"], (f"{name} [{unit}]",))


PAIRED = {
    "SpatialAnalyzer, vectors": table(
        [
            "Pose",
            "Vector",
            *DEG,
            "kg",
            *(f"{w} {x}" for w in ("Begin", "Delta", "End") for x in "XYZ"),
            "Mag",
        ],
        [
            [NAMES[k], f"P{m + 1}", *numbers(Q[k]), "100", *numbers([X[k, m], DOWN, X[k, m] + DOWN]), "3"]
            for k in range(N)
            for m in range(3)
        ],
    ),
    "X and dX, every row loaded": both("{} [mm]", "d{} [mm]", moved=True),
    "X and delta X in um": both("{} [mm]", "Delta {} [um]", moved=True, scale=1000),
    "X and a deflection": both("{} [mm]", "Deflection {} [mm]", moved=True),
    "X and a displacement, German": both("{} [mm]", "Verschiebung {} [mm]", moved=True),
    "initial and final": both("{} initial [mm]", "{} final [mm]"),
    "begin and end": both("{} begin [mm]", "{} end [mm]"),
    "free and loaded": both("{} free [mm]", "{} loaded [mm]"),
    "an acceleration in g and a field in T are no masses": by_state(
        lambda loaded: [STATE_WORDS[loaded], "0.02" * loaded or "0", "0" * loaded or "1"],
        ("State", "Vibration [g]", "B [T]"),
    ),
    "tonnes": weighs("t", 0.1),
    "tonnes in German": weighs("Tonnen", 0.1, "Last"),
    "grams": weighs("g", 100_000.0, "Mass"),
    "tonnes behind an underscore": weighs("t", 0.1).replace("Load [t]", "load_t"),
    "kilonewtons": weighs("kN", WEIGHT / 1000),
    "pounds of force": weighs("lbf", WEIGHT / 4.4482216152605),
    "kiloponds": weighs("kp", WEIGHT / 9.80665, "Last"),
    "newtons in a word": weighs("newtons", WEIGHT),
    "a payload beside its weight": by_state(
        lambda loaded: [f"{100 * loaded}", f"{980 * loaded}"], ("Payload [kg]", "Weight [N]")
    ),
    "a weight beside its payload": by_state(
        lambda loaded: [f"{981 * loaded}", f"{100 * loaded}"], ("Weight [N]", "Payload [kg]")
    ),
    "tonnes in words": by_state(lambda loaded: [("none", "0.1 t")[loaded]], ("Load",)),
    "two weights in tonnes": by_state(lambda loaded: [("none", "2 x 0.05 t")[loaded]], ("Load",)),
    "a legend of a flange and a plate": "LA: empty flange\nLB: 100 kg plate\n\n"
    + by_state(lambda loaded: [("LA", "LB")[loaded]], ("Load",)),
    "Y and N beside a mass": by_state(
        lambda loaded: ["NY"[loaded], str(100 * loaded)], ("Loaded?", "Mass [kg]")
    ),
    "states shortened": both("{} unl. [mm]", "{} load. [mm]"),
    "yes and no beside a mass": by_state(
        lambda loaded: [("no", "yes")[loaded], str(100 * loaded)], ("Loaded", "Mass [kg]")
    ),
    "steps with a number and a load": by_state(
        lambda loaded: [("1 - unloaded", "2 - loaded 100 kg")[loaded]], ("Step",)
    ),
    "a quantity per row, beside the joints": table(
        ["pose", "marker", "state", *six("joint_{}_deg"), "mass_kg", "variable", "value"],
        [[*row[:10], "xyz"[i], row[10 + i]] for row in WHOLE for i in range(3)],
    ),
    "a quantity per row, units in names": table(
        ["pose", "marker", "state", *six("joint_{}_deg"), "mass_kg", "name", "value"],
        [[*row[:10], f"{'xyz'[i]}_mm", row[10 + i]] for row in WHOLE for i in range(3)],
    ),
    "a quantity per row, all of them": table(
        ["pose", "marker", "state", "variable", "value"],
        [[*row[:3], *own] for row in WHOLE for own in zip(QUANTITIES, row[3:], strict=True)],
    ),
    "a quantity per row, beside its unit": table(
        ["pose", "marker", "state", "quantity", "value", "unit"],
        [
            [*row[:3], name.rpartition("_")[0], cell, name.rpartition("_")[2]]
            for row in WHOLE
            for name, cell in zip(QUANTITIES, row[3:], strict=True)
        ],
    ),
    "a quantity per row, targets and states in names": table(
        ["pose", *DEG, "load [kg]", "variable", "value"],
        [
            [row[0], *row[3:9], "100", f"{row[1]}_{row[2]}_{'xyz'[i]} [mm]", row[10 + i]]
            for i in range(3)
            for row in WHOLE
        ],
    ),
    "pandas, an index before pairs": table(
        ["", "pose", "marker", "state", *QUANTITIES], [[str(k), *row] for k, row in enumerate(WHOLE)]
    ),
}


def in_names(between, loads):
    """One row per pose, state and target; its name has three parts."""
    return [
        [between.join((NAMES[k], f"P{m + 1}", loads[n])), *numbers(X[k, m] + n * DOWN), *numbers(Q[k])]
        for k in range(N)
        for n in (0, 1)
        for m in range(3)
    ]


def exchanged(header, rows):
    """A column per point."""
    first, *others = zip(header, *rows, strict=True)
    return table(first, others)


PAIRED |= {
    "names with a mass in tonnes": table(["Name", *MM, *DEG], in_names("_", ("0t", "0.1t"))),
    "SpatialAnalyzer, state and pose in the group": table(
        ["Collection", "Group", "Target", *MM, *DEG],
        [
            ["Cell", f"POSE_{k + 1:02}_{('UNLOADED', 'LOADED')[n]}", f"P{m + 1}", *row[1:]]
            for (k, n, m), row in zip(np.ndindex(N, 2, 3), in_names("_", ("0", "1")), strict=True)
        ],
    ),
    "SpatialAnalyzer, names of three parts": table(
        ["Point Name", *MM, *DEG],
        [
            [f"Cell::POSE_{k + 1:02}_{('UNLOADED', 'LOADED')[n]}::P{m + 1}", *row[1:]]
            for (k, n, m), row in zip(np.ndindex(N, 2, 3), in_names("_", ("0", "1")), strict=True)
        ],
    ),
    "names with a mass in kg": table(["Name", *MM, *DEG], in_names("-", ("0", "100.0kg"))),
    "a column per point, without a heading": exchanged(["", *MM, *DEG], in_names("_", ("0t", "0.1t"))),
}


@pytest.mark.parametrize("name", PAIRED)
def test_pairs_are_read_to_the_last_digit(name, tmp_path):
    (file := tmp_path / "export.csv").write_text(PAIRED[name])
    fits(pairs(file))


EASTERN = {
    "cp949": ("자세", "목표점", "하중 [kg]", "관절{}"),
    "cp1251": ("Поза", "Мишень", "Нагрузка [kg]", "Ось{}"),
    "cp932": ("姿勢", "測定点", "荷重 [kg]", "関節{}"),
    "gb18030": ("姿态", "测点", "负载 [kg]", "关节{}"),
}


@pytest.mark.parametrize("encoding", EASTERN)
def test_an_encoding_is_found_by_the_words_of_the_header(encoding, tmp_path):
    pose, target, load, joint = EASTERN[encoding]
    rows = [row[:2] + row[9:10] + row[3:9] + row[10:] for row in WHOLE]
    rows = [[*row[:2], "0" if n % 6 < 3 else "100", *row[3:]] for n, row in enumerate(rows)]
    text = table([pose, target, load, *six(joint), *MM], rows)
    (file := tmp_path / "export.csv").write_bytes(text.encode(encoding))
    fits(pairs(file))


def test_joints_of_two_robots_are_said_as_a_guess(tmp_path):
    rows = [[NAMES[k], *numbers(Q[k]), *numbers(Q[k] / 2), *numbers(X[k, 0])] for k in range(N)]
    header = ["Point", *six("R1_J{} [deg]"), *six("R2_J{} [deg]"), *MM]
    _, entries = read("", tmp_path, table(header, rows))
    said = {own.key: (own.value, own.why) for own in entries}
    assert said["joint_1"] == ("R1_J1 [deg]", "'R2_J1 [deg]' is not read")


def test_what_x_and_dx_are_is_said_as_a_guess(tmp_path):
    (file := tmp_path / "export.csv").write_text(PAIRED["X and dX, every row loaded"])
    said = {own.key: own.why for own in propose(file, ARM, None, tmp_path).entries}
    assert said["before_x"] == "every row is loaded: X is taken as unloaded, and dX as loaded minus unloaded"


def test_after_beside_loaded_is_refused_as_it_may_be_unloaded_again(tmp_path):
    rows = [
        [NAMES[k], f"P{m + 1}", state, *numbers(Q[k]), *numbers(X[k, m] + loaded * DOWN)]
        for k in range(N)
        for state, loaded in (("before", 0), ("loaded", 1), ("after", 0))
        for m in range(3)
    ]
    (file := tmp_path / "export.csv").write_text(table(["Pose", "Target", "State", *DEG, *MM], rows))
    with pytest.raises(
        InputError, match="State: expected one word for loaded rows, got 'after' and 'loaded'"
    ):
        pairs(file)


def test_our_own_names_beside_dx_ask_for_a_map(tmp_path):
    text = both("{}_mm", "d{}_mm", moved=True, load=("mass_kg", "100"))
    text = text.replace("Target", "marker").replace("A", "joint_").replace(" [deg]", "_deg")
    (file := tmp_path / "export.csv").write_text(text)
    with pytest.raises(InputError, match="if dx, dy, dz are loaded minus unloaded positions, state it in"):
        read_export(file, ARM)


def test_the_unit_of_positions_is_not_guessed_from_deflections(tmp_path):
    """The median of places and deflections together looks like metres or micrometres."""
    text = both("{}", "d{}", moved=True).replace("Load [kg]", "mass_kg")
    (file := tmp_path / "export.csv").write_text(text)
    assert {"before_x_mm", "deflection_x_mm"} <= {
        own.key for own in propose(file, ARM, None, tmp_path).entries
    }


# --- A plan to which readings were added --------------------------------------------------------------------

PLANNED = [*six("joint_{}_rad"), *six("joint_{}_deg"), "load_kg"]
READ_BESIDE = [f"P{m}_{when}_{x}_mm" for m in (1, 2, 3) for when in ("before", "after") for x in "xyz"]
FORCES = ["force_x_N", "force_y_N", "force_z_N"]


def planned(degrees=Q, loads=("100",) * N, forces=("", "", "")):
    """One row per run, as plan.csv: every joint twice, the load, the forecast; then readings and forces."""
    rows = [
        [
            *(str(k + 1), *numbers(RAD[k], 9), *numbers(degrees[k], 4), loads[k], "5.9154", "0.00", "start"),
            *numbers([[X[k, m], X[k, m] + DOWN] for m in range(3)]),
            *(forces if not loads[k] else ("", "", "")),
        ]
        for k in range(N)
    ]
    header = ["run", *PLANNED, "expected_deflection_mm", "travel_deg", "way", *READ_BESIDE, *FORCES]
    return table(header, rows)


def read_plan(text, tmp_path):
    (file := tmp_path / "plan.csv").write_text(text)
    return read_export(file, ARM)


def test_readings_that_were_added_to_a_plan_are_read_to_the_last_digit(tmp_path):
    fits(read_plan(planned(), tmp_path).data)


def test_a_joint_that_a_plan_gives_in_two_units_must_agree(tmp_path):
    edited = Q.copy()
    edited[4, 1] += 0.5
    with pytest.raises(InputError) as refused:
        read_plan(planned(edited), tmp_path)
    got = f"got {Q[4, 1]:.4f} and {edited[4, 1]:.4f} deg"
    place = "line 6, columns joint_2_rad and joint_2_deg"
    assert f"{place}: expected the same joint in both units, {got}" in str(refused.value)


def test_each_run_of_a_plan_has_a_mass_or_a_force(tmp_path):
    loads = ["" if k == 3 else "100" for k in range(N)]
    export = read_plan(planned(loads=loads, forces=("30", "0", "-50")), tmp_path)
    np.testing.assert_allclose(export.data.wrench[3, :3], [30, 0, -50])
    np.testing.assert_allclose(export.data.wrench[4, :3], [0, 0, -WEIGHT])
    text = planned(loads=loads, forces=("30", "0", "-50"))
    line = text.splitlines()[4]
    both = text.replace(line, line.replace(",,5.9154", ",100,5.9154"))
    with pytest.raises(
        InputError, match="line 5, column load_kg: expected a mass or a force, got 100 kg and"
    ):
        read_plan(both, tmp_path)
    with pytest.raises(InputError, match="line 5, column load_kg: expected a finite number in a loaded row"):
        read_plan(planned(loads=loads), tmp_path)


@pytest.mark.parametrize(("load", "warns"), [("1000", True), ("100", False)])
def test_a_load_that_only_one_pose_has_raises_a_warning(load, warns, tmp_path):
    export = read_plan(planned(loads=[load if k == 6 else "100" for k in range(N)]), tmp_path)
    said = "warning: only pose 7 (line 8) has a load of 1000 kg; all other poses have 100 kg: a typo?"
    assert (said in export.notes) is warns


def test_several_loads_in_many_poses_raise_no_warning(tmp_path):
    export = read_plan(planned(loads=[("100", "200", "300")[k % 3] for k in range(N)]), tmp_path)
    assert not [note for note in export.notes if note.startswith("warning: only")]


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

RISE = np.round(np.random.default_rng(53).uniform(-3, 3, (N, 3)), 4)  #: Travels along +Z [mm].
WIDE = [f"P{m} +Z" for m in (1, 2, 3)]


def rows_of_states(name, reading, beside=(), cells=()):
    """One row per pose, state and target, with the reading of a gauge."""
    rows = [
        [NAMES[k], f"P{m + 1}", *numbers(Q[k]), str(100 * loaded), *numbers(reading(k, m, loaded), 4), *cells]
        for k in range(N)
        for loaded in (0, 1)
        for m in range(3)
    ]
    return table(["Pose", "Target", *DEG, "Load [kg]", name, *beside], rows)


def wide(names, cells, loads=("100",)):
    """One row per pose and load; gauges side by side."""
    rows = [
        [NAMES[k], *numbers(Q[k]), load, *numbers(cells(k, n), 4)]
        for k in range(N)
        for n, load in enumerate(loads)
    ]
    return table(["Pose", *DEG, "Load [kg]", *names], rows)


def up(k, m, loaded):
    return 5 + loaded * RISE[k, m]


GAUGES = {
    "a row per state, a letter": rows_of_states("Gauge [mm]", up, ["Direction"], ["+Z"]),
    "a row per state, downwards": rows_of_states(
        "Dial gauge reading [mm]", lambda k, m, loaded: 5 - loaded * RISE[k, m], ["Direction"], ["-Z"]
    ),
    "a row per state, a vector": rows_of_states(
        "Dial gauge reading [mm]", up, ["dir_x", "dir_y", "dir_z"], ["0", "0", "2"]
    ),
    "a row per state, the direction in the name": rows_of_states("Gauge Z+ [mm]", up),
    "wide, both states": wide(
        [f"P{m} Z {when} [mm]" for m in (1, 2, 3) for when in ("before", "after")],
        lambda k, _: [up(k, m, loaded) for m in range(3) for loaded in (0, 1)],
    ),
    "wide, a row per state": wide(
        [f"Gauge {name} [mm]" for name in WIDE], lambda k, n: 5 + n * RISE[k], ("0", "100")
    ),
    "wide, at zero unloaded, in um": wide(
        [f"Gauge P{m} -Z [um]" for m in (1, 2, 3)], lambda k, _: -1000 * RISE[k]
    ),
}


@pytest.mark.parametrize("name", GAUGES)
def test_gauges_are_read_to_the_last_digit(name, tmp_path):
    (file := tmp_path / "gauges.csv").write_text(GAUGES[name])
    found = pairs(file)
    assert found.is_line_reading.all()
    order = [found.markers.index(marker) for marker in ("P1", "P2", "P3")]
    rise = np.einsum("rmi,rmi->rm", found.deflection, found.line_direction)[:, order]
    signs = found.line_direction[:, order, 2]
    np.testing.assert_allclose(np.abs(signs), 1, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rise * signs, 1e-3 * RISE, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.q, RAD, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.wrench[:, 2], -WEIGHT, rtol=0, atol=1e-9)


def test_positions_whose_axis_is_called_direction_are_no_gauges(tmp_path):
    rows = [
        [NAMES[k], f"P{m + 1}", *numbers(Q[k]), "100", *numbers([X[k, m, i], X[k, m, i] + DOWN[i]]), "XYZ"[i]]
        for k in range(N)
        for m in range(3)
        for i in range(3)
    ]
    header = ["Pose", "Target", *DEG, "Load [kg]", "unloaded [mm]", "loaded [mm]", "Direction"]
    (file := tmp_path / "axes.csv").write_text(table(header, rows))
    with pytest.raises(InputError, match="got readings as large as positions, along x, y and z"):
        pairs(file)


def test_data_map_shows_the_runs_of_gauges(tmp_path):
    (file := tmp_path / "gauges.csv").write_text(GAUGES["wide, a row per state"])
    said = fine("data", "map", ARM.name, file)
    assert said.endswith(f"{N} runs")
    assert "travel" in said


def test_gauges_that_touch_one_target_in_turn_are_paired_each_with_itself(tmp_path):
    """All unloaded readings stand before all loaded ones."""
    rows = [
        [NAMES[k], "P1", *numbers(Q[k]), str(100 * loaded), *numbers(2 + n + loaded * (n + 1), 4), axis]
        for k in range(N)
        for loaded in (0, 1)
        for n, axis in enumerate(("+X", "+Y", "+Z"))
    ]
    header = ["Pose", "Target", *DEG, "Load [kg]", "Gauge [mm]", "Direction"]
    (file := tmp_path / "gauges.csv").write_text(table(header, rows))
    found = pairs(file)
    assert found.n_runs == 3 * N
    moved = found.deflection[:, 0]
    np.testing.assert_allclose(moved, 1e-3 * found.line_direction[:, 0] * [1, 2, 3], rtol=0, atol=1e-12)
    rows[0][-1] = "-X"
    file.write_text(table(header, rows))
    with pytest.raises(InputError, match="expected an unloaded reading in pose 1"):
        pairs(file)


# --- Files that do not say what they hold -------------------------------------------------------------------

REFUSED = {
    "spherical": (
        table(["Point", "Hz [deg]", "V [deg]", "D [mm]", *DEG], [["p1", *numbers(Q[0][:3]), *numbers(Q[0])]]),
        None,
        r"export.csv: line 1: no column looks like a position; .*; angles and a distance are no coordinates",
    ),
    "short tons or metric ones": (weighs("ton", 0.1), None, "expected a unit of mass or force, got 'ton'"),
    "a table of two states, one unknown": (
        both("{}0 [mm]", "{}L [mm]"),
        None,
        "expected X0 and X1, or X0 and dX, beside the column that names the targets, got X0; say which",
    ),
    "numbers of states, or of targets": (
        both("{}1 [mm]", "{}2 [mm]"),
        None,
        "beside the column that names the targets, got X1, X2; say which are unloaded and loaded",
    ),
    "one number of each target": (
        beside(place=["P1 [mm]", "P2 [mm]", "P3 [mm]"]),
        None,
        "no column looks like a position",
    ),
    "two weights side by side": (
        by_state(lambda loaded: [str(40 * loaded), str(60 * loaded)], ("Load 1 [kg]", "Load 2 [kg]")),
        None,
        r"got '40' in 'Load 1 \[kg\]' \(40 kg\) and '60' in 'Load 2 \[kg\]' \(60 kg\); say in",
    ),
    "a payload beside another weight": (
        by_state(lambda loaded: [str(100 * loaded), str(1500 * loaded)], ("Payload [kg]", "Weight [N]")),
        None,
        r"line 5: expected the same load in both, got '100' .* \(100 kg\) and '1500' .* \(152\.9 kg\)",
    ),
    "loads of which one has no unit": (
        by_state(lambda loaded: [str(100 * loaded), str(981 * loaded)], ("Payload [kg]", "Load")),
        None,
        r"expected one column of loads, got 'Payload \[kg\]' and 'Load'; say in",
    ),
    "suffixes of nobody knows what": (both("{}_u", "{}_l"), None, "no column looks like a position"),
    "degrees, minutes and seconds": (
        table(["Point", *six("J{}"), *MM], [[NAMES[0], *["88°56'00.7"] * 6, "1", "2", "3"]]),
        None,
        "column J1: expected a finite number",
    ),
    "a minus behind the number": (
        beside().replace("-", "").replace(",", "-,"),
        None,
        "no column looks like|expected a finite number",
    ),
    "a header of blanks over rows of tabs": (
        table(["Frame", "Tool X", "Tool Y", "Tool Z", *DEG], [["1", "4", "2", "3", *"123456"]] * 3, "\t"),
        None,
        r"no column looks like a position; columns are Frame, Tool X",
    ),
    "no header": (
        "".join(";".join([*numbers(Q[k]), "0.5", *numbers(X[k, 0])]) + "\n" for k in range(N)),
        None,
        "line 1: expected a line with the names of the columns, got .* add a line of names above the table",
    ),
    "no header, known cells": (
        "".join(";".join([NAMES[k], "ok", *numbers(X[k, 0]), "-", *numbers(Q[k])]) + "\n" for k in range(N)),
        None,
        "export.csv: no header: no column looks like joint_1; columns are Group, Point",
    ),
    "FANUC, current positions": (
        points(),
        "".join(
            f"{NAMES[k]}\nCURRENT JOINT POSITION:\n"
            + "".join(f" Joint  {j + 1}: {x}\n" for j, x in enumerate(numbers(Q[k])))
            for k in range(N)
        ),
        "robot.dat: expected a table with columns of the joints, got no table; save a table with a row for",
    ),
    "a list written by hand": (
        points(),
        "".join(f"{NAMES[k]} = [{', '.join(numbers(Q[k]))}]\n" for k in range(N)),
        "robot.dat: expected columns of the joints, such as A1 to A6",
    ),
    "Kawasaki program": (
        points(),
        ".JOINTS\n#p1 1 2 3 4 5 6\n.END\n",
        r"robot.dat: expected columns of the joints, such as A1 to A6, got columns .JOINTS",
    ),
    "YAML": (
        points(),
        "poses:\n" + "".join(f"  - joints: [{', '.join(numbers(Q[k]))}]\n" for k in range(N)),
        "robot.dat: expected columns of the joints",
    ),
    "Calypso, characteristics": (
        "planid\tid\tidsymbol\tactual\tnominal\tuppertol\nA\tP1_X\t\t1.5\t1\t0.1\n",
        None,
        "each row is one characteristic of a Calypso plan: export the points",
    ),
    "PC-DMIS, a report": (
        "PART NAME  : ROBOT\n\nDIM LOC1= LOCATION OF POINT PNT1  UNITS=MM\n"
        + "AX    NOMINAL     MEAS      +TOL     -TOL      DEV    OUTTOL\n"
        + "".join(
            f"{x}     1{x2}.000   100.012     0.100    -0.100     0.012     0.000\n" for x, x2 in ("X1", "Y2")
        ),
        None,
        "a report of PC-DMIS is no table: export the points",
    ),
    "a value that stands twice": (
        table(["Point", "variable", "value"], [*TIDY_POINTS, TIDY_POINTS[0]]),
        None,
        r"column variable: expected every quantity once per point, got 'A1 \[deg\]' again",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_that_does_not_say_what_it_holds_is_refused(name, tmp_path):
    content, other, said = REFUSED[name]
    with pytest.raises(InputError, match=said):
        read(name, tmp_path, content, other)


def test_a_row_number_without_quotes_does_not_shift_the_columns(tmp_path):
    """R quotes it; a row with one more cell than the header is refused otherwise."""
    text = table(["Point", *DEG, *MM], [[str(k), *row] for k, row in enumerate(LISTS)])
    with pytest.raises(InputError, match="line 2: expected 10 fields, got 11"):
        read("", tmp_path, text)


def test_a_map_says_which_columns_hold_names_and_values(tmp_path):
    (file := tmp_path / "tidy.csv").write_text(table(["Point", "variable", "value"], TIDY_POINTS))
    found = read_table(file, bool, FileLayout(tidy=["variable", "value"]))
    assert found.names == ("Point", *DEG, *MM)
    np.testing.assert_array_equal(found.numbers(1), Q[:, 0])
    (map_ := tmp_path / "tidy.toml").write_text('[file]\ntidy = ["variable"]\n')
    with pytest.raises(InputError, match=r'expected tidy = \["name", "value"\]'):
        read_series(file, ARM, map_)
    map_.write_text('[file]\ntidy = ["variable", "number"]\n')
    with pytest.raises(InputError, match="no column 'number'; columns are"):
        read_series(file, ARM, map_)
