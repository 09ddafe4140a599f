"""`testbench data check` says what was understood of a file, and shows it; maps serve the other commands."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from checks import tables_of
from page_checks import drawn_in, layer_of, times_of
from run_here import check_folder, fine, numbers_alone, refused

from testbench.arm.folder import load_arm
from testbench.files.read_pairs import read_export
from testbench.files.read_series import read_series
from testbench.workflows.absolute import kinematic_misfit
from testbench.workflows.cell import build_cell

ROOT = Path(__file__).resolve().parents[2]
MAPS = ROOT / "docs" / "maps"
ARM = "kr500_l480"


def mapped(name):
    return MAPS / f"{name}.csv", "--map", MAPS / f"{name}.toml"


@pytest.fixture(scope="module")
def spreadsheet(tmp_path_factory):
    out = tmp_path_factory.mktemp("data") / "seen"
    return out, fine("data", "check", ARM, *mapped("spreadsheet"), "--out", out)


def test_no_pane_of_the_recording_is_blank_on_any_timeline(spreadsheet, blank_panes):
    assert blank_panes(spreadsheet[0] / "recording.rrd") == []


def test_small_lengths_are_shown_in_micrometres():
    assert "sigma sigma_m m 50 um" in fine("data", "check", ARM, ROOT / "docs" / "example_dataset.csv")


def test_the_rounding_of_a_zero_is_shown_as_zero(tmp_path):
    """The load point lies on the tool's axis, but for what the program that wrote the file rounded."""
    text = (ROOT / "docs" / "example_dataset.csv").read_text()
    (tmp_path / "own.csv").write_text(text.replace("0.14,-0.07999999999999996,", "-8.7e-18,0.08,"))
    assert "load point point_x_m ... point_z_m m 0 to 0.35" in fine(
        "data", "check", ARM, tmp_path / "own.csv"
    )


def test_a_spreadsheet_is_understood_and_shown(spreadsheet):
    out, words = spreadsheet
    for said in (
        "joint 2 A2 [°] deg -126.97 to -49.95 16",
        "position P3 loaded Ziel 3 voll X [mm] ... Ziel 3 voll Z [mm] mm",
        "lost targets: 1 of 48",
        "1471.5 N (the weight of 150 kg) in 8 runs; 4515.5 N (the weight of 460.3 kg) in 8 runs",
        "columns not read: Bemerkung",
        "text in cp1252, cells separated by ';', header in line 4",
        "readings are in the base's frame",
    ):
        assert said in words
    report = json.loads((out / "report.json").read_text())
    assert report["scale"] == pytest.approx(1, abs=0.1)
    assert (
        f"measured deflections divided by those computed from the arm's folder: {report['scale']:.2f}"
        in words
    )
    shown = {row[0]: row[1] for row in tables_of((out / "report.md").read_text())[1][1]}
    farthest = f"{report['deflection_mm']['most']:.3f}, {report['farthest']}"
    assert shown["largest deflection, mm"] == farthest
    check_folder(out, "data.png")


def test_numbers_and_picture_are_those_of_the_file(spreadsheet):
    out, _ = spreadsheet
    report, drawn = json.loads((out / "report.json").read_text()), drawn_in(out / "report.html")
    data = read_export(
        MAPS / "spreadsheet.csv", load_arm(ROOT / "models" / ARM), mapped("spreadsheet")[2]
    ).data
    size = np.where(data.is_measured, 1e3 * np.linalg.norm(data.deflection, axis=2), np.nan)
    ends = np.nanquantile(size, [0, 0.5, 1])
    assert list(report["deflection_mm"].values()) == pytest.approx(ends)
    assert (report["runs"], report["poses"], report["sigma_um"]) == (16, 8, pytest.approx(1e6 * data.sigma))
    [M] = times_of(drawn["scene"]["title"])
    before, after = layer_of(drawn["scene"]["groups"][0], "deflection")
    np.testing.assert_allclose(
        (after - before)[data.is_measured] / M, data.deflection[data.is_measured], atol=2e-4 / M
    )
    moved, away = drawn["runs"]
    for k, line in enumerate(moved["lines"]):
        assert line["name"] == data.markers[k]
        np.testing.assert_allclose(np.array(line["values"], dtype=float), size[:, k], rtol=1e-3)
    most = max(x for line in away["lines"] for x in line["values"] if x)
    worst = drawn["scene"]["groups"][0]["worst"]  # it opens on a typical run; a button leads to this one
    assert most in [line["values"][worst] for line in away["lines"]]
    assert most == pytest.approx(report["away"]["distance_mm"], rel=1e-3)


def test_points_of_a_tracker_are_brought_into_the_base_and_fitted(tmp_path):
    """The tracker stood at (4.2, 1.7, -1.4) m of its own frame from the base; truth of the example."""
    said = fine("data", "check", ARM, *mapped("spatialanalyzer"))
    assert "turned by 137.0" in said
    out, models = tmp_path / "fit", ("--model", "Joints", "--no-intervals")
    with numbers_alone():
        fine("identify", ARM, *mapped("spatialanalyzer"), *models, "--out", out)
    assert "sigma 50 um is assumed" in (out / "report.md").read_text()


def test_both_examples_hold_the_same_loads_and_deflections():
    arm = load_arm(ROOT / "models" / ARM)
    one, other = (
        read_export(MAPS / f"{name}.csv", arm, MAPS / f"{name}.toml").data
        for name in ("spreadsheet", "spatialanalyzer")
    )
    np.testing.assert_array_equal(one.wrench, other.wrench)
    np.testing.assert_allclose(one.q, other.q, atol=1e-9)
    both = one.is_measured & other.is_measured
    size, again = (np.linalg.norm(data.deflection[both], axis=-1) for data in (one, other))
    np.testing.assert_allclose(size, again, atol=5e-4)  # two readings of each unloaded target, 50 um


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("frame =", "fame =", "fame: unknown key; keys are frame, file, series, log, loaded, controller, "),
        ('"tracker"', '"moon"', "frame: expected 'base' or 'tracker', got 'moon'"),
        (
            '"Point"',
            '"Pint"',
            "columns.marker: no column like 'pint' in spatialanalyzer.csv; columns are Collection",
        ),
        ("A{n}", "A{k}", "columns.joint_{n}_deg: expected the same {...} in both names, got 'A{k}'"),
        ("P3 =", "P4 =", "words.P4: expected one of before, after, P1, P2, P3, ignore, lost, or"),
        ("Pose {pose} /", "Pose {pose} :", "line 4, column Group: expected 'Pose {pose} : {mass_kg} kg'"),
        ("_mm", "_deg", "columns.{axis}_deg: unknown quantity"),
        ("frame =", "= frame", "not TOML"),
        (
            '"tracker"',
            "tracker",
            "not TOML: Invalid value (at line 1, column 9); a text needs quotation marks",
        ),
        (
            "frame =",
            "values = 5\nframe =",
            "values: expected a table, written as { key = value, ... }, got 5",
        ),
        (
            "frame =",
            "mass = 5\nframe =",
            "values, scale; put names of columns below [columns], and a number",
        ),
        ('"Point"', "5", "columns.marker: expected the name of a column in quotation marks, got 5; put"),
    ],
)
def test_a_wrong_map_is_one_line(tmp_path, old, new, text):
    whole = (MAPS / "spatialanalyzer.toml").read_text()
    (tmp_path / "map.toml").write_text(whole.replace(old, new))
    refused("data", "check", ARM, MAPS / "spatialanalyzer.csv", "--map", tmp_path / "map.toml", said=text)


@pytest.mark.parametrize("flag", ["--log", "--loaded"])
def test_a_file_cannot_be_its_own_log_or_loaded_file(flag):
    file = MAPS / "spatialanalyzer.csv"
    refused("data", "check", ARM, file, flag, file, said="expected another file for --log or --loaded")


def test_runs_of_an_arm_without_joints_are_looked_at_and_refused_without_any_load(tmp_path):
    runs = tmp_path / "runs.csv"
    fine("simulate", "single_link", "--poses", 2, "--out", runs)
    assert "Warnings: 0." in fine("data", "check", "single_link", runs)
    rows = [line.split(",") for line in runs.read_text().splitlines()]
    column = rows[0].index("force_z_N")
    lines = [rows[0], *([*row[:column], "0", *row[column + 1 :]] for row in rows[1:])]
    runs.write_text("\n".join(map(",".join, lines)))
    line = refused("data", "check", "single_link", runs)
    assert line == f"error: {runs}: expected at least one load, but all forces and moments are 0\n"


def test_a_file_with_names_of_its_own_is_shown_by_the_map_that_they_suggest(tmp_path):
    """Show pairs with the names of a German workshop, and absolute readings in ours."""
    rows = [line.split(",") for line in (ROOT / "docs/example_dataset.csv").read_text().splitlines()]
    at = {name: k for k, name in enumerate(rows[0])}
    theirs = {f"joint_{k}_rad": f"Achse {k} [rad]" for k in range(1, 7)} | {"marker": "Reflektor"}
    when = {"before": "unbelastet", "after": "belastet"}
    theirs |= {f"{ours}_{x}_m": f"{x.upper()} {word} [m]" for ours, word in when.items() for x in "xyz"}
    table = [list(theirs.values()), *([row[at[name]] for name in theirs] for row in rows[1:])]
    (file := tmp_path / "messung.csv").write_text("\n".join(map(";".join, table)))
    said = fine("data", "check", ARM, file, "--load", "460.3")
    assert (
        "Save this map as messung.toml and give it with --map: # A map of messung.csv, proposed by testbench"
        in said
    )
    assert 'before_x = "X unbelastet [m]"' in said
    assert "measured deflections divided by those computed from the arm's folder: " in said
    refused("data", "check", ARM, file, said="for one load in the whole file, give --load", below=tmp_path)
    absolute = ROOT / "testbench/layouts/readings.csv"  # in our names, without a load
    said = re.search(r"these readings from the nominal arm is (\S+) mm", fine("data", "check", ARM, absolute))
    off = kinematic_misfit(build_cell(ARM).vjm, read_series(absolute, load_arm(ROOT / "models" / ARM)).series)
    assert float(said[1]) == pytest.approx(1e3 * off, rel=5e-3)
