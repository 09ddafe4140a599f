"""A joint law and a true arm of a user's own, those of the docs: found by name, right, and of use."""

import re
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loads import GRAVITY, hung
from run_here import do

from testbench import (
    BenchError,
    NominalDeflections,
    TrueArm,
    cad_prior,
    deflections,
    load_model,
    save_model,
    score,
)
from testbench.model.laws import (
    add_joint_laws,
    add_law_parameters,
    joint_laws,
    law_kinds,
    law_sizes,
    vjm_for_structure,
)
from testbench.model.structure import all153
from testbench.model.vjm import evaluate_chain, generalised_load_without_laws
from testbench.plant.disturbance import Disturbances
from testbench.plant.equilibrium import solve_unloaded_and_loaded
from testbench.plant.true_arms import disturb, draw_true_plant, true_arms
from testbench.runs import manifest
from testbench.runs.rows import trial_rng
from testbench.runs.store import numeric_versions
from testbench.studies.study import true_arm_name
from testbench.workflows.campaign import Scenario, simulate, true_cell
from testbench.workflows.models import named_models, with_priors

DOCS = Path(__file__).resolve().parents[2] / "docs"
FILE = re.compile(r"`(\w+)/([\w.]+)`[^\n]*:?\n\n```\w+\n(.*?)```", re.DOTALL)
LINKS = 42  #: Virtual joints of the links.


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """The packages of both pages as pip installs them; the tables are read anew."""
    for page in ("add_joint_law.md", "add_true_arm.md"):
        files = {name: code for _, name, code in FILE.findall((DOCS / page).read_text(encoding="utf-8"))}
        about = tomllib.loads(files.pop("pyproject.toml"))["project"]
        for name, code in files.items():
            (tmp_path / name).write_text(code, encoding="utf-8")
        folder = tmp_path / f"{about['name'].replace('-', '_')}-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {about['name']}\nVersion: 1.0\n")
        lines = [
            f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in own.items())
            for group, own in about["entry-points"].items()
        ]
        (folder / "entry_points.txt").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(tmp_path)
    for known in (joint_laws, true_arms):
        monkeypatch.setattr(known, "_entries", None)
        monkeypatch.setattr(known, "_parts", {})
    return tmp_path


def test_packages_of_the_pages_are_known_by_name_and_the_manifest_says_which_file(installed):
    assert list(joint_laws) == ["stiffening", "backlash", "friction", "wind_up"]
    assert list(true_arms.added) == ["worn", "wound"]
    assert true_arm_name("worn") == "worn"
    digests = manifest.versions(true_arms)
    assert digests["joint law wind_up"] == manifest.digest(installed / "wind_up.py")
    assert digests["true arm worn"] == manifest.digest(installed / "worn.py")
    assert digests.keys() - manifest.versions().keys() == {"true arm worn", "true arm wound"}
    assert numeric_versions().items() >= {"true arm worn": digests["true arm worn"]}.items()


def test_a_worn_joint_is_one_and_the_same_for_a_seed(installed, kr500):
    own = [joint.compliance for joint in kr500.arm.joints]
    drawn = [
        [j.compliance for j in true_arms["worn"].draw_arm(kr500.arm, np.random.default_rng(s)).joints]
        for s in (1, 1, 2)
    ]
    assert drawn[0] == drawn[1] != drawn[2]
    off = np.divide(drawn, own)
    assert ((off > 1.9).sum(axis=1) == 1).all()
    assert ((off == 1).sum(axis=1) == 5).all()


def test_the_slope_of_the_law_is_the_derivative_of_its_turn(installed, rng):
    law, x = joint_laws["wind_up"], 1e-3 * rng.standard_normal((2, 6, 9))
    ahead, behind = (law.deflection(NominalDeflections(x[0], x[1] + step)) for step in (1e-9, -1e-9))
    np.testing.assert_allclose(law.slope(NominalDeflections(*x)), (ahead - behind) / 2e-9, rtol=0, atol=1e-5)


def test_the_law_turns_joints_as_mujocos_arm_does(installed, kr500):
    """But for what the bent arm changes of the torques, a percent or two."""
    q = np.random.default_rng(3).uniform(*(0.7 * kr500.arm.limits), (12, 6))
    wrench, point = hung(kr500, 12, 4500 / GRAVITY)
    plant = disturb(
        draw_true_plant(kr500.arm, "wound", trial_rng(1, 8)),
        Disturbances(own_weight=True),
        np.random.default_rng(0),
    )
    turns = []
    for own in (plant, replace(plant, spring_effects=None)):
        before, after = solve_unloaded_and_loaded(own, q, wrench, point)
        turns.append((after.theta - before.theta)[:, LINKS:48])
    vjm = replace(kr500.vjm, arm=replace(kr500.arm, compensator=None))
    where = evaluate_chain(add_joint_laws(vjm, ["wind_up"]), q)
    expected = (
        plant.spring_effects.joint_law.share
        * where.joint_laws.unit_deflections(
            where, generalised_load_without_laws(where, wrench, point)[LINKS:]
        ).T
    )
    assert np.abs(expected).max() > 1e-4
    np.testing.assert_allclose(turns[0] - turns[1], expected, rtol=0, atol=0.06 * np.abs(expected).max())


def default(cell, structure, data):
    [model] = with_priors(cell.arm, named_models(cell, ["ALL153"]), cad_prior(cell.arm))
    return model.estimator(cell.vjm, structure, data)


def test_unknowns_have_the_law_for_every_joint_beside_ours(installed, kr500):
    every = add_law_parameters(all153(kr500.arm), kr500.arm)
    assert law_kinds(every) == ("stiffening", "backlash", "friction", "wind_up", "compensator")
    assert every.row_labels[-7:-1] == tuple(f"joint_{k} wind_up" for k in range(1, 7))
    some = add_law_parameters(all153(kr500.arm), kr500.arm, ["friction"])
    assert vjm_for_structure(kr500.vjm, some).n_theta == some.n_theta == every.n_theta - 18


@pytest.mark.study
def test_the_default_finds_the_law_and_a_model_that_has_it_asks_for_it(installed, kr500, tmp_path):
    arm = replace(kr500.arm, compensator=None)  # which the simulated arm does not have either
    cell = replace(kr500, arm=arm, vjm=replace(kr500.vjm, arm=arm))
    scenario = Scenario(arm=arm.name, noise=False, identification_poses=8, identification_runs=16)
    true = true_cell(cell, "wound", 1)
    campaign = simulate(true, scenario, 5)
    with_it, ours = (
        add_law_parameters(all153(arm), arm, kinds) for kinds in (None, list(joint_laws.built_in))
    )
    found, without = (default(cell, s, campaign.identification) for s in (with_it, ours))
    truth = campaign.truth
    error, other = (score(deflections(cell.vjm, e, truth), truth.deflection).rms for e in (found, without))
    assert error < 0.3 * other
    sizes = law_sizes(vjm_for_structure(cell.vjm, found.structure), found.C_theta)
    share = true.plant.spring_effects.joint_law.share
    for k in (1, 2):  # the joints that bear the load
        assert abs(sizes[f"joint_{k + 1}"]["wind_up"] - share[k]) < 0.35 * share[k]
    whole = default(kr500, add_law_parameters(all153(kr500.arm), kr500.arm), campaign.identification)
    save_model(kr500.model(whole), tmp_path / "model")
    again = load_model(tmp_path / "model")
    np.testing.assert_allclose(again.state.C_theta, whole.C_theta, rtol=1e-12, atol=0)
    assert again.vjm.joint_laws.kinds == (*np.repeat(list(joint_laws), 6), "compensator")
    del joint_laws["wind_up"]
    with pytest.raises(BenchError, match="no joint law 'wind_up'; install the package that has it"):
        load_model(tmp_path / "model")


class NoSlope:
    unit, unit_symbol, size_prior, formula = 1.0, "1", (0.5, 0.8), "s x_1"

    def deflection(self, nominal):
        return nominal.x_1


class OneNumber(NoSlope):
    def slope(self, nominal):
        return 1.0


@pytest.mark.parametrize(
    ("table", "name", "part", "said"),
    [
        (joint_laws, "soft", NoSlope(), "joint law 'soft': NoSlope lacks slope"),
        (joint_laws, "soft", OneNumber(), r"expected finite numbers \(n, runs\) from slope, got"),
        (joint_laws, "friction", OneNumber(), "the name is taken"),
        (joint_laws, "compensator", OneNumber(), "the name is taken"),
        (joint_laws, "Wind up", OneNumber(), "expected a name of a-z"),
        (true_arms, "family", TrueArm(lambda arm, _: arm), "a name other than"),
        (true_arms, "own", lambda arm, _: arm, "expected a TrueArm"),
    ],
)
def test_a_part_that_cannot_work_is_refused_where_it_is_added(table, name, part, said):
    with pytest.raises(BenchError, match=said):
        table[name] = part
    assert not table.added


def test_a_package_that_fails_is_named_and_so_is_an_unknown_arm(installed, tmp_path):
    ask = "demo", "--true-arm", "wooden", "--out", tmp_path / "out"
    done = do(*ask)
    assert done.returncode == 2
    assert "slipping, worn, wound, got 'wooden'" in " ".join(done.stderr.split())
    true_arms._entries, true_arms._parts = None, {}
    sys.modules.pop("worn")
    (tmp_path / "worn.py").write_text("import nowhere_to_be_found\n")
    for _ in range(2):  # whenever it is asked
        done = do(*ask)
        assert done.returncode == 2
        assert "entry point worn = 'worn:worn' of testbench.true_arms" in " ".join(done.stderr.split())
