"""The recording of a comparison of solvers: gap against time, bars of time, local minima."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.views.recording.chart import Dot, chart_view, write_chart
from testbench.views.recording.stream import Header, layout, recording, write_texts
from testbench.views.recording.style import GREENS, NOISE, SHAPES, Colour
from testbench.views.report import Report, middle, show, show_truth
from testbench.views.tables import grid

TIMELINE = "iteration"
CONIC = "d"
"""Key of the conic program."""
SMALLEST = 1e-12
"""A gap or a time below is drawn here: the axes are logarithmic."""
COLOURS: tuple[Colour, ...] = (
    (213, 94, 0),
    (238, 152, 104),
    (86, 180, 233),
    (130, 140, 200),
    (204, 121, 167),
    (190, 160, 60),
)
"""Of the other solvers, in the report's order; all of them minimise the same F_M."""
ACROSS, UP = 150.0, 100.0
"""A power of ten of time and of gap, in the plane's own units."""
TIMES = (("to 1 %", "seconds_to_1_percent"), ("whole", "seconds"))
HEAD = ("solver", "F_M", "proven gap", "s to 1 %", "s, whole", "evaluations", "conservative", "check RMS, mm")


def write_solver(path: Path, report: Report, parameters: object, claims: Sequence[str]) -> None:
    """Write a comparison of solvers for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        report: report.json; all numbers are its own.
        parameters: The scenario as plain data.
        claims: The verdict sentence by sentence, written from the report; the first is the answer.
    """
    seed = report["convergence"]["seed"]
    header = Header("solver", report["scenario"], json.dumps(parameters, sort_keys=True), seed)
    ways = {key: np.maximum(points, SMALLEST) for key, points in report["convergence"]["points"].items()}
    with recording(path, header, _blueprint(report, ways)) as stream:
        write_texts(stream, {"summary": summary(report, claims), "log": notes(report, claims)})
        colours = solver_colours(report)
        _write_plane(stream, ways, colours)
        for k, (key, way) in enumerate(ways.items()):
            _write_way(stream, k, key, way, colours[key])
        write_chart(stream, "time_s", time_dots(report))


def solver_colours(report: Report) -> dict[str, Colour]:
    """Green is the conic program; the others have their own."""
    others = [row["key"] for row in report["solvers"] if row["key"] != CONIC]
    return {CONIC: GREENS[0]} | {key: COLOURS[k % len(COLOURS)] for k, key in enumerate(others)}


def _name(key: str) -> str:
    """A key in snake case, for paths."""
    return "solver_" + re.sub(r"\W", "_short", key)


def _write_way(stream: rr.RecordingStream, k: int, key: str, way: Array, colour: Colour) -> None:
    """Gap and time at every improvement, (improvements, 2) [s, 1], over their number."""
    time = rr.TimeColumn(TIMELINE, sequence=np.arange(len(way)))
    both = (("log10_gap", "log10 relative gap", way[:, 1]), ("log10_s", "log10 s", way[:, 0]))
    for root, unit, values in both:
        path, name = f"convergence/{root}/{_name(key)}", f"({key}) ({unit})"
        width = 3.0 if key == CONIC else 1.5
        stream.log(path, rr.SeriesLines(colors=colour, widths=width, names=name), static=True)
        size = 7.0 if len(way) == 1 else 2.0
        dots = rr.SeriesPoints(colors=colour, markers=SHAPES[k % len(SHAPES)], names=name, marker_sizes=size)
        stream.log(path, dots, static=True)
        stream.send_columns(path, [time], rr.Scalars.columns(scalars=np.log10(values)))


def _write_plane(
    stream: rr.RecordingStream, ways: Mapping[str, Array], colours: Mapping[str, Colour]
) -> None:
    """Gap over time on two logarithmic axes, every way with its solver's key at its end."""
    (left, right), (low, high) = _decades(ways)
    across, up = range(left, right + 1), range(low, high + 1)
    root = "gap_over_s"
    lines = [[_place(x, low), _place(x, high)] for x in across]
    lines += [[_place(left, y), _place(right, y)] for y in up]
    stream.log(f"{root}/axis", rr.LineStrips2D(lines, colors=(*NOISE, 90), radii=-0.5), static=True)
    ticks = [(_place(x, low - 0.15), f"{10.0**x:g} s") for x in across]
    ticks += [(_place(left - 0.3, y + 0.1), f"{10.0**y:g}") for y in up]
    _labels(stream, f"{root}/ticks", ticks, [NOISE] * len(ticks))
    logs = {key: np.log10(way) for key, way in ways.items()}
    strips = [[_place(x, y) for x, y in way] for way in logs.values()]
    drawn = [colours[key] for key in logs]
    stream.log(f"{root}/way", rr.LineStrips2D(strips, colors=drawn, radii=-1.5), static=True)
    ends = np.array([strip[-1] for strip in strips])
    sizes = [-9.0 if key == CONIC else -6.0 for key in logs]
    stream.log(f"{root}/end", rr.Points2D(ends, colors=drawn, radii=sizes), static=True)
    order = np.argsort(np.argsort(ends[:, 0]))  # labels at several heights: the ends lie close together
    names = [
        ((x, y - UP * (0.35 + 0.2 * (k % 3))), f"({key})")
        for (x, y), k, key in zip(ends.tolist(), order.tolist(), logs, strict=True)
    ]
    _labels(stream, f"{root}/name", names, drawn)


def _labels(
    stream: rr.RecordingStream,
    path: str,
    labels: Sequence[tuple[tuple[float, float], str]],
    colours: Sequence[Colour],
) -> None:
    at, texts = zip(*labels, strict=True)
    points = rr.Points2D(at, labels=texts, colors=colours, radii=0.0, show_labels=True)
    stream.log(path, points, static=True)


def _place(x: float, y: float) -> tuple[float, float]:
    """Of powers of ten in the plane; its y axis points down."""
    return ACROSS * float(x), -UP * float(y)


def _decades(ways: Mapping[str, Array]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Whole powers of ten around all times, and around all gaps."""
    logs = np.log10(np.concatenate(list(ways.values())))
    low, high = np.floor(logs.min(axis=0)).astype(int), np.ceil(logs.max(axis=0)).astype(int)
    (left, bottom), (right, top) = low.tolist(), high.tolist()
    return (left, max(right, left + 1)), (bottom, max(top, bottom + 1))


def time_dots(report: Report) -> list[Dot]:
    """Seconds to within 1 % of the optimum, then to the end, with their spread over seeds."""
    colours, dots = solver_colours(report), []
    for words, number in TIMES:
        for row in report["solvers"]:
            value = row[number]
            if value is None:
                continue
            low, mid, high = (max(value[k], SMALLEST) for k in ("p05", "median", "p95"))
            text = f"{show(value, '.2g')} s"
            dots.append(Dot(f"{words}: ({row['key']})", low, mid, high, colours[row["key"]], text))
    return dots


def table(report: Report) -> list[str]:
    """A line a solver, medians over seeds."""
    rows = [
        [
            f"**({row['key']})**" if row["key"] == CONIC else f"({row['key']})",
            f"{middle(row['f_m']):.4f}",
            f"{middle(row['relative_gap']):.1e}",
            "never" if row["seconds_to_1_percent"] is None else f"{middle(row['seconds_to_1_percent']):.2g}",
            f"{middle(row['seconds']):.2g}",
            "-" if row["evaluations"] is None else f"{middle(row['evaluations']):.0f}",
            show_truth(row["conservative"]),
            f"{middle(row['check']['rms_mm']):.3f}",
        ]
        for row in report["solvers"]
    ]
    return grid(list(HEAD), rows)


def summary(report: Report, claims: Sequence[str]) -> str:
    """Question, answer, table, legend, how to scrub."""
    data, seeds = report["dataset"], len(report["seed"])
    return "\n\n".join(
        [
            f"### {report['arm']}, {report['model']}: which solver finds the best model, and how fast?",
            f"#### **{claims[0]}**",
            *claims[1:3],
            "\n".join(table(report)),
            "\n".join(f"- ({row['key']}) {row['name']}" for row in report["solvers"]),
            f"Medians of {seeds} seeds, {data['runs']} runs each; ways and gap are those of seed "
            f"{report['convergence']['seed']}. Gap: F_M over its proven lower bound, minus 1.",
            "**Colours** Green: the conic program (d). The other solvers have a colour of their own.",
            f"**Scrub** `{TIMELINE}` counts the improvements of F_M of every solver (tab Iterations).",
        ]
    )


def notes(report: Report, claims: Sequence[str]) -> str:
    """The whole verdict, and the local minima of every order m."""
    head = ["m", "reference", "starts", "within 1e-6", "within 1e-5", "median excess", "worst excess"]
    rows = [
        [
            str(row["m"]),
            row["reference"],
            str(row["starts_per_seed"] * len(row["seeds"])),
            *(f"{100 * row[f'share_within_{k}']:.0f} %" for k in ("1e-6", "1e-5")),
            *(f"{row[k]:.1e}" for k in ("median", "worst")),
        ]
        for row in report["local_minima"].values()
    ]
    verdict = "\n".join(f"- {claim}" for claim in claims)
    minima = "\n".join(grid(head, rows))
    return "\n\n".join(["### Verdict", verdict, "### Local minima from random starts", minima])


def _blueprint(report: Report, ways: Mapping[str, Array]) -> rrb.Blueprint:
    (left, right), (low, high) = _decades(ways)
    bounds = rrb.VisualBounds2D(
        x_range=(ACROSS * (left - 0.6), ACROSS * (right + 0.3)),
        y_range=(-UP * (high + 0.3), -UP * (low - 0.5)),
    )
    plane = rrb.Spatial2DView(
        origin="gap_over_s", name="Relative gap (1) over time (s), both log10", visual_bounds=bounds
    )
    dots = time_dots(report)
    spread = f"; line: 5 to 95 % of {len(report['seed'])} seeds" if len(report["seed"]) > 1 else ""
    return layout(
        rrb.Horizontal(
            plane,
            rrb.TextDocumentView(origin="summary", name="Summary"),
            column_shares=[10, 9],
            name="Overview",
        ),
        rrb.Vertical(chart_view("time_s", f"Time (s), logarithmic; dot: median{spread}", dots), name="Time"),
        rrb.Vertical(
            *(
                rrb.TimeSeriesView(
                    origin=f"convergence/{root}",
                    name=f"{name} over improvements",
                    plot_legend=rrb.PlotLegend(corner),
                )
                for root, name, corner in (
                    ("log10_gap", "Relative gap (log10 of 1)", rrb.Corner2D.RightTop),
                    ("log10_s", "Time (log10 s)", rrb.Corner2D.RightBottom),
                )
            ),
            name="Iterations",
        ),
        rrb.TextDocumentView(origin="log", name="Notes"),
        timeline=TIMELINE,
    )
