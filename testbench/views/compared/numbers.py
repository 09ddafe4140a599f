"""Numbers of the tables of two runs, found by table, row and heading, and those that differ most."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from testbench.bench.compare_numbers import Difference, differ
from testbench.bench.compare_report import Counts, NumberPair
from testbench.trials.spread import Number, Spread, middle, triple
from testbench.views.schema import Column, Table

MOST = 200  #: Numbers that are kept.
CLOCK = ("s", "ms")  #: Units of what a clock measured: it differs in any case.
SIZES = ("mm", "um", "%")  #: Units of errors, which stand beside those of models.
ROUNDING = 1e-12  #: Numbers below, in the shown unit, are rounding of 0.

Told = tuple[str, Number, Number]  #: A row with its two numbers.


@dataclass(frozen=True)
class Numbers:
    """What the tables of two runs hold."""

    farthest: list[NumberPair]  #: Those that differ most, as far as the digits shown tell.
    counts: Counts


def numbers(ours: Mapping[str, Table], theirs: Mapping[str, Table], told: Collection[Told] = ()) -> Numbers:
    """The numbers of two runs' tables, those of the same table, row and heading beside one another.

    Args:
        ours: Tables of the first run, by name.
        theirs: Those of the other one.
        told: What is told elsewhere, of models by their names: then of all the rest sizes of errors alone.
    """
    found: dict[tuple[str, str, Number, Number], NumberPair] = {}
    for name in ours:
        if name in theirs:
            for pair in _pairs(name, ours[name], theirs[name]):
                found.setdefault((pair.row, pair.quantity, pair.found.a, pair.found.b), pair)
    every = [pair for pair in found.values() if (pair.row, pair.found.a, pair.found.b) not in told]
    shown = [p for p in every if p.found.verdict != "same" and p.a != p.b and (_is_size(p) or not told)]
    return Numbers(sorted(shown, key=lambda pair: _order(pair.found))[:MOST], _counts(every))


def _counts(every: Sequence[NumberPair]) -> Counts:
    apart = [pair.found.by == "one" for pair in every if pair.found.apart]
    same = sum(pair.found.verdict == "same" for pair in every)
    return Counts(len(every), same, beyond=apart.count(False), unsure=apart.count(True))


def _order(found: Difference) -> tuple[bool, bool, bool, float]:
    """First what differs by more than its spread, then what has none, at last what the spread covers."""
    return not found.apart, found.by == "one", middle(found.a) * middle(found.b) < 0, -found.size


def _is_size(pair: NumberPair) -> bool:
    return pair.quantity.endswith(SIZES) and min(*triple(pair.found.a), *triple(pair.found.b)) >= 0


def _pairs(name: str, a: Table, b: Table) -> list[NumberPair]:
    """Numbers that two tables have in the same row under the same heading."""
    other = {column.title: column for column in b.columns}
    both = [column for column in a.columns if column.title in other]
    first, second = _rows(a, both), _rows(b, [other[column.title] for column in both])
    return [
        NumberPair(
            table=a.title or name.replace("_", " "),
            row=", ".join(key),
            quantity=column.title,
            a=column.cell(first[key]),
            b=other[column.title].cell(second[key]),
            found=differ(x, y),
        )
        for key in first
        if key in second
        for column in both[len(key) :]
        if column.unit not in CLOCK
        and (x := number(column, first[key])) is not None
        and (y := number(other[column.title], second[key])) is not None
        and max(*map(abs, (*triple(x), *triple(y)))) > ROUNDING
    ]


def number(column: Column, row: object) -> Number:
    """The number in a cell; None where it holds words or nothing."""
    value = column.value(row)
    if isinstance(value, bool | int | float):
        return float(value)
    return value if isinstance(value, Spread) else None


def _rows(table: Table, columns: Sequence[Column]) -> dict[tuple[str, ...], object]:
    """Rows by as many of their first cells as tell them apart; none where nothing does."""
    for count in range(1, len(columns)):
        found = {tuple(_name(c, row) for c in columns[:count]): row for row in table.rows}
        if len(found) == len(table.rows):
            return found
    return {}


def _name(column: Column, row: object) -> str:
    """A cell that names its row; a number, also one that is a name, with what it is."""
    cell = column.cell(row)
    if number(column, row) is None and not cell.isdecimal():
        return cell
    return " ".join(filter(None, [column.heading, cell, column.unit]))
