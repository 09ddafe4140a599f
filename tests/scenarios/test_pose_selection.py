"""The study of pose selection as a stranger runs it: its files, its contract, its claims."""

import shutil
from pathlib import Path
from unittest import mock

from run_here import app_of, check_files, here, numbers_alone, quick_study

from testbench.report.schema import TRUE_ARM_LABELS
from testbench.studies import planning

ROOT = Path(__file__).resolve().parents[2]
APP = app_of(ROOT / "scenarios" / "pose_selection.py")
FLAGS = ("--seed", 2, "--seeds", 1)
quick, report, _ = quick_study(APP, *FLAGS)


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    assert (quick[0] / "prepared").is_dir()
    check_files(quick, "pose_selection.png")


def test_every_plan_is_printed_with_its_certificate(report):
    assert {(p["criterion"], p["poses"]) for p in report["plans"]} == {("test", 9), ("D", 9)}
    for plan in report["plans"]:
        assert 50 < plan["efficiency_percent"] <= 100
        assert plan["observability"]["seen"] == min(49, 6 * plan["poses"])


def test_what_was_promised_is_tried_on_both_grounds_and_joints_alone_beside(report):
    first = report["kept"][0]
    assert (first["promised"], first["count"], report["kept_joints"]["count"]) == ("all", 4, 4)
    # seed 2: links 20 % off tubes, a prior that is right but for its scale
    truth = f"truth: {TRUE_ARM_LABELS['off_20']}"
    assert {own["promised"] for own in report["kept"]} > {truth, "poses: planned", "poses: random"}
    assert first["inside_95"] > 0.9
    assert 0.3 < first["over_promised"]["median"] < 1.5


def test_a_finished_run_is_resumed_without_planning_again(quick, tmp_path):
    out = shutil.copytree(quick[0], tmp_path / "out")
    with mock.patch.object(planning, "make_plan", side_effect=AssertionError), numbers_alone():
        done = here(APP, *FLAGS, "--out", out, "--quick", "--workers", 1, "--resume")
    assert done.returncode == 0, done.stderr
    ours, theirs = ((folder / "report.json").read_text() for folder in (out, quick[0]))
    assert ours == theirs
