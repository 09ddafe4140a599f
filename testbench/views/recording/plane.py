"""The plane that plots are drawn in: they stand still, so that no timeline leaves them blank.

Its unit is a point of the screen in the smallest window, 1280x720: there nothing may overlap, and in a
larger one, where letters keep their size, there is more room.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.views.recording.pen import Pen
from testbench.views.recording.style import NOISE
from testbench.views.schema import show

HALF, WHOLE = (640.0, 390.0), (1240.0, 560.0)
"""Width and height of a pane: of half a tab with a text below it, and of a whole tab."""
TITLE = 30.0  #: Height of a pane's title.
NARROW, WIDE = "fijlrt.,:;'|()[] ", "mwMW%"
LETTERS = (4.2, 7.6, 11.0)  #: Width of a narrow letter, of a usual and of a wide one.
LINE = 20.0  #: Least distance of two lines of text.
BELOW = 14.0  #: How far a label stands below its point: text at a height is put that much higher.
SPACE = 12.0  #: Between a point and the text that belongs to it.
SMALLEST = 1e-9  #: Values below are drawn here where the axis is logarithmic.
STEPS = (1, 2, 5)  #: Ticks, times powers of ten.
LADDERS = ((range(1, 10), 1), (STEPS, 1), ((1,), 1), ((1,), 2), ((1,), 3), ((1,), 4))
"""The same on a logarithmic axis, from fine to coarse: digits, and of how many powers one has them."""
FEW, TICK = 10, 30.0  #: Ticks on an axis at most, and their least distance.
NARROWEST = 3  #: Steps on a logarithmic axis so short that round numbers of its powers do not fit.


@dataclass(frozen=True)
class Axis:
    """An axis of a plot."""

    low: float
    high: float
    length: float  #: From one end to the other; negative where it points up.
    log: bool = True

    def at(self, values: Array) -> Array:
        """Where values are, from its beginning."""
        low, high = self._scaled(np.array([self.low, self.high]))
        return np.asarray(self.length * (self._scaled(values) - low) / (high - low))

    @property
    def ticks(self) -> list[float]:
        """Round values between its ends, at most FEW."""
        if self.log:
            powers = range(int(np.floor(np.log10(self.low))), int(np.ceil(np.log10(self.high))) + 1)
            every = ([k * 10.0**p for p in powers[::step] for k in digits] for digits, step in LADDERS)
            within = ([t for t in found if self.low <= t <= self.high] for found in every)
            clear = next((found for found in within if len(found) <= FEW and self._clear(found)), None)
            if clear is not None:
                return clear
        rough = (self.high - self.low) / (NARROWEST if self.log else FEW)
        power = 10.0 ** np.floor(np.log10(rough))
        step = next(k * power for k in (*STEPS, 10) if k * power >= rough)
        return [float(t) for t in step * np.arange(np.ceil(self.low / step), self.high / step + 1e-9)]

    def _clear(self, ticks: Sequence[float]) -> bool:
        """Whether there are two ticks or more, and none stands nearer to the next than its text is wide."""
        return len(ticks) > 1 and float(np.abs(np.diff(self.at(np.array(ticks)))).min()) >= TICK

    def _scaled(self, values: Array) -> Array:
        return np.log10(np.maximum(values, SMALLEST)) if self.log else np.asarray(values, dtype=float)


def axis(values: Array, length: float, *, log: bool) -> Axis:
    """An axis around values, with some room at either end."""
    if not log:
        low, high = float(values.min()), float(values.max())
        room = 0.05 * (high - low) or 1.0
        return Axis(low if low == 0 else low - room, high + room, length, log=False)
    kept = np.maximum(values, SMALLEST)
    low, high = float(kept.min()), float(kept.max())
    room = max((high / low) ** 0.06, 1.25)
    return Axis(low / room, high * room, length)


def width(text: str) -> float:
    """Of a text on the screen."""
    return sum(LETTERS[1 + (letter in WIDE) - (letter in NARROW)] for letter in text)


def beside(at: Array, texts: Sequence[str], side: float) -> Array:
    """Where texts stand beside points (n, 2): right of them (1), left (-1) or about their middle (0)."""
    ahead = side * (SPACE + np.array([width(text) for text in texts]) / 2)
    return np.asarray(at + np.column_stack([ahead, np.full(len(texts), -BELOW)]))


def write_grid(pen: Pen, path: str, lines: Sequence[Sequence[tuple[float, float]]]) -> None:
    """Thin lines, each from one point to another."""
    pen.still(path, rr.LineStrips2D(lines, colors=NOISE, radii=-0.5))


def tick_text(value: float) -> str:
    """A tick for people."""
    return show(value, ".6g")


def apart(wanted: Array, least: float, ends: tuple[float, float]) -> Array:
    """Places (n,) near those wanted, no two nearer than a distance, within ends as far as there is room."""
    order, (low, high) = np.argsort(wanted, kind="stable"), ends
    found = np.array(wanted, dtype=float)[order]
    for k in range(len(found)):
        found[k] = max(found[k], low if k == 0 else found[k - 1] + least)
    for k in reversed(range(len(found))):
        found[k] = min(found[k], high if k == len(found) - 1 else found[k + 1] - least)
    back = np.empty_like(found)
    back[order] = found
    return back


def dashes(strip: Array, on: float = 7.0, off: float = 5.0) -> list[Array]:
    """A strip of points (n, 2) as dashes."""
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(strip, axis=0), axis=1))])
    starts = np.arange(0, along[-1], on + off)
    found = []
    for start in starts:
        within = along[(along > start) & (along < start + on)]
        where = np.concatenate([[start], within, [min(start + on, along[-1])]])
        found.append(np.column_stack([np.interp(where, along, part) for part in strip.T]))
    return found


def plane_view(path: str, title: str, x: tuple[float, float], y: tuple[float, float]) -> rrb.Spatial2DView:
    """The view of a plane from one end to the other of its width and of its height."""
    return rrb.Spatial2DView(origin=path, name=title, visual_bounds=rrb.VisualBounds2D(x_range=x, y_range=y))
