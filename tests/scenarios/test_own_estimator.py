"""Estimators of one's own beside ours: the page's example, bad ones, workers, resumed runs."""

import hashlib
import json
import os
import re
import subprocess
import sys
from contextlib import nullcontext, suppress
from pathlib import Path

import numpy as np
import pytest
from page_checks import check_winner
from run_here import ROOT, app_of_study, check_files, fine, here, is_refused, until

import testbench as tb
from testbench.errors import BenchError
from testbench.identify.prior import Prior
from testbench.model.structure import all153
from testbench.report.colours import look
from testbench.studies.bench import covariance
from testbench.workflows.own_estimator import (
    EstimatorSource,
    Limits,
    call_estimator,
    estimator_models,
    parameters_of,
)

APP = app_of_study("gravity_calibration")
PAGE = (ROOT / "docs" / "own_estimator.md").read_text()
EXAMPLE = re.search(r"`shrunk.py`:\n\n```python\n(.*?)```", PAGE, re.DOTALL)[1]
COMMAND = re.search(r"python (scenarios/.*?)\n", PAGE)[1]
LINE = re.search(r"`(A, y = .*?)`", PAGE)[1]
TIMEOUT = 6  #: Sound estimators take milliseconds; so long that a busy machine stops none of them [s].
BAD = """
import time

import numpy as np


def raises(kinematics, structure, data, prior):
    raise ValueError("no | *way*")


def blank(kinematics, structure, data, prior):
    return np.full(structure.n_parameters, np.nan)


def huge(kinematics, structure, data, prior):
    return np.full(structure.n_parameters, 1e300)


def nothing(kinematics, structure, data, prior):
    return None


def shape(kinematics, structure, data, prior):
    return np.zeros(3)


def askew(kinematics, structure, data, prior):
    C = np.array(prior.C_theta)
    C[0, 1] += 1e-3 * C[0, 0]
    return C


def sleeps(kinematics, structure, data, prior):
    time.sleep(600)


def eats(kinematics, structure, data, prior):
    kept = [np.zeros(2**25) for _ in range(64)]  # 16 GiB, of which nothing is touched
    return kept[0][: structure.n_parameters]


def few(kinematics, structure):
    return np.zeros(structure.n_parameters)
"""
WHY = {
    "raises": "raised ValueError: no | *way*",
    "blank": "expected finite numbers, got NaN or infinity",
    "huge": "expected compliances of at most 1 in SI units, got a larger one",
    "nothing": "expected an array, got None",
    "shape": "wrong shape: expected (153,) or (48, 48), got (3,)",
    "askew": "not symmetric: expected compliances that are their own transpose",
    "sleeps": f"too slow: stopped after {TIMEOUT} s",
    "eats": (
        "raised MemoryError: Unable to allocate 256. MiB for an array with shape (33554432,) "
        "and data type float64"
    ),
    "few": "raised TypeError: few() takes 2 positional arguments but 4 were given",
}
PAIRS = """
import time

import numpy as np


def both(*_):
    start = time.process_time()
    while time.process_time() - start < 0.2:
        pass
    return [1, 2], np.eye(2)


def half(*_):
    return np.ones(2), None
"""
LEAVES = """
import os
import subprocess
import time

import numpy as np

SLEEP = ["sleep", "LASTS"]


def child(*_):
    subprocess.Popen(SLEEP)
    return np.ones(1)


def slow(*_):
    child()
    time.sleep(600)


def dies(*_):
    child()
    os._exit(0)
"""
ASKS = """
from testbench.workflows.own_estimator import Limits, EstimatorSource, call_estimator

if __name__ == "__main__":
    call_estimator(EstimatorSource("slow", {file!r}, "slow", Limits(600.0)), (1, 2, 3, 4))
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    (folder / "bad.py").write_text(BAD)
    (folder / "shrunk.py").write_text(EXAMPLE)
    return folder


def flags(file, *names):
    return [part for name in names for part in ("--estimator", f"{file}:{name}")]


def example(files):
    """The page's own flag and estimator."""
    flag, asked = COMMAND.split()[-2:]
    return flag, asked.replace("=", f"={files}/")


@pytest.fixture(scope="module")
def run(files):
    """The page's example, whole, of one seed."""
    out = files / "whole"
    return out, here(APP, *example(files), "--quick", "--workers", 1, "--out", out)


@pytest.mark.study
def test_one_short_file_and_one_command_lead_to_a_row(files, run):
    """Pictures and recordings with one are looked at in tests/scenarios/test_own_estimator_studies.py."""
    assert len((files / "shrunk.py").read_text().splitlines()) <= 15
    check_files(run, "models.png", "eigenvalues.png", "residuals.png", "compliance.png")
    report = json.loads((run[0] / "report.json").read_text())
    [own] = [m for m in report["models"] if m["name"] == "shrunk"]
    assert (own["constraint"], own["prior"], own["parameters"]) == ("own", True, 153)
    assert own["rank"] == next(m for m in report["models"] if m["name"] == "ALL153 + prior")["rank"]
    assert f"{own['workspace']['rms_mm']:.3f}" in run[1].stdout
    assert "shrunk" in report["map"]["compared"]
    assert report["tables"]["models"]["looks"]["shrunk"]["colour"] == list(look("own 1", "own").colour)
    manifest = json.loads((run[0] / "manifest.json").read_text())
    assert manifest["estimators"]["shrunk"] == hashlib.sha256((files / "shrunk.py").read_bytes()).hexdigest()
    assert manifest["scenario"]["own"]["shrunk"]["sha256"] == manifest["estimators"]["shrunk"]  # for compare


def test_the_line_of_the_page_gives_the_equations():
    cell = tb.build_cell("kr500_l480")
    data = tb.simulate(cell, tb.Scenario(arm="kr500_l480"), seed=1).identification
    structure = tb.MODELS["MGCO56"](cell).structure
    given = {"tb": tb, "kinematics": cell.vjm, "structure": structure, "data": data}
    exec(LINE, given)
    pi = tb.least_squares(cell.vjm, structure, data).pi
    assert given["A"].shape == (given["y"].size, structure.n_parameters)
    off = given["A"].T @ (given["A"] @ pi - given["y"])  # least squares leave nothing along the columns
    assert np.abs(off).max() < 1e-9 * np.linalg.norm(given["A"]) * np.linalg.norm(given["y"])


@pytest.mark.study
def test_identify_shows_own_estimators_and_names_those_that_fail(files):
    data, out = files / "data.csv", files / "fit"
    poses = ROOT / "docs" / "poses.csv"
    fine("simulate", "kr500_l480", poses, "--out", data, "--payload-kg", 460.3)
    own = (*example(files), *flags(files / "bad.py", *WHY))
    held = ("--check-pose", 4, "--check-pose", 9, "--estimator-timeout", TIMEOUT)
    models = ("--model", "Joints", "--model", "ALL153")
    fine("identify", "kr500_l480", data, *models, *own, *held, "--out", out)
    report = json.loads((out / "report.json").read_text())
    names = [m["name"] for m in report["models"]]
    assert names == ["Joints + prior", "ALL153 + prior", "shrunk"]
    assert {m["name"]: m["status"] for m in report["failed"]} == {n: f"failed: {w}" for n, w in WHY.items()}
    assert not report["doubts"]
    shown = [row[0] for row in report["tables"]["models"]["rows"]]
    assert sorted(shown) == sorted([*names, *WHY])
    assert "residual_mm" in report["residuals"][0]
    assert "shrunk" in report["residuals"][0]["residual_mm"]
    flags_kept = json.loads((out / "manifest.json").read_text())["scenario"]["estimators"]
    assert flags_kept["few"]["sha256"] == hashlib.sha256((files / "bad.py").read_bytes()).hexdigest()
    check_winner(out)


@pytest.mark.parametrize(
    ("flag", "said"),
    [
        ("bad.py", "expected [NAME=]FILE.py:function"),
        ("{}/none.py:f", "none.py"),
        ("{}/bad.py:lacks", "bad.py: it has no function 'lacks'"),
        ("{}/broken.py:f", "broken.py: raised SyntaxError"),
        ("{}/exits.py:f", "exits.py: raised SystemExit: 3"),
        ("no_such_module:f", "no_such_module: raised ModuleNotFoundError"),
        ("MGCO56={}/bad.py:blank", "the name 'MGCO56' is taken"),
        ("a b={}/bad.py:blank", "expected a name of letters"),
    ],
)
@pytest.mark.attack
def test_what_cannot_be_imported_is_told_in_one_line_before_anything_is_done(files, tmp_path, flag, said):
    (files / "broken.py").write_text("def f(:\n")
    (files / "exits.py").write_text("raise SystemExit(3)\n")
    done = here(APP, "--quick", "--out", tmp_path / "out", "--estimator", flag.format(files))
    is_refused(done, said)
    assert not (tmp_path / "out").exists()


def test_a_worker_refuses_a_file_that_is_not_the_one_asked_for(files):
    own = EstimatorSource("blank", str(files / "bad.py"), "blank", Limits(5.0), sha256="0" * 64)
    with pytest.raises(BenchError, match="has changed since the run began"):
        estimator_models([own])


def test_an_answer_is_parameters_or_compliances_of_unknowns_alone():
    arm = tb.load_arm("kr500_l480")
    structure, C = all153(arm), tb.cad_prior(arm).C_theta
    pi = structure.parameters_of(C)
    np.testing.assert_array_equal(parameters_of(structure, pi), pi)
    np.testing.assert_array_equal(parameters_of(structure, np.array(C)), pi)
    coupled = np.array(C)
    coupled[0, 6] = coupled[6, 0] = 1e-12
    with pytest.raises(BenchError, match="expected 0 between"):
        parameters_of(structure, coupled)
    for entry, other in ((0, 4), (4, 0)):  # m/N beside rad/N: each on its own scale
        askew = np.array(C)
        askew[entry, other] += 1e-6 * np.sqrt(C[0, 0] * C[4, 4])
        with pytest.raises(BenchError, match="not symmetric"):
            parameters_of(structure, askew)


@pytest.mark.parametrize("value", [1e300, -1e300, 1e160, 1e101, 2.0])
def test_a_finite_number_that_no_arm_can_have_is_the_failure_of_its_entry(kr500, value):
    """Squares of the largest overflow; columns of trials hold numbers below 1e100."""
    structure = all153(kr500.arm)
    for found in (
        np.full(structure.n_parameters, value),
        structure.C_theta_of(np.full(structure.n_parameters, value)),
    ):
        with pytest.raises(BenchError, match="expected compliances of at most 1 in SI units"):
            parameters_of(structure, found)
    with pytest.raises(BenchError, match="covariance: expected at most 1 in SI units"):
        covariance(np.full((2, 2), abs(value)), 2)


def test_a_prediction_beyond_the_arm_is_a_failure_and_one_of_millimetres_is_none(kr500, files):
    data = tb.simulate(kr500, tb.Scenario(arm="kr500_l480"), seed=1).identification
    (files / "soft.py").write_text("def soft(k, s, d, p):\n    return 1e3 * s.parameters_of(p.C_theta)\n")
    digest = hashlib.sha256((files / "soft.py").read_bytes()).hexdigest()
    own = EstimatorSource("soft", str(files / "soft.py"), "soft", Limits(30.0), digest)
    for softer in (1.0, 1e-3):
        [model] = estimator_models([own])(kr500, Prior("drawn", softer * tb.cad_prior(kr500.arm).C_theta))
        beyond = pytest.raises(BenchError, match=r"predicts a deflection of .* m: the arm reaches")
        with beyond if softer == 1 else nullcontext():
            model.estimator(kr500.vjm, model.structure, data)


@pytest.mark.attack
def test_processes_that_a_call_leaves_are_ended_with_it_and_the_next_call_is_answered(files):
    lasts = f"600.{os.getpid()}"
    (files / "leaves.py").write_text(LEAVES.replace("LASTS", lasts))
    for name, fails in {"child": 0, "slow": 1, "dies": 1}.items():
        own = EstimatorSource(name, str(files / "leaves.py"), name, Limits(6.0 if name == "slow" else 30.0))
        with pytest.raises(BenchError) if fails else nullcontext():
            call_estimator(own, (1, 2, 3, 4))
        until(lambda: not sleeping(lasts))


@pytest.mark.attack
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_call_ends_with_the_process_that_asked_for_it(files):
    lasts = f"601.{os.getpid()}"
    (files / "leaves.py").write_text(LEAVES.replace("LASTS", lasts))
    words = [sys.executable, "-c", ASKS.format(file=str(files / "leaves.py"))]
    with subprocess.Popen(words) as asking:
        until(lambda: sleeping(lasts))
        asking.kill()
    until(lambda: not sleeping(lasts))


def sleeping(lasts):
    """Processes that sleep so long."""
    found = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has ended
            found += [file] * (file.read_bytes() == f"sleep\0{lasts}\0".encode())
    return found


def test_a_module_serves_as_well_as_a_file_and_nothing_is_left_beside_a_file(files):
    with pytest.raises(BenchError, match="raised TypeError"):
        call_estimator(EstimatorSource("m", "json", "loads", Limits(5.0)), (1, 2, 3, 4))
    assert not (files / "__pycache__").exists()


def test_a_second_array_is_the_covariance_and_processor_time_is_taken(files):
    (files / "pairs.py").write_text(PAIRS)
    answer = call_estimator(
        EstimatorSource("both", str(files / "pairs.py"), "both", Limits(30.0)), (1, 2, 3, 4)
    )
    with pytest.raises(BenchError, match="expected an array, got None"):
        call_estimator(EstimatorSource("half", str(files / "pairs.py"), "half", Limits(30.0)), (1, 2, 3, 4))
    np.testing.assert_array_equal(answer.values, [1, 2])
    np.testing.assert_array_equal(answer.covariance, np.eye(2))
    assert answer.cpu_seconds >= 0.2


def test_nine_own_estimators_are_told_apart():
    looks = [look(f"own {k}", "own", prior=True) for k in range(1, 10)]
    assert len({(own.colour, own.mark) for own in looks}) == 9
    assert len({own.colour for own in looks[:3]}) == 3
