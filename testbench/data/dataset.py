"""Measured runs as arrays: one load in one pose per run, every marker read before and after loading."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from numbers import Real
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, Mask, check_array, check_type

if TYPE_CHECKING:  # importing MuJoCo takes a sixth of a second, and --help does without
    from _typeshed import DataclassInstance

# --- Measured runs as arrays: one load in one pose per run, every marker read before and after loading ------

Shapes = dict[str, tuple[int | None, ...]]
"""Shapes of arrays by name and unit; None for any length."""

MAX_SIGMA = 1.0
"""Bound on the standard deviation of a reading [m, rad]: a larger one has another unit."""
MAX_SHOWN = 600
"""Most runs that are evaluated one by one, evenly out of all."""
ASYMMETRY_TOLERANCE = 1e-9
"""Largest asymmetry of a matrix, as a share of its size."""


@dataclass(frozen=True, repr=False)
class Dataset(Displayed):
    """Hold deflection measurements: readings of markers before and after loading, with poses and loads.

    For m markers on an arm of n joints it needs: `markers`, their names; `run` and `pose`, (runs,) integers;
    `q`, joints, (runs, n) [rad, m]; `wrench`, the load in world axes, (runs, 6) [N, N m], which acts at
    `point` of the tool's frame, (runs, 3) [m]; `before` and `after`, positions without and with the load in
    the base's frame, (runs, m, 3) [m]; `sigma`, the standard deviation of one reading along one axis [m].
    """

    markers: tuple[str, ...]  #: Names of the markers, m of them.
    run: Ids  #: Identifier of every run, (runs,).
    pose: Ids  #: Identifier of the pose of every run, (runs,); repeated runs share it.
    q: Array  #: Actuated joints, (runs, n) [rad, m].
    wrench: Array  #: Load, force and moment, world axes, (runs, 6) [N, N m].
    point: Array  #: Point where the load acts, in the tool's frame, (runs, 3) [m].
    before: Array  #: Marker positions read unloaded, world, (runs, m, 3) [m].
    after: Array  #: Marker positions read loaded, (runs, m, 3) [m].
    sigma: float  #: Standard deviation of one position reading along one axis [m].
    #: Tool orientation read unloaded, rotation vectors, (runs, 3) [rad]; None if not read.
    rotation_before: Array | None = None
    #: Tool orientation read loaded, rotation vectors, (runs, 3) [rad]; None if not read.
    rotation_after: Array | None = None
    #: Standard deviation of one orientation reading about one axis [rad].
    sigma_rotation: float | None = None
    #: Inverse covariance of every deflection, world axes, (runs, m, 3, 3) [1/m^2]; all zero where a target
    #: was lost, of rank one where one direction was read. None where sigma holds along every axis: a
    #: deflection then has 2 sigma^2.
    precision: Array | None = None
    #: Station of the tracker that read each run, (runs,); each has a frame of its own. None for one station.
    station: Ids | None = None
    #: Whether the load was taken off before the unloaded reading of a run, (runs,); None for no run.
    taken_off: Mask | None = None
    #: Direction of every reading along a line, unit vectors, world axes, (runs, m, 3) [1]; zero for positions
    #: and where there is no instrument. Such a reading is its number times this direction. None where all are
    #: positions.
    direction: Array | None = None
    #: Standard deviation of that direction about each axis across it, (runs, m) [rad]; with `direction`.
    tilt: Array | None = None
    #: Length of a reading that is a distance to a fixed point, (runs, m) [m]; 0 for the travel of a gauge on
    #: a plane face of the tool, which turns with the tool. With `direction`.
    reach: Array | None = None
    #: Error of each reading by the tilt: tilt times direction x deflection of a model, (runs, m, 3) [m].
    #: `identify.equations` fills it in; None before. Readings of one set-up share their tilt.
    slide: Array | None = None

    def __post_init__(self) -> None:
        """Refuse wrong shapes, identifiers, markers and sigmas, and what is not finite, by BenchError."""
        check_type(self.run, np.ndarray, "run")
        check_type(self.markers, (tuple, list), "markers")
        runs, m = len(self.run), len(self.markers)
        rotations = (self.rotation_before, self.rotation_after, self.sigma_rotation)
        if any(x is None for x in rotations) != all(x is None for x in rotations):
            raise BenchError("orientations: expected before, after and sigma together, or none")
        shapes: Shapes = {"before [m]": (runs, m, 3), "after [m]": (runs, m, 3), "taken_off": (runs,)}
        shapes |= {"rotation_before [rad]": (runs, 3), "rotation_after [rad]": (runs, 3)}
        shapes |= {"direction [1]": (runs, m, 3), "tilt [rad]": (runs, m), "reach [m]": (runs, m)}
        shapes |= {"slide [m]": (runs, m, 3)}
        check_rows(self, runs, ("run", "pose", "station"), shapes)
        if self.precision is not None:
            _check_precision(self.precision, self.lines)
        _check_lines(self)

    def summary(self) -> dict[str, object]:
        """Summarise the runs: numbers of runs and poses, markers, deflections and noise."""
        size = 1e3 * np.linalg.norm(self.deflection, axis=-1)[self.seen]
        lines = {} if self.direction is None else {"along_a_line": int(self.lines.sum())}
        return {
            "runs": self.runs,
            "poses": len(np.unique(self.pose)),
            "markers": " ".join(self.markers),
            "deflection_mm": f"{size.min():.2f} to {size.max():.2f}" if size.size else "none",
            "sigma_um": f"{1e6 * self.sigma:g}",
            **lines,
        }

    @property
    def runs(self) -> int:
        """Count the runs."""
        return len(self.run)

    @property
    def points(self) -> int:
        """Count the measured points, markers times runs."""
        return len(self.run) * len(self.markers)

    @property
    def seen(self) -> Mask:
        """Tell which targets were read, (runs, m), not those that the tracker lost."""
        if self.precision is None:
            return np.ones((self.runs, len(self.markers)), dtype=bool)
        return np.asarray(self.precision.any(axis=(2, 3)))

    @property
    def lines(self) -> Mask:
        """Tell which readings are one number along a direction, as of a dial gauge, (runs, m)."""
        if self.direction is None:
            return np.zeros((self.runs, len(self.markers)), dtype=bool)
        return np.asarray(self.direction.any(axis=2)) & self.seen

    @property
    def lost(self) -> Mask:
        """Tell which targets an instrument should have read but did not, (runs, m).

        Beside readings along lines a target may have no instrument: it has no direction, and no tracker
        reads it. A tracker reads its targets in all runs but those of other instruments only.
        """
        if self.direction is None:
            return ~self.seen
        along, placed = np.asarray(self.direction.any(axis=2)), np.asarray(self.seen & ~self.lines)
        tracked = np.asarray(placed.any(axis=1) | ~along.any(axis=1))[:, None]
        return np.asarray(~self.seen & (along | (tracked & placed.any(axis=0))))

    @property
    def covariance(self) -> Array:
        """Compute the covariance of every deflection, world axes, (runs, m, 3, 3) [m^2]; unused if lost.

        Along a line it has rank one: directions that were not read have no variance here.
        """
        if self.precision is None:
            return np.broadcast_to(2 * self.sigma**2 * np.eye(3), (*self.before.shape, 3))
        whole = np.where((self.seen & ~self.lines)[..., None, None], self.precision, np.eye(3))
        covariances = np.asarray(np.linalg.inv(whole))
        if self.direction is None:
            return covariances
        P = self.precision
        trace = np.where(self.lines, np.trace(P, axis1=2, axis2=3), 1.0)[..., None, None]
        return np.where(self.lines[..., None, None], P / trace**2, covariances)

    def measured_components(self, vectors: Array) -> Array:
        """Project motions of the markers on the directions that were measured.

        A reading along a line keeps the component along that line; a position keeps all three.

        Args:
            vectors: Motions of the markers, (..., runs, m, 3) [m].

        Returns:
            Measured components of the motions, (..., runs, m, 3) [m].
        """
        if self.direction is None:
            return vectors
        along = (self.direction * vectors).sum(axis=-1, keepdims=True) * self.direction
        return np.asarray(np.where(self.lines[..., None], along, vectors))

    @property
    def deflection(self) -> Array:
        """Compute the measured deflection of every marker, (runs, m, 3) [m]."""
        return self.after - self.before

    @property
    def rotation(self) -> Array:
        """Compute the measured rotation of the tool.

        Returns:
            Rotation vectors, world axes, (runs, 3) [rad].

        Raises:
            BenchError: If orientations were not read.
        """
        if self.rotation_before is None or self.rotation_after is None:
            raise BenchError("dataset: expected orientations, it has positions only")
        return rotation_between(self.rotation_before, self.rotation_after)


def runs_of_station(data: Dataset, station: int) -> Mask:
    """Find the runs that one set-up of the tracker read.

    Args:
        data: The runs.
        station: Number of the set-up.

    Returns:
        Mask, (runs,); all runs where the data name no station.
    """
    return np.ones(data.runs, dtype=bool) if data.station is None else data.station == station


def rotation_between(before: Array, after: Array) -> Array:
    """Compute the rotation from one orientation to another.

    Args:
        before: Rotation vectors, (runs, 3) [rad].
        after: Rotation vectors, (runs, 3) [rad].

    Returns:
        Rotation vectors, (runs, 3) [rad].
    """
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    return np.asarray((Rotation.from_rotvec(after) * Rotation.from_rotvec(before).inv()).as_rotvec())


def check_rows(data: "DataclassInstance", rows: int, ids: Sequence[str], shapes: Shapes) -> None:
    """Check the shapes and values of a `Dataset` or a `Series`.

    Args:
        data: The dataset or series.
        rows: Number of its runs or rows.
        ids: Names of the fields that are identifiers, (rows,) integers each.
        shapes: Expected shape of each further array, by its name and unit.

    Raises:
        BenchError: If an array has another shape or kind, two targets have one name, or a sigma is not
            between 0 and `MAX_SIGMA`.
    """
    have = vars(data)
    for name, identifiers in ((name, np.asarray(have[name])) for name in ids if have[name] is not None):
        if identifiers.shape != (rows,) or not np.issubdtype(identifiers.dtype, np.integer):
            raise BenchError(f"{name}: expected {rows} integers, got {identifiers.dtype} {identifiers.shape}")
    markers = have["markers"]
    if not markers or len(set(markers)) != len(markers):
        raise BenchError(f"markers: expected different names, got {markers}")
    every: Shapes = {"q [rad, m]": (rows, None), "wrench [N, N m]": (rows, 6), "point [m]": (rows, 3)}
    for what, shape in {**every, **shapes, "precision [1/m^2]": (rows, len(markers), 3, 3)}.items():
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


def along_lines(direction: Array, sigma: float | Array) -> Array:
    """Make the inverse covariances of deflections along lines, u u^T / (2 sigma^2).

    Args:
        direction: Unit vectors u, (..., 3) [1]; zero for lost readings.
        sigma: Standard deviation of one reading, one number or (...) [m].

    Returns:
        Of rank one, (..., 3, 3) [1/m^2].
    """
    weight = 1 / (2 * np.asarray(sigma) ** 2)
    return np.asarray(weight[..., None, None] * direction[..., :, None] * direction[..., None, :])


def _check_lines(data: Dataset) -> None:
    """Refuse directions without tilt, reach and precision, and values that no instrument has."""
    together = (data.direction, data.tilt, data.reach)
    if any(values is None for values in together) and any(values is not None for values in together):
        raise BenchError("readings along lines: expected direction, tilt and reach together, or none")
    if data.direction is None or data.tilt is None or data.reach is None:
        return
    if data.precision is None:
        raise BenchError("readings along lines: expected their precision too, got None")
    for name, values in (("tilt [rad]", data.tilt), ("reach [m]", data.reach)):
        if values.size and values.min() < 0:
            raise BenchError(f"{name}: expected 0 or more, got {values.min():g}")
    length = np.linalg.norm(data.direction, axis=2)[data.lines]
    if (np.abs(length - 1) > ASYMMETRY_TOLERANCE).any():
        raise BenchError(f"direction [1]: expected unit vectors, got one of length {length[0]:g}")
    P = data.precision[data.lines]
    u = data.direction[data.lines]
    size = np.trace(P, axis1=1, axis2=2)[:, None, None]
    if (np.abs(P - size * u[:, :, None] * u[:, None, :]) > ASYMMETRY_TOLERANCE * size).any():
        raise BenchError("precision [1/m^2]: expected u u^T over the variance for readings along u")


def _check_precision(precision: Array, lines: Mask) -> None:
    """Refuse a matrix that is neither symmetric positive definite nor zero; lines have rank one."""
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


def select(data: Dataset, runs: Mask) -> Dataset:
    """Select runs of a dataset.

    Args:
        data: The runs.
        runs: Mask, (runs,).

    Raises:
        BenchError: When the mask has another length than the dataset.
    """
    if np.shape(runs) != (data.runs,):
        raise BenchError(f"select: expected a mask of {data.runs} runs, got shape {np.shape(runs)}")
    return select_rows(data, np.flatnonzero(runs))


Rows = TypeVar("Rows", bound="DataclassInstance")


def join_rows(parts: Sequence[Rows]) -> Rows:
    """Concatenate datasets, or other dataclasses of arrays, row by row; the first one gives all else."""
    every = [row_arrays(part) for part in parts]
    whole = {name: np.concatenate([arrays[name] for arrays in every]) for name in every[0]}
    return replace(parts[0], **whole)


def row_arrays(data: "DataclassInstance") -> dict[str, npt.NDArray[np.generic]]:
    """Return the fields of a dataclass that are arrays with one row per run, reading or pose, by name."""
    every = {field.name: getattr(data, field.name) for field in fields(data)}
    return {name: values for name, values in every.items() if isinstance(values, np.ndarray)}


def select_rows(data: Rows, rows: Ids | Mask | slice) -> Rows:
    """Select rows of data with one entry per run, reading or pose.

    Args:
        data: The rows.
        rows: Mask, (rows,), or indices in any order.
    """
    return replace(data, **{name: values[rows] for name, values in row_arrays(data).items()})


def select_evenly(runs: Ids, count: int = MAX_SHOWN) -> Ids:
    """Select at most a given number of runs, evenly spaced; the first and the last are among them.

    Args:
        runs: The runs, (n,).
        count: Number of runs to keep.

    Returns:
        The selected runs, (min(n, count),).
    """
    return np.asarray(runs[np.linspace(0, len(runs) - 1, min(count, len(runs))).round().astype(int)])


def evenly_spaced(count: int, most: int) -> Ids:
    """List at most `most` indices below a count, evenly spaced and rounded down, both ends among them.

    Args:
        count: Number of rows.
        most: Number of indices to keep.

    Returns:
        Indices, ascending, (min(count, most),).
    """
    return np.linspace(0, count - 1, min(most, count)).astype(int)


def split(data: Dataset, poses: Ids) -> tuple[Dataset, Dataset]:
    """Split runs by pose; a pose is never on both sides.

    Args:
        data: The runs.
        poses: Identifiers of poses, (poses,).

    Returns:
        The runs in these poses, and all others.

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


# --- Absolute readings as arrays: targets on the tool in a tracker's frame, one pose and load per row -------

NOMINAL_FIXED = 0.02
"""Least standard deviation of a stated fixed point along each axis [m]: that of a nominal target."""
NOMINAL_TILT = math.radians(0.5)
"""Least standard deviation of a stated plane's normal about each axis [rad]: those of the base and of its
first axis."""


@dataclass(frozen=True, repr=False)
class Series(Displayed):
    """Hold the readings of one station of a tracker on one arm.

    For m targets on an arm of n joints it needs names, `row` and `pose`, (rows,) integers, `q`, (rows, n)
    [rad, m], `wrench`, (rows, 6) [N, N m] in world axes, at `point` of the tool's frame, (rows, 3) [m],
    `position` in the tracker's frame, (rows, m, 3) [m], and `sigma` [m].

    Frame and target are names: series that share a name share the unknown frame or mount. Rows of one `pose`
    are readings without a move in between, such as unloaded and loaded: the model error there is common to
    them.
    """

    name: str  #: Name in reports, such as the file's name.
    markers: tuple[str, ...]  #: Names of the targets, m of them.
    frame: str  #: Name of the tracker's frame.
    target: str  #: Name of the mount that holds the targets to the tool.
    row: Ids  #: Identifier of every row, such as its line in the file, (rows,).
    pose: Ids  #: Identifier of the pose of every row, (rows,).
    q: Array  #: Actuated joints, commanded or read, (rows, n) [rad, m].
    wrench: Array  #: Load in addition to own weight, force and moment, world axes, (rows, 6) [N, N m].
    point: Array  #: Point where the load acts, in the tool's frame, (rows, 3) [m].
    position: Array  #: Targets in the tracker's frame, (rows, m, 3) [m]; zero for lost ones.
    sigma: float  #: Standard deviation of one position reading along one axis [m].
    #: Inverse covariance of every position, the tracker's axes, (rows, m, 3, 3) [1/m^2]; zero where the
    #: target was lost. None where sigma holds for all.
    precision: Array | None = None
    #: Orientation of a target that has one, the tracker from the target, (rows, 3, 3); None if not read, all
    #: NaN in rows where it was lost.
    rotation: Array | None = None
    sigma_rotation: float | None = None  #: Standard deviation of an orientation about an axis [rad].
    torque: Array | None = None  #: Torques of the actuated joints, (rows, n) [N m, N].
    temperature: Array | None = None  #: Temperature, (rows,) [degree Celsius].
    time: Array | None = None  #: Time from any start, (rows,) [s].
    #: Distance of every target from the fixed point, or height over the plane, (rows, m) [m]; positions are
    #: then zeros. None of positions.
    distance: Array | None = None
    #: Stated fixed point of distances, or a point of the plane, world axes [m].
    fixed: tuple[float, float, float] | None = None
    fixed_sigma: float = NOMINAL_FIXED  #: Standard deviation of that point along each axis [m].
    #: Stated normal of the plane towards the targets, unit vector, world axes [1]; None of a fixed point.
    normal: tuple[float, float, float] | None = None
    tilt: float = NOMINAL_TILT  #: Standard deviation of the normal about each axis [rad].
    #: Standard deviation of an unknown constant in all distances from the fixed point [m]; 0 without one.
    zero_sigma: float = 0.0
    #: Name and unit of every joint's column in the file that it was read from, in the arm's order.
    joints: tuple[tuple[str, str], ...] = ()

    def summary(self) -> dict[str, object]:
        """Summarise the series: rows, poses, targets, frame, mount and noise."""
        return {
            "name": self.name,
            "rows": len(self.row),
            "poses": len(np.unique(self.pose)),
            "targets": " ".join(self.markers),
            "frame": self.frame,
            "mount": self.target,
            "orientations": self.rotation is not None,
            "sigma_um": f"{1e6 * self.sigma:g}",
        }

    def __post_init__(self) -> None:
        """Refuse wrong shapes and identifiers, and what is not finite, by BenchError."""
        check_type(self.row, np.ndarray, "row")
        check_type(self.markers, (tuple, list), "markers")
        rows, m = len(self.row), len(self.markers)
        if (self.rotation is None) != (self.sigma_rotation is None):
            raise BenchError("orientations: expected rotation and sigma together, or none")
        shapes: Shapes = {"position [m]": (rows, m, 3), "temperature": (rows,), "time": (rows,)}
        shapes |= {"torque [N m, N]": np.shape(self.q), "distance [m]": (rows, m)}
        check_rows(self, rows, ("row", "pose"), shapes)
        if (self.distance is None) != (self.fixed is None):
            raise BenchError("expected distances and a fixed point together, or neither")
        if self.distance is not None:
            self._check_distances(self.distance)
        elif self.normal is not None:
            raise BenchError("normal: expected heights over this plane too, got none")
        if self.rotation is not None:
            if self.rotation.shape != (rows, 3, 3):
                raise BenchError(f"rotation: expected shape {(rows, 3, 3)}, got {self.rotation.shape}")
            check_array(self.rotation[self.oriented], (None, 3, 3), "rotation")

    def _check_distances(self, distance: Array) -> None:
        """Refuse distances that no instrument reads, and fields that exclude each other, by BenchError."""
        if self.rotation is not None or self.position.any():
            raise BenchError("a series of distances has neither positions nor orientations")
        for name in ("fixed_sigma", "tilt"):
            if not 0 < getattr(self, name) < np.inf:
                raise BenchError(f"{name} [m, rad]: expected more than 0, got {getattr(self, name)}")
        if self.normal is not None:
            length = math.hypot(*self.normal)
            if not abs(length - 1) < ASYMMETRY_TOLERANCE or self.zero_sigma:
                raise BenchError(f"normal: expected a unit vector and no zero_sigma, got length {length:g}")
            return
        least = distance[self.seen].min(initial=np.inf)
        if least <= 0 and not self.zero_sigma:
            raise BenchError(f"distance [m]: expected more than 0, got {least:g}")

    @property
    def frame_deviation(self) -> tuple[float, ...] | None:
        """Return standard deviations of the frame's shifts [m], turns [rad] and constant [m], as stated.

        They are 0 for turns of a fixed point, which change no distance. None of positions: they determine
        their frame.
        """
        if self.distance is None:
            return None
        turn = 0.0 if self.normal is None else self.tilt
        return (*[self.fixed_sigma] * 3, *[turn] * 3, *[self.zero_sigma] * bool(self.zero_sigma))

    @property
    def equations(self) -> int:
        """Count the numbers that were read: three per position and orientation, one per distance."""
        return (3 if self.distance is None else 1) * int(self.seen.sum()) + 3 * int(self.oriented.sum())

    @property
    def quantile_95(self) -> float:
        """Return the 95 % quantile of chi squared: three degrees of freedom, or one for a distance [1]."""
        return 7.8147 if self.distance is None else 3.8415

    @property
    def rows(self) -> int:
        """Count the rows."""
        return len(self.row)

    @property
    def seen(self) -> Mask:
        """Tell which targets were read, (rows, m)."""
        if self.precision is None:
            return np.ones((self.rows, len(self.markers)), dtype=bool)
        return np.asarray(self.precision.any(axis=(2, 3)))

    @property
    def oriented(self) -> Mask:
        """Tell in which rows an orientation was read, (rows,)."""
        if self.rotation is None:
            return np.zeros(self.rows, dtype=bool)
        return np.asarray(np.isfinite(self.rotation).all(axis=(1, 2)))


def numbers_per_target(series: Sequence[Series]) -> float:
    """Compute the mean count of numbers per reading: a position has three, a distance has one.

    Args:
        series: Absolute readings of targets.

    Returns:
        Mean over all readings [1].
    """
    read = [(readings.distance is None, int(readings.seen.sum())) for readings in series]
    return sum((3 if position else 1) * n for position, n in read) / sum(n for _, n in read)


def series_of(data: Dataset, name: str, target: str) -> tuple[Series, ...]:
    """Convert deflection pairs to absolute readings: two rows per run, one pose; one series per station.

    Args:
        data: The pairs; their orientations are carried over.
        name: First part of every frame's name; the number of the station follows.
        target: Name of the mount.
    """
    stations = [1] if data.station is None else np.unique(data.station).tolist()
    every = [(station, select_rows(data, runs_of_station(data, station))) for station in stations]
    return tuple(
        _unloaded_and_loaded(station_runs, name, f"{name} {station}", target)
        for station, station_runs in every
    )


def _unloaded_and_loaded(data: Dataset, name: str, frame: str, target: str) -> Series:
    """Combine the unloaded and then the loaded readings of some runs."""
    rotation, doubled = None, select_rows(data, np.tile(np.arange(data.runs), 2))
    placed = (data.seen & ~data.lines)[..., None]  # a reading along a line is no position
    P = doubled.precision
    if P is not None and doubled.direction is not None:
        P = P * ~doubled.lines[..., None, None]
    if data.rotation_before is not None and data.rotation_after is not None:
        from scipy.spatial.transform import Rotation  # here: it takes long to import

        turns = np.concatenate([data.rotation_before, data.rotation_after])
        rotation = Rotation.from_rotvec(turns).as_matrix()
    return Series(
        name=name,
        markers=data.markers,
        frame=frame,
        target=target,
        row=doubled.run,
        pose=np.concatenate([np.arange(data.runs)] * 2),
        q=doubled.q,
        wrench=np.concatenate([np.zeros((data.runs, 6)), data.wrench]),
        point=doubled.point,
        position=np.concatenate([read * placed for read in (data.before, data.after)]),
        sigma=data.sigma,
        precision=None if P is None else 2 * P,  # that is of a deflection
        rotation=rotation,
        sigma_rotation=data.sigma_rotation,
    )
