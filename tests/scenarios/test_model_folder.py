"""A model is a file: what both commands leave is read back bit by bit, or refused in one line."""

import json
import shutil

import numpy as np
import pytest
from model_folders import identified
from run_here import refused

import testbench as tb
from testbench.errors import InputError
from testbench.identify.posterior import SECOND_ORDER_FACTOR, posterior_of_estimate, second_order_deflection
from testbench.model.vjm import evaluate_chain, marker_positions, observation_matrix
from testbench.workflows.campaign import Scenario, simulate
from testbench.workflows.models import named_models, with_priors

FORCE = 460.3 * 9.81  #: Of section 6 [N].


@pytest.fixture(scope="module")
def runs(kr500):
    scenario = Scenario(arm="kr500_l480", workspace_poses=1, check_runs=3)
    return simulate(kr500, scenario, 7).identification


def written(cell, runs, name, folder, prior=False):
    models = named_models(cell, [name])
    [model] = with_priors(cell.arm, models, tb.cad_prior(cell.arm)) if prior else models
    return identified(cell, model, runs, folder)


@pytest.mark.parametrize(
    ("name", "prior"),
    [("MLS56", False), ("MLS32", False), ("MGCO47", False), ("ALL153", True)],
)
def test_a_model_is_read_back_bit_by_bit_with_its_intervals(kr500, runs, tmp_path, name, prior):
    estimate = written(kr500, runs, name, tmp_path / "model", prior=prior)
    model = tb.load_model(tmp_path / "model", "kr500_l480")
    assert not model.is_absolute
    assert model.arm.joints == kr500.arm.joints
    assert model.structure.name == estimate.structure.name
    assert np.array_equal(model.state.C_theta, estimate.C_theta)
    known, own = posterior_of_estimate(estimate), model.posterior
    assert all(np.array_equal(getattr(known, key), getattr(own, key)) for key in vars(known))
    points = marker_positions(kr500.vjm, runs.markers)
    rows = observation_matrix(
        evaluate_chain(model.vjm, runs.q), model.structure, runs.wrench, runs.point, points
    )
    found = own.intervals(rows.reshape(-1, model.structure.n_parameters))
    half = np.hypot(
        found.upper - found.centre,
        SECOND_ORDER_FACTOR * second_order_deflection(model.vjm, model.state.C_theta, runs).ravel(),
    )
    wanted = tb.intervals(kr500.vjm, estimate, runs)
    np.testing.assert_allclose(half, (wanted.upper - wanted.centre).ravel(), rtol=1e-12)
    assert model.origin.largest_force == pytest.approx(FORCE)
    assert [*model.origin.file_hashes] == ["runs.csv"]


def test_what_least_squares_has_not_seen_stays_without_bound(kr500, runs, tmp_path):
    """A force along the horizontal turns joint 1, which no weight of the campaign did."""
    written(kr500, runs, "ALL153", tmp_path / "model")
    model = tb.load_model(tmp_path / "model")
    push = np.tile([1e3, 1e3, 0, 0, 0, 0], (runs.n_runs, 1))
    rows = observation_matrix(
        evaluate_chain(model.vjm, runs.q), model.structure, push, runs.point, np.zeros((1, 3))
    )
    assert np.isinf(model.posterior.standard_deviations(rows.reshape(-1, 153))).any()


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


def test_a_model_with_any_key_spoiled_is_read_or_refused_in_one_line(small, tmp_path):
    folder = shutil.copytree(small, tmp_path / "model")
    text, read = (folder / "model.json").read_text(), set()
    for at in list(paths(json.loads(text)))[1:]:
        for new in WRONG:
            (folder / "model.json").write_text(json.dumps(spoil(text, at, new)))
            said = refusal(folder)
            assert said is None or (len(said.splitlines()) == 1 and "model.json" in said), (at, new)
            read |= {at} if said is None and new is KeyError else set()
    assert {at[0] for at in read} == {"about", "fit"}  # a file of readings, a version; words for people


ENTRY = ("structure", "entries", 0)
TAMPERED = [
    (
        ("format",),
        1,
        "model.json: format: this version reads format 3, the model has format 1: fit it again",
    ),
    ((*ENTRY, "row"), "joint_9", "kr500_l480 has no 'joint_9'"),
    ((*ENTRY, "value"), 1e13, "structure.entries.0.value: expected at most 1"),
    (("weights", "mass_kg"), [1.0] * 7, "mass [kg]: expected shape (8), got (7,)"),
    (("columns",), [0, 10**5], "numbers of this model contradict each other"),
    (("theta_0",), [0.0], "theta_0 [m, rad]: expected shape"),
    (("noise",), {"open_position_m": 0.0}, "noise.open_rotation_rad: this key is missing"),
    (("arm",), "x" * 5_000_000, "arm: expected a text of at most 255 characters"),
    (("arm",), "a\0b", "arm: expected no control characters"),  # no XML holds it
    (("name",), "x" * 10**6, "name: expected a text of at most"),
    (("weights", "mass_kg"), [1e300] * 8, "weights.mass_kg.0: expected at most"),
    (("theta_0",), [1e308], "theta_0.0: expected at most"),
    (("about", "method"), "x" * 10**6, "about.method: expected a text of at most"),
    (("about", "doubts"), ["?"] * 10**5, "about.doubts: expected a list of at most"),
]


@pytest.mark.parametrize("case", TAMPERED, ids=lambda case: case[-1])
def test_what_does_not_belong_together_is_said(small, tmp_path, case):
    folder = shutil.copytree(small, tmp_path / "model")
    *change, said = case
    document = spoil((small / "model.json").read_text(), *change)
    (folder / "model.json").write_text(json.dumps(document))
    line = refusal(folder)
    assert said in line
    assert len(line) < 2100


ARRAYS = [
    ({"scale": np.full(6, np.nan)}, "scale: expected finite numbers"),
    ({"root": np.eye(5)}, "root: expected shape (any, 6), got (5, 5)"),
    (
        {"root": np.array([{}], dtype=object)},
        "expected the posterior of a model: Object arrays",
    ),
]


@pytest.mark.parametrize("case", ARRAYS)
def test_arrays_of_another_shape_or_kind_are_refused(small, tmp_path, case):
    folder, (changed, said) = shutil.copytree(small, tmp_path / "model"), case
    with np.load(folder / "posterior.npz") as data:
        arrays = {**data, **changed}
    np.savez(folder / "posterior.npz", **arrays)
    assert said in refusal(folder)
    (folder / "posterior.npz").unlink()
    assert "posterior.npz" in refusal(folder)


def test_models_of_other_arms_are_refused(small, tmp_path):
    with pytest.raises(InputError, match=r"the model is of another arm, kr500_l480: its rigid\.xml differs"):
        tb.load_model(small, "ur10")
    with pytest.raises(InputError, match="expected the folder of a model"):
        tb.load_model(tmp_path)
    said = "expected a model of testbench calibrate, got one of testbench identify"
    refused("calibrate", small, "none.csv", "--score", said=said)
