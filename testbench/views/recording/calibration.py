"""The recording of a calibration: verdict, arm, load, markers, residuals, compliances."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.campaign import Campaign, Cell, Result
from testbench.trials.spread import Spread
from testbench.views.recording.chart import Chart, dots
from testbench.views.recording.compliance import compliance_grid, legend, numbers, write_compliances
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
from testbench.views.recording.run_text import RunLine, captions, load_captions, notes, run_lines, table
from testbench.views.recording.scene import world_view, write_scene
from testbench.views.recording.stream import layout, recording

TIMELINES = ("worst_first", "pose", "load")


def write_calibration(
    path: Path, about: Calibration, cell: Cell, campaign: Campaign, results: Sequence[Result]
) -> None:
    """Write a calibration for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        about: Words and models; of several seeds the words are of all, `campaign` is the first's.
        cell: The arm.
        campaign: What was measured.
        results: One a model.
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
    runs, loading, shown = (
        run_lines(drawing.data, drawing.checked, drawing.rank),
        drawing.loading,
        drawing.shown,
    )
    on_runs.documents(
        {
            "summary": f"{drawing.about.summary}\n\n{_how_to_read(drawing, runs[drawing.worst])}",
            "table": table(runs, drawing.names, drawing.residual),
            "log": "\n\n".join(filter(None, (notes(drawing.about.models), drawing.about.notes))),
            "compliance_legend": legend(drawing),
            "compliance_table": numbers(drawing),
        }
    )
    on_runs.texts("this_run", captions(runs, drawing.names, drawing.residual))
    sag = drawing.sag[[0, *(1 + k for k in shown)]]
    names = [drawing.names[k] for k in shown]
    on_load.texts("this_run", load_captions(runs[loading.run], loading.share, names, sag))


def _how_to_read(drawing: Drawing, worst: RunLine) -> str:
    M, scale = drawing.magnification, drawing.residual_scale
    best = drawing.names[drawing.best]
    return (
        f"**Colours** Grey: arm without load. Vermillion: measured, and the ghost; deflection x {M:g}. "
        "Sky blue: markers without load. Orange: least squares. Green: GCO. Purple: load. "
        f"Arrows measured to predicted: x {scale:g}; label: worst marker of {best}.\n\n"
        f"**Scrub** the time bar below: `worst_first` 0 is the worst run of {best}, `pose` the dataset's "
        "order, "
        f"`load` loads {worst.where} from 0 to 100 % (tab Loading)."
    )


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
    )
