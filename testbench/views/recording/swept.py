"""A sweep as its views read it: points of several models over a quantity, and how each model is drawn."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from testbench.data.dataset import Ids
from testbench.errors import BenchError
from testbench.trials.spread import ends, middle
from testbench.views.colours import Look
from testbench.views.recording.chart import Dot
from testbench.views.recording.style import (
    GREENS,
    LOAD,
    MEASURED,
    NOMINAL,
    ORANGES,
    SHAPES,
    Colour,
    Drawn,
    drawn,
)
from testbench.views.schema import Column

TIMELINE = "sweep"
SMALLEST = 1e-12
"""Values below are drawn here: the axis is logarithmic."""
COLOURS: tuple[Colour, ...] = (NOMINAL, ORANGES[0], GREENS[0], LOAD, MEASURED, GREENS[1])
"""Of lines that are neither least squares nor GCO."""


@dataclass(frozen=True)
class Point:
    """One value of one model.

    Attributes:
        x: The swept quantity.
        model: Which line it belongs to.
        median: Not negative.
        p05: Low end of the spread.
        p95: High end of the spread.
    """

    x: float
    model: str
    median: float
    p05: float
    p95: float


def points(rows: Sequence[object], model: Column, x: Column, y: Column) -> list[Point]:
    """Points of a table's rows.

    Args:
        rows: Of all models.
        model: Names the line.
        x: What is swept.
        y: What is measured.
    """
    return [
        Point(middle(x.value(row)), model.cell(row), middle(y.value(row)), *ends(y.value(row)))
        for row in rows
    ]


@dataclass(frozen=True)
class Sweep:
    """A sweep and its words.

    Attributes:
        scenario: Name of the scenario.
        parameters: It as plain data, or as JSON.
        seed: Root of randomness.
        swept: Name of the swept quantity.
        swept_unit: Its unit, empty for a count; values must differ after rounding to whole ones, for the
            timeline.
        measured: Name of what is plotted.
        unit: Its unit.
        points: In any order; every model at every x.
        question: One line.
        answer: One line with numbers and units.
        remarks: Markdown below the table of medians.
        words: The whole summary in Markdown, in place of question, answer, medians and remarks.
        colours: Of the models by name, where roles decide; others take the next free one.
        labels: What stands for x in words, by x, where x only numbers things: no line joins them then.
        looks: Of models that have a structure, by name; before `colours`.
    """

    scenario: str
    parameters: object
    seed: int
    swept: str
    swept_unit: str
    measured: str
    unit: str
    points: Sequence[Point]
    question: str = ""
    answer: str = ""
    remarks: str = ""
    words: str = ""
    colours: Mapping[str, Colour] = field(default_factory=dict)
    labels: Mapping[float, str] = field(default_factory=dict)
    looks: Mapping[str, Look] = field(default_factory=dict)

    @property
    def heading(self) -> str:
        """Swept quantity and unit."""
        return f"{self.swept}, {self.swept_unit}" if self.swept_unit else self.swept

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
        if model in self.looks:
            return drawn(self.looks[model], bold=True)
        free = [c for c in COLOURS if c not in self.colours.values()]
        others = [name for name in self.models if name not in self.colours]
        colour = self.colours.get(model) or free[others.index(model) % len(free)]
        return Drawn(colour, SHAPES[self.models.index(model) % len(SHAPES)], 3.0)

    @property
    def dots(self) -> list[Dot]:
        """The points of a sweep over labels, the models of one label on one line."""
        found = []
        for p in sorted(self.points, key=lambda p: p.x):
            low, value, high = (max(v, SMALLEST) for v in (p.p05, p.median, p.p95))
            found.append(Dot(self.labels[p.x], low, value, high, self.drawn(p.model).colour, p.model))
        return found

    @property
    def root(self) -> str:
        """Path of what is plotted, its unit in the name."""
        unit = {"%": "percent", "1": "ratio"}.get(self.unit, self.unit)
        return re.sub(r"\W+", "_", f"{self.measured} {unit}".lower())

    @property
    def title(self) -> str:
        """Of what is plotted."""
        return f"{self.measured[:1].upper()}{self.measured[1:]}"

    @property
    def steps(self) -> Ids:
        """Values of x as whole numbers, the places on the timeline.

        Raises:
            BenchError: When two values of x are the same whole number, or a model lacks a value of x.
        """
        x = sorted({point.x for point in self.points})
        steps = np.rint(x).astype(int)
        if len(set(steps.tolist())) < len(x):
            raise BenchError(f"sweep: expected values of {self.swept} that differ after rounding, got {x}")
        for model in self.models:
            if [p.x for p in self.line(model)] != x:
                raise BenchError(f"sweep: expected {model!r} once at every value of {self.swept}")
        return steps
