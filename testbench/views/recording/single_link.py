"""The recording of section 5.1: matrices side by side, the draws behind them, and the order m."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.views.recording.chart import Dot, chart_view, write_chart
from testbench.views.recording.compliance import heatmap_view, matrix_tables, scaled, write_heatmap
from testbench.views.recording.stream import Header, layout, recording, write_texts
from testbench.views.recording.style import GREENS, ORANGES, Colour
from testbench.views.report import Report, middle, show, show_truth
from testbench.views.tables import grid

TIMELINE = "sweep"
SMALLEST = 1e-6
"""Errors below are drawn here: the axes are logarithmic."""
ERRORS = (("position", "position_rms_um", "um"), ("rotation", "rotation_rms_urad", "urad"))
ORDER = (
    ("order/log10_excess_percent", "excess of F_M over the certified optimum (log10 %)"),
    ("order/log10_position_rms_um", "RMS position error (log10 um)"),
)


def write_single_link(path: Path, report: Report, parameters: object, claims: Sequence[str]) -> None:
    """Write section 5.1 for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        report: report.json; all numbers are its own.
        parameters: The scenario as plain data.
        claims: The verdict sentence by sentence, written from the report; the first is the answer.
    """
    header = Header("single_link", report["scenario"], json.dumps(parameters, sort_keys=True), report["seed"])
    found = matrices(report)
    true = found["truth"][1]
    with recording(path, header, _blueprint(report)) as stream:
        documents = {
            "summary": summary(report, claims),
            "eigenvalue": eigenvalues(report),
            "table": "\n\n".join(matrix_tables(*zip(*found.values(), strict=True))),
        }
        write_texts(stream, documents)
        for name, (_, C) in found.items():
            write_heatmap(stream, f"compliance/{name}", [scaled(C, true)])
        for what, number, unit in ERRORS:
            write_chart(stream, f"error_{unit}/{what}", error_dots(report, number, unit))
        _write_orders(stream, report)


def matrices(report: Report) -> dict[str, tuple[str, Array]]:
    """By path: title and compliance (6, 6): truth, the first draw, and what the paper prints."""
    first, printed = report["first_draw"], report["eq_22_23"]
    found = {"truth": ("Truth, Eq. 21", report["truth_matrix"])}
    found |= {name.lower(): (name, row["matrix"]) for name, row in first.items()}
    found["eq_22"] = ("Paper's LS, Eq. 22", printed["eq_22"]["matrix"])
    found["eq_23"] = ("Paper's GCO, Eq. 23", printed["eq_23"]["matrix"])
    return {path: (title, np.array(C, dtype=float)) for path, (title, C) in found.items()}


def model_colours(report: Report) -> list[Colour]:
    """Least squares in oranges, GCO in green."""
    families = [GREENS if m["conservative"] is True else ORANGES for m in report["models"]]
    return [family[families[:k].count(family) % len(family)] for k, family in enumerate(families)]


def error_dots(report: Report, number: str, unit: str) -> list[Dot]:
    """Prediction errors model by model, with their spread over draws."""
    dots = []
    for model, colour in zip(report["models"], model_colours(report), strict=True):
        value = model["prediction"][number]
        spread = [value[k] if isinstance(value, dict) else middle(value) for k in ("p05", "median", "p95")]
        low, mid, high = (max(x, SMALLEST) for x in spread)
        dots.append(Dot(model["name"], low, mid, high, colour, f"{show(value, '.1f')} {unit}"))
    return dots


def _write_orders(stream: rr.RecordingStream, report: Report) -> None:
    """Excess of F_M and prediction error over the order m, median and spread."""
    rows = report["order"]
    time = rr.TimeColumn(TIMELINE, sequence=[row["m"] for row in rows])
    for key, width in (("median", 3.0), ("p05", 1.0), ("p95", 1.0)):
        excess = [100 * (_at(row["f_m_over_optimum"], key) - 1) for row in rows]
        error = [_at(row["prediction"]["position_rms_um"], key) for row in rows]
        for (root, title), values in zip(ORDER, (excess, error), strict=True):
            path, name = f"{root}/{key}", f"{key}: {title}"
            stream.log(path, rr.SeriesLines(colors=GREENS[0], widths=width, names=name), static=True)
            dots = rr.SeriesPoints(colors=GREENS[0], names=name, marker_sizes=4.0)
            stream.log(path, dots, static=True)
            logs = np.log10(np.maximum(values, SMALLEST))
            stream.send_columns(path, [time], rr.Scalars.columns(scalars=logs))


def _at(value: object, key: str) -> float:
    return float(value[key]) if isinstance(value, dict) else middle(value)


def summary(report: Report, claims: Sequence[str]) -> str:
    """Question, answer, table, legend, how to scrub."""
    draws, data = report["draws"], report["dataset"]
    um, urad = (data[f"sigma_of_a_deflection_{unit}"] for unit in ("um", "urad"))
    return "\n\n".join(
        [
            "### Single link, section 5.1: is a conservative compliance nearer the truth than least squares?",
            f"#### **{claims[0]}**",
            "\n".join(table(report)),
            "\n".join(f"- {claim}" for claim in claims[1:]),
            f"{draws} draws of noise, {data['runs']} loads each, {um:.3g} um and {urad:.3g} urad a "
            "deflection: medians (5 to 95 %). Matrices: first draw.",
            "**Pictures** entry ij over the root of the true entries ii and jj, signed log, one range of "
            "colours. Grey 0, brown as a true diagonal, yellow ten times as large, blue to cyan negative: "
            "**blue on a diagonal gives energy away**, here in the corner x, where the truth is stiffest.",
            f"**Scrub** `{TIMELINE}` is the order m of the vector space, Eq. 20 (tab Order m).",
        ]
    )


def table(report: Report) -> list[str]:
    """A column a model."""
    models = report["models"]
    rows = [
        ["conservative", *(_share(m["conservative"]) for m in models)],
        ["symmetric", *(_share(m["symmetric"]) for m in models)],
        ["negative eigenvalue (symmetric part)", *(_share(m["negative_eigenvalue"]) for m in models)],
    ]
    rows += [
        [f"{what} error, {unit}", *(show(m["prediction"][number], ".1f") for m in models)]
        for what, number, unit in ERRORS
    ]
    return grid(["share of draws; error of predictions", *(m["name"] for m in models)], rows)


def _share(value: bool | float) -> str:
    return show_truth(value)


def eigenvalues(report: Report) -> str:
    """Eigenvalues of the symmetric part of every matrix shown."""
    printed = report["eq_22_23"]
    rows = {"Truth, Eq. 21": np.linalg.eigvalsh(report["truth_matrix"]).tolist()}
    rows |= {name: row["eigenvalues_symmetric_part"] for name, row in report["first_draw"].items()}
    rows["Paper's LS, Eq. 22"] = printed["eq_22"]["eigenvalues_symmetric_part"]
    rows["Paper's GCO, Eq. 23"] = printed["eq_23"]["eigenvalues"]
    head = ["eigenvalues of the symmetric part", *(str(k) for k in range(1, 7))]
    lines = [[name, *(f"{x:.2e}" for x in values)] for name, values in rows.items()]
    return "\n\n".join(
        [
            "### Eigenvalues, ascending",
            "In mixed SI units (m/N, rad/(N m)), as the paper prints them; below zero is not conservative.",
            "\n".join(grid(head, lines)),
            "### The order m",
            report["which_m"],
        ]
    )


def _blueprint(report: Report) -> rrb.Blueprint:
    pictures = [
        heatmap_view(f"compliance/{path}", f"{title} (signed log; 1 = true diagonal)")
        for path, (title, _) in matrices(report).items()
    ]
    charts = [
        chart_view(f"error_{unit}/{what}", f"RMS {what} error ({unit}), logarithmic", dots)
        for what, number, unit in ERRORS
        if (dots := error_dots(report, number, unit))
    ]
    orders = [
        rrb.TimeSeriesView(origin=root, name=f"{title[0].upper()}{title[1:]} over the order m")
        for root, title in ORDER
    ]
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
