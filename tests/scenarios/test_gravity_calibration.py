"""The main job as a stranger runs it: its files, its contract, its manners."""

import json
import shutil
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from chromium import DESKTOP, IDLE, PHONE
from pyarrow import parquet
from run_here import app_of_study, check_files, held, here, numbers_alone, quick_study

from testbench.files.read_pairs import read_csv
from testbench.files.write import write_csv
from testbench.model.vjm import tool_poses
from testbench.studies import run
from testbench.studies.campaign.gravity_calibration import WITH_PRIOR, CalibrationSettings, calibrate, results
from testbench.workflows.campaign import Scenario
from testbench.workflows.cell import build_cell
from testbench.workflows.model_names import row_words

APP = app_of_study("gravity_calibration")
ROWS = 'table[data-table="0"] tbody tr'
CELLS = "rows => rows.map(row => [...row.cells].map(cell => cell.innerText))"
SCORES = ("rms_mm", "p95_mm", "max_mm", "p95_relative_percent", "max_relative_percent")
MODELS = {
    "Joints": 6, "MLS32": 32, "MLS56": 56, "MLS56, PSD of equal fit": 56, "MGCO47": 47, "MGCO56": 56,
    "MGCO68": 68, "Joints + prior": 6, "MLS56 + prior": 56, "MGCO56 + prior": 56, "MGCO68 + prior": 68,
    "ALL153 + prior": 153, "LS153 + prior": 153, "Ridge": 56, "Clipped LS": 56,
    "MGCO47 (paper)": 47, "MGCO56 (paper)": 56, "MGCO68 (paper)": 68,
}  # fmt: skip
quick, report, rows = quick_study(APP, "--seed", 3)


def test_a_run_leaves_the_files_of_the_contract_and_what_it_was_asked(quick, report):
    check_files(quick, "models.png", "eigenvalues.png", "residuals.png", "compliance.png")
    manifest = json.loads((quick[0] / "manifest.json").read_text())
    asked = manifest["scenario"]
    assert (asked["scenario"]["payload"], asked["true_arm"]) == (460.3, "family")
    assert set(manifest["versions"]) >= {"testbench", "mujoco", "pin", "clarabel"}
    assert set(manifest["models"]["kr500_l480"]) >= {"rigid.xml", "elastic.toml"}
    assert (manifest["seed"], bool(manifest["git"])) == (3, True)


@pytest.mark.parametrize("width", [PHONE, DESKTOP])
def test_the_page_shows_the_numbers_of_the_report_turns_the_arm_and_sorts(quick, report, open_page, width):
    shown = open_page(quick[0] / "report.html", width)
    page = shown.page
    heads = page.locator('table[data-table="0"] th').all_inner_texts()
    errs = heads.index("RMS workspace, true, mm")
    told = {row[0]: row for row in page.eval_on_selector_all(ROWS, CELLS)}
    models = {model["name"]: f"{model['workspace']['rms_mm']:.3f}" for model in report["models"]}
    assert {name: row[errs] for name, row in told.items()} == {name: models[name] for name in told}
    assert len(told) == 6
    for name in report["map"]["compared"]:
        panes = page.locator(".pane").all_inner_texts()
        [pane] = [text for text in panes if text.split("\n")[0] == row_words(name)]
        assert f"worst: {report['map']['worst'][name]['error_mm']:.3g} mm" in pane

    arm = page.locator("#scene canvas")
    before = arm.screenshot()
    arm.press("ArrowLeft")
    page.evaluate(IDLE)
    assert arm.screenshot() != before
    says = page.locator("#scene .says").first
    compared = report["map"]["compared"]
    first, last = (report["map"]["worst"][compared[k]]["place"] + 1 for k in (0, -1))
    assert not says.inner_text().startswith(f"Place {last} of")  # it opens at a typical place
    page.locator("#scene").get_by_role("button", name="worst").first.click()
    assert says.inner_text().startswith(f"Place {last} of")  # where the model to take errs most
    page.locator(".pane button").first.click()
    assert says.inner_text().startswith(f"Place {first} of")
    page.locator(".runs svg[role=img]").click()
    assert says.inner_text().startswith("Run ")

    page.locator("th", has_text="RMS workspace").first.click()
    errors = [float(row[errs]) for row in page.eval_on_selector_all(ROWS, CELLS)]
    assert errors == sorted(errors)
    assert shown.faults() == []


def test_report_has_the_contracts_keys(report):
    assert (report["scenario"], report["seed"]) == ("gravity_calibration", 3)
    assert {m["name"]: m["parameters"] for m in report["models"]} == MODELS
    for model in report["models"]:
        assert set(model["workspace"]) == set(model["check"]) == set(SCORES)
        assert model["status"] == "solved" or model["constraint"] == "free"
        assert model["prior"] == model["name"].endswith("prior")
        if not model["prior"] and model["name"] != "Joints":
            assert model["conservative"] == (model["constraint"] in ("psd", "clipped"))


def test_the_map_holds_every_models_error_pose_by_pose(report):
    """Of quick's 40 poses the root mean square is the error over the workspace; lengths have four digits."""
    found, models = report["map"], {m["name"]: m for m in report["models"]}
    for name, mm in found["error_mm"].items():
        assert len(mm) == len(found["q"]) == 40
        assert np.sqrt(np.mean(np.square(mm))) == pytest.approx(models[name]["workspace"]["rms_mm"], rel=1e-3)
    tool, _ = tool_poses(build_cell("kr500_l480").vjm, np.array(found["q"]))
    assert tool == pytest.approx(np.array(found["position_m"]), abs=2e-4)  # both are rounded


def test_reading_noise_is_no_error_of_a_model(report):
    """Errors against readings hold the noise of both readings in three axes, 122 um; true ones do not."""
    models = report["models"]
    variance = 2 * 0.05**2  # of a component [mm^2]; 18 points of three
    for model in models:
        own, true = model["check"]["rms_mm"], model["check_true"]["rms_mm"]
        # |e + n|^2 - |e|^2 = |n|^2 + 2 e n, in the mean of the points; 4 standard deviations of both terms
        deviation = np.sqrt((6 * variance**2 + 4 * variance * true**2) / 18)
        assert abs(own**2 - true**2 - 3 * variance) < 4 * deviation
    best = min(models, key=lambda m: m["check_true"]["rms_mm"])
    assert best["check"]["rms_mm"] > 1.5 * best["check_true"]["rms_mm"]


def test_the_dataset_is_that_of_section_6_and_of_the_seed_alone_byte_for_byte(quick, report, tmp_path):
    own = report["dataset"]
    assert (own["runs"], own["identification_points"], own["check_points"]) == (21, 45, 18)
    cell = build_cell("kr500_l480")
    data = read_csv(quick[0] / "dataset.csv", cell.arm)
    assert (len(np.unique(data.pose_id)), data.sigma) == (11, 50e-6)
    assert (data.wrench[:, 2] == -460.3 * 9.81).all()
    asked = CalibrationSettings("kr500_l480", Scenario(arm="kr500_l480", workspace_poses=1))
    write_csv(calibrate(cell, asked, 3)[1].measured, cell.arm, tmp_path / "dataset.csv")
    assert (tmp_path / "dataset.csv").read_bytes() == (quick[0] / "dataset.csv").read_bytes()


def test_every_prior_learns_how_wrong_it_is_and_is_that_of_the_folder():
    asked = CalibrationSettings("kr500_l480", Scenario(arm="kr500_l480", workspace_poses=1))
    true, campaign = calibrate(build_cell("kr500_l480"), asked, 4)
    filled = [own.weighted_prior for name, [own] in results(true, campaign).items() if name.endswith("prior")]
    assert len(filled) == len(WITH_PRIOR) + 1  # what the default is without its cone
    assert all(weighted_prior.learnt_scales for weighted_prior in filled)
    model = true.arm.links[2].compliance
    assert (model == build_cell("kr500_l480").arm.links[2].compliance).all()
    assert np.abs(true.plant.arm.links[2].compliance - model).max() > 0


def test_another_seed_beside_it_in_other_processes_changes_no_model_and_gives_a_spread(
    rows, report, tmp_path
):
    with numbers_alone():
        done = here(APP, "--seed", 3, "--seeds", 2, "--out", tmp_path, "--quick", "--workers", 2)
    assert done.returncode == 0, done.stderr
    beside = parquet.read_table(tmp_path / "trials.parquet").to_pylist()
    for a, b in zip(rows, [row for row in beside if row["seed"] == 3], strict=True):
        keys = ("name", "rank", "conservative")
        assert [a[key] for key in keys] == [b[key] for key in keys]
        # where the data or a prior hold a fit, a solver's last digits are far below a millionth
        held = a["prior"] or a["constraint"] == "none"
        groups = ("identification", "check", "check_true", "workspace") if held else ("identification",)
        for name in ("f_m", *(f"{group}.{score}" for group in groups for score in SCORES)):
            assert a[name] == pytest.approx(b[name], rel=1e-6)
    both = json.loads((tmp_path / "report.json").read_text())
    assert (both["seed"], len(both["true_arms"])) == ([3, 4], 2)
    for own, single in zip(both["models"], report["models"], strict=True):
        assert own["f_m"]["least"] < own["f_m"]["median"] < own["f_m"]["most"]
        assert single["f_m"] in (own["f_m"]["least"], own["f_m"]["most"])


def test_ctrl_c_at_the_last_moment_leaves_earlier_results_whole(quick, tmp_path):
    """Numbers and figures are written by then. The signal itself is sent in test_trial_engine.py."""
    out = shutil.copytree(quick[0], tmp_path / "out")
    asked = ("--seed", 3, "--out", out, "--quick", "--workers", 1, "--resume")
    with mock.patch.object(run, "write_page", side_effect=KeyboardInterrupt):
        done = here(APP, *asked)
    assert (done.returncode, done.stderr) == (130, "interrupted: earlier results are unchanged\n")
    assert held(tmp_path) == {Path(out.name, path): data for path, data in held(quick[0]).items()}
