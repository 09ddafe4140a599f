"""Ellipsoids of stiffness along a program hold every force, and are drawn as report.json has them."""

import json
import re

import numpy as np
import pytest
from legible import check_legible

from testbench.data.dataset import select_evenly
from testbench.report.run_figure import SEMI_AXES, stiffness_figure
from testbench.report.scene import ellipsoid_layer
from testbench.report.table import plain, rows
from testbench.workflows.program_numbers import ellipsoids

FORCE, COUNT = 1500.0, 5


@pytest.fixture(scope="module")
def compliance():
    """Of the tool's origin in some poses, and where a point of the tool is from there."""
    rng = np.random.default_rng(6)
    root = rng.standard_normal((COUNT, 6, 6)) * 1e-4
    return root @ root.transpose(0, 2, 1), rng.uniform(-0.3, 0.3, (COUNT, 3))


@pytest.fixture(scope="module")
def found(compliance):
    """The same as figures have it, read from report.json."""
    at = np.column_stack([np.linspace(2, 2.2, COUNT), np.linspace(-1, 1, COUNT), np.full(COUNT, 1.3)])
    own = ellipsoids(*compliance, at, [f"cut {k}" for k in range(COUNT)], FORCE)
    return rows(json.loads(json.dumps(plain(own), allow_nan=False)))


def test_forces_of_all_directions_move_a_point_of_the_tool_onto_its_ellipsoid(compliance, found):
    rng = np.random.default_rng(7)
    for C, r, row in zip(*compliance, found, strict=True):
        force = rng.standard_normal((50, 3))
        force *= FORCE / np.linalg.norm(force, axis=1, keepdims=True)
        twist = np.hstack([force, np.cross(r, force)]) @ C
        moved = 1e3 * (twist[:, :3] + np.cross(twist[:, 3:], r))
        shares = moved @ np.transpose(row.directions) / row.semi_axes_mm
        np.testing.assert_allclose(np.linalg.norm(shares, axis=1), 1, rtol=1e-9)
        assert sorted(row.semi_axes_mm, reverse=True) == row.semi_axes_mm


@pytest.mark.parametrize(
    ("count", "some"), [(3, [0, 1, 2]), (8, [*range(8)]), (15, [0, 2, 4, 6, 8, 10, 12, 14])]
)
def test_poses_with_an_ellipsoid_are_even_and_hold_both_ends(count, some):
    assert select_evenly(np.arange(count), 8).tolist() == some


def test_the_figure_draws_the_shadow_of_every_ellipsoid_and_its_semi_axes(found):
    figure = stiffness_figure(found, FORCE)
    figure.draw_without_rendering()
    check_legible(figure)
    side, above, sizes = figure.axes
    times = float(re.search(r"× ([\d,.]+)", side.get_title())[1].replace(",", ""))
    assert times == ellipsoid_layer(found, FORCE)[0]
    soft = max(found, key=lambda row: row.semi_axes_mm[0])
    for axes, plane in ((side, [1, 2]), (above, [0, 1])):  # the path is longest along y
        assert (axes.get_xlabel(), axes.get_ylabel()) == tuple(f"{'xyz'[k]} [m]" for k in plane)
        [drawn] = axes.collections
        for path, row in zip(drawn.get_paths(), found, strict=True):
            centre = np.array(row.at_m)[plane]
            semi = times / 1e3 * np.array(row.semi_axes_mm)[:, None] * np.array(row.directions)
            for way in np.eye(2):  # as far as the ellipsoid reaches, and no farther
                reached = ((path.vertices - centre) @ way).max()
                assert reached == pytest.approx(np.linalg.norm(semi[:, plane] @ way), rel=3e-3)
        [line] = axes.get_lines()
        np.testing.assert_allclose(line.get_xydata(), [np.array(row.at_m)[plane] for row in found])
        [name] = axes.texts
        assert name.get_text() == soft.label
        np.testing.assert_allclose(name.xy, np.array(soft.at_m)[plane])
    drawn = {line.get_label(): line.get_ydata() for line in sizes.get_lines()}
    for k, name in enumerate(SEMI_AXES):
        np.testing.assert_array_equal(drawn[name], [row.semi_axes_mm[k] for row in found])
    assert [text.get_text() for text in sizes.get_xticklabels()] == [row.label for row in found]
    assert sizes.get_ylabel() == "moved by 1,500 N [mm]"
    title = f"Softest at {soft.label}: 1,500 N move the tool by up to {soft.semi_axes_mm[0]:.3f} mm"
    assert " ".join(figure.get_suptitle().split()).startswith(title)
