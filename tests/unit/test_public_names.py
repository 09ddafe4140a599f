"""`import testbench as tb`: what a user writes, and what it costs."""

import ast
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import testbench as tb

ROOT = Path(__file__).resolve().parents[2]
HEAVY = {"mujoco", "pinocchio", "rerun", "matplotlib", "scipy", "numpy"}


def test_a_type_checker_sees_the_same_names():
    tree = ast.parse(Path(tb.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    typed = {alias.asname: node.module for node in block.body for alias in node.names}
    assert typed == {name: f"testbench.{home}" for name, home in tb.HOMES.items()}


def test_importing_the_package_imports_nothing_heavy():
    code = "import sys, testbench; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not HEAVY & set(done.stdout.split())
    with pytest.raises(AttributeError, match=r"no attribute 'least_square'; names are .*least_squares"):
        _ = tb.least_square


@pytest.fixture(scope="module")
def cell():
    return tb.build_cell("kr500_l480")


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        (lambda _: tb.MODELS["GCO56"], "no model 'GCO56'; models are .*MGCO56"),
        (lambda cell: tb.MODELS["MGCO56"](cell.arm), "cell: expected Cell, got Arm"),
        (lambda cell: tb.MODELS["MLS32"](cell.vjm), "cell: expected Cell, got Vjm"),
        (lambda cell: tb.true_cell(cell.arm, "cast", 1), "cell: expected Cell, got Arm"),
        (
            lambda _: tb.Scenario(arm="kr500_l480", payload=-1),
            r"^Scenario: payload: expected .*, got -1 \(SI units\)",
        ),
        (
            lambda _: tb.Scenario(arm="kr500_l480", poses=3),
            "^Scenario: poses: no such field; fields are arm, .*payload",
        ),
        (lambda _: tb.Scenario(), "^Scenario: arm: this field is missing"),
        (lambda cell: tb.simulate(cell, tb.Scenario(arm="ur10")), "a scenario for 'kr500_l480', got one for"),
        (lambda cell: tb.simulate(cell, seed=-1), "seed: expected an integer from 0 on, got -1"),
        (lambda _: tb.score(np.zeros((2, 3)), np.zeros((4, 3))), r"equal shapes, got \(2, 3\) and \(4, 3\)"),
        (lambda _: tb.score(np.zeros((0, 3)), np.zeros((0, 3))), "at least one deflection, got shape"),
        (lambda _: tb.score([["1 mm"]], [[1.0]]), r"predicted \[m\]: expected numbers"),
        (lambda _: tb.with_prior(tb.gco, None), "prior: expected one, such as cad_prior"),
        (
            lambda cell: tb.with_prior(tb.gco, tb.cad_prior(cell.arm), 0.3),
            "uncertainty: expected PriorUncertainty or None, got float",
        ),
        (lambda cell: tb.Structure.of(cell.arm, links="link_2"), "links: expected a list of names, got the"),
        (lambda _: tb.Prior("mine", "abc"), "prior mine .*: expected numbers, got str"),
        (lambda _: tb.PriorUncertainty("30 %"), "relative: expected a number from .*, got '30 %'"),
        (lambda cell: tb.weight(cell.vjm, "460 kg"), r"mass \[kg\]: expected numbers, got str"),
        (lambda cell: tb.weight(cell.vjm, -460), r"mass \[kg\]: expected 0 or more, got -460"),
        (
            lambda _: tb.Aim(corrected_part="axes"),
            "aim.corrected_part: expected pose or axis or position, got 'axes'",
        ),
        (lambda _: tb.Aim(joint_meaning="taught"), "aim.joint_meaning: expected unloaded or drawn or None"),
        (lambda _: tb.Aim(tool_point=(0.0, 0.1)), r"aim.tool_point \[m\]: expected shape \(3\), got \(2,\)"),
        (
            lambda cell: tb.plan(cell, np.full((1, 6), 40.0), tb.PlanSettings(loads_kg=(460.3,))),
            "expected radians; joint_1 of pose 0 is at 40 rad",
        ),
        (
            lambda cell: _structure(cell).parameters_of(np.eye(3)),
            r"C_theta: expected shape \(48, 48\), got \(3,",
        ),
        (lambda cell: _structure(cell).C_theta_of(np.ones(3)), r"pi .* expected shape \(56\), got \(3,\)"),
        (lambda cell: tb.plan(cell, np.zeros(6), tb.PlanSettings(loads_kg=(460.3,))), "tasks q"),
        (lambda cell: tb.calibrate(cell.vjm, [], tb.cad_prior(cell.arm)), "series: expected one or more"),
        (lambda cell: tb.gco(cell, None, None), r"vjm: expected Vjm, got Cell; it has one as \.vjm"),
        (lambda cell: tb.gco(cell.vjm, "MGCO56", None), "structure: expected Structure, got str"),
        (lambda cell: tb.predict(cell, np.zeros((1, 6)), []), "model: expected ArmModel, got Cell"),
        (lambda cell: tb.cad_prior(cell), r"arm: expected Arm, got Cell; it has one as \.arm"),
        (lambda cell: tb.simulate(cell, "kr500_l480"), "scenario: expected Scenario or None, got str"),
        (lambda _: tb.PlanSettings(loads_kg=(460.3,), poses=0), "^poses: expected 1 to 200, got 0"),
        (lambda _: tb.PlanSettings(loads_kg=(460.3,), poses="12"), "^poses: expected a number, got str"),
    ],
)
def test_a_mistake_is_told_in_one_line(cell, mistake, said):
    with pytest.raises(tb.BenchError, match=said):
        mistake(cell)


def _structure(cell):
    return tb.MODELS["MGCO56"](cell).structure


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: {"q": data.q.tolist()}, r"q \[rad, m\]: expected ndarray, got list"),
        (lambda data: {"run_id": None}, "run_id: expected ndarray, got NoneType"),
        (lambda data: {"markers": "P1"}, "markers: expected tuple or list, got str"),
        (lambda data: {"sigma": None}, r"sigma \[m\]: expected a number above 0 and below 1, got None"),
        (lambda data: {"sigma": "50 um"}, "sigma .*, got '50 um'"),
        (lambda data: {"sigma": 50.0}, "sigma .*, got 50.0"),
        (
            lambda data: {"before": 1e3 * data.before, "after": 1e3 * data.after},
            "expected metres; the median deflection is 5.63 m on an arm that reaches 3.37 m",
        ),
        (lambda data: {"q": np.degrees(data.q)}, r"q \[rad, m\]: expected radians; joint_\d of pose 0 is at"),
    ],
)
def test_wrong_readings_are_told_in_one_line(cell, change, said):
    data = tb.simulate(cell, seed=1).identification
    with pytest.raises(tb.BenchError, match=said):
        tb.gco(cell.vjm, _structure(cell), replace(data, **change(data)))


def test_joints_in_degrees_are_refused_by_what_predicts_and_corrects(cell):
    runs = tb.simulate(cell, seed=1)
    model = cell.model(tb.least_squares(cell.vjm, _structure(cell), runs.identification))
    q, load = np.degrees(runs.check.q), tb.weight(cell.vjm, 460.3)
    for use in (tb.predict, tb.compensate, tb.stiffness):
        with pytest.raises(tb.BenchError, match="expected radians"):
            use(model, q, [load])


@pytest.mark.parametrize("drawn", [None, "three joints"])
def test_a_true_arm_that_draws_no_such_arm_is_named(cell, drawn):
    arm = None if drawn is None else replace(cell.arm, joints=cell.arm.joints[:3], links=cell.arm.links[:4])
    tb.true_arms["broken"] = tb.TrueArm(lambda *_: arm)
    try:
        with pytest.raises(tb.BenchError, match="true arm 'broken': expected an Arm of the same joints"):
            tb.true_cell(cell, "broken", 1)
    finally:
        del tb.true_arms["broken"]


def test_what_is_public_shows_itself_in_a_line_and_in_a_small_table(cell):
    runs = tb.simulate(cell, seed=1)
    model = tb.MODELS["MGCO56"](cell)
    estimate = tb.gco(cell.vjm, model.structure, runs.identification)
    load, score = tb.weight(cell.vjm, 460.3), tb.score(runs.check.deflection, runs.check_true.deflection)
    arm_model = cell.model(estimate)
    there = [give(arm_model, runs.check.q, [load]) for give in (tb.predict, tb.compensate, tb.stiffness)]
    there += [score, load, tb.weight(cell.vjm, np.full(9, 460.3)), estimate.regression, estimate.certificate]
    there += [cell, cell.vjm, runs, runs.check, model, model.structure, tb.cad_prior(cell.arm), estimate]
    for own in there:
        assert len(repr(own)) < 200
        assert own._repr_html_().count("<tr>") == len(own.summary())
    assert re.fullmatch(r"ArmModel\(arm=kr500_l480, method=GCO[^\n]*\)", repr(arm_model))
    assert repr(load) == "Load(wrench=[0, 0, -4515.54, 0, 0, 0], point=[0.35, 0.14, -0.08])"
    assert repr(runs.check).startswith("Dataset(runs=6, poses=3, markers=P1 P2 P3, deflection_mm=")
    assert "<th>unknowns</th><td>56</td>" in estimate._repr_html_()


@pytest.mark.parametrize("page", ["README.md", "docs/api.md"])
def test_the_python_of_a_page_runs_and_prints_what_the_page_says(page, tmp_path, monkeypatch, capsys):
    """From readings to an estimate, and on to a corrected program."""
    monkeypatch.chdir(tmp_path)
    text = (ROOT / page).read_text(encoding="utf-8")
    exec(compile(re.search(r"```python\n(.*?)```", text, re.DOTALL)[1], page, "exec"), {})
    said, told = capsys.readouterr().out, re.search(r"```text\n(.*?)```", text, re.DOTALL)[1]
    number = re.compile(r"-?\d+\.\d+")
    assert number.sub("", said) == number.sub("", told)
    shown, found = ([float(x) for x in number.findall(text)] for text in (told, said))
    np.testing.assert_allclose(found, shown, rtol=0, atol=0.02)


def test_a_model_is_of_the_arm_that_was_identified_and_of_nothing_else(cell):
    runs = tb.simulate(cell, seed=1)
    estimate = tb.gco(cell.vjm, tb.MODELS["MGCO56"](cell).structure, runs.identification)
    q, load = runs.check.q[:1], tb.weight(cell.vjm, 460.3)
    there = tb.predict(cell.model(estimate), q, [load], linear=True)
    np.testing.assert_allclose(there.deflection[0, 1:], tb.deflections(cell.vjm, estimate, runs.check)[0])
    with pytest.raises(tb.BenchError, match="expected an estimate of ur10, got one of link_0"):
        tb.build_cell("ur10").model(estimate)
    with pytest.raises(tb.BenchError, match="expected an Estimate or a Calibration, got ndarray"):
        cell.model(estimate.pi)
