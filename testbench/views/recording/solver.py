"""The recording of a comparison of solvers: gap against time, time against time, local minima."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.trials.spread import spans
from testbench.views.recording.chart import Chart, Dot
from testbench.views.recording.pen import Line, Pen, text_view
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.style import NOISE, SHAPES, Colour

TIMELINE = "iteration"
SMALLEST = 1e-12  #: A gap or a time below is drawn here: the axes are logarithmic.
SCALE = np.array([150.0, -100.0])
"""A power of ten of time and of gap, in the plane's own units; its y axis points down."""
PLANE = "gap_over_s"


@dataclass(frozen=True)
class Race:
    """Solvers on the same data."""

    summary: str  #: Markdown: question, answer, table, legend.
    notes: str  #: Markdown: what else is said.
    ways: Mapping[str, Array]  #: Seconds and gap at every improvement by solver, (improvements, 2) [s, 1].
    colours: Mapping[str, Colour]  #: Of every solver.
    bold: str  #: The solver with a proof.
    times: Sequence[Dot]  #: Times over all seeds, for the tab of times.

    @property
    def logs(self) -> dict[str, Array]:
        """The ways in powers of ten."""
        return {key: np.log10(np.maximum(way, SMALLEST)) for key, way in self.ways.items()}

    @property
    def decades(self) -> Array:
        """Whole powers of ten around all times and all gaps, first and last, (2, 2)."""
        every = np.concatenate(list(self.logs.values()))
        first, last = np.floor(every.min(axis=0)), np.ceil(every.max(axis=0))
        return np.array([first, np.maximum(last, first + 1)])


def write_solver(path: Path, header: Header, race: Race) -> None:
    """Write a comparison of solvers; an existing file is replaced only by a whole one."""
    line = spans((dot.value for dot in race.times), "seeds")
    title = f"Time (s), logarithmic; dot: median{f'; line: {line}' if line else ''}"
    chart = Chart("time_s", title, race.times)
    with recording(path, "solver", header, _blueprint(race, chart)) as pen:
        pen.documents({"summary": race.summary, "log": race.notes})
        _write_plane(pen, race)
        for k, (key, way) in enumerate(race.logs.items()):
            _write_way(pen, k, key, way, race)
        chart.write(pen)


def _write_way(pen: Pen, k: int, key: str, way: Array, race: Race) -> None:
    """Gap and time at every improvement over their number."""
    pen = pen.on(rr.TimeColumn(TIMELINE, sequence=np.arange(len(way))))
    own, shape = "solver_" + re.sub(r"\W", "_short", key), SHAPES[k % len(SHAPES)]
    width, size = 3.0 if key == race.bold else 1.5, 7.0 if len(way) == 1 else 2.0
    for root, unit, values in (
        ("log10_gap", "log10 relative gap", way[:, 1]),
        ("log10_s", "log10 s", way[:, 0]),
    ):
        path, name = f"convergence/{root}/{own}", f"({key}) ({unit})"
        pen.line(Line(path, name, race.colours[key], width, shape, size), values)


def _write_plane(pen: Pen, race: Race) -> None:
    """Gap over time on two logarithmic axes, every way with its solver's key at its end."""
    (left, low), (right, high) = race.decades
    across, up = np.arange(left, right + 1), np.arange(low, high + 1)
    lines = [[(x, low), (x, high)] for x in across] + [[(left, y), (right, y)] for y in up]
    pen.still(f"{PLANE}/axis", rr.LineStrips2D(SCALE * np.array(lines), colors=(*NOISE, 90), radii=-0.5))
    at = [(x, low - 0.15) for x in across] + [(left - 0.3, y + 0.1) for y in up]
    texts = [f"{10.0**x:g} s" for x in across] + [f"{10.0**y:g}" for y in up]
    pen.names(f"{PLANE}/ticks", SCALE * np.array(at), texts, [NOISE] * len(texts))
    strips = [SCALE * way for way in race.logs.values()]
    colours = [race.colours[key] for key in race.ways]
    pen.still(f"{PLANE}/way", rr.LineStrips2D(strips, colors=colours, radii=-1.5))
    ends = np.array([strip[-1] for strip in strips])
    sizes = [-9.0 if key == race.bold else -6.0 for key in race.ways]
    pen.still(f"{PLANE}/end", rr.Points2D(ends, colors=colours, radii=sizes))
    order = np.argsort(np.argsort(ends[:, 0]))  # labels at several heights: the ends lie close together
    above = ends + np.outer(0.35 + 0.2 * (order % 3), [0, SCALE[1]])
    pen.names(f"{PLANE}/name", above, [f"({key})" for key in race.ways], colours)


def _blueprint(race: Race, times: Chart) -> rrb.Blueprint:
    (left, low), (right, high) = race.decades
    x, y = (SCALE * [(left - 0.6, high + 0.3), (right + 0.3, low - 0.5)]).T
    bounds = rrb.VisualBounds2D(x_range=x, y_range=y)
    title = "Relative gap over time (s), both logarithmic"
    plane = rrb.Spatial2DView(origin=PLANE, name=title, visual_bounds=bounds)
    ways = [
        rrb.TimeSeriesView(
            origin=f"convergence/{root}",
            name=f"{name} over improvements",
            plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=named),
        )
        for root, name, named in (
            ("log10_gap", "Gap (log10 relative gap)", True),
            ("log10_s", "Time (log10 s), colours as above,", False),  # a legend would hide where lines end
        )
    ]
    return layout(
        rrb.Horizontal(plane, text_view("summary", "Summary"), column_shares=[10, 10], name="Overview"),
        rrb.Vertical(times.view(), name="Time"),
        rrb.Vertical(*ways, name="Iterations"),
        text_view("log", "Notes"),
        timeline=TIMELINE,
        places=max(map(len, race.ways.values())),
    )
