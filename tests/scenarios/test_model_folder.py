"""A model is a file: what both commands leave is read back bit by bit, or refused in one line."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from run_here import refused

import testbench as tb
from testbench.campaign.arm_models import write_stiffness
from testbench.campaign.campaign import Scenario, simulate
from testbench.campaign.fits import Runs, fit
from testbench.campaign.model_folder import sealed
from testbench.campaign.model_selection import with_priors
from testbench.campaign.models import named_models
from testbench.errors import InputError
from testbench.identify.posterior import CURVED, curvature, linearise
from testbench.model.vjm import chain, marker_points, observation

ROOT = Path(__file__).resolve().parents[2]
FORCE, LEVER = 460.3 * 9.81, 0.15  #: Of section 6 [N]; the load point is so far from the tool's origin [m].


@pytest.fixture(scope="module")
def runs(kr500):
    scenario = Scenario(arm="kr500_l480", workspace_poses=1, check_runs=3)
    return simulate(kr500, scenario, 7).identification


def written(cell, runs, name, folder, prior=False):
    folder.mkdir()
    models = named_models(cell, [name])
    models = with_priors(cell.arm, models, tb.cad_prior(cell.arm)) if prior else models
    found = fit(cell, models, Runs("runs.csv", runs, runs, None), lambda: 0.0)
    write_stiffness(cell, found, Runs("runs.csv", runs, runs, None), {"runs.csv": "0" * 64}, folder)
    return found.taken


@pytest.mark.parametrize(
    ("name", "prior"),
    [("MLS56", False), ("MLS32", False), ("MGCO47", False), ("ALL153", True)],
)
def test_a_model_is_read_back_bit_by_bit_with_its_intervals(kr500, runs, tmp_path, name, prior):
    estimate = written(kr500, runs, name, tmp_path / "model", prior=prior)
    model = tb.load_model(tmp_path / "model", "kr500_l480")
    assert not model.absolute
    assert model.arm.joints == kr500.arm.joints
    assert model.structure.name == estimate.structure.name
    assert np.array_equal(model.state.C_theta, estimate.C_theta)
    known, own = linearise(estimate), model.posterior
    assert all(np.array_equal(getattr(known, key), getattr(own, key)) for key in vars(known))
    points = marker_points(kr500.vjm, runs.markers)
    rows = observation(chain(model.vjm, runs.q), model.structure, runs.wrench, runs.point, points)
    found = own.intervals(rows.reshape(-1, model.structure.n))
    half = np.hypot(
        found.upper - found.centre, CURVED * curvature(model.vjm, model.state.C_theta, runs).ravel()
    )
    wanted = tb.intervals(kr500.vjm, estimate, runs)
    np.testing.assert_allclose(half, (wanted.upper - wanted.centre).ravel(), rtol=1e-12)
    assert model.about.force == pytest.approx(FORCE)
    assert [*model.about.data] == ["runs.csv"]


def test_what_least_squares_has_not_seen_stays_without_bound(kr500, runs, tmp_path):
    """A force along the horizontal turns joint 1, which no weight of the campaign did."""
    written(kr500, runs, "ALL153", tmp_path / "model")
    model = tb.load_model(tmp_path / "model")
    push = np.tile([1e3, 1e3, 0, 0, 0, 0], (runs.runs, 1))
    rows = observation(chain(model.vjm, runs.q), model.structure, push, runs.point, np.zeros((1, 3)))
    assert np.isinf(model.posterior.deviations(rows.reshape(-1, 153))).any()


@pytest.fixture(scope="module")
def small(kr500, runs, tmp_path_factory):
    """A model of few numbers, with a prior, to spoil."""
    folder = tmp_path_factory.mktemp("small") / "model"
    written(kr500, runs, "Joints", folder, prior=True)
    return folder


def paths(value, at=()):
    """Where every value of a JSON document stands; of lists the first alone."""
    yield at
    keys = value if isinstance(value, dict) else range(min(len(value), 1)) if isinstance(value, list) else ()
    for key in keys:
        yield from paths(value[key], (*at, key))


def refusal(folder):
    """Why a model is refused; None where it is read."""
    try:
        tb.load_model(folder)
    except InputError as err:
        return str(err)


def written_again(folder, document):
    """As one who forges a model would: with the checksums of what it is now."""
    whole = sealed(document, (folder / "posterior.npz").read_bytes())
    (folder / "model.json").write_text(json.dumps(whole))


def spoil(text, at, new):
    document = json.loads(text)
    inner = document
    for key in at[:-1]:
        inner = inner[key]
    if new is KeyError:
        del inner[at[-1]]
    else:
        inner[at[-1]] = new
    return document


WRONG = (KeyError, None, "x", -1, float("nan"), [], {}, [[1.0]])
FREE = {"arm", "name", "units", "notes", "runs", "certificate", "prior", "unseen", "about", "spread", "kind"}
"""Words, and numbers that nothing else depends on: another value of the same type may be read."""


def leaf(document, at):
    for key in at:
        document = document[key]
    return document


def near(value):
    """Another value of the same type, of what is one."""
    others = {bool: lambda x: not x, int: lambda x: x + 1, float: lambda x: 1.01 * x + 1e-9}
    return (others | {str: lambda x: f"{x}."}).get(type(value), lambda _: None)(value)


def test_whatever_changes_in_a_model_is_refused_in_one_line(small, tmp_path):
    """Every key in turn, also where nothing else depends on it."""
    folder = shutil.copytree(small, tmp_path / "model")
    text = (folder / "model.json").read_text()
    for at in list(paths(json.loads(text)))[1:]:
        old = leaf(json.loads(text), at)
        for new in (*WRONG, near(old)):
            if new is KeyError or new != old:
                (folder / "model.json").write_text(json.dumps(spoil(text, at, new)))
                said = refusal(folder)
                assert said is not None, (at, new)
                assert len(said.splitlines()) == 1
    (folder / "model.json").write_text(json.dumps(json.loads(text), sort_keys=True))
    assert refusal(folder) is None  # the same, written otherwise
    posterior(folder, root=2 * np.load(small / "posterior.npz")["root"])
    assert "posterior.npz: has changed since the model was written" in refusal(folder)


def test_a_forged_model_with_any_key_spoiled_is_read_or_refused_in_one_line(small, tmp_path):
    folder = shutil.copytree(small, tmp_path / "model")
    text = (folder / "model.json").read_text()
    read = set()
    for at in [at for at in paths(json.loads(text)) if at and at[0] not in ("posterior", "checksum")]:
        for new in WRONG:
            written_again(folder, spoil(text, at, new))
            said = refusal(folder)
            read |= set() if said else {at}
            assert said is None or (len(said.splitlines()) == 1 and "model" in said)
    assert {at[0] for at in read} <= FREE | {"weights", "structure"}
    assert not [at for at in read if at[:2] == ("structure", "entries")]


ENTRY = ("structure", "entries", 0)
TAMPERED = [
    (("format",), 2, "format: is a stiffness of format 2, this version reads 1"),
    (("kind",), "magic", "kind: expected 'stiffness' (testbench identify) or 'absolute calibration'"),
    ((*ENTRY, "row"), "joint_9", "kr500_l480 has no 'joint_9'"),
    ((*ENTRY, "value"), 1e-7, "are of two models"),
    (("joints", "joint_2"), 1e-7, "joints: expected the compliances that structure.entries have"),
    (("links", "link_2"), np.eye(6).tolist(), "links: expected the blocks that structure.entries have"),
    (("weights", "mass_kg"), [1.0] * 7, "mass [kg]: expected shape (8), got (7,)"),
    (("digests", "rigid.xml"), "0" * 64, "rigid.xml: is not the arm of the model; it has changed"),
]


ARRAYS = [
    ({"scale": np.full(6, np.nan)}, "scale: expected finite numbers"),
    ({"root": np.eye(6, dtype=complex)}, "root: expected numbers of double precision"),
    ({"pi": np.full(6, -1e-7)}, "are of two models"),
]


def posterior(folder, **changed):
    with np.load(folder / "posterior.npz") as data:
        arrays = {**data, **changed}
    np.savez(folder / "posterior.npz", **arrays)


@pytest.mark.parametrize("case", [*TAMPERED, *ARRAYS])
def test_what_does_not_belong_together_is_said(small, tmp_path, case):
    folder = shutil.copytree(small, tmp_path / "model")
    document = json.loads((small / "model.json").read_text())
    if isinstance(case[0], dict):
        posterior(folder, **case[0])
    else:
        document = spoil((small / "model.json").read_text(), *case[:2])
    written_again(folder, document)
    assert case[-1] in refusal(folder)


def test_compliances_that_claim_to_be_conservative_are(small, tmp_path):
    folder = shutil.copytree(small, tmp_path / "model")
    document = json.loads((folder / "model.json").read_text())
    for entry in document["structure"]["entries"]:
        entry["value"] *= -1
    document["joints"] = {name: -value for name, value in document["joints"].items()}
    posterior(folder, pi=np.array([entry["value"] for entry in document["structure"]["entries"]]))
    written_again(folder, document)
    with pytest.raises(InputError, match="conservative: expected symmetric positive semi-definite"):
        tb.load_model(folder)
    document["conservative"] = False
    written_again(folder, document)
    assert tb.load_model(folder).posterior.x.max() < 0


def test_models_of_other_arms_and_of_earlier_versions_are_refused(small, tmp_path):
    with pytest.raises(InputError, match=r"is a model of another arm, kr500_l480 \(rigid.xml: digest"):
        tb.load_model(small, "ur10")
    with pytest.raises(InputError, match="expected the folder of a model"):
        tb.load_model(tmp_path)
    (tmp_path / "models.json").touch()
    with pytest.raises(InputError, match=r"fits of an earlier version and no model\.json: identify again"):
        tb.load_model(tmp_path)
    said = "expected 'absolute calibration' (testbench calibrate), got 'stiffness'"
    refused("score", small, "none.csv", said=said)
