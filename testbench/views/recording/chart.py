"""Values with their spread on a logarithmic axis: drawn in a plane, so that every dot has its name."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.trials.spread import Number, triple
from testbench.views.recording.pen import Pen
from testbench.views.recording.style import NOISE, Colour
from testbench.views.schema import Table

ROW, TALL, WIDTH = 60.0, 100.0, 1000.0
"""Height of a line, of one that several dots share, and width of the axis, in the chart's own units."""
SHARE = 0.7  #: How much of a line its dots take up.
LEFT, RIGHT = 340.0, 200.0  #: Room for names on the left and for numbers on the right.
PANE = 1580.0, 760.0
"""About the size of the view [ui points]: labels keep their size on the screen whatever the chart's."""
BELOW, LETTER, SPACE = 14.0, 3.7, 18.0
"""How far a label stands below its point, half the width of a letter, space before a number [ui points]."""
ABREAST = 4  #: Entries of the legend on one line: more would overlap.
SMALLEST = 1e-9  #: Values below are drawn here: the axis is logarithmic.


@dataclass(frozen=True)
class Dot:
    """A value of the chart, on a line of its own or on one with others."""

    name: str  #: What it is; dots of the same name share a line.
    value: Number  #: Not negative.
    colour: Colour  #: Of its role.
    text: str  #: The value for people, unit included; on a shared line what the colour means.


def dots(table: Table, colours: Sequence[Colour]) -> list[Dot]:
    """A table's numbers, column by column and row by row; those that are None are left out.

    Args:
        table: Its first column names the rows, its bold row is the recommended one.
        colours: One a row.
    """
    name, *columns = table.columns
    found = []
    for column in columns:
        head = f"{column.heading}: " if len(columns) > 1 else ""
        for row, colour in zip(table.rows, colours, strict=True):
            if column.value(row) is not None:
                mark = ", recommended" if table.bold == name.cell(row) else ""
                text = f"{column.cell(row)} {column.unit}{mark}"
                found.append(Dot(head + name.cell(row), column.value(row), colour, text))
    return found


@dataclass(frozen=True)
class Chart:
    """Dots from top to bottom."""

    path: str  #: Root of its entities.
    title: str  #: Of its view, unit included.
    dots: Sequence[Dot]

    @property
    def names(self) -> list[str]:
        """Of the lines, from top to bottom."""
        return list(dict.fromkeys(d.name for d in self.dots))

    @property
    def shared(self) -> bool:
        """Whether several dots are on one line."""
        return len(self.names) < len(self.dots)

    @property
    def bottom(self) -> float:
        """Where the lines end."""
        return self._tall * len(self.names)

    @property
    def _meaning(self) -> dict[str, Colour]:
        """What the colours of shared lines mean."""
        return {d.text: d.colour for d in self.dots}

    @property
    def _tall(self) -> float:
        return TALL if self.shared else ROW

    def view(self) -> rrb.Spatial2DView:
        """The view of the chart."""
        top = -ROW * (0.5 + math.ceil(len(self._meaning) / ABREAST)) if self.shared else -ROW / 4
        bounds = rrb.VisualBounds2D(x_range=(-LEFT, WIDTH + RIGHT), y_range=(top, self.bottom + ROW))
        return rrb.Spatial2DView(origin=self.path, name=self.title, visual_bounds=bounds)

    def write(self, pen: Pen) -> None:
        """Dots, whiskers, names and a grid of powers of ten."""
        values = np.array([triple(d.value) for d in self.dots])
        logs = np.log10(np.maximum(values, SMALLEST))
        first = int(np.floor(logs.min()))
        last = max(int(np.ceil(logs.max())), first + 1)
        ticks = WIDTH * np.linspace(0, 1, last - first + 1)
        x, y = WIDTH * (logs - first) / (last - first), self._tall * self._heights()
        lines = [[(t, 0), (t, self.bottom)] for t in ticks]
        pen.still(f"{self.path}/axis", rr.LineStrips2D(lines, colors=(*NOISE, 120), radii=-0.5))
        marks = rr.Points2D(
            [(t, self.bottom + ROW / 2) for t in ticks],
            labels=[f"{10.0**k:g}" for k in range(first, last + 1)],
            colors=NOISE,
            radii=-1.0,
            show_labels=True,
        )
        pen.still(f"{self.path}/ticks", marks)
        colours = [d.colour for d in self.dots]
        spread = np.stack([x[:, 1:], np.column_stack([y, y])], axis=2)
        pen.still(f"{self.path}/spread", rr.LineStrips2D(spread, colors=colours, radii=-2.0))
        places = rr.Points2D(np.column_stack([x[:, 0], y]), colors=colours, radii=-6.0)
        pen.still(f"{self.path}/value", places)
        self._write_words(pen, x[:, 2], y)

    def _write_words(self, pen: Pen, right: Array, y: Array) -> None:
        """Names of the lines; numbers, or on shared lines what the colours mean, above."""
        unit = max((LEFT + WIDTH + RIGHT) / PANE[0], (self.bottom + ROW) / PANE[1])  # of the chart a ui point
        lift = BELOW * unit
        own = [next(d.colour for d in self.dots if d.name == name) for name in self.names]
        places = [(-LEFT / 2, self._tall * (k + 0.5) - lift) for k in range(len(own))]
        pen.names(f"{self.path}/name", np.array(places), self.names, NOISE if self.shared else own)
        if not self.shared:
            texts = [d.text for d in self.dots]
            ahead = right + unit * (SPACE + LETTER * np.array([len(text) for text in texts]))
            colours = [d.colour for d in self.dots]
            pen.names(f"{self.path}/number", np.column_stack([ahead, y - lift]), texts, colours)
            return
        names, colours = list(self._meaning), list(self._meaning.values())
        columns, lines = min(ABREAST, len(names)), math.ceil(len(names) / ABREAST)
        places = [
            (WIDTH * (k % ABREAST + 0.5) / columns, -ROW * (lines - k // ABREAST)) for k in range(len(names))
        ]
        marks = rr.Points2D(places, labels=names, colors=colours, radii=-6.0, show_labels=True)
        pen.still(f"{self.path}/legend", marks)

    def _heights(self) -> Array:
        """Height of every dot [lines]: the middle of its line; several share it out."""
        names = [d.name for d in self.dots]
        within = [(names[:k].count(n) + 0.5) / names.count(n) - 0.5 for k, n in enumerate(names)]
        return np.array([self.names.index(n) for n in names]) + 0.5 + SHARE * np.array(within)
