"""The recording of a sweep: accuracy against a swept quantity, with its spread, one line a model."""

import json
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from testbench.views.recording.chart import chart_view, write_chart
from testbench.views.recording.stream import Header, layout, recording, write_texts
from testbench.views.recording.sweep_lines import plot_views, write_lines
from testbench.views.recording.sweep_text import caption, summary, table
from testbench.views.recording.swept import TIMELINE, Point, Sweep, points

__all__ = [
    "TIMELINE",
    "Point",
    "Sweep",
    "plot_views",
    "points",
    "summary",
    "table",
    "write_lines",
    "write_sweep",
]


def write_sweep(path: Path, sweep: Sweep) -> None:
    """Write a sweep for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        sweep: Numbers and words.

    Raises:
        BenchError: When two values of x are the same whole number, or a model lacks a value of x.
    """
    steps = sweep.steps
    parameters = sweep.parameters
    text = parameters if isinstance(parameters, str) else json.dumps(parameters, sort_keys=True)
    header = Header("sweep", sweep.scenario, text, sweep.seed)
    with recording(path, header, _blueprint(sweep)) as stream:
        write_texts(stream, {"summary": summary(sweep), "table": table(sweep)})
        captions = [caption(sweep, k) for k in range(len(steps))]
        columns = rr.TextDocument.columns(text=captions, media_type=["text/markdown"] * len(steps))
        stream.send_columns("this_step", [rr.TimeColumn(TIMELINE, sequence=steps)], columns)
        if sweep.labels:
            write_chart(stream, sweep.root, sweep.dots)
        else:
            write_lines(stream, sweep)


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


def _chart(sweep: Sweep) -> rrb.Spatial2DView:
    name = f"{sweep.title} ({sweep.unit}), logarithmic"
    return chart_view(sweep.root, name, sweep.dots)
