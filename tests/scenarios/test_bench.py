"""The bench as a stranger runs it: one file, bad entries, workers, resumed runs, frozen tasks."""

import hashlib
import json

import numpy as np
import pytest
from pyarrow import parquet
from run_here import ROOT, check_files, do, fine, numbers_alone
from test_own_estimator import BAD, EXAMPLE, PAGE, WHY

import testbench as tb
from testbench.studies.bench import FLOORS, TASKS, problem, read_entries
from testbench.workflows.cell import build_cell
from testbench.workflows.models import without_compliances
from testbench.workflows.own_estimator import Limits, call_estimator

ENTRIES = sorted((ROOT / "entries").glob("*.py"))
TOLD = {name: WHY[name] for name in ("raises", "huge", "shape", "eats", "few")}
"""Bad ones that do not wait; how each kind is told is asked in test_own_estimator.py."""
DRAWS = '''
import numpy as np


def estimate(kinematics, structure, data, prior):
    """Draws from the global generator, keeps state, and fails in some arms."""
    if prior is None:
        raise NotImplementedError("needs a prior")
    estimate.calls = getattr(estimate, "calls", 0) + 1
    if data.deflection[0, 0, 0] * 1e6 % 2 < 1:
        raise RuntimeError("odd")
    pi = structure.parameters_of(prior.C_theta) * (1 + np.random.uniform() + estimate.calls) / 4
    return pi, np.diag((0.3 * pi) ** 2)
'''
FROZEN = {
    "gravity-8": (1, "off_40", 561.1843, 6.729526, 2.863578),
    "gravity-12": (1, "off_40", 701.8159, 6.147792, 2.631999),
    "gravity-20": (1, "off_40", 916.7116, 6.253121, 2.651842),
    "loads": (1, "off_40", 493.5155, 6.729526, 2.863578),
    "section-5-2": (1, "off_40", 6430.079, 25.89255, 13.09915),
    "disturbed": (1, "off_40", 625.9618, 6.147792, 2.382489),
    "frame": (1, "off_40", 2741.171, 6.1478, 2.631999),
    "stations": (1, "off_40", 2237.785, 6.15007, 2.382489),
    "other-arms": (1, "soft_link", 724.9501, 6.147792, 2.734013),
    "ur10": (2, "ur10", 16.61840, 0.3162947, 0),
    "wrong-prior": (1, "off_40", 701.8159, 5.69154, 2.631999),
}
"""With seed 3: version, true arm; sizes of readings [1], of what the prior predicts and of the truth [mm]."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    (folder / "shrunk.py").write_text(EXAMPLE)
    (folder / "bad.py").write_text(BAD)
    (folder / "draws.py").write_text(DRAWS)
    return folder


@pytest.fixture(scope="module")
def run(folder):
    """The page's file beside bad ones, in two tasks of two arms."""
    bad = [f"{name}={folder / 'bad.py'}:{name}" for name in TOLD]
    asked = (folder / "shrunk.py", *bad, "--quick", "--workers", 1)
    return folder / "run", do("bench", *asked, "--out", folder / "run")


def test_one_short_file_and_one_command_lead_to_a_row(run):
    assert "testbench bench shrunk.py" in PAGE
    assert len(EXAMPLE.splitlines()) <= 15
    check_files(run, "bench.png", "time.png")
    report = json.loads((run[0] / "report.json").read_text())
    board = {row["name"]: row for row in report["board"]["with prior"]}
    assert {"shrunk", "default", *FLOORS} <= board.keys()
    assert board["shrunk"]["failed"] is None
    assert 0 < board["shrunk"]["ratio_low"] <= board["shrunk"]["ratio"] <= board["shrunk"]["ratio_high"]
    assert "shrunk" not in {row["name"] for row in report["board"]["without prior"]}
    manifest = json.loads((run[0] / "manifest.json").read_text())
    assert manifest["estimators"]["shrunk"] == hashlib.sha256(EXAMPLE.encode()).hexdigest()


def test_bad_entries_leave_a_complete_table_with_named_failures(run):
    rows = parquet.read_table(run[0] / "trials.parquet").to_pylist()
    given = {(row["task"], row["prior"], row["seed"]) for row in rows}
    assert len(given) == 2 * 2 * 2
    names = {"shrunk", *FLOORS, *TOLD}
    assert {(r["name"], *key) for r in rows for key in [(r["task"], r["prior"], r["seed"])]} == {
        (name, *key) for name in names for key in given
    } | {("default", *key) for key in given if key[1]}
    told = {row["name"]: row["status"] for row in rows if row["prior"] and row["name"] in TOLD}
    assert told == {name: f"failed: {why}" for name, why in TOLD.items()}
    report = json.loads((run[0] / "report.json").read_text())
    board = {row["name"]: row for row in report["board"]["with prior"]}
    assert all(board[name]["failed"] == "4 of 4" for name in TOLD)
    counted = {row["name"]: row["count"] for row in report["failures"] if row["given"] == "with prior"}
    assert counted == dict.fromkeys(TOLD, 4)
    assert all(board[name]["failed"] is None for name in ("default", *FLOORS))


def test_workers_and_a_resumed_run_find_the_same(folder):
    asked, found = (folder / "draws.py", "--task", "frame", "--task", "section-5-2"), []
    for name, workers, seeds in (("one", 1, 3), ("again", 2, 2), ("again", 1, 3)):
        resumed = ("--resume",) if (name, seeds) == ("again", 3) else ()
        with numbers_alone():
            fine("bench", *asked, "--seeds", seeds, "--workers", workers, "--out", folder / name, *resumed)
        table = parquet.read_table(folder / name / "trials.parquet").to_pylist()
        found.append([{k: v for k, v in row.items() if k != "cpu_seconds"} for row in table])
    assert [row for row in found[0] if row["seed"] < 3] == found[1]
    assert found[0] == found[2]
    own = [row for row in found[0] if row["name"] == "draws" and row["prior"]]
    assert {row["status"] for row in own} == {"done", "failed: raised RuntimeError: odd"}
    assert all(row["cover.half_mm"] > 0 for row in own if row["status"] == "done")
    assert {r["status"] for r in found[0] if r["name"] == "draws" and not r["prior"]} == {
        "skipped: needs a prior"
    }


@pytest.mark.parametrize("name", TASKS)
def test_a_task_is_what_it_was_under_its_version(name, kr500):
    """To the digits that processors share: who changes a task counts its version up."""
    task = TASKS[name]
    cell = kr500 if task.arm == "kr500_l480" else build_cell(ROOT / "models" / task.arm)
    own = problem(task, cell, 3)
    _, y = tb.reduce(own.cell.vjm, own.structure, own.data).weighted_equations
    moved = own.predict(own.structure.parameters_of(own.prior.C_theta))
    version, arm, *sizes = FROZEN[name]
    assert (task.version, own.true_arm) == (version, arm)
    found = (np.linalg.norm(y), *(1e3 * np.sqrt((part**2).mean()) for part in (moved, own.true)))
    learnt = name == "ur10"  # last digits decide where learning the sizes of its errors stops
    assert found == pytest.approx(sizes, rel=0.05 if learnt else 1e-4)


def test_every_entry_of_ours_is_short_and_answers(kr500):
    assert len(ENTRIES) >= 14
    assert max(len(file.read_text().splitlines()) for file in ENTRIES) <= 40
    own = problem(TASKS["gravity-12"], kr500, 4)
    entries = read_entries([*map(str, ENTRIES)], Limits())
    assert len(entries) == len(ENTRIES)
    for entry in entries:
        given = (without_compliances(own.cell.vjm), own.structure, own.data, own.prior)
        assert np.isfinite(call_estimator(entry, given).values).all()
