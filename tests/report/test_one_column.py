"""For one column of a journal: panes below each other, all rows named, nothing cut, nothing over another."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from legible import check_legible
from made_up_run import REPORT, made_up_run

from testbench.report.colours import look
from testbench.report.figure import for_column, forest, one_column, page, ranges, say, sweeps
from testbench.report.run_figure import error_map, overview
from testbench.report.schema import Table, TableColumn
from testbench.report.table import Row
from testbench.runs.spread import spread

ERROR, RATIO = TableColumn("error", "error", "mm"), TableColumn("ratio", "ratio over that of the first")
NAME, SIZE = TableColumn("name", "model"), TableColumn("size", "noise", "µm", form=".0f")
NAMES = ("all links and joints, prior", "Joints", "MLS56")
HEADS = ("all links and joints, prior", "joints-only model", "least squares of\nbeam links (MLS56)")


def rows(**more):
    """A row of each model."""
    return [
        Row(
            name=name,
            structure=name,
            constraint="psd",
            prior=False,
            error=spread([k, 1.2 * k, 1.1 * k]),
            **more,
        )
        for k, name in enumerate(NAMES, 1)
    ]


def stacked(figure):
    """The figure in one column, looked at; its panes without keys, from top to bottom."""
    figure.draw_without_rendering()
    wide = figure.get_size_inches().tolist(), [axes.get_position().bounds for axes in figure.axes]
    narrow = one_column(figure)
    narrow.draw_without_rendering()
    check_legible(narrow)
    assert 25.4 * narrow.get_figwidth() == pytest.approx(89)
    assert 25.4 * narrow.get_figheight() <= 121
    assert wide == (figure.get_size_inches().tolist(), [axes.get_position().bounds for axes in figure.axes])
    panes = [axes for axes in narrow.axes if axes.axison and axes.get_subplotspec() is not None]
    boxes = [axes.get_window_extent() for axes in panes]
    below = sorted(range(len(panes)), key=lambda k: -boxes[k].y0)
    assert all(boxes[a].y0 > boxes[b].y1 for a, b in pairwise(below))
    return [panes[k] for k in below]


def labels(axes):
    return [text.get_text() for text in axes.get_yticklabels()]


def test_every_pane_of_a_forest_names_its_rows_with_its_own_numbers():
    table = Table((NAME, ERROR, RATIO), [Row(row, ratio=2.0 * k) for k, row in enumerate(rows(), 1)])
    first, second = stacked(forest(table, {"error": "Errors", "ratio": "Ratios"}, "One wins", "Words."))
    for axes, numbers in ((first, ("1.1", "2.2", "3.3")), (second, ("2", "4", "6"))):
        heads, found = zip(*[label.split("  ") for label in labels(axes)], strict=True)
        assert heads == HEADS
        assert [float(own) for own in found] == pytest.approx([float(own) for own in numbers])


def test_a_column_has_the_first_panes_that_fit_or_those_that_are_marked():
    figure = page(6.0)
    panes = figure.subplots(4, 1)
    for k, axes in enumerate(panes):
        axes.plot([1, 2])
        axes.set_title(f"pane {k}")
    say(figure, "Title", "Words.")
    assert [axes.get_title() for axes in stacked(figure)] == ["pane 0", "pane 1"]
    for_column(panes[1], panes[3])
    assert [axes.get_title() for axes in stacked(figure)] == ["pane 1", "pane 3"]


def test_lines_keep_their_key_and_panes_that_share_an_axis_get_their_own_names():
    swept = Table((NAME, SIZE, ERROR), [row for k in (1.0, 10.0, 100.0) for row in rows(size=k)])
    panes = stacked(sweeps({"Left": swept, "Right": swept}, "One wins", "Words."))
    assert [axes.get_title() for axes in panes] == ["Left", "Right"]
    down = TableColumn("kind", "arm")
    kinds = Table((down, NAME, ERROR), [row for kind in ("tubes", "cast links") for row in rows(kind=kind)])
    panes = stacked(ranges({"Left": kinds, "Right": kinds}, "One wins", "Words.", 1.0))
    assert [labels(axes) for axes in panes] == [["tubes", "cast links"]] * 2


@pytest.mark.parametrize(
    "names", [[f"{k}" for k in range(1, 25)], pytest.param(["cut 12"] * 16, marks=pytest.mark.study)]
)
def test_labels_of_runs_are_left_out_until_none_touch_and_the_key_is_below(arm_6r, names):
    seen = made_up_run(arm_6r)
    lines = [replace(line, values=0.1 * np.arange(len(names)), ends=None) for line in seen.runs[0].lines]
    chart = replace(seen.runs[0], labels=names, lines=lines)
    [runs] = stacked(overview(REPORT, replace(seen, tables=[], runs=(chart,))))
    shown = [text.get_text() for text in runs.get_xticklabels()]
    assert 5 <= sum(map(bool, shown)) < len(shown)
    assert runs.get_legend().get_window_extent().y1 < runs.get_window_extent().y0


def test_a_key_of_several_columns_has_one_where_names_are_long_each_beside_its_own_line():
    swept = Table((NAME, SIZE, ERROR), [row for k in (1.0, 10.0, 100.0) for row in rows(size=k)])
    figure = sweeps({"Left": swept, "Right": swept}, "One wins", "Words.")
    own = {line.get_label(): line.get_color() for line in figure.axes[0].get_lines()}
    [key] = [key for part in (figure, *figure.subfigs) for key in part.legends]
    stacked(figure)
    narrow = one_column(figure)
    narrow.draw_without_rendering()
    [narrowed] = [key for part in (narrow, *narrow.subfigs) for key in part.legends]
    for found in (key, narrowed):
        handles = zip(found.get_texts(), found.legend_handles, strict=True)
        assert {text.get_text(): handle.get_color() for text, handle in handles} == own
    boxes = [text.get_window_extent() for text in narrowed.get_texts()]
    assert all(above.y0 > below.y1 - 2 for above, below in pairwise(boxes))


def test_maps_stand_below_each_other_with_their_bar(arm_6r):
    seen = made_up_run(arm_6r)
    [side] = stacked(error_map(seen.map, "Under load"))  # both do not fit, and half a map says where it errs
    assert side.get_xlabel() == "x [m]"
    assert seen.map.lines[-1].name in side.get_title()


def test_a_long_title_of_a_pane_is_broken_and_a_pane_that_is_not_drawn_takes_no_room():
    figure = page(2.0)
    left, right = figure.subplots(1, 2)
    left.set_title("word " * 20)
    right.set_visible(False)
    say(figure, "Title", "Words.")
    [axes] = stacked(figure)
    assert "\n" in axes.get_title()


def test_a_pane_that_is_too_tall_alone_stays_and_all_of_its_rows_are_named():
    many = [Row(row, name=f"{row.name} {k}") for k in range(14) for row in rows()]
    table = Table((NAME, ERROR), many, looks={row.name: look("MGCO56", "psd") for row in many})
    figure = forest(table, {"error": "Errors"}, "One wins", "Words.")
    figure.draw_without_rendering()
    [axes] = [axes for axes in one_column(figure).axes if axes.axison]
    assert len([own for own in labels(axes) if own]) == len(many)
