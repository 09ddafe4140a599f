"""A sweep as its views read it: points of several models over a quantity, and how each model is drawn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from testbench.data.dataset import Ids
from testbench.errors import BenchError
from testbench.trials.spread import Number, middle, triple
from testbench.views.colours import Look
from testbench.views.markdown import Words
from testbench.views.recording.chart import Chart, Dot
from testbench.views.recording.pen import snake
from testbench.views.recording.style import Drawn, drawn
from testbench.views.schema import Column


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
class Sweep:
    """Values of several models over a quantity."""

    x: Column  #: What is swept; on the timeline its values are rounded to whole ones and must differ.
    y: Column  #: What is measured.
    points: Sequence[Point]  #: In any order; every model at every x.
    looks: Mapping[str, Look]  #: Of the models, by name.
    #: What stands for x in words, by x, where x only numbers things: no line joins them then.
    labels: Mapping[float, str] = field(default_factory=dict)

    def place(self, x: float) -> str:
        """A value of the swept quantity, or what it numbers."""
        return f"{x:.6g} {self.labels[x]}" if x in self.labels else f"{x:.6g}"

    @property
    def models(self) -> list[str]:
        """Names in order of appearance."""
        return list(dict.fromkeys(point.model for point in self.points))

    def line(self, model: str) -> list[Point]:
        """Points of a model in order of x."""
        return sorted((p for p in self.points if p.model == model), key=lambda p: p.x)

    def drawn(self, model: str) -> Drawn:
        """Colour and shape of a model."""
        return drawn(self.looks[model], bold=True)

    def chart(self, path: str) -> Chart:
        """A line at every x, on it the models; `path` is the root of its entities."""
        own = sorted(self.points, key=lambda p: p.x)
        names = [self.labels.get(p.x, f"{p.x:g} {self.x.heading}") for p in own]
        looks = [self.drawn(p.model) for p in own]
        found = [Dot(n, p.y, d.colour, p.model) for n, p, d in zip(names, own, looks, strict=True)]
        return Chart(path, f"{self.title} ({self.y.unit}), logarithmic", found)

    @property
    def root(self) -> str:
        """Path of what is plotted, its unit in the name."""
        unit = {"%": "percent", "1": "ratio"}.get(self.y.unit, self.y.unit)
        return snake(f"{self.y.heading} {unit}")

    @property
    def title(self) -> str:
        """Of what is plotted."""
        return f"{self.y.heading[:1].upper()}{self.y.heading[1:]}"

    @property
    def steps(self) -> Ids:
        """Values of x as whole numbers, the places on the timeline.

        Raises:
            BenchError: When two values of x are the same whole number, or a model lacks a value of x.
        """
        x = sorted({point.x for point in self.points})
        steps = np.rint(x).astype(int)
        if len(set(steps.tolist())) < len(x):
            name = self.x.heading
            raise BenchError(f"sweep: expected values of {name} that differ after rounding, got {x}")
        for model in self.models:
            if [p.x for p in self.line(model)] != x:
                raise BenchError(f"sweep: expected {model!r} once at every value of {self.x.heading}")
        return steps

    @property
    def columns(self) -> list[tuple[Point, ...]]:
        """The models at every x."""
        return list(zip(*map(self.line, self.models), strict=True))

    @property
    def words(self) -> Words:
        """The blocks of `sweep.md.j2`; of the block `step` one at every x, with its points."""
        return Words(Path(__file__).parent, {"sweep": self, "triple": triple}, "sweep.md.j2")
