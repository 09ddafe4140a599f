"""Contents of a file of measured runs: columns by quantity, loads, lost targets, how far targets move."""

from collections.abc import Iterator

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset
from testbench.errors import Array, Ids
from testbench.files.columns import Columns, ReadColumn
from testbench.files.names import What
from testbench.files.read_pairs import Export
from testbench.identify.registered import RegisteredDataset
from testbench.model.vjm import marker_points, tool_points, tool_pose
from testbench.runs.rows import Row
from testbench.workflows.rows import MM, UM

CALLED: dict[What, str] = {
    "reading": "position",
    "point": "load point",
    "covariance": "covariance",
    "rotation": "orientation",
    "tilt": "uncertainty of the direction",
    "fixed": "fixed point",
    "fixed_sigma": "uncertainty of the fixed point",
}
"""What people call the quantities with another name of theirs."""
LISTED = 4  #: Words of a column that are listed.


def contents(export: Export) -> Row:
    """Collect what is in a file before any frame is found; keys of report.json.

    Args:
        export: The file as it was read.
    """
    data, table = export.data, export.columns.table
    size = np.where(data.seen, MM * np.linalg.norm(data.deflection, axis=-1), np.nan)
    known = size[data.seen]
    least, median, most = np.quantile(known, [0, 0.5, 1]).tolist() if len(known) else [np.nan] * 3
    downward = (data.wrench[:, [0, 1, 3, 4, 5]] == 0).all() and (data.wrench[:, 2] <= 0).all()
    return Row(
        columns=list(column_rows(export.columns)),
        ignored=export.columns.ignored,
        rows=table.rows,
        runs=data.runs,
        poses=len(np.unique(data.pose)),
        stations=1 if data.station is None else len(np.unique(data.station)),
        markers=data.markers,
        targets=int((data.seen | data.lost).sum()),
        lost=[_where(data, i, k) for i, k in np.argwhere(data.lost)],
        without=list(_without_instrument(data)),
        loads=_loads(data, hung=bool(downward)),
        deflection_mm=Row(least=least, median=median, most=most),
        farthest=_where(data, *np.argwhere(size == most)[0]) if len(known) else "",
        sigma_um=UM * data.sigma,
        notes=[*table.notes, *export.notes],
    )


def _without_instrument(data: Dataset) -> Iterator[str]:
    """Name the markers that no instrument reads, in any run or in some."""
    without = ~data.seen & ~data.lost
    never = without.all(axis=0)
    yield from (data.markers[k] for k in np.flatnonzero(never))
    yield from (_where(data, i, k) for i, k in np.argwhere(without & ~never))


def _where(data: Dataset, run: int, marker: int) -> str:
    return f"{data.markers[marker]} in run {data.run[run]}"


def _loads(data: Dataset, *, hung: bool) -> list[str]:
    """Loads that differ in their sizes by more than rounding, the smallest first."""
    sizes = np.linalg.norm(data.wrench.reshape(-1, 2, 3), axis=-1).round(6)
    values, counts = np.unique(sizes, axis=0, return_counts=True)
    return [
        f"{force:.5g} N"
        + (f" and {moment:.5g} N m" if moment else "")
        + (f" (as of {force / GRAVITY:.5g} kg hung)" if hung and force else "")
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
    ends = dict.fromkeys(f"{x:.5g}" for x in (known.min(), known.max())) if len(known) else ["none"]
    return " to ".join(ends)


def farthest_off(registered: RegisteredDataset) -> Row | None:
    """Find the unloaded reading that fits the arm without sag worst, and how far it is off [mm]."""
    data = registered.data
    placed = data.seen & ~data.lines
    if not placed.any():
        return None
    off = np.where(placed, np.linalg.norm(data.before - nominal_targets(registered), axis=-1), -1.0)
    i, k = np.unravel_index(int(off.argmax()), off.shape)
    return Row(target=_where(data, int(i), int(k)), distance_mm=MM * float(off[i, k]))


def nominal_targets(registered: RegisteredDataset) -> Array:
    """Find the targets of the rigid arm in all runs, (runs, m, 3) [m]."""
    vjm, data = registered.vjm, registered.data
    return tool_points(vjm, data.q, marker_points(vjm, data.markers))


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
    hidden = np.where(data.seen[some], 0.0, np.nan)[..., None]
    position, rotation = tool_pose(registered.vjm, data.q[some])
    return Row(
        nominal=nominal_targets(registered)[some] + hidden,
        before=data.before[some] + hidden,
        tool=position[:, None],
        hook=(position + np.matvec(rotation, data.point[some]))[:, None],
    )
