"""The arm with its load and its markers: in the runs, at the places of the workspace, while it is loaded."""

from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.rows import MM
from testbench.errors import Array
from testbench.views.recording.arm import (
    ARROW,
    LABEL,
    orbit,
    write_places,
    write_shapes,
    write_weight,
)
from testbench.views.recording.camera import SIDE, frame
from testbench.views.recording.drawing import Drawing, States
from testbench.views.recording.error_maps import CLEAR, write_here
from testbench.views.recording.error_maps import ROOT as ERROR_MAP
from testbench.views.recording.pen import Pen
from testbench.views.recording.style import LOAD, MEASURED, NOISE, NOMINAL
from testbench.views.recording.tracker import HEAD, feet, write_sights, write_tracker

MARKERS = "world/markers"
APART = 2.5  #: Distance of arrows at one marker over their radius: none hides another [1].
CLOSE, THICK = 0.85, 0.07
"""Width over height of the pane of the loading; about half of how thick the arm is, over its reach [1]."""
LEADER = 0.25  #: Length of the line to the label of the worst marker over the reach [1].
STATION = (1.4, 0.4)
"""Where the tracker is drawn: how far ahead of the measured markers and how high, over the reach [1]."""


@dataclass(frozen=True)
class Shown:
    """States and what they are drawn on."""

    pen: Pen  #: On their timelines.
    states: States
    what: str  #: Entity of the deflected markers: measured or true.
    toward: Array  #: From the arm to the opening camera, (3,) [m].


def write_scene(runs: Pen, places: Pen, load: Pen, drawing: Drawing) -> None:
    """Everything under `world`.

    Args:
        runs: On the timelines of the runs, in the order of the dataset.
        places: On that of the places, where the compared models differ most first.
        load: On the timeline of loading.
        drawing: What to draw.
    """
    moving, (eye, target) = drawing.moving(), camera(drawing)
    write_shapes(runs, drawing.cell, moving)
    _write_styles(runs, drawing)
    for shown in (
        Shown(runs, drawing.runs, "measured", eye - target),
        Shown(places, drawing.places, "true", eye - target),
        Shown(load, drawing.loading, "true", eye - target),
    ):
        pen, states = shown.pen, shown.states
        write_places(pen, drawing.cell, states.rigid, states.ghost, moving)
        _write_markers(shown, drawing)
        _write_load(pen, drawing, states)
        write_here(pen, drawing.bodies([drawing.cell.arm.tool], states.rigid)[:, 0], drawing.reach)
    measured = _deflected(drawing, drawing.runs)
    write_tracker(runs, station(drawing))
    write_sights(runs, station(drawing), measured)


def station(drawing: Drawing) -> Array:
    """Where a tracker would see the runs: ahead of the markers, (3,) [m]; the campaign has none."""
    foot = drawing.runs.rigid.positions[0, 1]
    ahead = drawing.bodies(drawing.data.markers, drawing.runs.rigid).mean(axis=(0, 1)) - foot
    ahead[2] = 0
    size = np.linalg.norm(ahead)
    toward = ahead / size if size > 0 else np.array([1.0, 0.0, 0.0])
    far, high = STATION
    return np.asarray(foot + drawing.reach * (far * toward + np.array([0, 0, high])))


def _write_styles(pen: Pen, drawing: Drawing) -> None:
    """What does not change: colours and sizes."""
    radius = 0.012 * drawing.reach
    for name, colour in (("nominal", NOMINAL), ("measured", MEASURED), ("true", MEASURED)):
        pen.still(f"{MARKERS}/{name}", rr.Points3D.from_fields(colors=colour, radii=0.8 * radius))
    for k in drawing.about.shown:
        path, shade = drawing.paths[k], drawing.looks[k].colour
        dots = rr.Points3D.from_fields(colors=shade, radii=0.7 * radius)
        pen.still(f"{MARKERS}/predicted_{path}", dots)
        arrows = rr.Arrows3D.from_fields(colors=shade, radii=_slim(drawing))
        pen.still(f"{MARKERS}/error_{path}", arrows)
    thin = rr.Arrows3D.from_fields(colors=MEASURED, radii=0.4 * radius)
    pen.still(f"{MARKERS}/deflection", thin)
    leader = rr.LineStrips3D.from_fields(colors=NOISE, radii=0.1 * radius)
    pen.still(f"{MARKERS}/worst_leader", leader)


def _slim(drawing: Drawing) -> float:
    """Radius of an error's arrow [m]."""
    return 0.005 * drawing.reach


def _deflected(drawing: Drawing, states: States) -> Array:
    """Markers of the arm under load, the deflection magnified, (rows, m, 3) [m]."""
    nominal = drawing.bodies(drawing.data.markers, states.rigid)
    return np.asarray(nominal + drawing.about.magnification * states.deflection)


def _write_markers(shown: Shown, drawing: Drawing) -> None:
    """Markers without load, deflected and as predicted; arrows from deflected to predicted."""
    pen, states, M = shown.pen, shown.states, drawing.about.magnification
    nominal, deflected = drawing.bodies(drawing.data.markers, states.rigid), _deflected(drawing, states)
    pen.points(f"{MARKERS}/nominal", nominal)
    pen.points(f"{MARKERS}/{shown.what}", deflected)
    pen.arrows(f"{MARKERS}/deflection", nominal, M * states.deflection)
    middle = (len(drawing.about.shown) - 1) / 2
    for place, k in enumerate(drawing.about.shown):
        path, errors = drawing.paths[k], states.errors[k]
        pen.points(f"{MARKERS}/predicted_{path}", deflected - M * errors)
        arrows, aside = -states.scale * errors, APART * _slim(drawing) * (place - middle)
        pen.arrows(f"{MARKERS}/error_{path}", deflected + aside * _across(arrows, shown.toward), arrows)
    _write_worst(shown, drawing, deflected)


def _across(arrows: Array, toward: Array) -> Array:
    """Unit vectors across arrows as a camera that way sees them, (rows, m, 3); 0 for no arrow."""
    found = np.cross(arrows, toward)
    size = np.linalg.norm(found, axis=-1, keepdims=True)
    return np.asarray(np.divide(found, size, out=np.zeros_like(found), where=size > 0))


def _write_worst(shown: Shown, drawing: Drawing, deflected: Array) -> None:
    """One label a row, off its marker: labels at every marker would cover each other."""
    first = drawing.about.best if shown.what == "measured" else drawing.about.shown[0]
    length = MM * np.linalg.norm(shown.states.errors[first], axis=-1)
    worst, rows = length.argmax(axis=1), np.arange(len(length))
    tool = drawing.bodies([drawing.cell.arm.tool], shown.states.ghost)[:, 0]
    away = deflected[rows, worst] - tool
    size = np.linalg.norm(away, axis=1, keepdims=True)
    away = np.divide(away, size, out=np.zeros_like(away), where=size > 0.02 * drawing.reach)
    away[:, 2] += 0.5
    at = deflected[rows, worst] + LEADER * drawing.reach * away
    names = [drawing.data.markers[k] for k in worst]
    model = drawing.names[first]
    texts = [f"{model} at {name}: {mm:.3f} mm" for name, mm in zip(names, length[rows, worst], strict=True)]
    shade = drawing.looks[first].colour
    shown.pen.still(f"{MARKERS}/worst_label", rr.Points3D.from_fields(radii=0.0, show_labels=True))
    labels = rr.Points3D.columns(positions=at, labels=texts, colors=[shade] * len(at))
    shown.pen.rows(f"{MARKERS}/worst_label", labels)
    leaders = np.stack([deflected[rows, worst], at], axis=1)
    shown.pen.rows(f"{MARKERS}/worst_leader", rr.LineStrips3D.columns(strips=leaders))


def _write_load(pen: Pen, drawing: Drawing, states: States) -> None:
    """A hung weight on its sling below the load point of the ghost; other loads as arrows."""
    hook = drawing.bodies([drawing.cell.arm.load], states.ghost)[:, 0]
    if drawing.payload is not None:
        share = np.linalg.norm(states.wrench[:, :3], axis=1) / np.linalg.norm(states.whole[:, :3], axis=1)
        write_weight(pen, hook, share * drawing.payload, drawing.reach)
        return
    for entity, part, thick in (("force", slice(0, 3), 0.01), ("moment", slice(3, 6), 0.005)):
        size = np.linalg.norm(states.whole[:, part], axis=1, keepdims=True)
        if size.any():
            look = rr.Arrows3D.from_fields(colors=LOAD, radii=thick * drawing.reach)
            pen.still(f"world/load/{entity}", look)
            vectors = np.divide(states.wrench[:, part], size, out=np.zeros_like(hook), where=size > 0)
            pen.arrows(f"world/load/{entity}", hook[:, None], ARROW * drawing.reach * vectors[:, None])
    sizes = np.linalg.norm(states.wrench.reshape(-1, 2, 3), axis=-1)
    texts = [
        " and ".join(f"{x:.0f} {u}" for x, u in zip(row, ("N", "N m"), strict=True) if x) for row in sizes
    ]
    below = hook - [0, 0, 0.5 * ARROW * drawing.reach]
    pen.label(LABEL, below, [text or "no load" for text in texts], LOAD)


def world_view(drawing: Drawing) -> rrb.Spatial3DView:
    """The arm under its load, with its markers and what the shown models predict of them."""
    M, place, run = drawing.about.magnification, drawing.places.scale, drawing.runs.scale
    return rrb.Spatial3DView(
        origin="world",
        contents=["+ $origin/**", f"- {ERROR_MAP}/**"],
        name=f"Arm (m): deflection x {M:g}; arrows of errors x {place:g}, of runs x {run:g}",
        eye_controls=orbit(*camera(drawing)),
    )


def loading_view(drawing: Drawing) -> rrb.Spatial3DView:
    """The same from nearby, where the arm is loaded step by step; bars beside it name the errors."""
    hidden = (
        f"{ERROR_MAP}/**",
        "world/tracker/**",
        "world/sight",
        f"{MARKERS}/worst_label",
        f"{MARKERS}/worst_leader",
    )
    return rrb.Spatial3DView(
        origin="world",
        contents=["+ $origin/**", *(f"- {path}" for path in hidden)],
        name=f"Arm (m): deflection x {drawing.about.magnification:g}, errors x {drawing.loading.scale:g}",
        eye_controls=orbit(*loading_camera(drawing)),
    )


def camera(drawing: Drawing) -> tuple[Array, Array]:
    """Eye and target, each (3,) [m]: every place, every run and the tracker in view, the first from aside.

    Of both sides it is that from which the tracker stands farther away: it must not hide the arm.
    """
    tracker = station(drawing)
    points = [np.vstack([tracker, feet(tracker)])]
    for states in (drawing.places, drawing.runs):
        points += [frames.positions[:, 1:].reshape(-1, 3) for frames in (states.rigid, states.ghost)]
    tool = drawing.bodies([drawing.cell.arm.tool], drawing.places.rigid)[0, 0, :2]
    found = np.vstack(points)
    ahead, aside, above = SIDE
    sides = [frame(found, np.full(len(found), HEAD), tool, (ahead, s * aside, above)) for s in (1, -1)]
    return max(sides, key=lambda side: float(np.linalg.norm(side[0] - tracker)))


def loading_camera(drawing: Drawing) -> tuple[Array, Array]:
    """The same for the arm that is loaded step by step, its markers and what hangs from it."""
    states, away = drawing.loading, [0, 0, 2 * ARROW * drawing.reach]
    markers = drawing.bodies(drawing.data.markers, states.ghost).reshape(-1, 3)
    hooks = drawing.bodies([drawing.cell.arm.load], states.ghost)[:, 0]
    points = np.vstack(
        [*states.rigid.positions[:1, 1:], *states.ghost.positions[-1:, 1:], markers, hooks - away]
    )
    tool = drawing.bodies([drawing.cell.arm.tool], states.rigid)[0, 0, :2]
    return frame(points, np.full(len(points), THICK * drawing.reach), tool, aspect=CLOSE)


def map_camera(drawing: Drawing) -> tuple[Array, Array]:
    """The same for the error maps: every place of the tool and the arm of the first."""
    tools = drawing.bodies([drawing.cell.arm.tool], drawing.places.rigid)[:, 0]
    above = np.array([*tools[:, :2].mean(axis=0), tools[:, 2].max() + 2 * CLEAR * drawing.reach])
    points = np.vstack([tools, drawing.places.rigid.positions[0, 1:], above])
    return frame(points, np.full(len(points), HEAD), tools[0, :2])
