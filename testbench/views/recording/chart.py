"""Values with their spread on a logarithmic axis: drawn in a plane, so that every dot has its name."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.trials.spread import Number, triple
from testbench.views.recording.pen import Pen
from testbench.views.recording.plane import (
    LINE,
    SPACE,
    WHOLE,
    Axis,
    axis,
    beside,
    plane_view,
    tick_text,
    width,
    write_grid,
)
from testbench.views.recording.style import NOISE, Colour
from testbench.views.schema import Table

SHARE = 0.7  #: How much of a line its dots take up.
DOT = (2.5, 4.5)  #: Radius of a dot, at least and at most.
OUTLINE = 1.2  #: Radius of an outline over that of a dot.
BETWEEN = 26.0  #: Between two entries of the legend.


@dataclass(frozen=True)
class Dot:
    """A value of the chart, on a line of its own or on one with others."""

    name: str  #: What it is; dots of the same name share a line.
    value: Number  #: Not negative.
    colour: Colour  #: Of its role.
    text: str  #: The value for people, unit included; on a shared line what the colour means.
    corners: int = 0  #: Of its outline, many for a ring; filled and round if 0.


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
    size: tuple[float, float] = WHOLE  #: Of its pane.

    @property
    def names(self) -> list[str]:
        """Of the lines, from top to bottom."""
        return list(dict.fromkeys(d.name for d in self.dots))

    @property
    def shared(self) -> bool:
        """Whether several dots are on one line."""
        return len(self.names) < len(self.dots)

    @property
    def legend(self) -> dict[str, Colour]:
        """What the colours of shared lines mean."""
        return {d.text: d.colour for d in self.dots} if self.shared else {}

    @cached_property
    def _entries(self) -> Array:
        """Where the dots of the legend stand, (entries, 2): from left to right, then on the next line."""
        found: list[tuple[float, float]] = []
        x, y = SPACE, 0.0
        for text in self.legend:
            wide = SPACE + width(text)
            if x + wide > self._values.length + self._right and x > SPACE:
                x, y = SPACE, y + LINE
            found.append((x, y))
            x += wide + BETWEEN
        return np.array(found).reshape(-1, 2) - [0.0, y + 1.5 * LINE]

    @cached_property
    def _left(self) -> float:
        return max(map(width, self.names)) + 2 * SPACE

    @cached_property
    def _right(self) -> float:
        return SPACE if self.shared else max(width(d.text) for d in self.dots) + 2 * SPACE

    @cached_property
    def _values(self) -> Axis:
        every = np.array([triple(d.value) for d in self.dots])
        return axis(every, self.size[0] - self._left - self._right, log=True)

    @cached_property
    def _top(self) -> float:
        return -LINE if not self.shared else float(self._entries[:, 1].min()) - LINE

    @cached_property
    def _bottom(self) -> float:
        """Where the lines end: as low as the pane allows, and as each needs for its text."""
        return max(self.size[1] + self._top - 2 * LINE, LINE * len(self.names))

    def view(self) -> rrb.Spatial2DView:
        """The view of the chart."""
        ends = (-self._left, self._values.length + self._right), (self._top, self._bottom + 2 * LINE)
        return plane_view(self.path, self.title, *ends)

    def write(self, pen: Pen) -> None:
        """Dots, whiskers, names and a grid."""
        values = self._values.at(np.array([triple(d.value) for d in self.dots]))
        ticks, y = self._values.at(np.array(self._values.ticks)), self._heights()
        write_grid(pen, f"{self.path}/axis", [[(float(t), 0.0), (float(t), self._bottom)] for t in ticks])
        below = np.column_stack([ticks, np.full(len(ticks), self._bottom)])
        pen.names(f"{self.path}/ticks", below, [tick_text(t) for t in self._values.ticks], NOISE)
        colours = [d.colour for d in self.dots]
        spread = np.stack([values[:, 1:], np.column_stack([y, y])], axis=2)
        pen.still(f"{self.path}/spread", rr.LineStrips2D([*spread], colors=colours, radii=-1.5))
        places = np.column_stack([values[:, 0], y])
        filled = [k for k, dot in enumerate(self.dots) if not dot.corners]
        shades = [colours[k] for k in filled]
        pen.still(f"{self.path}/value", rr.Points2D(places[filled], colors=shades, radii=-self._dot))
        self._write_outlines(pen, places)
        self._write_words(pen, values.max(axis=1), y)

    def _write_outlines(self, pen: Pen, places: Array) -> None:
        """Polygons about the places of dots with corners, (dots, 2)."""
        drawn = [k for k, dot in enumerate(self.dots) if dot.corners]
        if drawn:
            shapes = [places[k] + OUTLINE * self._dot * _polygon(self.dots[k].corners) for k in drawn]
            colours = [self.dots[k].colour for k in drawn]
            pen.still(f"{self.path}/outline", rr.LineStrips2D(shapes, colors=colours, radii=-1.0))

    def write_cursor(self, pen: Pen, number: Array, lines: int = 1) -> None:
        """Lines above and below what the time bar is at: so many lines from a number, (rows,) from 1."""
        pen.still(f"{self.path}/cursor", rr.LineStrips2D.from_fields(colors=NOISE, radii=-1.0))
        ends = (-self._left, self._values.length + self._right)
        each = self._bottom / len(self.names)
        strips = [[(x, each * y) for x in ends] for k in number for y in (k - 1, k - 1 + lines)]
        columns = rr.LineStrips2D.columns(strips=strips)
        pen.rows(f"{self.path}/cursor", columns.partition([2] * len(number)))

    def _write_words(self, pen: Pen, right: Array, y: Array) -> None:
        """Names of the lines; numbers, or on shared lines what the colours mean, above."""
        own = [next(d.colour for d in self.dots if d.name == name) for name in self.names]
        middles = self._bottom * (np.arange(len(own)) + 0.5) / len(own)
        left = np.column_stack([np.zeros(len(own)), middles])
        pen.names(
            f"{self.path}/name", beside(left, self.names, -1), self.names, NOISE if self.shared else own
        )
        if not self.shared:
            texts, colours = [d.text for d in self.dots], [d.colour for d in self.dots]
            pen.names(f"{self.path}/number", beside(np.column_stack([right, y]), texts, 1), texts, colours)
            return
        texts, colours = list(self.legend), list(self.legend.values())
        pen.still(f"{self.path}/key", rr.Points2D(self._entries, colors=colours, radii=-5.0))
        pen.names(f"{self.path}/legend", beside(self._entries, texts, 1), texts, colours)

    @property
    def _dot(self) -> float:
        """Radius of a dot: those of a line do not cover each other where there is room."""
        each = self._bottom / len(self.names) * SHARE
        return float(np.clip(0.7 * each / len(self.legend or [1]), *DOT))

    def _heights(self) -> Array:
        """Height of every dot: the middle of its line; several share it out."""
        names, each = [d.name for d in self.dots], self._bottom / len(self.names)
        within = [(names[:k].count(n) + 0.5) / names.count(n) - 0.5 for k, n in enumerate(names)]
        return each * (np.array([self.names.index(n) for n in names]) + 0.5 + SHARE * np.array(within))


def _polygon(corners: int) -> Array:
    """A closed polygon about the origin, one corner above, (corners + 1, 2)."""
    turn = 2 * np.pi * np.arange(corners + 1) / corners
    return np.column_stack([np.sin(turn), -np.cos(turn)])
