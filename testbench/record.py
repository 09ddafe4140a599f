"""A calibration study as a Rerun recording: a view of the report, never an input.

The only importer of rerun.
"""

import contextlib
import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import FillMode, MarkerShape
from scipy.spatial.transform import Rotation

from testbench import recording_text as text
from testbench.bench import Campaign, Cell, Result
from testbench.errors import Array
from testbench.files import versions
from testbench.plant.shapes import Frames, Shape, body_names, join_meshes, visual_shapes
from testbench.recording_study import (
    RESIDUAL_FACTOR,
    Bars,
    Study,
    build_study,
    camera,
    histograms,
    moves,
    noise_limit,
)
from testbench.report import MM, Report

Colour = tuple[int, ...]

APPLICATION = "testbench_calibration_v1"
TIMELINES = ("worst_first", "pose")
SETS = ("identification", "check")

NOMINAL, MEASURED, LOAD, NOISE = (86, 180, 233), (213, 94, 0), (204, 121, 167), (127, 127, 127)
ORANGE, GREEN = (230, 159, 0), (0, 158, 115)
"""Roles, Okabe-Ito: sky blue, vermillion, purple, grey; least squares orange, GCO green."""
GHOST = (*MEASURED, 70)

MARKERS = (
    MarkerShape.Circle,
    MarkerShape.Diamond,
    MarkerShape.Square,
    MarkerShape.Up,
    MarkerShape.Cross,
    MarkerShape.Plus,
)
"""Tell models of one colour apart; used again from the start beyond six models."""

STEEL = 7850.0
"""Density [kg/m^3] of the drawn weight, a cube."""


def write_recording(
    path: Path,
    report: Report,
    cell: Cell,
    campaign: Campaign,
    results: Sequence[Result],
    *,
    magnification: float = 50.0,
) -> None:
    """Write a calibration study for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        report: The numbers of this campaign's seed; all text is written from them.
        cell: The arm.
        campaign: What was measured.
        results: One a model, in the order of the report's.
        magnification: Of the drawn deflections [1]; residuals are drawn RESIDUAL_FACTOR times larger still.
    """
    study = build_study(report, cell, campaign, results, magnification)
    with _stream(path, study) as stream:
        _write_properties(stream, study)
        _write_texts(stream, study)
        _write_arm(stream, study)
        _write_markers(stream, study)
        _write_load(stream, study)
        _write_residuals(stream, study)
        _write_histograms(stream, study)


@contextlib.contextmanager
def _stream(path: Path, study: Study) -> Iterator[rr.RecordingStream]:
    """A stream into a part file, closed with its footer in any case; without an error it becomes `path`."""
    part = path.with_name(path.name + ".part")
    strict = rr.strict_mode()
    rr.set_strict_mode(True)  # otherwise a wrong argument only warns, and the data are lost
    scenario = study.campaign.scenario.model_dump_json()
    digest = hashlib.sha256(f"{scenario} {study.campaign.seed}".encode()).hexdigest()[:16]
    try:
        # The stream's own properties would hold the time of writing: equal seeds would differ.
        stream = rr.RecordingStream(APPLICATION, recording_id=digest, send_properties=False)
        try:
            stream.set_log_time_enabled(False)
            stream.set_log_tick_enabled(False)
            stream.save(part, default_blueprint=_blueprint(study))
            yield stream
        finally:
            stream.disconnect()
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
        rr.set_strict_mode(strict)


def _times(study: Study) -> list[rr.TimeColumn]:
    """Both timelines of columns that are in the order of the dataset."""
    rows = (study.rank, np.arange(len(study.rank)))
    return [rr.TimeColumn(name, sequence=row) for name, row in zip(TIMELINES, rows, strict=True)]


def _colour(study: Study, k: int) -> Colour:
    """Role colour of a model."""
    return GREEN if text.is_gco(study.report["models"][k]) else ORANGE


def _write_properties(stream: rr.RecordingStream, study: Study) -> None:
    stream.send_recording_name(f"{study.report['scenario']}, seed {study.campaign.seed}")
    stream.send_property(
        "study",
        rr.AnyValues(
            scenario=study.report["scenario"],
            parameters=study.campaign.scenario.model_dump_json(),
            seed=study.campaign.seed,
            deflection_magnification=study.magnification,
            residual_magnification=study.magnification * RESIDUAL_FACTOR,
        ),
    )
    stream.send_property("versions", rr.AnyValues(drop_untyped_nones=True, **versions()))


def _write_texts(stream: rr.RecordingStream, study: Study) -> None:
    runs = text.run_lines(study.campaign.measured, study.checked, study.rank)
    scales = study.magnification, study.magnification * RESIDUAL_FACTOR
    documents = {
        "summary": text.summary(
            study.report,
            study.cell.arm.title,
            study.campaign.scenario,
            runs[study.worst].where,
            scales,
        ),
        "table": text.table(runs, study.names, study.residual),
        "log": text.notes(study.report),
    }
    for path, document in documents.items():
        stream.log(path, rr.TextDocument(document, media_type="text/markdown"), static=True)
    captions = text.captions(runs, study.names, study.residual)
    kind = ["text/markdown"] * len(captions)
    columns = rr.TextDocument.columns(text=captions, media_type=kind)
    stream.send_columns("this_run", _times(study), columns)


def _write_arm(stream: rr.RecordingStream, study: Study) -> None:
    """Rigid arm and magnified ghost, body by body; a body that stays where it is has no ghost."""
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    arm, names, shapes = study.cell.arm, body_names(study.cell.room), visual_shapes(study.cell.room)
    for body in sorted({shape.body for shape in shapes}):
        if names[body] in (arm.load, *arm.markers):  # drawn by their roles
            continue
        own = [shape for shape in shapes if shape.body == body]
        drawn: list[tuple[str, Frames, Colour | None]] = [("arm", study.rigid, None)]
        drawn += [("arm_deflected", study.ghost, GHOST)] if moves(study, body) else []
        for entity, frames, colour in drawn:
            path = rr.new_entity_path(["world", entity, names[body]])
            stream.log(path, *_solids(own, colour), static=True)
            turns = Rotation.from_matrix(frames.rotations[:, body]).as_quat()
            at = rr.Transform3D.columns(translation=frames.positions[:, body], quaternion=turns)
            stream.send_columns(path, _times(study), at)


def _solids(shapes: Sequence[Shape], colour: Colour | None) -> list[rr.AsComponents]:
    """The shapes of a body, one archetype a kind; in shades of grey where no colour is given."""
    solids: list[rr.AsComponents] = []
    for kind in dict.fromkeys(shape.kind for shape in shapes):
        own = [shape for shape in shapes if shape.kind == kind]
        size, centre = np.array([s.size for s in own]), np.array([s.position for s in own])
        R, radius, length = np.array([s.rotation for s in own]), size[:, 0], 2 * size[:, 2]
        look: dict[str, Any] = {
            "quaternions": Rotation.from_matrix(R).as_quat(),
            "colors": [colour or _grey(s.rgba) for s in own],
            "fill_mode": FillMode.Solid,
        }
        if kind == "mesh":
            solids.append(_mesh(own, look["colors"]))
        elif kind == "box":
            solids.append(rr.Boxes3D(half_sizes=size, centers=centre, **look))
        elif kind == "cylinder":
            solids.append(rr.Cylinders3D(lengths=length, radii=radius, centers=centre, **look))
        elif kind == "capsule":  # Rerun's begins at its origin
            start = centre - R[:, :, 2] * size[:, 2:]
            solids.append(rr.Capsules3D(lengths=length, radii=radius, translations=start, **look))
        else:
            solids.append(rr.Ellipsoids3D(half_sizes=size, centers=centre, **look))
    return solids


def _grey(rgba: Array) -> Colour:
    """Grey of about the brightness of a colour, neither black nor white: colours are roles."""
    level = round(255 * (0.35 + 0.45 * float(rgba[:3] @ [0.299, 0.587, 0.114])))
    return level, level, level


def _mesh(shapes: Sequence[Shape], colours: Sequence[Colour]) -> rr.Mesh3D:
    """All meshes of a body as one."""
    mesh, counts = join_meshes(shapes)
    return rr.Mesh3D(
        vertex_positions=mesh.vertices,
        vertex_normals=mesh.normals,
        triangle_indices=mesh.faces,
        vertex_colors=np.repeat(np.array(colours, dtype=np.uint8), counts, axis=0),
    )


def _write_markers(stream: rr.RecordingStream, study: Study) -> None:
    """Markers without load, as measured and as predicted; arrows from measured to predicted."""
    data, M = study.campaign.measured, study.magnification
    nominal = study.bodies(data.markers, study.rigid)
    measured, radius = nominal + M * data.deflection, 0.012 * study.reach
    sag = M * data.deflection, data.deflection
    _points(stream, study, "nominal", nominal, colors=NOMINAL, radii=radius, labels=data.markers)
    _points(stream, study, "measured", measured, colors=MEASURED, radii=radius)
    thin: dict[str, Any] = {"colors": MEASURED, "radii": 0.5 * radius, "show_labels": False}
    _arrows(stream, study, "deflection", nominal, *sag, **thin)
    for k, result in enumerate(study.results):
        name, colour, best = study.paths[k], _colour(study, k), k == study.best
        predicted = measured - M * result.residuals
        _points(stream, study, f"predicted_{name}", predicted, colors=colour, radii=0.8 * radius)
        slim = (0.5 if best else 0.8) * radius  # so that arrows on one line are both seen
        error = -M * RESIDUAL_FACTOR * result.residuals, result.residuals
        look: dict[str, Any] = {"colors": colour, "radii": slim, "show_labels": best}
        _arrows(stream, study, f"residual_{name}", measured, *error, **look)


def _points(stream: rr.RecordingStream, study: Study, name: str, positions: Array, **look: Any) -> None:
    """A point a marker, positions (runs, m, 3) [m]."""
    path = f"world/markers/{name}"
    stream.log(path, rr.Points3D.from_fields(**look), static=True)
    columns = rr.Points3D.columns(positions=positions.reshape(-1, 3))
    stream.send_columns(path, _times(study), columns.partition([positions.shape[1]] * len(positions)))


def _arrows(
    stream: rr.RecordingStream,
    study: Study,
    name: str,
    origins: Array,
    drawn: Array,
    true: Array,
    **look: Any,
) -> None:
    """An arrow a marker: origins and drawn vectors (runs, m, 3) [m], labelled with the true length in mm."""
    path = f"world/markers/{name}"
    stream.log(path, rr.Arrows3D.from_fields(**look), static=True)
    labels = [f"{mm:.2f} mm" for mm in MM * np.linalg.norm(true, axis=-1).ravel()]
    columns = rr.Arrows3D.columns(origins=origins.reshape(-1, 3), vectors=drawn.reshape(-1, 3), labels=labels)
    stream.send_columns(path, _times(study), columns.partition([origins.shape[1]] * len(origins)))


def _write_load(stream: rr.RecordingStream, study: Study) -> None:
    """The weight as an arrow at the load point of the ghost, and as a cube of steel below."""
    payload, force = study.campaign.scenario.payload, study.campaign.measured.wrench[:, :3]
    hook = study.bodies([study.cell.arm.load], study.ghost)[:, 0]
    direction = force / np.linalg.norm(force, axis=1, keepdims=True)
    length, half = 0.2 * study.reach, (payload / STEEL) ** (1 / 3) / 2
    label = f"{payload:g} kg"
    arrow = rr.Arrows3D.from_fields(colors=LOAD, radii=0.01 * study.reach, labels=label)
    stream.log("world/load", arrow, static=True)
    vectors = rr.Arrows3D.columns(origins=hook, vectors=length * direction)
    stream.send_columns("world/load", _times(study), vectors)
    cube = rr.Boxes3D.from_fields(half_sizes=[half] * 3, colors=LOAD, fill_mode=FillMode.Solid)
    stream.log("world/load/weight", cube, static=True)
    centres = rr.Boxes3D.columns(centers=hook + (length + half) * direction)
    stream.send_columns("world/load/weight", _times(study), centres)


def _write_residuals(stream: rr.RecordingStream, study: Study) -> None:
    """Worst marker residual of every run and model, and what noise alone stays below in 95 % of runs."""
    for k, model in enumerate(study.names):
        path, name, colour = f"residual_mm/{study.paths[k]}", f"{model} (mm)", _colour(study, k)
        width, shape = 3.0 if k == study.best else 1.5, MARKERS[k % len(MARKERS)]
        stream.log(path, rr.SeriesLines(colors=colour, widths=width, names=name), static=True)
        stream.log(path, rr.SeriesPoints(colors=colour, markers=shape, names=name), static=True)
        sizes = rr.SeriesPoints.columns(marker_sizes=np.where(study.checked, 5.0, 0.0))
        values = rr.Scalars.columns(scalars=MM * study.residual[k])
        # In one chunk: of two the viewer pairs the rows wrongly on a timeline that is not sorted.
        stream.send_columns(path, _times(study), [*values, *sizes])
    path, name = "residual_mm/noise_p95", "95 % of pure noise (mm)"
    stream.log(path, rr.SeriesLines(colors=NOISE, widths=1.5, names=name), static=True)
    limit = np.full(len(study.rank), MM * noise_limit(study))
    stream.send_columns(path, _times(study), rr.Scalars.columns(scalars=limit))


def _write_histograms(stream: rr.RecordingStream, study: Study) -> None:
    """Residual components of the best models before the normal curve of noise, for each set of runs."""
    for group, runs in zip(SETS, (~study.checked, study.checked), strict=True):
        curve, bars = histograms(study, runs)
        path = f"histogram_um/{group}"
        stream.log(f"{path}/expected_noise", _chart(curve, (*NOISE, 90)), static=True)
        for k, model in zip(study.shown, bars, strict=True):
            stream.log(f"{path}/{study.paths[k]}", _chart(model, _colour(study, k)), static=True)


def _chart(bars: Bars, colour: Colour) -> rr.BarChart:
    widths = np.full(len(bars.at), bars.width)
    return rr.BarChart(bars.counts, color=colour, abscissa=bars.at, widths=widths)


def _blueprint(study: Study) -> rrb.Blueprint:
    """Overview, table, histograms and notes; the reviewer lands on the worst run."""
    overview = rrb.Horizontal(
        rrb.Vertical(
            _world_view(study),
            rrb.TextDocumentView(origin="this_run", name="This run"),
            row_shares=[5, 1],
        ),
        rrb.Vertical(
            rrb.TextDocumentView(origin="summary", name="Summary"),
            _residual_view(study),
            row_shares=[13, 8],
        ),
        column_shares=[11, 10],
        name="Overview",
    )
    what = "residual components (um); grey: noise alone"
    charts = [
        rrb.BarChartView(origin=f"histogram_um/{group}", name=f"{group.capitalize()} runs, {what}")
        for group in SETS
    ]
    return rrb.Blueprint(
        rrb.Tabs(
            overview,
            rrb.TextDocumentView(origin="table", name="Table"),
            rrb.Horizontal(*charts, name="Histogram"),
            rrb.TextDocumentView(origin="log", name="Notes"),
            active_tab=0,
        ),
        rrb.TimePanel(timeline=TIMELINES[0], state="collapsed", play_state="paused"),
        auto_views=False,
        collapse_panels=True,
    )


def _world_view(study: Study) -> rrb.Spatial3DView:
    """The arm; of the markers, only the best model of each method is visible at first."""
    M, (eye, target) = study.magnification, camera(study)
    hidden: dict[str | rr.datatypes.EntityPath, Any] = {
        f"/world/markers/{what}_{name}": rrb.EntityBehavior(visible=False)
        for k, name in enumerate(study.paths)
        if k not in study.shown
        for what in ("predicted", "residual")
    }
    return rrb.Spatial3DView(
        origin="world",
        name=f"Arm (m): deflection x {M:g}, residual arrows x {M * RESIDUAL_FACTOR:g}",
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=eye, look_target=target, eye_up=(0, 0, 1)
        ),
        overrides=hidden,
    )


def _residual_view(study: Study) -> rrb.TimeSeriesView:
    """Zoomed on the best model of each method; the title says how far the others go."""
    top = MM * max(2 * study.residual[list(study.shown)].max(), 1.2 * noise_limit(study))
    largest = MM * study.residual.max(axis=1)
    names = [name for name, mm in zip(study.names, largest, strict=True) if mm > top]
    beyond = f"; {', '.join(names)} beyond, up to {largest.max():.1f} mm" if names else ""
    return rrb.TimeSeriesView(
        origin="residual_mm",
        name=f"Worst marker residual of each run (mm), markers: check runs{beyond}",
        axis_y=rrb.ScalarAxis(range=(0.0, float(top))),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )
