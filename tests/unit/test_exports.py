"""Exports as instruments, spreadsheets and robots write them, each read with a map of at most ten lines."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from refused import refused

from testbench.arm.folder import load_arm
from testbench.data.dataset import Dataset, select_rows, select_runs
from testbench.errors import InputError
from testbench.files.names import our_names, recognise
from testbench.files.read_pairs import read_export

ROOT = Path(__file__).parents[2]
ARM = load_arm(ROOT / "models" / "kr500_l480")
MASSES = (150.0, 460.3)
M = range(3)
WHEN, RUNS = ("before", "after"), range(6)


def measured() -> Dataset:
    """Three poses, two hung masses in each, three markers; one unloaded reading a pose, to 0.1 um."""
    rng = np.random.default_rng(7)
    q = np.deg2rad(rng.uniform(*np.rad2deg(0.9 * ARM.limits), (3, 6)).round(3))
    before = rng.uniform(-2.5, 2.5, (3, 3, 3)).round(7)
    sag = rng.uniform(-9e-3, 9e-3, (3, 3, 3)).round(7)
    wrench = np.zeros((6, 6))
    wrench[:, 2] = -9.81 * np.tile(MASSES, 3)
    pose = np.repeat([0, 1, 2], 2)
    return Dataset(
        markers=ARM.markers,
        run_id=np.arange(6) + 1,
        pose_id=pose + 1,
        q=q[pose],
        wrench=wrench,
        point=np.tile([0.35, 0.14, -0.08], (6, 1)),
        before=before[pose],
        after=(before[pose] + sag[pose] * np.tile(MASSES, 3)[:, None, None] / 460.3).round(7),
        sigma=50e-6,
    )


DATA = measured()
DEG = np.rad2deg(DATA.q)
KG = DATA.wrench[:, 2] / -9.81


def number(value: float, scale: float = 1.0, decimal: str = ".") -> str:
    return f"{scale * value:.7f}".replace(".", decimal)


def deg(r, decimal="."):
    return [number(x, 1, decimal) for x in DEG[r]]


def mm(places, decimal="."):
    return [number(x, 1e3, decimal) for x in np.ravel(places)]


def both(r):
    """Each marker unloaded, then loaded, (3, 2, 3) [m]."""
    return np.stack([DATA.before[r], DATA.after[r]], axis=1)


def readings():
    """Run, state and places: the unloaded one with the first load of its pose, then the loaded one."""
    return [(r, when, getattr(DATA, when)[r]) for r in RUNS for when in WHEN[r % 2 :]]


def table(lines, between):
    return "\n".join(between.join(map(str, line)) for line in lines).encode()


def two_headers() -> bytes:
    """Tabs, a header of two lines with merged cells, units below, pounds, differences, a joint backwards."""
    states = [f"P{m + 1} {what}" for m in M for what in ("Unloaded", "deflection")]
    upper = ["Run", "Pose", "Joints", *[""] * 5, "Load", *(cell for s in states for cell in (s, "", ""))]
    lower = ["", "", *range(1, 7), "m", *"XYZ" * 6]
    units = ["", "", *["deg"] * 6, "lb", *["mm"] * 18]
    rows = []
    for r in RUNS:
        first, second, *others = deg(r)
        angles, pounds = [first, number(-float(second)), *others], f"{KG[r] / 0.45359237:.9f}"
        moved = mm(np.stack([DATA.before[r], DATA.deflection[r]], axis=1))
        rows.append([r + 1, DATA.pose_id[r], *angles, pounds, *moved])
    return b"\xef\xbb\xbf" + table([upper, lower, units, *rows], "\t")


TWO_HEADERS = """
[file]
header = 2
[columns]
"joint_{n}" = "Joints {n}"
joint_2 = "-Joints 2"
mass = "Load m"
"""


def inches() -> bytes:
    """Wide by marker, long by state, in inches; forces pressed, positive downwards, in kilonewtons."""
    head = ['"Shot"', '"Config"', '"Condition"', '"Push (kN)"', *(f'"J{k} (deg)"' for k in range(1, 7))]
    lines = [[*head, *(f'"{x} P{m + 1} (in)"' for m in M for x in "XYZ")]]
    for r, when, places in readings():
        state, force = ("free", "") if when == "before" else ("pushed", f"{9.81e-3 * KG[r]:.9f}")
        where = [f"{x / 0.0254:.9f}" for x in places.reshape(-1)]
        lines.append([len(lines), f"C-{DATA.pose_id[r]}", state, force, *deg(r), *where])
    return table(lines, ",")


INCHES = """
[columns]
run = "Shot"
pose = "Config"
state = "Condition"
force_z_kN = "-Push"
"joint_{n}_deg" = "J{n}"
"{marker}_{axis}_in" = "{axis} {marker}"
[words]
before = "free"\nafter = "pushed"
"""


def merged() -> bytes:
    """A spreadsheet whose cells were merged: what holds for a run stands in its first row alone."""
    head = ["run", "pose", *(f"joint_{k}_deg" for k in range(1, 7)), "mass_kg", "marker"]
    lines = [[*head, *(f"{when} {x} (mm)" for when in WHEN for x in "xyz")]]
    for r in RUNS:
        first = [r + 1, DATA.pose_id[r], *deg(r, ","), number(KG[r], 1, ",")]
        lines += [[*(first if m == 0 else [""] * 9), f"P{m + 1}", *mm(both(r)[m], ",")] for m in M]
    return table(lines, ";")


MERGED = """
file = { merged = true }
"""


def plain() -> bytes:
    """Our own names, as short as they may be: no run, no pose, no state, no point, no sigma."""
    lines = [[*(f"joint_{k}_deg" for k in range(1, 7)), "Mass [KG]", "Marker", "x_mm", "y_mm", "z_mm"]]
    for r, when, places in readings():
        kg = number(KG[r] if when == "after" else 0.0)
        lines += [[*deg(r), kg, f"p{m + 1}", *mm(places[m])] for m in M]
    return table(lines, ",")


def names_of_points() -> bytes:
    """One column of names holds pose, load and point; a line below the table."""
    lines = [["sep=,"], ["Name", "X [m]", "Y [m]", "Z [m]", *(f"J{k}" for k in range(1, 7))]]
    for r, when, places in readings():
        load = f"{KG[r]:.1f}kg" if when == "after" else "free"
        group = f"Cell::P{DATA.pose_id[r]:02d}_{load}"
        lines += [[f"{group}::T{m + 1}", *(number(x) for x in places[m]), *deg(r)] for m in M]
    return table([*lines, ["36 points"]], ",")


NAMES_OF_POINTS = """
words = { P1 = "T1", P2 = "T2", P3 = "T3", before = "free" }
file = { footer = 1 }
[columns]
"{axis}" = "{axis}"
"joint_{n}_deg" = "J{n}"
[cells]
Name = ["*::P{pose}_{mass_kg}kg::{marker}", "*::P{pose}_{when}::{marker}"]
"""


def rows_of_axes() -> bytes:
    """A report of inspection software: a row a point and axis, both readings of one name."""
    head = ["Feature", "Axis", "Value", "Value", "Deviation [mm]", "Shot", "Pose", "Load"]
    lines = [["Report 7"], [*head, *(f"A{k}" for k in range(1, 7))]]
    for r in RUNS:
        for m in M:
            shared = [r + 1, DATA.pose_id[r], number(KG[r]), *deg(r)]
            lines += [[f"P{m + 1}", "XYZ"[k], *mm(both(r)[m][:, k]), "0.1", *shared] for k in (2, 0, 1)]
            lines.append([f"P{m + 1}", "D", "38.1", "38.1", "0", *shared])
    return table(lines, "\t")


ROWS_OF_AXES = """
words = { ignore = "D" }
[columns]
run = "Shot"
marker = "Feature"
before_mm = "Value"
after_mm = "Value (2)"
mass_kg = "Load"
"joint_{n}_deg" = "A{n}"
"""


EXPORTS = {
    "two_headers": (two_headers, TWO_HEADERS),
    "inches": (inches, INCHES),
    "merged": (merged, MERGED),
    "plain": (plain, ""),
    "names_of_points": (names_of_points, NAMES_OF_POINTS),
    "rows_of_axes": (rows_of_axes, ROWS_OF_AXES),
}


MAPS = ROOT / "docs" / "maps"
DOCUMENTED = {"spreadsheet": ((MAPS / "spreadsheet.csv").read_bytes, (MAPS / "spreadsheet.toml").read_text())}
ENCODING = dict.fromkeys(EXPORTS, "utf-8") | {"spreadsheet": "cp1252"}


def lines_of(name):
    return (EXPORTS | DOCUMENTED)[name][0]().decode(ENCODING[name]).splitlines()


def files(folder, name, lines=None, text=None):
    """An export, perhaps with other lines, and its map: as `read_export` takes them."""
    make, known = (EXPORTS | DOCUMENTED)[name]
    content = make() if lines is None else "\n".join(lines).encode(ENCODING[name])
    (folder / "export.csv").write_bytes(content)
    text = known if text is None else text
    (folder / "map.toml").write_text(text, encoding="utf-8")
    return folder / "export.csv", ARM, folder / "map.toml" if text else None


def read(*args):
    return read_export(*files(*args))


def check_alike(read: Dataset, data: Dataset = DATA) -> None:
    assert read.markers == data.markers
    np.testing.assert_array_equal(read.pose_id, data.pose_id)
    for name in ("q", "before", "after", "point"):
        np.testing.assert_allclose(getattr(read, name), getattr(data, name), rtol=0, atol=2e-9, err_msg=name)
    np.testing.assert_allclose(read.wrench, data.wrench, rtol=0, atol=1e-6)
    assert read.sigma == data.sigma


@pytest.mark.parametrize("name", EXPORTS)
def test_an_export_is_read_with_a_map_of_at_most_ten_lines(tmp_path, name):
    own = files(tmp_path, name)
    assert EXPORTS[name][1].strip().count("\n") < 10
    found = read_export(*own)
    check_alike(found.data)
    assert any("sigma 50 um is assumed" in note for note in found.notes)


def exchanged(old, new):
    return lambda lines: [line.replace(old, new) for line in lines]


def parts_of_cells(lines):
    said = [re.sub(r",([0-9.]+),p", r",loaded \1 kg,p", line) for line in lines]
    said = [line.replace("loaded 0.0000000 kg", "nominal/unloaded") for line in said]
    return [said[0].replace("Mass [KG]", "state"), *said[1:]]


def aligned(lines):
    """A report in columns, whose names hold blanks where two stand between cells."""
    named = [line.replace("_mm", " (mm)").replace("_deg", " [deg]").split(",") for line in lines]
    return ["Report of a day", "", *("".join(f"  {cell:>16}" for cell in line) for line in named)]


def header_again(lines):
    head = [lines[0].replace("_mm", ""), f"{',' * 8}mm,mm,mm"]
    return [*head, *lines[1:10], *head, *lines[10:]]


def poses_as_runs(lines):
    return [f"Run,{lines[0]}", *(f"{(k // 9) + 5},{line}" for k, line in enumerate(lines[1:]))]


def moved_a_little(lines):
    cells = lines[1].split(",")
    cells[4] = number(float(cells[4]) + 0.005)
    return [lines[0], ",".join(cells), *lines[2:]]


def from_zero(lines):
    return [re.sub(r'"J(\d) ', lambda m: f'"J{int(m[1]) - 1} ', line) for line in lines]


NAMED = NAMES_OF_POINTS.replace("file = { footer = 1 }", "") + "[file]\nfooter = 1\nnames = {}\n".format(
    ["Name", "X [m]", "Y [m]", "Z [m]", "J1", "J2", "J3", "J4", "J5", "J6"]
)
SAME = {
    "names in a comment": ("plain", lambda lines: [f"# {lines[0]}", *lines], ""),
    "a comment as header": ("plain", lambda lines: [f"# {lines[0]}", *lines[1:]], ""),
    "words for loads": (
        "merged",
        exchanged(";150,0000000;", ";light;"),
        f'words = {{ 150 = "light" }}{MERGED}',
    ),
    **{
        f"no header, {gap!r}": (
            "names_of_points",
            lambda lines, gap=gap: exchanged(",", gap)(lines[2:]),
            NAMED,
        )
        for gap in (", ", " ")
    },
    "parts of a cell": ("plain", parts_of_cells, 'cells.state = ["*/{when}", "{when} {mass_kg} kg"]'),
    "whole names": ("plain", list, 'columns = { "{axis}" = "{axis}_mm", "joint_{n}" = "joint_{n}_deg" }'),
    "joints from 0": ("inches", from_zero, INCHES.replace("{n}", "{n0}")),
    "aligned": ("plain", aligned, "", "cells separated by runs of two or more blanks, header in line 3"),
    "the header again": ("plain", header_again, "", "2 lines of comments or the header again left out"),
    "poses as runs": ("plain", poses_as_runs, "", "runs are numbered in file order, one per load: 6"),
    "moved": ("inches", moved_a_little, INCHES, "joints differ by up to 8.7e-05 rad or m between unloaded"),
}
"""Other ways to write an export: which one, its lines otherwise, the map, what is said."""


@pytest.mark.parametrize("way", SAME)
def test_an_export_may_be_written_otherwise(tmp_path, way):
    name, change, text, *said = SAME[way]
    found = read(tmp_path, name, change(lines_of(name)), text)
    check_alike(found.data)
    notes = "; ".join((*found.notes, *found.columns.table.notes))
    assert all(words in notes for words in said)


BY_LOAD = """
columns = {{ pose = "Pose", "joint_{{n}}_deg" = "A{{n}}", "{{marker}}_{{axis}}_mm" = {} }}
words = {{ 0 = "empty" }}
"""


def columns_by_load() -> bytes:
    """A row per pose, and a column for every target, axis and load."""
    loads = ["empty", *map(number, MASSES)]
    lines = [["Pose", *(f"A{k}" for k in range(1, 7))]]
    lines[0] += [f"P{m + 1} {x} {load} kg" for m in M for x in "XYZ" for load in loads]
    for r in (0, 2, 4):
        places = np.stack([DATA.before[r], DATA.after[r], DATA.after[r + 1]], axis=2)
        lines.append([DATA.pose_id[r], *deg(r), *mm(places)])
    return table(lines, ",")


@pytest.mark.parametrize(
    "name",
    ['"{marker} {axis} {mass_kg} kg"', '["{marker} at {axis} {mass_kg}", "{marker} {axis} {mass_kg} kg"]'],
)
def test_names_of_columns_may_hold_a_target_an_axis_and_a_load(tmp_path, name):
    export, names = tmp_path / "export.csv", tmp_path / "map.toml"
    export.write_bytes(columns_by_load())
    names.write_text(BY_LOAD.format(name))
    found = read_export(export, ARM, names, None).data
    order = np.argsort(found.pose_id, kind="stable")  # the rows of a load stand together
    check_alike(select_rows(found, order))


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        (
            '"{marker} {axis} {mass_kg} {mass_kg}"',
            "expected each placeholder of a load, a target or a direction once",
        ),
        ('"{marker} {axis} {mass_kg} tonnes"', "expected columns 'P1 x {mass_kg} tonnes' of several loads"),
    ],
)
def test_a_name_of_columns_by_load_that_fits_none_is_refused(tmp_path, name, problem):
    export, names = tmp_path / "export.csv", tmp_path / "map.toml"
    export.write_bytes(columns_by_load())
    names.write_text(BY_LOAD.format(name))
    with pytest.raises(InputError, match=re.escape(problem)):
        read_export(export, ARM, names, None)


def test_a_lost_target_needs_no_covariances(tmp_path):
    """Blank cells in a row, or no row in one of the states."""
    text = lines_of("plain")
    assert text[8].split(",")[7] == "p2"
    text[8] = ",".join([*text[8].split(",")[:8], "", "", ""])
    del text[3]  # the unloaded reading of P3 in the first pose, which serves both loads
    found = read(tmp_path, "plain", text).data
    expected = np.ones((6, 3), bool)
    expected[[0, 1, 1], [2, 1, 2]] = False
    np.testing.assert_array_equal(found.is_measured, expected)
    np.testing.assert_allclose(found.precision[0, 0], np.eye(3) / (2 * (50e-6) ** 2))
    check_alike(
        replace(select_runs(found, expected.all(axis=1)), precision=None), select_runs(DATA, DATA.pose_id > 1)
    )


@pytest.mark.parametrize(
    ("name", "change", "line"),
    [
        ("names_of_points", list, '"joint_{n}_deg" = "J{n}"'),
        ("inches", from_zero, '"joint_{n0}_deg" = "J{n0}"'),
    ],
)
def test_a_line_for_numbered_joints_is_offered(tmp_path, name, change, line):
    text = "\n".join(line for line in EXPORTS[name][1].splitlines() if "joint" not in line)
    with pytest.raises(InputError, match=re.escape(f"are they joints? [columns] of a map: {line}")):
        read(tmp_path, name, change(lines_of(name)), text)


@pytest.mark.parametrize(
    ("divided", "decimal"), [(",", "."), ("'", "."), (" ", "."), (".", ","), ("\u202f", ",")]
)
def test_thousands_may_be_divided_where_a_decimal_mark_follows(tmp_path, divided, decimal):
    lines = [line.replace(",", ".") for line in lines_of("merged")]
    for k, line in enumerate(lines[1:], start=1):
        cells = line.split(";")
        lines[k] = ";".join([*cells[:-6], *(f"{float(cell):,.4f}" for cell in cells[-6:])])
    text = "\n".join(lines).translate(str.maketrans({",": divided, ".": decimal}))
    assert re.search(rf";-1{divided}[0-9]{{3}}[{decimal}]", text)
    check_alike(read(tmp_path, "merged", text.splitlines()).data)
    alone = re.sub(rf"(;-1{divided}[0-9]{{3}})[{decimal}][0-9]+", r"\1", text)
    with pytest.raises(InputError, match=r"column .* \(mm\): expected a finite number, got .-1"):
        read(tmp_path, "merged", alone.splitlines())


def test_a_map_may_name_some_columns_and_leave_the_others_to_our_names(tmp_path):
    """Parts of our names stand in any order; of two that say the same the map's is read."""
    content = merged().decode().replace("before x", "x unloaded").replace("after z", "Z unter Last")
    content = content.replace("marker", "after_z_mm;marker", 1).replace(";P", ";7,0;P")
    text = "file.merged = true\ncolumns.after_z = 'Z unter Last'"
    found = read(tmp_path, "merged", content.splitlines(), text)
    check_alike(found.data)
    assert found.columns.ignored == ("after_z_mm",)


@pytest.mark.parametrize(
    ("lost", "said"),
    [
        ("NaN", "expected a finite number, got 'NaN'"),
        ("9999.0000000", "expected a position, got '9999.0000000' three times"),
        ("0", "expected a position, got '0' three times"),
    ],
)
def test_words_stand_for_lost_targets_and_a_blank_mass_for_none(tmp_path, lost, said):
    """Also equal coordinates, which instruments write for a lost target."""
    text = lines_of("plain")
    text[4] = ",".join([*text[4].split(",")[:8], lost, lost, lost])
    text[1:4] = [line.replace(",0.0000000,", ",,") for line in text[1:4]]
    own = files(tmp_path, "plain", text, f'words.lost = ["{lost}", "---"]')
    assert np.argwhere(~read_export(*own).data.is_measured).tolist() == [[0, 0]]
    with pytest.raises(InputError, match=rf"line 5, column x_mm: {said}"):
        read_export(*own[:2])


def test_repeated_runs_are_told_apart_without_a_column_for_them(tmp_path):
    text = lines_of("plain")
    found = read(tmp_path, "plain", [*text, *text[1:]]).data
    assert found.n_runs == 12
    np.testing.assert_array_equal(found.after[:6], found.after[6:])
    with pytest.raises(
        InputError, match="this marker has more readings in its pose and load than the others"
    ):
        read(tmp_path, "plain", [*text, *text[1:-1]])


def test_of_several_unloaded_readings_the_last_one_before_counts(tmp_path):
    """The first pose again at the end: unloaded, 1 mm higher; loaded as before."""
    text = lines_of("plain")
    again = [line.split(",") for line in text[1:7]]
    for cells in again[:3]:
        cells[-1] = number(float(cells[-1]) + 1)
    found = read(tmp_path, "plain", [*text, *map(",".join, again)]).data
    assert found.pose_id.tolist() == [1, 1, 2, 2, 3, 3, 1]
    np.testing.assert_array_equal(found.before[:2], found.before[[0, 0]])
    np.testing.assert_allclose(found.before[6] - found.before[0], np.tile([0, 0, 1e-3], (3, 1)), atol=1e-12)


def test_the_sigma_of_file_or_map_counts_more_than_a_flag_and_that_is_said(tmp_path):
    own = files(tmp_path, "plain", text="values = { sigma_um = 30 }")
    assert read_export(*own).data.sigma == pytest.approx(30e-6)
    assert read_export(*own[:2], None, 20e-6).data.sigma == 20e-6
    both = read_export(*own, 20e-6)
    assert both.data.sigma == pytest.approx(30e-6)
    assert any("not the stated 20 um" in note for note in both.notes)
    assert not any("not the stated" in note for note in read_export(*own, 30e-6).notes)


BETWEEN = {"spreadsheet": ";", "merged": ";", "rows_of_axes": "\t"}
WRONG = [
    ("spreadsheet", 6, 3, "12.5", "line 6, column A2 [°]: expected a finite number, got '12.5'; the dec"),
    ("spreadsheet", 4, 2, "A7 [°]", "line 4: missing columns: joint_1_deg; not understood: A7"),
    (
        "spreadsheet",
        4,
        2,
        "A1 [mm]",
        "line 4, column A1 [mm]: expected a unit of angle, such as _rad, got mm",
    ),
    ("spreadsheet", 4, 10, "Ziel 1 x", "missing columns: P1_before_y_m"),
    ("spreadsheet", 7, 2, "", "line 7, column A1 [°]: expected a finite number, got ''; for merged cells"),
    ("spreadsheet", 7, 3, "90", "line 7, column A2 [°]: expected -130.0000 to 20.0000 deg, got 90"),
    ("names_of_points", 6, 0, "P1", "line 6, column Name: expected '*::P{pose}_{mass_kg}kg::{marker}'"),
    ("names_of_points", 6, 0, "C::P1_-2kg::T1", "expected a mass of at least 0 kg, got -2"),
    ("inches", 4, 2, "idle", "line 4, column Condition: no state 'idle' is known; states are"),
    ("inches", 4, 1, "C-9", "line 4: expected an unloaded reading in pose 9"),
    (
        "inches",
        3,
        4,
        "12.0",
        "line 3: expected the same joints as in the unloaded reading of line 2; one",
    ),
    ("inches", 3, 3, "", "line 3, column Push (kN): expected a finite number in a loaded row, got ''"),
    ("rows_of_axes", 4, 1, "Z", "line 3, column Axis: expected the rows x, y, z of a point together"),
    ("rows_of_axes", 8, 1, "R", "line 8, column Axis: no axis 'R'; axes are x, y, z"),
    ("rows_of_axes", 5, 0, "P2", "line 5, column Feature: expected 'P1' as in the other rows"),
    ("plain", 28, 10, "0\n36,points", "for a line after the table, write footer = 1"),
    ("plain", 1, 9, f"x{' ' * 9000}in", "line 1: expected one column for each quantity"),
]
"""An export, the line, counted from 1, and the column, from 0, of another cell, and what is said."""


@pytest.mark.parametrize(("name", "line", "column", "cell", "text"), WRONG)
def test_a_wrong_cell_is_named_by_line_and_column(tmp_path, name, line, column, cell, text):
    between, lines = BETWEEN.get(name, ","), lines_of(name)
    cells = lines[line - 1].split(between)
    lines[line - 1] = between.join([*cells[:column], cell, *cells[column + 1 :]])
    assert text in refused(read_export, *files(tmp_path, name, lines))


def test_every_name_of_the_documented_table_is_known():
    """The names and examples of all quantities of measured runs."""
    with (ROOT / "docs" / "tables" / "quantities.csv").open(encoding="utf-8", newline="") as file:
        _, *rows = csv.reader(file)
    assert len(rows) == 29
    known, seen = our_names(ARM), set()
    for what, names, _, example, _ in rows:
        for name in re.findall(r"`([^`]+)`", names) + re.findall(r"`([^`]+_[^`]*|[^`]+\[.*)`", example):
            found = recognise(name, known)
            assert found is not None, (what, name)
            seen.add(found[0].what)
    assert seen == {slot.what for slot in known.values()}
