"""The recording of a calibration: verdict, arm, load, markers, residuals, compliances."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.campaign import Campaign, Cell
from testbench.bench.judged import Result
from testbench.trials.spread import Spread
from testbench.views.recording.chart import Chart, dots
from testbench.views.recording.compliance import compliance_grid, write_compliances
from testbench.views.recording.drawing import Calibration, Drawing, build_drawing
from testbench.views.recording.pen import Pen, text_view
from testbench.views.recording.plots import (
    histogram_views,
    residual_view,
    sag_views,
    write_histograms,
    write_residuals,
    write_sag,
)
from testbench.views.recording.run_text import run_lines, words
from testbench.views.recording.scene import world_view, write_scene
from testbench.views.recording.stream import layout, recording

TIMELINES = ("worst_first", "pose", "load")


def write_calibration(
    path: Path, about: Calibration, cell: Cell, campaign: Campaign, results: Sequence[Result]
) -> None:
    """Write a calibration for the Rerun viewer; an existing file is replaced only by a whole one.

    Of several seeds the words are of all, the campaign and its results, one a model, are the first's.
    """
    drawing = build_drawing(about, cell, campaign, results)
    scales = {
        "deflection_magnification": about.magnification,
        "residual_magnification": drawing.residual_scale,
    }
    places = (drawing.rank, np.arange(drawing.data.runs), np.rint(100 * drawing.loading.share).astype(int))
    *runs, load = (rr.TimeColumn(n, sequence=k) for n, k in zip(TIMELINES, places, strict=True))
    chart = _errors(drawing)
    header = replace(about.header, scales=scales)
    with recording(path, "calibration", header, _blueprint(drawing, chart)) as pen:
        on_runs, on_load = pen.on(*runs), pen.on(load)
        _write_words(on_runs, on_load, drawing)
        write_scene(on_runs, on_load, drawing)
        write_residuals(on_runs, drawing)
        write_sag(on_load, drawing)
        write_histograms(pen, drawing)
        chart.write(pen)
        write_compliances(pen, drawing)


def _write_words(on_runs: Pen, on_load: Pen, drawing: Drawing) -> None:
    found = words(drawing)
    on_runs.documents(
        {
            "summary": f"{drawing.about.summary}\n\n{found.block('how_to_read')}",
            "table": found.block("every_run"),
            "log": found.block("notes"),
            "compliance_legend": found.block("legend"),
            "compliance_table": found.block("numbers"),
        }
    )
    on_runs.texts("this_run", [found.block("run", run=run) for run in run_lines(drawing)])
    steps = range(len(drawing.loading.share))
    on_load.texts("this_run", [found.block("step", step=step) for step in steps])


def _errors(drawing: Drawing) -> Chart:
    """The errors in millimetres, quantity by quantity and model by model, with their spread over seeds."""
    errors = drawing.about.errors
    spread = any(isinstance(c.value(row), Spread) for c in errors.columns for row in errors.rows)
    line = "; line: 5 to 95 % of the seeds" if spread else ""
    title = f"Errors by model (mm), logarithmic; dot: value{line}"
    return Chart("error_mm", title, dots(errors, [look.colour for look in drawing.looks]))


def _blueprint(drawing: Drawing, chart: Chart) -> rrb.Blueprint:
    """Overview, errors, table, histograms, compliances and notes; the reviewer lands on the worst run."""
    run = rrb.Vertical(world_view(drawing), text_view("this_run", "This run"), row_shares=[5, 1])
    words = rrb.Vertical(text_view("summary", "Summary"), residual_view(drawing), row_shares=[16, 8])
    step = rrb.Vertical(*sag_views(drawing), text_view("this_run", "This step"), row_shares=[3, 3, 1])
    return layout(
        rrb.Horizontal(run, words, column_shares=[11, 10], name="Overview"),
        rrb.Vertical(chart.view(), name="Errors"),
        rrb.Horizontal(*histogram_views(drawing), name="Histogram"),
        rrb.Horizontal(world_view(drawing), step, name="Loading"),
        compliance_grid(drawing),
        text_view("compliance_table", "Numbers"),
        text_view("table", "Table"),
        text_view("log", "Notes"),
        timeline=TIMELINES[0],
        places=drawing.data.runs,
    )
