"""The arm with its load and its markers, on the timelines of the runs and on that of the load."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.rows import MM
from testbench.errors import Array
from testbench.plant.shapes import visual_shapes
from testbench.views.recording.arm import ARROW, LABEL, orbit, write_places, write_shapes, write_weight
from testbench.views.recording.drawing import Drawing
from testbench.views.recording.pen import Pen
from testbench.views.recording.style import LOAD, MEASURED, NOMINAL

HALF_VIEW = np.tan(np.deg2rad(27.5))  #: Tangent of half the viewer's vertical angle of view.
ASPECT = 0.8  #: Width over height of the narrowest pane that shows the arm [1].
SIDE = (0.35, 0.9, 0.25)  #: Where the eye is: ahead along the reach of the arm, beside it, above [1].
CLOSER = 0.6  #: The eye is at least at this share of the distance from which all runs are in view [1].
MARKERS = "world/markers"


def write_scene(runs: Pen, load: Pen, drawing: Drawing) -> None:
    """Everything under `world`.

    Args:
        runs: On the timelines of the runs, in the order of the dataset.
        load: On the timeline of loading.
        drawing: What to draw.
    """
    moving, loading, wrench = drawing.moving(), drawing.loading, drawing.data.wrench
    write_shapes(runs, drawing.cell, moving)
    _write_styles(runs, drawing)
    _write_markers(runs, drawing)
    _write_loading(load, drawing)
    whole = np.tile(wrench[loading.run], (len(loading.share), 1))
    for pen, frames, most, acting in (
        (runs, drawing, wrench, wrench),
        (load, loading, whole, loading.share[:, None] * whole),
    ):
        write_places(pen, drawing.cell, frames.rigid, frames.ghost, moving)
        _write_load(pen, drawing, drawing.bodies([drawing.cell.arm.load], frames.ghost)[:, 0], most, acting)


def _write_styles(pen: Pen, drawing: Drawing) -> None:
    """What does not change: colours and sizes."""
    radius, best = 0.012 * drawing.reach, drawing.looks[drawing.about.best].colour
    for name, colour in (("nominal", NOMINAL), ("measured", MEASURED), ("true", MEASURED)):
        pen.still(f"{MARKERS}/{name}", rr.Points3D.from_fields(colors=colour, radii=radius))
    for k, (path, look) in enumerate(zip(drawing.paths, drawing.looks, strict=True)):
        dots = rr.Points3D.from_fields(colors=look.colour, radii=0.8 * radius)
        pen.still(f"{MARKERS}/predicted_{path}", dots)
        slim = (0.5 if k == drawing.about.best else 0.8) * radius  # so that arrows on one line are both seen
        arrows = rr.Arrows3D.from_fields(colors=look.colour, radii=slim)
        pen.still(f"{MARKERS}/residual_{path}", arrows)
    thin = rr.Arrows3D.from_fields(colors=MEASURED, radii=0.5 * radius)
    pen.still(f"{MARKERS}/deflection", thin)
    leader = rr.LineStrips3D.from_fields(colors=best, radii=0.1 * radius)
    pen.still(f"{MARKERS}/worst_leader", leader)


def _write_markers(pen: Pen, drawing: Drawing) -> None:
    """Markers without load, as measured and as predicted; arrows from measured to predicted."""
    data, M, scale = drawing.data, drawing.about.magnification, drawing.residual_scale
    nominal = drawing.bodies(data.markers, drawing.rigid)
    measured = nominal + M * data.deflection
    pen.points(f"{MARKERS}/nominal", nominal)
    pen.points(f"{MARKERS}/measured", measured)
    pen.arrows(f"{MARKERS}/deflection", nominal, M * data.deflection)
    for path, errors in zip(drawing.paths, drawing.errors, strict=True):
        pen.points(f"{MARKERS}/predicted_{path}", measured - M * errors)
        pen.arrows(f"{MARKERS}/residual_{path}", measured, -scale * errors)
    _write_worst(pen, drawing, measured)


def _write_worst(pen: Pen, drawing: Drawing, measured: Array) -> None:
    """One label a run, off its marker: labels at every marker would cover each other."""
    length = MM * np.linalg.norm(drawing.errors[drawing.about.best], axis=-1)
    worst, runs = length.argmax(axis=1), np.arange(len(length))
    away = measured[runs, worst] - drawing.bodies([drawing.cell.arm.tool], drawing.ghost)[:, 0]
    size = np.linalg.norm(away, axis=1, keepdims=True)
    away = np.divide(away, size, out=np.zeros_like(away), where=size > 0.02 * drawing.reach)
    away[:, 2] += 0.5
    at = measured[runs, worst] + 0.16 * drawing.reach * away
    names = [drawing.data.markers[k] for k in worst]
    texts = [f"{name}: {mm:.3f} mm" for name, mm in zip(names, length[runs, worst], strict=True)]
    pen.label(f"{MARKERS}/worst_label", at, texts, drawing.looks[drawing.about.best].colour)
    leaders = np.stack([measured[runs, worst], at], axis=1)
    pen.rows(f"{MARKERS}/worst_leader", rr.LineStrips3D.columns(strips=leaders))


def _write_loading(pen: Pen, drawing: Drawing) -> None:
    """The same markers while the load grows: true instead of measured, predicted by the shown models."""
    loading, M = drawing.loading, drawing.about.magnification
    nominal = drawing.bodies(drawing.data.markers, loading.rigid)
    pen.points(f"{MARKERS}/nominal", nominal)
    pen.points(f"{MARKERS}/true", nominal + M * loading.deflection)
    pen.arrows(f"{MARKERS}/deflection", nominal, M * loading.deflection)
    for k in drawing.about.shown:
        pen.points(f"{MARKERS}/predicted_{drawing.paths[k]}", nominal + M * loading.predicted[k])


def _write_load(pen: Pen, drawing: Drawing, hook: Array, whole: Array, wrench: Array) -> None:
    """Force and moment as arrows at the load point of the ghost, a hung weight as a cube of steel below.

    Args:
        pen: On the times of the rows.
        drawing: What to draw.
        hook: Load point of the ghost, (rows, 3) [m].
        whole: The whole load, which sets the length of the arrows, (rows, 6) [N, N m].
        wrench: What acts of it, (rows, 6) [N, N m].
    """
    for entity, part, thick in (("force", slice(0, 3), 0.01), ("moment", slice(3, 6), 0.005)):
        size = np.linalg.norm(whole[:, part], axis=1, keepdims=True)
        if size.any():
            look = rr.Arrows3D.from_fields(colors=LOAD, radii=thick * drawing.reach)
            pen.still(f"world/load/{entity}", look)
            vectors = np.divide(wrench[:, part], size, out=np.zeros_like(hook), where=size > 0)
            pen.arrows(f"world/load/{entity}", hook[:, None], ARROW * drawing.reach * vectors[:, None])
    if drawing.payload is not None:
        share = np.linalg.norm(wrench[:, :3], axis=1) / np.linalg.norm(whole[:, :3], axis=1)
        write_weight(pen, hook, np.full(len(hook), drawing.payload), share, drawing.reach)
        return
    sizes = np.linalg.norm(wrench.reshape(-1, 2, 3), axis=-1)
    texts = [
        " and ".join(f"{x:.0f} {u}" for x, u in zip(row, ("N", "N m"), strict=True) if x) for row in sizes
    ]
    below = hook - [0, 0, 0.5 * ARROW * drawing.reach]
    pen.label(LABEL, below, [text or "no load" for text in texts], LOAD)


def world_view(drawing: Drawing) -> rrb.Spatial3DView:
    """The arm; of the markers, only the best model of each method is visible at first."""
    hidden: dict[str | rr.datatypes.EntityPath, rrb.EntityBehavior] = {
        f"/{MARKERS}/{what}_{name}": rrb.EntityBehavior(visible=False)
        for k, name in enumerate(drawing.paths)
        if k not in drawing.about.shown
        for what in ("predicted", "residual")
    }
    M, scale = drawing.about.magnification, drawing.residual_scale
    return rrb.Spatial3DView(
        origin="world",
        name=f"Arm (m): deflection x {M:g}, residual arrows x {scale:g}",
        eye_controls=orbit(*_camera(drawing)),
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
