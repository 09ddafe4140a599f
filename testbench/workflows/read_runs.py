"""Measured runs for a fit: read, brought into the base's frame, poses that are held back set apart.

Notes on the frames and targets of measured runs, in sentences.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, get_args

import numpy as np
import typer
from pydantic import Field, ValidationError

from testbench.arm.document import StrictModel, first_invalid_value, parse_toml, toml_place
from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset, split_by_pose
from testbench.errors import Array, BenchError, Doubt, Ids, InputError, read_text, shell_word, some_of
from testbench.files.columns import Columns, ReadColumn
from testbench.files.mapping import Map
from testbench.files.names import What
from testbench.files.read_pairs import Export, read_export
from testbench.identify.base_frame import (
    STATION_PREFIX,
    FrameChoice,
    RegisteredDataset,
    register_dataset,
    station_number,
)
from testbench.identify.diagnosis.deflections import LoadedRuns, deflection_scale
from testbench.identify.diagnosis.diagnose import diagnose, explain_unregistered_runs
from testbench.identify.diagnosis.hypotheses import describe
from testbench.identify.diagnosis.kinematics import Submission
from testbench.identify.equations import RUNS_PER_BATCH
from testbench.identify.prior import cad_prior, scale_by_prior
from testbench.identify.registration import Frame, largest_deviation
from testbench.model.load import own_weight_load, read_body_masses
from testbench.model.structure import all153
from testbench.model.vjm import Vjm, evaluate_chain, marker_positions, tool_points, tool_poses
from testbench.runs.interrupt import SESSION
from testbench.runs.rows import Row, finite
from testbench.workflows.cell import Cell
from testbench.workflows.options import ArmName, Load, MapFile, SigmaUm, overload_warnings
from testbench.workflows.rows import MM, UM


@dataclass(frozen=True)
class ReadingOptions:
    """Name measured runs of an arm, and how they are read."""

    arm: ArmName
    dataset: Annotated[Path, typer.Argument(help="Measured runs: CSV, text, or FILE.xlsx#SHEET.")]
    mapping: MapFile = None
    sigma_um: SigmaUm = None
    load: Load = None
    frame: Annotated[
        str, typer.Option(metavar="FRAME", help="Frame of the readings: auto, base, tracker or TOML.")
    ] = "auto"
    new_target: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Target that the arm lacks; repeatable.")
    ] = None

    @property
    def words(self) -> str:
        """Write how runs are read as flags of another command, without what the project file says."""
        load, frame = None if self.load is None else f"{self.load:g}", self.frame
        own = {"map": self.mapping, "sigma_um": self.sigma_um, "load": load}
        own |= {"frame": None if frame == "auto" else frame}
        flags = [(key, value) for key, value in own.items() if value is not None]
        flags += [("new_target", name) for name in self.new_target or ()]
        taken = SESSION.get().taken
        kept = [(key, value) for key, value in flags if {"new_target": "targets"}.get(key, key) not in taken]
        return "".join(f" --{key.replace('_', '-')} {shell_word(Path(str(value)))}" for key, value in kept)


# --- Measured runs for a fit: read, brought into the base's frame, poses that are held back set apart -------

SMALL = 1e-9  #: Rotation that has no axis [deg].


def registration_notes(registered: RegisteredDataset) -> tuple[str, ...]:
    """Write notes on the frames, on how well the readings fit, and on targets taken as found."""
    row = registration_row(registered)
    if row is None:
        return (f"readings are taken to be in the base's frame: {registered.failure}",)
    frames = ["readings are in the base's frame"]
    if registered.frame == "tracker":
        frames = [_frame_note(frame) for frame in row.frames]
    fitted = [row.targets[k] for k in np.flatnonzero(registered.is_fitted_target)]
    fit = _fit_note(row, _sag(registered.vjm, registered.data))
    return (*frames, fit, *map(_target_note, fitted))


def _frame_note(frame: Row) -> str:
    """Where the base is in the frame of a station, and how well that is known."""
    angle = float(np.linalg.norm(frame.rotation_deg))
    axis = (np.array(frame.rotation_deg) / max(angle, SMALL)).round(3) + 0.0  # no -0.000
    about = ", ".join(f"{x:.3f}" for x in axis)
    text = f"{STATION_PREFIX} {frame.station}: base at ({_place(frame)}) mm in the tracker's frame, "
    text += f"turned by {angle:.3f} deg about ({about})"
    if not (frame.position_sd_mm or frame.rotation_sd_deg):
        return text
    where, turned = frame.position_sd_mm, frame.rotation_sd_deg
    return f"{text}. Uncertainty (1 sd) by noise: {where:.2f} mm and {turned:.3f} deg"


def _place(row: Row) -> str:
    return ", ".join(f"{x:.1f}" for x in row.position_mm)


def _fit_note(row: Row, sag: float | None) -> str:
    """How well all readings fit, and how far own weight alone sags the tool, RMS [m], where that is known."""
    text = f"unloaded readings fit the arm's kinematics to {row.rms_mm:.2f} mm RMS"
    if row.wild:
        text += f"; {row.wild} of {row.readings} fit worse and count less"
    size = "" if sag is None else f" ({MM * sag:.2f} mm RMS according to the arm's folder)"
    return (
        f"{text}. Unloaded readings contain the deflection under own weight{size}. Differences between "
        "loaded and unloaded readings do not contain it"
    )


def _target_note(target: Row) -> str:
    """Where a target taken as found is, and how far from where the arm's folder has it."""
    away = target.from_nominal_mm
    new = "new" if away is None else f"{away:.1f} mm from its nominal place"
    return (
        f"target {target.marker} at ({_place(target)}) mm in the tool's frame, {new}. "
        f"Uncertainty (1 sd) by noise: {target.position_sd_mm:.2f} mm"
    )


def _sag(vjm: Vjm, data: Dataset) -> float | None:
    """How far own weight bends the folder's arm at its tool, linear, RMS [m]; None where nobody knows it."""
    try:
        weights = read_body_masses(vjm.arm)
    except InputError:
        return None
    total = 0.0
    for first in range(0, data.n_runs, RUNS_PER_BATCH):
        where = evaluate_chain(vjm, data.q[first : first + RUNS_PER_BATCH])
        moved = np.einsum("xtp,tp->px", where.J_theta[:3], vjm.arm.C_theta @ own_weight_load(where, weights))
        total += float((moved**2).sum())
    return math.sqrt(total / data.n_runs)


MAX_BYTES = 20_000
Metres = Annotated[float, Field(ge=-1000, le=1000)]
Degrees = Annotated[float, Field(ge=-360, le=360)]


class _Frame(StrictModel):
    """The base in the tracker's frame: a reading is R x + position, R = Rz Ry Rx."""

    station: int = 1  #: Identifier of the station.
    position_m: list[Metres] = Field(min_length=3, max_length=3)
    rotation_xyz_deg: list[Degrees] = Field(min_length=3, max_length=3)  #: About the tracker's x, y, then z.


class _File(StrictModel):
    frame: list[_Frame] = Field(min_length=1, max_length=100)


@dataclass(frozen=True)
class MeasuredRuns:
    """Hold a user's runs."""

    name: str  #: Of the file.
    every: Dataset  #: All of them.
    used: Dataset  #: Those to fit.
    check: Dataset | None  #: Those held back; None if there are none.
    notes: tuple[str, ...] = ()  #: What was understood of them.
    registration: Mapping[str, object] | None = None  #: Frames and targets; None where no frame fitted.
    doubts: tuple[Doubt, ...] = ()  #: What may be wrong with them, the likeliest first.
    #: By what factor the deflections exceed those that the arm's folder says [1]; None where nobody looked.
    scale: float | None = None


def files_read(options: ReadingOptions) -> list[Path]:
    """List the files that are read: table, map, frames."""
    return [options.dataset, *([options.mapping] if options.mapping else []), *_frame_files(options.frame)]


def _frame_files(frame: str) -> list[Path]:
    """The file that a choice of frame names, if it names one."""
    return [Path(frame)] if frame.endswith(".toml") else []


def read_export_file(cell: Cell, options: ReadingOptions, mapping: Path | Map | None = None) -> Export:
    """Read runs.

    Args:
        cell: The cell that was measured.
        options: The file, and how it is read.
        mapping: A map beside the one that was asked for.

    Returns:
        The runs and their columns.

    Raises:
        InputError: Names what is wrong with the file or its map.
    """
    sigma = None if options.sigma_um is None else options.sigma_um / UM
    markers = (*cell.arm.markers, *(options.new_target or ()))
    if "" in markers or len(set(markers)) < len(markers):
        new, have = ", ".join(options.new_target or ()), ", ".join(cell.arm.markers)
        raise BenchError(f"--new-target: expected new names, got {new}; {cell.arm.name} has {have}")
    arm = replace(cell.arm, markers=markers)
    export = read_export(options.dataset, arm, mapping or options.mapping, sigma, options.load)
    if not export.data.wrench.any():
        raise InputError(options.dataset, "", "expected at least one load, but all forces and moments are 0")
    return export


def register_export(cell: Cell, export: Export, options: ReadingOptions) -> tuple[Cell, RegisteredDataset]:
    """Bring runs into the base's frame; a flag counts more than the map.

    Args:
        cell: The arm with its model and its truth.
        export: The runs as read.
        options: How they are read.

    Returns:
        The cell with targets where they are, and the runs.
    """
    try:
        return to_base(cell, export.data, _said(export, options))
    except InputError:
        raise
    except BenchError as err:
        doubt = explain_unregistered_runs(cell.vjm, export.data)
        if doubt is None:
            raise
        words = describe(doubt, cell.arm, export.columns.joints).sentence
        raise BenchError(f"{err}; {words}") from err


def diagnose_runs(
    cell: Cell, export: Export, registered: RegisteredDataset, options: ReadingOptions
) -> tuple[tuple[Doubt, ...], float]:
    """Diagnose registered runs of an arm, as its folder has it.

    Args:
        cell: The arm with its model and its truth.
        export: The runs as read.
        registered: The registered runs.
        options: How they are read.

    Returns:
        Doubts, and the factor of the deflections.
    """
    prior = cad_prior(cell.arm)
    try:
        issues = diagnose(
            Submission(cell.vjm, export.data, registered, _said(export, options) != "auto"), prior
        )
        compliance_prior = scale_by_prior(prior, registered.vjm, all153(registered.vjm.arm))
        factor = deflection_scale(LoadedRuns(registered.vjm, compliance_prior, registered.data))
    except BenchError as err:
        raise InputError(options.dataset, "", str(err)) from err
    masses = np.linalg.norm(export.data.wrench[:, :3], axis=1) / GRAVITY
    heavy = (Doubt("payload", words) for words in overload_warnings(cell.arm, masses.tolist()))
    return (*(describe(issue, cell.arm, export.columns.joints) for issue in issues), *heavy), factor


def _said(export: Export, options: ReadingOptions) -> str:
    """The frame that was said, "auto" if none was."""
    frame = export.columns.names.map.frame
    return options.frame if options.frame != "auto" or frame is None else frame


def read_runs(
    cell: Cell, options: ReadingOptions, held: Sequence[int] = (), *, full_pose: bool = False
) -> tuple[Cell, MeasuredRuns]:
    """Read the runs of a cell: those to fit, and those in the poses held back.

    Frames and targets are found from the unloaded readings of all poses, those held back among them.

    Args:
        cell: The arm with its model and its truth.
        options: How they are read.
        held: Poses that are held back.
        full_pose: Whether orientations are required.

    Returns:
        The cell with targets where they are, and the runs.

    Raises:
        InputError: When the file is wrong, or lacks the orientations that were insisted on.
        BenchError: When a pose is not in the data, none is left on one side, no target was read in those held
            back, or a frame cannot be found.
    """
    export = read_export_file(cell, options)
    if full_pose and export.data.rotation_before is None:
        problem = "expected rotation_before_*_rad, rotation_after_*_rad and sigma_rad for the rotation term"
        raise InputError(options.dataset, "header", f"{problem} (--full-pose); it has positions only")
    filed = cell
    cell, registered = register_export(cell, export, options)
    doubts, factor = diagnose_runs(filed, export, registered, options)
    name = options.dataset.name
    notes = (*export.notes, *registration_notes(registered))
    frames = registration_row(registered)
    runs = MeasuredRuns(name, registered.data, registered.data, None, notes, frames, doubts, factor)
    if not held:
        return cell, runs
    try:
        check, used = split_by_pose(registered.data, np.array(held))
    except BenchError as err:
        raise BenchError(f"--check-pose: {err}") from err
    if not check.is_measured.any():
        problem = f"expected readings in pose {some_of(held)}, but every target was lost there"
        raise BenchError(f"--check-pose: {problem}")
    return cell, replace(runs, used=used, check=check)


def to_base(cell: Cell, data: Dataset, frame: str = "auto") -> tuple[Cell, RegisteredDataset]:
    """Bring runs into the base's frame.

    The frame is auto, base, tracker, or the name of a TOML file with the frames.

    Args:
        cell: The arm with its model and its truth.
        data: Measured runs.
        frame: auto, base, tracker, or the name of a TOML file with the frames.

    Returns:
        The cell with targets where they are, and the runs.
    """
    words = get_args(FrameChoice)
    choice: FrameChoice | dict[str, Frame]
    if frame in words:
        choice = next(word for word in words if word == frame)
    elif files := _frame_files(frame):
        to_world = np.asarray(np.linalg.inv(cell.vjm.base_pose), dtype=float)
        choice = {
            f"{STATION_PREFIX} {k}": one.with_base_at(to_world) for k, one in read_frames(files[0]).items()
        }
    else:
        raise BenchError(f"frame: expected {', '.join(words)} or a .toml file, got {frame[:80]!r}")
    registered = register_dataset(cell.vjm, data, choice)
    return replace(cell, vjm=registered.vjm), registered


def read_frames(path: Path) -> dict[int, Frame]:
    """Read bases in the frames of stations, as a user gives them; InputError names the key."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    content = parse_toml(path, read_text(path, MAX_BYTES))
    try:
        given = _File.model_validate(content).frame
    except ValidationError as err:
        keys, _, problem = first_invalid_value(err)
        form = "[[frame]] has position_m and rotation_xyz_deg of the base in the tracker's frame"
        raise InputError(path, toml_place(path, keys), f"{problem}; {form}") from err
    stations = [one.station for one in given]
    if len(set(stations)) < len(stations):
        raise InputError(path, "frame", f"expected every station once, got {stations}")
    turns = [Rotation.from_euler("xyz", one.rotation_xyz_deg, degrees=True).as_matrix() for one in given]
    return {one.station: Frame(R, np.array(one.position_m)) for one, R in zip(given, turns, strict=True)}


def registration_row(registered: RegisteredDataset) -> Row | None:
    """Collect frames and targets, and how well unloaded readings fit them; None if no frame fitted.

    Of a frame the base's position in it, turn as a rotation vector, and largest standard deviations, 0 for
    one that was given; of a target its place in the tool's frame, its distance from where the arm's folder
    has it, None if it has not, and its largest standard deviation.
    """
    registration = registered.registration
    if registration is None:
        return None
    away = MM * np.linalg.norm(registration.targets - registration.nominal_targets, axis=1)
    based = {
        station_number(name): frame.with_base_at(registered.vjm.base_pose)
        for name, frame in registration.frames.items()
    }
    return Row(
        frame=registered.frame,
        frames=[
            Row(
                station=station,
                position_mm=(MM * frame.translation).tolist(),
                rotation_deg=np.degrees(frame.rotation_vector).tolist(),
                position_sd_mm=MM * largest_deviation(frame.covariance[3:, 3:]),
                rotation_sd_deg=math.degrees(frame.rotation_deviation),
            )
            for station, frame in based.items()
        ],
        targets=[
            Row(
                marker=name,
                position_mm=(MM * registration.targets[k]).tolist(),
                from_nominal_mm=finite(away[k]),
                position_sd_mm=MM * float(registration.target_deviations[k].max()),
            )
            for k, name in enumerate(registration.target_names)
        ],
        rms_mm=MM * registration.rms_distance,
        noise_mm=MM * registration.noise,
        readings=len(registration.distances),
        wild=registration.n_downweighted,
    )


# --- Contents of a file of measured runs: columns by quantity, loads, lost targets, how far targets move ----

CALLED: dict[What, str] = {
    "reading": "position",
    "point": "load point",
    "covariance": "covariance",
    "rotation": "orientation",
    "tilt": "uncertainty of the direction",
    "fixed": "fixed point",
    "fixed_sigma": "uncertainty of the fixed point",
    "zero_sigma": "uncertainty of the constant",
}
"""What people call the quantities with another name of theirs."""
LISTED = 4  #: Words of a column that are listed.
ROUNDING = 1e-12  #: Number over the largest of its quantity below which it is a computed zero [1].


def contents(export: Export) -> Row:
    """Collect what is in a file before any frame is found; keys of report.json.

    Args:
        export: The file as it was read.
    """
    data, table = export.data, export.columns.table
    size = np.where(data.is_measured, MM * np.linalg.norm(data.deflection, axis=-1), np.nan)
    known = size[data.is_measured]
    least, median, most = np.quantile(known, [0, 0.5, 1]).tolist() if len(known) else [np.nan] * 3
    downward = (data.wrench[:, [0, 1, 3, 4, 5]] == 0).all() and (data.wrench[:, 2] <= 0).all()
    return Row(
        columns=list(column_rows(export.columns)),
        ignored=export.columns.ignored,
        rows=table.rows,
        runs=data.n_runs,
        poses=len(np.unique(data.pose_id)),
        stations=1 if data.station is None else len(np.unique(data.station)),
        markers=data.markers,
        targets=int((data.is_measured | data.is_lost).sum()),
        lost=[_where(data, i, k) for i, k in np.argwhere(data.is_lost)],
        without=list(_without_instrument(data)),
        loads=_loads(data, hung=bool(downward)),
        deflection_mm=Row(least=least, median=median, most=most),
        farthest=_where(data, *np.argwhere(size == most)[0]) if len(known) else "",
        sigma_um=UM * data.sigma,
        notes=[*table.notes, *export.notes],
    )


def _without_instrument(data: Dataset) -> Iterator[str]:
    """Name the markers that no instrument reads, in any run or in some."""
    without = ~data.is_measured & ~data.is_lost
    never = without.all(axis=0)
    yield from (data.markers[k] for k in np.flatnonzero(never))
    yield from (_where(data, i, k) for i, k in np.argwhere(without & ~never))


def _where(data: Dataset, run: int, marker: int) -> str:
    return f"{data.markers[marker]} in run {data.run_id[run]}"


def _loads(data: Dataset, *, hung: bool) -> list[str]:
    """Loads that differ in their sizes by more than rounding, the smallest first."""
    sizes = np.linalg.norm(data.wrench.reshape(-1, 2, 3), axis=-1).round(6)
    values, counts = np.unique(sizes, axis=0, return_counts=True)
    return [
        f"{force:.5g} N"
        + (f" and {moment:.5g} N m" if moment else "")
        + (f" (the weight of {force / GRAVITY:.5g} kg)" if hung and force else "")
        + f" in {runs:,} run{'' if runs == 1 else 's'}"
        for (force, moment), runs in zip(values.tolist(), counts.tolist(), strict=True)
    ]


def column_rows(found: Columns) -> Iterator[Row]:
    """List the quantities of a file, the axes of a vector in one row.

    Args:
        found: The columns as they were understood.

    Yields:
        Quantity, columns of the file, unit, values as text, and how many rows have one.
    """
    groups: dict[tuple[object, ...], list[ReadColumn]] = {}
    for column in sorted(found.found.values(), key=lambda c: c.index):
        slot = column.slot
        alone = slot.index if slot.what in ("joint", "sigma") else 0
        groups.setdefault((slot.what, slot.marker, slot.when, alone), []).append(column)
    for columns in groups.values():
        slot, names = columns[0].slot, [column.name for column in columns]
        what = CALLED.get(slot.what, slot.what) + (f" {slot.index + 1}" if slot.what == "joint" else "")
        state = {"before": "unloaded", "after": "loaded"}.get(slot.when, slot.when)
        there = np.any([~found.table.blank(column.index) for column in columns], axis=0)
        yield Row(
            quantity=" ".join(filter(None, (what, slot.marker, state))),
            file_columns=", ".join(names) if len(names) <= 2 else f"{names[0]} ... {names[-1]}",
            unit=columns[0].unit.name if columns[0].unit else "",
            values=_values(found, columns),
            rows=str(int(there.sum())),  # a word: there is nothing to draw
        )


def _values(found: Columns, columns: list[ReadColumn]) -> str:
    """The words of a column, or its least and largest number in the column's unit."""
    unit = columns[0].unit
    if unit is None:
        words = list(dict.fromkeys(found.table.texts(columns[0].index)))
        few = ", ".join(word[:20] for word in words[:LISTED])
        return few if len(words) <= LISTED else f"{few} ... ({len(words)})"
    numbers = np.concatenate([found.values(column) / unit.scale for column in columns])
    known = numbers[np.isfinite(numbers)]
    known[np.abs(known) < ROUNDING * np.abs(known).max(initial=0.0)] = 0.0
    ends = dict.fromkeys(f"{x:.5g}" for x in (known.min(), known.max())) if len(known) else ["none"]
    return " to ".join(ends)


def farthest_off(registered: RegisteredDataset) -> Row | None:
    """Find the unloaded reading that fits the arm without sag worst, and how far it is off [mm]."""
    data = registered.data
    placed = data.is_measured & ~data.is_line_reading
    if not placed.any():
        return None
    off = np.where(placed, np.linalg.norm(data.before - nominal_targets(registered), axis=-1), -1.0)
    i, k = np.unravel_index(int(off.argmax()), off.shape)
    return Row(target=_where(data, int(i), int(k)), distance_mm=MM * float(off[i, k]))


def nominal_targets(registered: RegisteredDataset) -> Array:
    """Find the targets of the rigid arm in all runs, (runs, m, 3) [m]."""
    vjm, data = registered.vjm, registered.data
    return tool_points(vjm, data.q, marker_positions(vjm, data.markers))


def shown_runs(registered: RegisteredDataset, some: Ids) -> Row:
    """Find what is drawn of some runs; NaN where a target was lost.

    Args:
        registered: The runs in the base's frame.
        some: Numbers of the runs, (runs,).

    Returns:
        Targets of the rigid arm (`nominal`) and as read unloaded (`before`), (runs, m, 3) [m]; tool position
        `tool` and load point `hook`, (runs, 1, 3) [m].
    """
    data = registered.data
    hidden = np.where(data.is_measured[some], 0.0, np.nan)[..., None]
    position, rotation = tool_poses(registered.vjm, data.q[some])
    return Row(
        nominal=nominal_targets(registered)[some] + hidden,
        before=data.before[some] + hidden,
        tool=position[:, None],
        hook=(position + np.matvec(rotation, data.point[some]))[:, None],
    )
