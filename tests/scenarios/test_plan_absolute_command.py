"""`testbench plan --absolute`: from an arm to poses, their promise, and on to simulated readings."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from page_checks import check_page, said

from testbench.arm.mjcf import GRAVITY
from testbench.bench.campaign import build_cell
from testbench.cli.program import program
from testbench.data.posefile import absolute_columns, read_poses
from testbench.plant import collisions
from testbench.shell import command

ROOT = Path(__file__).resolve().parents[2]
ARM = ROOT / "models" / "ur10"
POSES = 14
FLAGS = ["--absolute", "--model", "Joints", "--orders", 1, "--poses", POSES, "--candidates", 60]
FLAGS += ["--load", 5, "--tracker", "2.5,-1.5,1.2", "--seed", 3]
FILES = "error_map.png manifest.json plan.csv plan.json plan.md plan.png recording.rrd report.html".split()


def run(*args):
    """The command in this process: exit code and what it says of an error."""
    said = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["testbench", *map(str, args)])
        code = command.run(program(args[:1]), fail=said.append)
    return code, "".join(said)


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    out = tmp_path_factory.mktemp("plan") / "first"
    code, said = run("plan", ARM, *FLAGS, "--out", out)
    assert code == 0, said
    return out


@pytest.fixture(scope="module")
def report(planned):
    return json.loads((planned / "plan.json").read_text())


def test_a_plan_is_seven_files_with_the_answer_first(planned, report):
    assert sorted(p.name for p in planned.iterdir()) == FILES
    asked = json.loads((planned / "manifest.json").read_text())["scenario"]
    assert (asked["absolute"], asked["loads_kg"], asked["orders"]) == (True, [5.0], 1)
    title, _, first, *_ = (planned / "plan.md").read_text().splitlines()
    assert title == "# Plan of absolute readings: ur10, Joints, own weight, then 5 kg"
    error, random = report["error_mm"]["expected"], report["random_mm"]["median_mm"]
    assert f"{error:.3f} mm (90 %: " in first
    assert f"random poses {random:.3f} mm" in first
    assert all(f"- {words}." in (planned / "plan.md").read_text() for words in report["hidden"])


def test_no_pane_of_the_recording_is_blank_on_any_timeline(planned, blank_panes):
    assert blank_panes(planned / "recording.rrd") == []


def test_the_plan_beats_random_and_greedy_ones_and_says_how_many_unknowns_there_are(report):
    assert 0.6 < report["efficiency"] <= 1
    row = next(row for row in report["curve"] if row["poses"] == POSES)
    assert report["error_mm"]["expected"] <= row["greedy_mm"] < report["random_mm"]["p10_mm"]
    assert all(row["greedy_mm"] < row["random_p10_mm"] for row in report["curve"])
    counts = report["unknowns"]
    kinds = [counts[kind] for kind in ("frame", "mount", "geometry", "errors", "elastic")]
    assert kinds == [6, 3, 6 * 5, 2 * 6, 6]
    assert counts["seen"] <= sum(kinds) - 12  # those that are structural


def test_the_plan_is_read_back_and_simulated_in_two_readings_a_pose(planned, report, tmp_path):
    cell = build_cell(ARM)
    q = read_poses(planned / "plan.csv", cell.arm)
    assert (q == [row["q"] for row in report["plan"]]).all()
    assert collisions(cell.room, q) == [None] * POSES
    with (planned / "plan.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == absolute_columns(cell.arm.joints, loaded=True)
    assert {float(row["load_kg"]) for row in rows} == {5.0}
    code, said = run("simulate", ARM, planned / "plan.csv", "--absolute", "--out", tmp_path / "read.csv")
    assert code == 0, said
    with (tmp_path / "read.csv").open() as file:
        force = [float(row["force_z_N"]) for row in csv.DictReader(file)]
    assert np.reshape(force, (POSES, 2)) == pytest.approx(np.tile([0, -5 * GRAVITY], (POSES, 1)))


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--absolute", "--task", "tasks.csv"], "--task: expected no --absolute with it"),
        ([], "--task: expected a CSV of tasks, or --absolute"),
        (["--task", "tasks.csv", "--orders", 2], "--orders: expected --absolute with it"),
        (
            ["--absolute", "--criterion", "test"],
            "no criterion 'test' of absolute readings; criteria are I, G",
        ),
        (["--absolute", "--gear-urad", 0], "--gear-urad: expected 1e-06 to 100000, got 0"),
    ],
)
def test_flags_that_do_not_fit_are_one_line(flags, said, tmp_path):
    code, error = run("plan", ARM, *flags, "--out", tmp_path / "plan")
    assert code == 2
    assert error.startswith(f"error: {said}")
    assert error.count("\n") == 1


def test_the_page_shows_the_poses_and_where_the_arm_will_err(planned, report, open_page):
    ends = [(row["expected_error_mm"], row["expected_error_p05_mm"]) for row in report["plan"]]
    told = [f"{mm:.3f} ({low:.3f} to" for mm, low in ends]
    shown = check_page(open_page, planned / "report.html", told)
    shown.page.locator("#map button").click()
    assert said(shown).startswith("Place ")
