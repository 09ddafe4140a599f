"""The recording of a measurement plan: which poses, in which order, seen from where, and what to expect."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import MarkerShape

from testbench.views.markdown import Words
from testbench.views.recording.chart import Chart
from testbench.views.recording.curves import Curves
from testbench.views.recording.error_map import key_view, map_words, write_key
from testbench.views.recording.pen import Line, text_view
from testbench.views.recording.plan_world import PlanScene, map_view, plan_view, write_world
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.style import NOISE, NOMINAL

TIMELINE, CHART, KEY = "run", "other_plans_mm", "error_key_mm"
EXPECTED = {
    "expected_deflection_mm": ("Expected deflection (mm)", NOISE),
    "expected_error_mm": ("Expected error (mm)", NOMINAL),
}
"""Plots over the order of measuring: title and colour by path."""


def write_plan(path: Path, header: Header, scene: PlanScene) -> None:
    """Write a measurement plan for the Rerun viewer; an existing file is replaced only by a whole one."""
    plot = scene.sweep.plot(CHART) if scene.sweep else None
    words = Words(Path(__file__).parent, {"scene": scene}, "plan.md.j2")
    with recording(path, "plan", header, _blueprint(scene, plot)) as pen:
        run = pen.on(rr.TimeColumn(TIMELINE, sequence=np.arange(scene.poses) + 1))
        write_world(run, scene)
        pen.documents(
            {
                "summary": f"{scene.summary.strip()}\n\n{words.block('how_to_read')}",
                "error_words": map_words(scene.error_map),
            }
        )
        run.texts("this_step", scene.pose_words)
        write_key(pen, KEY, scene.error_map.scale)
        values = (scene.deflection_mm, scene.error_mm)
        for (name, (title, colour)), mm in zip(EXPECTED.items(), values, strict=True):
            run.line(Line(name, title.lower(), colour, 2.0, MarkerShape.Circle), mm)
        if scene.tables:
            pen.documents({"tables": scene.tables})
        if plot:
            pen.documents({"sweep_words": scene.sweep_words})
            plot.write(pen)


def _blueprint(scene: PlanScene, plot: Chart | Curves | None) -> rrb.Blueprint:
    """Plan, error map, and where there are any tables and errors over the number of poses."""
    ends = [rr.TimeRangeBoundary.absolute(seq=k) for k in (0, scene.poses + 1)]
    expected = [
        rrb.TimeSeriesView(
            origin=path,
            name=f"{title} over run",
            axis_x=rrb.TimeAxis(view_range=rr.TimeRange(*ends)),
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for path, (title, _) in EXPECTED.items()
    ]
    words = [text_view("summary", "Summary"), text_view("this_step", "This step")]
    beside = rrb.Vertical(*words, rrb.Horizontal(*expected), row_shares=[9, 4, 4])
    mapped = rrb.Vertical(map_view(scene), key_view(KEY, scene.error_map.scale), row_shares=[10, 1])
    in_words = text_view("error_words", "Error map in words")
    tabs: list[rrb.Container | rrb.View] = [
        rrb.Horizontal(plan_view(scene), beside, column_shares=[12, 9], name="Overview"),
        rrb.Horizontal(mapped, in_words, column_shares=[3, 1], name="Error map"),
    ]
    if scene.tables:
        tabs.append(text_view("tables", "Tables"))
    if plot:
        both = plot.view(), text_view("sweep_words", "In words")
        tabs.append(rrb.Horizontal(*both, column_shares=[12, 9], name="How many poses"))
    return layout(*tabs, timeline=TIMELINE, places=scene.poses)
