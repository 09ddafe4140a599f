"""The recording of a calibration: verdict, arm, load, markers, residuals, compliances."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.campaign import Cell
from testbench.views.recording.chart import Dot, chart_view, write_chart
from testbench.views.recording.compliance import compliance_grid, legend, numbers, write_compliances
from testbench.views.recording.plots import (
    histogram_views,
    residual_view,
    sag_views,
    write_histograms,
    write_residuals,
    write_sag,
)
from testbench.views.recording.run_text import captions, load_captions, notes, run_lines, table
from testbench.views.recording.scene import world_view, write_scene
from testbench.views.recording.stream import Header, layout, recording, write_texts
from testbench.views.recording.study import Campaign, Result, Study, build_study
from testbench.views.recording.summary import error_rows, statements, summary
from testbench.views.report import Report, middle, show

TIMELINES = ("worst_first", "pose", "load")
MAGNIFICATION = 50.0
SMALLEST_MM = 1e-9
"""Errors below, of exact data, are drawn here: the axis is logarithmic."""


def write_calibration(
    path: Path,
    report: Report,
    cell: Cell,
    campaign: Campaign,
    results: Sequence[Result],
    *,
    magnification: float = MAGNIFICATION,
) -> None:
    """Write a calibration for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        report: report.json; all text is written from it. Of several seeds, `campaign` is the first's.
        cell: The arm.
        campaign: What was measured.
        results: One a model, in the order of the report's.
        magnification: Of the drawn deflections [1].
    """
    study = build_study(report, cell, campaign, results, magnification)
    scales = {
        "deflection_magnification": magnification,
        "residual_magnification": study.residual_scale,
    }
    header = Header("calibration", report["scenario"], study.parameters, study.seed, scales)
    runs = [
        rr.TimeColumn(name, sequence=row)
        for name, row in zip(TIMELINES, (study.rank, np.arange(study.data.runs)), strict=False)
    ]
    load = rr.TimeColumn(TIMELINES[2], sequence=np.rint(100 * study.loading.share).astype(int))
    with recording(path, header, _blueprint(study)) as stream:
        _write_words(stream, study, runs, load)
        write_scene(stream, study, runs, load)
        write_residuals(stream, study, runs)
        write_sag(stream, study, load)
        write_histograms(stream, study)
        write_chart(stream, "error_mm", error_dots(study))
        write_compliances(stream, study)


def _write_words(
    stream: rr.RecordingStream, study: Study, times: Sequence[rr.TimeColumn], load: rr.TimeColumn
) -> None:
    runs = run_lines(study.data, study.checked, study.rank)
    documents = {
        "summary": summary(study, runs[study.worst]),
        "table": table(runs, study.names, study.residual),
        "log": "\n\n".join(filter(None, (notes(study.report), statements(study.report)))),
        "compliance_legend": legend(study),
        "compliance_table": numbers(study),
    }
    write_texts(stream, documents)
    loading = study.loading
    marker = int(np.linalg.norm(loading.deflection[-1], axis=-1).argmax())
    shown = list(study.shown)
    steps = load_captions(
        runs[loading.run],
        loading.share,
        [study.names[k] for k in shown],
        np.linalg.norm(loading.deflection[:, marker], axis=-1),
        np.linalg.norm(loading.predicted[shown][:, :, marker], axis=-1),
    )
    for columns, texts in ((times, captions(runs, study.names, study.residual)), ([load], steps)):
        kind = ["text/markdown"] * len(texts)
        stream.send_columns("this_run", columns, rr.TextDocument.columns(text=texts, media_type=kind))


def error_dots(study: Study) -> list[Dot]:
    """The errors of the summary in millimetres, model by model, with their spread over seeds."""
    dots = []
    for heading, group, number, form, _ in error_rows(study.report):
        if not number.endswith("_mm"):
            continue
        models = study.report["models"]
        held = [m for m in models if m["conservative"] is True]
        judged = group != "identification"  # what fits best may predict worst
        least = min(held, key=lambda m: middle(m[group][number]), default=None)
        for model, look in zip(models, study.looks, strict=True):
            value = model[group][number]
            low, high = (value[k] if isinstance(value, dict) else middle(value) for k in ("p05", "p95"))
            low, mid, high = (max(x, SMALLEST_MM) for x in (low, middle(value), high))
            name = f"{heading.removesuffix(', mm')}: {model['name']}"
            mark = " mm, best conservative" if judged and model is least else " mm"
            dots.append(Dot(name, low, mid, high, look.colour, show(value, form) + mark))
    return dots


def _blueprint(study: Study) -> rrb.Blueprint:
    """Overview, errors, table, histograms, compliances and notes; the reviewer lands on the worst run."""
    dots = error_dots(study)
    overview = rrb.Horizontal(
        rrb.Vertical(
            world_view(study),
            rrb.TextDocumentView(origin="this_run", name="This run"),
            row_shares=[5, 1],
        ),
        rrb.Vertical(
            rrb.TextDocumentView(origin="summary", name="Summary"),
            residual_view(study),
            row_shares=[16, 8],
        ),
        column_shares=[11, 10],
        name="Overview",
    )
    seeds = study.report["seed"]
    spread = f"; line: 5 to 95 % of {len(seeds)} seeds" if isinstance(seeds, list) else ""
    return layout(
        overview,
        rrb.Vertical(
            chart_view("error_mm", f"Errors by model (mm), logarithmic; dot: value{spread}", dots),
            name="Errors",
        ),
        rrb.Horizontal(*histogram_views(study), name="Histogram"),
        rrb.Horizontal(
            world_view(study),
            rrb.Vertical(
                *sag_views(study),
                rrb.TextDocumentView(origin="this_run", name="This step"),
                row_shares=[3, 3, 1],
            ),
            name="Loading",
        ),
        compliance_grid(study),
        rrb.TextDocumentView(origin="compliance_table", name="Numbers"),
        rrb.TextDocumentView(origin="table", name="Table"),
        rrb.TextDocumentView(origin="log", name="Notes"),
        timeline=TIMELINES[0],
    )
