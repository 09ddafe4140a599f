"""The recording of a measurement plan: which poses, in which order, seen from where, and what to expect."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.views.markdown import Words
from testbench.views.recording.chart import Chart
from testbench.views.recording.curves import Curve, Curves, alone
from testbench.views.recording.error_maps import write_places_of
from testbench.views.recording.pen import text_view
from testbench.views.recording.plan_world import MANY, PlanScene, map_tab, plan_view, write_world
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.style import NOISE, NOMINAL

TIMELINE, CHART = "run", "other_plans_mm"
EXPECTED = "expected_mm"
BELOW = (360.0, 150.0)  #: Size of the pane of what to expect [ui points].


def write_plan(path: Path, header: Header, scene: PlanScene) -> None:
    """Write a measurement plan for the Rerun viewer; an existing file is replaced only by a whole one."""
    plot, expected = scene.sweep.plot(CHART) if scene.sweep else None, _expected(scene)
    words = Words(Path(__file__).parent, {"scene": scene}, "plan.md.j2")
    with recording(path, "plan", header, _blueprint(scene, plot, expected)) as pen:
        run = pen.on(rr.TimeColumn(TIMELINE, sequence=np.arange(scene.poses) + 1))
        write_world(run, scene)
        pen.documents(
            {
                "summary": f"{scene.summary.strip()}\n\n{words.block('how_to_read')}",
            }
        )
        run.texts("this_step", scene.pose_words)
        write_places_of(pen, scene.cell, scene.map, "this_step")
        expected.write(pen)
        expected.write_cursor(run, np.arange(1.0, scene.poses + 1))
        if scene.tables:
            pen.documents({"tables": scene.tables})
        if plot:
            pen.documents({"sweep_words": scene.sweep_words})
            plot.write(pen)


def _expected(scene: PlanScene) -> Curves:
    """Deflection to expect in each run, and the error of its prediction after identification."""
    run, dots = np.arange(1.0, scene.poses + 1), scene.poses <= MANY
    lines = (("deflection", NOISE, scene.deflection_mm), ("its error", NOMINAL, scene.error_mm))
    curves = [Curve(name, colour, run, alone(mm), dots=dots) for name, colour, mm in lines]
    return Curves(EXPECTED, "Expected (mm) over run", curves, {}, size=BELOW)


def _blueprint(scene: PlanScene, plot: Chart | Curves | None, expected: Curves) -> rrb.Blueprint:
    """Plan, error map, and where there are any tables and errors over the number of poses."""
    below = rrb.Horizontal(text_view("this_step", "This step"), expected.view())
    shown = rrb.Vertical(plan_view(scene), below, row_shares=[7, 3])
    tabs: list[rrb.Container | rrb.View] = [
        rrb.Horizontal(shown, text_view("summary", "Summary"), column_shares=[12, 9], name="Overview"),
        map_tab(scene),
    ]
    if scene.tables:
        tabs.append(text_view("tables", "Tables"))
    if plot:
        both = plot.view(), text_view("sweep_words", "In words")
        tabs.append(rrb.Horizontal(*both, column_shares=[12, 9], name="How many poses"))
    return layout(*tabs, timeline=TIMELINE, places=scene.poses)
