"""A sweep as its views read it: points of several models over a quantity, and how each model is drawn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from testbench.data.dataset import Ids
from testbench.errors import BenchError
from testbench.trials.spread import Number, middle, spans, triple
from testbench.views.colours import Look
from testbench.views.markdown import Words
from testbench.views.recording.chart import Chart, Dot
from testbench.views.recording.curves import Curve, Curves
from testbench.views.recording.pen import snake
from testbench.views.recording.plane import HALF, SMALLEST
from testbench.views.recording.style import Drawn, drawn
from testbench.views.schema import ALIKE, Column

WHOLE_FROM = 1000  #: Values of the swept quantity from which no decimals are shown.
TITLE = 62  #: Letters of a title at most: more are cut in the smallest window.


@dataclass(frozen=True)
class Point:
    """One value of one model."""

    x: float  #: The swept quantity.
    model: str  #: Which line it belongs to.
    y: Number  #: Not negative.


def points(rows: Sequence[object], model: Column, x: Column, y: Column) -> list[Point]:
    """Points of a table's rows; `model` names the line."""
    return [Point(middle(x.value(row)), model.cell(row), y.value(row)) for row in rows]


@dataclass(frozen=True)
class Step:
    """The models at one value of the swept quantity."""

    number: int  #: From 1, in the order of the quantity.
    points: Sequence[Point]  #: The least first.
    theirs: Point  #: The least of those that the others are compared with.
    best: Point  #: The least of all.

    @property
    def ratio(self) -> float:
        """Theirs over the best [1]."""
        theirs, best = (max(middle(p.y), SMALLEST) for p in (self.theirs, self.best))
        return theirs / best

    @property
    def alike(self) -> bool:
        """Whether they are as good as each other."""
        return self.ratio <= 1 + ALIKE


@dataclass(frozen=True)
class Sweep:
    """Values of several models over a quantity."""

    x: Column  #: What is swept.
    y: Column  #: What is measured.
    points: Sequence[Point]  #: In any order; a model may lack values of x.
    looks: Mapping[str, Look]  #: Of the models, by name.
    #: What stands for x in words, by x, where x only numbers things: no line joins them then.
    labels: Mapping[float, str] = field(default_factory=dict)
    #: What the others are compared with, such as least squares; where there is none the greatest.
    against: Sequence[str] = ()
    among: Sequence[str] = ()  #: Of which the best is sought; of all where it is empty.

    def place(self, x: float) -> str:
        """A value of the swept quantity, or what it numbers."""
        return self.labels.get(x, f"{x:.0f}" if abs(x) >= WHOLE_FROM else f"{x:.6g}")

    @property
    def unit(self) -> str:
        """Of the swept quantity, where its name does not say it."""
        return "" if self.labels or self.x.unit == self.x.heading else self.x.unit

    @cached_property
    def models(self) -> list[str]:
        """Names in order of appearance."""
        return list(dict.fromkeys(point.model for point in self.points))

    def line(self, model: str) -> list[Point]:
        """Points of a model in order of x."""
        return sorted((p for p in self.points if p.model == model), key=lambda p: p.x)

    def drawn(self, model: str) -> Drawn:
        """Colour and shape of a model."""
        return drawn(self.looks[model])

    def plot(self, path: str, size: tuple[float, float] = HALF) -> Chart | Curves:
        """Lines over the quantity; what is only numbered has a line of its own, on it the models as dots.

        `path` is the root of its entities, `size` that of its pane [ui points].
        """
        return self._chart(path, size) if self.labels else self._curves(path, size)

    def _chart(self, path: str, size: tuple[float, float]) -> Chart:
        own = sorted(self.points, key=lambda p: p.x)
        found = [Dot(self.place(p.x), p.y, self.drawn(p.model).colour, p.model) for p in own]
        return Chart(path, self.view_title, found, size)

    def _curves(self, path: str, size: tuple[float, float]) -> Curves:
        number = {step.best.x: float(step.number) for step in self.steps}
        found = [
            Curve(
                model,
                self.drawn(model).colour,
                np.array([number[p.x] for p in self.line(model)]),
                np.array([triple(p.y) for p in self.line(model)]),
                dashed=self.looks[model].prior,
                bold=model not in self.against,
            )
            for model in self.models
        ]
        ticks = {at: self.place(x) for x, at in number.items()}
        return Curves(path, self.view_title, found, ticks, size=size)

    @property
    def root(self) -> str:
        """Path of what is plotted, its unit in the name."""
        return snake(f"{self.y.heading} {'percent' if self.y.unit == '%' else self.y.unit or 'ratio'}")

    @property
    def title(self) -> str:
        """Of what is plotted."""
        return f"{self.y.heading[:1].upper()}{self.y.heading[1:]}"

    @property
    def view_title(self) -> str:
        """The same with its unit, and with what is swept where that is not cut."""
        own = f"{self.title} ({self.y.unit or 'ratio'})"
        over = f"{own} over {self.x.heading}{f' ({self.unit})' if self.unit else ''}"
        return own if self.labels or len(over) > TITLE else over

    @cached_property
    def steps(self) -> list[Step]:
        """The models at every x, in order.

        Raises:
            BenchError: When a model has two values at one x.
        """
        found: dict[float, dict[str, Point]] = {}
        for point in self.points:
            if found.setdefault(point.x, {}).setdefault(point.model, point) is not point:
                raise BenchError(f"sweep: expected {point.model!r} once at every value of {self.x.heading}")
        return [self._step(k, list(found[x].values())) for k, x in enumerate(sorted(found), 1)]

    def _step(self, number: int, own: Sequence[Point]) -> Step:
        ordered = sorted(own, key=lambda p: middle(p.y))
        theirs = [p for p in ordered if p.model in self.against] or ordered[-1:]
        ours = [p for p in ordered if not self.among or p.model in self.among]
        return Step(number, ordered, theirs[0], ours[0])

    @property
    def rank(self) -> Ids:
        """Place of every step by how much the best differs from what it is compared with, (steps,)."""
        found = np.empty(len(self.steps), dtype=int)
        found[np.argsort([-step.ratio for step in self.steps], kind="stable")] = np.arange(len(found))
        return found

    @property
    def widest(self) -> Step:
        """Where they differ most."""
        return self.steps[int(self.rank.argmin())]

    @property
    def spans(self) -> str:
        """What the ends of what is plotted are."""
        return spans(point.y for point in self.points) or "none"

    @property
    def words(self) -> Words:
        """The blocks of `sweep.md.j2`; of the block `step` one a step."""
        return Words(Path(__file__).parent, {"sweep": self, "triple": triple}, "sweep.md.j2")
