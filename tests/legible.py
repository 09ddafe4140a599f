"""What every figure must hold when it is written: fit for print and a page, nothing cut or covered."""

import re
from itertools import combinations

from matplotlib.axis import Axis
from matplotlib.colors import to_rgb
from matplotlib.text import Text

WIDTHS, SMALLEST = (89, 183), 7.0
"""Millimetres, one column or two of a journal, and points: at 800 pixels the least letters are 11 high."""
READABLE = 4.5  #: Least contrast of letters with their ground, as WCAG has it [1].
ROUNDING = 2.0  #: Points of the picture by which boxes may touch [pixel].
RAW = re.compile(r"mathdefault|\[1\]|\de[+-]?\d|\bnan\b|\binf\b|\bNone\b|[a-z]_(?:mm|um|percent|rad)\b")
"""Formulas, units without a name, scientific numbers, what is not there, keys of a report."""


def check_legible(figure):
    """A figure that was just drawn."""
    seen = [text for text in _texts(figure) if text.get_text().strip()]
    wide = 25.4 * figure.get_figwidth()
    assert min(abs(wide - own) for own in WIDTHS) < 0.1, f"{wide:g} mm wide"
    assert figure.get_suptitle(), "no title"
    lines = figure.get_suptitle().count("\n") + 1
    assert lines <= (2 if wide > 100 else 4), f"a title of {lines} lines"
    small = [(t.get_text(), t.get_fontsize()) for t in seen if t.get_fontsize() < SMALLEST]
    assert not small, f"too small at 800 pixels: {small}"
    raw = [t.get_text() for t in seen if RAW.search(t.get_text())]
    assert not raw, f"not for a reader: {raw}"
    boxes = [(t.get_text(), Text.get_window_extent(t)) for t in seen]  # of a note without its arrow
    page = figure.bbox
    cut = [
        words
        for words, box in boxes
        if box.x0 < page.x0 - ROUNDING
        or box.y0 < page.y0 - ROUNDING
        or box.x1 > page.x1 + ROUNDING
        or box.y1 > page.y1 + ROUNDING
    ]
    assert not cut, f"cut: {cut}"
    faint = [t.get_text() for t in seen if not _on_image(t) and _contrast(t.get_color()) < READABLE]
    assert not faint, f"too pale on white: {faint}"
    unnamed = [axes.get_title() for axes in figure.axes if axes.axison and not _named(axes)]
    assert not unnamed, f"marks whose names no legend has: {unnamed}"
    over = [(a, b) for (a, one), (b, two) in combinations(boxes, 2) if _overlap(one, two)]
    assert not over, f"over one another: {over}"
    for legend in _legends(figure):
        alike = [_drawn(handle) for handle in legend.legend_handles]
        assert len(set(alike)) == len(alike), f"swatches alike: {[t.get_text() for t in legend.get_texts()]}"


def _on_image(text):
    """Whether a text may stand on a coloured cell."""
    return text.axes is not None and bool(text.axes.images) and text in text.axes.texts


def _contrast(colour):
    """Contrast with white, as WCAG has it [1]."""
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in to_rgb(colour)]
    return 1.05 / (0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2] + 0.05)


def _named(axes):
    """Whether a legend of the pane, or one of all panes, tells apart what bears several names."""
    part, legends = axes.figure, [axes.get_legend()] if axes.get_legend() else []
    while part is not None:
        legends += part.legends
        part = getattr(part, "_parent", None)
    told = {text.get_text() for legend in legends for text in legend.get_texts()}
    names = set(axes.get_legend_handles_labels()[1])
    return len(names) < 2 or names <= told


def _texts(figure):
    """All texts that are drawn: of ticks only those within their axis."""
    axes = [a for a in figure.findobj(Axis) if a.axes.get_visible() and a.axes.axison]
    ticks = {id(label) for axis in figure.findobj(Axis) for label in axis.findobj(Text)}
    for text in figure.findobj(Text):
        if id(text) not in ticks and text.get_visible() and _shown(text):
            yield text
    for axis in axes:
        if not axis.get_visible():
            continue
        low, high = sorted(axis.get_view_interval())
        edge = 1e-9 * (high - low)
        for tick in axis.get_major_ticks():
            if low - edge <= tick.get_loc() <= high + edge:
                yield from (label for label in (tick.label1, tick.label2) if label.get_visible())
        yield axis.label
        yield axis.offsetText


def _shown(text):
    """Whether the axes of a text are drawn."""
    return text.axes is None or text.axes.get_visible()


def _overlap(one, two):
    across = min(one.x1, two.x1) - max(one.x0, two.x0)
    up = min(one.y1, two.y1) - max(one.y0, two.y0)
    return across > ROUNDING and up > ROUNDING


def _legends(figure):
    parts = [figure, *figure.subfigs]
    return [x for part in parts for x in part.legends] + [
        a.get_legend() for a in figure.axes if a.get_legend()
    ]


def _drawn(handle):
    """How an entry of a legend looks."""
    if hasattr(handle, "get_marker"):
        return handle.get_color(), handle.get_linestyle(), handle.get_marker(), handle.get_markerfacecolor()
    return str(handle.get_facecolor()), getattr(handle, "get_hatch", lambda: None)()
