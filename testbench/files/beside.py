"""Readings other than positions: orientations in any notation, joint torques, temperature, time."""

import re

import numpy as np

from testbench.arm.document import is_decimal
from testbench.arm.folder import Arm
from testbench.errors import Array, BenchError, InputError, Mask
from testbench.files.columns import Columns, ReadColumn
from testbench.files.names import ROTATIONS, XYZ, Slot, columns_of, torque_columns
from testbench.files.rearranged import clock, seconds

UNIT_NORM = 5e-3
"""Largest deviation of a quaternion's norm, or of a matrix times its transpose, from one [1]: rounding in a
file."""
MAX_RADIANS = 2.5 * np.pi
"""Largest angle [rad]: larger ones are in degrees."""
NOTATIONS = 'expected "intrinsic xyz", "extrinsic zyx" or the like, or "vector" for three angles'
ROUNDED = re.compile(r"\d([.,]\d*)?[eE]\+?13|\d{6}0{8}")
"""Time rounded by a spreadsheet, such as 2,02011E+13: its hour is lost."""


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
        return _from_angles(columns, notation or _stated(columns, found) or _unsaid(columns))
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
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few files need it

    found = [c for c in columns.all_of("rotation") if not c.slot.when]
    angles, there = _angles(columns, found)
    if notation == "vector":
        rotation = Rotation.from_rotvec(angles).as_matrix()
    else:
        kind, axes = notation.split()
        if axes[1] in (axes[0], axes[2]):
            raise columns.map_error("series.rotation", f"no Euler angles {axes!r}")
        if found[0].slot.index < len(XYZ):  # named by their axes
            if len(set(axes)) < len(axes):
                missing = ["rotation_1_rad", "rotation_2_rad", "rotation_3_rad"]
                raise columns.lack(missing, f"; the angles {axes} are named by their order")
            angles = angles[:, [XYZ.index(axis) for axis in axes]]
        order = axes.upper() if kind == "intrinsic" else axes
        rotation = Rotation.from_euler(order, angles).as_matrix()
    rotation[~there] = np.nan
    return np.asarray(rotation)


def _stated(columns: Columns, found: list[ReadColumn]) -> str:
    """Return the map's notation, or "vector" for our own rotation_x, y, z; "" for other angles."""
    ours = all(column.slot.index < len(XYZ) and not columns.names.maps(column.name) for column in found)
    return columns.names.map.series.rotation or ("vector" if ours else "")


def _unsaid(columns: Columns) -> str:
    """Refuse angles whose notation nobody knows."""
    raise UnclearNotation(columns, f"{NOTATIONS}")


def _from_quaternions(columns: Columns, name: str, values: Array) -> Array:
    from scipy.spatial.transform import Rotation  # here: the same

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
        return torque if torque is None or not arm.joint_map else arm.joint_map.torque_to_model(torque)
    except BenchError as err:
        raise columns.table.header_error(str(err)) from err


def read_temperature(columns: Columns) -> tuple[Array | None, list[str]]:
    """Read the temperature of every row; a cell that is no number never makes the file refused.

    Args:
        columns: The table.

    Returns:
        Temperatures, (rows,) [degree Celsius], or None; and a note if a cell is no number.
    """
    column = columns.get(Slot("temperature"))
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
    counted, stamp = columns.get(Slot("time", 1)), columns.get(Slot("time"))
    if counted is not None:
        return _if_full(columns, counted)
    if stamp is None:
        return None, []
    texts = columns.table.texts(stamp.index)
    values = clock(texts)
    counted_in = is_decimal(texts[0]) and seconds(texts[0]) is None  # minutes, perhaps
    if values is not None and not counted_in and (np.ptp(values) > 0 or len(texts) == 1):
        return values - values[0], []
    wrong = next((text for text in texts if seconds(text) is None), None)
    if wrong is not None and ROUNDED.fullmatch(wrong):
        return None, [f"{stamp.name}: {wrong!r} is a time that a spreadsheet rounded: no time is read"]
    got = f"{wrong[:40]!r}" if wrong is not None else f"{texts[0][:40]!r} in every row"
    return None, [f"{stamp.name}: expected 20200714163904 or 2020-07-14 16:39:04, got {got}: no time is read"]


def _if_full(columns: Columns, column: ReadColumn) -> tuple[Array | None, list[str]]:
    """Read a column of numbers, (rows,), or explain why it is not read: it never makes a file refused."""
    try:
        return columns.full(column), []
    except InputError:
        return None, [f"{column.name}: blank or no number in a row, not read"]
