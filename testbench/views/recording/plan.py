"""The recording of a measurement plan: which poses, in which order, seen from where, and what to expect."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import MarkerShape

from testbench.errors import Array, BenchError, check_array
from testbench.plant.shapes import Frames, rigid_frames
from testbench.views.recording.error_map import key_view, key_words, write_key
from testbench.views.recording.plan_world import PlanScene, map_view, plan_view, write_world
from testbench.views.recording.stream import Header, layout, recording, write_texts
from testbench.views.recording.style import LOAD, NOMINAL, Colour
from testbench.views.recording.sweep import plot_views, write_lines
from testbench.views.recording.sweep import summary as sweep_summary

__all__ = ["PlanScene", "write_plan"]

TIMELINE = "run"
EXPECTED: dict[str, tuple[str, Colour]] = {
    "expected_deflection_mm": ("Expected deflection (mm)", LOAD),
    "expected_error_mm": ("Expected error (mm)", NOMINAL),
}
"""Plots over the order of measuring: path, title, colour."""


def write_plan(path: Path, scene: PlanScene) -> None:
    """Write a measurement plan for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        scene: The plan and its words.

    Raises:
        BenchError: When an array has the wrong shape or is not finite, or a number of things does not match.
    """
    scene = _check(scene)
    frames = rigid_frames(scene.cell.room, scene.q)
    header = Header("plan", scene.scenario, json.dumps(scene.parameters, sort_keys=True), scene.seed)
    time = rr.TimeColumn(TIMELINE, sequence=np.arange(scene.poses) + 1)
    with recording(path, header, _blueprint(scene, frames)) as stream:
        write_world(stream, scene, frames, time)
        _write_words(stream, scene, time)
        write_key(stream, "error_key_mm", scene.error_map)
        for name, values in zip(EXPECTED, (scene.deflection_mm, scene.error_mm), strict=True):
            _write_expected(stream, name, values, time)
        if scene.sweep is not None:
            write_lines(stream, scene.sweep)


def _check(scene: PlanScene) -> PlanScene:
    """The scene with its numbers as arrays."""
    q = check_array(scene.q, (None, scene.cell.arm.n_joints), "q [rad]")
    poses, t, p = len(q), len(scene.tasks), len(scene.field)
    shapes: dict[str, tuple[int | None, ...]] = {
        "candidates": (None, 3),
        "deflection_mm": (poses,),
        "error_mm": (poses,),
        "tasks": (t, 3),
        "task_error_mm": (t,),
        "field": (p, 3),
        "field_error_mm": (p,),
    }
    arrays: dict[str, Any] = {
        name: check_array(getattr(scene, name), shape, name) for name, shape in shapes.items()
    }
    for name, count in (("poses", poses), ("tasks", t), ("positions in the error map", p)):
        if count == 0:
            raise BenchError(f"plan: expected at least one of {name}, got none")
    if len(scene.pose_words) != poses:
        raise BenchError(f"pose_words: expected {poses}, one a pose, got {len(scene.pose_words)}")
    load = np.asarray(scene.load)
    if load.shape != (poses,) or not np.isin(load, np.arange(len(scene.loads_kg))).all():
        raise BenchError(
            f"load: expected {poses} indices into {len(scene.loads_kg)} loads, got {load.tolist()}"
        )
    if scene.station is not None:
        check_array(scene.station, (3,), "station [m]")
    return replace(scene, q=q, load=load.astype(int), **arrays)


def _write_words(stream: rr.RecordingStream, scene: PlanScene, time: rr.TimeColumn) -> None:
    documents = {"summary": _summary(scene), "error_words": key_words(scene.error_map)}
    if scene.tables:
        documents["tables"] = "\n\n".join(f"### {name}\n\n{text}" for name, text in scene.tables.items())
    if scene.sweep is not None:
        documents["sweep_words"] = sweep_summary(scene.sweep)
    write_texts(stream, documents)
    kind = ["text/markdown"] * scene.poses
    words = rr.TextDocument.columns(text=list(scene.pose_words), media_type=kind)
    stream.send_columns("this_step", [time], words)


def _summary(scene: PlanScene) -> str:
    """The caller's words, then what the colours mean and how to scrub."""
    count, drawn = len(scene.candidates), len(scene.drawn_candidates())
    some = f", {drawn} of {count} drawn" if drawn < count else f" ({count})"
    tracker = "Vermillion: tracker and its lines of sight. " if scene.station is not None else ""
    sweep = ", `sweep` that of the tab Sweep" if scene.sweep is not None else ""
    return "\n\n".join(
        [
            scene.summary.strip(),
            f"**Colours** Sky blue: planned tool positions, numbered, and the markers. {tracker}Purple: hung "
            f"weight. Olive cubes: tasks. Grey: arm; dots: candidates{some}.",
            f"**Scrub** the time bar below: `{TIMELINE}` 1 to {scene.poses} is the order of measuring"
            f"{sweep}.",
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
    """Plan, error map, and where there are any tables and accuracy over the number of poses."""
    ends = [rr.TimeRangeBoundary.absolute(seq=k) for k in (0, scene.poses + 1)]
    plots = [
        rrb.TimeSeriesView(
            origin=name,
            name=f"{title} over run",
            axis_x=rrb.TimeAxis(view_range=rr.TimeRange(*ends)),
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for name, (title, _) in EXPECTED.items()
    ]
    overview = rrb.Horizontal(
        plan_view(scene, frames),
        rrb.Vertical(
            rrb.TextDocumentView(origin="summary", name="Summary"),
            rrb.TextDocumentView(origin="this_step", name="This step"),
            rrb.Horizontal(*plots),
            row_shares=[9, 4, 4],
        ),
        column_shares=[12, 9],
        name="Overview",
    )
    errors = rrb.Horizontal(
        rrb.Vertical(map_view(scene, frames), key_view("error_key_mm"), row_shares=[10, 1]),
        rrb.TextDocumentView(origin="error_words", name="Error map in words"),
        column_shares=[3, 1],
        name="Error map",
    )
    tabs: list[rrb.Container | rrb.View] = [overview, errors]
    if scene.tables:
        tabs.append(rrb.TextDocumentView(origin="tables", name="Tables"))
    if scene.sweep is not None:
        tabs.append(
            rrb.Horizontal(
                rrb.Vertical(*plot_views(scene.sweep, ": choose timeline sweep below")),
                rrb.TextDocumentView(origin="sweep_words", name="Summary of the sweep"),
                column_shares=[10, 9],
                name="Sweep",
            )
        )
    return layout(*tabs, timeline=TIMELINE)
