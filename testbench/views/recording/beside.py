"""The recording of a comparison: its words, a chart of the runs line by line, and what each line says."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.views.recording.chart import Chart
from testbench.views.recording.pen import text_view
from testbench.views.recording.stream import Header, layout, recording

TIMELINE = "worst_first"


@dataclass(frozen=True)
class BesideScene:
    """Runs beside one another, as Markdown and a chart."""

    summary: str  #: Question, answer, what differs and how to read it.
    chart: Chart | None  #: None where no number differs.
    rows: Sequence[str]  #: What is said of each model or number, in the order of the chart; at least one.
    lines: int  #: Of each of them in the chart.
    tables: str  #: All of them.


def write_beside(path: Path, header: Header, scene: BesideScene) -> None:
    """Write a comparison for the Rerun viewer; an existing file is replaced only by a whole one."""
    places = np.arange(len(scene.rows))
    with recording(path, "compare", header, _blueprint(scene)) as pen:
        pen.documents({"summary": scene.summary, "tables": scene.tables})
        row = pen.on(rr.TimeColumn(TIMELINE, sequence=places))
        row.texts("this_row", scene.rows)
        if scene.chart:
            scene.chart.write(pen)
            scene.chart.write_cursor(row, 1 + scene.lines * places.astype(np.float64), scene.lines)


def _blueprint(scene: BesideScene) -> rrb.Blueprint:
    """The chart beside the words, below them what is said of one model or number; then all tables."""
    texts = text_view("summary", "Summary"), text_view("this_row", "Marked in the chart")
    words = rrb.Vertical(*texts, row_shares=[5, 2])
    parts = [scene.chart.view()] if scene.chart else []
    overview = rrb.Horizontal(*parts, words, column_shares=[1] * (len(parts) + 1), name="Overview")
    tables = text_view("tables", "Tables")
    return layout(overview, tables, timeline=TIMELINE, places=len(scene.rows))
