"""The recording of section 5.1: matrices side by side, the draws behind them, and the order m."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.views.recording.chart import Chart
from testbench.views.recording.compliance import heatmap_view, scaled, write_heatmap
from testbench.views.recording.curves import Curves
from testbench.views.recording.pen import snake, text_view
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.swept import Sweep

TIMELINE = "sweep"
ORDERS = (610.0, 560.0)  #: Size of the pane of one of two plots [ui points].


@dataclass(frozen=True)
class Matrices:
    """Compliances of one body, how far off they are, and what the order m of a search costs."""

    documents: Mapping[str, str]  #: Markdown by path: summary, table.
    matrices: Mapping[str, Array]  #: By title, (6, 6) [m/N, rad/N, rad/(N m)]; the first is the truth.
    errors: Sequence[Chart]  #: One a kind of error.
    orders: Sequence[Sweep]  #: What depends on the order m of a search.


def write_single_link(path: Path, header: Header, shown: Matrices) -> None:
    """Write section 5.1 for the Rerun viewer; an existing file is replaced only by a whole one."""
    true = next(iter(shown.matrices.values()))
    plots = [sweep.plot(sweep.root, ORDERS) for sweep in shown.orders]
    with recording(path, "single_link", header, _blueprint(shown, plots)) as pen:
        pen.documents(shown.documents)
        for title, C in shown.matrices.items():
            write_heatmap(pen, f"compliance/{snake(title)}", scaled(C, true))
        for chart in shown.errors:
            chart.write(pen)
        for sweep, plot in zip(shown.orders, plots, strict=True):
            plot.write(pen)
            number = np.array([step.number for step in sweep.steps])
            plot.write_cursor(pen.on(rr.TimeColumn(TIMELINE, sequence=number)), number)


def _blueprint(shown: Matrices, plots: Sequence[Chart | Curves]) -> rrb.Blueprint:
    pictures = [heatmap_view(f"compliance/{snake(title)}", title) for title in shown.matrices]
    grid = rrb.Grid(*pictures, grid_columns=2)
    return layout(
        rrb.Horizontal(grid, text_view("summary", "Summary"), column_shares=[10, 9], name="Overview"),
        rrb.Vertical(*(chart.view() for chart in shown.errors), name="Errors"),
        rrb.Horizontal(*(plot.view() for plot in plots), name="Order m"),
        text_view("table", "Numbers"),
        timeline=TIMELINE,
        places=len(shown.orders[0].steps),
    )
