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
FOLDER = Path(__file__).parent / "exports"
"""Exports of one campaign, each with its map if it needs one, and the readings that all of them hold."""
EXPORTS = sorted(
    file.stem for file in FOLDER.glob("*.csv") if file.stem not in ("readings", "columns_by_load")
)


def measured() -> Dataset:
    """Three poses, two hung masses in each, three markers; one unloaded reading a pose, to 0.1 um."""
    rows = np.genfromtxt(FOLDER / "readings.csv", delimiter=",", names=True)
    values = rows.view((float, len(rows.dtype.names)))
    places = 1e-3 * values[:, 9:].reshape(-1, 3, 2, 3)
    wrench = np.zeros((len(rows), 6))
    wrench[:, 2] = -9.81 * rows["mass_kg"]
    return Dataset(
        markers=ARM.markers,
        run_id=rows["run"].astype(int),
        pose_id=rows["pose"].astype(int),
        q=np.deg2rad(values[:, 2:8]),
        wrench=wrench,
        point=np.tile([0.35, 0.14, -0.08], (len(rows), 1)),
        before=places[:, :, 0],
        after=places[:, :, 1],
        sigma=50e-6,
    )


DATA = measured()


MAPS = ROOT / "docs" / "maps"
ENCODING = {"spreadsheet": "cp1252"}


def export_of(name):
    """An export and its map: a sample, or the documented spreadsheet; None without a map."""
    home = MAPS if name == "spreadsheet" else FOLDER
    return home / f"{name}.csv", known if (known := home / f"{name}.toml").exists() else None


def lines_of(name):
    return export_of(name)[0].read_text(ENCODING.get(name, "utf-8")).splitlines()


def files(folder, name, lines, text=None):
    """An export with other lines, and its map or another: as `read_export` takes them."""
    (folder / "export.csv").write_bytes("\n".join(lines).encode(ENCODING.get(name, "utf-8")))
    _, known = export_of(name)
    text = (known.read_text("utf-8") if known else "") if text is None else text
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


SAID = {
    "aligned": "cells separated by runs of two or more blanks, header in line 3",
    "the_header_again": "2 lines of comments or the header again left out",
    "poses_as_runs": "runs are numbered in file order, one per load: 6",
    "moved": "joints differ by up to 8.7e-05 rad or m between unloaded",
}
"""What is said of some exports, beside the noise that is assumed."""


@pytest.mark.parametrize("name", EXPORTS)
def test_an_export_is_read_with_a_map_of_at_most_ten_lines(name):
    export, mapping = export_of(name)
    assert mapping is None or mapping.read_text("utf-8").count("\n") <= 10
    found = read_export(export, ARM, mapping)
    check_alike(found.data)
    notes = "; ".join((*found.notes, *found.columns.table.notes))
    assert "sigma 50 um is assumed" in notes
    assert SAID.get(name, "") in notes


BY_LOAD = """
columns = {{ pose = "Pose", "joint_{{n}}_deg" = "A{{n}}", "{{marker}}_{{axis}}_mm" = {} }}
words = {{ 0 = "empty" }}
"""


@pytest.mark.parametrize(
    "name",
    ['"{marker} {axis} {mass_kg} kg"', '["{marker} at {axis} {mass_kg}", "{marker} {axis} {mass_kg} kg"]'],
)
def test_names_of_columns_may_hold_a_target_an_axis_and_a_load(tmp_path, name):
    (names := tmp_path / "map.toml").write_text(BY_LOAD.format(name))
    found = read_export(FOLDER / "columns_by_load.csv", ARM, names).data
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
    (names := tmp_path / "map.toml").write_text(BY_LOAD.format(name))
    with pytest.raises(InputError, match=re.escape(problem)):
        read_export(FOLDER / "columns_by_load.csv", ARM, names)


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


def test_a_map_may_name_some_columns_and_leave_the_others_to_our_names(tmp_path):
    """Parts of our names stand in any order; of two that say the same the map's is read."""
    content = (
        "\n".join(lines_of("merged")).replace("before x", "x unloaded").replace("after z", "Z unter Last")
    )
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
        cells[-1] = f"{float(cells[-1]) + 1:.7f}"
    found = read(tmp_path, "plain", [*text, *map(",".join, again)]).data
    assert found.pose_id.tolist() == [1, 1, 2, 2, 3, 3, 1]
    np.testing.assert_array_equal(found.before[:2], found.before[[0, 0]])
    np.testing.assert_allclose(found.before[6] - found.before[0], np.tile([0, 0, 1e-3], (3, 1)), atol=1e-12)


def test_the_sigma_of_file_or_map_counts_more_than_a_flag_and_that_is_said(tmp_path):
    own = files(tmp_path, "plain", lines_of("plain"), "values = { sigma_um = 30 }")
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
