"""The recording of a calibration: verdict, arm, load, markers, errors by place and by run, compliances."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.campaign import Campaign, Cell
from testbench.bench.judged import Result
from testbench.views.recording.arm import orbit
from testbench.views.recording.chart import Chart, dots
from testbench.views.recording.compliance import compliance_tab, write_compliances
from testbench.views.recording.drawing import Calibration, Drawing, build_drawing
from testbench.views.recording.error_maps import error_maps_tab, write_error_maps
from testbench.views.recording.pen import Pen, text_view
from testbench.views.recording.plots import (
    deflection_view,
    error_bars_view,
    error_view,
    histogram_grid,
    write_histograms,
    write_plots,
)
from testbench.views.recording.run_text import place_lines, run_lines, words
from testbench.views.recording.scene import loading_view, map_camera, world_view, write_scene
from testbench.views.recording.stream import layout, recording
from testbench.views.schema import brackets

PLACE, WORST, RUN, LOAD = "place", "worst_first", "run", "load"
"""Timelines: places of the workspace from 1, runs by their residual, runs of the dataset from 1, load [%]."""


def write_calibration(
    path: Path, about: Calibration, cell: Cell, campaign: Campaign, results: Sequence[Result]
) -> None:
    """Write a calibration for the Rerun viewer; an existing file is replaced only by a whole one.

    Of several seeds the words are of all, the campaign and its results, one a model, are the first's.
    """
    drawing = build_drawing(about, cell, campaign, results)
    scales = {
        "deflection_magnification": about.magnification,
        "error_magnification": drawing.places.scale,
        "residual_magnification": drawing.runs.scale,
    }
    chart = _errors(drawing)
    header = replace(about.header, scales=scales)
    with recording(path, "calibration", header, _blueprint(drawing, chart)) as pen:
        order = np.arange(drawing.data.runs) + 1
        runs = pen.on(rr.TimeColumn(WORST, sequence=drawing.rank), rr.TimeColumn(RUN, sequence=order))
        places = pen.on(rr.TimeColumn(PLACE, sequence=1 + np.arange(len(about.map.run))))
        load = pen.on(rr.TimeColumn(LOAD, sequence=np.rint(100 * drawing.share).astype(int)))
        _write_words(runs, places, load, drawing)
        write_scene(runs, places, load, drawing)
        write_plots(runs, places, load, drawing)
        write_error_maps(pen, about.map, drawing.reach)
        write_histograms(pen, drawing)
        chart.write(pen)
        write_compliances(pen, drawing)


def _write_words(runs: Pen, places: Pen, load: Pen, drawing: Drawing) -> None:
    found = words(drawing)
    runs.documents(
        {
            "summary": f"{drawing.about.summary}\n\n{found.block('how_to_read')}",
            "table": found.block("every_run"),
            "log": found.block("notes"),
            "compliance_legend": found.block("legend"),
            "compliance_table": found.block("numbers"),
        }
    )
    runs.texts("here", [found.block("run", run=run) for run in run_lines(drawing)])
    places.texts("here", [found.block("place", place=place) for place in place_lines(drawing)])
    load.texts("here", [found.block("step", step=step) for step in range(len(drawing.share))])


def _errors(drawing: Drawing) -> Chart:
    """The errors in millimetres, quantity by quantity and model by model, with their spread over seeds."""
    errors = drawing.about.errors
    line = f"; line: {brackets(errors)}" if brackets(errors) else ""
    title = f"Errors by model (mm), logarithmic; dot: value{line}"
    return Chart("errors_by_model_mm", title, dots(errors, [look.colour for look in drawing.looks]))


def _blueprint(drawing: Drawing, chart: Chart) -> rrb.Blueprint:
    """Overview, error map, errors, loading and what else; the reviewer lands where models differ most."""
    here = rrb.Vertical(world_view(drawing), text_view("here", "What is shown"), row_shares=[7, 2])
    words = rrb.Vertical(text_view("summary", "Summary"), error_view(), row_shares=[5, 2])
    beside = error_bars_view(drawing), deflection_view()
    step = rrb.Vertical(*beside, text_view("here", "What is shown"), row_shares=[7, 7, 4])
    return layout(
        rrb.Horizontal(here, words, column_shares=[11, 10], name="Overview"),
        error_maps_tab(drawing.about.map, orbit(*map_camera(drawing))),
        rrb.Vertical(chart.view(), name="Errors"),
        rrb.Horizontal(loading_view(drawing), step, name="Loading"),
        histogram_grid(drawing),
        compliance_tab(drawing),
        text_view("compliance_table", "Numbers"),
        text_view("table", "Table"),
        text_view("log", "Notes"),
        timeline=PLACE,
        places=drawing.data.runs,
    )
