"""What `testbench identify` leaves beside its model: numbers that are those of the model, words, views."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from page_checks import check_page, drawn_in, layer_of, said, times_of
from run_here import check_folder, numbers_alone
from run_here import fine as run

import testbench as tb
from testbench.data.dataset import select_runs
from testbench.model.load import Load, first_order_deflection, one_step_theta
from testbench.model.vjm import evaluate_chain
from testbench.workflows.model_names import in_words

ROOT = Path(__file__).resolve().parents[2]
MODEL = {"model.json", "posterior.npz", "models.json", "rigid.xml", "elastic.toml"}
MODELS = ("--model", "Joints", "--model", "MGCO56", "--no-prior")


@pytest.fixture(scope="module")
def made(tmp_path_factory, legible):
    """Folder of a model, and what was said."""
    folder = tmp_path_factory.mktemp("identified")
    poses = ROOT / "docs" / "poses.csv"
    run("simulate", "kr500_l480", poses, "--out", folder / "data.csv", "--payload-kg", 460.3, "--seed", 3)
    flags = ("--check-pose", 4, "--check-pose", 9, "--out", folder / "fit")
    with legible():
        return folder / "fit", run("identify", "kr500_l480", folder / "data.csv", *MODELS, *flags)


@pytest.fixture(scope="module")
def report(made):
    return json.loads((made[0] / "report.json").read_text())


@pytest.fixture(scope="module")
def data(made):
    return tb.read_csv(made[0].parent / "data.csv", tb.load_arm("kr500_l480"))


def test_the_folder_is_whole_and_the_places_are_said(made):
    out, said = made
    check_folder(out, "identify.png", "model.png", "compliance.png", "error_map.png", *MODEL)
    for path in out.iterdir():
        hidden = ("posterior.npz", "rigid.xml", "elastic.toml", "manifest.json", "run.log")
        assert path.name in hidden or str(path) in said


def moved_by(fit, data):
    """Deflections by the compliances of models.json, not by the command's own arrays, (runs, m, 3) [m]."""
    cell = tb.build_cell("kr500_l480")
    at = evaluate_chain(cell.vjm, data.q)
    return first_order_deflection(
        at, one_step_theta(at, compliance(fit), data.wrench, data.point), cell.vjm.markers
    )


def compliance(fit):
    """C_theta of a model in models.json."""
    C = np.zeros((48, 48))
    for k, block in enumerate(fit["links"].values()):
        C[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = block
    C[range(42, 48), range(42, 48)] = [x or 0.0 for x in fit["joints"].values()]
    return C


def test_figures_have_the_residuals_and_the_signs_of_the_eigenvalues_of_the_models(made, report, data):
    fits = {fit["name"]: fit for fit in json.loads((made[0] / "models.json").read_text())["models"]}
    details = report["details"]
    assert [*details["eigenvalues"]][-1] == report["recommended"]
    for name, parts in details["eigenvalues"].items():
        blocks = [np.array(block) for block in fits[name]["links"].values()]
        for part, block in zip(parts, blocks, strict=False):
            own = np.linalg.eigvalsh(block)
            clear = np.abs(own) > 1e-9 * np.abs(own).max(initial=1e-30)
            assert sum(x < 0 for x in part["urad_per_Nm"]) == (own[clear] < 0).sum()  # Sylvester's inertia
    for row in details["residuals"]:
        left = 1e6 * (data.deflection - moved_by(fits[row["name"]], data))
        if not fits[row["name"]]["laws"]:
            assert (row["n"], row["mean_um"]) == (left.size, pytest.approx(left.mean(), abs=1e-3))
    over = {row["name"]: row["ratio"] for row in report["over"]}
    assert over[report["recommended"]] == 1.0


def test_residuals_are_readings_less_the_deflections_of_the_models(made, report, data):
    fits = json.loads((made[0] / "models.json").read_text())
    for fit in fits["models"]:
        moved = moved_by(fit, data)
        left = 1e3 * np.linalg.norm(data.deflection - moved, axis=2)
        found = [row["residual_mm"][fit["name"]] for row in report["residuals"]]
        np.testing.assert_allclose(found, left.max(axis=1), rtol=1e-9)
        size = 1e3 * np.linalg.norm(data.deflection, axis=2).max(axis=1)
        np.testing.assert_allclose([row["moved_mm"] for row in report["residuals"]], size)
        held = np.isin(data.pose_id, (4, 9))
        assert [row["held_back"] for row in report["residuals"]] == held.tolist()
        [row] = [m for m in report["models"] if m["name"] == fit["name"]]
        for key, runs in (("identification", ~held), ("check", held)):
            assert row[key]["rms_mm"] == pytest.approx(np.sqrt((left[runs] ** 2).mean()), rel=1e-9)


def test_without_runs_held_out_for_good_the_badge_is_of_poses_held_out_in_turn(made, data):
    """Poses are dealt out to eight groups; each is predicted by fits of the others, which are made here."""
    file, out = made[0].parent / "data.csv", made[0].parent / "all"
    models = ("--model", "Joints", "--model", "MLS56", "--no-prior")
    with numbers_alone():
        run("identify", "kr500_l480", file, *models, "--no-intervals", "--out", out)
    badge, cell = json.loads((out / "report.json").read_text())["badge"], tb.build_cell("kr500_l480")
    group, left = np.arange(data.n_runs) % 8, {}
    for name in models[1::2]:
        model, left[name] = tb.MODELS[name](cell), []
        for k in range(8):
            fit = model.estimator(cell.vjm, model.structure, select_runs(data, group != k))
            off = tb.deflections(cell.vjm, fit, select_runs(data, group == k)) - data.deflection[group == k]
            left[name].append((off**2).mean())
    factor = np.sqrt(np.sum(left[badge["rival"]]) / np.sum(left[badge["winner"]]))
    assert badge["factor"] == pytest.approx(factor, rel=1e-4)
    assert (badge["n"], badge["each"]) == (8, "group of fitted runs held out in turn")


def test_the_map_is_what_the_models_say_of_its_poses_and_the_worst_is_named(made, report, data):
    found, errors, model = report["map"], report["map"]["errors"], tb.load_model(made[0])
    k = int(np.linalg.norm(data.wrench, axis=1).argmax())
    load = Load(data.wrench[k], data.point[k])
    moved = tb.predict(model, np.array(errors["q"]), [load])
    half, taken = 1e3 * moved.largest_half_width[:, 0], report["recommended"]
    rounded = {"rtol": 2e-3}  # joints are kept to 1e-5 rad, lengths in four digits
    np.testing.assert_allclose(errors["error_mm"][taken], half, **rounded)
    np.testing.assert_allclose(errors["deflection_mm"], 1e3 * moved.deflection_length[:, 0], **rounded)
    worst = errors["worst"][taken]
    assert worst["error_mm"] == max(errors["error_mm"][taken]) == errors["error_mm"][taken][worst["place"]]
    assert found["median_mm"] == pytest.approx(np.median(half), **{"rel": 2e-3})
    assert (found["places"], found["without_bound"]) == (200, 0)
    page = (made[0] / "report.md").read_text()
    x, y, z = worst["position_m"]
    [row] = [line for line in page.splitlines() if f"| {x:.2f}, {y:.2f}, {z:.2f} |" in line]
    assert row.replace("**", "").startswith(
        f"| {taken} | {found['median_mm']:.3f} | {worst['error_mm']:.3f} | 0 |"
    )


def test_other_models_stand_beside_the_one_to_take_with_how_far_apart_they_are(made, report, data):
    """Linear in the load: the tangent compliance of Eq. (7) differs by a few per cent."""
    cell, errors = tb.build_cell("kr500_l480"), report["map"]["errors"]
    taken = report["recommended"]
    others = set(report["map"]["apart_mm"])
    assert others | {taken} == set(errors["error_mm"]) == {m["name"] for m in report["models"]}
    k = int(np.linalg.norm(data.wrench, axis=1).argmax())
    at = evaluate_chain(cell.vjm, np.array(errors["q"]))
    tool = {}
    for fit in json.loads((made[0] / "models.json").read_text())["models"]:
        wrench, point = (np.tile(one[k], (200, 1)) for one in (data.wrench, data.point))
        bent = one_step_theta(at, compliance(fit), wrench, point)
        tool[fit["name"]] = first_order_deflection(at, bent, np.zeros((1, 3)))[:, 0]
    for name in others:
        apart = 1e3 * np.linalg.norm(tool[name] - tool[taken], axis=1)
        np.testing.assert_allclose(report["map"]["apart_mm"][name], apart, rtol=0.1, atol=0.02)


def test_an_arm_whose_masses_only_mujoco_knows_has_a_model_without_own_weight(tmp_path):
    arm = shutil.copytree(ROOT / "models" / "arm_6r", tmp_path / "light")
    text = (arm / "rigid.xml").read_text()
    (arm / "rigid.xml").write_text(text.replace('inertiafromgeom="false"', 'inertiafromgeom="true"'))
    names = ",".join(f"joint_{k}_deg" for k in range(1, 7))
    (tmp_path / "poses.csv").write_text(names + 5 * "\n0,-90,90,0,20,0" + "\n")
    run("simulate", arm, tmp_path / "poses.csv", "--payload-kg", 20, "--out", tmp_path / "data.csv")
    flags = ("--model", "Joints", "--no-intervals", "--out", tmp_path / "m")
    with numbers_alone():
        run("identify", arm, tmp_path / "data.csv", *flags)
    model = tb.load_model(tmp_path / "m", arm)
    assert not model.state.body_masses.mass.any()
    assert any(doubt.startswith("Own weight is left out: ") for doubt in model.origin.warnings)


def test_the_page_shows_the_models_the_runs_and_the_arm_in_the_worst_of_them(
    made, report, open_page, blank_panes
):
    assert blank_panes(made[0] / "recording.rrd") == []
    told = [f"{model['check']['rms_mm']:.3f}" for model in report["models"]]
    told += [f"{row['taken_mm']:.3f}" for row in report["residuals"]]
    shown = check_page(open_page, made[0] / "report.html", told)
    worst = max(report["residuals"], key=lambda row: row["taken_mm"])
    shown.page.locator("#scene").get_by_role("button", name="worst").first.click()
    assert said(shown).startswith(f"Run {worst['run']}")
    errors = report["map"]["errors"]
    half = [errors["worst"][name]["error_mm"] for name in errors["compared"]]
    assert shown.page.locator("#map button").all_inner_texts() == [f"worst: {mm:.3g} mm" for mm in half]


def test_what_the_page_draws_are_the_models_and_the_numbers_of_the_report(made, report, data):
    """Arrows lead from where one target was read to where each model has it; numbers are in millimetres."""
    drawn = drawn_in(made[0] / "report.html")
    runs = drawn["scene"]["groups"][0]
    M, A = times_of(drawn["scene"]["title"])
    fits = {fit["name"]: fit for fit in json.loads((made[0] / "models.json").read_text())["models"]}
    shown = [line["name"] for line in drawn["runs"][0]["lines"]]
    order = [data.run_id.tolist().index(int(label)) for label in drawn["runs"][0]["labels"]]
    assert [re.match(r"Run (\d+)", name)[1] for name in runs["names"]] == drawn["runs"][0]["labels"]
    read = data.before[order] + M * data.deflection[order]
    before, after = layer_of(runs, "deflection as read")
    np.testing.assert_allclose(before, data.before[order], atol=1e-4)
    np.testing.assert_allclose(after, read, atol=1e-4)
    off = {name: moved_by(fits[name], data)[order] - data.deflection[order] for name in shown}
    one = np.linalg.norm(off[report["recommended"]], axis=2).argmax(axis=1)  # the target of its largest error
    runs_of = np.arange(len(order))
    for name, line in zip(shown, drawn["runs"][0]["lines"], strict=True):
        start, end = layer_of(runs, f"error of {in_words(name)}")
        np.testing.assert_allclose(start[:, 0], read[runs_of, one], atol=1e-4)
        np.testing.assert_allclose((end - start)[:, 0] / A, off[name][runs_of, one], atol=2e-4 / A)
        left = [report["residuals"][k]["residual_mm"][name] for k in order]
        np.testing.assert_allclose(line["values"], left, rtol=1e-3)
    errors = report["map"]["errors"]
    np.testing.assert_allclose(drawn["map"]["at"], errors["position_m"], atol=1e-3)
    for line in drawn["map"]["lines"]:
        np.testing.assert_allclose(line["values"], errors["error_mm"][line["name"]], rtol=1e-3)
