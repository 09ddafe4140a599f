"""The recording of a measurement plan: which poses, in which order, seen from where, and what to expect."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import MarkerShape

from testbench.errors import Array
from testbench.plant.shapes import Frames, rigid_frames
from testbench.views.recording.chart import Dot, chart_view, write_chart
from testbench.views.recording.error_map import key_view, key_words, write_key
from testbench.views.recording.plan_world import PlanScene, map_view, plan_view, write_world
from testbench.views.recording.stream import Header, layout, recording, write_texts
from testbench.views.recording.style import LOAD, NOMINAL, Colour
from testbench.views.recording.sweep import Sweep

__all__ = ["PlanScene", "write_plan"]

TIMELINE, CHART, KEY = "run", "other_plans_mm", "error_key_mm"
EXPECTED: dict[str, tuple[str, Colour]] = {
    "expected_deflection_mm": ("Expected deflection (mm)", LOAD),
    "expected_error_mm": ("Expected error (mm)", NOMINAL),
}
"""Plots over the order of measuring: path, title, colour."""


def write_plan(path: Path, scene: PlanScene) -> None:
    """Write a measurement plan for the Rerun viewer; an existing file is replaced only by a whole one."""
    frames = rigid_frames(scene.cell.room, scene.q)
    parameters = scene.parameters
    text = parameters if isinstance(parameters, str) else json.dumps(parameters, sort_keys=True)
    header = Header("plan", scene.scenario, text, scene.seed)
    time = rr.TimeColumn(TIMELINE, sequence=np.arange(scene.poses) + 1)
    with recording(path, header, _blueprint(scene, frames)) as stream:
        write_world(stream, scene, frames, time)
        _write_words(stream, scene, time)
        write_key(stream, KEY, scene.error_map)
        for name, values in zip(EXPECTED, (scene.deflection_mm, scene.error_mm), strict=True):
            _write_expected(stream, name, values, time)
        if scene.sweep is not None:
            write_chart(stream, CHART, _dots(scene.sweep))


def _dots(sweep: Sweep) -> Sequence[Dot]:
    """A line a number of poses, a dot a plan: a chart stands still, whatever the timeline."""
    return replace(sweep, labels={p.x: f"{p.x:g} {sweep.swept}" for p in sweep.points}).dots


def _write_words(stream: rr.RecordingStream, scene: PlanScene, time: rr.TimeColumn) -> None:
    documents = {"summary": _summary(scene), "error_words": key_words(scene.error_map)}
    if scene.tables:
        documents["tables"] = "\n\n".join(f"### {name}\n\n{text}" for name, text in scene.tables.items())
    if scene.sweep is not None:
        documents["sweep_words"] = scene.sweep.words
    write_texts(stream, documents)
    kind = ["text/markdown"] * scene.poses
    words = rr.TextDocument.columns(text=list(scene.pose_words), media_type=kind)
    stream.send_columns("this_step", [time], words)


def _summary(scene: PlanScene) -> str:
    """The caller's words, then what the colours mean and how to scrub."""
    count, drawn = len(scene.candidates), len(scene.drawn_candidates())
    some = f", {drawn} of {count} drawn" if drawn < count else f" ({count})"
    tracker = "Vermillion: tracker and its lines of sight. " if scene.station is not None else ""
    return "\n\n".join(
        [
            scene.summary.strip(),
            f"**Colours** Sky blue: planned tool positions, numbered, and the markers. {tracker}Purple: hung "
            f"weight. Olive cubes: tasks. Grey: arm; dots: candidates{some}.",
            f"**Scrub** the time bar below: `{TIMELINE}` 1 to {scene.poses} is the order of measuring.",
        ]
    )


def _write_expected(stream: rr.RecordingStream, name: str, values: Array, time: rr.TimeColumn) -> None:
    """One value a pose: a line with dots."""
    title, colour = EXPECTED[name]
    words = title.lower()
    stream.log(name, rr.SeriesLines(colors=colour, names=words, widths=2.0), static=True)
    dots = rr.SeriesPoints(colors=colour, names=words, marker_sizes=4.0, markers=MarkerShape.Circle)
    stream.log(name, dots, static=True)
    stream.send_columns(name, [time], rr.Scalars.columns(scalars=values))


def _blueprint(scene: PlanScene, frames: Frames) -> rrb.Blueprint:
    """Plan, error map, and where there are any tables and errors over the number of poses."""
    overview = rrb.Horizontal(
        plan_view(scene, frames),
        rrb.Vertical(
            rrb.TextDocumentView(origin="summary", name="Summary"),
            rrb.TextDocumentView(origin="this_step", name="This step"),
            rrb.Horizontal(*_expected_views(scene.poses)),
            row_shares=[9, 4, 4],
        ),
        column_shares=[12, 9],
        name="Overview",
    )
    errors = rrb.Horizontal(
        rrb.Vertical(map_view(scene, frames), key_view(KEY), row_shares=[10, 1]),
        rrb.TextDocumentView(origin="error_words", name="Error map in words"),
        column_shares=[3, 1],
        name="Error map",
    )
    tabs: list[rrb.Container | rrb.View] = [overview, errors]
    if scene.tables:
        tabs.append(rrb.TextDocumentView(origin="tables", name="Tables"))
    if scene.sweep is not None:
        tabs.append(_sweep_view(scene.sweep))
    return layout(*tabs, timeline=TIMELINE)


def _expected_views(poses: int) -> list[rrb.TimeSeriesView]:
    ends = [rr.TimeRangeBoundary.absolute(seq=k) for k in (0, poses + 1)]
    return [
        rrb.TimeSeriesView(
            origin=name,
            name=f"{title} over run",
            axis_x=rrb.TimeAxis(view_range=rr.TimeRange(*ends)),
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for name, (title, _) in EXPECTED.items()
    ]


def _sweep_view(sweep: Sweep) -> rrb.Container:
    return rrb.Horizontal(
        chart_view(CHART, f"{sweep.title} ({sweep.unit}), logarithmic", _dots(sweep)),
        rrb.TextDocumentView(origin="sweep_words", name="In words"),
        column_shares=[12, 9],
        name="How many poses",
    )
