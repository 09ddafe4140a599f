"""The recording of section 5.1: matrices side by side, the draws behind them, and the order m."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.trials.spread import ends, middle
from testbench.views.colours import Look
from testbench.views.recording.chart import Dot, chart_view, write_chart
from testbench.views.recording.compliance import heatmap_view, scaled, write_heatmap
from testbench.views.recording.stream import Header, layout, recording, write_texts
from testbench.views.recording.sweep import TIMELINE, Sweep, plot_views, write_lines
from testbench.views.schema import Column, Table

SMALLEST = 1e-6
"""Errors below are drawn here: the axes are logarithmic."""


@dataclass(frozen=True)
class Matrices:
    """Compliances of one body, how far off they are, and what the order m of a search costs."""

    scenario: str  #: Name of the scenario.
    parameters: str  #: The scenario as JSON.
    seed: int  #: Of the first draw.
    documents: Mapping[str, str]  #: Markdown by path: summary, eigenvalue, table.
    matrices: Mapping[str, Array]  #: By title, (6, 6) [m/N, rad/N, rad/(N m)]; the first is the truth.
    looks: Sequence[Look]  #: Of the models, one a row of `errors`.
    errors: Table  #: The model, then errors in the units of their columns.
    orders: Sequence[Sweep]  #: What depends on the order m of a search.


def write_single_link(path: Path, shown: Matrices) -> None:
    """Write section 5.1 for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        shown: Numbers and words.
    """
    header = Header("single_link", shown.scenario, shown.parameters, shown.seed)
    true = next(iter(shown.matrices.values()))
    with recording(path, header, _blueprint(shown)) as stream:
        write_texts(stream, shown.documents)
        for title, C in shown.matrices.items():
            write_heatmap(stream, f"compliance/{snake(title)}", [scaled(C, true)])
        for column in shown.errors.columns[1:]:
            write_chart(stream, _chart(column), error_dots(shown, column))
        for sweep in shown.orders:
            write_lines(stream, sweep)


def snake(title: str) -> str:
    """A title as a path."""
    return re.sub(r"\W+", "_", title.lower()).strip("_")


def _chart(column: Column) -> str:
    return f"error_{column.unit}/{snake(column.heading)}"


def error_dots(shown: Matrices, column: Column) -> list[Dot]:
    """Errors model by model, with their spread over draws."""
    name, dots = shown.errors.columns[0], []
    for row, own in zip(shown.errors.rows, shown.looks, strict=True):
        value = column.value(row)
        low, mid, high = (max(x, SMALLEST) for x in (ends(value)[0], middle(value), ends(value)[1]))
        dots.append(Dot(name.cell(row), low, mid, high, own.colour, f"{column.cell(row)} {column.unit}"))
    return dots


def _blueprint(shown: Matrices) -> rrb.Blueprint:
    pictures = [
        heatmap_view(f"compliance/{snake(title)}", f"{title} (signed log; 1 = true diagonal)")
        for title in shown.matrices
    ]
    charts = [
        chart_view(
            _chart(column), f"RMS {column.heading} ({column.unit}), logarithmic", error_dots(shown, column)
        )
        for column in shown.errors.columns[1:]
    ]
    orders = [rrb.Vertical(*plot_views(sweep)) for sweep in shown.orders]
    return layout(
        rrb.Horizontal(
            rrb.Grid(*pictures, grid_columns=2),
            rrb.TextDocumentView(origin="summary", name="Summary"),
            column_shares=[10, 9],
            name="Overview",
        ),
        rrb.Vertical(*charts, name="Errors"),
        rrb.Horizontal(*orders, name="Order m"),
        rrb.TextDocumentView(origin="eigenvalue", name="Eigenvalues"),
        rrb.TextDocumentView(origin="table", name="Numbers"),
        timeline=TIMELINE,
    )
