"""A robot's log beside a tracker's file, each reading with the row of its name or nearest time; and times."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from testbench.arm.decimal import is_decimal
from testbench.data.mapping import Layout, Log, Names
from testbench.data.names import Slot, squeeze
from testbench.data.table import Table, read_table
from testbench.errors import Array, Ids

STAMP = re.compile(r"(\d{4})(\d\d)(\d\d)[T_ ]?(\d\d)(\d\d)(\d\d)")  #: 20200714163904.
FRACTION = re.compile(r"(.*?:\d\d|[^.,:]*)(?:[.,](\d+))?(\s*[AP]M|Z)?", re.IGNORECASE | re.DOTALL)
DAYS = ("%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y", "%Y/%m/%d", "%d.%m.%y", "")
HOURS = ("%H:%M:%S", "%I:%M:%S %p", "%H:%M")
FORMS = ("", *(f"{day} {hour}".strip() for day in DAYS for hour in HOURS))
"""Ways of writing a time, of which the first that fits a whole column counts; "" for seconds and ISO 8601."""


def clock(texts: Sequence[str]) -> Array | None:
    """Seconds of dates and times, or of times of a day, all in one way of writing, (n,); None for others."""
    parts = [part for text in texts if (part := FRACTION.fullmatch(text))]
    for form in FORMS if parts and len(parts) == len(texts) else ():
        found = [_seconds(form, f"{part[1]}{part[3] or ''}") for part in parts]
        if None not in found:
            beyond = np.array([float(f"0.{part[2] or 0}") for part in parts])
            return np.asarray(np.array(found, dtype=float) + beyond)
    return None


def _seconds(form: str, text: str) -> float | None:
    if not form:
        return float(text) if is_decimal(text) and not STAMP.fullmatch(text) else seconds(text)
    try:
        return datetime.strptime(text, form).replace(tzinfo=UTC).timestamp()
    except ValueError:
        return None


def seconds(text: str) -> float | None:
    """Seconds of a date and time since 1970; None for anything else."""
    stamp = STAMP.fullmatch(text)
    try:
        when = datetime.fromisoformat("{}-{}-{}T{}:{}:{}".format(*stamp.groups()) if stamp else text)
    except ValueError:
        return None
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()


def with_log(table: Table, names: Names) -> Table:
    """The table with the columns of the log that a map names; as it is where the map names none.

    Points that the map ignores have no row in the log.
    """
    if names.log is None or names.path is None:
        return table
    for k, own in enumerate(map(names.find, table.names)):
        if own and own.slot == Slot("marker"):
            table = table.take(np.array([squeeze(text) not in names.ignored for text in table.texts(k)]))
    file = names.path.parent / names.log.file
    return joined(table, read_table(file, names.knows, Layout()), names.log)


def joined(table: Table, log: Table, how: Log) -> Table:
    """The table with those columns of a log that it has not.

    Raises:
        InputError: At the first reading without a row of the log, and at a name that the log has twice.
    """
    to = how.to or how.on
    if how.within_s is None:
        return table.beside(log, _by_name(table, log, keys_of(table, how.on), keys_of(log, to)))
    ours, theirs = times_of(table, how.on), times_of(log, to)
    rows = nearest(ours, theirs)
    apart, most = np.abs(theirs[rows] - ours), f"expected a row of {log.path.name} within {how.within_s:g} s"
    table.refuse(apart > how.within_s, "", lambda row: f"{most}, the nearest is {apart[row]:.4g} s away")
    return table.beside(log, rows)


def nearest(ours: Array, theirs: Array) -> Ids:
    """Of every time the place of the nearest one of others."""
    return np.array([int(np.abs(theirs - t).argmin()) for t in ours], dtype=np.int64)


def times_of(table: Table, columns: Sequence[str]) -> Array:
    """What columns say together as times, (rows,) [s]; InputError where they do not."""
    found = clock(keys_of(table, columns)) if columns else None
    if found is None:
        raise table.header_error(f"expected times to join by in {' and '.join(columns) or 'a column'}")
    return found


def keys_of(table: Table, columns: Sequence[str]) -> list[str]:
    """What columns say together, row by row; InputError names one that is not there."""
    if missing := [name for name in columns if name not in table.names]:
        raise table.header_error(f"no column {missing[0]!r} to join by; columns are {list(table.names)}")
    return [" ".join(own) for own in zip(*(table.texts(table.names.index(n)) for n in columns), strict=True)]


def _by_name(table: Table, log: Table, keys: list[str], theirs: list[str]) -> Ids:
    place: dict[str, int] = {}
    for row, key in enumerate(map(squeeze, theirs)):
        if place.setdefault(key, row) != row:
            raise log.error(row, "", f"expected every name once, got {theirs[row][:80]!r} again")
    rows = np.array([place.get(squeeze(key), -1) for key in keys], dtype=np.int64)
    table.refuse(rows < 0, "", lambda row: f"no row of {log.path.name} is called {keys[row][:80]!r}")
    return rows
