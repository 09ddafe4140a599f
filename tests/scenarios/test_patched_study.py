"""A script that changes a study's models: workers that do not know it, and resumed runs, say so."""

import pytest
from run_here import here, numbers_alone

from testbench.campaign import perturbed_prior
from testbench.campaign.models import MODELS
from testbench.studies.gravity_calibration import trial
from testbench.studies.gravity_calibration.study import STUDY
from testbench.studies.run import app


def rows(monkeypatch):
    monkeypatch.setattr(trial, "WITHOUT_PRIOR", ("Joints", "MLS56", "MGCO47"))
    return "testbench.studies.gravity_calibration.trial"


def functions(monkeypatch):
    monkeypatch.setattr(trial, "named_models", lambda cell, names: [MODELS["Joints"](cell)])
    return "testbench.studies.gravity_calibration.trial"


def models(monkeypatch):
    monkeypatch.setitem(MODELS, "MGCO47", lambda cell: MODELS["MGCO56"](cell))
    return "testbench.campaign.model_selection"  # the first that has them


def another_module(monkeypatch):
    monkeypatch.setattr(perturbed_prior, "SHAPE", 0.4)
    return "testbench.campaign.perturbed_prior"


CHANGES = (rows, functions, models, another_module)
"""Each changes something, and says of which module."""


def study(out, *args):
    with numbers_alone():
        return here(app(STUDY), "--quick", "--out", out, *args)


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.study
def test_workers_that_do_not_know_what_a_script_changed_say_so(tmp_path, monkeypatch, change):
    name = change(monkeypatch)
    done = study(tmp_path / "out", "--seeds", 5, "--workers", 2)
    assert done.returncode == 2
    assert f"{name} was changed by a script, which a worker knows nothing of: --workers 1" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.study
def test_a_run_is_not_resumed_with_other_models(tmp_path, monkeypatch, change):
    out = tmp_path / "out"
    assert study(out, "--seeds", 1).returncode == 0
    name = change(monkeypatch)
    done = study(out, "--seeds", 2, "--resume")
    assert done.returncode == 2
    assert f"trials.parquet: {name}: the trials in this folder have" in done.stderr
    monkeypatch.undo()
    assert study(out, "--seeds", 2, "--resume").returncode == 0
