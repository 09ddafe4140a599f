"""The page of a prediction: the arm bent by its loads in the poses of the file, and where it is soft."""

from dataclasses import replace

import numpy as np

from testbench.bench.prediction import Predicted
from testbench.bench.prediction_report import PredictionReport
from testbench.bench.rows import MM
from testbench.correct.rest import rest
from testbench.correct.stiffness import direction_words
from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.views.colours import GCO, MEASURED, NOMINAL, Look
from testbench.views.magnified import arrow_scale
from testbench.views.page.charts import Line, PlaceMap, RunChart
from testbench.views.page.page import Seen
from testbench.views.page.scene import Layer, Poses, Scene
from testbench.views.picked import of_all, picked
from testbench.views.predicted.words import tables
from testbench.views.schema import Table

MOVED, GIVE = 0.15, 0.25  #: Length of most deflections and of most ways by a force over the reach [1].
FARTHEST = 14  #: Poses of the table, each a line of its chart.
TOOL = Look(GCO, 0, prior=True)


def seen(made: Predicted, report: PredictionReport) -> Seen:
    """What the page of a prediction draws."""
    some = picked(made.found.size[:, 0], np.arange(len(made.found.size)))
    reach, field = made.cell.vjm.reach, made.map
    M = arrow_scale(made.found.deflection[some, :1], MOVED * reach)
    G = arrow_scale(field.force * made.stiffness.give[some, :1] * made.stiffness.softest[some], GIVE * reach)
    title = (
        f"Deflections x {M:g}; green: how far {field.force:,.0f} N move the loaded tool along its principal "
        f"axes, x {G:g}."
    )
    size, half = MM * made.found.size[some, 0], MM * made.found.widest[some, 0]
    half = np.where(np.isfinite(half), half, np.nan)
    tool = Line("tool", TOOL, size, (np.maximum(size - half, 0), size + half))
    note = of_all(len(some), len(made.asked.q), "poses")
    labels = [made.asked.labels[k] for k in some]
    chart = RunChart("How far the tool moves in each pose, 95 % intervals (mm)", 0, labels, [tool], note=note)
    where = f"How far {field.force:,.0f} N in the worst direction move the tool (mm)"
    soft = Line("tool", TOOL, MM * field.worst)
    return Seen(
        scene=Scene(made.cell, title, [_asked(made, some, M, G), _places(made)]),
        map=PlaceMap(where, 1, field.position, [soft], heading="Where it is soft"),
        runs=[chart],
        tables=[_farthest(tables(report)["worst"])],
    )


def _farthest(table: Table) -> Table:
    """The poses that go farthest, as many as a chart can name."""
    rows = table.rows[:FARTHEST]
    title = f"The {len(rows)} poses that move most" if len(rows) > 1 else "The pose"
    return replace(table, rows=rows, title=title, headline="deflection_mm")


def _asked(made: Predicted, some: Ids, M: float, G: float) -> Poses:
    """The poses of the file, bent by what acts there."""
    found, state, q = made.found, made.model.state, made.asked.q[some]
    theta = rest(state, q, [load.of(some) for load in made.asked.loads]).theta - rest(state, q).theta
    deflection = found.deflection[some]
    start = found.position[some] - deflection
    end = start + M * deflection
    ways = G * made.map.force * (made.stiffness.give[some][:, None] * made.stiffness.axes[some])
    ways = ways.transpose(0, 2, 1)  # a row an axis
    return Poses(
        name="Poses of the file",
        names=[f"Pose {made.asked.labels[k]}" for k in some],
        words=[_said(made, int(k)) for k in some],
        rigid=rigid_frames(made.cell.room, q),
        bent=elastic_frames(made.cell.plant, q, M * theta),
        layers=[
            Layer("tool and markers, unloaded", NOMINAL, "dots", start),
            Layer("deflection", MEASURED, "arrows", start, end),
            Layer("where a force moves it", GCO, "lines", end[:, :1] - ways, end[:, :1] + ways),
        ],
        first=int(found.size[some, 0].argmax()),
    )


def _said(made: Predicted, k: int) -> str:
    size, half = MM * made.found.size[k, 0], MM * made.found.widest[k, 0]
    push = MM * made.map.force * made.stiffness.give[k, 0]
    return (
        f"The tool moves {size:.3f} mm, {_sure(half)}. {made.map.force:,.0f} N move it up to {push:.3f} mm, "
        f"{direction_words(made.stiffness.softest[k])}. {made.model.arm.words(made.asked.q[k])}."
    )


def _sure(half: float) -> str:
    return f"+- {half:.3f} mm (95 %)" if np.isfinite(half) else "not seen by the data"


def _places(made: Predicted) -> Poses:
    """The arm all over the workspace, and its softest direction there."""
    field, reach = made.map, made.cell.vjm.reach
    way: Array = field.worst[:, None] * field.direction
    way = (way * arrow_scale(way, GIVE * reach))[:, None]
    at = field.position[:, None]
    sizes = zip(MM * field.worst, MM * field.half.max(axis=1), field.direction, field.q, strict=True)
    return Poses(
        name="Workspace",
        names=[f"Place {k} of {len(field.q)}" for k in range(1, len(field.q) + 1)],
        words=[
            f"{field.force:,.0f} N {direction_words(direction)} move the tool {size:.3f} mm, {_sure(half)}. "
            f"{made.model.arm.words(q)}."
            for size, half, direction, q in sizes
        ],
        rigid=rigid_frames(made.cell.room, field.q),
        bent=None,
        layers=[Layer("softest direction", GCO, "lines", at - way, at + way)],
    )
