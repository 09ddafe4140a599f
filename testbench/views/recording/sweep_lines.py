"""Lines of a sweep, one a model with its spread, and the plots that show them."""

import re

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.views.recording.swept import SMALLEST, TIMELINE, Sweep


def write_lines(stream: rr.RecordingStream, sweep: Sweep) -> None:
    """The lines of `plot_views`, one a model with its spread, on the timeline `sweep`.

    Args:
        stream: Where to.
        sweep: Numbers and words.

    Raises:
        BenchError: When two values of x are the same whole number, or a model lacks a value of x.
    """
    time = rr.TimeColumn(TIMELINE, sequence=sweep.steps)
    for model in sweep.models:
        _write_line(stream, sweep, model, time)


def _write_line(stream: rr.RecordingStream, sweep: Sweep, model: str, time: rr.TimeColumn) -> None:
    """Median as a bold line with dots, 5 and 95 % as thin ones; values and their logarithms."""
    name = re.sub(r"\W+", "_", model.lower()).strip("_")
    look, line = sweep.drawn(model), sweep.line(model)
    values = np.array([[p.median, p.p05, p.p95] for p in line])
    roots = {sweep.root: values, f"log10_{sweep.root}": np.log10(np.maximum(values, SMALLEST))}
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


def plot_views(sweep: Sweep, hint: str = "") -> list[rrb.TimeSeriesView]:
    """The plot in its unit, and the logarithms of the same.

    Args:
        sweep: Numbers and words.
        hint: Ends the titles, where the reader does not land on the timeline `sweep`.
    """
    root = sweep.root
    axis = f"over {sweep.heading}{hint}"
    x = np.rint([p.x for p in sweep.points]).astype(int)
    margin = max(1, round(0.03 * float(np.ptp(x))))
    ends = [rr.TimeRangeBoundary.absolute(seq=int(k)) for k in (x.min() - margin, x.max() + margin)]
    scales = {root: sweep.unit, f"log10_{root}": f"log10 {sweep.unit}"}
    return [
        rrb.TimeSeriesView(
            origin=path,
            name=f"{sweep.title} ({unit}) {axis}",
            axis_x=rrb.TimeAxis(view_range=rr.TimeRange(*ends)),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=path == root),
        )
        for path, unit in scales.items()
    ]
