"""The recording of a sweep: accuracy against a swept quantity, with its spread, one line a model."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.trials.spread import triple
from testbench.views.recording.chart import SMALLEST
from testbench.views.recording.pen import Line, Pen, snake, text_view
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.swept import Sweep

TIMELINE = "sweep"


def write_sweep(path: Path, header: Header, sweep: Sweep, words: str) -> None:
    """Write a sweep for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        header: What identifies it.
        sweep: Numbers.
        words: Question, answer and tables in Markdown; how to read the plots is added.

    Raises:
        BenchError: When two values of x are the same whole number, or a model lacks a value of x.
    """
    own, time = sweep.words, rr.TimeColumn(TIMELINE, sequence=sweep.steps)
    chart = sweep.chart(sweep.root) if sweep.labels else None
    summary = f"{words}\n\n{own.block('how_to_read')}"
    blueprint = _blueprint([chart.view()] if chart else plot_views(sweep))
    with recording(path, "sweep", header, blueprint) as pen:
        pen.documents({"summary": summary, "table": own.block("every_number")})
        pen.on(time).texts("this_step", [own.block("step", points=points) for points in sweep.columns])
        if chart:
            chart.write(pen)
        else:
            write_lines(pen, sweep)


def _blueprint(plots: list[rrb.View]) -> rrb.Blueprint:
    texts = text_view("summary", "Summary"), text_view("this_step", "This step")
    words = rrb.Vertical(*texts, row_shares=[5, 2])
    overview = rrb.Horizontal(rrb.Vertical(*plots), words, column_shares=[10, 9], name="Overview")
    return layout(overview, text_view("table", "Table"), timeline=TIMELINE)


def write_lines(pen: Pen, sweep: Sweep) -> None:
    """The lines of `plot_views`: median bold with dots, 5 and 95 % thin; values and their logarithms.

    Raises:
        BenchError: When two values of x are the same whole number, or a model lacks a value of x.
    """
    pen = pen.on(rr.TimeColumn(TIMELINE, sequence=sweep.steps))
    for model in sweep.models:
        own = snake(model)
        look, values = sweep.drawn(model), np.array([triple(p.y) for p in sweep.line(model)])
        for root, unit, data in (
            (sweep.root, sweep.y.unit, values),
            (f"log10_{sweep.root}", f"log10 {sweep.y.unit}", np.log10(np.maximum(values, SMALLEST))),
        ):
            name = f"{model} ({unit})"  # of all three: the legend then has a model once
            median = Line(f"{root}/{own}/median", name, look.colour, shape=look.shape)
            pen.line(median, data[:, 0])
            for end, column in (("p05", data[:, 1]), ("p95", data[:, 2])):
                pen.line(Line(f"{root}/{own}/{end}", name, look.colour, 1.0), column)


def plot_views(sweep: Sweep) -> list[rrb.View]:
    """The plot in its unit, and the logarithms of the same."""
    x = np.rint([p.x for p in sweep.points]).astype(int)
    margin = max(1, round(0.03 * float(np.ptp(x))))
    ends = [rr.TimeRangeBoundary.absolute(seq=int(k)) for k in (x.min() - margin, x.max() + margin)]
    scales = {sweep.root: sweep.y.unit, f"log10_{sweep.root}": f"log10 {sweep.y.unit}"}
    return [
        rrb.TimeSeriesView(
            origin=path,
            name=f"{sweep.title} ({unit}) over {sweep.x.title}",
            axis_x=rrb.TimeAxis(view_range=rr.TimeRange(*ends)),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=path == sweep.root),
        )
        for path, unit in scales.items()
    ]
