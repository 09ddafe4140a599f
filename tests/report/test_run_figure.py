"""The picture of a run holds the numbers and places that its page draws."""

import numpy as np
import pytest
from made_up_run import REPORT, made_up_run

from testbench.views.run_figure import overview


@pytest.fixture(scope="module")
def seen(arm_6r):
    return made_up_run(arm_6r)


@pytest.fixture(scope="module")
def figure(seen):
    return overview(REPORT, seen)


@pytest.mark.parametrize(("pane", "plane"), [(0, [0, 2]), (1, [0, 1])])
def test_the_first_pose_is_drawn_from_aside_and_from_above(figure, seen, pane, plane):
    axes, own = figure.axes[pane], seen.scene.groups[0]
    k, (dots, arrows, path, _) = own.first, own.layers
    assert (axes.get_xlabel(), axes.get_ylabel()) == tuple(f"{'xyz'[i]} [m]" for i in plane)
    lines = [np.column_stack(line.get_data()) for line in axes.get_lines()]
    drawn = {
        (line.get_color(), line.get_linestyle()): at for line, at in zip(axes.get_lines(), lines, strict=True)
    }
    assert drawn["0.3", "--"] == pytest.approx(own.bent.positions[k, 1:, plane].T)
    assert any(at.shape == (3, 2) and np.allclose(at, dots.at[k][:, plane], equal_nan=True) for at in lines)
    for j in range(3):
        ends = np.stack([arrows.at[k, j, plane], arrows.to[k, j, plane]])
        assert any(at.shape == (2, 2) and np.allclose(at, ends, equal_nan=True) for at in lines), j
    still = np.stack([path.at[0, 0, plane], path.to[0, 0, plane]])
    assert any(at.shape == (2, 2) and np.allclose(at, still) for at in lines)
    assert axes.get_title().startswith(own.names[k])


def test_charts_hold_every_number_in_its_colour_with_its_interval(figure, seen):
    axes, chart = figure.axes[-1], seen.runs[0]
    shown = {line.get_label(): line for line in axes.get_lines()}
    for own in chart.lines:
        assert shown[own.name].get_ydata() == pytest.approx(own.values, nan_ok=True)
        assert shown[own.name].get_color() == own.look.hex
    low, high = chart.lines[1].ends
    corners = np.vstack([path.vertices for path in axes.collections[0].get_paths()])
    for x in np.flatnonzero(np.isfinite(low)):
        ends = corners[corners[:, 0] == x, 1]
        assert (ends.min(), ends.max()) == pytest.approx((low[x], high[x]))
    assert axes.get_title() == "Left (mm)"
    assert [text.get_text() for text in axes.get_xticklabels()] == list("abcde")


def test_the_title_is_the_answer_and_the_caption_what_is_enlarged(figure):
    assert figure.get_suptitle() == "It is 3.000 mm off."
    assert figure.get_supxlabel() == "Runs: Errors x 10."
