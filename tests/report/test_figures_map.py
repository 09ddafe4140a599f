"""Maps of errors: slices that hold every place next to them, on one scale, with the arm."""

import numpy as np
import pytest
from legible import check_legible
from made_up_run import made_up_run
from matplotlib.colors import to_hex

from testbench.report.colours import look
from testbench.report.figure import IN_COLUMN
from testbench.report.run_figure import error_map, forward_pose, silhouette, slice_of
from testbench.report.scene import ModelLine, PageContent, PlaceMap
from testbench.workflows.model_names import row_words

RNG = np.random.default_rng(3)
AT = RNG.uniform(-2, 2, (60, 3))
MAPS = {"MLS56": RNG.uniform(0.5, 1.5, 60), "MGCO56": RNG.uniform(0.01, 0.03, 60)}
MAPS["MLS56"][17] = 4.0
ARM = {
    (0, 2): ([np.array([[0, 0], [0.3, 0], [0, 1.0]]), np.array([[0, 1.0], [1, 1.5], [1, 2.5]])], np.ones(2)),
    (0, 1): ([np.array([[0, -0.2], [2.6, 0], [0, 0.2]])], np.ones(1)),
}
"""Outlines of an arm from the side and from above; it reaches beyond all places."""
LEVELS = {1: 0.0, 2: float(np.median(AT[:, 2]))}
"""Where slices are, by the axis on which they stand: through the base, and at half of the places."""


def mapped(at=AT, **values):
    """Two maps, or what else is given."""
    lines = [ModelLine(name, look(name, "psd"), mm) for name, mm in (values or MAPS).items()]
    without = "" if all(np.isfinite(line.values).all() for line in lines) else "no bound"
    return PlaceMap("Error of the tool (mm)", 0, at, lines, "Where it errs", without)


def test_a_slice_has_the_error_of_each_place_on_it_and_nothing_far_from_all_places():
    ends = np.array([[-1.0, -1, -1], [1, 1, 1]])
    side = np.linspace(-1, 1, 9)
    x, z = (own.ravel() for own in np.meshgrid(side, side))
    left = x <= 0  # no place is on the right
    at = np.column_stack([x, np.zeros(len(x)), z])[left]
    values = 1 + at[:, 0] ** 2 + at[:, 2]
    cut = slice_of(at, 1, 0.0, ends)
    found = cut.interpolate(values)
    assert cut.near.all()
    corners = [(0, 0), (-1, 0)]  # grid points that are places
    for row, column in corners:
        assert found[row, column] == pytest.approx(1 + cut.x[column] ** 2 + cut.y[row], abs=1e-6)
    assert np.isnan(found[:, cut.x > 0.6]).all()
    known = found[np.isfinite(found)]
    assert values.min() <= known.min() <= known.max() <= values.max()
    np.testing.assert_allclose(cut.interpolate(np.full(len(at), 3.0))[np.isfinite(found)], 3.0)
    lost = np.where(at[:, 2] > 0, np.nan, values)
    assert np.nanmax(np.abs(cut.interpolate(lost)[cut.y < -0.4] - found[cut.y < -0.4])) < 0.1
    assert np.isnan(cut.interpolate(lost)[cut.y > 0.6]).all()


def test_a_map_has_two_slices_in_one_scale_the_arm_and_the_worst_place():
    figure = error_map(mapped(), "arm under 9 kg", ARM)
    limits = np.quantile(np.concatenate([*MAPS.values()]), (0.02, 0.98))
    for k, axes in enumerate(figure.axes[:4]):
        name, across = list(MAPS)[k % 2], 1 if k < 2 else 2
        shown = [0, 3 - across]
        cut = slice_of(AT, across, LEVELS[across], np.array([AT.min(axis=0), AT.max(axis=0)]))
        [image] = axes.images
        np.testing.assert_allclose(
            image.get_array().filled(np.nan), np.exp(cut.interpolate(np.log(MAPS[name])))
        )
        dots, arm = axes.collections
        assert 0 < cut.near.sum() < len(AT)
        np.testing.assert_allclose(dots.get_offsets(), AT[cut.near][:, shown])
        np.testing.assert_allclose(dots.get_array(), MAPS[name][cut.near])
        assert image.get_clim() == dots.get_clim() == pytest.approx(tuple(limits))
        worst = int(MAPS[name].argmax())
        [ring] = axes.get_lines()
        assert np.ravel(ring.get_xydata()) == pytest.approx(AT[worst, shown])
        assert axes.texts[0].get_text() == f"{MAPS[name][worst]:.3g} mm"
        for outline, corners in zip(arm.get_paths(), ARM[tuple(shown)][0], strict=True):
            np.testing.assert_allclose(outline.vertices[:-1], corners)
        if k < 2:
            said = " ".join(axes.get_title().split())
            assert said == f"{row_words(name)}: median {np.median(MAPS[name]):.3f} mm"
        where = f"at {'xyz'[across]} = {LEVELS[across]:.1f} m\n{'xyz'[shown[1]]} [m]"
        assert axes.get_ylabel() == ("" if k % 2 else where)
    marked = [axes.get_label() == IN_COLUMN for axes in figure.axes[:4]]
    assert marked == [False, True, False, True]  # one column has the model that the title is about
    assert figure.axes[-1].get_ylabel() == "error [mm, logarithmic]"
    title, caption = (text.replace("\n", " ") for text in (figure.get_suptitle(), figure.get_supxlabel()))
    x, y, z = AT[17]
    assert title.startswith(f"GCO of beam links: error at most {MAPS['MGCO56'].max():.3f} mm at x ")
    assert "arm under 9 kg." in caption
    assert f"least squares of beam links 4.000 mm at x {x:.2f}, y {y:.2f}, z {z:.2f} m" in caption


def test_the_slices_of_a_model_stand_above_each_other_on_one_scale_of_metres_with_all_of_the_arm_inside():
    figure = error_map(mapped(), "arm under 9 kg", ARM)
    figure.draw_without_rendering()
    for side, above in zip(figure.axes[:2], figure.axes[2:4], strict=True):
        ends = side.get_window_extent(), above.get_window_extent()
        assert (ends[0].x0, ends[0].x1) == pytest.approx((ends[1].x0, ends[1].x1), abs=1)
        assert side.get_xlim() == above.get_xlim()
        metres = [
            np.diff(axes.get_ylim())[0] / own.height for axes, own in zip((side, above), ends, strict=True)
        ]
        assert metres[0] == pytest.approx(metres[1], rel=0.01)
        for axes, shown in ((side, [0, 2]), (above, [0, 1])):
            low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
            for corners in ARM[tuple(shown)][0]:
                assert (low < corners).all()
                assert (corners < high).all()


def test_the_last_pane_is_in_the_colour_of_the_one_that_errs_less():
    rng = np.random.default_rng(4)
    values = {
        "MLS56": rng.uniform(1, 2, 60),
        "Joints": np.where(AT[:, 0] > 0, 1.0, 0.1),
        "MGCO56": np.full(60, 0.5),
    }
    made = mapped(**values)
    figure = error_map(made, "arm under 9 kg")
    ours, joints = made.difference
    less = values["MGCO56"] <= values["Joints"]
    for axes in (figure.axes[3], figure.axes[7]):
        [image] = axes.images
        shades = [to_hex(image.get_cmap()(own)).upper() for own in (0.0, 1.0)]
        assert shades == [ours.look.hex, joints.look.hex]
        x = np.linspace(*image.get_extent()[:2], image.get_array().shape[1] + 1)
        x = (x[1:] + x[:-1]) / 2
        array = image.get_array().filled(np.nan)
        assert np.nanmean(array[:, x > 1]) < 0.1 < 0.9 < np.nanmean(array[:, x < -1])
    title = figure.axes[3].get_title().replace("\n", " ")
    assert title == f"Which errs less: the chosen one in {less.sum()} of 60 places"
    [key] = figure.subfigs[0].legends
    assert [text.get_text() for text in key.get_texts()] == ["GCO of beam links", "joints-only model"]
    assert [to_hex(own.get_color()).upper() for own in key.legend_handles] == [ours.look.hex, joints.look.hex]


def test_places_without_a_bound_are_rings_and_a_map_without_any_says_so():
    mm = MAPS["MLS56"].copy()
    near = np.flatnonzero(slice_of(AT, 1, 0.0, np.array([AT.min(axis=0), AT.max(axis=0)])).near)[:2]
    mm[near] = np.nan
    figure = error_map(mapped(MLS56=mm, MGCO56=np.full(60, np.nan)), "arm")
    first, nowhere = figure.axes[:2]
    rings, _ = first.get_lines()
    np.testing.assert_allclose(rings.get_xydata(), AT[near][:, [0, 2]])
    assert " ".join(nowhere.get_title().split()) == "GCO of beam links (MGCO56): no bound"
    assert "Grey rings: no bound." in figure.get_supxlabel().replace("\n", " ")


@pytest.mark.study
@pytest.mark.parametrize("still", [[0], [0, 1, 2]])
def test_arms_that_move_in_a_plane_on_a_line_or_not_at_all_have_panes_too(still):
    at = AT.copy()
    at[:, still] = 0.3
    figure = error_map(mapped(at), "arm", ARM)
    figure.draw_without_rendering()
    assert figure.get_figheight() < 2 * figure.get_figwidth()
    for axes in figure.axes[:4]:
        assert min(axes.get_position().size) > 0.01


def test_the_arm_is_drawn_where_it_reaches_forward_at_a_typical_distance(arm_6r):
    tools = np.array([[3, 0, 1], [2, 0.1, 1], [-2, 0, 1], [0, 2, 1], [1, 0, 1.0]])
    positions = np.stack([np.ones((5, 3)), tools], axis=1)
    assert forward_pose(positions) == 1
    assert silhouette(PageContent(), mapped()) is None
    seen = made_up_run(arm_6r)
    check = error_map(seen.map, "arm", silhouette(seen, seen.map))
    check.draw_without_rendering()
    check_legible(check)


def test_the_two_views_of_a_single_map_stand_side_by_side_and_fill_the_width():
    figure = error_map(mapped(MGCO56=MAPS["MGCO56"]), "arm under 9 kg", ARM)
    figure.draw_without_rendering()
    check_legible(figure)
    side, above, bar = figure.axes
    assert (side.get_ylabel(), above.get_ylabel()) == tuple(
        f"at {'xyz'[across]} = {level:.1f} m\n{'xyz'[3 - across]} [m]" for across, level in LEVELS.items()
    )
    left, right = side.get_window_extent(), above.get_window_extent()
    assert left.x1 < right.x0
    assert left.width == pytest.approx(right.width, abs=1)  # one scale of metres
    assert (bar.bbox.x1 - left.x0) / figure.bbox.width > 0.75
    assert (left.width + right.width) / figure.bbox.width > 0.5


@pytest.mark.parametrize("models", [["MLS56", "MGCO56"], ["MLS56", "Joints", "MGCO56"]])
def test_the_height_of_a_figure_of_maps_follows_from_what_is_in_it(models):
    rng = np.random.default_rng(6)
    values = {name: rng.uniform(1, 2, 60) for name in models}
    figure = error_map(mapped(**values), "arm under 9 kg", ARM)
    figure.draw_without_rendering()
    across = (len(figure.axes) - 1) // 2
    for upper, lower in zip(figure.axes[:across], figure.axes[across : 2 * across], strict=True):
        gap = upper.get_window_extent().y0 - lower.get_window_extent().y1
        assert 0 < gap / figure.dpi < 0.35
