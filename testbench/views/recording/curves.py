"""Values of several models over a quantity, with their spread and their names at the ends of the lines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.views.recording.pen import Pen
from testbench.views.recording.plane import (
    HALF,
    LINE,
    SPACE,
    Axis,
    apart,
    axis,
    beside,
    dashes,
    plane_view,
    tick_text,
    width,
    write_grid,
)
from testbench.views.recording.style import NOISE, Colour

BOLD, THIN = 1.8, 1.1  #: Half the width of a line [ui points].
BESIDE = 5.0  #: How far values of neighbours stand apart, so that their whiskers are told apart.
WIDEST = 0.4  #: What all of them may take up of the way to the next value [1].


@dataclass(frozen=True)
class Curve:
    """A line of the plot."""

    name: str  #: At its end.
    colour: Colour
    x: Array  #: (n,)
    y: Array  #: Value, and the ends of its spread, (n, 3).
    dashed: bool = False  #: As those with a prior are.
    bold: bool = False  #: What to look at.
    dots: bool = True  #: Whether its values are marked.


def alone(values: Array) -> Array:
    """Values (n,) without a spread, (n, 3)."""
    return np.asarray(np.tile(values[:, None], 3))


@dataclass(frozen=True)
class Curves:
    """Lines over a quantity."""

    path: str  #: Root of its entities, the unit in its name.
    title: str  #: Of its view, unit included.
    curves: Sequence[Curve]
    ticks: Mapping[float, str]  #: Of the quantity; round values where it is empty.
    log: bool = True  #: Whether the axis of values is logarithmic.
    size: tuple[float, float] = HALF  #: Of its pane.

    @cached_property
    def _left(self) -> float:
        return max(width(tick_text(t)) for t in self._y.ticks) + 2 * SPACE

    @cached_property
    def _right(self) -> float:
        return max(width(c.name) for c in self.curves) + 4 * SPACE

    @cached_property
    def _y(self) -> Axis:
        height = self.size[1] - 3 * LINE
        return axis(np.concatenate([c.y.ravel() for c in self.curves]), -height, log=self.log)

    @cached_property
    def _x(self) -> Axis:
        every = np.concatenate([c.x for c in self.curves])
        low, high = float(every.min()), float(every.max())
        room = 0.04 * (high - low) or 1.0
        return Axis(low - room, high + room, self.size[0] - self._left - self._right, log=False)

    def view(self) -> rrb.Spatial2DView:
        """The view of the lines."""
        ends = (-self._left, self._x.length + self._right), (self._y.length - LINE, 2 * LINE)
        return plane_view(self.path, self.title, *ends)

    def write(self, pen: Pen) -> None:
        """Grid, lines, spreads and names."""
        self._write_axes(pen)
        both = list(zip(self.curves, self._lines, strict=True))
        drawn = [(c, part) for c, line in both for part in (dashes(line) if c.dashed else [line])]
        strips = rr.LineStrips2D(
            [part for _, part in drawn],
            colors=[c.colour for c, _ in drawn],
            radii=[-BOLD if c.bold else -THIN for c, _ in drawn],
        )
        pen.still(f"{self.path}/line", strips)
        self._write_spread(pen)
        marked = [(c, place) for c, line in both if c.dots for place in line]
        if marked:
            radii = [-3 * (BOLD if c.bold else THIN) for c, _ in marked]
            colours = [c.colour for c, _ in marked]
            pen.still(f"{self.path}/value", rr.Points2D([p for _, p in marked], colors=colours, radii=radii))
        self._write_names(pen, np.array([line[-1] for line in self._lines]))

    def write_cursor(self, pen: Pen, x: Array) -> None:
        """A line that follows the time bar, at x (rows,)."""
        pen.still(f"{self.path}/cursor", rr.LineStrips2D.from_fields(colors=NOISE, radii=-1.0))
        at = self._x.at(x)
        strips = [[(one, self._y.length), (one, 0)] for one in at]
        pen.rows(f"{self.path}/cursor", rr.LineStrips2D.columns(strips=strips).partition([1] * len(at)))

    @cached_property
    def _lines(self) -> list[Array]:
        """Where the values are, (n, 2) a curve; those of curves with a spread stand side by side."""
        own = [c.name for c in self.curves if np.ptp(c.y, axis=1).any()]
        steps = len({*np.concatenate([c.x for c in self.curves]).tolist()})
        each = min(BESIDE, WIDEST * self._x.length / max(1, steps) / max(1, len(own)))
        shift = {name: each * (k - (len(own) - 1) / 2) for k, name in enumerate(own)}
        return [
            np.column_stack([self._x.at(c.x) + shift.get(c.name, 0.0), self._y.at(c.y[:, 0])])
            for c in self.curves
        ]

    def _write_axes(self, pen: Pen) -> None:
        x, y = self._x, self._y
        ticks = self.ticks or {t: tick_text(t) for t in x.ticks}
        across, up = x.at(np.array(list(ticks))), y.at(np.array(y.ticks))
        level = [[(0.0, float(h)), (x.length, float(h))] for h in up]
        write_grid(pen, f"{self.path}/axis", [*level, [(0.0, 0.0), (x.length, 0.0)]])
        below = np.column_stack([across, np.zeros(len(across))])
        pen.names(f"{self.path}/ticks_x", below, list(ticks.values()), NOISE)
        left, texts = np.column_stack([np.zeros(len(up)), up]), [tick_text(t) for t in y.ticks]
        pen.names(f"{self.path}/ticks_y", beside(left, texts, -1), texts, NOISE)

    def _write_spread(self, pen: Pen) -> None:
        """From 5 to 95 %."""
        strips = [
            [(float(at), float(low)), (float(at), float(high))]
            for c, line in zip(self.curves, self._lines, strict=True)
            for at, low, high in zip(line[:, 0], *self._y.at(c.y[:, 1:]).T, strict=True)
        ]
        colours = [c.colour for c in self.curves for _ in c.x]
        pen.still(f"{self.path}/spread", rr.LineStrips2D(strips, colors=colours, radii=-1.0))

    def _write_names(self, pen: Pen, ends: Array) -> None:
        """At the ends of the lines, moved apart where they would overlap, and led to."""
        height = apart(ends[:, 1], LINE, (self._y.length, 0.0))
        at = np.column_stack([np.full(len(ends), self._x.length + SPACE), height])
        colours = [c.colour for c in self.curves]
        leaders = [[end, (there[0] + SPACE / 2, there[1])] for end, there in zip(ends, at, strict=True)]
        pen.still(
            f"{self.path}/leader",
            rr.LineStrips2D(leaders, colors=colours, radii=-0.5),
        )
        names = [c.name for c in self.curves]
        pen.names(f"{self.path}/name", beside(at, names, 1), names, colours)
