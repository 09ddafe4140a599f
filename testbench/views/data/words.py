"""What was understood of a file of measured runs: its columns, and the whole in numbers."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.bench.looks import Looks
from testbench.bench.rows import MM, UM
from testbench.bench.understood import ColumnRow, Understood
from testbench.identify.registered import Registered
from testbench.identify.weighed import marker_points
from testbench.model.vjm import tool_points
from testbench.views.markdown import Words
from testbench.views.schema import NUMBER, Column, Table, plain, show, written_out

COLUMNS = (
    Column("quantity", "quantity"),
    Column("columns", "columns of the file"),
    Column("unit", "unit"),
    Column("values", "values"),
    Column("rows", "rows"),
)
MOST = 6  #: Loads and names that are listed.
GAP = 2  #: Blanks between two columns.
SMALL = 1e-3  #: Lengths below are shown in um [m].


@dataclass(frozen=True)
class CheckedRuns:
    """A file of runs, and what was understood of it."""

    name: str  #: Of the file.
    found: Understood
    registered: Registered
    looks: Looks

    @property
    def doubts(self) -> list[str]:
        """What may be wrong, the likeliest first."""
        return [doubt.sentence for doubt in self.looks.doubts]

    @property
    def notes(self) -> list[str]:
        """How the readings fit the arm."""
        scale = self.looks.scale
        factor = (
            f"the deflections are {show(scale or 1.0, '.3g')} times what the arm's folder says of these loads"
        )
        return [*self.registered.notes, *[factor] * (scale is not None)]

    @property
    def away(self) -> tuple[str, float] | None:
        """The unloaded reading that fits the arm without sag worst, and how far it is off [mm]."""
        vjm, data = self.registered.vjm, self.registered.data
        if not data.seen.any():
            return None
        nominal = tool_points(vjm, data.q, marker_points(vjm, data.markers))
        off = np.where(data.seen, np.linalg.norm(data.before - nominal, axis=-1), -1.0)
        i, k = np.unravel_index(int(off.argmax()), off.shape)
        return f"{data.markers[k]} in run {data.run[i]}", MM * float(off[i, k])


def words(runs: CheckedRuns, scale: float = 1.0) -> Words:
    """The words of page and recording; deflections are drawn so many times as long."""
    found = runs.found
    values = {
        "runs": runs,
        "found": found,
        "deflections": deflections(found),
        "lines": lines(found),
        "columns": found.columns,
        "scale": scale,
    }
    return Words(Path(__file__).parent, values, "data.md.j2")


def columns(found: Understood) -> Table:
    """Which column is which quantity; numbers of rows are words, as there is nothing to draw."""
    rows = [{**vars(row), "values": _values(row), "rows": str(row.rows)} for row in found.columns]
    return Table(COLUMNS, rows, "Which column is which quantity")


def table(found: Understood) -> list[str]:
    """A line a quantity: columns of the file, unit, values, rows."""
    head = ("quantity", "column of the file", "unit", "values", "rows")
    rows = [head, *((r.quantity, r.columns, r.unit, _values(r), str(r.rows)) for r in found.columns)]
    widths = [max(len(row[k]) for row in rows) + GAP for k in range(len(head))]
    return ["".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]


def _values(row: ColumnRow) -> str:
    """Numbers have no powers of ten that a reader must decode, small lengths are in um; words stay."""
    if row.unit == "m":
        return NUMBER.sub(lambda number: _length(number[0]), row.values)
    return written_out(row.values) if row.unit else row.values


def _length(number: str) -> str:
    """A number of metres as people write it."""
    metres = float(number)
    return f"{UM * metres:g} um" if 0 < abs(metres) < SMALL else plain(number)


def lines(found: Understood) -> list[str]:
    """The whole in numbers, what was left out, what was assumed."""
    readings = found.runs * len(found.markers)
    return [
        f"{found.rows} rows: {count(found.runs, 'run')} in {count(found.poses, 'pose')}, "
        f"{count(len(found.markers), 'marker')} {', '.join(found.markers)}"
        + (f", {found.stations} stations" if found.stations > 1 else ""),
        f"lost targets: {len(found.lost)} of {readings}" + (f", {listed(found.lost)}" if found.lost else ""),
        f"loads: {loads(found)}",
        f"deflections: {deflections(found)}; sigma of a reading {show(found.sigma_um, 'g')} um",
        f"columns not read: {listed(found.ignored)}",
        *(f"- {note}" for note in (*found.how, *found.assumed)),
    ]


def deflections(found: Understood) -> str:
    """How far loads moved the targets."""
    low, middle, high = found.deflection_mm
    return f"{low:.3f} to {high:.3f} mm, median {middle:.3f} mm"


def count(number: int, noun: str) -> str:
    """A number of things."""
    return f"{number} {noun}" + "s" * (number != 1)


def listed(names: tuple[str, ...]) -> str:
    """The first names, and how many there are more."""
    shown = ", ".join(names[:MOST]) or "none"
    return shown + (f" and {len(names) - MOST} more" if len(names) > MOST else "")


def loads(found: Understood) -> str:
    """Forces and moments, or what hangs where all point down."""
    parts = []
    for load, kg in zip(found.loads[:MOST], found.masses, strict=False):
        size = f"{load.force:.5g} N" + (f" and {load.moment:.5g} N m" if load.moment else "")
        size += f" (as of {kg:.5g} kg hung)" if found.downward and load.force else ""
        parts.append(f"{size} in {count(load.runs, 'run')}")
    rest = len(found.loads) - MOST
    return "; ".join([*parts, *[f"and {rest} more"] * (rest > 0)])
