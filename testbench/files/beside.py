"""Readings other than positions: orientations, torques, temperature, time, gauges, distances.

Notation of orientations that a file does not state: the one that fits the arm's kinematics.

Orientation and position of one target in n poses fit a notation if one frame X and one mount Y, m exist with

    C_i = X R_i Y,    p_i = t + X (x_i + R_i m),

where R_i, x_i are orientation and position of the drawn arm's tool. Then X R_i = C_i Y^T: of all pairs of
matrices those that come nearest follow from the largest singular value of the mean of R_i^T (x) C_i^T
(M. Shah, Solving the robot-world/hand-eye calibration problem using the Kronecker product, 2013). With X,
the vectors t and m are linear.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from testbench.arm.document import is_decimal
from testbench.arm.folder import Arm
from testbench.data.dataset import NOMINAL_FIXED_POINT_DEVIATION, NOMINAL_NORMAL_DEVIATION, select_evenly
from testbench.errors import Array, BenchError, Ids, InputError, Mask
from testbench.files.columns import Columns, ReadColumn
from testbench.files.names import ROTATIONS, WHEN, XYZ, Slot, What, columns_of, torque_columns
from testbench.files.rearranged import clock, seconds
from testbench.model.kinematics import build_vjm
from testbench.model.vjm import marker_positions, rotation_matrices, tool_points, tool_poses

# --- Readings other than positions: orientations in any notation, joint torques, temperature, time ----------

UNIT_NORM = 5e-3
"""Largest deviation of a quaternion's norm, or of a matrix times its transpose, from one [1]: rounding in a
file."""
MAX_RADIANS = 2.5 * np.pi
"""Largest angle [rad]: larger ones are in degrees."""
NOTATIONS = 'expected "intrinsic xyz", "extrinsic zyx" or the like, or "vector" for three angles'


class UnclearNotation(InputError):
    """Signal angles whose notation neither file nor map states, and the arm's kinematics do not tell.

    Args:
        columns: The table.
        problem: What was expected, and what fits.
    """

    def __init__(self, columns: Columns, problem: str) -> None:
        super().__init__(columns.names.path or columns.table.path, "series.rotation", problem)


def read_rotations(columns: Columns, notation: str = "") -> Array | None:
    """Read the orientation of the target in every row, tracker from target.

    Args:
        columns: The table.
        notation: What three angles are, if the map does not say it; "" if nobody knows.

    Returns:
        Rotation matrices, (rows, 3, 3), NaN in rows without one; None if no column states orientations.

    Raises:
        InputError: If the notation of angles is not stated, a component is missing, or a cell is no rotation.
    """
    found = [c for c in columns.all_of(*ROTATIONS) if not c.slot.when]
    if not found:
        return None
    kinds = sorted({c.slot.what for c in found})
    if len(kinds) > 1:
        raise columns.table.header_error(f"expected orientations in one notation, got {' and '.join(kinds)}")
    what = found[0].slot.what
    if what == "rotation":
        if not (notation := notation or _stated(columns, found)):
            raise UnclearNotation(columns, NOTATIONS)
        return _from_angles(columns, notation)
    own = columns.complete_set(columns_of(what))
    values, there = columns.together(own)
    read = _from_quaternions if what == "quaternion" else _from_matrices
    none = [1.0, 0, 0, 0] if what == "quaternion" else np.eye(3).ravel()
    rotation = read(columns, own[0].name, np.where(there[:, None], values, none))
    rotation[~there] = np.nan
    return rotation


def unsaid_angles(columns: Columns) -> tuple[Array, Mask, bool] | None:
    """Read three angles whose notation neither the map nor their names state.

    Args:
        columns: The table.

    Returns:
        The angles, (rows, 3) [rad], zero where there are none; which rows have them, (rows,); and whether
        they are named by their axes, not by their order. None if the notation is stated, or there are no
        angles.

    Raises:
        InputError: If one of the three is missing, or a cell is no angle.
    """
    found = [c for c in columns.all_of(*ROTATIONS) if not c.slot.when]
    if {c.slot.what for c in found} != {"rotation"} or _stated(columns, found):
        return None
    angles, there = _angles(columns, found)
    return angles, there, found[0].slot.index < len(XYZ)


def _angles(columns: Columns, found: list[ReadColumn]) -> tuple[Array, Mask]:
    """Read three angles, (rows, 3) [rad], zero where there are none, and which rows have them, (rows,)."""
    first = found[0].slot.index // 3 * 3
    ours = "123" if first else "xyz"
    own = columns.complete_set({f"rotation_{x}_rad": Slot("rotation", first + k) for k, x in enumerate(ours)})
    angles, there = columns.together(own)

    def problem(row: int, k: int) -> str:
        unit = own[k].unit
        hint = "; are these degrees?" if unit and unit.name == "rad" else ""
        return f"expected an angle of at most {MAX_RADIANS:.2f} rad, got {angles[row, k]:g} rad{hint}"

    columns.table.refuse(np.abs(angles) > MAX_RADIANS, [column.name for column in own], problem)
    angles[~there] = 0
    return angles, there


def _from_angles(columns: Columns, notation: str) -> Array:
    """Convert three angles in a notation."""
    found = [c for c in columns.all_of("rotation") if not c.slot.when]
    angles, there = _angles(columns, found)
    by_axis = found[0].slot.index < len(XYZ)
    axes = notation.rpartition(" ")[2]
    if notation != "vector" and axes[1] in (axes[0], axes[2]):
        raise columns.map_error("series.rotation", f"no Euler angles {axes!r}")
    if notation != "vector" and by_axis and len(set(axes)) < len(axes):
        missing = ["rotation_1_rad", "rotation_2_rad", "rotation_3_rad"]
        raise columns.lack(missing, f"; name the angles of {axes} by their order")
    rotation = _turned(angles, notation, by_axis=by_axis)
    rotation[~there] = np.nan
    return rotation


def _turned(angles: Array, notation: str, *, by_axis: bool) -> Array:
    """Convert three angles in a notation, named by their axes or by their order, to matrices."""
    if notation == "vector":
        return rotation_matrices(angles)
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few files need it

    kind, axes = notation.split()
    if by_axis:
        angles = angles[:, [XYZ.index(axis) for axis in axes]]
    return np.asarray(Rotation.from_euler(axes.upper() if kind == "intrinsic" else axes, angles).as_matrix())


def _stated(columns: Columns, found: list[ReadColumn]) -> str:
    """Return the map's notation, or "vector" for our own rotation_x, y, z; "" for other angles."""
    ours = all(column.slot.index < len(XYZ) and not columns.names.maps(column.name) for column in found)
    return columns.names.map.series.rotation or ("vector" if ours else "")


def _from_quaternions(columns: Columns, name: str, values: Array) -> Array:
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few files need it

    norm = np.linalg.norm(np.clip(values, -MAX_RADIANS, MAX_RADIANS), axis=1)
    columns.table.refuse(
        np.abs(norm - 1) > UNIT_NORM,
        name,
        lambda row: f"expected a unit quaternion, got one of norm {norm[row]:.4g}",
    )
    return np.asarray(Rotation.from_quat(values[:, [1, 2, 3, 0]]).as_matrix())


def _from_matrices(columns: Columns, name: str, values: Array) -> Array:
    R = np.clip(values.reshape(-1, 3, 3), -MAX_RADIANS, MAX_RADIANS)
    off, det = np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0), np.linalg.det(R)

    def problem(row: int) -> str:
        differs = f"R R^T differs from 1 by {off[row]:.2g}, det R is {det[row]:.3g}"
        return f"expected a rotation matrix, {differs}"

    columns.table.refuse((off > UNIT_NORM) | (det < 0), name, problem)
    U, _, V = np.linalg.svd(R)
    return np.asarray(U @ V)


def read_torques(columns: Columns, arm: Arm) -> Array | None:
    """Read the torques of the chain's joints.

    Args:
        columns: The columns of the file.
        arm: The arm.

    Returns:
        Torques, (rows, n) [N m, N]; None without such columns.

    Raises:
        InputError: If a joint has none, or joints follow others: their torques cannot be separated.
    """
    found = columns.complete_set(torque_columns(arm))
    torque = np.column_stack([columns.full(column) for column in found]) if found else None
    try:
        return torque if torque is None or not arm.joint_map else arm.joint_map.to_chain_torques(torque)
    except BenchError as err:
        raise columns.table.header_error(str(err)) from err


def read_temperature(columns: Columns) -> tuple[Array | None, list[str]]:
    """Read the temperature of every row; a cell that is no number never makes the file refused.

    Args:
        columns: The table.

    Returns:
        Temperatures, (rows,) [degree Celsius], or None; and a note if a cell is no number.
    """
    column = columns.found.get(Slot("temperature"))
    if column is None:
        return None, []
    return _if_full(columns, column)


def read_time(columns: Columns) -> tuple[Array | None, list[str]]:
    """Read the time of every row; cells that are no times never make the file refused.

    Args:
        columns: The table.

    Returns:
        Times, (rows,) [s], or None; and a note if the cells are no times. Seconds are taken as they are;
        dates and times count from the first row.
    """
    counted, stamp = columns.found.get(Slot("time", 1)), columns.found.get(Slot("time"))
    if counted is not None:
        return _if_full(columns, counted)
    if stamp is None:
        return None, []
    texts = columns.table.texts(stamp.index)
    values = clock(texts)
    counted_in = is_decimal(texts[0]) and seconds(texts[0]) is None  # minutes, perhaps
    if values is not None and not counted_in and (np.ptp(values) > 0 or len(texts) == 1):
        return values - values[0], []
    wrong = next((text for text in texts if seconds(text) is None), texts[0])
    problem = "expected times that differ, such as 20200714163904 or 2020-07-14 16:39:04"
    return None, [f"{stamp.name}: {problem}, got {wrong[:40]!r}; times are not read"]


def _if_full(columns: Columns, column: ReadColumn) -> tuple[Array | None, list[str]]:
    """Read a column of numbers, (rows,), or explain why it is not read: it never makes a file refused."""
    try:
        return columns.full(column), []
    except InputError:
        return None, [f"{column.name}: a row has no number, so this column is not read"]


# --- Readings along lines in a file: travels of gauges and distances to fixed points, one marker per row ----

TILT, FIXED = np.radians(0.5), 1e-3
"""Standard deviations of a gauge's direction [rad] and of a fixed point [m] if the file states none."""
FAR = 1.0
"""Travel that no gauge has, though a touch probe may count it from the base [m]."""
MAX_TILT, MAX_FIXED, MAX_ZERO = np.radians(10), 0.1, 10.0
"""Largest of these, and of a constant in distances, that are accepted [rad, m, m]: beyond them a unit is
wrong."""


@dataclass(frozen=True)
class FileLines:
    """Hold the readings along lines of a table; rows of positions hold none."""

    number: Array  #: Readings unloaded and loaded, (rows, 2) [m]; NaN in other rows, or where lost.
    gauge: Mask  #: Rows of gauges, (rows,).
    meter: Mask  #: Rows of distances, (rows,).
    direction: Array  #: Directions of gauges, unit vectors, (rows, 3) [1]; the x axis in other rows.
    tilt: Array  #: Their standard deviations, (rows,) [rad].
    fixed: Array  #: Fixed points of distances, (rows, 3) [m]; NaN in other rows.
    fixed_sigma: Array  #: Their standard deviations, (rows,) [m].
    by_state: bool  #: Whether a row holds the reading of one state; the number of the other one is NaN.
    notes: tuple[str, ...]  #: Assumptions that were made.

    @property
    def rows(self) -> Mask:
        """Tell which rows are readings along lines, (rows,)."""
        return self.gauge | self.meter


def read_lines(columns: Columns, loaded: Mask) -> FileLines | None:
    """Read travels and distances.

    Args:
        columns: The columns of the file.
        loaded: Whether the arm was loaded, (rows,), where each row holds one state.

    Returns:
        The readings; None without columns for them.

    Raises:
        InputError: Names line and column, and what was expected.
    """
    if not columns.all_of("travel", "distance"):
        return None
    table, notes = columns.table, list[str]()
    travel, distance = _numbers(columns, "travel"), _numbers(columns, "distance")
    if one_state := columns.found.get(Slot("travel")):
        values = columns.values(one_state)
        travel = np.array([np.where(loaded == state, values, np.nan) for state in (False, True)])
    # What a row is: the one of the two kinds whose direction or fixed point it states.
    (fixed, name), (direction, gauge) = _triple(columns, "fixed"), _directions(columns)
    meter = np.asarray(np.isfinite(fixed).all(axis=1))
    table.refuse(gauge & meter, name, "expected a direction or a fixed point, got both")
    for read, own, what in (
        (travel, gauge, "direction_x, _y and _z"),
        (distance, meter, "fixed_x, _y and _z"),
    ):
        stray = np.asarray(np.isfinite(read).any(axis=0) & ~own)
        table.refuse(stray, "", f"expected {what} of this reading")
    direction = np.where(gauge[:, None], direction, (1.0, 0.0, 0.0))
    far = np.asarray((np.abs(travel) > FAR).any(axis=0) & gauge)
    everywhere = np.linalg.matrix_rank(direction[gauge]) == len(XYZ)
    problem = "expected travels of gauges, got readings as large as positions, along x, y and z"
    hint = "if they are positions, state the columns of axis, before and after in [columns] of a map"
    table.refuse(far & everywhere, "", f"{problem}; {hint}")
    tilt = _deviation(columns, "tilt", gauge, (TILT, MAX_TILT), notes)
    fixed_sigma = _deviation(columns, "fixed_sigma", meter, (FIXED, MAX_FIXED), notes)
    number = np.where(gauge, travel, np.where(meter, distance, np.nan)).T
    kinds = (
        f"{gauge.sum()} travels of gauges" * bool(gauge.any()),
        f"{meter.sum()} distances" * bool(meter.any()),
    )
    notes.insert(0, f"{' and '.join(filter(None, kinds))}: each is one number, along a line")
    by_state = one_state is not None
    return FileLines(number, gauge, meter, direction, tilt, fixed, fixed_sigma, by_state, tuple(notes))


@dataclass(frozen=True)
class FixedPoints:
    """Hold the fixed points and planes of distances in absolute readings."""

    place: Array  #: Where each is stated, a point of a plane, world axes, (rows, 3) [m].
    sigma: Array  #: Standard deviation along each axis, (rows,) [m].
    normal: Array  #: Normals of planes, unit vectors, world axes, (rows, 3) [1]; NaN for points.
    tilt: Array  #: Standard deviation of a normal about each axis, (rows,) [rad].
    zero_sigma: Array  #: That of a constant in all distances from a point, (rows,) [m].
    notes: tuple[str, ...]  #: Assumptions that were made.


def read_fixed_points(columns: Columns) -> FixedPoints:
    """Read the fixed point or the plane of every distance of absolute readings.

    A calibration finds it: in the axes of its model it is millimetres from where the base has it. So its
    standard deviations are at least `NOMINAL_FIXED_POINT_DEVIATION` and `NOMINAL_NORMAL_DEVIATION`.

    Args:
        columns: The columns of the file.

    Returns:
        The fixed points.

    Raises:
        InputError: If a row has none, an uncertainty is absurd, or a distance is not positive.
    """
    table = columns.table
    fixed, name = _triple(columns, "fixed")
    if not name:
        raise columns.lack([*columns_of("fixed")])
    blank = np.asarray(np.isnan(fixed).any(axis=1))
    table.refuse(blank, name, "expected the fixed point of this distance, got ''")
    notes = list[str]()
    sigma = _deviation(columns, "fixed_sigma", ~blank, (NOMINAL_FIXED_POINT_DEVIATION, MAX_FIXED), notes)
    # A row with a direction is of a plane.
    normal, plane = _directions(columns)
    tilt = _deviation(columns, "tilt", plane, (NOMINAL_NORMAL_DEVIATION, MAX_TILT), notes)
    zero = np.zeros(table.rows)
    if columns.source_of(Slot("zero_sigma")) is not None:
        zero = _deviation(columns, "zero_sigma", ~plane, (0.0, MAX_ZERO), notes)
    column = columns.found.get(Slot("distance"))
    read = np.full(table.rows, np.nan) if column is None else columns.values(column)
    problem = "expected more than 0, got {:g} m; a height over a plane needs a direction (x, y, z)"
    table.refuse(
        np.asarray((read <= 0) & ~plane & (zero == 0)),
        "" if column is None else column.name,
        lambda row: problem.format(read[row]),
    )
    return FixedPoints(
        place=fixed,
        sigma=np.maximum(sigma, NOMINAL_FIXED_POINT_DEVIATION),
        normal=normal,
        tilt=np.maximum(tilt, NOMINAL_NORMAL_DEVIATION),
        zero_sigma=zero,
        notes=tuple(notes),
    )


def _numbers(columns: Columns, what: What) -> Array:
    """Read a quantity unloaded and loaded, (2, rows) [m]; a gauge without unloaded readings was zeroed."""
    unloaded, loaded = (columns.found.get(Slot(what, when=when)) for when in WHEN)
    if loaded is None and unloaded is None:
        return np.full((2, columns.table.rows), np.nan)
    if loaded is None or (unloaded is None and what == "distance"):
        raise columns.lack([f"{what}_{'after' if loaded is None else 'before'}_m"])
    last = columns.values(loaded)
    first = np.where(np.isnan(last), np.nan, 0.0) if unloaded is None else columns.values(unloaded)
    return np.array([first, last])


def _triple(columns: Columns, what: What) -> tuple[Array, str]:
    """Read a vector, (rows, 3), NaN where blank or missing; and the name of its first column, or ""."""
    found = columns.complete_set(columns_of(what))
    if not found:
        return np.full((columns.table.rows, 3), np.nan), ""
    return columns.together(found)[0], found[0].name


def _directions(columns: Columns) -> tuple[Array, Mask]:
    """Read directions of gauges or normals of planes, unit vectors, (rows, 3), and which rows have one."""
    vector, name = _triple(columns, "direction")
    length = np.linalg.norm(vector, axis=1)
    columns.table.refuse(length == 0, name, "expected a direction, got 0, 0, 0")
    return vector / length[:, None], np.asarray(np.isfinite(vector).all(axis=1))


def _deviation(
    columns: Columns, what: What, own: Mask, usual: tuple[float, float], notes: list[str]
) -> Array:
    """Read a standard deviation, (rows,), 0 in other rows; the usual one where nothing states it."""
    source = columns.source_of(Slot(what))
    value = np.nan if source is None else source
    stated = columns.values(value) if isinstance(value, ReadColumn) else np.full(len(own), value)
    if (missing := own & np.isnan(stated)).any():
        point = f"{1e3 * usual[0]:g} mm for the fixed point"
        words = {"tilt": "0.5 deg for the direction", "fixed_sigma": point, "zero_sigma": "no constant"}[what]
        notes.append(f"{missing.sum()} rows have no stated uncertainty: {words} is assumed")
    values = np.where(own, np.where(np.isnan(stated), usual[0], stated), 0.0)
    name = source.name if isinstance(source, ReadColumn) else what
    bad = ~((values >= 0) & (values <= usual[1]))
    columns.table.refuse(bad, name, lambda row: f"expected 0 to {usual[1]:.3g} rad or m, got {values[row]:g}")
    return values


def place_lines(
    lines: FileLines, arm: Arm, names: tuple[str, ...], q: Array, at: tuple[Ids, Ids]
) -> tuple[Array, Array, Array]:
    """Arrange directions by run and marker; those of distances are towards the marker of the rigid arm.

    Args:
        lines: The readings.
        arm: The arm that was measured.
        names: Markers of the runs, m of them.
        q: Joints of the runs, (runs, n) [rad, m].
        at: Run and marker of every row, (rows,) each.

    Returns:
        Unit vectors, (runs, m, 3) [1], zero for positions and without an instrument; their standard
        deviations, (runs, m) [rad]; and lengths of distances, (runs, m) [m], 0 for gauges.
    """
    shape = len(q), len(names)
    direction = np.zeros((*shape, 3))
    tilt = np.zeros(shape)
    reach = np.zeros(shape)
    direction[at] = np.where(lines.gauge[:, None], lines.direction, 0.0)
    tilt[at] = lines.tilt
    if lines.meter.any():
        vjm = build_vjm(arm)
        beam = tool_points(vjm, q, marker_positions(vjm, names))[at] - lines.fixed
        length = np.linalg.norm(beam, axis=1)
        own = lines.meter
        runs, markers = at[0][own], at[1][own]
        direction[runs, markers] = beam[own] / length[own, None]
        reach[runs, markers] = length[own]
        tilt[runs, markers] = lines.fixed_sigma[own] / length[own]
    return direction, tilt, reach


# --- Notation of orientations that a file does not state: the one that fits the arm's kinematics ------------

MOST_ANGLE = np.radians(2.0)  #: RMS angle up to which orientations fit the drawn arm [rad].
MOST_DISTANCE = 0.02  #: RMS distance of positions up to which they fit it, over its reach [1].
CLEAR = 3.0  #: A notation is taken if the next one fits so many times worse [1].
SAME = 1e-6  #: Difference of two matrices that counts as none [1].
MIN_POSES = 4  #: Fewest poses from which a notation is found.
LOOKED_AT = 300  #: Most poses that are used.
ORDERS = tuple(
    "".join(axes) for axes in product(XYZ, repeat=3) if axes[0] != axes[1] != axes[2]
)  #: The 12 orders of Euler angles.


@dataclass(frozen=True)
class OrientationFit:
    """Hold how well orientations in one notation fit the drawn arm."""

    notation: str  #: As a map states it, such as "intrinsic zyx".
    angle: float  #: RMS angle between read and drawn orientations [rad].
    distance: float  #: RMS distance between read and drawn positions [m].
    score: float  #: Root of the sum of the squares of both over what fits: 1 or less fits [1].

    def __str__(self) -> str:
        """Write the notation with its two numbers."""
        return f"{self.notation} ({np.degrees(self.angle):.2g} deg, {1e3 * self.distance:.2g} mm)"


def notations(angles: Array, by_axis: bool) -> dict[str, Array]:
    """Convert three angles by every notation.

    Args:
        angles: Three angles of each pose, (poses, 3) [rad].
        by_axis: Whether the angles are named by their axes x, y, z, not by their order.

    Returns:
        Rotation matrices, (poses, 3, 3), by the notation as a map states it. Of notations that give the same
        for these angles, there is only the first.
    """
    found = {"vector": _turned(angles, "vector", by_axis=by_axis)}
    for kind, order in product(("intrinsic", "extrinsic"), ORDERS):
        if by_axis and order[0] == order[2]:
            continue
        rotation = _turned(angles, f"{kind} {order}", by_axis=by_axis)
        if all(np.abs(rotation - other).max() > SAME for other in found.values()):
            found[f"{kind} {order}"] = rotation
    return found


def fits_of(arm: Arm, q: Array, position: Array, tried: Mapping[str, Array]) -> list[OrientationFit]:
    """Fit frame and mount to poses of a target, for orientations in several notations.

    Args:
        arm: The arm; its drawn geometry counts.
        q: Joints of the chain, (poses, n) [rad, m].
        position: Positions of the target, (poses, 3) [m].
        tried: Orientations, (poses, 3, 3), by notation.

    Returns:
        The fits, the best first.
    """
    vjm = build_vjm(replace(arm, markers=()))
    some = select_evenly(np.arange(len(q)), LOOKED_AT)
    x, R = tool_poses(vjm, q[some])
    fits = []
    for notation, rotation in tried.items():
        angle, distance = _misfit(x, R, position[some], rotation[some])
        score = float(np.hypot(angle / MOST_ANGLE, distance / (MOST_DISTANCE * vjm.reach)))
        fits.append(OrientationFit(notation, angle, distance, score))
    return sorted(fits, key=lambda fit: fit.score)


def _misfit(x: Array, R: Array, position: Array, C: Array) -> tuple[float, float]:
    """RMS angle [rad] and distance [m] of read poses from those of the drawn tool, frame and mount fitted."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few files need it

    # X and Y^T: the pair of matrices with the largest mean of R^T (x) C^T, each made a rotation
    K = np.einsum("nrp,nsq->pqrs", R, C).reshape(9, 9) / len(R)
    left, _, right = np.linalg.svd(K)
    X, Y_T = (_nearest(own.reshape(3, 3).T) for own in (right[0], left[:, 0]))
    off = np.swapaxes(C, 1, 2) @ X @ R @ Y_T.T
    angle = np.sqrt((Rotation.from_matrix(off).magnitude() ** 2).mean())
    # t and m: linear in both
    A = np.concatenate([np.broadcast_to(np.eye(3), R.shape), X @ R], axis=2).reshape(-1, 6)
    left_over = (position - x @ X.T).reshape(-1)
    left_over = left_over - A @ np.linalg.lstsq(A, left_over)[0]
    return float(angle), float(np.sqrt((left_over**2).sum() / len(R)))


def _nearest(matrix: Array) -> Array:
    """The rotation nearest to a multiple of a matrix, whose sign is free."""
    U, _, V = np.linalg.svd(matrix)
    return np.asarray(np.linalg.det(U @ V).round() * (U @ V))


def clear_fit(fits: Sequence[OrientationFit]) -> OrientationFit | None:
    """Choose the notation that fits, if it fits clearly better than all others.

    Args:
        fits: Fits of notations, the best first.

    Returns:
        The best one; None if it does not fit, or the next one is nearly as good.
    """
    best, *others = fits
    if best.score > 1 or (others and others[0].score < CLEAR * best.score):
        return None
    return best


def unclear(fits: Sequence[OrientationFit]) -> str:
    """Say why no notation is taken: which ones fit, or that none does.

    Args:
        fits: Fits of notations, the best first.

    Returns:
        A sentence without a full stop.
    """
    best = fits[0]
    if best.score > 1:
        return f"no notation fits the nominal arm; the nearest is {best}"
    alike = [fit for fit in fits if fit.score <= max(1.0, CLEAR * best.score)]
    return f"several notations fit the nominal arm: {', '.join(map(str, alike))}"
