"""The study of the default method as a stranger runs it: its files, its contract, its claims."""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from run_here import app_of, here

from testbench.bench.campaign import draw_poses, simulate_at
from testbench.bench.truths import TRUTHS, true_cell
from testbench.bench.wrong_prior import PRIORS
from testbench.studies.which_model.trial import POSES, RUNS, Settings, pairs, read, scenario

ROOT = Path(__file__).resolve().parents[2]
APP = app_of(ROOT / "scenarios" / "which_model.py")
FILES = {
    "dataset.csv", "report.json", "report.md", "manifest.json", "which_model.png", "recording.rrd",
    "trials.parquet",
}  # fmt: skip
SEEDS = range(2, 4)
METHODS = 10


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick")
    done = here(APP, "--seed", 2, "--seeds", len(SEEDS), "--out", out, "--quick", "--workers", 1)
    assert done.returncode == 0, done.stderr
    return out, done


@pytest.fixture(scope="module")
def report(quick):
    return json.loads((quick[0] / "report.json").read_text())


@pytest.fixture(scope="module")
def rows(quick):
    return pq.read_table(quick[0] / "trials.parquet").to_pylist()


def errors(rows, **wanted):
    """Workspace errors by seed, truth and number of poses, of one method."""
    return {
        (row["seed"], row["case.truth"], row["poses"]): row["workspace_mm"]
        for row in rows
        if all(row[key] == value for key, value in wanted.items())
    }


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    out, done = quick
    assert {p.name for p in out.iterdir()} == FILES
    assert done.stderr == ""
    for name in FILES - {"manifest.json"}:
        assert str(out / name) in done.stdout


def test_over_as_many_trials_as_priors_every_truth_meets_every_prior_once():
    for first in (0, 1000, 1003):
        met = [pair for seed in range(first, first + len(PRIORS)) for pair in pairs(seed)]
        assert sorted(met) == sorted(product(TRUTHS, PRIORS))
    assert all([truth for truth, _ in pairs(seed)] == list(TRUTHS) for seed in range(6))


def test_every_method_is_tried_in_every_case(rows):
    assert len(rows) == len(SEEDS) * len(TRUTHS) * len(POSES) * METHODS
    cases = {(r["seed"], r["case.truth"], r["case.prior"]) for r in rows}
    assert cases == {(seed, *pair) for seed in SEEDS for pair in pairs(seed)}
    assert all(r["solved"] and r["conservative"] for r in rows if r["constraint"] == "psd")
    assert {r["filled"] for r in rows if r["method"].endswith(" + prior")} == {True}


def test_fewer_poses_are_the_first_of_the_same_readings(kr500):
    asked = Settings("kr500_l480", workspace=1)
    poses = draw_poses(kr500, scenario(asked), 2)
    campaign = simulate_at(true_cell(kr500, "cast", 2), scenario(asked), 2, poses)
    data = read(campaign)
    for own, count in zip(data, POSES, strict=True):
        assert own.runs == RUNS * count
        assert set(own.pose) == set(range(1, count + 1))
        np.testing.assert_array_equal(own.after, data[-1].after[: own.runs])
    assert not set(campaign.check.pose) & set(data[-1].pose)
    noise = data[-1].deflection - campaign.identification.deflection
    assert np.std(noise) == pytest.approx(np.sqrt(2) * 50e-6, rel=0.1)  # 360 components: 4 % standard error
    assert campaign.truth.sigma == asked.sigma


def test_the_report_is_made_of_the_rows(report, rows):
    joints = errors(rows, method="Joints")
    for own in report["family"]:
        found = {k: v for k, v in errors(rows, method=own["method"]).items() if k[2] == own["poses"]}
        over = np.array([v / joints[k] for k, v in found.items()])
        assert own["cases"] == len(found) == len(SEEDS) * len(TRUTHS)
        assert own["workspace_mm"]["median"] == pytest.approx(np.median(list(found.values())))
        assert own["over_joints"]["median"] == pytest.approx(np.median(over))
        assert own["loses"] == pytest.approx(np.mean(over > 1.05))
    assert sum(m["cases"] for m in report["cells"]) == sum(m["cases"] for m in report["family"])


def test_the_folder_is_wrong_for_every_truth_but_its_own(report):
    by_name = {t["truth"]: t for t in report["truths"]}
    own = by_name.pop("tubes")
    assert own["off_tubes"]["median"] < 1e-9
    assert all(t["cad_mm"]["median"] > 2 * own["cad_mm"]["median"] for t in by_name.values())
    off = [by_name[name]["off_tubes"]["median"] for name in ("off_10", "off_20", "off_40")]
    assert off == sorted(off)
    assert off[0] > 0.1


@pytest.mark.parametrize(("flags", "said"), [(["--arm", "x"], "folder"), (["--poses", "9"], "poses")])
def test_wrong_flags_are_one_line_and_exit_2(tmp_path, flags, said):
    done = here(APP, "--quick", "--out", tmp_path / "out", *flags)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()
