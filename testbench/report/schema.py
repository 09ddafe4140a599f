"""Columns of tables, declared once for terminal, report.md, figures and recording alike."""

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from testbench.errors import Array
from testbench.report.colours import Look, Modelled, look_of
from testbench.runs.spread import Number, Share, Spread, median_interval, middle, spans

# --- Columns of tables, declared once for terminal, report.md, figures and recording alike ------------------


@dataclass(frozen=True)
class TableColumn:
    """Describe one quantity of a table."""

    key: str  #: Where it is in a row and in report.json, such as "check.rms_mm".
    heading: str  #: What it is, such as "RMS check".
    unit: str = ""  #: Its unit, empty for none.
    #: Format of a number, or "yes" for a truth value and the share of trials in which it holds.
    form: str = ".3f"
    paper: str = ""  #: Key of the paper's number in the row's `paper`, if it gives one.
    exact: bool = False  #: Nothing to spread: only the median is shown.
    short: str = ""  #: Heading and unit for a terminal, line by line; each word on a line if empty.
    #: What is shown is so many times the report's number, for a unit that is not the key's.
    scale: float = 1.0
    rounding: float = 0.0  #: Numbers below, in the shown unit, are rounding and shown as "exact".
    called: Mapping[str, str] = field(default_factory=dict)  #: Keys of a report by what readers call them.
    none: str = "not fitted"  #: What a cell without a number says: why it has none.

    @property
    def title(self) -> str:
        """Return heading and unit."""
        return f"{self.heading}, {self.unit}" if self.unit else self.heading

    def value(self, row: object) -> Any:
        """Return the quantity in a row of dataclasses and mappings, in its unit; None if a part is None."""
        found = _at(row, self.key)
        return found if self.scale == 1 else _times(self.scale, found)

    def text(self, value: object) -> str:
        """Write a value of this quantity for people."""
        if self.rounding and value is not None and abs(middle(value)) < self.rounding:  # type: ignore[arg-type]
            return "exact"
        if isinstance(value, str):
            return self.called.get(value, value)
        nothing = value is None or (isinstance(value, float | Spread) and math.isnan(middle(value)))
        return self.none if nothing else show(value, self.form)

    def cell(self, row: object) -> str:
        """Write what is shown of a row: the median with its spread, or the word."""
        value = self.value(row)
        return self.text(_median(value) if self.exact else value)

    def known_value(self, row: object) -> Any:
        """Return the paper's number for a row, in its unit; None where it gives none."""
        cells = _at(row, "paper") if self.paper and hasattr(row, "paper") else None
        value = None if cells is None else _at(cells, self.paper)
        return value if value is None or self.form == "yes" else _times(self.scale, value)

    def known(self, row: object) -> str:
        """Write the paper's number for a row, empty where there is none."""
        value = self.known_value(row)
        if value is None or self.form == "yes":
            return "" if value is None else show_truth(value)
        return plain(f"{value:.3g}")


def _at(row: object, key: str) -> Any:
    """What is at the end of a path of fields, keys and places; None where a part is None or not there."""
    for part in key.split("."):
        if isinstance(row, Mapping):
            row = row.get(part)
        else:
            row = row[int(part)] if isinstance(row, list | tuple) else getattr(row, part)
        if row is None:
            return None
    return row


def _times(scale: float, value: Any) -> Any:
    if isinstance(value, Spread):
        return value.scaled(scale)
    return None if value is None else scale * value


@dataclass(frozen=True)
class Table:
    """Hold rows under columns."""

    columns: tuple[TableColumn, ...]  #: From left to right; the first one names the row.
    rows: Sequence[object]  #: Dataclasses or mappings.
    title: str = ""  #: What it shows, empty for none.
    bold: str = ""  #: Value of the first column in the row that is marked, empty for none.
    headline: str = ""  #: Key of the column that the answer speaks of; empty for the last one.
    across: str = ""  #: What changes from column to column after the first; empty where these differ in kind.
    looks: Mapping[str, Look] = field(default_factory=dict)  #: Of rows, by the text of the first column.
    stepwise: bool = False  #: Whether each row adds something to the one before, so that their order stays.

    def __post_init__(self) -> None:
        """What is marked is first, unless several rows are."""
        if self.bold and self.columns:
            object.__setattr__(self, "rows", self._led_by(self.bold))

    def led_by(self, name: str) -> "Table":
        """Move the row of a name to the top; nothing moves where none or several have it."""
        return replace(self, rows=self._led_by(name))

    def _led_by(self, name: str) -> Sequence[object]:
        at = [k for k, row in enumerate(self.rows) if self.columns[0].cell(row) == name]
        return self.rows if len(at) != 1 else [self.rows[at[0]], *self.rows[: at[0]], *self.rows[at[0] + 1 :]]

    def marks(self, row: object) -> bool:
        """Tell whether a row is marked in every view."""
        return bool(self.bold and self.columns) and self.columns[0].cell(row) == self.bold


MAX_COLUMNS = 6  #: Columns that a terminal or a study's page has room for.


def with_fewer_columns(table: Table) -> Table:
    """Drop columns but the first ones, at most MAX_COLUMNS, and that of which the answer speaks.

    Args:
        table: The table.

    Returns:
        The table.
    """
    first, *others = table.columns
    answer = table.headline or table.columns[-1].key
    keep = [c for c in others if c.key == answer]
    keep += [c for c in others if c not in keep][: MAX_COLUMNS - 1 - len(keep)]
    return replace(table, columns=(first, *(c for c in others if c in keep)))


def brackets(table: Table) -> str:
    """Say what stands in brackets behind the medians of a table; empty where nothing does."""
    return spans(column.value(row) for column in table.columns if not column.exact for row in table.rows)


def pivot(
    table: Table, down: TableColumn, across: TableColumn, cell: TableColumn, *last: TableColumn
) -> Table:
    """Make a table with a row for every value of one column and a column for every value of another.

    Args:
        table: Rows with all three; its title stays.
        down: Names the rows.
        across: Names the columns, its unit in their headings.
        cell: What stands there.
        last: Columns behind these, of quantities that do not vary with what heads a column.

    Returns:
        The table.
    """
    heads = list(dict.fromkeys(across.cell(row) for row in table.rows))
    unit = f" {across.unit}" if across.unit else ""
    rows: dict[str, dict[str, object]] = {}
    for row in table.rows:
        own = rows.setdefault(down.cell(row), {"name": down.cell(row)})
        own[f"c{heads.index(across.cell(row))}"] = cell.value(row)
        own |= {column.key: column.value(row) for column in last}
    columns = [
        TableColumn(
            f"c{k}", head + unit, "", cell.form, exact=cell.exact, rounding=cell.rounding, none="not tried"
        )
        for k, head in enumerate(heads)
    ]
    return Table(
        (TableColumn("name", down.heading), *columns, *last),
        list(rows.values()),
        table.title,
        table.bold,
        across=across.heading if across.unit == across.heading else across.title,
        looks=looks(table.rows, down),
    )


def looks(rows: Sequence[object], name: TableColumn) -> dict[str, Look]:
    """Collect how the models of rows are drawn, by the text of a column; none where it names several models.

    Args:
        rows: Rows of the table.
        name: Column of the name.

    Returns:
        Looks by text.
    """
    found: dict[str, set[Look]] = {}
    for row in rows:
        if isinstance(row, Modelled):
            found.setdefault(name.cell(row), set()).add(look_of(row))
    return {text: own.pop() for text, own in found.items() if len(own) == 1}


def show(value: object, form: str = ".3f") -> str:
    """Write a value for people: a number, its median with the ends of its spread, a word, a share of trials.

    Args:
        value: The value.
        form: Format of a number.

    Returns:
        The text.
    """
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    if form == "yes":
        return show_truth(value)  # type: ignore[arg-type]
    if isinstance(value, Spread):
        low, high = value.ends
        if low == high or math.isnan(value.median):  # one, or all alike
            return _form(value.median, form)
        return f"{_form(value.median, form)} ({_form(low, form)} to {_form(high, form)})"
    return _form(value, form)


def _form(value: object, form: str) -> str:
    if isinstance(value, float) and math.isnan(value):
        return "-"
    if isinstance(value, float) and math.isinf(value):
        return "infinite" if value > 0 else "minus infinite"
    text = plain(format(value, form))
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text  # never "-0.000"


NUMBER = re.compile(r"(?<![\w.`/^-])-?\d(?:\.\d+)?e[+-]\d{2,3}(?![\w`])")
POWER = re.compile(r"(-?\d(?:\.(\d+))?)e([+-]\d+)")
MIN_POWER, MAX_POWER = -3, 6  #: Powers of ten from which, and below which, a number is written out.


def plain(number: str) -> str:
    """Write a number with a power of ten for people: 1230 for 1.23e+03, 1.2 x 10^-8 for 1.2e-08."""
    found = POWER.fullmatch(number)
    if found is None:
        return number
    size = found[1]
    digits = len(found[2] or "")
    power = int(found[3])
    if float(size) == 0:
        return "0"
    if MIN_POWER <= power < MAX_POWER:
        return f"{float(number):.{max(digits - power, 0)}f}"
    return f"{size} x 10^{power}"


def written_out(text: str) -> str:
    """Write words with every number in them as `plain` has it, whoever wrote them."""
    return NUMBER.sub(lambda number: plain(number[0]), text)


def show_truth(value: Share) -> str:
    """Write yes, no, or the share of trials."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{100 * value:.0f} %"


def _median(value: object) -> object:
    return value.median if isinstance(value, Spread) else value


LEAST_IS_BEST = ("mm", "um", "urad", "um/N", "s", "ms")
"""Units of columns of which less is better, errors and times; ratios of errors have none."""
RATIOS = ("over", "relative_excess_bound")  #: Keys of columns without a unit, the same.


def best_rows(table: Table, column: TableColumn) -> set[int]:
    """Find the rows of least median in a column, and all that tie with it in the same trials.

    Nothing where all of them tie, where trials are too few for a sign test, or where less is not better.

    Args:
        table: The table.
        column: The column.

    Returns:
        Indices of the rows.
    """
    if column.unit not in LEAST_IS_BEST and column.key not in RATIOS:
        return set()
    values = [column.value(row) for row in table.rows]
    trials = max((own.trials for own in values if isinstance(own, Spread)), default=0)
    known = {k: own for k, own in enumerate(values) if isinstance(own, Spread) and own.trials == trials}
    sizes = {k: np.array(spread.values) for k, spread in known.items() if spread.values}
    if len(sizes) < 2:
        return set()
    first = min(sizes, key=lambda k: known[k].median)
    tied = {k for k, own in sizes.items() if _alike(sizes[first], own)}
    judged = median_interval(sizes[first]) is not None
    return tied if judged and len(tied) < len(sizes) else set()


def _alike(ours: Array, theirs: Array) -> bool:
    """Whether nothing tells two errors apart, trial by trial, (n,) both: as a badge decides."""
    positive = (ours > 0) & (theirs > 0)
    if len(ours) != len(theirs) or not positive.any():
        return ours is theirs
    ratio = theirs[positive] / ours[positive]
    low, high = median_interval(ratio) or (0.0, math.inf)
    return low <= 1 <= high or abs(float(np.median(ratio)) - 1) <= ALIKE


ALIKE = 0.02  #: Share of the least value within which others are as good as the best.


def best_of(values: Mapping[str, Number], alike: float = ALIKE) -> list[str]:
    """Find the names of least value (of medians), and all within a share of it; None and NaN take no part.

    Args:
        values: Values by name.
        alike: Share within which values tie [1].

    Returns:
        The names, that of the least value first.
    """
    known = {name: middle(value) for name, value in values.items() if not math.isnan(middle(value))}
    most = (1 + alike) * min(known.values(), default=0.0)
    return sorted((name for name, value in known.items() if value <= most), key=lambda name: known[name])


# --- The quantities of tables: columns.toml declares each once, by its key: heading, unit, format -----------

WORDS = """
    method status interval quantity values rows number truth what verdict why prediction
    solver split fit joint load way unit instrument arm campaign series
"""
COUNTS = "datasets seeds poses run task line pose seed cases trials readings row"
"""Keys of words and of counts that are their own headings."""


DECLARED = tomllib.loads(Path(__file__).with_name("columns.toml").read_text(encoding="utf-8"))
EVERY = (
    *(TableColumn(key, key.replace("_", " ")) for key in WORDS.split()),
    *(TableColumn(key, key.replace("_", " "), form="d") for key in COUNTS.split()),
    *(TableColumn(key, **own) for key, own in DECLARED.items()),
)
KNOWN = {column.key: column for column in EVERY}
ROUNDING_UM = KNOWN["rms_um"].rounding  #: Errors below are rounding.
TRUE_ARM_LABELS = KNOWN["true_arm"].called  #: What readers call our true arms.


def true_arm_label(name: str) -> str:
    """Return the words that reports use for a kind of true arm; one that a user added keeps its own name."""
    return TRUE_ARM_LABELS.get(name, name)


def columns(keys: str, *, paper: bool = True) -> tuple[TableColumn, ...]:
    """Look up columns by their keys, blanks between.

    Args:
        keys: The keys.
        paper: Whether they show the paper's numbers where it has such.

    Returns:
        The columns.
    """
    found = tuple(KNOWN[key] for key in keys.split())
    return found if paper else tuple(replace(column, paper="") for column in found)
