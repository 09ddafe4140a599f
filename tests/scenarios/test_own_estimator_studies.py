"""An estimator of one's own in every study that takes one: in table and picture, and counted where it fails.

Tables and pictures are those of page and recording: tests/scenarios/test_own_estimator.py looks at both.
"""

import json
import re
from contextlib import nullcontext
from unittest import mock

import numpy as np
import pytest
from made_up import of_one_trial
from matplotlib.text import Text
from pyarrow import parquet
from read_reports import read_report
from run_here import ROOT, app_of_study, here, numbers_alone
from test_compensation import less_work

from testbench.identify.method import paper_gco
from testbench.studies import find_study, planning
from testbench.studies.paper import six_dof_arm
from testbench.studies.planning import PlannedRow

MINE = """
import testbench as tb


def plain(kinematics, structure, data, prior):
    assert all(joint.compliance != joint.compliance for joint in kinematics.arm.joints)
    return tb.least_squares(kinematics, structure, data).pi


def never(kinematics, structure, data, prior):
    raise ValueError("not today")
"""
WITH = {
    "gravity_calibration": "workspace.rms_mm",
    "six_dof_arm": "workspace.rms_mm",
    "noise_sensitivity": "rms_um",
    "model_error": "rms_um",
    "which_model": "rms_um",
    "regimes": "rms_um",
    "instruments": "rms_um",
    "identifiability": "fit.rms_um",
    "compensation": None,
    "pose_selection": "tasks_mm",
}
"""Studies, and the column of the error that who failed has not; compensation has one a point."""
ALIKE = {"noise_sensitivity", "model_error", "which_model", "instruments", "gravity_calibration"}
"""Presets of one study: the others of them stand for these, and test_own_estimator.py runs the last one."""
ONE = {"regimes": ("--truth", "tubes")}
"""Flags of less to do."""


def first_poses(asked, k):
    """A plan that is ready at once: planning is tested elsewhere."""
    there, fit, criterion, poses = planning._jobs(asked)[k]
    q = tuple(np.ravel(there.scene.candidates[:poses]).tolist())
    own = {"ground": there.scope.ground.name, "fit": fit, "criterion": criterion, "poses": poses}
    return of_one_trial(PlannedRow, np.random.default_rng(1), q_rad=q, **own)


def one_order(cell, structure, data, *_):
    """All orders m alike: how they are found is tested elsewhere."""
    return 6 * [paper_gco(cell.vjm, structure, data)]


LESS = {
    "compensation": less_work,
    "pose_selection": lambda: mock.patch.object(planning, "_plan_row", first_poses),
    "six_dof_arm": lambda: mock.patch.object(six_dof_arm, "every_order", one_order),
}
"""Contexts in which what other tests ask is not done."""
WITHOUT = set("absolute_calibration bench loaded_stiffness real_ur10 single_link solver_comparison".split())
SCREEN = 45  #: Lines of a terminal of 100 columns.


def test_every_study_takes_estimators_or_has_no_place_for_them(monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    scripts = {file.stem for file in (ROOT / "scenarios").glob("*.py")}
    assert scripts == {*WITH} | WITHOUT
    for name in scripts:
        said = here(app_of_study(name), "--help").stdout
        assert bool(re.search(r"--estimator\s", said)) == (name in WITH), name
        assert len(said.splitlines()) <= SCREEN


@pytest.mark.study
@pytest.mark.parametrize("name", sorted({*WITH} - ALIKE))
def test_it_is_in_table_and_picture_and_a_failure_costs_nobody_else(tmp_path, name):
    (tmp_path / "mine.py").write_text(MINE)
    own = [part for one in ("plain", "never") for part in ("--estimator", f"{tmp_path}/mine.py:{one}")]
    own += ["--seeds", 1, "--workers", 1]
    out = tmp_path / "out"
    with LESS.get(name, nullcontext)(), numbers_alone():
        done = here(app_of_study(name), "--quick", *ONE.get(name, ()), *own, "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    report = json.loads((out / "report.json").read_text())
    assert report["failures"] == [
        {"name": "never", "seed": 1, "status": "failed: raised ValueError: not today"}
    ]
    assert "Failures" in done.stdout  # a table, beside the warning
    found, study = read_report(out / "report.json"), find_study(name)
    assert "plain" in found.whole()
    assert "plain" in done.stdout
    if name != "pose_selection":  # with one number of poses its picture is of one fit
        figures = study.figures(found).values()
        assert any("plain" in text.get_text() for own in figures for text in own.findobj(Text))
    assert {*json.loads((out / "manifest.json").read_text())["estimators"]} == {"plain", "never"}
    if column := WITH[name]:
        rows = parquet.read_table(out / "trials.parquet").to_pylist()
        lost = [row for row in rows if "failed: raised ValueError: not today" in row.values()]
        assert lost
        assert all(row[column] is None for row in lost)
