"""The recording of a comparison of solvers: gap against time, time against time, local minima."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.views.recording.chart import Dot, chart_view, write_chart
from testbench.views.recording.stream import Header, layout, recording, write_texts
from testbench.views.recording.style import NOISE, SHAPES, Colour

TIMELINE = "iteration"
SMALLEST = 1e-12
"""A gap or a time below is drawn here: the axes are logarithmic."""
ACROSS, UP = 150.0, 100.0
"""A power of ten of time and of gap, in the plane's own units."""


@dataclass(frozen=True)
class Race:
    """Solvers on the same data.

    Attributes:
        scenario: Name of the scenario.
        parameters: The settings as JSON.
        seed: Of the ways down.
        summary: Markdown: question, answer, table, legend.
        notes: Markdown: what else is said.
        ways: Seconds and gap at every improvement by solver, (improvements, 2) [s, 1].
        colours: Of every solver.
        bold: The solver with a proof.
        times: Times over all seeds, for the tab of times.
    """

    scenario: str
    parameters: str
    seed: int
    summary: str
    notes: str
    ways: Mapping[str, Array]
    colours: Mapping[str, Colour]
    bold: str
    times: Sequence[Dot]


def write_solver(path: Path, race: Race) -> None:
    """Write a comparison of solvers for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        race: Words and numbers.
    """
    header = Header("solver", race.scenario, race.parameters, race.seed)
    ways = {key: np.maximum(points, SMALLEST) for key, points in race.ways.items()}
    with recording(path, header, _blueprint(race, ways)) as stream:
        write_texts(stream, {"summary": race.summary, "log": race.notes})
        _write_plane(stream, ways, race)
        for k, (key, way) in enumerate(ways.items()):
            _write_way(stream, k, key, way, race)
        write_chart(stream, "time_s", race.times)


def _write_way(stream: rr.RecordingStream, k: int, key: str, way: Array, race: Race) -> None:
    """Gap and time at every improvement over their number."""
    colour = race.colours[key]
    own = "solver_" + re.sub(r"\W", "_short", key)
    time = rr.TimeColumn(TIMELINE, sequence=np.arange(len(way)))
    both = (("log10_gap", "log10 relative gap", way[:, 1]), ("log10_s", "log10 s", way[:, 0]))
    for root, unit, values in both:
        path, name = f"convergence/{root}/{own}", f"({key}) ({unit})"
        width = 3.0 if key == race.bold else 1.5
        stream.log(path, rr.SeriesLines(colors=colour, widths=width, names=name), static=True)
        size = 7.0 if len(way) == 1 else 2.0
        dots = rr.SeriesPoints(colors=colour, markers=SHAPES[k % len(SHAPES)], names=name, marker_sizes=size)
        stream.log(path, dots, static=True)
        stream.send_columns(path, [time], rr.Scalars.columns(scalars=np.log10(values)))


def _write_plane(stream: rr.RecordingStream, ways: Mapping[str, Array], race: Race) -> None:
    """Gap over time on two logarithmic axes, every way with its solver's key at its end."""
    (left, right), (low, high) = _decades(ways)
    across, up = range(left, right + 1), range(low, high + 1)
    root = "gap_over_s"
    lines = [[_place(x, low), _place(x, high)] for x in across]
    lines += [[_place(left, y), _place(right, y)] for y in up]
    stream.log(f"{root}/axis", rr.LineStrips2D(lines, colors=(*NOISE, 90), radii=-0.5), static=True)
    ticks = [(_place(x, low - 0.15), f"{10.0**x:g} s") for x in across]
    ticks += [(_place(left - 0.3, y + 0.1), f"{10.0**y:g}") for y in up]
    _labels(stream, f"{root}/ticks", ticks, [NOISE] * len(ticks))
    logs = {key: np.log10(way) for key, way in ways.items()}
    strips = [[_place(x, y) for x, y in way] for way in logs.values()]
    drawn = [race.colours[key] for key in logs]
    stream.log(f"{root}/way", rr.LineStrips2D(strips, colors=drawn, radii=-1.5), static=True)
    ends = np.array([strip[-1] for strip in strips])
    sizes = [-9.0 if key == race.bold else -6.0 for key in logs]
    stream.log(f"{root}/end", rr.Points2D(ends, colors=drawn, radii=sizes), static=True)
    order = np.argsort(np.argsort(ends[:, 0]))  # labels at several heights: the ends lie close together
    names = [
        ((x, y - UP * (0.35 + 0.2 * (k % 3))), f"({key})")
        for (x, y), k, key in zip(ends.tolist(), order.tolist(), logs, strict=True)
    ]
    _labels(stream, f"{root}/name", names, drawn)


def _labels(
    stream: rr.RecordingStream,
    path: str,
    labels: Sequence[tuple[tuple[float, float], str]],
    colours: Sequence[Colour],
) -> None:
    at, texts = zip(*labels, strict=True)
    points = rr.Points2D(at, labels=texts, colors=colours, radii=0.0, show_labels=True)
    stream.log(path, points, static=True)


def _place(x: float, y: float) -> tuple[float, float]:
    """Of powers of ten in the plane; its y axis points down."""
    return ACROSS * float(x), -UP * float(y)


def _decades(ways: Mapping[str, Array]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Whole powers of ten around all times, and around all gaps."""
    logs = np.log10(np.concatenate(list(ways.values())))
    low, high = np.floor(logs.min(axis=0)).astype(int), np.ceil(logs.max(axis=0)).astype(int)
    (left, bottom), (right, top) = low.tolist(), high.tolist()
    return (left, max(right, left + 1)), (bottom, max(top, bottom + 1))


def _blueprint(race: Race, ways: Mapping[str, Array]) -> rrb.Blueprint:
    (left, right), (low, high) = _decades(ways)
    bounds = rrb.VisualBounds2D(
        x_range=(ACROSS * (left - 0.6), ACROSS * (right + 0.3)),
        y_range=(-UP * (high + 0.3), -UP * (low - 0.5)),
    )
    plane = rrb.Spatial2DView(
        origin="gap_over_s", name="Relative gap (1) over time (s), both log10", visual_bounds=bounds
    )
    name = "Time (s), logarithmic; dot: median; line: 5 to 95 % of the seeds"
    return layout(
        rrb.Horizontal(
            plane,
            rrb.TextDocumentView(origin="summary", name="Summary"),
            column_shares=[10, 9],
            name="Overview",
        ),
        rrb.Vertical(chart_view("time_s", name, race.times), name="Time"),
        rrb.Vertical(
            *(
                rrb.TimeSeriesView(
                    origin=f"convergence/{root}",
                    name=f"{name} over improvements",
                    plot_legend=rrb.PlotLegend(corner),
                )
                for root, name, corner in (
                    ("log10_gap", "Relative gap (log10 of 1)", rrb.Corner2D.RightTop),
                    ("log10_s", "Time (log10 s)", rrb.Corner2D.RightBottom),
                )
            ),
            name="Iterations",
        ),
        rrb.TextDocumentView(origin="log", name="Notes"),
        timeline=TIMELINE,
    )
