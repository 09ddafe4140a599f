"""What comes after a run, from its manifest, perhaps a stranger's."""

import json

import pytest

from testbench.cli import program
from testbench.report.terminal import COMMANDS, MISSING, next_lines

PLAN = {"absolute": False, "loads_kg": [460.3], "model": "MGCO56", "uncertainty_percent": None}
ABSOLUTE = {"absolute": True, "loads_kg": [0.0, 5.0], "orientations": True, "gear_urad": 30.0}
ABSOLUTE |= {"geometry_mm": 1.5}
MEASURED, GIVEN = "../arms/a MEASURED.csv", "../arms/a a.csv 'b 2.csv' MEASURED.csv"
FROM_B = ABSOLUTE | {"given": ["b.csv"]}
AS_ASKED = "--absolute --gear-urad 30 --geometry-mm 1.5 --orientations --loads 0,5"


def run_of(folder, command, scenario=None, arm="my arm"):
    folder.mkdir(parents=True)
    about = {"command": command, "versions": {"testbench": "0"}, "scenario": scenario, "models": {arm: {}}}
    (folder / "manifest.json").write_text(json.dumps(about))
    return folder


def bare(lines):
    return [line.removeprefix("next").strip() for line in lines]


@pytest.mark.parametrize(
    ("command", "scenario", "expected"),
    [
        ("testbench plan", PLAN, "data check ../arms/a MEASURED.csv --out runs/data"),
        ("testbench plan", PLAN, f"identify {MEASURED} --model MGCO56 --no-prior --out runs/model"),
        ("testbench plan", ABSOLUTE, f"simulate ../arms/a runs/one/plan.csv {AS_ASKED} --out rehearsal.csv"),
        (
            "testbench plan",
            PLAN | {"gauges": 3},
            "simulate ../arms/a runs/one/plan.csv --instrument planned --out rehearsal.csv",
        ),
        ("testbench plan", ABSOLUTE | {"given": ["a.csv", "b 2.csv"]}, f"calibrate {GIVEN} --out runs/model"),
        ("testbench data check", {"data": "export.csv"}, "identify ../arms/a export.csv --out runs/model"),
        ("testbench identify", {}, "compensate runs/one PROGRAM.csv --out CORRECTED.csv"),
        ("testbench calibrate", {}, "calibrate runs/one READINGS.csv --score --frame-poses 50"),
        ("scenarios/regimes.py", {}, "compare runs/one OTHER_RUN"),
    ],
)
def test_the_next_command_is_filled_in(tmp_path, monkeypatch, command, scenario, expected):
    monkeypatch.chdir(tmp_path)
    run = run_of(tmp_path / "runs" / "one", command, scenario)
    lines = next_lines(run.relative_to(tmp_path), arm="../arms/a")
    assert f"testbench {expected}" in bare(lines)
    assert "/tmp" not in "".join(lines)


@pytest.mark.parametrize(
    ("scenario", "readings"),
    [
        (PLAN, "without and with the load"),
        (ABSOLUTE, "in the tracker's frame"),
        (ABSOLUTE | {"instruments": ["wire:P1:2.2,0,0.1"]}, "of the planned instruments"),
    ],
)
def test_a_plan_says_which_readings_it_needs(tmp_path, scenario, readings):
    lines = next_lines(run_of(tmp_path / "one", "testbench plan", scenario))
    assert lines[0].split(maxsplit=1) == ["needed", f"readings of all poses of plan.csv, {readings}"]


def test_a_run_without_a_given_arm_has_the_name_of_its_manifest(tmp_path):
    run = run_of(tmp_path / "one", "testbench check", arm="kr\x1b[31m {0}")
    (line,) = [own for own in next_lines(run) if own.startswith("next")]
    assert "\x1b" not in line
    assert "{0} --task" in line


@pytest.mark.parametrize(
    ("command", "scenario", "expected"),
    [
        ("testbench predict", {}, "compensate {}C PROGRAM.csv --out CORRECTED.csv"),
        ("testbench data check", {"data": "b.csv"}, "identify C {}b.csv --out runs/model"),
        ("testbench plan", FROM_B, "calibrate C {}b.csv MEASURED.csv --out runs/model"),
    ],
)
def test_what_a_run_names_is_sought_here_then_beside_it(tmp_path, monkeypatch, command, scenario, expected):
    monkeypatch.chdir(tmp_path)
    run = run_of(tmp_path / "runs" / "one", command, scenario, arm="C").relative_to(tmp_path)
    for where in ("runs/", ""):
        for name in ("C", "b.csv"):
            (tmp_path / where / name).touch()
        assert f"testbench {expected.format(where)}" in bare(next_lines(run))


def test_every_command_of_a_text_exists():
    texts = [text.split()[0] for own in COMMANDS.values() for text in own]
    assert {*texts} <= {*program.COMMANDS}
    assert {*MISSING} <= {*COMMANDS}


def test_of_other_folders_nothing_follows(tmp_path):
    (tmp_path / "manifest.json").write_text('{"command": 3}')
    assert next_lines(tmp_path) == []
