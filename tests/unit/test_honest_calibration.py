"""What a calibration says of itself is true of the model that it leaves; what fits no arm is rejected."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from programs import block_matrices
from run_here import do

from testbench.cli.calibrate import report
from testbench.data.dataset import select_rows
from testbench.errors import BenchError
from testbench.identify.absolute import evidence
from testbench.identify.absolute.align import residuals
from testbench.identify.absolute.evidence import (
    WIDE_PRIOR,
    ActiveUnknowns,
    ErrorScales,
    solve_active_unknowns,
)
from testbench.identify.absolute.fit import CalibrationOptions, linearise_readings
from testbench.identify.absolute.state import Mount, nominal_state
from testbench.identify.observability import UndeterminedQuantity
from testbench.identify.prior import cad_prior, scale_by_prior
from testbench.identify.registration import Frame
from testbench.model.load import read_body_masses
from testbench.model.structure import all153
from testbench.report.table import Row
from testbench.workflows import calibration_numbers
from testbench.workflows.absolute import calibrate_with_masses, sentences
from testbench.workflows.absolute_campaign import AbsoluteCampaign, simulate_series
from testbench.workflows.calibration_numbers import remaining_errors

ROOT = Path(__file__).resolve().parents[2]

FEW = CalibrationOptions(
    max_order=2, excluded_errors=frozenset({"links", "gear ratio", "backlash", "stiffening"})
)
SPRINGS = CalibrationOptions(used_errors=frozenset({"joint springs"}), max_order=2)


def square(rng, rows, size):
    """Sums of squares of random equations [A | y], (1, size + 1, size + 1)."""
    A = rng.standard_normal((rows, size + 1))
    return (A.T @ A)[None]


def test_a_held_out_fold_is_the_least_sum_of_squares_in_the_cone(kr500, rng):
    """Its gradient is zero along all but compliances, and along these is in the cone and opposite to X."""
    elastic = scale_by_prior(cad_prior(kr500.arm), kr500.vjm, all153(kr500.arm))
    r, e = 4, len(elastic.expected_x)
    own = ActiveUnknowns(None, np.arange(r + e), elastic)
    learnt, S = ErrorScales(np.full(r + e, 2.0), np.ones(1)), square(rng, 3 * e, r + e)
    H, (P, b) = S[0].copy(), evidence.prior_precision(own, learnt, WIDE_PRIOR)
    H[:-1, :-1] += P
    H[:-1, -1] += b
    free, found = (
        solve_active_unknowns(own, S, learnt, WIDE_PRIOR, constraint).x for constraint in ("none", "psd")
    )
    assert min(np.linalg.eigvalsh(X)[0] for X in block_matrices(elastic, free[r:])) < -0.01
    gradient = H[:-1, :-1] @ found - H[:-1, -1]
    np.testing.assert_allclose(gradient[:r], 0, atol=1e-6 * np.abs(H[:-1, -1]).max())
    for X, G in zip(block_matrices(elastic, found[r:]), block_matrices(elastic, gradient[r:]), strict=True):
        size = np.abs(G).max() + 1
        assert np.linalg.eigvalsh(X)[0] > -1e-6
        assert np.linalg.eigvalsh(G)[0] > -1e-4 * size
        assert abs(np.trace(X @ G)) < 1e-3 * size
    inside = S.copy()  # readings of the expected arm: no block leaves its cone, and no digit may change
    inside[0, :-1, -1] = inside[0, -1, :-1] = S[0, :-1, :-1] @ np.r_[np.zeros(r), elastic.expected_x]
    one, other = (
        solve_active_unknowns(own, inside, learnt, WIDE_PRIOR, constraint).x for constraint in ("none", "psd")
    )
    assert np.array_equal(one, other)


@pytest.fixture(scope="module")
def hung(ur10):
    """Fitted and fresh readings of an arm whose weight pulls the other way, perfect but for its sag."""
    (one,), _ = simulate_series(ur10, AbsoluteCampaign(poses=70, masses=(8.0,)), 3)
    weights = read_body_masses(ur10.arm)
    sag = replace(nominal_state(ur10.vjm, weights, np.ones(6)), C_theta=-4 * ur10.plant.arm.C_theta)
    at = Frame(np.eye(3), np.zeros(3)), Mount(np.zeros((1, 3)), np.eye(3), one.markers)
    state = replace(sag, frames={one.frame: at[0]}, mounts={one.mount: at[1]})
    still = replace(one, position=np.zeros_like(one.position), wrench=0 * one.wrench)
    noise = 30e-6 * np.random.default_rng(1).standard_normal(one.position.shape)
    read = replace(still, position=noise - residuals(state, still)[:1].transpose(2, 0, 1), sigma=30e-6)
    k = np.arange(one.n_rows)
    return select_rows(read, k < 45), select_rows(read, k >= 45)


def test_held_out_numbers_are_those_of_the_arm_that_is_delivered(ur10, hung):
    """Compliances that want to be negative: without the cone they foretell a third of what the arm leaves."""
    fit, fresh = hung
    found = calibrate_with_masses(ur10.vjm, [fit], FEW)
    said = report(found, remaining_errors(found))
    f = said.numbers
    truth = 1e3 * np.sqrt((residuals(found.calibration.state, fresh)[:1] ** 2).sum(axis=1).mean())
    assert f["held_out_mm"][1] == pytest.approx(truth, rel=0.35)
    assert f["pressed"]
    assert said.badge.verdict == "do not use"
    assert any("Does the arm hang?" in doubt for doubt in f["doubts"])


def circle_points(cell, each=5, size=0.9):
    """Every joint alone through its range, so many poses each."""
    low, high = cell.arm.limits
    home, q = np.clip([0.2, -1.2, 1.3, 0.3, 0.6, 0.2], low, high), []
    for k in range(6):
        turned = np.tile(home, (each, 1))
        turned[:, k] = np.clip(home[k] + np.linspace(-size, size, each), low[k], high[k])
        q.append(turned)
    return np.concatenate(q)


def test_a_misfit_of_decimetres_is_rejected_and_no_lack_of_poses_nor_a_move(kr500):
    """Joint 3 counts joint 2 along with itself, in circles of one joint each."""
    (one,), _ = simulate_series(kr500, AbsoluteCampaign(poses=30, targets=2), 5, circle_points(kr500))
    coupled = replace(one, q=one.q + np.outer(one.q[:, 1], np.eye(6)[2]))
    with pytest.raises(BenchError) as found:
        linearise_readings(kr500.vjm, (coupled,), cad_prior(kr500.arm), SPRINGS)
    assert "do not fit this arm" in str(found.value)
    for wrong in ("too few", "moved", "measure more"):
        assert wrong not in str(found.value)


@pytest.mark.parametrize(
    ("before", "after", "held_out", "why"),
    [
        (3.0, 0.2, [0.4, 0.3], ""),
        (3.0, 0.59, [0.4, 0.3], ""),
        (700.0, 63.0, [0.1, 0.066], "held-out ones only 0.066 mm: the readings contradict each other"),
        (340.0, 432.0, None, "432.000 mm from the calibrated arm, but 340.000 mm from the nominal arm"),
        (3.0, 3.1, [0.4, 4.0], ""),
    ],
)
def test_an_arm_far_from_what_it_was_fitted_to_is_rejected(before, after, held_out, why):
    found = calibration_numbers._rejected(Row(held_out_mm=held_out), before, after)
    assert found.endswith(why)
    assert bool(found) == bool(why)


def test_a_rejected_arm_is_one_reason_and_leaves_the_folder_as_it_was(tmp_path, monkeypatch):
    rows = (ROOT / "models" / "ur10" / "readings" / "series_C.csv").read_text().splitlines()[:25]
    (file := tmp_path / "r.csv").write_text("\n".join(rows) + "\n")
    flags = ("--orders", 2, *(word for name in sorted(FEW.excluded_errors) for word in ("--without", name)))
    asked = ("calibrate", "ur10", file, *flags, "--force", "--out", tmp_path / "out")
    (tmp_path / "out").mkdir()
    earlier = {"manifest.json": '{"command": "testbench calibrate"}', "model.json": "of an earlier run"}
    for name, text in earlier.items():
        (tmp_path / "out" / name).write_text(text)
    monkeypatch.setattr(calibration_numbers, "ABOVE", 1e-3)
    done = do(*asked)
    assert (done.returncode, done.stderr) == (1, "")
    words = " ".join(done.stdout.split())
    assert words.startswith("Do not use the calibrated arm: the nearest 80 % of the fitted readings lie")
    assert "Holds" not in words
    assert "nothing was written" in words
    assert {path.name: path.read_text() for path in (tmp_path / "out").iterdir()} == earlier


def test_what_readings_leave_open_is_one_sentence_for_each_advice_and_names_each_kind_once():
    left = {"remaining_variance_share": 0.9, "joint_to_turn": 2}
    lost = [
        UndeterminedQuantity("a1's error of order 3", **left),
        UndeterminedQuantity("a2's error of order 3", **left | {"remaining_variance_share": 0.97}),
        UndeterminedQuantity("a1's error of order 1", **left),
        UndeterminedQuantity("a2's error of order 1", **left),
        UndeterminedQuantity("link_1's torsion", **left),
    ]
    more = UndeterminedQuantity("the frame of A", ("a1's offset",), 0.4, 0.991, joint_to_turn=0)
    useless = UndeterminedQuantity("a2's compliance", joint_to_turn=-1)
    assert sentences([*lost, more, useless], ["a1", "a2"]) == (
        "errors of orders 1, 3 (a1, a2), link_1's torsion are not determined "
        "(90 to 97 % of the prior variance remains): turn several joints together",
        "the frame of A cannot be separated from a1's offset (correlation 0.99, 40 % of the prior variance "
        "remains): turn a1 more",
        "a2's compliance is not determined (100 % of the prior variance remains): 40 more poses hardly help; "
        "another load may help",
    )
    assert sentences(lost[2:4], ["a1", "a2"])[0].startswith("errors of order 1 (a1, a2) are not determined")
    first, second, third = (f"a1's error of order {k}" for k in (1, 2, 3))
    among = [
        UndeterminedQuantity(first, (second,), 0.8, 0.95),
        UndeterminedQuantity(second, (third,), 0.9, 0.99),
    ]
    assert sentences(among, ["a1", "a2"]) == (
        "a1's errors of orders 1, 2, 3 cannot be separated from each other "
        "(correlation 0.95 to 0.99, 80 to 90 % of the prior variance remains)",
    )
