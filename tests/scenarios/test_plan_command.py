"""`testbench plan`: from tasks to poses, their promise, and back through simulate and identify."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from page_checks import check_page, said
from read_back import chunks_of, columns
from run_here import check_recording, do, fine, refused, table

from testbench.arm.mjcf import GRAVITY
from testbench.files.program import read_poses
from testbench.files.read_pairs import read_csv
from testbench.identify.method import least_squares
from testbench.model.vjm import evaluate_chain
from testbench.plant.rigid_cell import find_collisions
from testbench.plant.tracker import Station
from testbench.workflows.cell import build_cell
from testbench.workflows.models import MODELS
from testbench.workflows.plan import build_path_check

ROOT = Path(__file__).resolve().parents[2]
ARM = ROOT / "models" / "kr500_l480"
ERRORS = "expected_error_mm expected_error_p05_mm expected_error_p95_mm travel_deg way".split()
TASKS = ROOT / "docs" / "tasks.csv"
POSES = 6
FLAGS = ["--poses", POSES, "--load", 460, "--load", 150, "--candidates", 200]
FLAGS += ["--tracker", "4.5,-2.5,1.6", "--seed", 3]
FILES = (
    "error_map.png manifest.json plan.csv plan.json plan.md plan.png recording.rrd report.html run.log "
    "tasks_expected.csv".split()
)
UR10, READ = ROOT / "models" / "ur10", 14
ABSOLUTE = ["--absolute", "--model", "Joints", "--orders", 1, "--poses", READ, "--candidates", 60]
ABSOLUTE += ["--load", 5, "--tracker", "2.5,-1.5,1.2", "--seed", 3]


def tasks_with(folder, columns, values, rows=3):
    """The first tasks of the docs with further columns."""
    lines = TASKS.read_text().splitlines()
    file = folder / "tasks.csv"
    text = [f"{lines[0]},{columns}", *(f"{line},{values}" for line in lines[1 : rows + 1])]
    file.write_text("\n".join(text) + "\n")
    return file


def fixtures(*flags):
    """The folder of a plan, and its plan.json."""

    @pytest.fixture(scope="module")
    def folder(tmp_path_factory):
        out = tmp_path_factory.mktemp("plan") / "first"
        fine("plan", *flags, "--out", out)
        return out

    @pytest.fixture(scope="module")
    def report(request):
        return json.loads((request.getfixturevalue(folder_name) / "plan.json").read_text())

    folder_name = "absolute" if "--absolute" in flags else "planned"
    return folder, report


planned, report = fixtures(ARM, "--task", TASKS, *FLAGS)
absolute, calibration = fixtures(UR10, *ABSOLUTE)


@pytest.mark.study
@pytest.mark.parametrize(
    ("flags", "first"),
    [((ARM, "--task", TASKS, *FLAGS), "planned"), ((UR10, *ABSOLUTE), "absolute")],
    ids=["pairs", "absolute"],
)
def test_figures_are_legible_and_equal_seeds_give_equal_files(tmp_path, legible, request, flags, first):
    """But for the recording, which has an identity, and what holds a digest or a time of it."""
    again, folder = tmp_path / "again", request.getfixturevalue(first)
    with legible():
        fine("plan", *flags, "--out", again)
    for file in folder.iterdir():
        if file.name not in ("recording.rrd", "manifest.json", "run.log"):
            assert file.read_bytes() == (again / file.name).read_bytes(), file.name


def test_a_plan_is_nine_files_with_the_answer_first(planned, report):
    assert sorted(p.name for p in planned.iterdir()) == FILES
    assert json.loads((planned / "manifest.json").read_text())["scenario"]["loads_kg"] == [460.0, 150.0]
    _, _, title, _, first, *_ = (planned / "plan.md").read_text().splitlines()
    assert "kr500_l480, GCO of all links and joints (ALL153), 460 kg or 150 kg" in title
    error = report["error_mm"]["expected"]
    assert first.startswith(f"**Expected error at the tasks: {error:.3f} mm")
    check_recording(planned, "plan.json")


def test_a_warning_names_the_joint_that_no_weight_turns_and_what_that_costs(planned, report, kr500):
    """A weight has no moment about a vertical axis: a side force is predicted by the prior alone."""
    own = report["unloaded"]
    assert own["joints"] == ["joint_1"]
    force, q = np.array(own["force_N"]), np.array([row["q"] for row in report["plan"]])
    arms = evaluate_chain(kr500.vjm, q).tool_position - kr500.vjm.base_pose[:3, 3]
    assert np.abs(np.cross(arms, force)[:, 2]).min() > 1  # it turns joint 1 in every pose
    assert own["error_mm"] > 5 * report["error_mm"]["expected"]
    page = (planned / "plan.md").read_text()
    told = f"under ({', '.join(f'{x:.0f}' for x in force)}) N: {own['error_mm']:.3f} mm"
    assert f"**No load of this plan has a moment about joint_1**. Expected error at the tasks {told}." in page


def test_no_pane_of_the_recording_is_blank_on_any_timeline(planned, blank_panes):
    assert blank_panes(planned / "recording.rrd") == []


def test_the_plan_beats_random_ones_and_respects_its_bound(report):
    certificate, random = report["certificate"], report["random_plans"]
    assert 0.7 < certificate["efficiency"] <= 1
    # the same number twice, from Phi and from the forecast's covariance
    hidden = report["directions"]["hidden_mm"] ** 2
    reached, least = (np.sqrt(hidden + 1e6 / certificate[phi]) for phi in ("phi", "phi_bound"))
    assert reached == pytest.approx(random["planned_mm"], rel=1e-6)
    # and once more, as ALL153 leaves nothing out; the arms here have the folder's scale, a fit has to find it
    assert report["error_mm"]["expected"] == pytest.approx(reached, rel=1e-2)
    assert report["error_mm"]["p95"] < report["joints_alone_mm"]
    assert least <= reached < random["best_tenth_mm"]
    greedy = report["greedy_mm"]
    assert all(a >= b for a, b in pairwise(greedy))
    assert report["advice"]["fewest"] == next(k for k, e in enumerate(greedy, 1) if e <= 0.1)
    assert report["directions"]["seen"] <= report["directions"]["shown"] <= 153
    rms = np.sqrt(np.mean([row["expected_error_mm"] ** 2 for row in report["tasks"]]))
    assert rms == pytest.approx(report["error_mm"]["expected"], rel=1e-9)  # nothing but rounding between


def test_the_map_has_the_errors_over_the_workspace_beside_those_of_least_squares_and_joints(report):
    found = report["map"]
    assert found["compared"] == ["MLS56", "Joints", "ALL153 + prior"]
    errors = {name: np.array(found["error_mm"][name]) for name in found["compared"]}
    rms = {name: np.sqrt(np.mean(mm**2)) for name, mm in errors.items()}
    assert rms["ALL153 + prior"] == pytest.approx(report["workspace_error_mm"]["expected"], rel=1e-3)
    assert rms["ALL153 + prior"] < min(rms["MLS56"], rms["Joints"])
    for name, mm in errors.items():
        worst = found["worst"][name]
        assert mm[worst["place"]] == mm.max() == worst["error_mm"]
        assert found["position_m"][worst["place"]] == worst["position_m"]


def angles(cell):
    joints = cell.arm.joints
    return [*(joint.file_column for joint in joints), *(joint.display_column for joint in joints)]


def test_the_plan_is_read_back_bit_by_bit_and_is_free_of_collision(planned, report, kr500):
    q = read_poses(planned / "plan.csv", kr500.arm)
    assert (q == [row["q"] for row in report["plan"]]).all()
    assert find_collisions(kr500.room, q) == [None] * POSES
    rows = table(planned / "plan.csv")
    assert [*rows[0]] == ["run", *angles(kr500), "load_kg", "expected_deflection_mm", *ERRORS]
    travel = np.rad2deg(np.abs(np.diff(q, axis=0)).max(axis=1))
    assert [float(row["travel_deg"]) for row in rows[1:]] == pytest.approx(travel, abs=0.01)  # two digits
    assert rows[0]["way"] == "start"
    assert {row["way"] for row in rows[1:]} <= {"clear", "via"}
    assert {float(row["load_kg"]) for row in rows} <= {460.0, 150.0}


def test_tasks_that_no_hung_weight_can_serve_are_named_without_a_prior(tmp_path):
    sideways = tasks_with(tmp_path, "force_x_N,force_y_N,force_z_N", "500,800,-300")
    flags = ["--load", 460, "--candidates", 100, "--no-prior", "--out", tmp_path / "out"]
    line = refused("plan", ARM, "--task", sideways, *flags, said="tasks 1, 2, 3 (3 of 3)", below=tmp_path)
    assert "add a prior, or a load or pull in another direction" in line


@pytest.mark.study
def test_a_pull_shows_the_joint_that_no_hung_weight_turns(tmp_path, kr500):
    """Joint 1 has a vertical axis: weights give it no torque, whatever the pose; a force along y does."""
    sideways = tasks_with(tmp_path, "force_x_N,force_y_N,force_z_N", "0,2000,0")
    flags = ["--model", "Joints", "--poses", 4, "--load", 460, "--candidates", 60]
    found = {}
    for name, pull in {"hung": [], "pulled": ["--pull", "0,3000,0"]}.items():
        out = tmp_path / name
        fine("plan", ARM, "--task", sideways, *flags, *pull, "--out", out)
        fine("simulate", ARM, out / "plan.csv", "--out", tmp_path / f"{name}.csv")
        data = read_csv(tmp_path / f"{name}.csv", kr500.arm)
        fit = least_squares(kr500.vjm, MODELS["Joints"](kr500).structure, data)
        report = json.loads((out / "plan.json").read_text())
        found[name] = report, fit, data
    (hung_, fit_hung, _), (pulled, fit, data) = found["hung"], found["pulled"]
    assert hung_["unshown"] == {"joints": ["joint_1"], "turned_by_pull": ["joint_1"], "pull_N": [0, 4000, 0]}
    assert pulled["unshown"] is None
    assert (hung_["directions"]["shown"], pulled["directions"]["shown"]) == (5, 6)
    assert (fit_hung.regression.rank, fit.regression.rank) == (5, 6)
    loads = [row["pull_N"] or [0, 0, -9.81 * row["load_kg"]] for row in pulled["plan"]]
    assert [0, 3000, 0] in loads
    np.testing.assert_allclose(data.wrench, np.hstack([loads, np.zeros((4, 3))]), rtol=1e-12)
    np.testing.assert_array_equal(data.point, np.tile(kr500.vjm.load_point, (4, 1)))


def test_a_weight_far_beyond_the_payload_is_doubted_before_the_search(tmp_path):
    none = ("--box", "10,10,10,11,11,11", "--candidates", 100, "--out", tmp_path / "out")
    done = do("plan", ARM, "--task", TASKS, "--load", 700, *none)
    assert done.returncode == 2
    assert "700 kg hang" in done.stdout


def test_a_plan_and_a_payload_contradict_each_other(planned, tmp_path):
    args = ("simulate", ARM, planned / "plan.csv", "--payload-kg", 3, "--out", tmp_path / "data.csv")
    refused(*args, said="leave out --payload-kg", below=tmp_path)


def test_a_straight_way_that_meets_floor_arm_or_tracker_is_not_clear(kr500):
    left, right, folded = np.deg2rad(
        [[-60, -90, 90, 0, 20, 0], [60, -90, 90, 0, 20, 0], [0, -50, 130, 0, 80, 0]]
    )
    stretched = np.deg2rad([0, 10, -50, 0, 70, 0])
    assert find_collisions(kr500.room, np.array([folded, stretched])) == [None, None]
    alone = build_path_check(kr500, None)
    assert alone(left, right)
    assert alone(left, left)
    assert not alone(folded, stretched)
    half_way = evaluate_chain(kr500.vjm, (left + right)[None] / 2).tool_position[0]
    assert not build_path_check(kr500, Station(tuple(half_way)))(left, right)


def test_the_pages_show_poses_and_tasks_and_where_the_arm_will_err(
    planned, report, absolute, calibration, open_page
):
    told = [
        f"{row['expected_error_mm']:.3f} ({row['expected_error_p05_mm']:.3f} to" for row in report["plan"]
    ]
    told += [f"{report['joints_alone_mm']:.3f}", f"{report['random_plans']['median_mm']:.3f}"]
    shown = check_page(open_page, planned / "report.html", told)
    assert said(shown).startswith("Run 1. Load ")
    shown.page.locator(".runs svg[role=img]").first.click()
    assert said(shown).startswith("Task ")
    told = [f"{row['expected_error_mm']:.3f} (" for row in calibration["plan"]]
    shown = check_page(open_page, absolute / "report.html", told)
    shown.page.locator("#map button").click()
    assert said(shown).startswith("Place ")


@pytest.mark.study
def test_a_plan_of_absolute_readings_has_the_answer_first(absolute, calibration):
    assert {p.name for p in absolute.iterdir()} == {*FILES} - {"tasks_expected.csv"}
    asked = json.loads((absolute / "manifest.json").read_text())["scenario"]
    assert (asked["absolute"], asked["loads_kg"], asked["orders"]) == (True, [5.0], 1)
    page = (absolute / "plan.md").read_text()
    _, _, title, _, first, *_ = page.splitlines()
    assert title == "Calibration plan: ur10, joints-only model, own weight, then 5 kg"
    error, random = calibration["error_mm"]["expected"], calibration["random_plans"]["median_mm"]
    assert f"Expected error over the workspace: {error:.3f} mm, " in first
    assert f"with random poses (median of 100 plans: {random:.3f} mm). 90 % interval: " in first
    own = np.hypot(error, calibration["beyond_mm"])
    assert f"| this plan, with joint errors of all orders | {own:.3f} |" in page
    assert all(f"- {words}." in page for words in calibration["hidden"])


@pytest.mark.study
def test_the_plan_beats_random_and_greedy_ones_and_says_how_many_unknowns_there_are(calibration):
    assert 0.6 < calibration["certificate"]["efficiency"] <= 1
    row = next(row for row in calibration["curve"] if row["poses"] == READ)
    assert (
        calibration["error_mm"]["expected"] <= row["greedy_mm"] < calibration["random_plans"]["best_tenth_mm"]
    )
    assert all(row["greedy_mm"] < row["random_p10_mm"] for row in calibration["curve"])
    assert calibration["random_plans"]["best_tenth_mm"] < calibration["random_plans"]["median_mm"]
    counts = calibration["unknowns"]
    kinds = [counts[kind] for kind in ("frame", "mount", "geometry", "errors", "elastic")]
    assert kinds == [6, 3, 6 * 5, 2 * 6, 6]
    assert counts["seen"] <= sum(kinds) - 12  # those that are structural


@pytest.mark.study
def test_the_plan_is_read_back_and_simulated_in_two_readings_a_pose(absolute, calibration, tmp_path):
    cell = build_cell(UR10)
    q = read_poses(absolute / "plan.csv", cell.arm)
    assert (q == [row["q"] for row in calibration["plan"]]).all()
    assert find_collisions(cell.room, q) == [None] * READ
    rows = table(absolute / "plan.csv")
    assert [*rows[0]] == ["run", *angles(cell), "load_kg", "expected_sag_mm", *ERRORS]
    assert {float(row["load_kg"]) for row in rows} == {5.0}
    fine("simulate", UR10, absolute / "plan.csv", "--absolute", "--out", tmp_path / "read.csv")
    force = [float(row["force_z_N"]) for row in table(tmp_path / "read.csv")]
    assert np.reshape(force, (READ, 2)) == pytest.approx(np.tile([0, -5 * GRAVITY], (READ, 1)))


@pytest.mark.study
def test_a_plan_with_gauges_is_rehearsed_by_simulate(tmp_path, kr500):
    flags = ("--poses", 4, "--load", 460, "--candidates", 60, "--gauges", 2, "--out", tmp_path / "plan")
    fine("plan", ARM, "--task", TASKS, *flags)
    plan = tmp_path / "plan" / "plan.csv"
    assert plan.read_text().splitlines()[0].endswith(",way,gauges")
    assert "read by a tracker" in (tmp_path / "plan" / "plan.md").read_text()
    fine("simulate", ARM, plan, "--instrument", "planned", "--out", tmp_path / "data.csv")
    data = read_csv(tmp_path / "data.csv", kr500.arm)
    assert data.is_line_reading.sum(axis=1).tolist() == [2] * 4


@pytest.mark.study
def test_planned_touches_of_a_box_are_drawn_simulated_and_calibrated(tmp_path):
    """From the plan to the calibrated arm by the lines that the plan prints; no touch is lost."""
    box = ("z:1.9,0.3,0.6", "-x:2.3,0,1.4", "-y:1.5,1.2,1.4", "y:1.5,-1.2,1.4")
    faces = [word for face in box for word in ("--instrument", f"plane:P1:{face}:box")]
    few = ("--poses", 40, "--candidates", 160, "--load", 300, "--sling-m", 0.2, "--model", "Joints")
    out = tmp_path / "plan"
    words = fine("plan", ARM, "--absolute", "--orders", 0, *few, *faces, "--out", out)
    assert all(f"--instrument plane:P1:{face}:box" in words for face in box)
    rows = table(out / "plan.csv")
    assert list(rows[0])[-1] == "face"
    assert {row["face"] for row in rows} == {f"plane {k}" for k in range(1, 5)}
    assert "Visibility was not checked" not in (out / "plan.md").read_text()
    chunks = chunks_of(out / "recording.rrd")
    group = "/world/plan_in_the_order_of_measuring/faces"
    [names] = columns(chunks, f"{group}_names")["Points3D:labels"]
    assert list(names) == [f"plane {k}" for k in range(1, 5)]
    [corners] = columns(chunks, group)["Mesh3D:vertex_positions"]
    middle = np.reshape(corners, (4, 4, 3)).mean(axis=1)
    stated = [[float(x) for x in face.split(":")[1].split(",")] for face in box]
    np.testing.assert_allclose(middle, stated, atol=1e-6)
    readings, exact = tmp_path / "touches.csv", [word.replace(":box", ":box:10um") for word in faces]
    fine("simulate", ARM, out / "plan.csv", "--absolute", "--geometry-mm", 0.5, *exact, "--out", readings)
    read = table(readings)
    assert {row["series"] for row in read} == {f"plane {k}" for k in range(1, 5)}
    assert {row["series_frame"] for row in read} == {"touches box"}
    assert len(read) > 0.9 * 2 * 40  # the box is off its place, so that few touches are beside a face
    fine("calibrate", ARM, readings, "--out", tmp_path / "model")
    calibrated = json.loads((tmp_path / "model" / "report.json").read_text())
    assert calibrated["total_after"]["rms_mm"] < 0.1 < calibrated["total_before"]["rms_mm"]
