"""What was understood of a file of measured runs: its columns, and the whole in numbers."""

from testbench.bench.understood import Understood

MOST = 6  #: Loads and names that are listed.
GAP = 2  #: Blanks between two columns.


def table(found: Understood) -> list[str]:
    """A line a quantity: columns of the file, unit, values, rows."""
    head = ("quantity", "column of the file", "unit", "values", "rows")
    rows = [head, *((r.quantity, r.columns, r.unit, r.values, str(r.rows)) for r in found.columns)]
    widths = [max(len(row[k]) for row in rows) + GAP for k in range(len(head))]
    return ["".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]


def lines(found: Understood) -> list[str]:
    """The whole in numbers, what was left out, what was assumed."""
    readings = found.runs * len(found.markers)
    low, middle, high = found.deflection_mm
    return [
        f"{found.rows} rows: {count(found.runs, 'run')} in {count(found.poses, 'pose')}, "
        f"{count(len(found.markers), 'marker')} {', '.join(found.markers)}"
        + (f", {found.stations} stations" if found.stations > 1 else ""),
        f"lost targets: {len(found.lost)} of {readings}" + (f", {listed(found.lost)}" if found.lost else ""),
        f"loads: {loads(found)}",
        f"deflections: {low:.3f} to {high:.3f} mm, median {middle:.3f} mm; sigma of a reading "
        f"{found.sigma_um:g} um",
        f"columns not read: {listed(found.ignored)}",
        *(f"- {note}" for note in (*found.how, *found.assumed)),
    ]


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
