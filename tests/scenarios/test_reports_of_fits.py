"""Code that fills reports, by real fits: columns, words and levels are of the quantity that they name."""

import re

import numpy as np
import pytest

import testbench as tb
from testbench.correct.predicted import predict
from testbench.identify.absolute.fit import CalibrationOptions, calibrate
from testbench.identify.prior import PriorUncertainty, cad_prior
from testbench.model.laws import COMPENSATOR_KIND
from testbench.model.load import Load
from testbench.report.fitted_runs import seen
from testbench.report.table import find
from testbench.workflows import calibration_numbers, fit_numbers
from testbench.workflows.absolute_campaign import AbsoluteCampaign, simulate_series
from testbench.workflows.fits import MeasuredRuns, fit_models
from testbench.workflows.models import named_models, with_priors


@pytest.fixture(scope="module")
def identified(kr500):
    """The default and GCO without a prior by one campaign, and the rows of its report."""
    runs = tb.simulate(kr500, tb.Scenario(arm="kr500_l480", workspace_poses=1), 3).identification
    [whole, plain] = named_models(kr500, ["ALL153", "MGCO56"])
    models = [plain, *with_priors(kr500.arm, [whole], cad_prior(kr500.arm), PriorUncertainty(0.3))]
    found = fit_models(kr500, models, MeasuredRuns("runs.csv", runs, runs, None), lambda: 0.0, widths=True)
    left = fit_numbers.residuals_by_model(kr500, found)
    numbers = fit_numbers.numbers(kr500, kr500, found, left, widths=True)
    numbers["badge"] = None
    return found, left, numbers


def test_beside_a_prior_only_models_with_one_have_intervals_and_name_what_no_reading_checks(identified):
    found, _, f = identified
    assert [(m.name, bool(m.intervals)) for m in f.models] == [("MGCO56", False), ("ALL153 + prior", True)]
    assert found.fits.recommended != "ALL153 + prior" or found.fits.unchecked.stiffer


def test_every_law_of_a_joint_stands_in_its_own_column(identified):
    found, *_ = identified
    sizes = {"stiffening": 0.11, "backlash": 2.2e-5, "friction": 3.3e-5, COMPENSATOR_KIND: 0.044}
    taken = find(found.fits.models, name=found.fits.recommended)
    taken.laws = {"joint_2": sizes}
    [row] = fit_numbers._laws(found)
    keys = ("stiffer_percent", "backlash_urad", "friction_urad", "strut_percent")
    assert [row[key] for key in keys] == pytest.approx([11.0, 22.0, 33.0, 4.4])


def test_words_of_workspace_poses_hold_the_half_width_of_the_model_to_take(kr500, identified):
    """By predictions of the estimate itself, not by the rows of the report."""
    found, left, f = identified
    data, taken = found.runs.used, found.fits.recommended
    drawn = seen(kr500, found, f, left).scene.groups[-1]
    k = int(np.linalg.norm(data.wrench[:, :3], axis=1).argmax())
    own = kr500.model(found.estimates[taken])
    load = Load(data.wrench[k], data.point[k])
    there = predict(own, np.array(f.map.errors.q), [load], points=np.zeros((0, 3)))
    told = [
        tuple(map(float, re.search(r"moves (\d+\.\d+) mm, ± (\d+\.\d+) mm", words).groups()))
        for words in drawn.words
    ]
    moved, half = np.array(told).T
    np.testing.assert_allclose(half, 1e3 * there.largest_half_width[:, 0], atol=6e-4)
    np.testing.assert_allclose(moved, 1e3 * np.linalg.norm(there.deflection[:, 0], axis=1), atol=6e-4)
    others = [f.map.errors.error_mm[name] for name in f.map.errors.compared if name != taken]
    assert others
    assert all(np.abs(other - half).max() > 1e-2 for other in others)  # it would show


def test_the_level_of_noise_alone_holds_95_percent_of_pairs_of_noisy_readings(identified):
    found, _, f = identified
    data, rng = found.runs.every, np.random.default_rng(1)
    runs, m = 20_000, len(data.markers)
    before, after = rng.normal(0, data.sigma, (2, runs, m, 3))
    longest = 1e3 * np.linalg.norm(after - before, axis=2).max(axis=1)
    assert np.mean(longest < f.noise_p95_mm) == pytest.approx(0.95, abs=0.01)  # six deviations of a share


@pytest.fixture(scope="module")
def calibration(kr500):
    """Of the arm's own joint errors and compliances, from absolute readings."""
    series, _ = simulate_series(kr500, AbsoluteCampaign(poses=60), 4)
    asked = CalibrationOptions(max_order=2, used_errors=frozenset({"joint springs", "joint errors"}))
    return calibrate(kr500.vjm, series, cad_prior(kr500.arm), asked)


def test_the_rms_of_a_joints_error_over_a_turn_is_that_of_its_waves(calibration):
    """By the angles themselves: a wave of amplitude a has a / sqrt 2."""
    errors, n = calibration.state.error_terms, calibration.state.error_coefficients
    rows = list(calibration_numbers._spectrum(calibration))
    assert rows
    q = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    names = [joint.name for joint in calibration.state.vjm.arm.joints]
    k = len(errors.orders)
    for row in rows:
        own = n[names.index(row.joint)]
        angles = np.multiply.outer(q, np.array(errors.orders))
        wave = np.sin(angles) @ own[:k] + np.cos(angles) @ own[k : 2 * k]
        assert row.rms_urad == pytest.approx(1e6 * np.sqrt(np.mean(wave**2)))
    assert max(row.rms_urad for row in rows) > 1


def test_the_folders_compliance_of_a_joint_is_its_own_and_the_turn_of_the_link_before_it(calibration):
    vjm = calibration.state.vjm
    rows = calibration_numbers._compliances(calibration)
    assert len(rows) == vjm.arm.n_joints
    for row, joint, link, axis in zip(
        rows, vjm.arm.joints, vjm.arm.links, vjm.joint_axes_in_beam_frame, strict=False
    ):
        turn, slide = (axis @ link.compliance[part, part] @ axis for part in (slice(3, 6), slice(0, 3)))
        assert row.folder == pytest.approx(1e6 * (joint.compliance + turn))
        assert turn != pytest.approx(slide, rel=0.1)  # translations for turns would show
