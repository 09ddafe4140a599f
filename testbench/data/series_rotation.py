"""Orientations of a target in any notation, as matrices: rotation vectors, Euler angles, quaternions."""

import numpy as np

from testbench.data.columns import Column, Columns
from testbench.data.dataset import Ids, Mask
from testbench.data.names import ROTATIONS, XYZ, Slot
from testbench.errors import Array, InputError

UNIT_NORM = 5e-3
"""How far a quaternion's norm, or a matrix times its transpose, may be from one [1]: rounding in a file."""
MOST = 2.5 * np.pi  #: Angles beyond it are in degrees [rad].
PARTS = {"quaternion": tuple("wxyz"), "matrix": tuple(f"{i}{j}" for i in "123" for j in "123")}


def read_rotations(columns: Columns) -> Array | None:
    """Orientation of the target in every row, the tracker from the target, (rows, 3, 3).

    Returns:
        All NaN in rows where it is blank; None where no column says it.

    Raises:
        InputError: When the notation is not said or a part is missing, and at what is no rotation.
    """
    found = [c for c in columns.every(*ROTATIONS) if not c.slot.when]
    if not found:
        return None
    kinds = sorted({c.slot.what for c in found})
    if len(kinds) > 1:
        problem = f"expected orientations in one notation, got {' and '.join(kinds)}"
        raise InputError(columns.table.path, f"line {columns.table.header}", problem)
    if kinds == ["rotation"]:
        return _from_angles(columns, found)
    what, parts = found[0].slot.what, PARTS[kinds[0]]
    own = [columns.get(Slot(what, k)) for k in range(len(parts))]
    name = "quaternion" if what == "quaternion" else "rotation"
    values, there = _full(columns, own, [f"{name}_{part}" for part in parts])
    read = _from_quaternions if what == "quaternion" else _from_matrices
    return _placed(read(columns, own[0], values[there], np.flatnonzero(there)), there)


def _full(columns: Columns, found: list[Column | None], names: list[str]) -> tuple[Array, Mask]:
    """Columns as an array, (rows, k), and which rows have them; a row has all or none."""
    missing = [name for name, column in zip(names, found, strict=True) if column is None]
    if missing:
        raise columns.lack(missing)
    known = [column for column in found if column is not None]
    values = np.column_stack([columns.values(column) for column in known])
    blank = np.isnan(values)
    part = np.argwhere(blank & ~blank.all(axis=1, keepdims=True))
    if len(part):
        raise columns.table.error(part[0, 0], known[part[0, 1]].name, "expected a finite number, got ''")
    return values, ~blank[:, 0]


def _from_angles(columns: Columns, found: list[Column]) -> Array:
    """Of three angles in the notation of the map, or a rotation vector under our own names."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few files need it

    notation = columns.names.series.rotation or _unsaid(columns, found)
    order = [found[0].slot.index // 3 * 3 + k for k in range(3)]
    ours = "123" if order[0] else "xyz"
    own = [columns.get(Slot("rotation", k)) for k in order]
    angles, there = _full(columns, own, [f"rotation_{k}_rad" for k in ours])
    far = np.argwhere(np.abs(angles) > MOST)
    if len(far):
        row, column = far[0, 0], own[far[0, 1]]
        hint = "; are these degrees?" if column and column.unit and column.unit.name == "rad" else ""
        problem = f"expected an angle of at most {MOST:.2f} rad, got {angles[tuple(far[0])]:g} rad{hint}"
        raise columns.table.error(row, column.name if column else "", problem)
    if notation == "vector":
        return _placed(Rotation.from_rotvec(angles[there]).as_matrix(), there)
    kind, axes = notation.split()
    if axes[1] in (axes[0], axes[2]):
        raise InputError(
            columns.names.path or columns.table.path, "series.rotation", f"no Euler angles {axes!r}"
        )
    if order[0] == 0:  # named by their axes
        if len(set(axes)) < len(axes):
            missing = ["rotation_1_rad", "rotation_2_rad", "rotation_3_rad"]
            raise columns.lack(missing, f"; the angles {axes} are named by their order")
        angles = angles[:, [XYZ.index(axis) for axis in axes]]
    axes = axes.upper() if kind == "intrinsic" else axes
    return _placed(Rotation.from_euler(axes, angles[there]).as_matrix(), there)


def _unsaid(columns: Columns, found: list[Column]) -> str:
    """Our own rotation_x, y, z are a rotation vector; what others call angles must be said."""
    if all(column.slot.index < len(XYZ) and not columns.names.maps(column.name) for column in found):
        return "vector"
    problem = 'expected "intrinsic xyz", "extrinsic zyx" or the like, or "vector", for three angles'
    raise InputError(columns.names.path or columns.table.path, "series.rotation", problem)


def _from_quaternions(columns: Columns, column: Column | None, values: Array, rows: Ids) -> Array:
    from scipy.spatial.transform import Rotation  # here: the same

    norm = np.linalg.norm(np.clip(values, -MOST, MOST), axis=1)
    bad = np.flatnonzero(np.abs(norm - 1) > UNIT_NORM)
    if len(bad):
        problem = f"expected a unit quaternion, got one of norm {norm[bad[0]]:.4g}"
        raise columns.table.error(int(rows[bad[0]]), column.name if column else "", problem)
    return np.asarray(Rotation.from_quat(values[:, [1, 2, 3, 0]]).as_matrix())


def _from_matrices(columns: Columns, column: Column | None, values: Array, rows: Ids) -> Array:
    R = np.clip(values.reshape(-1, 3, 3), -MOST, MOST)
    off = np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    bad = np.flatnonzero((off > UNIT_NORM) | (np.linalg.det(R) < 0))
    if len(bad):
        problem = f"expected a rotation matrix, R R^T differs from 1 by {off[bad[0]]:.2g}, det R is "
        problem += f"{np.linalg.det(R[bad[0]]):.3g}"
        raise columns.table.error(int(rows[bad[0]]), column.name if column else "", problem)
    U, _, V = np.linalg.svd(R)
    return np.asarray(U @ V)


def _placed(R: Array, there: Mask) -> Array:
    """Rotations of some rows in the place of each, (rows, 3, 3); NaN in the others."""
    placed = np.full((len(there), 3, 3), np.nan)
    placed[there] = R
    return placed
