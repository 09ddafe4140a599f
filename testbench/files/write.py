"""Writers of runs, absolute readings and corrected programs as CSV, in the columns that `names` declares.

A row is one marker of one run, one target of one reading, or one point. Numbers are written in full, so that
reading them back gives the same bits; a blank cell is a missing number.
"""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset, Series
from testbench.errors import Array, BenchError, Ids, InputError, Mask, check_array, check_type, some_of
from testbench.files.columns import Columns, load_point, same_poses
from testbench.files.names import ENTRIES, LOADING, WHEN, What, columns_of, torque_columns
from testbench.files.program import Program
from testbench.files.read_pairs import MIN_DEVIATIONS
from testbench.files.read_series import ALONE
from testbench.files.table import as_cell
from testbench.model.kinematics import build_vjm
from testbench.model.vjm import marker_positions, tool_points
from testbench.runs.whole import write_whole

Table = dict[str, Array | Ids | list[str]]
"""Numbers or texts of every column."""
Block = tuple[Iterable[str], Array | Ids | None]
"""Columns and their numbers, (rows, columns), a row for as many points as follow each other; None for no
columns."""
DECIMALS = 12  #: Decimals of numbers that were made from vectors [m]: rounding errors are left out.


def write_csv(data: Dataset, arm: Arm | tuple[str, ...], path: str | Path) -> None:
    """Write the dataset; an existing file is replaced only by a whole one.

    run, pose: integers. marker: its name in the arm. JOINT_rad: joint angle, JOINT_m of a slide. force_*_N,
    moment_*_Nm: load, world axes. point_*_m: where it acts, tool's frame. before_*_m, after_*_m: readings,
    world axes. sigma_m: standard deviation of one reading along one axis, the same in all rows.

    Where orientations were read: rotation_before_*_rad, rotation_after_*_rad (rotation vectors, world axes,
    the same for every marker of a run) and sigma_rad. Where every reading has a covariance of its own:
    deflection_cov_*_m2, of both readings together, world axes; a lost target leaves them and its readings
    empty. The set-up of the tracker stands in station, an integer, where there are several; readings are then
    in its frame. loading, on or off, where some loads were taken off before the unloaded reading.

    Where a gauge read a travel: travel_before_m, travel_after_m, direction_x, _y, _z, world axes, tilt_rad.
    Where a distance was read: distance_before_m, distance_after_m, fixed_*_m, world axes, fixed_sigma_m.
    Then sigma_m is that of each reading, and before_*_m and after_*_m are empty.

    Args:
        data: The runs.
        arm: The arm that was measured, or the names of its hinges: they head the columns.
        path: The file.

    Raises:
        BenchError: When data is no Dataset, or the names are not as many as the joint angles.
        InputError: When the file cannot be written.
    """
    check_type(data, Dataset, "data")
    write_whole(csv_text(data, arm), Path(path))


def csv_text(data: Dataset, arm: Arm | tuple[str, ...]) -> str:
    """Write a dataset as the text of `write_csv`.

    Args:
        data: The runs.
        arm: The arm, or the names of its joints.

    Returns:
        The text.
    """
    own = columns(data, arm)
    return _text(own, _rows(own.values()))


def columns(data: Dataset, arm: Arm | tuple[str, ...]) -> Table:
    """Make the columns of `write_csv`, one cell per point, NaN for lost readings.

    Args:
        data: The runs.
        arm: The arm, or the names of its joints.

    Returns:
        Columns by name.
    """
    joints, q = [f"{name}_rad" for name in arm] if isinstance(arm, tuple) else [], data.q
    if isinstance(arm, Arm):
        joints = [joint.file_column for joint in arm.file_joints]
        q = arm.to_file_joints(q) if q.shape[1] == arm.n_joints else q
    if len(joints) != q.shape[1]:
        raise BenchError(f"joints: expected {q.shape[1]} names, got {some_of(joints)}")
    n = data.n_points
    lost = ~data.is_measured.reshape(-1, 1)
    turned = data.rotation_before is not None
    blocks, lines = _conditions(joints, q, data), data.is_line_reading.reshape(-1, 1)
    for when, places in zip(WHEN, (data.before, data.after), strict=True):
        if not lines.all():
            blocks.append(
                (columns_of("reading", when), np.where(lost | lines, np.nan, places.reshape(-1, 3)))
            )
    sigma = np.full(n, data.sigma)
    if data.line_direction is not None:
        blocks += _along_lines(data, arm)
        own = np.sqrt(
            np.trace(data.covariance, axis1=2, axis2=3) / np.where(data.is_line_reading, 2, 6)
        ).ravel()
        sigma = np.where(lost[:, 0], sigma, own)
    blocks.append((["sigma_m"], sigma))
    for when, turns in zip(WHEN, (data.rotation_before, data.rotation_after), strict=True):
        blocks.append((columns_of("rotation", when), turns))
    blocks.append((["sigma_rad"], np.full(n, data.sigma_rotation) if turned else None))
    if data.precision is not None and not _lines_and_sigma(data):
        C = _entries(data.covariance.reshape(-1, 3, 3))
        blocks.append((columns_of("covariance"), np.where(lost | lines, np.nan, C)))
    found: Table = dict(_repeated(n, [(["run"], data.run_id), (["pose"], data.pose_id)]))
    found["marker"] = list(data.markers) * data.n_runs
    found |= dict(_repeated(n, [*blocks, (["station"], data.station)]))
    if data.unloaded_after_load is not None:
        found["loading"] = [
            LOADING[off] for off in np.repeat(data.unloaded_after_load, len(data.markers)).tolist()
        ]
    return found


def _lines_and_sigma(data: Dataset) -> bool:
    """Tell whether positions beside readings along lines have equal noise along every axis."""
    positions, C = data.is_measured & ~data.is_line_reading, data.covariance
    even = np.trace(C, axis1=2, axis2=3)[..., None, None] / 3 * np.eye(3)
    return data.line_direction is not None and bool(
        np.allclose(C[positions], even[positions], rtol=1e-12, atol=0)
    )


def _along_lines(data: Dataset, arm: Arm | tuple[str, ...]) -> list[Block]:
    """List the columns of travels and distances; NaN for other readings."""
    assert data.line_direction is not None
    assert data.line_direction_deviation is not None
    assert data.line_length is not None
    if data.tilt_error is not None:
        raise BenchError("dataset: expected the stated directions, got those of the loaded arm")
    u, seen = data.line_direction, data.is_measured.reshape(-1, 1)
    lines = u.any(axis=2).reshape(-1, 1)
    gauge, meter = (
        lines & (data.line_length.reshape(-1, 1) == 0),
        lines & (data.line_length.reshape(-1, 1) > 0),
    )
    numbers = [
        np.where(seen, (u * own).sum(axis=2).reshape(-1, 1).round(DECIMALS), np.nan)
        for own in (data.before, data.after)
    ]
    blocks: list[Block] = []
    if gauge.any():
        names = [f"travel_{when}_m" for when in WHEN]
        blocks += [([name], np.where(gauge, own, np.nan)) for name, own in zip(names, numbers, strict=True)]
        blocks.append((columns_of("direction"), np.where(gauge, u.reshape(-1, 3), np.nan)))
        blocks.append((["tilt_rad"], np.where(gauge, data.line_direction_deviation.reshape(-1, 1), np.nan)))
    if meter.any():
        if not isinstance(arm, Arm):
            raise BenchError("distances: expected the arm, to write the fixed points")
        vjm, reach = build_vjm(arm), data.line_length[..., None]
        fixed = (tool_points(vjm, data.q, marker_positions(vjm, data.markers)) - reach * u).round(
            DECIMALS
        ) + 0.0
        names = [f"distance_{when}_m" for when in WHEN]
        blocks += [([name], np.where(meter, own, np.nan)) for name, own in zip(names, numbers, strict=True)]
        blocks.append((columns_of("fixed"), np.where(meter, fixed.reshape(-1, 3), np.nan)))
        blocks.append(
            (
                ["fixed_sigma_m"],
                np.where(meter, (data.line_direction_deviation * data.line_length).reshape(-1, 1), np.nan),
            )
        )
    return blocks


def write_series(path: str | Path, arm: Arm, series: Series | Sequence[Series]) -> None:
    """Write one or several series; an existing file is replaced only by a complete one.

    Columns whose value the reader assumes by default are left out: no load, the arm's load point, one marker,
    and names that are the file's. Numbers are read back bit by bit, except orientations (1e-15).

    Args:
        path: The file.
        arm: The arm that was measured.
        series: Series with the same targets and the same kinds of readings.

    Raises:
        BenchError: If series differ in their columns, or a target is not the arm's.
        InputError: If the file cannot be written.
    """
    every = [series] if isinstance(series, Series) else series
    write_whole(series_text(arm, every, Path(path).stem), Path(path))


def series_text(arm: Arm, series: Sequence[Series], stem: str) -> str:
    """Write series as the text of `write_series`.

    Args:
        arm: The arm that was measured.
        series: The series.
        stem: Name of the file without its ending; names that begin with it are shortened.

    Returns:
        The text.

    Raises:
        BenchError: If series differ in their columns, or do not fit the arm.
    """
    for s in series:
        if s.q.shape[1] != arm.n_joints:
            raise BenchError(f"joints: expected {arm.n_joints} of {arm.name}, got {s.q.shape[1]}")
        if s.markers != series[0].markers:
            wanted, got = some_of(series[0].markers), some_of(s.markers)
            raise BenchError(f"markers: expected {wanted} in all series of a file, got {got}")
    silent, scatter = _silent(arm, series, stem), _scatter_columns(series)
    turned = next((s.sigma_rotation for s in series if s.sigma_rotation), None)
    if turned:  # one without orientations among others that have them: all were lost
        none = [np.full((s.n_rows, 3, 3), np.nan) for s in series]
        series = [
            s if s.rotation is not None else replace(s, rotation=own, sigma_rotation=turned)
            for s, own in zip(series, none, strict=True)
        ]
    tables = [_table(arm, s, stem) | _scatter(s, scatter) for s in series]
    if any(list(table) != list(tables[0]) for table in tables):
        raise BenchError("series: expected torques, temperature and time in all series of a file or in none")
    header = [name for name in tables[0] if name not in silent]
    return _text(header, chain.from_iterable(_rows(own[name] for name in header) for own in tables))


def write_program(
    path: str | Path, program: Program, q: Array, more: Mapping[str, Array | Sequence[str]] | None = None
) -> None:
    """Write a program with other joints; an existing file is replaced only by a whole one.

    Columns, their order and units are those of the table that was read; of a program in a robot language
    only the points' names are written. Joints that it lacks follow, in deg and mm, then what the caller adds.
    Numbers are written in full.

    Args:
        path: The file.
        program: As it was read.
        q: The joints of the chain instead, (points, n) [rad, m].
        more: Further columns by their names, numbers or words, (points,) each; NaN is a blank cell.

    Raises:
        BenchError: When program is no Program, or joints or columns are not one a point.
        InputError: When the program has a column of that name, or the file cannot be written.
    """
    check_type(program, Program, "program")
    arm = program.arm
    mark = "."
    header = 1
    q, more = check_array(q, (program.points, arm.n_joints), "q [rad, m]"), more or {}
    names = ["point"]
    cells = [list(map(as_cell, program.labels))]
    units = [""]
    if isinstance(program.content, Columns):
        table = program.content.table
        mark = program.content.mark
        header = program.content.table.header
        names = list(table.names)
        cells = [list(map(as_cell, table.texts(k))) for k in range(len(names))]
        units = [unit.name if unit else "" for unit in table.units]
    for joint, column, own in zip(arm.file_joints, program.joints, arm.to_file_joints(q).T, strict=True):
        if column is None:
            names.append(joint.display_column)
            cells.append(_numbers(joint.display_factor * own, mark=mark))
        else:
            scale = column.unit.scale if column.unit else 1.0
            cells[column.index] = _numbers(own / (column.sign * scale), mark=mark)
    for name, values in more.items():
        if name in names:
            problem = f"there is a column {name!r} already; was the program corrected before?"
            raise InputError(program.path, f"line {header}", problem)
        if len(values) != program.points:
            raise BenchError(f"{name}: expected {program.points} cells, got {len(values)}")
        names.append(name)
        words = not isinstance(values, np.ndarray)
        cells.append(list(map(as_cell, values)) if words else _numbers(np.asarray(values), mark=mark))
    rows = zip(*cells, strict=True)
    below = [units + [""] * (len(names) - len(units))] * any(units)
    write_whole(_text(names, [*below, *rows], ";" if mark == "," else ","), Path(path))


def _text(header: Iterable[str], rows: Iterable[Iterable[str]], delimiter: str = ",") -> str:
    """Write a table as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, delimiter=delimiter, lineterminator="\n")
    writer.writerow(map(as_cell, header))
    writer.writerows(rows)
    return text.getvalue()


def _rows(columns: Iterable[Array | Ids | Sequence[str]]) -> Iterator[tuple[str, ...]]:
    """Format columns, row by row."""
    return zip(
        *(_numbers(own) if isinstance(own, np.ndarray) else map(as_cell, own) for own in columns), strict=True
    )


def _repeated(points: int, blocks: Iterable[Block]) -> Iterator[tuple[str, Array | Ids]]:
    """Repeat the numbers of every run for its points, by column."""
    for names, values in blocks:
        if values is not None:
            rows = np.repeat(values.reshape(len(values), -1), points // max(len(values), 1), axis=0)
            yield from zip(names, rows.T, strict=True)


def _numbers(values: Array | Ids, mark: str = ".") -> list[str]:
    """Format numbers with a decimal mark; NaN is blank."""
    texts = ["" if x != x else repr(x) for x in values.tolist()]
    return texts if mark == "." else [text.replace(".", mark) for text in texts]


def _conditions(joints: Sequence[str], q: Array, own: Dataset | Series) -> list[Block]:
    """List file joints, (rows, m) [rad, m], and load of every run or reading."""
    load = [*columns_of("force"), *columns_of("moment")]
    return [(joints, q), (load, own.wrench), (columns_of("point"), own.point)]


def _entries(C: Array) -> Array:
    """Return the entries of covariances, (rows, 3, 3), that files hold, (rows, 6)."""
    return np.column_stack([C[:, a, b] for a, b in ENTRIES.values()])


def _silent(arm: Arm, series: Sequence[Series], stem: str) -> set[str]:
    """List columns with the values that the reader assumes by default."""
    at, first = load_point(arm), series[0]
    known = arm.markers if len(arm.markers) == 1 else (ALONE,)
    places = [_place(s, stem) for s in series]
    frames = [f"{stem} {place}".strip() for place in places]
    alone = len(series) == 1
    groups = {
        ("pose",): alone and bool((first.pose_id == same_poses(first.q)).all()),
        ("series",): not any(places),
        ("series_frame",): [s.frame for s in series] == frames,
        ("series_target",): all(s.mount == stem for s in series),
        ("marker",): first.markers == known and len(known) == 1,
        tuple(columns_of("force")): not any(s.wrench[:, :3].any() for s in series),
        tuple(columns_of("moment")): not any(s.wrench[:, 3:].any() for s in series),
        tuple(columns_of("point")): all((s.point == at).all() for s in series),
        (*columns_of("direction"), "tilt_rad"): all(s.plane_normal is None for s in series),
        ("zero_sigma_m",): not any(s.distance_offset_sigma for s in series),
    }
    if set(first.markers) - set(arm.markers) and not groups["marker",]:
        raise BenchError(
            f"markers: expected some of {some_of(arm.markers)} of {arm.name}, got {some_of(first.markers)}"
        )
    return {name for names, silent in groups.items() if silent for name in names}


def _place(s: Series, stem: str) -> str:
    """Return the part of a series' name that the file's name does not contain."""
    return "" if s.name == stem else s.name.removeprefix(f"{stem} ")


def _table(arm: Arm, s: Series, stem: str) -> Table:
    """List all columns of a series except its noise, (rows * m) cells each."""
    n = s.n_rows * len(s.markers)
    lost = ~s.is_measured.reshape(-1, 1)
    own: Table = dict(_repeated(n, [(["run"], s.row_id), (["pose"], s.pose_id)]))
    texts = {"series": _place(s, stem) or s.name, "series_frame": s.frame, "series_target": s.mount}
    own |= {name: [text] * n for name, text in texts.items()}
    own["marker"] = list(s.markers) * s.n_rows
    joints = [joint.file_column for joint in arm.file_joints]
    blocks = _conditions(joints, arm.to_file_joints(s.q), s)
    blocks += [(torque_columns(arm), _torques(arm, s)), (["time_s"], s.time)]
    blocks.append((columns_of("rotation"), None if s.rotation is None else _vectors(s, s.rotation)))
    blocks.append((["temperature"], s.temperature))
    if s.distance is None:
        blocks.append((columns_of("reading"), np.where(lost, np.nan, s.position.reshape(-1, 3))))
    else:
        length = np.where(lost, np.nan, s.distance.reshape(-1, 1))
        blocks.append((["distance_m"], length))
        blocks.append((columns_of("fixed"), np.tile(np.array(s.fixed_point), (n, 1))))
        blocks.append((["fixed_sigma_m"], np.full(n, s.fixed_point_sigma)))
        normal = np.full(3, np.nan) if s.plane_normal is None else np.array(s.plane_normal)
        blocks.append((columns_of("direction"), np.tile(normal, (n, 1))))
        blocks.append((["tilt_rad"], np.full(n, np.nan if s.plane_normal is None else s.plane_normal_sigma)))
        blocks.append((["zero_sigma_m"], np.full(n, s.distance_offset_sigma)))
    return own | dict(_repeated(n, blocks))


def _torques(arm: Arm, s: Series) -> Array | None:
    """Convert torques to file joints, (rows, m) [N m, N], the inverse of `beside.read_torques`."""
    if s.torque is None or arm.joint_map is None:
        return s.torque
    return arm.joint_map.to_file_torques(s.torque)


def _vectors(s: Series, R: Array) -> Array:
    """Convert orientations, (rows, 3, 3), to rotation vectors, (rows, 3) [rad]; NaN where lost."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few files need it

    found = np.full((s.n_rows, 3), np.nan)
    if s.is_oriented.any():
        found[s.is_oriented] = Rotation.from_matrix(R[s.is_oriented]).as_rotvec()
    return found


def _covariances(s: Series) -> tuple[Array, Mask]:
    """Return the covariance of every position, (rows * m, 3, 3) [m^2], NaN where lost, and which exist."""
    seen = s.is_measured.reshape(-1)
    C = np.full((len(seen), 3, 3), np.nan)
    C[seen] = (
        s.sigma**2 * np.eye(3) if s.precision is None else np.linalg.inv(s.precision.reshape(-1, 3, 3)[seen])
    )
    return C, seen


def _scatter_columns(series: Sequence[Series]) -> What | None:
    """Choose columns of standard deviations by axis, or of covariances; None if sigma suffices."""
    C = np.concatenate([own[seen] / s.sigma**2 for s in series for own, seen in [_covariances(s)]])
    if np.allclose(C, np.eye(3), rtol=0, atol=1e-12):
        return None
    least = min((MIN_DEVIATIONS[0] / s.sigma) ** 2 for s in series)
    diagonal = (C * np.eye(3) == C).all() and (np.diagonal(C, axis1=1, axis2=2) >= least).all()
    return "deviation" if diagonal else "spread"


def _scatter(s: Series, what: What | None) -> Table:
    """List the noise of a series: one number for all, and one per reading if needed."""
    C, _ = _covariances(s)
    sigmas = zip(("sigma_m", "sigma_rad"), (s.sigma, s.sigma_rotation), strict=True)
    blocks: list[Block] = [([name], np.full(len(C), x)) for name, x in sigmas if x is not None]
    if what is not None:
        deviations = what == "deviation"
        values = np.sqrt(np.diagonal(C, axis1=1, axis2=2)) if deviations else _entries(C)
        blocks.append((columns_of(what), values))
    return dict(_repeated(len(C), blocks))
