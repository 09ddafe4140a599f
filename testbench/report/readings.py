"""Readings: which column of a file is which, its runs on the arm, and the tables of a calibration."""

import re
from collections.abc import Iterator, Sequence

import numpy as np

from testbench.data.dataset import Dataset, select_rows
from testbench.errors import Array, Ids, some_of
from testbench.identify.absolute.align import deviation_from_stated
from testbench.identify.base_frame import RegisteredDataset
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.report import scene as draw
from testbench.report.colours import GCO, GREY, MEASURED, NOMINAL, SERIES, Look
from testbench.report.markdown import Markdown, capital, ended
from testbench.report.markdown import counted as with_noun
from testbench.report.report import Report, bullets, say
from testbench.report.scene import loads, read_along, trackers
from testbench.report.schema import NUMBER, Table, TableColumn, columns, plain, show, written_out
from testbench.report.table import Row
from testbench.workflows import calibration_numbers as counted
from testbench.workflows.absolute import Calibrated
from testbench.workflows.cell import Cell
from testbench.workflows.read_runs import farthest_off, nominal_targets, registration_notes, shown_runs
from testbench.workflows.rows import MM, UM

COLUMNS = (
    *columns("quantity file_columns"),
    TableColumn("unit", "unit in the file"),
    *columns("values"),
    TableColumn("rows", "rows with a value"),
)
SHARE = 0.15  #: Length of deflections over the reach [1].
FACE = 0.05  #: Half a side of a face at least, over the reach [1]; it holds all of its touches.
ARROW_LENGTH, BENT = 0.3, 0.12  #: Length of most arrows and of most sags over the reach [1].
NOMINAL_ARM, CALIBRATED_ARM = "nominal arm", "calibrated arm"
LOOKS = {NOMINAL_ARM: Look(NOMINAL, 1, prior=True), CALIBRATED_ARM: Look(GCO, 0, prior=True)}


def written(row: Row) -> str:
    """Write the values of a column for people: lengths below 1 mm in um."""

    def length(number: re.Match[str]) -> str:
        metres = float(number[0])
        return f"{UM * metres:g} um" if 0 < abs(metres) < 1e-3 else plain(number[0])

    return NUMBER.sub(length, str(row["values"])) if row.unit == "m" else written_out(str(row["values"]))


def column_lines(rows: Sequence[Row]) -> list[str]:
    """Lay out columns of a file below one another, of any width."""
    table = [
        [column.heading for column in COLUMNS],
        *([row[column.key] for column in COLUMNS] for row in rows),
    ]
    widths = [2 + max(map(len, cells)) for cells in zip(*table, strict=True)]
    return ["".join(map(str.ljust, cells, widths)).rstrip() for cells in table]


def file_lines(f: Row, more: Sequence[str] = ()) -> list[str]:
    """List columns, numbers and notes of the file, for a terminal.

    Args:
        f: Numbers of the file.
        more: Other notes.

    Returns:
        Lines.
    """
    notes = [f"- {note}" for note in (*f.notes, *more)]
    return ["", *column_lines(f.columns), "", *(f"{what}: {value}" for what, value in _others(f)), *notes]


def _others(f: Row) -> Iterator[tuple[str, str]]:
    """Numbers of the file and its runs, with their units."""
    counts = zip(("row", "run", "pose", "station"), (f.rows, f.runs, f.poses, f.stations), strict=True)
    yield "size", ", ".join(with_noun(n, what) for what, n in counts)
    yield "markers", some_of(f.markers)
    yield "lost targets", f"{len(f.lost)} of {f.targets}" + (f": {some_of(f.lost)}" if f.lost else "")
    if f.without:
        yield "markers that no instrument reads", some_of(f.without)
    yield "loads", some_of(f.loads, "; ")
    yield "standard deviation (sigma) of a reading along an axis, um", show(f.sigma_um, "g")
    yield "columns not read", some_of(f.ignored)
    if f.farthest:
        yield "largest deflection, mm", f"{f.deflection_mm.most:.3f}, {f.farthest}"
    if f.get("away"):
        away = f"{f.away.distance_mm:.3f}, {f.away.target}"
        yield "largest distance of an unloaded reading from its place on the undeflected arm, mm", away
    if f.get("scale") is not None:
        yield "measured deflections divided by those computed from the arm's folder", f"{f.scale:.2f}"


def report(row: Row, registered: RegisteredDataset) -> Report:
    """Report a file of measured runs.

    Args:
        row: What is in it, with its `dataset`, `doubts` and `scale`.
        registered: The runs in the base's frame.

    Returns:
        The report.
    """
    f = Row(row, arm=registered.vjm.arm.name, frame=registered.frame, away=farthest_off(registered))
    others = [Row(what=what, value=value) for what, value in _others(f)]
    tables = {"columns": Table(COLUMNS, f.columns, "Which column is which quantity")}
    tables["numbers"] = Table(columns("what value"), others, "The runs")
    notes = [ended(capital(note)) for note in (*f.notes, *registration_notes(registered))]
    return Report(
        scenario="data_check",
        question=say("How was {dataset} read?", f),
        title=say("{dataset}, read as runs of {arm}", f),
        answer=say(
            "{runs:counted run} in {poses:counted pose}: the load moves the targets by "
            "{deflection_mm.least:.3f} to "
            "{deflection_mm.most:.3f} mm, median {deflection_mm.median:.3f} mm. Warnings: {count}.",
            f,
            count=len(f.doubts),
        ),
        claims=[say("**Warning**: {text}", text=ended(text)) for text in f.doubts],
        numbers=f,
        tables=tables,
        body=[*tables, Markdown("## How the runs were read"), bullets(notes)],
    )


def draw_runs(cell: Cell, registered: RegisteredDataset) -> draw.PageContent:
    """Draw the arm run by run, its targets as read and as they should be.

    Args:
        cell: The arm with its model and its truth.
        registered: The runs in the base's frame.

    Returns:
        The content.
    """
    data = registered.data
    hidden = np.where(data.is_measured, 0.0, np.nan)
    moved = MM * np.linalg.norm(data.deflection, axis=2) + hidden
    away = MM * np.linalg.norm(data.before - nominal_targets(registered), axis=2) + hidden
    away[data.is_line_reading] = np.nan  # a reading along a line is no place
    some = draw.largest_and_even(
        np.nan_to_num(moved).max(axis=1), np.flatnonzero(data.is_measured.any(axis=1))
    )
    if not len(some):
        return draw.PageContent()
    M = draw.arrow_scale(data.deflection[some] + hidden[some][..., None], SHARE * cell.vjm.reach)
    labels, note = [str(data.run_id[k]) for k in some], draw.of_all(len(some), data.n_runs, "runs")
    looks = [Look(SERIES[k % len(SERIES)], k, prior=True) for k in range(len(data.markers))]
    lines = (
        (title, [draw.ModelLine(*own) for own in zip(data.markers, looks, mm[some].T, strict=True)])
        for title, mm in (
            ("How far loads moved each target (mm)", moved),
            ("Distance of the unloaded reading from the arm without sag (mm)", away),
        )
    )
    read = (
        (title, [line for line in model_lines if np.isfinite(line.values).any()])
        for title, model_lines in lines
    )
    charts = [
        draw.RunChart(title, 0, "run", labels, model_lines, note=note, leads=False)
        for title, model_lines in read
        if model_lines
    ]
    title = f"Deflections x {M:g}."
    return draw.PageContent(scene=draw.Scene(cell, title, [_runs(cell, registered, some, M)]), runs=charts)


def _runs(cell: Cell, registered: RegisteredDataset, some: Ids, M: float) -> draw.PoseGroup:
    """The arm in its runs, its targets where they should be, were read, and went under load."""
    data = registered.data
    registration = registered.registration
    row = shown_runs(registered, some)
    tool = np.broadcast_to(row.tool, row.nominal.shape)
    layers = [
        draw.Layer("targets of the arm without sag", NOMINAL, "dots", row.nominal),
        draw.Layer("from the tool", NOMINAL, "lines", tool, row.nominal),
        draw.Layer("read unloaded", MEASURED, "dots", row.before),
        draw.Layer("deflection", MEASURED, "arrows", row.before, row.before + M * data.deflection[some]),
        *loads(row.hook[:, 0], data.wrench[some, :3], cell.vjm.reach),
        *read_along(select_rows(data, some), row.tool[:, 0], cell.vjm.reach),
    ]
    if registered.frame == "tracker" and registration is not None:
        stands = np.array([-frame.rotation.T @ frame.translation for frame in registration.frames.values()])
        layers.append(trackers(stands, [f"tracker {k + 1}" for k in range(len(stands))]))
    return draw.PoseGroup(
        name="Runs",
        names=[
            f"Run {run}, pose {pose}" for run, pose in zip(data.run_id[some], data.pose_id[some], strict=True)
        ],
        words=[_words(cell, data, int(k)) for k in some],
        rigid=rigid_frames(cell.room, data.q[some]),
        bent=None,
        layers=layers,
        first=int(np.nan_to_num(np.linalg.norm(row.before - row.nominal, axis=2)).max(axis=1).argmax()),
    )


def _words(cell: Cell, data: Dataset, k: int) -> str:
    """What the page says of a run that it shows."""
    sizes, there = MM * np.linalg.norm(data.deflection[k], axis=1), data.is_measured[k]
    each = zip(data.markers, sizes, there, there | data.is_lost[k], strict=True)
    moved = [f"{name} {f'moves {mm:.3f} mm' if seen else 'lost'}" for name, mm, seen, meant in each if meant]
    force = float(np.linalg.norm(data.wrench[k, :3]))
    return f"{force:.5g} N: {', '.join(moved)}. Joints at {cell.arm.pose_text(data.q[k])}."


def draw_calibration(cell: Cell, calibrated: Calibrated, left: counted.RemainingErrors) -> draw.PageContent:
    """Draw the readings on the arm: from where the arm should have its targets to where they were read.

    Args:
        cell: The arm with its model and its truth.
        calibrated: The calibration.
        left: Errors that remain.

    Returns:
        The content.
    """
    known = np.flatnonzero((size := counted.largest_remaining_error(calibrated, left)) >= 0)
    rows, reach = counted.rows_of(calibrated, left, draw.largest_and_even(size, known)), cell.vjm.reach
    sizes = [MM * np.nanmax(np.linalg.norm(x, axis=2), axis=1) for x in (rows.before, rows.after)]
    marks = [draw.ModelLine(name, look, mm) for (name, look), mm in zip(LOOKS.items(), sizes, strict=True)]
    A = draw.arrow_scale(rows.before, ARROW_LENGTH * reach)
    straight, soft = rigid_frames(cell.room, rows.q), bool(rows.sag.any())
    moved = elastic_frames(cell.plant, rows.q, rows.sag).positions - straight.positions
    M = draw.arrow_scale(moved[:, -1], BENT * reach)
    arrows = [
        draw.Layer(f"error of the {name}", look.colour, "arrows", rows.read - A * error, rows.read)
        for (name, look), error in zip(LOOKS.items(), (rows.before, rows.after), strict=True)
    ]
    group = draw.PoseGroup(
        name="Readings",
        names=[f"{name}, row {row}" for name, row in zip(rows.name, rows.row, strict=True)],
        words=[
            f"{b:.3f} mm from the nominal arm, {a:.3f} mm from the calibrated arm. "
            f"Joints at {cell.arm.pose_text(q)}."
            for b, a, q in zip(*sizes, rows.q, strict=True)
        ],
        rigid=straight,
        bent=elastic_frames(cell.plant, rows.q, M * rows.sag) if soft else None,
        layers=[
            *arrows,
            draw.Layer("target as read", MEASURED, "dots", rows.read),
            *_read_from(calibrated, rows),
        ],
        first=int(np.argmax(sizes[1])),
    )
    title = f"Arrows from the predicted target to the reading x {A:g}."
    title += f" Sag of the calibrated arm x {M:g}." if soft else ""
    labels, note = [str(k) for k in rows.row], draw.of_all(len(rows.q), len(known), "poses")
    chart = draw.RunChart("Error in each row (mm)", 0, "row of the file", labels, marks, note=note)
    errors = draw.PlaceMap("Distance of reading and arm, worst target (mm)", 0, rows.tool, marks)
    return draw.PageContent(draw.Scene(cell, title, [group]), errors, [chart])


def _read_from(calibrated: Calibrated, rows: Row) -> list[draw.Layer]:
    """Draw plane faces and fixed points where they were found, and lines from these points to the targets."""
    state, reach = calibrated.calibration.state, calibrated.calibration.state.vjm.reach
    plane_faces: dict[object, tuple[str, Array, Array]] = {}
    points: dict[object, tuple[str, Array]] = {}
    start, half = np.full_like(rows.read, np.nan), FACE * reach
    for series in calibrated.calibration.series:
        if series.distance is None:
            continue
        frame, own = state.frame(series), rows.name == series.name
        _, _, found = deviation_from_stated(series, frame)
        place = series.frame, series.fixed_point, series.plane_normal
        if series.plane_normal is None:
            points.setdefault(place, (series.name, found))
            start[own] = np.where(np.isfinite(rows.read[own]), found, np.nan)
        else:
            normal = frame.rotation.T @ series.plane_normal
            plane_faces.setdefault(place, (series.name, found, normal))
            off = rows.read[own] - found
            across = np.linalg.norm(off - (off @ normal)[..., None] * normal, axis=-1)
            half = max(half, float(np.max(across, where=np.isfinite(across), initial=0.0)))
    layers = []
    if plane_faces:
        names, at, normals = zip(*plane_faces.values(), strict=True)
        layers.append(draw.faces(np.array(at), np.array(normals), half, _short_names(names)))
    if points:
        names, at = zip(*points.values(), strict=True)
        labels = _short_names(names)
        layers.append(draw.Layer("fixed points", MEASURED, "dots", np.array([at]), labels=labels))
        layers.append(draw.Layer("distances", MEASURED, "lines", start, rows.read))
    return layers


def _short_names(names: Sequence[str]) -> list[str]:
    """Shorten names of series to their last two words, such as "plane 2", if these differ."""
    short = [" ".join(name.split()[-2:]) for name in names]
    return short if len({*short}) == len(names) else list(names)


CALIBRATION_TABLES = {
    "steps": (
        "Kinds of error tried, and the held-out error of the calibrated arm with each",
        "tried verdict after_mm series_after_mm",
    ),
    "errors": ("Fitted readings", "what error.mean_mm error.rms_mm error.p95_mm error.max_mm"),
    "series": ("Series", "series after.n before.mean_mm after.mean_mm after.max_mm"),
    "values": ("Compliances and geometry", "what value half_95 unit folder"),
    "numbers": ("Other numbers", "what value"),
    "spectrum": (
        "Periodic errors of the joints",
        "joint rms_urad largest.order largest.amplitude_urad largest.deviation_urad significant",
    ),
    "pattern": ("Periodic error that joints share", "joint turn_deg mirrored"),
    "ranges": ("Joint ranges with the largest errors after calibration", "what rms_mm"),
    "outliers": ("Readings with little weight", "series row marker error_mm pull"),
}
"""Titles and columns of the tables of a calibration."""


def calibration_tables(f: Row) -> dict[str, Table]:
    """Tabulate a calibration: errors that were tried and remain, series, compliances, periodic errors.

    Args:
        f: Its numbers.

    Returns:
        The tables, by name.
    """
    start = {"name": "geometry", "kept": True}
    first = [Row(r, **start, after_mm=r.before_mm, series_after_mm=r.series_before_mm) for r in f.steps[:1]]
    tried = [Row(row, tried=row.name, verdict="kept" if row.kept else "dropped") for row in first + f.steps]
    far = sorted((row for row in f.places if row.n), key=lambda row: -float(row.after_mm))[:5]
    rows = {
        "steps": tried,
        "errors": [
            Row(what=w, error=f[k]) for w, k in zip(LOOKS, ("total_before", "total_after"), strict=True)
        ],
        "series": f.series,
        "values": [Row(row, what=row.name) for row in (*f.compliances, *f.geometry)],
        "numbers": [Row(what=name, value=own) for name, own in _single_numbers(f) if own is not None],
        "spectrum": f.spectrum,
        "pattern": f.pattern,
        "ranges": [Row(what=counted.range_words(row), rms_mm=row.after_mm) for row in far],
        "outliers": f.outliers,
    }
    looks = {
        "steps": {row.tried: Look(GCO if row.kept else GREY, 0, prior=row.kept) for row in tried},
        "errors": LOOKS,
    }
    heads = {"steps": "after_mm", "series": "after.mean_mm"}
    shown = {name: keys for name, (_, keys) in CALIBRATION_TABLES.items()}
    if all(row.series_after_mm is None for row in f.steps):  # no whole series was held out
        shown["steps"] = shown["steps"].removesuffix(" series_after_mm")
    return {
        name: Table(
            columns(shown[name]),
            rows[name],
            title,
            headline=heads.get(name, ""),
            looks=looks.get(name, {}),
            stepwise=name == "steps",
        )
        for name, (title, _) in CALIBRATION_TABLES.items()
    }


def _single_numbers(f: Row) -> Iterator[tuple[str, object]]:
    """Numbers that stand in no other table, with their units."""
    yield "solver", f"{f.program.method}: {f.program.status}" if f.program else "the arm is rigid"
    yield "smallest eigenvalue of the compliances, SI", min((row.smallest for row in f.blocks), default=None)
    yield "stated noise of a reading along an axis, um", f.noise.sigma_um
    yield "error of the model at a position, without noise, um", f.noise.open_position_um
    yield "error of the model at an orientation, without noise, urad", f.noise.open_rotation_urad or None
    yield "scatter of the readings divided by noise and model error together", f.noise.position_factor
    yield "positions with less weight, as likely outliers, % (0.7 % expected)", f.less_pull_percent
    if f.more:
        yield "expected error over the workspace now, mm", f.more.now_mm
        yield (
            f"expected error over the workspace after {f.more.poses} more planned poses, mm",
            f.more.after_mm,
        )
