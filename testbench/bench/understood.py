"""How a file of measured runs was understood: which column is which quantity, and what is in it."""

from dataclasses import dataclass

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.bench.rows import MM
from testbench.data.columns import Column, Columns
from testbench.data.dataset import Dataset
from testbench.data.export import Export
from testbench.data.names import What

WORDS: dict[What, str] = {
    "reading": "position",
    "point": "load point",
    "covariance": "covariance",
    "rotation": "orientation",
}
"""What people call the quantities with another name of theirs."""
LISTED = 4  #: Most words of a column that are listed.


@dataclass(frozen=True)
class ColumnRow:
    """One quantity, of one column or of those of its axes."""

    quantity: str  #: In words.
    columns: str  #: As the file names them.
    unit: str  #: That of the file; empty where it has none.
    values: str  #: From the least to the largest, in that unit, or the words.
    rows: int  #: How many rows have it.


@dataclass(frozen=True)
class LoadRow:
    """A load that was applied."""

    force: float  #: [N].
    moment: float  #: [N m].
    runs: int  #: How many runs had it.


@dataclass(frozen=True)
class Understood:
    """A file in words and numbers."""

    columns: tuple[ColumnRow, ...]  #: What is read.
    ignored: tuple[str, ...]  #: Names of columns that are not.
    rows: int  #: Of the table.
    runs: int
    poses: int
    stations: int  #: Set-ups of the tracker.
    markers: tuple[str, ...]
    lost: tuple[str, ...]  #: Targets without readings, as "P1 in run 3".
    loads: tuple[LoadRow, ...]  #: The smallest first.
    downward: bool  #: Whether all forces point along -z, as hung masses do.
    deflection_mm: tuple[float, float, float]  #: Least, median, largest; NaN where every target was lost.
    farthest: str  #: The target that moves most, as "P1 in run 3"; empty where every target was lost.
    sigma_um: float  #: Of one reading along an axis.
    how: tuple[str, ...]  #: How the text was read.
    assumed: tuple[str, ...]  #: What the file did not say.

    @property
    def masses(self) -> tuple[float, ...]:
        """What hangs for these forces [kg]."""
        return tuple(load.force / GRAVITY for load in self.loads)


def understand(export: Export) -> Understood:
    """What was understood of a file."""
    data, columns = export.data, export.columns
    size = MM * np.linalg.norm(data.deflection, axis=-1)[data.seen]
    whole = np.where(data.seen, np.linalg.norm(data.deflection, axis=-1), -1.0)
    i, k = np.unravel_index(int(whole.argmax()), whole.shape)
    spread = np.quantile(size, [0, 0.5, 1]).tolist() if len(size) else [np.nan] * 3
    return Understood(
        columns=tuple(_rows(columns)),
        ignored=columns.ignored,
        rows=columns.table.rows,
        runs=data.runs,
        poses=len(np.unique(data.pose)),
        stations=1 if data.station is None else len(np.unique(data.station)),
        markers=data.markers,
        lost=tuple(f"{data.markers[k]} in run {data.run[i]}" for i, k in np.argwhere(~data.seen)),
        loads=_loads(data),
        downward=bool((data.wrench[:, [0, 1, 3, 4, 5]] == 0).all() and (data.wrench[:, 2] <= 0).all()),
        deflection_mm=(spread[0], spread[1], spread[2]),
        farthest=f"{data.markers[k]} in run {data.run[i]}" if len(size) else "",
        sigma_um=1e6 * data.sigma,
        how=columns.table.notes,
        assumed=export.notes,
    )


def _loads(data: Dataset) -> tuple[LoadRow, ...]:
    """Loads that differ in their sizes by more than rounding."""
    sizes = np.linalg.norm(data.wrench.reshape(-1, 2, 3), axis=-1).round(6)
    values, counts = np.unique(sizes, axis=0, return_counts=True)
    rows = zip(*values.T.tolist(), counts.tolist(), strict=True)
    return tuple(LoadRow(force, moment, runs) for force, moment, runs in rows)


def _rows(columns: Columns) -> list[ColumnRow]:
    """A row a quantity; the axes of a vector stand in one."""
    groups: dict[tuple[object, ...], list[Column]] = {}
    for column in sorted(columns.found.values(), key=lambda c: c.index):
        slot = column.slot
        alone = slot.what in ("joint", "sigma")
        groups.setdefault((slot.what, slot.marker, slot.when, slot.index if alone else 0), []).append(column)
    return [_row(columns, own) for own in groups.values()]


def _row(columns: Columns, own: list[Column]) -> ColumnRow:
    slot, names = own[0].slot, [column.name for column in own]
    what = WORDS.get(slot.what, slot.what) + (f" {slot.index + 1}" if slot.what == "joint" else "")
    state = {"before": "unloaded", "after": "loaded"}.get(slot.when, slot.when)
    quantity = " ".join(filter(None, (what, slot.marker, state)))
    shown = ", ".join(names) if len(names) <= 2 else f"{names[0]} ... {names[-1]}"
    there = np.any([~columns.table.blank(column.index) for column in own], axis=0)
    if own[0].unit is None:
        words = list(dict.fromkeys(columns.table.texts(own[0].index)))
        few = ", ".join(word[:20] for word in words[:LISTED])
        values = few if len(words) <= LISTED else f"{few} ... ({len(words)})"
        return ColumnRow(quantity, shown, "", values, int(there.sum()))
    unit = own[0].unit
    numbers = np.concatenate([columns.values(column) / unit.scale for column in own])
    known = numbers[np.isfinite(numbers)]
    ends = list(dict.fromkeys(f"{x:.5g}" for x in (known.min(), known.max()))) if len(known) else ["none"]
    values = " to ".join(ends)
    return ColumnRow(quantity, shown, unit.name, values, int(there.sum()))
