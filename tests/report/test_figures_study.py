"""Figures of studies: coverage of intervals and errors of joints, read back from what was drawn."""

import numpy as np
import pytest
from legible import check_legible

from testbench.identify.posterior import Posterior
from testbench.report.figure import split_title
from testbench.report.figures_fit import coverage_figure, joint_error_figure
from testbench.runs.rows import Row
from testbench.workflows.calibration_numbers import joint_curve


def counted(name, kind, actual):
    """Intervals of a kind, at five levels or at one."""
    nominal = [50.0, 80.0, 90.0, 95.0, 99.0] if len(actual) == 5 else []
    return Row(
        interval=name,
        kind=kind,
        confidence=0.95,
        covered_percent=actual[3] if nominal else actual[0],
        standard_error_percent=0.5,
        nominal_percent=nominal,
        actual_percent=actual if nominal else [],
        actual_error_percent=[1.0] * len(nominal),
    )


KINDS = [
    counted("arm_6r, GCO, linearised", "linearised", [51.0, 79.0, 91.0, 94.0, 98.0]),
    counted("arm_6r, GCO, bootstrap", "bootstrap", [93.0]),
    counted("kr500_l480 MGCO56, GCO", "posterior", [48.0, 81.0, 90.0, 95.5, 99.0]),
    counted("MuJoCo truth, wrong prior: learnt", "learnt", [55.0, 83.0, 92.0, 96.0, 99.0]),
    counted("MuJoCo truth, wrong prior: believed", "believed", [20.0, 33.0, 42.0, 56.0, 79.0]),
]


def test_coverage_is_drawn_at_every_level_with_its_error_beside_the_diagonal():
    figure = coverage_figure(KINDS)
    figure.draw_without_rendering()
    check_legible(figure)
    titles = ["no prior, noise only", "prior as assumed", "wrong prior, other arms"]
    assert [axes.get_title() for axes in figure.axes] == titles
    drawn = {line.get_label(): line.get_xydata() for axes in figure.axes for line in axes.get_lines()}
    for row in KINDS:
        given = np.c_[row.nominal_percent or [95.0], row.actual_percent or [row.covered_percent]]
        np.testing.assert_allclose(drawn[row.interval], given)
    for axes in figure.axes:
        lines = [line.get_xydata() for line in axes.get_lines()]
        assert any(np.array_equal(line, [[0, 0], [100, 100]]) for line in lines)
        low, high = axes.get_ylim()
        assert all(low <= y <= high for line in lines if len(line) != 2 for y in line[:, 1])
    whiskers = [line.get_xydata().tolist() for line in figure.axes[1].get_lines()]
    assert [[95.0, 93.5], [95.0, 97.5]] in whiskers
    assert figure.get_suptitle() == "The 95 % intervals with a learnt prior contain 96 % of the deflections"


@pytest.mark.study
def test_the_error_of_a_joint_is_its_fourier_sum_with_the_interval_of_each_angle():
    orders, q = (1, 3), np.radians([-170.0, 10, 120])
    x = np.array([7.0, 30e-6, -20e-6, 10e-6, 5e-6])  # an unknown of another kind, then sines, then cosines
    root = np.diag([1.0, 2e-6, 2e-6, 2e-6, 2e-6])
    curve = joint_curve(Posterior.from_covariance_root(x, root), np.array([[1, 2], [3, 4]]), orders, q)
    angle = np.radians(curve.angle_deg)
    assert (angle[0], angle[-1]) == pytest.approx((q.min(), q.max()), rel=1e-4)
    error = 30 * np.sin(angle) - 20 * np.sin(3 * angle) + 10 * np.cos(angle) + 5 * np.cos(3 * angle)
    np.testing.assert_allclose(curve.error_urad, error, atol=2e-2)
    half = 1.96 * 2 * np.sqrt(2)  # sine and cosine of one deviation: the same at every angle
    np.testing.assert_allclose(curve.half_urad, half, rtol=1e-3)
    joints = [Row(joint=f"joint_{k}", rms_urad=10.0 * k, curve=curve) for k in (1, 3, 2, 4)]
    figure = joint_error_figure(joints)
    figure.draw_without_rendering()
    check_legible(figure)
    for axes, row in zip(figure.axes, joints, strict=False):
        line, _ = axes.get_lines()
        np.testing.assert_array_equal(line.get_xydata(), np.c_[row.curve.angle_deg, row.curve.error_urad])
        [band] = axes.collections
        corners = np.vstack([path.vertices for path in band.get_paths()])
        ends = corners[np.isclose(corners[:, 0], row.curve.angle_deg[50]), 1]
        middle, half = row.curve.error_urad[50], row.curve.half_urad[50]
        assert (ends.min(), ends.max()) == pytest.approx((middle - half, middle + half))
        assert axes.get_title() == f"{row.joint}: {row.rms_urad:.0f} µrad RMS"
    assert not figure.axes[-1].get_visible()
    assert "joint_4 errs most, 40 µrad" in figure.get_suptitle()


LONG = "averylongwordwithoutanyblankinitanywhereatall"


@pytest.mark.parametrize(
    ("words", "title", "rest"),
    [
        ("Short enough", "Short enough", ""),
        (
            "Tie: a matches b (error ratio 1.00, n 8).",
            "Tie: a matches b",
            "Error ratio 1.00, n 8.",
        ),
        ("One sentence ends here. The other is long.", "One sentence ends here", "The other is long."),
        ("Holds: one is far better than two (n 8).", "Holds: one is far better than two", "N 8."),
        ("Error 0.1 mm; by chance: 0.3 mm (n 8)", "Error 0.1 mm; by chance: 0.3 mm", "N 8"),
        ("Eq. (7) is better than any (n 8).", "Eq.\u00a0(7) is better than any", "N 8."),
        ("One, weightless, is better than two (n 8)", "One, weightless, is better than two", "N 8"),
        (LONG, f"{LONG[:26]}…", LONG),
    ],
)
def test_a_title_ends_where_a_thought_ends_and_loses_no_word(words, title, rest):
    assert split_title(words, 27, 36) == (title, rest)
