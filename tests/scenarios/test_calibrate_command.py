"""testbench calibrate: a folder of model, report and views; its warnings; and --score."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from checks import at, tables_of
from page_checks import check_page, drawn_in, layer_of, said, times_of
from read_reports import read
from reports import check
from run_here import check_folder, do, fine, numbers_alone, refused
from strangers import MESH

import testbench as tb
from testbench.arm.folder import load_arm
from testbench.identify.absolute.align import align_all, residuals, unknowns_of
from testbench.identify.absolute.posterior import RegisteredSeries, predict_series, without_frame_and_mount
from testbench.identify.absolute.state import nominal_state
from testbench.identify.equations import series_equations
from testbench.identify.posterior import Posterior
from testbench.plant.build import build_plant
from testbench.report.markdown import grid
from testbench.report.schema import show
from testbench.workflows.absolute import File, evenly_spaced_rows, position_errors, read_all
from testbench.workflows.arm_models import read_model

ROOT = Path(__file__).resolve().parents[2]
SHOWN = {
    "steps": ("steps", {0: ("name", ""), 2: ("after_mm", ".3f"), 3: ("series_after_mm", ".3f")}),
    "series": ("series", {1: ("after.n", "d"), 2: ("before.mean_mm", ".3f"), 3: ("after.mean_mm", ".3f")}),
    "geometry": ("values", {0: ("name", ""), 1: ("value", ".3g"), 2: ("half_95", ".2g")}),
    "spectrum": ("spectrum", {1: ("rms_urad", ".0f"), 3: ("largest.amplitude_urad", ".0f")}),
    "outliers": ("outliers", {1: ("row", "d"), 3: ("error_mm", ".3f")}),
}
"""Table of some rows of report.json, the last ones, and what its cells are by their places."""
GAP = 0.9, 1.7  #: Range of joint_1 without readings [rad].
OFF = 4e-3  #: What one reading is off [m].
SHAPE = '<geom type="mesh" mesh="flag" contype="0" conaffinity="0" group="2" mass="0"/></body>'


def spoiled(path):
    """Without the rows of a range of joint_1, and with one row off."""
    head, *rows = path.read_text().splitlines()
    rows = [row for row in rows if not GAP[0] < float(row.split(",")[1]) < GAP[1]]
    cells = rows[7].split(",")
    place = head.split(",").index("position_y_m")
    cells[place] = str(float(cells[place]) + OFF)
    path.write_text("\n".join([head, *rows[:7], ",".join(cells), *rows[8:]]) + "\n")
    return cells[0]


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """An arm with a mesh, as `testbench new` makes them."""
    folder = tmp_path_factory.mktemp("arms") / "flagged"
    shutil.copytree(ROOT / "models" / "arm_6r", folder)
    (folder / "meshes").mkdir()
    shutil.copy(MESH, folder / "meshes" / "flag.stl")
    text = (folder / "rigid.xml").read_text()
    text = text.replace('inertiafromgeom="false"', 'inertiafromgeom="false" meshdir="meshes"')
    mesh = '<asset><mesh name="flag" file="flag.stl" scale="0.001 0.001 0.001"/></asset><worldbody>'
    text = text.replace("<worldbody>", mesh).replace("</body>", SHAPE, 1)
    (folder / "rigid.xml").write_text(text)
    return folder


@pytest.fixture(scope="module")
def readings(arm):
    flags = ("--poses", 120, "--series", 3, "--geometry-mm", 0.5, "--gear-urad", 60, "--sigma-um", 20)
    out = arm.parent / "r.csv"
    fine("simulate", arm, "--absolute", *flags, "--seed", 11, "--out", out)
    return [arm.parent / f"r_{k}.csv" for k in (1, 2, 3)]


@pytest.fixture(scope="module")
def made(arm, readings, legible):
    """Folder of a model, what was said, and the rows that are off; the third series is never seen."""
    rows = [spoiled(path) for path in readings[:2]]
    out = arm.parent / "model"
    flags = ("--orders", 30, "--without", "links", "--without", "stiffening")
    with legible():
        return out, fine("calibrate", arm, *readings[:2], *flags, "--out", out), rows


@pytest.fixture(scope="module")
def report(made):
    return json.loads((made[0] / "report.json").read_text())


def distances(state, series):
    left = [residuals(state, one)[: len(one.markers)].transpose(2, 0, 1)[one.is_measured] for one in series]
    return 1e3 * np.linalg.norm(np.concatenate(left), axis=-1)


def test_numbers_of_the_report_are_those_of_the_model_that_was_written(made, report, readings):
    state = read_model(made[0]).state
    series, _ = read_all(list(map(File, readings[:2])), state.vjm.arm)
    after = distances(state, series)
    before = distances(
        align_all(nominal_state(state.vjm, state.body_masses, state.torque_scale), series), series
    )
    for key, size in (("total_before", before), ("total_after", after)):
        known = (len(size), size.mean(), np.sqrt((size**2).mean()), np.percentile(size, 95), size.max())
        assert list(report[key].values()) == pytest.approx(known, rel=1e-6)
    assert sum(row["n"] for row in report["places"]) == 6 * len(after)  # every joint has every position
    orders = len(state.error_terms.orders)
    sine, cosine = state.error_coefficients[:, :orders], state.error_coefficients[:, orders : 2 * orders]
    found = [[one["amplitude_urad"] for one in row["orders"]] for row in report["spectrum"]]
    np.testing.assert_allclose(found, 1e6 * np.hypot(sine, cosine), rtol=1e-9, atol=1e-6)
    links = 6 * len(state.vjm.arm.links)
    springs = 1e6 * np.diag(state.C_theta)[links:]
    np.testing.assert_allclose([row["value"] for row in report["compliances"]], springs, rtol=1e-9)
    assert all(row["half_95"] > 0 for row in report["compliances"] + report["geometry"])
    assert report["program"]["status"] == "solved"
    assert report["program"]["constrained"]
    assert report["program"]["conservative"]
    assert min(row["smallest"] for row in report["blocks"]) >= 0


def test_what_was_planted_is_found_and_the_verdict_comes_first(made, report):
    out, words, rows = made
    verdict = report["badge"]
    assert words.startswith("Holds: the error of the calibrated arm is ")
    assert (verdict["winner"], verdict["verdict"]) == ("calibrated arm", "holds")
    assert verdict["rival"] == "arm with only geometry and joint springs"
    sizes = re.search(r"readings: ([\d.]+) mm of the calibrated arm, ([\d.]+) mm of the (.*?)\.", words)
    own, plain = map(float, sizes.groups()[:2])
    assert sizes[3] == verdict["rival"]  # one rival in verdict, headline and table
    assert plain / own == pytest.approx(verdict["factor"], abs=1e-3 * plain / own**2)  # of three decimals
    [springs] = [step["after_mm"] for step in report["steps"] if step["name"] == "joint springs"]
    assert plain == pytest.approx(springs, abs=6e-4)
    assert report["total_after"]["mean_mm"] < 0.2 * report["total_before"]["mean_mm"]
    assert report["more"]["after_mm"] < report["more"]["now_mm"]
    kept = {step["name"]: step["after_mm"] for step in report["steps"] if step["kept"]}
    assert [*kept] == ["joint springs", "joint errors"]
    assert report["held_out_mm"] == [report["steps"][0]["before_mm"], kept["joint errors"]]
    assert {step["name"] for step in report["steps"]} - kept.keys() == {"gear ratio", "backlash"}
    unread = next(text for text in report["doubts"] if text.startswith("Extrapolated at joint angles"))
    assert re.search(r": joint_1 (4|5|6)\d to (7|8|9)\d deg\.", unread), unread
    assert (report["outliers"][0]["series"], str(report["outliers"][0]["row"])) in zip(
        ("r_1", "r_2"), rows, strict=True
    )
    assert report["outliers"][0]["error_mm"] == pytest.approx(1e3 * OFF, abs=0.5)
    assert "Own weight is the only load" in words
    model = {"model.json", "posterior.npz", "rigid.xml", "elastic.toml", "meshes"}
    check_folder(out, "calibration.png", "joint_errors.png", *model)
    found = read(json.loads(json.dumps(report).replace("r_", "r")))  # r_1 looks like a key of ours
    check(found, ["steps"])
    for name, (table, cells) in SHOWN.items():
        [(_, shown)] = tables_of(grid(found.tables[table]))
        for line, own in zip(shown[-len(report[name]) :], report[name], strict=True):
            assert {k: line[k] for k in cells} == {
                k: show(at(own, *key), form) for k, (*key, form) in cells.items()
            }
    shown = {row[0]: row[1:] for row in tables_of(grid(found.tables["errors"]))[0][1]}
    for name, key in (("nominal arm", "total_before"), ("calibrated arm", "total_after")):
        sizes = (report[key][size] for size in ("mean_mm", "rms_mm", "p95_mm", "max_mm"))
        assert shown[name] == [f"{mm:.3f}" for mm in sizes]


def test_a_series_never_seen_is_scored_by_frame_and_mount_alone(made, readings, tmp_path):
    asked = ("calibrate", made[0], readings[2], "--score", "--frame-poses", 20)
    model = read_model(made[0])
    series, _ = read_all(list(map(File, readings[2:])), model.arm)
    found, words = position_errors(model, series, 20), fine(*asked)
    assert found.n == 100
    sizes = (f"{getattr(found, name):.3f} mm" for name in ("mean_mm", "rms_mm", "p95_mm", "max_mm"))
    assert [size for size in sizes if size not in words] == []
    assert f"{100 * found.coverage_95:.1f} %" in words
    assert "these readings were fitted" not in words
    assert "these readings were fitted" in fine("calibrate", made[0], readings[0], "--score")
    twice = replace(series[0], pose_id=np.arange(series[0].n_rows) // 2)
    assert len(evenly_spaced_rows(twice, 20)) == 40
    for share, code, head in ((1.01, 0, "Holds: "), (0.99, 1, "Do not use: ")):
        done = do(*asked, "--at-most", share * found.mean_mm)
        assert (done.returncode, done.stderr) == (code, "")
        assert done.stdout.startswith(head)
    same = tmp_path / readings[0].name  # one of the name of a fitted one: its tracker stands elsewhere
    for file, lines, told in (
        (readings[2], None, "--frame-poses fits a new frame"),
        (readings[0], 2, "determine frame and target"),
    ):
        same.write_text("\n".join(file.read_text().splitlines()[:lines]) + "\n")
        refused("calibrate", made[0], same, "--score", said=told)


TAMPERED = {
    "noise.factor.0: expected more than 0": lambda d: {"noise": {**d["noise"], "factor": [0.0] * 4}},
    "expected a model of testbench calibrate": lambda d: {"noise": None},
    "orders: expected different": lambda d: {"errors": {**d["errors"], "orders": [2, 2]}},
}


@pytest.mark.parametrize("words", TAMPERED)
def test_a_model_that_was_tampered_with_is_one_line(words, made, readings, tmp_path):
    folder = shutil.copytree(made[0], tmp_path / "model")
    document = json.loads((folder / "model.json").read_text())
    (folder / "model.json").write_text(json.dumps(document | TAMPERED[words](document)))
    refused("calibrate", folder, readings[2], "--score", said=words)


@pytest.mark.parametrize(
    ("lines", "flags", "words"),
    [
        (5, (), "part: 4 poses with a reading are too few"),
        (41, ("r_3.csv",), "expected new readings: 40 of its 40 are in another file too"),
        (41, ("--without", "springs"), "--without: no errors called springs"),
        (41, ("--at-most", "1"), "--at-most works only with --score"),
        (41, ("--score",), "--out cannot be combined with --score, which writes nothing"),
    ],
)
def test_what_cannot_be_calibrated_is_said_and_nothing_is_written(readings, lines, flags, words, tmp_path):
    (part := tmp_path / "part.csv").write_text("\n".join(readings[2].read_text().splitlines()[:lines]) + "\n")
    more = [readings[2] if flag == "r_3.csv" else flag for flag in flags]
    arm = readings[0].parent / "flagged"
    refused("calibrate", arm, *more, part, "--out", tmp_path / "out", said=words, below=tmp_path)


def test_the_arm_of_the_model_is_the_one_that_was_calibrated(made, arm):
    """With its meshes: collisions are found and it is drawn from the folder alone."""
    model = tb.load_model(made[0], arm)
    assert model.arm.joints == load_arm(arm).joints
    assert model.arm.name == "flagged"
    assert build_plant(model.arm).load_point.shape == (3,)


def test_a_loaded_model_is_as_sure_as_the_calibration_with_its_frame_held(made, readings):
    """Positions are linear in what is open: their covariance is that of `predict` but for the scatter."""
    model = read_model(made[0])
    [one], _ = read_all(list(map(File, readings[2:])), model.arm)
    held = align_all(without_frame_and_mount(model.state, one), (one,))
    root = np.hstack(
        [np.zeros((len(model.uncertain_columns), 6 + 3 * len(one.markers))), model.posterior.covariance_root]
    )
    placed = RegisteredSeries(
        held, np.zeros(0, int), Posterior.from_covariance_root(np.zeros(root.shape[1]), root)
    )
    calm = replace(model, noise=replace(model.noise, factor=1e-9 * model.noise.factor))
    wanted = np.einsum("rmkk->rmk", predict_series(calm, placed, one)[1])
    unknowns = unknowns_of(model.vjm, (one,), held.error_terms, model.structure)
    first = unknowns.first_columns["geometry"]
    rows = series_equations(unknowns, held, one)[: len(one.markers), :, first + model.uncertain_columns]
    found = model.posterior.standard_deviations(
        rows.transpose(3, 0, 1, 2).reshape(-1, len(model.uncertain_columns))
    )
    np.testing.assert_allclose(found.reshape(wanted.shape) ** 2, wanted, rtol=1e-6)
    assert np.array_equal(model.posterior.mean, model.unknowns.values(model.state)[model.uncertain_columns])
    assert model.is_absolute
    assert model.position_scatter > 0


def test_a_model_says_where_it_comes_from(made):
    origin = tb.load_model(made[0]).origin
    assert origin.method == "absolute calibration: geometry, joint springs, joint errors"
    assert [*origin.file_hashes] == ["r_1.csv", "r_2.csv"]
    assert (origin.largest_force, origin.largest_moment) == (0, 0)
    assert [doubt.split(":")[0] for doubt in origin.warnings] == [
        "Extrapolated at joint angles without a reading",
        "Own weight is the only load",
    ]


@pytest.mark.parametrize(
    ("poses", "told"),
    [
        pytest.param(11, "Too few poses: none could be held out", marks=pytest.mark.study),
        (13, "Too few poses: held-out ones are "),
    ],
)
def test_a_model_that_foretells_worse_than_the_drawing_says_so(poses, told, tmp_path):
    """Some poses of a real arm are fitted well, and tell nothing of any other."""
    rows = (ROOT / "models" / "ur10" / "readings" / "series_C.csv").read_text().splitlines()[: poses + 1]
    (tmp_path / "few.csv").write_text("\n".join(rows) + "\n")
    flags = ("--orders", 5, "--without", "links", "--out", tmp_path / "model")
    with numbers_alone():
        words = fine("calibrate", "ur10", tmp_path / "few.csv", *flags)
    found = json.loads((tmp_path / "model/report.json").read_text())
    assert any(text.startswith(told) for text in found["doubts"]), words
    assert ("RMS error at held-out readings" in words) == (found["held_out_mm"] is not None) == (poses == 13)
    assert found["badge"]["verdict"] == "do not use"
    assert [step["name"] for step in found["steps"] if step["kept"]] == ["joint springs"]
    heads = found["tables"]["steps"]["columns"]
    assert not any("series" in str(head) for head in heads), heads  # there is one series


def test_the_page_shows_what_was_tried_and_a_button_leads_to_the_worst_reading_of_all(
    made, report, open_page, blank_panes
):
    told = [f"{row['after_mm']:.3f}" for row in report["steps"]]
    shown = check_page(open_page, made[0] / "report.html", told)
    shown.page.locator("#scene").get_by_role("button", name="worst").first.click()
    assert f"{report['total_after']['max_mm']:.3f} mm from the calibrated arm" in said(shown)
    assert blank_panes(made[0] / "recording.rrd") == []


def test_the_page_draws_readings_off_the_arm_as_drawn_and_as_calibrated(made, report, readings):
    """Arrows end at the reading, and are as long as the distances of the model that was written."""
    drawn = drawn_in(made[0] / "report.html")
    [group], [times, *_] = drawn["scene"]["groups"], times_of(drawn["scene"]["title"])
    state = read_model(made[0]).state
    series, _ = read_all(list(map(File, readings[:2])), state.vjm.arm)
    straight = align_all(nominal_state(state.vjm, state.body_masses, state.torque_scale), series)
    at = {one.name: one for one in series}
    for name, own in (("calibrated arm", state), ("nominal arm", straight)):
        left = {key: residuals(own, one).transpose(2, 0, 1) for key, one in at.items()}
        start, end = layer_of(group, f"error of the {name}")
        where = [re.match(r"(.*), row (\d+)", words).groups() for words in group["names"]]
        rows = [(key, at[key].row_id.tolist().index(int(row))) for key, row in where]
        wanted = np.array([left[key][k] for key, k in rows])
        np.testing.assert_allclose((end - start) / times, wanted, atol=1e-4 / times + 1e-9)
        [line] = [one for one in drawn["runs"][0]["lines"] if one["name"] == name]
        np.testing.assert_allclose(
            line["values"], 1e3 * np.linalg.norm(wanted, axis=2).max(axis=1), rtol=1e-3
        )
    np.testing.assert_allclose(end, layer_of(group, "target as read")[0])
