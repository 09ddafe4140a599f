"""Measured runs as arrays, and their CSV file.

A run is one load in one pose, every marker read before and after loading. In the file a row is one marker of
one run; the unit is in the column's name; numbers are written in full, so that reading gives them back bit
by bit. `columns(...)` is the documented header.
"""

import csv
import io
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from testbench.arm import Arm
from testbench.errors import Array, BenchError, InputError, check_array, read_text

Mask = npt.NDArray[np.bool_]
Ids = npt.NDArray[np.int_]

XYZ = ("x", "y", "z")
MAX_BYTES = 100_000_000


@dataclass(frozen=True)
class Dataset:
    """Deflection measurements.

    Attributes:
        markers: Names of the markers, m of them.
        run: Identifier of every run, (runs,).
        pose: Identifier of the pose of every run, (runs,); repeated runs share it.
        q: Actuated joint angles, (runs, n) [rad].
        wrench: Load, force and moment, world axes, (runs, 6) [N, N m].
        point: Where it acts, in the tool's frame, (runs, 3) [m].
        before: Marker positions read unloaded, world, (runs, m, 3) [m].
        after: Marker positions read loaded, (runs, m, 3) [m].
        sigma: Standard deviation of one position reading along one axis [m].
        rotation_before: Tool orientation read unloaded, rotation vectors, (runs, 3) [rad]; None if not read.
        rotation_after: The same loaded, (runs, 3) [rad].
        sigma_rotation: Standard deviation of one orientation reading about one axis [rad].
    """

    markers: tuple[str, ...]
    run: Ids
    pose: Ids
    q: Array
    wrench: Array
    point: Array
    before: Array
    after: Array
    sigma: float
    rotation_before: Array | None = None
    rotation_after: Array | None = None
    sigma_rotation: float | None = None

    def __post_init__(self) -> None:
        """Check shapes and values at the door.

        Raises:
            BenchError: When an array has the wrong shape or is not finite, an identifier is no integer, a
                marker is named twice or none is, or a sigma is not positive.
        """
        runs, m = len(self.run), len(self.markers)
        for name in ("run", "pose"):
            ids = np.asarray(getattr(self, name))
            if ids.shape != (runs,) or not np.issubdtype(ids.dtype, np.integer):
                raise BenchError(f"{name}: expected {runs} integers, got {ids.dtype} {ids.shape}")
        if m == 0 or len(set(self.markers)) != m:
            raise BenchError(f"markers: expected different names, got {self.markers}")
        check_array(self.q, (runs, None), "q [rad]")
        check_array(self.wrench, (runs, 6), "wrench [N, N m]")
        check_array(self.point, (runs, 3), "point [m]")
        check_array(self.before, (runs, m, 3), "before [m]")
        check_array(self.after, (runs, m, 3), "after [m]")
        if not 0 < self.sigma < np.inf:
            raise BenchError(f"sigma [m]: expected more than 0, got {self.sigma}")
        rotations = (self.rotation_before, self.rotation_after, self.sigma_rotation)
        if any(x is None for x in rotations) != all(x is None for x in rotations):
            raise BenchError("orientations: expected before, after and sigma together, or none")
        if self.sigma_rotation is not None:
            check_array(self.rotation_before, (runs, 3), "rotation_before [rad]")
            check_array(self.rotation_after, (runs, 3), "rotation_after [rad]")
            if not 0 < self.sigma_rotation < np.inf:
                raise BenchError(f"sigma [rad]: expected more than 0, got {self.sigma_rotation}")

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.run)

    @property
    def points(self) -> int:
        """Number of measured points: markers times runs."""
        return len(self.run) * len(self.markers)

    @property
    def deflection(self) -> Array:
        """Measured deflection of every marker, (runs, m, 3) [m]."""
        return self.after - self.before

    @property
    def rotation(self) -> Array:
        """Measured rotation of the tool, world axes, (runs, 3) [rad].

        Raises:
            BenchError: When the dataset has no orientations.
        """
        if self.rotation_before is None or self.rotation_after is None:
            raise BenchError("dataset: expected orientations, it has positions only")
        before = Rotation.from_rotvec(self.rotation_before)
        after = Rotation.from_rotvec(self.rotation_after)
        return np.asarray((after * before.inv()).as_rotvec())


def select(data: Dataset, runs: Mask) -> Dataset:
    """The runs under a mask, (runs,).

    Raises:
        BenchError: When the mask has another length than the dataset.
    """
    if np.shape(runs) != (data.runs,):
        raise BenchError(f"select: expected a mask of {data.runs} runs, got shape {np.shape(runs)}")
    arrays = ("run", "pose", "q", "wrench", "point", "before", "after")
    rotations = ("rotation_before", "rotation_after") if data.rotation_before is not None else ()
    return replace(data, **{name: getattr(data, name)[runs] for name in (*arrays, *rotations)})


def split(data: Dataset, poses: Ids) -> tuple[Dataset, Dataset]:
    """The runs in these poses, and all others; a pose is never on both sides.

    Raises:
        BenchError: When the dataset lacks one of the poses, or one side would be empty.
    """
    missing = np.setdiff1d(poses, data.pose)
    if len(missing):
        raise BenchError(f"no pose {missing[0]} in the dataset; poses are {np.unique(data.pose).tolist()}")
    inside = np.isin(data.pose, poses)
    if inside.all() or not inside.any():
        raise BenchError(f"split: expected runs on both sides, got {inside.sum()} of {data.runs}")
    return select(data, inside), select(data, ~inside)


def columns(joints: tuple[str, ...], *, rotation: bool) -> list[str]:
    """The header of the CSV file, in order.

    run, pose: integers. marker: its name in the arm. JOINT_rad: joint angle. force_*_N, moment_*_Nm: load,
    world axes. point_*_m: where it acts, tool's frame. before_*_m, after_*_m: readings, world axes. sigma_m:
    standard deviation of one reading along one axis, the same in all rows. Where orientations are read too:
    rotation_before_*_rad, rotation_after_*_rad (rotation vectors, world axes, the same for every marker of a
    run) and sigma_rad.

    Args:
        joints: Names of the arm's joints.
        rotation: Whether orientations are read.
    """
    names = ["run", "pose", "marker", *(f"{j}_rad" for j in joints)]
    names += [f"force_{x}_N" for x in XYZ] + [f"moment_{x}_Nm" for x in XYZ]
    names += [f"{what}_{x}_m" for what in ("point", "before", "after") for x in XYZ] + ["sigma_m"]
    if rotation:
        names += [f"rotation_{when}_{x}_rad" for when in ("before", "after") for x in XYZ]
        names += ["sigma_rad"]
    return names


def write_csv(data: Dataset, joints: tuple[str, ...], path: Path) -> None:
    """Write the dataset; an existing file is replaced only by a whole one.

    Args:
        data: The runs.
        joints: Names of the arm's joints, for the header.
        path: The file.

    Raises:
        BenchError: When the names are not as many as the joint angles.
        InputError: When the file cannot be written.
    """
    if len(joints) != data.q.shape[1]:
        raise BenchError(f"joints: expected {data.q.shape[1]} names, got {list(joints)}")
    m = len(data.markers)
    rotation = data.rotation_before is not None
    parts = [np.repeat(a, m, axis=0) for a in (data.q, data.wrench, data.point)]
    parts += [a.reshape(-1, 3) for a in (data.before, data.after)]
    parts += [np.full((data.points, 1), data.sigma)]
    if data.rotation_before is not None and data.rotation_after is not None:
        parts += [np.repeat(a, m, axis=0) for a in (data.rotation_before, data.rotation_after)]
        parts += [np.full((data.points, 1), data.sigma_rotation)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns(joints, rotation=rotation))
    ids = zip(np.repeat(data.run, m), np.repeat(data.pose, m), data.markers * data.runs, strict=True)
    for (run, pose, marker), row in zip(ids, np.hstack(parts).tolist(), strict=True):
        writer.writerow([run, pose, marker, *map(repr, row)])
    part = path.with_name(path.name + ".part")
    try:
        part.write_bytes(text.getvalue().encode())
        part.replace(path)
    except OSError as err:
        part.unlink(missing_ok=True)
        raise InputError(path, "", f"cannot be written: {err.strerror}") from err


def read_csv(path: Path, arm: Arm) -> Dataset:
    """Read and check a dataset of an arm.

    Args:
        path: The file; `columns` documents its header.
        arm: The arm that was measured.

    Raises:
        InputError: Names the line and what was expected.
    """
    header, lines = _read_lines(path)
    joints = tuple(j.name for j in arm.joints)
    plain, full = columns(joints, rotation=False), columns(joints, rotation=True)
    rotation = not set(header).isdisjoint(set(full) - set(plain))
    expected = full if rotation else plain
    unknown = [name for name in header if name not in expected]
    missing = [name for name in expected if name not in header]
    twice = [name for name in expected if header.count(name) > 1]
    if twice:
        raise InputError(path, "line 1", f"expected every column once, got {twice} more than once")
    if missing or unknown:
        problem = f"missing columns {missing}, unknown columns {unknown}"
        raise InputError(path, "line 1", f"{problem}; expected {','.join(expected)}")
    if not lines:
        raise InputError(path, "line 2", "expected at least one row")
    order = [header.index(name) for name in expected]
    lines = [[line[k] for k in order] for line in lines]
    marker = [line[2] for line in lines]
    for number, name in enumerate(marker, start=2):
        if name not in arm.markers:
            have = ", ".join(arm.markers)
            problem = f"no marker {name[:80]!r} in {arm.name}; markers are {have}"
            raise InputError(path, f"line {number}, column marker", problem)
    markers = tuple(dict.fromkeys(marker))
    ids, values = _numbers(path, expected, lines)
    _check_runs(path, ids, marker, markers)
    _check_limits(path, arm, values[:, : len(joints)])
    return _assemble(path, expected, len(joints), markers, ids, values, rotation)


def _read_lines(path: Path) -> tuple[list[str], list[list[str]]]:
    reader = csv.reader(io.StringIO(read_text(path, MAX_BYTES), newline=""), strict=True)
    try:
        lines = list(reader)
    except csv.Error as err:
        raise InputError(path, f"line {reader.line_num}", f"not CSV: {err}") from err
    while lines and not lines[-1]:  # blank lines at the end, as editors leave them
        lines.pop()
    if not lines:
        raise InputError(path, "line 1", "expected a header, the file is empty")
    for number, line in enumerate(lines[1:], start=2):
        if len(line) != len(lines[0]):
            raise InputError(path, f"line {number}", f"expected {len(lines[0])} fields, got {len(line)}")
    return lines[0], lines[1:]


def _numbers(path: Path, names: list[str], lines: list[list[str]]) -> tuple[Ids, Array]:
    """Run and pose identifiers, (rows, 2), and all other numbers, (rows, columns)."""
    ids = np.empty((len(lines), 2), dtype=int)
    values = np.empty((len(lines), len(names) - 3))
    for i, line in enumerate(lines):
        for k, (name, text) in enumerate(zip(names, line, strict=True)):
            try:
                if k != 2 and "_" in text:  # Python reads 1_0 as 10
                    raise ValueError
                if k < 2:
                    ids[i, k] = int(text)
                elif k > 2:
                    values[i, k - 3] = float(text)
            except (ValueError, OverflowError):
                kind = "an integer of 64 bits" if k < 2 else "a number"
                place = f"line {i + 2}, column {name}"
                raise InputError(path, place, f"expected {kind}, got {text[:80]!r}") from None
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        i, k = bad[0]
        place = f"line {i + 2}, column {names[k + 3]}"
        raise InputError(path, place, f"expected a finite number, got {values[i, k]}")
    return ids, values


def _check_runs(path: Path, ids: Ids, marker: list[str], markers: tuple[str, ...]) -> None:
    """Every run lists every marker once, in the same order, on consecutive lines."""
    m = len(markers)
    for i in range(0, len(ids), m):
        block = marker[i : i + m]
        if tuple(block) != markers or (ids[i : i + m] != ids[i]).any():
            raise InputError(
                path,
                f"line {i + 2}",
                f"run {ids[i, 0]}: expected one line for each of {', '.join(markers)} in this order",
            )
    runs = ids[::m, 0]
    _, first = np.unique(runs, return_index=True)
    again = np.setdiff1d(np.arange(len(runs)), first)
    if len(again):
        raise InputError(path, f"line {again[0] * m + 2}", f"run {runs[again[0]]} stands in the file twice")


def _check_limits(path: Path, arm: Arm, q: Array) -> None:
    """Joint angles lie within the arm's limits; if not, degrees are the first suspect."""
    lower, upper = arm.limits
    bad = np.argwhere((q < lower - 1e-6) | (q > upper + 1e-6))
    if len(bad):
        i, k = bad[0]
        joint = arm.joints[k]
        hint = "; are these degrees?" if np.abs(q).max() > 2.5 * np.pi else ""
        raise InputError(
            path,
            f"line {i + 2}, column {joint.name}_rad",
            f"expected {joint.lower:.4f} to {joint.upper:.4f} rad, got {q[i, k]:g}{hint}",
        )


def _assemble(
    path: Path,
    names: list[str],
    n: int,
    markers: tuple[str, ...],
    ids: Ids,
    values: Array,
    rotation: bool,
) -> Dataset:
    m = len(markers)
    once = [*range(n + 9), *range(n + 15, values.shape[1])]  # all but the readings of a marker
    differs = np.argwhere(values[:, once].reshape(-1, m, len(once)) != values[::m][:, None, once])
    if len(differs):
        i, j, k = differs[0]
        place = f"line {i * m + j + 2}, column {names[3 + once[k]]}"
        raise InputError(path, place, "expected the same value in every row of the run")
    sigmas = [names.index("sigma_m") - 3] + ([names.index("sigma_rad") - 3] if rotation else [])
    for k in sigmas:
        other = np.flatnonzero(values[:, k] != values[0, k])
        if len(other):
            place = f"line {other[0] + 2}, column {names[k + 3]}"
            raise InputError(path, place, "expected one value in the whole file")
        if not values[0, k] > 0:
            place = f"line 2, column {names[k + 3]}"
            raise InputError(path, place, f"expected more than 0, got {values[0, k]}")
    first = values[::m]
    turned = first[:, n + 16 : n + 22] if rotation else None
    return Dataset(
        markers=markers,
        run=ids[::m, 0],
        pose=ids[::m, 1],
        q=first[:, :n],
        wrench=first[:, n : n + 6],
        point=first[:, n + 6 : n + 9],
        before=values[:, n + 9 : n + 12].reshape(-1, m, 3),
        after=values[:, n + 12 : n + 15].reshape(-1, m, 3),
        sigma=float(values[0, n + 15]),
        rotation_before=None if turned is None else turned[:, :3],
        rotation_after=None if turned is None else turned[:, 3:],
        sigma_rotation=float(values[0, n + 22]) if rotation else None,
    )
