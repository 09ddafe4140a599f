"""Readings as arrays: `Dataset` of deflections under loads, `Series` of absolute positions of targets."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from numbers import Real
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, Mask, check_array, check_type, some_of

if TYPE_CHECKING:  # importing MuJoCo takes a sixth of a second, and --help does without
    from _typeshed import DataclassInstance

# --- Deflections: in every run one load acts in one pose, and every marker is read without and with it ------

ArrayShapes = dict[str, tuple[int | None, ...]]
"""Expected shapes of arrays by "name [unit]"; None stands for any length."""

MAX_SIGMA = 1.0
"""Bound on the standard deviation of a reading [m, rad]; a larger number has another unit."""
MAX_EVALUATED_RUNS = 600
"""Largest number of runs that are evaluated one by one; of more, an evenly spaced selection is used."""
ASYMMETRY_TOLERANCE = 1e-9
"""Largest asymmetry of a matrix over its size, and error of a unit vector's length, from rounding [1]."""


@dataclass(frozen=True, repr=False)
class Dataset(Displayed):
    """Hold deflection measurements: positions of markers without and with a load, in runs of one pose each.

    Markers are the targets of a tracker on the tool, m of them; the arm has n joints. World axes are base
    axes. An instrument that reads along a line, such as a dial gauge or a ballbar, reads one number per
    marker instead of a position.
    """

    markers: tuple[str, ...]  #: Names of the markers, m of them.
    run_id: Ids  #: Identifier of every run, (runs,).
    pose_id: Ids  #: Identifier of the pose of every run, (runs,); runs in one pose share it.
    q: Array  #: Actuated joints, (runs, n) [rad, m].
    wrench: Array  #: Load, force and moment, world axes, (runs, 6) [N, N m].
    point: Array  #: Point where the load acts, in the tool's frame, (runs, 3) [m].
    before: Array  #: Marker positions read without the load, world, (runs, m, 3) [m].
    after: Array  #: Marker positions read with the load, world, (runs, m, 3) [m].
    sigma: float  #: Standard deviation of one position reading along one axis [m].
    #: Tool orientation read without the load, rotation vectors, world, (runs, 3) [rad]; None if not read.
    rotation_before: Array | None = None
    #: Tool orientation read with the load, rotation vectors, world, (runs, 3) [rad]; None if not read.
    rotation_after: Array | None = None
    #: Standard deviation of one orientation reading about one axis [rad]; None if not read.
    sigma_rotation: float | None = None
    #: Inverse covariance of every deflection, world axes, (runs, m, 3, 3) [1/m^2]; all zero where a target
    #: was lost, of rank one for a reading along a line. None where every deflection has the variance 2
    #: sigma^2 along every axis.
    precision: Array | None = None
    #: Number of the tracker's station that read each run, (runs,); every station has its own frame. None for
    #: one station.
    station: Ids | None = None
    #: Whether the reading without load followed the one with load, (runs,): with hysteresis the order
    #: matters. None where the unloaded reading was always first.
    unloaded_after_load: Mask | None = None
    #: Direction of every reading along a line, unit vectors, world axes, (runs, m, 3) [1]; zero for positions
    #: and where there is no instrument. `after` - `before` is the number read times this direction. None
    #: where all readings are positions.
    line_direction: Array | None = None
    #: Standard deviation of `line_direction` about each axis across it, (runs, m) [rad]; None without it.
    line_direction_deviation: Array | None = None
    #: Distance from marker to fixed point of a reading that is a distance, (runs, m) [m]; 0 for a gauge on a
    #: plane face of the tool, which turns with the tool. None without `line_direction`.
    line_length: Array | None = None
    #: Error of each reading by one standard deviation of `line_direction`, (runs, m, 3) [m]: that deviation
    #: times direction x predicted deflection. Readings of one set-up share this error. None until
    #: `resolve_line_readings` computes it.
    tilt_error: Array | None = None

    def __post_init__(self) -> None:
        """Check shapes, identifiers, markers and sigmas; BenchError where one is wrong or not finite."""
        check_type(self.run_id, np.ndarray, "run_id")
        check_type(self.markers, (tuple, list), "markers")
        runs, m = len(self.run_id), len(self.markers)
        rotations = (self.rotation_before, self.rotation_after, self.sigma_rotation)
        if any(x is None for x in rotations) != all(x is None for x in rotations):
            raise BenchError("orientations: expected before, after and sigma together, or none")
        shapes: ArrayShapes = {
            "before [m]": (runs, m, 3),
            "after [m]": (runs, m, 3),
            "unloaded_after_load": (runs,),
        }
        shapes |= {"rotation_before [rad]": (runs, 3), "rotation_after [rad]": (runs, 3)}
        shapes |= {"line_direction [1]": (runs, m, 3), "line_direction_deviation [rad]": (runs, m)}
        shapes |= {"line_length [m]": (runs, m), "tilt_error [m]": (runs, m, 3)}
        check_readings(self, runs, ("run_id", "pose_id", "station"), shapes)
        if self.precision is not None:
            _check_precision(self.precision, self.is_line_reading)
        _check_lines(self)

    def summary(self) -> dict[str, object]:
        """Summarise the dataset: numbers of runs and poses, markers, range of deflections, noise."""
        size = 1e3 * np.linalg.norm(self.deflection, axis=-1)[self.is_measured]
        lines = {} if self.line_direction is None else {"along_a_line": int(self.is_line_reading.sum())}
        return {
            "runs": self.n_runs,
            "poses": len(np.unique(self.pose_id)),
            "markers": " ".join(self.markers),
            "deflection_mm": f"{size.min():.2f} to {size.max():.2f}" if size.size else "none",
            "sigma_um": f"{1e6 * self.sigma:g}",
            **lines,
        }

    @property
    def n_runs(self) -> int:
        """Count the runs: readings without and with one load in one pose."""
        return len(self.run_id)

    @property
    def n_points(self) -> int:
        """Count the markers of all runs, lost ones included: number of runs times number of markers."""
        return len(self.run_id) * len(self.markers)

    @property
    def is_measured(self) -> Mask:
        """Tell which markers have a reading, (runs, m); a lost target has none."""
        if self.precision is None:
            return np.ones((self.n_runs, len(self.markers)), dtype=bool)
        return np.asarray(self.precision.any(axis=(2, 3)))

    @property
    def is_line_reading(self) -> Mask:
        """Tell which readings are one number along a direction, such as that of a dial gauge, (runs, m)."""
        if self.line_direction is None:
            return np.zeros((self.n_runs, len(self.markers)), dtype=bool)
        return np.asarray(self.line_direction.any(axis=2)) & self.is_measured

    @property
    def is_lost(self) -> Mask:
        """Tell which markers an instrument should have read but did not, (runs, m).

        A marker that no instrument is set up for is not lost. An instrument along a line is set up in the
        runs where `line_direction` is not zero. A tracker is set up for all markers that it reads in any run,
        in all runs but those with readings along lines only.
        """
        if self.line_direction is None:
            return ~self.is_measured
        along = np.asarray(self.line_direction.any(axis=2))
        placed = np.asarray(self.is_measured & ~self.is_line_reading)
        tracked = np.asarray(placed.any(axis=1) | ~along.any(axis=1))[:, None]
        return np.asarray(~self.is_measured & (along | (tracked & placed.any(axis=0))))

    @property
    def covariance(self) -> Array:
        """Compute the covariance of every deflection, world axes, (runs, m, 3, 3) [m^2].

        For a reading along a line it has rank one: the variance across the line is zero. Entries of lost
        targets have no meaning.
        """
        if self.precision is None:
            return np.broadcast_to(2 * self.sigma**2 * np.eye(3), (*self.before.shape, 3))
        whole = np.where(
            (self.is_measured & ~self.is_line_reading)[..., None, None], self.precision, np.eye(3)
        )
        covariances = np.asarray(np.linalg.inv(whole))
        if self.line_direction is None:
            return covariances
        P = self.precision
        trace = np.where(self.is_line_reading, np.trace(P, axis1=2, axis2=3), 1.0)[..., None, None]
        return np.where(self.is_line_reading[..., None, None], P / trace**2, covariances)

    def measured_components(self, vectors: Array) -> Array:
        """Project motions of the markers on the measured directions: one for a line, all for a position.

        Args:
            vectors: Motions of the markers, world axes, (..., runs, m, 3) [m].

        Returns:
            Their projections, world axes, (..., runs, m, 3) [m].
        """
        if self.line_direction is None:
            return vectors
        along = (self.line_direction * vectors).sum(axis=-1, keepdims=True) * self.line_direction
        return np.asarray(np.where(self.is_line_reading[..., None], along, vectors))

    @property
    def deflection(self) -> Array:
        """Compute the measured deflection, `after` - `before`, of every marker, world, (runs, m, 3) [m]."""
        return self.after - self.before

    @property
    def rotation(self) -> Array:
        """Compute the measured rotation of the tool by the load, rotation vectors, world, (runs, 3) [rad].

        Raises:
            BenchError: If orientations were not read.
        """
        if self.rotation_before is None or self.rotation_after is None:
            raise BenchError("dataset: expected orientations, it has positions only")
        return rotation_between(self.rotation_before, self.rotation_after)


def runs_of_station(data: Dataset, station: int) -> Mask:
    """Find the runs that were read from one station of the tracker.

    Args:
        data: The dataset.
        station: Number of the station.

    Returns:
        Mask, (runs,); all runs where the dataset has no station numbers.
    """
    return np.ones(data.n_runs, dtype=bool) if data.station is None else data.station == station


def rotation_between(before: Array, after: Array) -> Array:
    """Compute the rotation R_after R_before^T from one orientation to another, row by row.

    Args:
        before: First orientations as rotation vectors, (runs, 3) [rad].
        after: Second orientations as rotation vectors, (runs, 3) [rad].

    Returns:
        Rotation vectors in the frame of the orientations, (runs, 3) [rad].
    """
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    return np.asarray((Rotation.from_rotvec(after) * Rotation.from_rotvec(before).inv()).as_rotvec())


def check_readings(
    data: "DataclassInstance", n_rows: int, identifier_fields: Sequence[str], shapes: ArrayShapes
) -> None:
    """Check the shapes and values of the fields that a `Dataset` and a `Series` have in common.

    Args:
        data: The dataset or series.
        n_rows: Number of its runs or rows.
        identifier_fields: Names of the fields that are identifiers; each must be n_rows integers.
        shapes: Expected shape of each further array, by "name [unit]".

    Raises:
        BenchError: If an array has another shape or type, two targets have one name, or a sigma is not
            between 0 and `MAX_SIGMA`.
    """
    have = vars(data)
    for name, identifiers in (
        (name, np.asarray(have[name])) for name in identifier_fields if have[name] is not None
    ):
        if identifiers.shape != (n_rows,) or not np.issubdtype(identifiers.dtype, np.integer):
            raise BenchError(
                f"{name}: expected {n_rows} integers, got {identifiers.dtype} {identifiers.shape}"
            )
    markers = have["markers"]
    if not markers or len(set(markers)) != len(markers):
        raise BenchError(f"markers: expected different names, got {some_of(markers)}")
    every: ArrayShapes = {
        "q [rad, m]": (n_rows, None),
        "wrench [N, N m]": (n_rows, 6),
        "point [m]": (n_rows, 3),
    }
    for what, shape in {**every, **shapes, "precision [1/m^2]": (n_rows, len(markers), 3, 3)}.items():
        values = have[what.split()[0]]
        if values is not None:
            check_type(values, np.ndarray, what)
            check_array(values, shape, what)
    for name, unit in (("sigma", "m"), ("sigma_rotation", "rad")):
        deviation = have[name]
        if deviation is None and name == "sigma_rotation":
            continue  # orientations were not read
        if not (isinstance(deviation, Real) and 0 < float(deviation) < MAX_SIGMA):
            problem = f"expected a number above 0 and below {MAX_SIGMA:g}, got {deviation!r}"
            raise BenchError(f"{name} [{unit}]: {problem}")


def line_precision(direction: Array, sigma: float | Array) -> Array:
    """Make the inverse covariances u u^T / (2 sigma^2) of deflections that were read along lines.

    Args:
        direction: Unit vectors u of the lines, (..., 3) [1]; zero for lost readings.
        sigma: Standard deviation of one reading, one number or (...) [m].

    Returns:
        Inverse covariances of rank one, in the axes of u, (..., 3, 3) [1/m^2].
    """
    weight = 1 / (2 * np.asarray(sigma) ** 2)
    return np.asarray(weight[..., None, None] * direction[..., :, None] * direction[..., None, :])


def _check_lines(data: Dataset) -> None:
    """Refuse directions without their deviation, length and precision, and values that no instrument has."""
    together = (data.line_direction, data.line_direction_deviation, data.line_length)
    if any(values is None for values in together) and any(values is not None for values in together):
        raise BenchError(
            "readings along lines: expected direction, its deviation and length together, or none"
        )
    if data.line_direction is None or data.line_direction_deviation is None or data.line_length is None:
        return
    if data.precision is None:
        raise BenchError("readings along lines: expected their precision too, got None")
    for name, values in (
        ("line_direction_deviation [rad]", data.line_direction_deviation),
        ("line_length [m]", data.line_length),
    ):
        if values.size and values.min() < 0:
            raise BenchError(f"{name}: expected 0 or more, got {values.min():g}")
    length = np.linalg.norm(data.line_direction, axis=2)[data.is_line_reading]
    if (np.abs(length - 1) > ASYMMETRY_TOLERANCE).any():
        raise BenchError(f"line_direction [1]: expected unit vectors, got one of length {length[0]:g}")
    P = data.precision[data.is_line_reading]
    u = data.line_direction[data.is_line_reading]
    size = np.trace(P, axis1=1, axis2=2)[:, None, None]
    if (np.abs(P - size * u[:, :, None] * u[:, None, :]) > ASYMMETRY_TOLERANCE * size).any():
        raise BenchError("precision [1/m^2]: expected u u^T over the variance for readings along u")


def _check_precision(precision: Array, lines: Mask) -> None:
    """Refuse a matrix that is neither symmetric positive definite nor zero, nor of rank one for a line."""
    size = np.abs(precision).max(axis=(2, 3))
    skew = np.abs(precision - precision.swapaxes(2, 3)).max(axis=(2, 3))
    least = np.linalg.eigvalsh(precision)[..., 0]
    bad = (size > 0) & ((skew > ASYMMETRY_TOLERANCE * size) | ((least <= 0) & ~lines))
    if bad.any():
        run, marker = np.argwhere(bad)[0]
        raise BenchError(
            "precision [1/m^2]: expected symmetric positive definite matrices, or zero for a lost target, "
            f"got {precision[run, marker].tolist()} in place {run}, {marker}"
        )


def select_runs(data: Dataset, runs: Mask) -> Dataset:
    """Select runs of a dataset by a mask.

    Args:
        data: The dataset.
        runs: Mask of the runs to keep, (runs,).

    Raises:
        BenchError: When the mask has another length than the dataset.
    """
    if np.shape(runs) != (data.n_runs,):
        raise BenchError(f"select: expected a mask of {data.n_runs} runs, got shape {np.shape(runs)}")
    return select_rows(data, np.flatnonzero(runs))


Rows = TypeVar("Rows", bound="DataclassInstance")


def concatenate_rows(parts: Sequence[Rows]) -> Rows:
    """Concatenate the arrays of dataclasses of one type, such as datasets, along their first axis.

    Fields that are no arrays are those of the first part.
    """
    every = [row_arrays(part) for part in parts]
    whole = {name: np.concatenate([arrays[name] for arrays in every]) for name in every[0]}
    return replace(parts[0], **whole)


def row_arrays(data: "DataclassInstance") -> dict[str, npt.NDArray[np.generic]]:
    """Return all fields of a dataclass that are arrays, by name; the first axis counts runs or poses."""
    every = {field.name: getattr(data, field.name) for field in fields(data)}
    return {name: values for name, values in every.items() if isinstance(values, np.ndarray)}


def select_rows(data: Rows, rows: Ids | Mask | slice) -> Rows:
    """Select rows of all arrays of a dataclass, such as runs of a dataset or poses of a target.

    Args:
        data: Dataclass whose arrays all have the same number of rows.
        rows: The rows to keep: a mask, (rows,), indices in any order, or a slice.
    """
    return replace(data, **{name: values[rows] for name, values in row_arrays(data).items()})


def select_evenly(runs: Ids, count: int = MAX_EVALUATED_RUNS) -> Ids:
    """Select at most a given number of runs, evenly spaced; the first and the last are among them.

    Args:
        runs: Indices of the runs, (n,).
        count: Largest number of runs to keep.

    Returns:
        Indices of the selected runs, (min(n, count),).
    """
    return np.asarray(runs[np.linspace(0, len(runs) - 1, min(count, len(runs))).round().astype(int)])


def evenly_spaced(count: int, most: int) -> Ids:
    """List at most `most` of the indices 0 to count - 1, evenly spaced; the first and last are among them.

    Args:
        count: Number of rows to select from.
        most: Largest number of indices to list.

    Returns:
        Indices, ascending, (min(count, most),).
    """
    return np.linspace(0, count - 1, min(most, count)).astype(int)


def split_by_pose(data: Dataset, poses: Ids) -> tuple[Dataset, Dataset]:
    """Split a dataset into the runs in some poses and the runs in all other poses.

    Args:
        data: The dataset.
        poses: Identifiers of the poses, (poses,).

    Returns:
        The runs in these poses, and all other runs.

    Raises:
        BenchError: When the dataset lacks one of the poses, or one of the two sets would be empty.
    """
    missing = np.setdiff1d(poses, data.pose_id)
    if len(missing):
        raise BenchError(f"no pose {missing[0]} in the dataset; poses are {some_of(np.unique(data.pose_id))}")
    inside = np.isin(data.pose_id, poses)
    if inside.all() or not inside.any():
        count = f"{inside.sum()} of {data.n_runs}"
        raise BenchError(f"expected runs in these poses and in others, got {count} in these")
    return select_runs(data, inside), select_runs(data, ~inside)


# --- Absolute readings: positions of targets on the tool in a tracker's frame, one pose and load per row ----

NOMINAL_FIXED_POINT_DEVIATION = 0.02
"""Least and default standard deviation of the stated fixed point of distances along each axis [m]: in base
axes of a calibrated model it is millimetres from where it was measured."""
NOMINAL_NORMAL_DEVIATION = math.radians(0.5)
"""Least and default standard deviation of the stated normal of a plane about each axis [rad]."""


@dataclass(frozen=True, repr=False)
class Series(Displayed):
    """Hold absolute readings of targets on the tool: positions from one station of a tracker, or distances.

    The arm has n joints and m targets. Series with the same `frame` share one unknown tracker frame, and
    series with the same `mount` share unknown positions of the targets on the tool. The arm does not move
    between rows with the same `pose_id`, such as without and with a load, so that they share one model error.

    Distances are from a fixed point (ballbar, draw-wire), or heights over a plane if `plane_normal` is set.
    """

    name: str  #: Name in reports, such as the file's name.
    markers: tuple[str, ...]  #: Names of the targets, m of them.
    frame: str  #: Name of the tracker's frame.
    mount: str  #: Name of the mount that holds the targets on the tool.
    row_id: Ids  #: Identifier of every row, such as its line in the file, (rows,).
    pose_id: Ids  #: Identifier of the pose of every row, (rows,).
    q: Array  #: Actuated joints, commanded or read, (rows, n) [rad, m].
    wrench: Array  #: Load in addition to own weight, force and moment, world axes, (rows, 6) [N, N m].
    point: Array  #: Point where the load acts, in the tool's frame, (rows, 3) [m].
    position: Array  #: Positions of the targets in the tracker's frame, (rows, m, 3) [m]; zero if lost.
    sigma: float  #: Standard deviation of one position reading along one axis [m].
    #: Inverse covariance of every position, the tracker's axes, (rows, m, 3, 3) [1/m^2]; zero where the
    #: target was lost. None where every position has the variance sigma^2 along every axis.
    precision: Array | None = None
    #: Orientation of the target, tracker from target, (rows, 3, 3) [1]; NaN in rows where it was lost. None
    #: if no orientation was read.
    rotation: Array | None = None
    #: Standard deviation of an orientation reading about each axis [rad]; None if not read.
    sigma_rotation: float | None = None
    torque: Array | None = None  #: Torques of the actuated joints, (rows, n) [N m, N]; None if not read.
    temperature: Array | None = None  #: Temperature, (rows,) [degree Celsius]; None if not read.
    time: Array | None = None  #: Time from any start, (rows,) [s]; None if not read.
    #: Distance of every target from the fixed point, or its height over the plane, (rows, m) [m]; `position`
    #: is then zero. None where positions were read.
    distance: Array | None = None
    #: Stated fixed point of distances, or stated point of the plane, world [m]; None without distances.
    fixed_point: tuple[float, float, float] | None = None
    #: Standard deviation of the stated point along each axis [m].
    fixed_point_sigma: float = NOMINAL_FIXED_POINT_DEVIATION
    #: Stated normal of the plane towards the targets, unit vector, world axes [1]; None for a fixed point.
    plane_normal: tuple[float, float, float] | None = None
    #: Standard deviation of the stated normal about each axis [rad].
    plane_normal_sigma: float = NOMINAL_NORMAL_DEVIATION
    #: Standard deviation of an unknown offset that all distances from the fixed point share [m]; 0 for none.
    distance_offset_sigma: float = 0.0
    #: Name and unit of every joint's column in the file of the series, in the arm's order.
    joint_columns: tuple[tuple[str, str], ...] = ()

    def summary(self) -> dict[str, object]:
        """Summarise the series: numbers of rows and poses, targets, frame, mount and noise."""
        return {
            "name": self.name,
            "rows": len(self.row_id),
            "poses": len(np.unique(self.pose_id)),
            "targets": " ".join(self.markers),
            "frame": self.frame,
            "mount": self.mount,
            "orientations": self.rotation is not None,
            "sigma_um": f"{1e6 * self.sigma:g}",
        }

    def __post_init__(self) -> None:
        """Check shapes, identifiers, targets and sigmas; BenchError where one is wrong or not finite."""
        check_type(self.row_id, np.ndarray, "row_id")
        check_type(self.markers, (tuple, list), "markers")
        rows, m = len(self.row_id), len(self.markers)
        if (self.rotation is None) != (self.sigma_rotation is None):
            raise BenchError("orientations: expected rotation and sigma together, or none")
        shapes: ArrayShapes = {"position [m]": (rows, m, 3), "temperature": (rows,), "time": (rows,)}
        shapes |= {"torque [N m, N]": np.shape(self.q), "distance [m]": (rows, m)}
        check_readings(self, rows, ("row_id", "pose_id"), shapes)
        if (self.distance is None) != (self.fixed_point is None):
            raise BenchError("expected distances and a fixed point together, or neither")
        if self.distance is not None:
            self._check_distances(self.distance)
        elif self.plane_normal is not None:
            raise BenchError("normal: expected heights over this plane too, got none")
        if self.rotation is not None:
            if self.rotation.shape != (rows, 3, 3):
                raise BenchError(f"rotation: expected shape {(rows, 3, 3)}, got {self.rotation.shape}")
            check_array(self.rotation[self.is_oriented], (None, 3, 3), "rotation")

    def _check_distances(self, distance: Array) -> None:
        """Refuse distances that no instrument reads, and fields that exclude each other, by BenchError."""
        if self.rotation is not None or self.position.any():
            raise BenchError("a series of distances has neither positions nor orientations")
        for name in ("fixed_point_sigma", "plane_normal_sigma"):
            if not 0 < getattr(self, name) < np.inf:
                raise BenchError(f"{name} [m, rad]: expected more than 0, got {getattr(self, name)}")
        if self.plane_normal is not None:
            length = math.hypot(*self.plane_normal)
            if not abs(length - 1) < ASYMMETRY_TOLERANCE or self.distance_offset_sigma:
                raise BenchError(
                    f"normal: expected a unit vector and no distance_offset_sigma, got length {length:g}"
                )
            return
        least = distance[self.is_measured].min(initial=np.inf)
        if least <= 0 and not self.distance_offset_sigma:
            raise BenchError(f"distance [m]: expected more than 0, got {least:g}")

    @property
    def frame_deviations(self) -> tuple[float, ...] | None:
        """Return the stated standard deviations of the frame that distances are measured in.

        Returns:
            Three translations [m], three rotations [rad] and, if distances have an unknown offset, that
            offset [m]. Rotations about a fixed point change no distance: they are 0. None for positions,
            which determine their frame.
        """
        if self.distance is None:
            return None
        turn = 0.0 if self.plane_normal is None else self.plane_normal_sigma
        return (
            *[self.fixed_point_sigma] * 3,
            *[turn] * 3,
            *[self.distance_offset_sigma] * bool(self.distance_offset_sigma),
        )

    @property
    def n_equations(self) -> int:
        """Count the numbers that were read: three per position or orientation, one per distance."""
        return (3 if self.distance is None else 1) * int(self.is_measured.sum()) + 3 * int(
            self.is_oriented.sum()
        )

    @property
    def chi_squared_95(self) -> float:
        """Return the 95 % quantile of chi squared with 3 degrees of freedom, 1 for distances [1]."""
        return 7.8147 if self.distance is None else 3.8415

    @property
    def n_rows(self) -> int:
        """Count the rows: readings of all targets in one pose under one load."""
        return len(self.row_id)

    @property
    def is_measured(self) -> Mask:
        """Tell which targets have a reading, (rows, m); a lost target has none."""
        if self.precision is None:
            return np.ones((self.n_rows, len(self.markers)), dtype=bool)
        return np.asarray(self.precision.any(axis=(2, 3)))

    @property
    def is_oriented(self) -> Mask:
        """Tell which rows have a reading of the orientation, (rows,)."""
        if self.rotation is None:
            return np.zeros(self.n_rows, dtype=bool)
        return np.asarray(np.isfinite(self.rotation).all(axis=(1, 2)))


def mean_numbers_per_reading(series: Sequence[Series]) -> float:
    """Compute the mean count of numbers per reading of a target: 3 for a position, 1 for a distance.

    Args:
        series: Absolute readings of targets.

    Returns:
        Mean over all readings of targets [1].
    """
    read = [(readings.distance is None, int(readings.is_measured.sum())) for readings in series]
    return sum((3 if position else 1) * n for position, n in read) / sum(n for _, n in read)


def series_from_runs(data: Dataset, name: str, mount: str) -> tuple[Series, ...]:
    """Convert a dataset of deflections to absolute readings, one series per station of the tracker.

    A run gives two rows of one pose: without load, and with load. Readings along lines are left out, because
    they are no positions.

    Args:
        data: The dataset.
        name: Name of every series; a frame's name is this name and the number of its station.
        mount: Name of the mount that holds the targets on the tool.

    Returns:
        The series; the first half of their rows is without load.
    """
    stations = [1] if data.station is None else np.unique(data.station).tolist()
    every = [(station, select_rows(data, runs_of_station(data, station))) for station in stations]
    return tuple(
        _unloaded_and_loaded(station_runs, name, f"{name} {station}", mount)
        for station, station_runs in every
    )


def _unloaded_and_loaded(data: Dataset, name: str, frame: str, target: str) -> Series:
    """Combine the unloaded and then the loaded readings of some runs."""
    rotation, doubled = None, select_rows(data, np.tile(np.arange(data.n_runs), 2))
    placed = (data.is_measured & ~data.is_line_reading)[..., None]  # a reading along a line is no position
    P = doubled.precision
    if P is not None and doubled.line_direction is not None:
        P = P * ~doubled.is_line_reading[..., None, None]
    if data.rotation_before is not None and data.rotation_after is not None:
        from scipy.spatial.transform import Rotation  # here: it takes long to import

        turns = np.concatenate([data.rotation_before, data.rotation_after])
        rotation = Rotation.from_rotvec(turns).as_matrix()
    return Series(
        name=name,
        markers=data.markers,
        frame=frame,
        mount=target,
        row_id=doubled.run_id,
        pose_id=np.concatenate([np.arange(data.n_runs)] * 2),
        q=doubled.q,
        wrench=np.concatenate([np.zeros((data.n_runs, 6)), data.wrench]),
        point=doubled.point,
        position=np.concatenate([read * placed for read in (data.before, data.after)]),
        sigma=data.sigma,
        precision=None if P is None else 2 * P,  # that is of a deflection
        rotation=rotation,
        sigma_rotation=data.sigma_rotation,
    )
