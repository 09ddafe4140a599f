"""A calibration study as a Rerun recording: a view of the report, never an input. The only importer of rerun."""

import contextlib
import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from scipy import stats
from scipy.spatial.transform import Rotation

from testbench import recording_text as text
from testbench.bench import Campaign, Cell, Result
from testbench.dataset import Ids, Mask
from testbench.errors import Array
from testbench.files import versions
from testbench.plant.shapes import (
    Frames,
    Shape,
    body_names,
    elastic_frames,
    rigid_frames,
    visual_shapes,
)
from testbench.recording_text import MM, UM, Report

APPLICATION = "testbench_calibration_v1"
TIMELINES = ("worst_first", "pose")

NOMINAL, MEASURED, LOAD, NOISE = (86, 180, 233), (213, 94, 0), (204, 121, 167), (127, 127, 127)
ORANGE, GREEN = (230, 159, 0), (0, 158, 115)
"""Roles, Okabe-Ito: sky blue, vermillion, purple, grey; least squares orange, GCO green."""
GHOST = (*MEASURED, 70)

MARKERS = ("circle", "diamond", "square", "up", "cross", "plus", "down", "asterisk")
"""Tell models of one role apart; used again from the start beyond eight models."""

RESIDUAL_FACTOR = 20
"""Residuals are drawn that much larger than deflections: at 50 x an arrow of 1 m is 1 mm."""

STEEL = 7850.0
"""Density [kg/m^3] of the drawn weight, a cube."""

BINS = 25


@dataclass(frozen=True)
class _Study:
    """What is drawn, computed once.

    Attributes:
        report: The numbers.
        cell: The arm.
        campaign: The data.
        results: One a model.
        best: Index of the model that the runs are sorted by.
        shown: Indices of the models whose markers are visible at first: the best of each method.
        residual: Worst marker residual of each run and model, (models, runs) [m].
        checked: Which runs are of the check poses, (runs,).
        rank: Place of each run in worst_first, (runs,).
        rigid: The unloaded arm without any sag.
        ghost: The arm under its load, deflection magnified.
        magnification: Of the deflection [1].
    """

    report: Report
    cell: Cell
    campaign: Campaign
    results: Sequence[Result]
    best: int
    shown: tuple[int, ...]
    residual: Array
    checked: Mask
    rank: Ids
    rigid: Frames
    ghost: Frames
    magnification: float

    @property
    def times(self) -> list[rr.TimeColumn]:
        """Both timelines of data that are in dataset order."""
        worst, pose = TIMELINES
        index = np.arange(len(self.rank))
        return [rr.TimeColumn(worst, sequence=self.rank), rr.TimeColumn(pose, sequence=index)]

    @property
    def size(self) -> float:
        """Length that what is drawn scales with: the reach of the arm in these runs [m]."""
        return float(np.linalg.norm(self.rigid.positions - self.rigid.positions[:, :1], axis=-1).max())

    def bodies(self, names: Sequence[str], frames: Frames) -> Array:
        """Origins of named bodies, (runs, len(names), 3) [m]."""
        known = body_names(self.cell.room)
        return frames.positions[:, [known.index(name) for name in names]]


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
    study = _study(report, cell, campaign, results, magnification)
    with _stream(path, study) as stream:
        _write_properties(stream, study)
        _write_texts(stream, study)
        _write_arm(stream, study)
        _write_markers(stream, study)
        _write_load(stream, study)
        _write_residuals(stream, study)
        _write_histograms(stream, study)


def _study(
    report: Report,
    cell: Cell,
    campaign: Campaign,
    results: Sequence[Result],
    magnification: float,
) -> _Study:
    data = campaign.measured
    rows = report["models"]
    best = rows.index(text.best(rows, "check"))
    methods = {id(text.best(group, "check")) for group in text.by_method(rows) if group}
    residual = np.array([np.linalg.norm(r.residuals, axis=-1).max(axis=1) for r in results])
    rank = np.empty(data.runs, dtype=int)
    rank[np.argsort(-residual[best], kind="stable")] = np.arange(data.runs)
    sag = campaign.after.theta - campaign.before.theta
    return _Study(
        report=report,
        cell=cell,
        campaign=campaign,
        results=results,
        best=best,
        shown=tuple(k for k, row in enumerate(rows) if id(row) in methods),
        residual=residual,
        checked=np.isin(data.pose, campaign.check.pose),
        rank=rank,
        rigid=rigid_frames(cell.room, data.q),
        ghost=elastic_frames(cell.plant, data.q, magnification * sag),
        magnification=magnification,
    )


@contextlib.contextmanager
def _stream(path: Path, study: _Study) -> Iterator[rr.RecordingStream]:
    """A stream into a part file that becomes `path` when all has been written; its footer is always written."""
    part = path.with_name(path.name + ".part")
    strict = rr.strict_mode()
    rr.set_strict_mode(True)  # otherwise a wrong argument only warns, and the data are lost
    scenario = study.campaign.scenario.model_dump_json()
    digest = hashlib.sha256(f"{scenario} {study.campaign.seed}".encode()).hexdigest()[:16]
    try:
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


def _write_properties(stream: rr.RecordingStream, study: _Study) -> None:
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
    stream.send_property("versions", rr.AnyValues(**versions()))


def _write_texts(stream: rr.RecordingStream, study: _Study) -> None:
    report, data = study.report, study.campaign.measured
    names = [r.model.name for r in study.results]
    worst = int(np.argmin(study.rank))
    scales = study.magnification, study.magnification * RESIDUAL_FACTOR
    where = text.where(data, worst, checked=bool(study.checked[worst]))
    documents = {
        "summary": text.summary(report, study.cell.arm.title, study.campaign.scenario, where, scales),
        "table": text.table(data, study.checked, study.rank, names, study.residual),
        "log": text.notes(report),
    }
    for path, document in documents.items():
        stream.log(path, rr.TextDocument(document, media_type="text/markdown"), static=True)
    captions = text.captions(data, study.checked, study.rank, names, study.residual)
    stream.send_columns(
        "this_run",
        study.times,
        rr.TextDocument.columns(text=captions, media_type=["text/markdown"] * len(captions)),
    )


def _write_arm(stream: rr.RecordingStream, study: _Study) -> None:
    """Rigid arm and magnified ghost, body by body; a body that stays where it is has no ghost."""
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    names, shapes = body_names(study.cell.room), visual_shapes(study.cell.room)
    drawn_elsewhere = {study.cell.arm.load, *study.cell.arm.markers}
    for body in sorted({shape.body for shape in shapes}):
        if names[body] in drawn_elsewhere:
            continue
        own = [shape for shape in shapes if shape.body == body]
        for entity, frames, ghost in (("arm", study.rigid, False), ("arm_deflected", study.ghost, True)):
            if ghost and not _moves(study, body):
                continue
            path = rr.new_entity_path(["world", entity, names[body]])
            stream.log(path, *_solids(own, ghost=ghost), static=True)
            turns = Rotation.from_matrix(frames.rotations[:, body]).as_quat()
            columns = rr.Transform3D.columns(translation=frames.positions[:, body], quaternion=turns)
            stream.send_columns(path, study.times, columns)


def _moves(study: _Study, body: int) -> bool:
    """Whether a body's ghost stands off the body far enough not to flicker through its surface."""
    a, b = study.rigid, study.ghost
    shift = np.linalg.norm(b.positions[:, body] - a.positions[:, body], axis=1)
    turn = np.linalg.norm(b.rotations[:, body] - a.rotations[:, body], axis=(1, 2)) / np.sqrt(2)
    return bool((shift + 0.2 * study.size * turn).max() > 0.005 * study.size)


def _solids(shapes: Sequence[Shape], *, ghost: bool) -> list[rr.AsComponents]:
    """One archetype a kind of shape; the arm in shades of grey, for colours are roles."""
    solids: list[rr.AsComponents] = []
    for kinds in (("box",), ("cylinder",), ("capsule",), ("sphere", "ellipsoid"), ("mesh",)):
        own = [shape for shape in shapes if shape.kind in kinds]
        if not own:
            continue
        colours = np.array([GHOST if ghost else _grey(shape.rgba) for shape in own])
        if kinds == ("mesh",):
            solids.append(_mesh(own, colours))
            continue
        size, centre = np.array([s.size for s in own]), np.array([s.position for s in own])
        R = np.array([s.rotation for s in own])
        turns, solid = Rotation.from_matrix(R).as_quat(), rr.components.FillMode.Solid
        look = {"quaternions": turns, "colors": colours, "fill_mode": solid}
        if kinds == ("box",):
            solids.append(rr.Boxes3D(half_sizes=size, centers=centre, **look))
        elif kinds == ("cylinder",):
            length, radius = 2 * size[:, 2], size[:, 0]
            solids.append(rr.Cylinders3D(lengths=length, radii=radius, centers=centre, **look))
        elif kinds == ("capsule",):  # Rerun's capsule starts at its origin
            length, radius, start = 2 * size[:, 2], size[:, 0], centre - R[:, :, 2] * size[:, 2:]
            solids.append(rr.Capsules3D(lengths=length, radii=radius, translations=start, **look))
        else:
            solids.append(rr.Ellipsoids3D(half_sizes=size, centers=centre, **look))
    return solids


def _grey(rgba: Array) -> tuple[int, int, int, int]:
    level = round(255 * (0.35 + 0.45 * float(rgba[:3] @ [0.299, 0.587, 0.114])))
    return level, level, level, 255


def _mesh(shapes: Sequence[Shape], colours: Array) -> rr.Mesh3D:
    """All meshes of a body as one, in the body's axes."""
    vertices, normals, faces, shades, count = [], [], [], [], 0
    for shape, colour in zip(shapes, colours, strict=True):
        mesh = shape.mesh
        assert mesh is not None
        vertices.append(shape.position + mesh.vertices @ shape.rotation.T)
        normals.append(mesh.normals @ shape.rotation.T)
        faces.append(mesh.faces + count)
        shades.append(np.tile(colour, (len(mesh.vertices), 1)))
        count += len(mesh.vertices)
    return rr.Mesh3D(
        vertex_positions=np.concatenate(vertices),
        vertex_normals=np.concatenate(normals),
        triangle_indices=np.concatenate(faces),
        vertex_colors=np.concatenate(shades),
    )


def _colour(study: _Study, k: int) -> tuple[int, int, int]:
    return GREEN if text.is_gco(study.report["models"][k]) else ORANGE


def _write_markers(stream: rr.RecordingStream, study: _Study) -> None:
    """Markers unloaded, as measured and as predicted, with arrows from measured to predicted."""
    data, M, m = study.campaign.measured, study.magnification, len(study.cell.arm.markers)
    nominal, deflection = study.bodies(study.cell.arm.markers, study.rigid), data.deflection
    measured, radius = nominal + M * deflection, 0.012 * study.size
    root = "world/markers"

    def points(name: str, positions: Array, **look: object) -> None:
        stream.log(f"{root}/{name}", rr.Points3D.from_fields(**look), static=True)
        columns = rr.Points3D.columns(positions=positions.reshape(-1, 3))
        stream.send_columns(f"{root}/{name}", study.times, columns.partition([m] * data.runs))

    def arrows(name: str, origins: Array, vectors: Array, labels: Array, **look: object) -> None:
        stream.log(f"{root}/{name}", rr.Arrows3D.from_fields(**look), static=True)
        columns = rr.Arrows3D.columns(
            origins=origins.reshape(-1, 3), vectors=vectors.reshape(-1, 3), labels=labels.ravel()
        )
        stream.send_columns(f"{root}/{name}", study.times, columns.partition([m] * data.runs))

    points("nominal", nominal, colors=NOMINAL, radii=radius, labels=data.markers)
    points("measured", measured, colors=MEASURED, radii=radius)
    arrows(
        "deflection",
        nominal,
        measured - nominal,
        _millimetres(deflection),
        colors=MEASURED,
        radii=0.5 * radius,
        show_labels=False,
    )
    for k, result in enumerate(study.results):
        name = result.model.name.lower()
        colour, slim = _colour(study, k), 0.5 if k == study.best else 0.8  # to see both
        predicted = measured - M * result.residuals
        points(f"predicted_{name}", predicted, colors=colour, radii=0.8 * radius)
        arrows(
            f"residual_{name}",
            measured,
            -M * RESIDUAL_FACTOR * result.residuals,
            _millimetres(result.residuals),
            colors=colour,
            radii=slim * radius,
            show_labels=k == study.best,
        )


def _millimetres(vectors: Array) -> Array:
    lengths = MM * np.linalg.norm(vectors, axis=-1)
    return np.array([f"{mm:.2f} mm" for mm in lengths.ravel()])


def _write_load(stream: rr.RecordingStream, study: _Study) -> None:
    """The weight as an arrow at the load point of the loaded arm, and as a cube of steel."""
    data, payload = study.campaign.measured, study.campaign.scenario.payload
    hook = study.bodies([study.cell.arm.load], study.ghost)[:, 0]
    force = data.wrench[:, :3]
    along = 0.2 * study.size * force / np.linalg.norm(force, axis=1, keepdims=True)
    half = (payload / STEEL) ** (1 / 3) / 2
    look = rr.Arrows3D.from_fields(
        colors=LOAD, radii=0.01 * study.size, labels=f"{payload:g} kg", show_labels=True
    )
    stream.log("world/load", look, static=True)
    stream.send_columns("world/load", study.times, rr.Arrows3D.columns(origins=hook, vectors=along))
    cube = rr.Boxes3D.from_fields(
        half_sizes=[half] * 3, colors=(*LOAD, 255), fill_mode=rr.components.FillMode.Solid
    )
    stream.log("world/load/weight", cube, static=True)
    below = hook + along * (1 + half / np.linalg.norm(along, axis=1, keepdims=True))
    stream.send_columns("world/load/weight", study.times, rr.Boxes3D.columns(centers=below))


def _write_residuals(stream: rr.RecordingStream, study: _Study) -> None:
    """Worst marker residual of every run and model, and what noise alone stays below in 95 % of runs."""
    runs = len(study.rank)
    for k, result in enumerate(study.results):
        path, colour = f"residual_mm/{result.model.name.lower()}", _colour(study, k)
        name = f"{result.model.name} (mm)"
        width = 3.0 if k == study.best else 1.5
        stream.log(path, rr.SeriesLines(colors=colour, widths=width, names=name), static=True)
        stream.log(
            path, rr.SeriesPoints(colors=colour, markers=MARKERS[k % len(MARKERS)], names=name), static=True
        )
        sizes = np.where(study.checked, 5.0, 0.0)
        columns = [
            *rr.Scalars.columns(scalars=MM * study.residual[k]),
            *rr.SeriesPoints.columns(marker_sizes=sizes),
        ]
        stream.send_columns(path, study.times, columns)
    path, limit = "residual_mm/noise_p95", MM * _noise_limit(study)
    name = "95 % of pure noise (mm)"
    stream.log(path, rr.SeriesLines(colors=NOISE, widths=1.5, names=name), static=True)
    stream.send_columns(path, study.times, rr.Scalars.columns(scalars=np.full(runs, limit)))


def _noise_limit(study: _Study) -> float:
    """95th percentile of the largest of m noisy deflections, each of three normal components [m]."""
    data = study.campaign.measured
    share = 0.95 ** (1 / len(data.markers))
    return float(data.sigma * np.sqrt(2 * stats.chi2.ppf(share, 3)))


def _write_histograms(stream: rr.RecordingStream, study: _Study) -> None:
    """Residual components of the best models, side by side in each bin, before the normal curve of noise."""
    pooled = UM * np.array([study.results[k].residuals for k in study.shown])
    edge = 50 * max(1.0, np.ceil(np.abs(pooled).max() / 50))
    bins, wide = np.linspace(-edge, edge, BINS + 1, retstep=True)
    slot = 0.8 * wide / len(pooled)
    fine, narrow = np.linspace(-edge, edge, 8 * BINS + 1, retstep=True)
    density = stats.norm.pdf(fine, scale=UM * study.campaign.measured.sigma * np.sqrt(2))
    for group, runs in (("identification", ~study.checked), ("check", study.checked)):
        root, components = f"histogram_um/{group}", pooled[:, runs].reshape(len(pooled), -1)
        curve = density * components.shape[1] * wide
        chart = rr.BarChart(curve, color=(*NOISE, 90), abscissa=fine, widths=np.full(len(fine), narrow))
        stream.log(f"{root}/expected_noise", chart, static=True)
        for i, (k, values) in enumerate(zip(study.shown, components, strict=True)):
            counts = np.histogram(values, bins)[0].astype(float)
            at = (bins[:-1] + bins[1:]) / 2 + slot * (i - (len(pooled) - 1) / 2)
            chart = rr.BarChart(counts, color=_colour(study, k), abscissa=at, widths=np.full(BINS, slot))
            stream.log(f"{root}/{study.results[k].model.name.lower()}", chart, static=True)


def _blueprint(study: _Study) -> rrb.Blueprint:
    """Overview, table, histogram and notes; the reviewer lands on the worst run."""
    M = study.magnification
    hidden = {
        f"/world/markers/{what}_{result.model.name.lower()}": rrb.EntityBehavior(visible=False)
        for k, result in enumerate(study.results)
        if k not in study.shown
        for what in ("predicted", "residual")
    }
    world = rrb.Spatial3DView(
        origin="world",
        name=f"Arm (m): deflection x {M:g}, residual arrows x {M * RESIDUAL_FACTOR:g}",
        eye_controls=_camera(study),
        overrides=hidden,
    )
    top, largest = 2 * MM * study.residual[list(study.shown)].max(), MM * study.residual.max()
    beyond = f"; others leave the picture, up to {largest:.1f} mm" if largest > top else ""
    plot = rrb.TimeSeriesView(
        origin="residual_mm",
        name=f"Worst marker residual of each run (mm), markers: check runs{beyond}",
        axis_y=rrb.ScalarAxis(range=(0.0, top)),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )
    overview = rrb.Horizontal(
        rrb.Vertical(world, rrb.TextDocumentView(origin="this_run", name="This run"), row_shares=[5, 1]),
        rrb.Vertical(rrb.TextDocumentView(origin="summary", name="Summary"), plot, row_shares=[13, 8]),
        column_shares=[11, 10],
        name="Overview",
    )
    return rrb.Blueprint(
        rrb.Tabs(
            overview,
            rrb.TextDocumentView(origin="table", name="Table"),
            rrb.Horizontal(
                *(
                    rrb.BarChartView(
                        origin=f"histogram_um/{group}",
                        name=f"{group.capitalize()} runs: residual components (um); grey: noise alone",
                    )
                    for group in ("identification", "check")
                ),
                name="Histogram",
            ),
            rrb.TextDocumentView(origin="log", name="Notes"),
            active_tab=0,
        ),
        rrb.TimePanel(timeline=TIMELINES[0], state="collapsed", play_state="paused"),
        auto_views=False,
        collapse_panels=True,
    )


def _camera(study: _Study) -> rrb.EyeControls3D:
    """From the side of the arm and a little ahead, so that arm and ghost of all runs fill the view."""
    corners = np.concatenate([study.rigid.positions, study.ghost.positions]).reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    target = (low + high) / 2
    forward = study.bodies([study.cell.arm.tool], study.rigid)[:, 0, :2].mean(axis=0)
    forward /= max(float(np.linalg.norm(forward)), 1e-9)
    side = np.array([forward[1], -forward[0]])
    eye = np.append(0.9 * side + 0.35 * forward, 0.25)
    distance = 0.72 * float(np.linalg.norm(high - low))
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + distance * eye / np.linalg.norm(eye),
        look_target=target,
        eye_up=(0, 0, 1),
    )
