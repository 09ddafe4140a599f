"""The arm with its load and its markers, on the timelines of the runs and on that of the load."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.rows import MM
from testbench.errors import Array
from testbench.plant.shapes import Frames, visual_shapes
from testbench.views.recording.arm import (
    ARROW,
    Places,
    Weight,
    write_load_label,
    write_places,
    write_shapes,
    write_weight,
)
from testbench.views.recording.drawing import Drawing
from testbench.views.recording.style import LOAD, MEASURED, NOMINAL, Colour

HALF_VIEW = np.tan(np.deg2rad(27.5))
"""Tangent of half the viewer's vertical angle of view."""
ASPECT = 0.8
"""Width over height of the narrowest pane that shows the arm [1]."""
SIDE = (0.35, 0.9, 0.25)
"""Where the eye is: ahead along the reach of the arm, beside it, above [1]."""
CLOSER = 0.6
"""The eye is at least at this share of the distance from which all runs are in view [1]."""


def write_scene(
    stream: rr.RecordingStream, drawing: Drawing, runs: Sequence[rr.TimeColumn], load: rr.TimeColumn
) -> None:
    """Everything under `world`.

    Args:
        stream: Where to.
        drawing: What to draw.
        runs: Timelines of the runs, in the order of the dataset.
        load: Timeline of loading.
    """
    moving = drawing.moving()
    write_shapes(stream, drawing.cell, moving)
    loading = drawing.loading
    write_places(stream, drawing.cell, Places(runs, drawing.rigid, drawing.ghost, moving))
    write_places(stream, drawing.cell, Places([load], loading.rigid, loading.ghost, moving))
    _write_styles(stream, drawing)
    _write_markers(stream, drawing, runs)
    _write_loading(stream, drawing, load)
    wrench = drawing.data.wrench
    _write_load(stream, drawing, runs, _Load(_hook(drawing, drawing.ghost), wrench, wrench))
    whole = np.tile(wrench[loading.run], (len(loading.share), 1))
    hook = _hook(drawing, loading.ghost)
    _write_load(stream, drawing, [load], _Load(hook, whole, loading.share[:, None] * whole))


def _write_styles(stream: rr.RecordingStream, drawing: Drawing) -> None:
    """What does not change: colours and sizes."""
    radius = 0.012 * drawing.reach
    points: dict[str, tuple[Colour, float]] = {
        "nominal": (NOMINAL, radius),
        "measured": (MEASURED, radius),
        "true": (MEASURED, radius),
    }
    for k, (path, look) in enumerate(zip(drawing.paths, drawing.looks, strict=True)):
        points[f"predicted_{path}"] = (look.colour, 0.8 * radius)
        slim = (0.5 if k == drawing.best else 0.8) * radius  # so that arrows on one line are both seen
        stream.log(
            _marker(f"residual_{path}"), rr.Arrows3D.from_fields(colors=look.colour, radii=slim), static=True
        )
    for name, (colour, size) in points.items():
        stream.log(_marker(name), rr.Points3D.from_fields(colors=colour, radii=size), static=True)
    thin = rr.Arrows3D.from_fields(colors=MEASURED, radii=0.5 * radius)
    stream.log(_marker("deflection"), thin, static=True)
    label = rr.Points3D.from_fields(colors=drawing.looks[drawing.best].colour, radii=0.0, show_labels=True)
    stream.log(_marker("worst_label"), label, static=True)
    leader = rr.LineStrips3D.from_fields(colors=drawing.looks[drawing.best].colour, radii=0.1 * radius)
    stream.log(_marker("worst_leader"), leader, static=True)


def _marker(name: str) -> str:
    return f"world/markers/{name}"


def _write_markers(stream: rr.RecordingStream, drawing: Drawing, times: Sequence[rr.TimeColumn]) -> None:
    """Markers without load, as measured and as predicted; arrows from measured to predicted."""
    data, M, scale = drawing.data, drawing.magnification, drawing.residual_scale
    nominal = drawing.bodies(data.markers, drawing.rigid)
    measured = nominal + M * data.deflection
    write_points(stream, "nominal", times, nominal)
    write_points(stream, "measured", times, measured)
    _arrows(stream, "deflection", times, nominal, M * data.deflection)
    for path, errors in zip(drawing.paths, drawing.errors, strict=True):
        write_points(stream, f"predicted_{path}", times, measured - M * errors)
        _arrows(stream, f"residual_{path}", times, measured, -scale * errors)
    _write_worst(stream, drawing, times, measured)


def _write_worst(
    stream: rr.RecordingStream, drawing: Drawing, times: Sequence[rr.TimeColumn], measured: Array
) -> None:
    """One label a run, off its marker: labels at every marker would cover each other."""
    length = MM * np.linalg.norm(drawing.errors[drawing.best], axis=-1)
    worst, runs = length.argmax(axis=1), np.arange(len(length))
    away = measured[runs, worst] - drawing.bodies([drawing.cell.arm.tool], drawing.ghost)[:, 0]
    size = np.linalg.norm(away, axis=1, keepdims=True)
    away = np.divide(away, size, out=np.zeros_like(away), where=size > 0.02 * drawing.reach)
    away[:, 2] += 0.5
    at = measured[runs, worst] + 0.16 * drawing.reach * away
    labels = [
        f"{drawing.data.markers[k]}: {mm:.3f} mm" for k, mm in zip(worst, length[runs, worst], strict=True)
    ]
    columns = rr.Points3D.columns(positions=at, labels=labels).partition([1] * len(at))
    stream.send_columns(_marker("worst_label"), times, columns)
    leaders = np.stack([measured[runs, worst], at], axis=1)
    stream.send_columns(_marker("worst_leader"), times, rr.LineStrips3D.columns(strips=leaders))


def _write_loading(stream: rr.RecordingStream, drawing: Drawing, time: rr.TimeColumn) -> None:
    """The same markers while the load grows: true instead of measured, predicted by the shown models."""
    loading, M = drawing.loading, drawing.magnification
    nominal = drawing.bodies(drawing.data.markers, loading.rigid)
    write_points(stream, "nominal", [time], nominal)
    write_points(stream, "true", [time], nominal + M * loading.deflection)
    _arrows(stream, "deflection", [time], nominal, M * loading.deflection)
    for k in drawing.shown:
        write_points(stream, f"predicted_{drawing.paths[k]}", [time], nominal + M * loading.predicted[k])


def write_points(
    stream: rr.RecordingStream, name: str, times: Sequence[rr.TimeColumn], positions: Array
) -> None:
    """A point a marker: positions (times, m, 3) [m]."""
    columns = rr.Points3D.columns(positions=positions.reshape(-1, 3))
    stream.send_columns(_marker(name), times, columns.partition([positions.shape[1]] * len(positions)))


def _arrows(
    stream: rr.RecordingStream, name: str, times: Sequence[rr.TimeColumn], origins: Array, vectors: Array
) -> None:
    """An arrow a marker: origins and vectors (times, m, 3) [m]."""
    columns = rr.Arrows3D.columns(origins=origins.reshape(-1, 3), vectors=vectors.reshape(-1, 3))
    stream.send_columns(_marker(name), times, columns.partition([origins.shape[1]] * len(origins)))


@dataclass(frozen=True)
class _Load:
    """What acts on the arm."""

    hook: Array  #: Load point of the ghost, (rows, 3) [m].
    whole: Array  #: The whole load, which sets the length of the arrows, (rows, 6) [N, N m].
    wrench: Array  #: What acts of it, (rows, 6) [N, N m].


def _hook(drawing: Drawing, ghost: Frames) -> Array:
    return drawing.bodies([drawing.cell.arm.load], ghost)[:, 0]


def _write_load(
    stream: rr.RecordingStream, drawing: Drawing, times: Sequence[rr.TimeColumn], load: _Load
) -> None:
    """Force and moment as arrows at the load point of the ghost, a hung weight as a cube of steel below."""
    hook, whole, wrench, payload = load.hook, load.whole, load.wrench, drawing.payload
    for entity, part, thick in (("force", slice(0, 3), 0.01), ("moment", slice(3, 6), 0.005)):
        size = np.linalg.norm(whole[:, part], axis=1, keepdims=True)
        if not size.any():
            continue
        look = rr.Arrows3D.from_fields(colors=LOAD, radii=thick * drawing.reach)
        stream.log(f"world/load/{entity}", look, static=True)
        vectors = np.divide(wrench[:, part], size, out=np.zeros_like(hook), where=size > 0)
        columns = rr.Arrows3D.columns(origins=hook, vectors=ARROW * drawing.reach * vectors)
        stream.send_columns(f"world/load/{entity}", times, columns)
    if payload is not None:
        share = np.linalg.norm(wrench[:, :3], axis=1) / np.linalg.norm(whole[:, :3], axis=1)
        write_weight(stream, times, Weight(hook, np.full(len(hook), payload), share), drawing.reach)
        return
    texts = [
        " and ".join(f"{x:.0f} {unit}" for x, unit in zip(sizes, ("N", "N m"), strict=True) if x > 0)
        or "no load"
        for sizes in np.linalg.norm(wrench.reshape(-1, 2, 3), axis=-1)
    ]
    write_load_label(stream, times, hook - [0, 0, 0.5 * ARROW * drawing.reach], texts)


def world_view(drawing: Drawing) -> rrb.Spatial3DView:
    """The arm; of the markers, only the best model of each method is visible at first."""
    eye, target = _camera(drawing)
    hidden: dict[str | rr.datatypes.EntityPath, rrb.EntityBehavior] = {
        f"/world/markers/{what}_{name}": rrb.EntityBehavior(visible=False)
        for k, name in enumerate(drawing.paths)
        if k not in drawing.shown
        for what in ("predicted", "residual")
    }
    return rrb.Spatial3DView(
        origin="world",
        name=f"Arm (m): deflection x {drawing.magnification:g}, residual arrows x {drawing.residual_scale:g}",
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=eye, look_target=target, eye_up=(0, 0, 1)
        ),
        overrides=hidden,
    )


def _camera(drawing: Drawing) -> tuple[Array, Array]:
    """Eye and target, each (3,) [m]: the worst run in view, and the others not much beyond it."""
    hooks = drawing.bodies([drawing.cell.arm.load], drawing.ghost) - [0, 0, 0.3 * drawing.reach]
    points = np.hstack([drawing.rigid.positions, drawing.ghost.positions, hooks])
    tool = drawing.bodies([drawing.cell.arm.tool], drawing.rigid)[drawing.worst, 0, :2]
    centres, radii = _spheres(drawing)
    worst = np.vstack([points[drawing.worst], centres])
    eye, target = frame(worst, np.append(np.zeros(points.shape[1]), radii), tool)
    every = points.reshape(-1, 3)
    far, middle = frame(every, np.zeros(len(every)), tool)
    closer = CLOSER * np.linalg.norm(far - middle) / np.linalg.norm(eye - target)
    return target + max(1.0, float(closer)) * (eye - target), target


def _spheres(drawing: Drawing) -> tuple[Array, Array]:
    """Spheres around every shape of the worst run, rigid and deflected: centres (n, 3), radii (n,) [m]."""
    shapes = visual_shapes(drawing.cell.room)
    bodies = [shape.body for shape in shapes]
    at = np.array([shape.position for shape in shapes])
    centres = [
        frames.positions[drawing.worst, bodies]
        + np.einsum("kxy,ky->kx", frames.rotations[drawing.worst, bodies], at)
        for frames in (drawing.rigid, drawing.ghost)
    ]
    corners = [s.size if s.mesh is None else s.mesh.vertices for s in shapes]
    radii = np.array([np.linalg.norm(x, axis=-1).max() for x in corners])
    return np.concatenate(centres), np.tile(radii, 2)


def frame(
    points: Array,
    radii: Array,
    tool: Array,
    side: tuple[float, float, float] = SIDE,
    aspect: float = ASPECT,
) -> tuple[Array, Array]:
    """Eye and target, each (3,) [m], all spheres in view.

    Args:
        points: Their centres, (points, 3) [m].
        radii: Of the spheres, (points,) [m].
        tool: Where the arm reaches, seen from above, (2,) [m].
        side: Where the eye is: ahead along the reach of the arm, beside it, above [1].
        aspect: Width over height of the pane [1].
    """
    length = float(np.linalg.norm(tool))
    x, y = tool / length if length > 0 else (1.0, 0.0)
    ahead, aside, above = side
    back = np.array([aside * y + ahead * x, -aside * x + ahead * y, above])
    back /= np.linalg.norm(back)
    right = np.array([-back[1], back[0], 0]) / np.hypot(back[0], back[1])
    axes = np.column_stack([back, right, np.cross(back, right)])
    along = points @ axes
    low, high = (along - radii[:, None]).min(axis=0), (along + radii[:, None]).max(axis=0)
    target = axes @ ((low + high) / 2)
    depth, across, up = ((points - target) @ axes).T
    wide = np.maximum(np.abs(across) / aspect, np.abs(up)) + radii
    distance = float((depth + wide / HALF_VIEW).max())  # the point that needs most
    return target + distance * back, target
