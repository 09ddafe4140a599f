"""Numbers of two runs beside one another: models by their names, cells of tables by row and heading."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from testbench.errors import InputError
from testbench.output.manifest import Finished
from testbench.report.badge import Badge, decide
from testbench.report.report import Report, number
from testbench.report.table import Row, finite
from testbench.trials.spread import (
    SAME,
    Number,
    Spread,
    ends,
    median_interval,
    middle,
    spread,
    triple,
    wins,
)
from testbench.trials.store import WHOLE
from testbench.views.schema import ALIKE, Column, Table

KINDS = {
    "workspace": "over the workspace, against the truth",
    "check_true": "at the check poses, against the truth",
    "check": "at the check poses, against readings",
    "identification": "at the fitted poses, against readings",
}
"""Errors of models, what matters most first, and where they are."""
CLOCK = ("s", "ms")  #: Units of what a clock measured: it differs in any case.
SIZES = ("mm", "um", "%")  #: Units of errors, which stand beside those of models.
MOST, LARGEST_MM = 1000, 1e9  #: Models that are compared, and their largest error.
KEPT = 200  #: Numbers of tables that are kept.
ROUNDING = 1e-12  #: Numbers below, in the shown unit, are rounding of 0.
FEWEST = 2  #: Pairs that have a spread.

Verdict = Literal["same", "tie", "less", "more"]
"""Of the second number beside the first one; a tie is within 2 %, or where its interval holds both."""
BySeed = Mapping[int, float]
ALONE: BySeed = {}  #: Of a run of one seed.


def differ(a: Number, b: Number, ours: BySeed = ALONE, theirs: BySeed = ALONE) -> Row:
    """A number of two runs: its sizes, ratio b over a, verdict, and what tells.

    By "pairs" tell ratios seed by seed, where both runs have it above 0 in the same two seeds or more; by
    "spreads" whether these overlap; by "one" nothing, as a side has one number.
    """
    first, second = middle(a), middle(b)
    difference = finite(second - first)
    ratios = [finite(theirs[s] / x) if x > 0 else None for s, x in ours.items() if s in theirs]
    known = [ratio for ratio in ratios if ratio is not None and ratio > 0]
    if ours.keys() == theirs.keys() and len(ratios) >= FEWEST and len(known) == len(ratios):
        times = spread(known)
        x, y = ([own[seed] for seed in ours] for own in (ours, theirs))
        told = {"by": "pairs", "pairs": len(x), "smaller": wins(y, x), "larger": wins(x, y)}
        told["interval"] = median_interval(np.array(known))
        return Row(a=a, b=b, difference=difference, ratio=times, verdict=_paired(times, known), **told)
    by = "spreads" if isinstance(a, Spread) and isinstance(b, Spread) else "one"
    ratio = finite(second / first) if first > 0 else None
    return Row(a=a, b=b, difference=difference, ratio=ratio, verdict=_verdict(a, b), by=by)


def _paired(ratio: Spread, ratios: Sequence[float]) -> Verdict:
    if np.allclose(triple(ratio), 1, rtol=0, atol=SAME):
        return "same"
    low, high = ratio.ends
    within = median_interval(np.array(ratios)) or (low, high)
    if within[0] <= 1 <= within[1] or max(abs(low - 1), abs(high - 1)) <= ALIKE:
        return "tie"
    return "less" if ratio.median < 1 else "more"


def _verdict(a: Number, b: Number) -> Verdict:
    (low, high), (least, most) = ends(a), ends(b)
    if np.allclose(triple(a), triple(b), rtol=SAME, atol=0, equal_nan=True):
        return "same"
    if (low <= most and least <= high) or size(a, b) < math.log1p(ALIKE):
        return "tie"
    return "less" if middle(b) < middle(a) else "more"


def size(a: Number, b: Number) -> float:
    """How far from equal, the same both ways: |log(b / a)|, infinite where signs differ."""
    first, second = middle(a), middle(b)
    if first == second:
        return 0.0
    return abs(math.log(second / first)) if first * second > 0 else math.inf


def apart(row: Row) -> bool:
    """Whether two numbers differ clearly."""
    return row.verdict in ("less", "more")


def told(row: Row) -> str:
    """What the second number is beside the first one."""
    if row.verdict == "same":
        return "the same"
    if row.verdict == "tie":
        return "within 2 %" if size(row.a, row.b) < ALIKE else "no clear difference"
    words = ("smaller", "larger") if min(*triple(row.a), *triple(row.b)) >= 0 else ("lower", "higher")
    return words[row.verdict == "more"] + (", no spread" if row.by == "one" else "")


def models_of(run: Finished) -> dict[str, Row]:
    """Models of a report by name, with their RMS errors by kind; none where several have one name.

    Raises:
        InputError: When an error is none that a model can have.
    """
    listed = run.report.get("models")
    rows = [own for own in listed if isinstance(own, dict)] if isinstance(listed, list) else []
    found = [_model(run, own) for own in rows[:MOST] if isinstance(own.get("name"), str)]
    told = [m for m in found if m.errors and not (m.constraint == "free" and m.conservative is False)]
    return {m.name: m for m in told} if len({m.name for m in told}) == len(told) else {}


def _model(run: Finished, own: Mapping[str, Any]) -> Row:
    errors = {}
    for kind in KINDS:
        cell = own.get(kind)
        mm = number(cell.get("rms_mm")) if isinstance(cell, dict) else None
        if not isinstance(mm, float | int | Spread):
            continue
        if not 0 <= min(triple(mm)) <= max(triple(mm)) <= LARGEST_MM:
            problem = f"expected an RMS error of 0 to {LARGEST_MM:g} mm, got {mm}"
            raise InputError(run.file, f"models: {own['name']}, {kind}", problem)
        errors[kind] = mm
    keys = ("name", "structure", "constraint", "prior", "conservative")
    drawn = {key: str(own.get(key) or "none") for key in ("structure", "constraint")}
    return Row({key: own.get(key) for key in keys} | drawn, errors=errors)


def models_compared(a: Finished, b: Finished) -> list[Row]:
    """Every error of every model that both runs have, by kind, what matters most first.

    Raises:
        InputError: When the trials of a run are damaged.
    """
    ours, theirs = models_of(a), models_of(b)
    both = [name for name in ours if name in theirs]
    mine, other = (_trials(run) if both else {} for run in (a, b))
    found = []
    for kind in KINDS:
        for name in both:
            x, y = (own[name].errors.get(kind) for own in (ours, theirs))
            if x is not None and y is not None:
                pair = (_seeds(t.get((name, kind), ()), n) for t, n in ((mine, x), (other, y)))
                model = {key: ours[name][key] for key in ("name", "structure", "constraint", "prior")}
                found.append(Row(model, kind=kind, **differ(x, y, *pair)))
    return found


def worse(said: Report) -> bool:
    """Whether a run errs more than the first one: beyond the spread, of one number by more than 2 %."""
    more = [own.lead for own in said.numbers["beside"] if own.lead and own.lead.verdict == "more"]
    return bool(more) or bool(said.badge and said.badge.verdict == "do not use")


def badge_of(lead: Row, a: tuple[str, Finished], b: tuple[str, Finished]) -> Badge:
    """The second run beside the first by the model that matters, seed by seed where both have the same."""
    x, y = (
        _seeds(_trials(run).get((lead.name, lead.kind), ()), reported)
        for (_, run), reported in ((a, lead.a), (b, lead.b))
    )
    if not x or x.keys() != y.keys():
        x, y = ({0: middle(own)} for own in (lead.a, lead.b))
    each = "trial" if x.keys() == y.keys() and len(x) > 1 else "pair of runs"
    return decide((b[0], [y[seed] for seed in x]), (a[0], [*x.values()]), each)


def _trials(run: Finished) -> Mapping[tuple[str, str], Sequence[BySeed]]:
    """Errors by seed of a run that left its trials, of every condition, by model and kind."""
    path = run.folder / WHOLE
    if not run.several or not path.is_file():
        return {}
    from testbench.trials.parquet import series  # here: few runs have trials

    found: dict[tuple[str, str], list[BySeed]] = {}
    for own in series(path, [f"{kind}.rms_mm" for kind in KINDS]):
        found.setdefault((own.name, own.key.removesuffix(".rms_mm")), []).append(own.by_seed)
    return found


def _seeds(conditions: Sequence[BySeed], reported: Number) -> BySeed:
    """The condition whose median is the report's; nothing where none is."""
    medians = [float(np.median([*own.values()])) for own in conditions]
    fits = np.isclose(medians, middle(reported), rtol=SAME, atol=0)
    return next((own for own, fit in zip(conditions, fits, strict=True) if fit), {})


def leading(models: Sequence[Row], runs: Sequence[Finished]) -> Row | None:
    """The model to judge the runs by: what all recommend, else the one of least error in all of them."""
    pairs = [m for m in models if m.kind == models[0].kind]
    recommended = {str(run.report.get("recommended")) for run in runs}
    agreed = [p for p in pairs if {p.name} == recommended]
    known = [p for p in pairs if min(middle(p.a), middle(p.b)) > 0]
    least = sorted(known, key=lambda p: middle(p.a) * middle(p.b))
    return next(iter([*agreed, *least, *pairs]), None)


def tables_compared(a: Report, b: Report, models: Sequence[Row]) -> tuple[list[Row], Row]:
    """Numbers of two runs' tables that differ, the farthest first, and how many there are.

    Args:
        a: The first run's.
        b: The other's.
        models: What is told by models: then of all the rest only sizes of errors are listed.
    """
    found: dict[object, Row] = {}
    for name in (name for name in a.tables if name in b.tables):
        for own in _cells(name, a.tables[name], b.tables[name]):
            found.setdefault((own.row, own.quantity, own.a, own.b), own)
    told: Collection[object] = {(m.name, m.a, m.b) for m in models}
    every = [own for own in found.values() if (own.row, own.a, own.b) not in told]
    unsure = [own.by == "one" for own in every if apart(own)]
    shown = [
        own
        for own in every
        if own.verdict != "same"
        and own.shown_a != own.shown_b
        and (not models or (own.quantity.endswith(SIZES) and min(*triple(own.a), *triple(own.b)) >= 0))
    ]
    counts = Row(
        every=len(every),
        same=sum(own.verdict == "same" for own in every),
        beyond=unsure.count(False),
        unsure=unsure.count(True),
    )
    return sorted(shown, key=_order)[:KEPT], counts


def _order(own: Row) -> tuple[bool, bool, bool, bool, float]:
    """First what differs by more than its spread, then what has none, at last what the spread covers.

    Angles come last of each: those of another plan are neither better nor worse.
    """
    far = 0.0 if own.ratio is None else size(own.a, own.b)
    return (
        not apart(own),
        own.quantity.endswith(", deg"),
        own.by == "one",
        middle(own.a) * middle(own.b) < 0,
        -far,
    )


def _cells(name: str, a: Table, b: Table) -> Iterator[Row]:
    """Numbers that two tables have in the same row under the same heading."""
    other = {column.title: column for column in b.columns}
    both = [column for column in a.columns if column.title in other]
    first, second = _rows(a, both), _rows(b, [other[column.title] for column in both])
    for key in (key for key in first if key in second):
        for column in both[len(key) :]:
            x, y = _number(column, first[key]), _number(other[column.title], second[key])
            if x is None or y is None or max(*map(abs, (*triple(x), *triple(y)))) <= ROUNDING:
                continue
            if column.unit not in CLOCK:
                share = column.form == "yes" or column.unit == "%"  # beside one near 0 a ratio says nothing
                yield Row(
                    differ(x, y) | ({"ratio": None} if share else {}),
                    table=a.title or name.replace("_", " "),
                    row=", ".join(key),
                    quantity=column.title,
                    shown_a=column.cell(first[key]),
                    shown_b=other[column.title].cell(second[key]),
                )


def _number(column: Column, row: object) -> Number:
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
    if _number(column, row) is None and not cell.isdecimal():
        return cell
    return " ".join(filter(None, [column.heading, cell, column.unit]))
