"""Blank panes and arms at their origin are seen: recordings with such faults are looked at."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.report.colours import Look
from testbench.report.recording.stream import RecordingHeader, recording, text_view

ROWS = np.arange(3)
RED = (200, 60, 20)


def written(path, *timelines):
    """An arm, a chart and a text on timelines `run` and `load`; faults: what is on these alone."""
    chart = rrb.TimeSeriesView(origin="chart", name="Chart")
    shown = rrb.Vertical(chart, text_view("text", "Text"), name="Charts")
    world = rrb.Spatial3DView(origin="world", name="Arm")
    tabs = rrb.Horizontal(world, name="World"), shown
    with recording(path, RecordingHeader(path.stem, "{}", 1)) as pen:
        pen.layout(*tabs, timeline="run", places=3)
        pen.still("world/arm/link", rr.Boxes3D(half_sizes=[0.1, 0.1, 0.5], colors=RED, fill_mode="solid"))
        for timeline in ("run", "load"):
            own = pen.on(rr.TimeColumn(timeline, sequence=ROWS))
            own.rows("world/arm", rr.Scalars.columns(scalars=ROWS))  # so both timelines are there
            if timeline in timelines:
                own.rows("world/arm/link", rr.Transform3D.columns(translation=[[0, 0, 1]] * 3))
                own.line("chart/line", "line", Look(RED, 0, prior=False), ROWS)
                own.texts("text", ["A sentence that has letters enough to be read by somebody."] * 3)
    return path


def test_what_stays_blank_until_the_timeline_is_changed_is_seen(tmp_path, blank_panes, monkeypatch):
    monkeypatch.setattr("panes.PATIENCE", 1.0)
    found = "\n".join(blank_panes(written(tmp_path / "blank.rrd", "load")))
    assert "world/arm/link on run" in found
    for pane in ("Chart", "Text"):
        assert f"{pane!r}: " in found
    assert "on load" not in found
    assert "on run at 0" in found
