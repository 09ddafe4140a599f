"""The recording of a sweep: accuracy against a swept quantity, with its spread, one line a model."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.views.recording.chart import Chart
from testbench.views.recording.curves import Curves
from testbench.views.recording.pen import text_view
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.swept import Sweep

TIMELINES = ("worst_first", "sweep")


def write_sweep(path: Path, header: Header, sweep: Sweep, words: str) -> None:
    """Write a sweep for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        header: What identifies it.
        sweep: Numbers.
        words: Question, answer and tables in Markdown; how to read the plot is added.

    Raises:
        BenchError: When a model has two values at one x.
    """
    own, plot, steps = sweep.words, sweep.plot(sweep.root), sweep.steps
    numbers = np.array([step.number for step in steps])
    times = [rr.TimeColumn(n, sequence=at) for n, at in zip(TIMELINES, (sweep.rank, numbers), strict=True)]
    with recording(path, "sweep", header, _blueprint(plot, len(steps))) as pen:
        pen.documents(
            {"summary": f"{words}\n\n{own.block('how_to_read')}", "table": own.block("every_number")}
        )
        plot.write(pen)
        step = pen.on(*times)
        step.texts("this_step", [own.block("step", step=one) for one in steps])
        plot.write_cursor(step, numbers)


def _blueprint(plot: Chart | Curves, steps: int) -> rrb.Blueprint:
    """The plot over the words of the step, beside the summary; the reader lands where models differ most."""
    both = rrb.Vertical(plot.view(), text_view("this_step", "This step"), row_shares=[7, 3])
    overview = rrb.Horizontal(both, text_view("summary", "Summary"), column_shares=[11, 10], name="Overview")
    return layout(overview, text_view("table", "Table"), timeline=TIMELINES[0], places=steps)
