"""testbench predict: a folder of numbers and views that say what the library says; bad input in one line."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from checks import tables_of
from model_folders import identified
from page_checks import check_page, said
from reports import check
from run_here import check_folder, fine, refused, table
from tables import write_table

import testbench as tb
from testbench.arm.mjcf import GRAVITY
from testbench.cli.predict import report
from testbench.errors import InputError
from testbench.model.load import BodyMasses
from testbench.model.vjm import tool_poses
from testbench.report.schema import show
from testbench.workflows.campaign import Scenario, settle_both, simulate
from testbench.workflows.models import named_models, with_priors
from testbench.workflows.program import predict_file, read_pose_file
from testbench.workflows.program_numbers import write_predictions

ROOT = Path(__file__).resolve().parents[2]
MEDIAN = "deflection by the force in the worst direction, median over the map, mm"
POSES, MASS, PULL = 8, 300.0, 9500.0  #: Of the file; hung [kg]; of one pose [N].


def folder_of(cell, parent, prior):
    """A model of few poses of a hung weight; without a prior some of it stays open."""
    runs = simulate(cell, Scenario(arm="kr500_l480", workspace_poses=1), 7).identification
    models = named_models(cell, ["MGCO56"])
    [model] = with_priors(cell.arm, models, tb.cad_prior(cell.arm)) if prior else models
    folder = parent / ("prior" if prior else "bare")
    identified(cell, model, runs, folder)
    return folder


def poses_file(path, q, rows, head="force_x_N,force_y_N,force_z_N,mass_kg"):
    names = ",".join(f"joint_{k}_rad" for k in range(1, 7))
    cells = ([*own, *row.split(",")] for own, row in zip(q, rows, strict=True))
    return write_table(path, f"{names},{head}", cells)


@pytest.fixture(scope="module")
def q(kr500):
    return simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=POSES), 8).truth.q


@pytest.fixture(scope="module")
def model(kr500, tmp_path_factory):
    return folder_of(kr500, tmp_path_factory.mktemp("models"), True)


@pytest.fixture(scope="module")
def made(model, q, legible):
    """Folder of the results, and what was said; one pose is pulled harder than any reading was."""
    rows = [f"0,0,0,{MASS}"] * (POSES - 1) + [f"0,{PULL},0,0"]
    out = model.parent / "out"
    file = poses_file(model.parent / "poses.csv", q, rows)
    with legible():
        return out, fine("predict", model, file, "--push", 1000, "--out", out, "--recording")


def test_every_pose_and_point_is_what_the_library_says_and_holds_the_truth(kr500, model, made, q):
    """95 % intervals of 8 poses: at least 80 % of the components, whatever the draw."""
    rows = table(made[0] / "predictions.csv")
    assert [row["point"] for row in rows] == ["tool", "P1", "P2", "P3"] * POSES
    wrench = np.zeros((POSES, 6))
    wrench[:-1, 2], wrench[-1, 1] = -GRAVITY * MASS, PULL
    point = np.tile(kr500.vjm.load_point, (POSES, 1))
    point[-1] = 0
    wanted = tb.predict(tb.load_model(model), q, [tb.Load(wrench, point)])
    for what, own in (
        ("", wanted.position),
        ("deflection_", wanted.deflection),
        ("half_95_", wanted.half_width),
    ):
        found = np.array([[float(row[f"{what}{axis}_m"]) for axis in "xyz"] for row in rows])
        np.testing.assert_allclose(found.reshape(POSES, 4, 3), own, rtol=1e-8, atol=1e-12)
    before, after = settle_both(kr500.plant, "nonlinear", q, wrench, point)
    off = np.abs(wanted.deflection[:, 1:] - (after.marker_positions - before.marker_positions))
    assert (off <= wanted.half_width[:, 1:]).mean() > 0.8


def test_the_headline_is_the_largest_deflection_and_warnings_follow(made):
    out, said = made
    report = json.loads((out / "report.json").read_text())
    check_folder(out, "predictions.csv", "predict.png", "stiffness.png")
    longest = {row["label"]: row["semi_axes_mm"][0] for row in report["ellipsoids"]}
    assert len(longest) == POSES
    assert all(longest[row["pose"]] == pytest.approx(row["push_mm"]) for row in report["worst"])
    worst = report["worst"][0]
    assert "0 to 300 kg and 0 to 9,500 N" in said
    assert f" {worst['deflection_mm']:.3f} mm, ± {worst['half_mm']:.3f} mm (95 %), in pose 8." in said
    ratio = PULL / (460.3 * GRAVITY)
    assert f"Extrapolated: a force of 9,500 N is {ratio:.1f} times the largest one" in said
    assert report["force_ratio"] == pytest.approx(ratio, rel=1e-6)
    assert report["map"]["half_mm"] > report["map"]["worst_mm"] / 2  # a hung weight never turned joint 1
    assert "Uncertain: the 95 % half width of the largest deflection in the map" in said
    shown = {row[0]: row[1] for row in tables_of((out / "report.md").read_text())[1][1]}
    for name, mm in (("worst_mm", "this deflection, largest over the map, mm"), ("median_mm", MEDIAN)):
        assert shown[mm] == show(report["map"][name], ".3g")


def test_the_interval_beside_the_softest_direction_is_that_of_a_force_along_it(model, q, tmp_path):
    """A hung weight never turned joint 1: aside, the same force has an interval many times wider."""
    own = tb.load_model(model)
    file = poses_file(tmp_path / "poses.csv", q, [f"0,0,0,{MASS}"] * POSES)
    made = predict_file(own, read_pose_file(file, own, None, MASS), 1000.0)
    push = tb.Load(
        np.hstack([1000 * made.stiffness.principal_axes[:, :, 0], np.zeros((POSES, 3))]), np.zeros(3)
    )
    wanted = tb.predict(own, q, [push]).half_width[:, 0].max(axis=1)
    assert made.push_halves(np.arange(POSES)) == pytest.approx(wanted)


def test_the_table_has_the_numbers_of_the_file_of_all_poses_the_farthest_first(made):
    rows = [row for row in table(made[0] / "predictions.csv") if row["point"] == "tool"]

    def of(row, name):
        return [float(row[name.replace("*", axis)]) for axis in "xyz"]

    wanted = []
    for row in rows:
        moved = 1e3 * np.array(of(row, "deflection_*_m"))
        cells = [f"{x:.3f}" for x in (np.linalg.norm(moved), 1e3 * max(of(row, "half_95_*_m")), *moved)]
        cells += [f"{1e3 * np.linalg.norm(of(row, 'rotation_*_rad')):.2f}"]
        wanted.append([row["pose"], *cells, show(1e-6 * float(row["stiffness_1_N_per_m"]), ".3g")])
    wanted.sort(key=lambda cells: -float(cells[1]))
    head, found = tables_of((made[0] / "report.md").read_text())[0]
    assert head[1:7] == ["deflection, mm", "95 % half width, mm", "x, mm", "y, mm", "z, mm", "rotation, mrad"]
    assert head[7] == "least stiffness, N/um"
    assert [row[:-1] for row in found] == wanted


def test_what_no_reading_has_seen_is_said_and_blank(kr500, tmp_path, q):
    """Without a prior: a force across turns joint 1, which no hung weight did."""
    bare = tb.load_model(folder_of(kr500, tmp_path, False))
    file = poses_file(tmp_path / "poses.csv", q[:1], ["0,800,0,0"])
    made = predict_file(bare, read_pose_file(file, bare, None, MASS), 1000.0)
    said = report(made)
    assert "not determined by the readings" in said.answer
    assert any(
        claim == "The readings give no interval for 100 % of the deflections." for claim in said.claims
    )
    assert said.json()["worst"][0]["half_mm"] is None
    write_predictions(made, tmp_path)
    assert table(tmp_path / "predictions.csv")[0]["half_95_y_m"] == ""


HUNG = ["0,0,-900,0"] * 2


@pytest.mark.parametrize(
    ("rows", "flags", "said"),
    [
        (["0,0,nan,0"] * 2, (), "line 2, column force_z_N: expected a finite number, got 'nan'"),
        (HUNG, ("--arm", "arm_6r"), "the model is of another arm, kr500_l480"),
        (HUNG, ("--box", "1,2"), "expected 6 numbers"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(model, tmp_path, q, rows, flags, said):
    file = poses_file(tmp_path / "poses.csv", q[:2], rows)
    refused("predict", model, file, *flags, "--out", tmp_path / "out", said=said, below=tmp_path)


def test_the_first_pose_that_cannot_bear_its_load_is_named_by_its_line(model, tmp_path, q):
    """An arm 300 times softer, that bears a newton and not a ton."""
    stiff = tb.load_model(model)
    soft = replace(stiff, state=replace(stiff.state, C_theta=300 * stiff.state.C_theta))
    light = replace(soft, state=replace(soft.state, body_masses=BodyMasses(np.zeros(8), np.zeros((8, 3)))))
    file = poses_file(tmp_path / "poses.csv", q[:6], ["0,0,-1,0"] * 3 + ["0,0,-90000,0"] * 3)
    with pytest.raises(InputError, match="line 5: no static equilibrium at q"):
        predict_file(light, read_pose_file(file, light, None, MASS), 1000.0)


def test_programs_of_tool_poses_and_plans_are_read_too(kr500, model, tmp_path, q):
    found = tb.load_model(model)
    cut = read_pose_file(ROOT / "docs" / "program.csv", found, None, MASS)
    rows = table(ROOT / "docs" / "program.csv")
    asked = [[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows]
    np.testing.assert_allclose(1e3 * tool_poses(kr500.vjm, cut.q)[0], asked, atol=1e-6)
    sizes = [np.linalg.norm([float(row[f"{way}_N"]) for way in ("feed", "cross", "axial")]) for row in rows]
    forces = np.linalg.norm(cut.loads[0].wrench[:, :3], axis=1)
    np.testing.assert_allclose(forces, sizes, rtol=5e-3)  # chords are not quite across the spindle
    assert cut.words == "0 to 1,019 N"
    unread, chosen = cut.notes
    assert unread == "These columns are not read: speed_mm_s"
    assert chosen.startswith("The table has no joint values: of the arm's configurations, the one with")
    plan = poses_file(tmp_path / "plan.csv", q, ["250,0.1"] * POSES, head="load_kg,expected_error_mm")
    hung = read_pose_file(plan, found, None, MASS)
    assert hung.words == "250 kg"
    np.testing.assert_allclose(hung.loads[0].wrench[:, 2], -250 * GRAVITY)
    assert np.array_equal(hung.q, q)
    mixed = ["250,,,,0.1", *[",0,3000,0,0.1"] * (POSES - 1)]
    head = "load_kg,force_x_N,force_y_N,force_z_N,expected_error_mm"
    pulled = read_pose_file(poses_file(tmp_path / "pulled.csv", q, mixed, head=head), found, None, MASS)
    total = sum(load.wrench for load in pulled.loads)
    np.testing.assert_allclose(total[:2, :3], [[0, 0, -250 * GRAVITY], [0, 3000, 0]])
    assert all((load.point == kr500.vjm.load_point).all() for load in pulled.loads)


def test_of_a_corrected_program_the_joints_count_not_the_poses_beside_them(kr500, model, tmp_path, q):
    poses = read_pose_file(ROOT / "docs" / "program.csv", tb.load_model(model), None, MASS)
    rows = (ROOT / "docs" / "program.csv").read_text().splitlines()
    head = [rows[0], *(f"joint_{k}_rad" for k in range(1, 7)), "correction_joint_1_deg"]
    moved = poses.q + 1e-3
    cells = [
        ",".join([row, *map(repr, own), "0.1"]) for row, own in zip(rows[1:], moved.tolist(), strict=True)
    ]
    (file := tmp_path / "corrected.csv").write_text("\n".join([",".join(head), *cells]) + "\n")
    found = read_pose_file(file, tb.load_model(model), None, MASS)
    assert np.array_equal(found.q, moved)
    assert "corrected" in found.notes[-1]


def test_a_recording_is_written_when_it_is_asked_for(made, model, tmp_path, q):
    assert (made[0] / "recording.rrd").is_file()
    file = poses_file(tmp_path / "poses.csv", q[:2], [f"0,0,0,{MASS}"] * 2)
    said = fine("predict", model, file, "--out", tmp_path / "out")
    assert "testbench view" not in said
    assert "report.html" in said
    assert sorted(path.name for path in (tmp_path / "out").glob("*.rrd")) == []
    refused("view", tmp_path / "out", said="predict and compensate leave one with --recording")


def test_a_model_of_own_weight_alone_has_no_ratio_of_loads_and_says_so(model, tmp_path, q):
    """JSON has no infinity."""
    loaded = tb.load_model(model)
    bare = replace(loaded, origin=replace(loaded.origin, largest_force=0.0, largest_moment=0.0))
    file = poses_file(tmp_path / "poses.csv", q[:2], ["0,0,-900,0"] * 2)
    said = report(predict_file(bare, read_pose_file(file, bare, None, MASS), 1000.0))
    check(said, ["worst"])
    assert said.json()["force_ratio"] is None
    assert "own weight only" in said.claims[0]


def test_what_hangs_where_the_file_says_of_no_load_and_what_was_not_read_are_said(model, tmp_path, q):
    own = tb.load_model(model)
    file = poses_file(tmp_path / "poses.csv", q[:2], ["900", "900"], head="axail_N")
    notes = read_pose_file(file, own, None, None).notes
    assert "The file gives no load, so the rated payload of 460.3 kg is assumed" in notes
    assert any(note.startswith("Not used, although it looks like a load: axail_N") for note in notes)
    asked = read_pose_file(file, own, None, 460.3).notes
    assert "The file gives no load: 460.3 kg of --load hang in every pose" in asked
    bare = read_pose_file(file, own, None, 0.0)
    assert (bare.words, bare.notes[-1]) == ("", "Neither the file nor --load gives a load")


def test_the_page_shows_every_pose_and_the_softest_place_and_no_pane_is_blank(made, open_page, blank_panes):
    assert blank_panes(made[0] / "recording.rrd") == []
    report = json.loads((made[0] / "report.json").read_text())
    told = [f"{row['deflection_mm']:.3f}" for row in report["worst"]]
    shown = check_page(open_page, made[0] / "report.html", told)
    shown.page.locator("#scene").get_by_role("button", name="worst").first.click()
    assert said(shown).startswith(f"Pose {report['worst'][0]['pose']}.")
    shown.page.locator("#map button").click()
    assert f"{report['map']['worst_mm']:.3f} mm" in said(shown)
