"""The recording of a sweep: accuracy against a swept quantity, with its spread, one line a model."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.data.dataset import Ids
from testbench.errors import BenchError
from testbench.trials.spread import ends, middle
from testbench.views.colours import Look
from testbench.views.markdown import lines as grid
from testbench.views.recording.chart import Dot, chart_view, write_chart
from testbench.views.recording.stream import Header, layout, recording, write_texts
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
LARGE = 1000.0
"""Numbers from here on are shown without decimals."""
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
        question: One line.
        answer: One line with numbers and units.
        swept: Name of the swept quantity.
        swept_unit: Its unit, empty for a count; values must differ after rounding to whole ones, for the
            timeline.
        measured: Name of what is plotted.
        unit: Its unit.
        points: In any order; every model at every x.
        colours: Of the models by name, where roles decide; others take the next free one.
        remarks: Markdown below the table.
        labels: What stands for x in words, by x, where x only numbers things: no line joins them then.
        looks: Of models that have a structure, by name; before `colours`.
        words: The whole summary in Markdown, in place of question, answer, medians and remarks.
    """

    scenario: str
    parameters: object
    seed: int
    question: str
    answer: str
    swept: str
    swept_unit: str
    measured: str
    unit: str
    points: Sequence[Point]
    colours: Mapping[str, Colour]
    remarks: str = ""
    labels: Mapping[float, str] = field(default_factory=dict)
    looks: Mapping[str, Look] = field(default_factory=dict)
    words: str = ""

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


def write_sweep(path: Path, sweep: Sweep) -> None:
    """Write a sweep for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        sweep: Numbers and words.

    Raises:
        BenchError: When two values of x are the same whole number, or a model lacks a value of x.
    """
    steps = _steps(sweep)
    parameters = sweep.parameters
    text = parameters if isinstance(parameters, str) else json.dumps(parameters, sort_keys=True)
    header = Header("sweep", sweep.scenario, text, sweep.seed)
    with recording(path, header, _blueprint(sweep)) as stream:
        write_texts(stream, {"summary": summary(sweep), "table": table(sweep)})
        captions = [_caption(sweep, k) for k in range(len(steps))]
        columns = rr.TextDocument.columns(text=captions, media_type=["text/markdown"] * len(steps))
        stream.send_columns("this_step", [rr.TimeColumn(TIMELINE, sequence=steps)], columns)
        if sweep.labels:
            write_chart(stream, _root(sweep), sweep.dots)
        else:
            write_lines(stream, sweep)


def write_lines(stream: rr.RecordingStream, sweep: Sweep) -> None:
    """The lines of `plot_views`, one a model with its spread, on the timeline `sweep`.

    Args:
        stream: Where to.
        sweep: Numbers and words.

    Raises:
        BenchError: When two values of x are the same whole number, or a model lacks a value of x.
    """
    time = rr.TimeColumn(TIMELINE, sequence=_steps(sweep))
    for model in sweep.models:
        _write_line(stream, sweep, model, time)


def _steps(sweep: Sweep) -> Ids:
    """Values of x as whole numbers, the places on the timeline."""
    x = sorted({point.x for point in sweep.points})
    steps = np.rint(x).astype(int)
    if len(set(steps.tolist())) < len(x):
        raise BenchError(f"sweep: expected values of {sweep.swept} that differ after rounding, got {x}")
    for model in sweep.models:
        if [p.x for p in sweep.line(model)] != x:
            raise BenchError(f"sweep: expected {model!r} once at every value of {sweep.swept}")
    return steps


def _write_line(stream: rr.RecordingStream, sweep: Sweep, model: str, time: rr.TimeColumn) -> None:
    """Median as a bold line with dots, 5 and 95 % as thin ones; values and their logarithms."""
    name = re.sub(r"\W+", "_", model.lower()).strip("_")
    look, line = sweep.drawn(model), sweep.line(model)
    values = np.array([[p.median, p.p05, p.p95] for p in line])
    roots = {_root(sweep): values, f"log10_{_root(sweep)}": np.log10(np.maximum(values, SMALLEST))}
    for root, data in roots.items():
        unit = f"log10 {sweep.unit}" if root.startswith("log10") else sweep.unit
        for column, what in enumerate(("median", "p05", "p95")):
            path, width = f"{root}/{name}/{what}", 3.0 if what == "median" else 1.0
            shown = f"{model} ({unit})"  # of all three: the legend then has a model once
            stream.log(path, rr.SeriesLines(colors=look.colour, widths=width, names=shown), static=True)
            if what == "median":
                dots = rr.SeriesPoints(colors=look.colour, markers=look.shape, names=shown, marker_sizes=4.0)
                stream.log(path, dots, static=True)
            stream.send_columns(path, [time], rr.Scalars.columns(scalars=data[:, column]))


def _root(sweep: Sweep) -> str:
    """Path of what is plotted, its unit in the name."""
    unit = {"%": "percent", "1": "ratio"}.get(sweep.unit, sweep.unit)
    return re.sub(r"\W+", "_", f"{sweep.measured} {unit}".lower())


def summary(sweep: Sweep) -> str:
    """Question, answer, table, legend, how to scrub."""
    models = sweep.models
    x = [p.x for p in sweep.line(models[0])]
    rows = [
        [sweep.place(value), *(_number(sweep.line(m)[k].median) for m in models)] for k, value in enumerate(x)
    ]
    head = [sweep.heading, *models]
    medians = [
        f"### {sweep.question}",
        f"#### **{sweep.answer}**",
        f"Median {sweep.measured}, {sweep.unit}:",
        grid(head, rows),
        sweep.remarks,
    ]
    drawn_as = (
        "**Dots** Median, with a bar from 5 to 95 %. One colour a model."
        if sweep.labels
        else "**Lines** Bold with dots: median. Thin: 5 and 95 %. One colour and one shape a model. "
        f"Above: {sweep.unit}; below: log10 of the same."
    )
    rounded = "" if sweep.labels else ", rounded"
    scrub = f"**Scrub** `{TIMELINE}` is the {sweep.heading}{rounded}."
    return "\n\n".join(filter(None, [*([sweep.words] if sweep.words else medians), drawn_as, scrub]))


def table(sweep: Sweep) -> str:
    """Every number with its spread."""
    rows = [
        [model, sweep.place(p.x), *(_number(v) for v in (p.median, p.p05, p.p95))]
        for model in sweep.models
        for p in sweep.line(model)
    ]
    head = [
        "model",
        sweep.heading,
        *(f"{k}, {sweep.unit}" for k in ("median", "5 %", "95 %")),
    ]
    return "\n\n".join([f"### {sweep.measured[:1].upper()}{sweep.measured[1:]}", grid(head, rows)])


def _caption(sweep: Sweep, k: int) -> str:
    points = [sweep.line(model)[k] for model in sweep.models]
    unit = "" if sweep.labels or not sweep.swept_unit else f" {sweep.swept_unit}"
    rows = [[p.model, *(_number(v) for v in (p.median, p.p05, p.p95))] for p in points]
    place = f"**{sweep.swept.capitalize()} {sweep.place(points[0].x)}{unit}**"
    head = [f"{sweep.measured}, {sweep.unit}", "median", "5 %", "95 %"]
    return "\n\n".join([place, grid(head, rows)])


def _number(value: float) -> str:
    """Four digits, never 1.2e+03."""
    return f"{value:.0f}" if value >= LARGE else f"{value:.4g}"


def plot_views(sweep: Sweep, hint: str = "") -> list[rrb.TimeSeriesView]:
    """The plot in its unit, and the logarithms of the same.

    Args:
        sweep: Numbers and words.
        hint: Ends the titles, where the reader does not land on the timeline `sweep`.
    """
    root = _root(sweep)
    axis = f"over {sweep.heading}{hint}"
    x = np.rint([p.x for p in sweep.points]).astype(int)
    margin = max(1, round(0.03 * float(np.ptp(x))))
    ends = [rr.TimeRangeBoundary.absolute(seq=int(k)) for k in (x.min() - margin, x.max() + margin)]
    scales = {root: sweep.unit, f"log10_{root}": f"log10 {sweep.unit}"}
    return [
        rrb.TimeSeriesView(
            origin=path,
            name=f"{sweep.measured[:1].upper()}{sweep.measured[1:]} ({unit}) {axis}",
            axis_x=rrb.TimeAxis(view_range=rr.TimeRange(*ends)),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=path == root),
        )
        for path, unit in scales.items()
    ]


def _chart(sweep: Sweep) -> rrb.Spatial2DView:
    name = f"{sweep.measured[:1].upper()}{sweep.measured[1:]} ({sweep.unit}), logarithmic"
    return chart_view(_root(sweep), name, sweep.dots)


def _blueprint(sweep: Sweep) -> rrb.Blueprint:
    plots = [_chart(sweep)] if sweep.labels else plot_views(sweep)
    overview = rrb.Horizontal(
        rrb.Vertical(*plots),
        rrb.Vertical(
            rrb.TextDocumentView(origin="summary", name="Summary"),
            rrb.TextDocumentView(origin="this_step", name="This step"),
            row_shares=[5, 2],
        ),
        column_shares=[10, 9],
        name="Overview",
    )
    return layout(overview, rrb.TextDocumentView(origin="table", name="Table"), timeline=TIMELINE)
