"""Figures for one column of a journal: the panes of a figure one below the other, in words that fit."""

import pickle
import textwrap
from collections.abc import Iterator
from itertools import pairwise

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.legend import Legend
from matplotlib.text import Text
from matplotlib.transforms import ScaledTranslation

from testbench.report.figure import INCH, TITLE_BAND, WORDS_LINE, say

WIDTH = 89 / INCH  #: Width of the figure, as journals print one column [in].
PANE_LETTERS = 46  #: Letters of a line above or below a pane, and of the entries of its key side by side.
BELOW = 3.0  #: Distance of a key from what is above it [pt].
INSIDE = 0.99  #: Where a key begins at most that is inside of a pane, over its width [1].
APART = 2.0  #: Least distance of two labels along an axis [pt].


def one_column(figure: Figure) -> Figure:
    """Stack the panes of a figure, row by row, 89 mm wide; each keeps its height.

    Rows that only the first pane of a row names get their names in every pane; labels along an axis are left
    out where they would touch; keys beside a pane go below it.

    Args:
        figure: A figure that was laid out; it stays as it is.

    Returns:
        Its copy, laid out.
    """
    narrow: Figure = pickle.loads(pickle.dumps(figure))
    parts = [part for part in _leaves(narrow) if _panes(part)]
    stacks = [_stack(part) for part in parts]
    for part, heights in zip(parts, stacks, strict=True):
        if isinstance(part, SubFigure):
            place = part._subplotspec  # type: ignore[attr-defined] # it has no public name
            bands = place.get_gridspec()
            ratios = list(bands.get_height_ratios())
            ratios[place.rowspan.start] = sum(heights)
            bands.set_height_ratios(ratios)
    narrow.set_size_inches(WIDTH, sum(map(sum, stacks)))
    say(narrow, " ".join(narrow.get_suptitle().split()), " ".join(narrow.get_supxlabel().split()))
    lines = narrow.get_supxlabel().count("\n") + 1
    narrow.set_size_inches(WIDTH, sum(map(sum, stacks)) + TITLE_BAND + WORDS_LINE * lines)
    _lay_out(narrow)
    for axes in narrow.axes:
        _thin(axes)
        if legend := axes.get_legend():
            _place_below(axes, legend)
    _lay_out(narrow)
    return narrow


def _lay_out(figure: Figure) -> None:
    """Lay a figure out once, and keep it so."""
    figure.set_layout_engine("constrained")
    engine = figure.get_layout_engine()
    assert engine is not None  # just set
    engine.execute(figure)
    figure.set_layout_engine("none")


def _leaves(part: Figure | SubFigure) -> Iterator[Figure | SubFigure]:
    """Parts of a figure that have no parts."""
    for own in part.subfigs:
        yield from _leaves(own)
    if not part.subfigs:
        yield part


def _panes(part: Figure | SubFigure) -> list[Axes]:
    """Panes of a part, row by row."""
    placed = [axes for axes in part.axes if axes.get_subplotspec() is not None and axes.figure is part]
    return sorted(placed, key=_place)


def _place(axes: Axes) -> tuple[int, int]:
    """Row and column of a pane."""
    spec = axes.get_subplotspec()
    assert spec is not None  # see `_panes`
    return spec.rowspan.start, spec.colspan.start


def _stack(part: Figure | SubFigure) -> list[float]:
    """Stack the panes of a part; their heights with what is around them [in]."""
    for axes in _panes(part):
        if not axes.get_visible():
            axes.remove()
    panes = _panes(part)
    spec = panes[0].get_subplotspec()
    assert spec is not None  # see `_panes`
    grid = spec.get_gridspec()
    ratios = grid.get_height_ratios()
    words = 0.0 if isinstance(part, SubFigure) else TITLE_BAND + WORDS_LINE * _lines(part)
    room = part.bbox.height / part.figure.dpi - words  # type: ignore[union-attr]
    heights = [room * ratios[_place(axes)[0]] / sum(ratios) for axes in panes]
    firsts = {_place(axes)[0]: axes for axes in reversed(panes)}
    lasts = {_place(axes)[1]: axes for axes in panes}
    for axes in panes:
        row, column = _place(axes)
        _name(axes, firsts[row], lasts[column])
        _wrap(axes)
    stacked = part.add_gridspec(len(panes), 1, height_ratios=heights)
    for k, axes in enumerate(panes):
        axes.set_subplotspec(stacked[k, 0])
    for legend in [*part.legends, *filter(None, (axes.get_legend() for axes in panes))]:
        legend.set_ncols(_columns(legend))
    return heights


def _lines(figure: Figure) -> int:
    """Lines of the words below a figure."""
    return figure.get_supxlabel().count("\n") + 1


def _columns(legend: Legend) -> int:
    """How many entries of a key fit side by side."""
    longest = max((len(text.get_text()) for text in legend.get_texts()), default=1)
    return max(1, PANE_LETTERS // (longest + 8))


def _name(axes: Axes, first: Axes, last: Axes) -> None:
    """Give a pane what it shares with the first one of its row and the last one of its column."""
    if not axes.axison:
        return
    if axes in axes.get_shared_y_axes().get_siblings(first) and axes is not first:
        axes.tick_params(labelleft=True)
        axes.set_ylabel(axes.get_ylabel() or first.get_ylabel())
    if axes in axes.get_shared_x_axes().get_siblings(last) and axes is not last:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel(axes.get_xlabel() or last.get_xlabel())
    if axes is first or axes.get_ylim() != first.get_ylim():
        return
    names, own = ([text.get_text() for text in pane.get_yticklabels()] for pane in (first, axes))
    if not own:
        axes.set_yticks(first.get_yticks(), names)
    elif len(own) == len(names) and all("  " in name for name in names):  # a name and a number
        heads = [name.rpartition("  ")[0] for name in names]
        axes.set_yticks(axes.get_yticks(), [f"{a}  {b}" for a, b in zip(heads, own, strict=True)])


def _wrap(axes: Axes) -> None:
    """Break long words above and below a pane."""
    for place in ("left", "center", "right"):
        if title := axes.get_title(loc=place):
            axes.set_title(textwrap.fill(" ".join(title.split()), PANE_LETTERS), loc=place)
    axes.set_xlabel(textwrap.fill(axes.get_xlabel(), PANE_LETTERS))


def _thin(axes: Axes) -> None:
    """Leave out labels along a pane that touch: show every second one, or as many as are apart."""
    low, high = sorted(axes.get_xlim())
    every_label = [label for label in axes.get_xticklabels() if label.get_text()]
    labels = [label for label in every_label if low <= label.get_position()[0] <= high]
    if not labels:
        return
    ticks, words = [label.get_position()[0] for label in labels], [label.get_text() for label in labels]
    room = APART * axes.get_figure(root=True).dpi / 72  # type: ignore[union-attr]
    ends = [(box.x0, box.x1) for box in map(Text.get_window_extent, labels)]
    every = 1
    while any(b < a + room for (_, a), (b, _) in pairwise(sorted(ends[::every]))):
        every += 1
    if every > 1:
        shown = ["" if k % every else word for k, word in enumerate(words)]
        axes.set_xticks(ticks, shown, rotation=labels[0].get_rotation())


def _place_below(axes: Axes, legend: Legend) -> None:
    """Put a key that stands outside of a pane below its axis."""
    anchor = legend.get_bbox_to_anchor().transformed(axes.transAxes.inverted())
    if INSIDE > anchor.x0 >= 0 <= anchor.y0:
        return
    figure = axes.get_figure(root=True)
    assert figure is not None  # it has one
    low = min(box.y0 for box in (axes.bbox, axes.xaxis.get_tightbbox()) if box is not None)
    down = ScaledTranslation(0, (low - axes.bbox.y0) / figure.dpi - BELOW / 72, figure.dpi_scale_trans)
    legend.set_loc("upper center")
    legend.set_bbox_to_anchor((0.5, 0.0), axes.transAxes + down)
