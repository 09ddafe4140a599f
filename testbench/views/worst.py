"""Where each model errs most: the rows and the table that reports, recordings and maps share."""

from dataclasses import dataclass

from testbench.bench.error_places import ErrorPlaces
from testbench.views.schema import Column, Table


@dataclass(frozen=True)
class WorstRow:
    """A model of the table: its errors, and where it is worst; None where it has no bound anywhere."""

    model: str
    typical_mm: float | None
    worst_mm: float | None
    unbounded: int
    place: int | None
    where_m: str
    joints: str


def worst_rows(found: ErrorPlaces) -> list[WorstRow]:
    """The compared models, then the others."""
    names = dict.fromkeys([*found.compared, *found.error_mm])
    return [_row(found, name) for name in names]


def _row(found: ErrorPlaces, name: str) -> WorstRow:
    worst = found.worst.get(name)
    return WorstRow(
        model=name,
        typical_mm=found.typical_mm(name) if worst else None,
        worst_mm=worst.error_mm if worst else None,
        unbounded=found.unbounded(name),
        place=worst.place + 1 if worst else None,
        where_m=", ".join(f"{x:.2f}" for x in worst.position_m) if worst else "",
        joints=worst.joints if worst else "",
    )


def worst_table(found: ErrorPlaces) -> Table:
    """Errors of every model, and where it is worst."""
    rows = worst_rows(found)
    columns = [
        Column("model", "model"),
        Column("typical_mm", found.means.typical, "mm"),
        Column("worst_mm", "greatest", "mm"),
        *(
            [Column("unbounded", "places without a bound", form="d")]
            if any(r.unbounded for r in rows)
            else []
        ),
        Column("place", "place", form="d"),
        Column("where_m", "x, y, z", "m"),
        Column("joints", "joints"),
    ]
    return Table(tuple(columns), rows)
