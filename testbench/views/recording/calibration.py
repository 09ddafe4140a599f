"""The recording of a calibration: verdict, arm, load, markers, residuals, compliances."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.campaign import Campaign, Cell, Result
from testbench.trials.spread import Spread, ends, middle
from testbench.views.recording.chart import Dot, chart_view, write_chart
from testbench.views.recording.compliance import compliance_grid, legend, numbers, write_compliances
from testbench.views.recording.drawing import Calibration, Drawing, build_drawing
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
from testbench.views.recording.stream import Header, layout, recording, write_texts
from testbench.views.schema import Table

TIMELINES = ("worst_first", "pose", "load")
SMALLEST_MM = 1e-9
"""Errors below, of exact data, are drawn here: the axis is logarithmic."""


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
    header = Header("calibration", about.scenario, about.parameters, drawing.seed, scales)
    runs = [
        rr.TimeColumn(name, sequence=row)
        for name, row in zip(TIMELINES, (drawing.rank, np.arange(drawing.data.runs)), strict=False)
    ]
    load = rr.TimeColumn(TIMELINES[2], sequence=np.rint(100 * drawing.loading.share).astype(int))
    with recording(path, header, _blueprint(drawing)) as stream:
        _write_words(stream, drawing, runs, load)
        write_scene(stream, drawing, runs, load)
        write_residuals(stream, drawing, runs)
        write_sag(stream, drawing, load)
        write_histograms(stream, drawing)
        write_chart(stream, "error_mm", error_dots(drawing))
        write_compliances(stream, drawing)


def _write_words(
    stream: rr.RecordingStream, drawing: Drawing, times: Sequence[rr.TimeColumn], load: rr.TimeColumn
) -> None:
    runs = run_lines(drawing.data, drawing.checked, drawing.rank)
    worst = runs[int(np.argmin(drawing.rank))]
    documents = {
        "summary": f"{drawing.about.summary}\n\n{_how_to_read(drawing, worst)}",
        "table": table(runs, drawing.names, drawing.residual),
        "log": "\n\n".join(filter(None, (notes(drawing.about.models), drawing.about.notes))),
        "compliance_legend": legend(drawing),
        "compliance_table": numbers(drawing),
    }
    write_texts(stream, documents)
    loading = drawing.loading
    marker = int(np.linalg.norm(loading.deflection[-1], axis=-1).argmax())
    shown = list(drawing.shown)
    steps = load_captions(
        runs[loading.run],
        loading.share,
        [drawing.names[k] for k in shown],
        np.linalg.norm(loading.deflection[:, marker], axis=-1),
        np.linalg.norm(loading.predicted[shown][:, :, marker], axis=-1),
    )
    for columns, texts in ((times, captions(runs, drawing.names, drawing.residual)), ([load], steps)):
        kind = ["text/markdown"] * len(texts)
        stream.send_columns("this_run", columns, rr.TextDocument.columns(text=texts, media_type=kind))


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


def error_dots(drawing: Drawing) -> list[Dot]:
    """The errors in millimetres, quantity by quantity and model by model, with their spread over seeds."""
    errors, dots = drawing.about.errors, []
    name, *columns = errors.columns
    for column in columns:
        for row, own in zip(errors.rows, drawing.looks, strict=True):
            value = column.value(row)
            low, mid, high = (max(x, SMALLEST_MM) for x in (ends(value)[0], middle(value), ends(value)[1]))
            mark = ", recommended" if errors.bold == name.cell(row) else ""
            text = f"{column.cell(row)} {column.unit}{mark}"
            dots.append(Dot(f"{column.heading}: {name.cell(row)}", low, mid, high, own.colour, text))
    return dots


def spread_words(errors: Table) -> str:
    """What the line behind a dot is, where there is one."""
    spreads = [c.value(row) for c in errors.columns for row in errors.rows]
    return "; line: 5 to 95 % of the seeds" if any(isinstance(s, Spread) for s in spreads) else ""


def _blueprint(drawing: Drawing) -> rrb.Blueprint:
    """Overview, errors, table, histograms, compliances and notes; the reviewer lands on the worst run."""
    dots = error_dots(drawing)
    overview = rrb.Horizontal(
        rrb.Vertical(
            world_view(drawing),
            rrb.TextDocumentView(origin="this_run", name="This run"),
            row_shares=[5, 1],
        ),
        rrb.Vertical(
            rrb.TextDocumentView(origin="summary", name="Summary"),
            residual_view(drawing),
            row_shares=[16, 8],
        ),
        column_shares=[11, 10],
        name="Overview",
    )
    spread = spread_words(drawing.about.errors)
    return layout(
        overview,
        rrb.Vertical(
            chart_view("error_mm", f"Errors by model (mm), logarithmic; dot: value{spread}", dots),
            name="Errors",
        ),
        rrb.Horizontal(*histogram_views(drawing), name="Histogram"),
        rrb.Horizontal(
            world_view(drawing),
            rrb.Vertical(
                *sag_views(drawing),
                rrb.TextDocumentView(origin="this_run", name="This step"),
                row_shares=[3, 3, 1],
            ),
            name="Loading",
        ),
        compliance_grid(drawing),
        rrb.TextDocumentView(origin="compliance_table", name="Numbers"),
        rrb.TextDocumentView(origin="table", name="Table"),
        rrb.TextDocumentView(origin="log", name="Notes"),
        timeline=TIMELINES[0],
    )
