"""Values with their spread on a logarithmic axis: drawn in a plane, so that every dot has its name."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.views.recording.style import NOISE, Colour

ROW, TALL, WIDTH = 60.0, 100.0, 1000.0
"""Height of a line, of one that several dots share, and width of the axis, in the chart's own units."""
SHARE = 0.7
"""How much of a line its dots take up."""
LEFT, RIGHT = 340.0, 200.0
"""Room for names on the left and for numbers on the right."""
PANE = 1580.0, 760.0
"""About the size of the view [ui points]: labels keep their size on the screen whatever the chart's."""
BELOW, LETTER, SPACE = 14.0, 3.7, 18.0
"""How far a label stands below its point, half the width of a letter, space before a number [ui points]."""


@dataclass(frozen=True)
class Dot:
    """A value of the chart, on a line of its own or on one with others."""

    name: str  #: What it is; dots of the same name share a line.
    low: float  #: Low end of the spread; the value itself where there is none.
    value: float  #: Positive.
    high: float  #: High end of the spread.
    colour: Colour  #: Of its role.
    text: str  #: The value for people, unit included; on a shared line what the colour means.


def write_chart(stream: rr.RecordingStream, path: str, dots: Sequence[Dot]) -> None:
    """Dots, whiskers, names and a grid of powers of ten.

    Args:
        stream: Where to.
        path: Root of the chart's entities.
        dots: From top to bottom.
    """
    first, last = _decades(dots)
    names = _names(dots)
    tall = TALL if _shared(dots) else ROW
    rows = tall * _heights(dots)
    x = np.array([[_place(v, first, last) for v in (d.low, d.value, d.high)] for d in dots])
    colours = [d.colour for d in dots]
    bottom = tall * len(names)
    unit = max((LEFT + WIDTH + RIGHT) / PANE[0], (bottom + ROW) / PANE[1])  # of the chart a ui point
    ticks = [_place(10.0**k, first, last) for k in range(first, last + 1)]
    lines = [[(t, 0), (t, bottom)] for t in ticks]
    stream.log(f"{path}/axis", rr.LineStrips2D(lines, colors=(*NOISE, 120), radii=-0.5), static=True)
    marks = rr.Points2D(
        [(t, bottom + ROW / 2) for t in ticks],
        labels=[f"{10.0**k:g}" for k in range(first, last + 1)],
        colors=NOISE,
        radii=-1.0,
        show_labels=True,
    )
    stream.log(f"{path}/ticks", marks, static=True)
    spread = [[(low, y), (high, y)] for (low, _, high), y in zip(x, rows, strict=True)]
    stream.log(f"{path}/spread", rr.LineStrips2D(spread, colors=colours, radii=-2.0), static=True)
    stream.log(
        f"{path}/value",
        rr.Points2D(np.column_stack([x[:, 1], rows]), colors=colours, radii=-6.0),
        static=True,
    )
    lift = BELOW * unit
    own = [dots[[d.name for d in dots].index(name)].colour for name in names]
    places = [(-LEFT / 2, tall * (k + 0.5) - lift) for k in range(len(names))]
    _write_labels(stream, f"{path}/name", places, names, NOISE if _shared(dots) else own)
    if _shared(dots):
        _write_legend(stream, path, dots)
        return
    texts = [d.text for d in dots]
    ahead = [x[k, 2] + unit * (SPACE + LETTER * len(text)) for k, text in enumerate(texts)]
    _write_labels(stream, f"{path}/number", list(zip(ahead, rows - lift, strict=True)), texts, colours)


def _write_labels(
    stream: rr.RecordingStream,
    path: str,
    places: Sequence[tuple[float, float]],
    texts: Sequence[str],
    colours: Colour | Sequence[Colour],
) -> None:
    labels = rr.Points2D(places, labels=texts, colors=colours, radii=0.0, show_labels=True)
    stream.log(path, labels, static=True)


def _write_legend(stream: rr.RecordingStream, path: str, dots: Sequence[Dot]) -> None:
    """What the colours mean, in a line above the others."""
    meaning = {d.text: d.colour for d in dots}
    places = [(WIDTH * (k + 0.5) / len(meaning), -ROW) for k in range(len(meaning))]
    marks = rr.Points2D(
        places, labels=list(meaning), colors=list(meaning.values()), radii=-6.0, show_labels=True
    )
    stream.log(f"{path}/legend", marks, static=True)


def _names(dots: Sequence[Dot]) -> list[str]:
    """Of the lines, from top to bottom."""
    return list(dict.fromkeys(d.name for d in dots))


def _shared(dots: Sequence[Dot]) -> bool:
    return len(_names(dots)) < len(dots)


def _heights(dots: Sequence[Dot]) -> Array:
    """Height of every dot [lines]: the middle of its line; several share it out."""
    names = [d.name for d in dots]
    order = [names[:k].count(name) for k, name in enumerate(names)]
    line = [_names(dots).index(name) for name in names]
    within = [(k + 0.5) / names.count(name) - 0.5 for k, name in zip(order, names, strict=True)]
    return np.array(line) + 0.5 + SHARE * np.array(within)


def chart_view(path: str, name: str, dots: Sequence[Dot]) -> rrb.Spatial2DView:
    """The view of a chart, its unit in the name."""
    top, tall = (-1.5 * ROW, TALL) if _shared(dots) else (-ROW / 4, ROW)
    bounds = rrb.VisualBounds2D(x_range=(-LEFT, WIDTH + RIGHT), y_range=(top, tall * len(_names(dots)) + ROW))
    return rrb.Spatial2DView(origin=path, name=name, visual_bounds=bounds)


def _decades(dots: Sequence[Dot]) -> tuple[int, int]:
    """Powers of ten that hold all dots."""
    low, high = min(d.low for d in dots), max(d.high for d in dots)
    first = int(np.floor(np.log10(low)))
    return first, max(int(np.ceil(np.log10(high))), first + 1)


def _place(value: float, first: int, last: int) -> float:
    return float(WIDTH * (np.log10(value) - first) / (last - first))
