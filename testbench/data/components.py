"""Vectors and masses that a table gives row by row; a number that only another unit explains is refused."""

from collections.abc import Sequence

import numpy as np

from testbench.data.columns import Column, Columns
from testbench.data.names import SI, XYZ, Slot, What
from testbench.errors import Array, InputError

FARTHEST: dict[What, float] = {
    "force": 1e6,
    "moment": 1e6,
    "process": 1e6,
    "mass": 1e5,
    "point": 10.0,
    "set_point": 100.0,
}
"""Largest components [N, N m, N, kg, m, m]; beyond them a unit is a slip."""


def vector(columns: Columns, what: What) -> Array | None:
    """A vector of every row, (rows, 3), zero for whichever of x, y, z is missing; None without any.

    Raises:
        InputError: Where a part is blank or too large.
    """
    return components(columns, what, [columns.get(Slot(what, k)) for k in range(len(XYZ))])


def components(columns: Columns, what: What, found: Sequence[Column | None]) -> Array | None:
    """Some columns in SI units, or the map's constants for them, zero for what neither says.

    Args:
        columns: The table.
        what: The quantity.
        found: The column of each of its components, k of them.

    Returns:
        (rows, k); None where neither file nor map says any.

    Raises:
        InputError: At the first cell that is blank or too large.
    """
    stated = [columns.constant(Slot(what, k)) for k in range(len(found))]
    if all(x is None for x in (*found, *stated)):
        return None
    rows, most = columns.table.rows, FARTHEST[what]
    parts = [columns.full(c) if c else np.full(rows, x or 0.0) for c, x in zip(found, stated, strict=True)]
    values = np.column_stack(parts)
    far = np.argwhere(np.abs(values) > most)
    if len(far):
        i, k = far[0]
        problem = f"expected {-most:g} to {most:g} {SI[what][0]}, got {values[i, k]:g}"
        column = found[k]
        if column is None:
            raise InputError(columns.names.path or columns.table.path, "values", problem)
        raise columns.table.error(i, column.name, problem)
    return values
