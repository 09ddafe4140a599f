"""A robot's log beside a tracker's file: each reading gets the row of its name, or of the nearest time."""

import numpy as np

from testbench.data.clock import clock
from testbench.data.dataset import Ids
from testbench.data.mapping import Layout, Log, Names
from testbench.data.names import squeeze
from testbench.data.table import Table, read_table
from testbench.errors import InputError


def with_log(table: Table, names: Names) -> Table:
    """The table with the columns of the log that a map names; as it is where the map names none."""
    if names.log is None or names.path is None:
        return table
    file = names.path.parent / names.log.file
    log = read_table(file, lambda name: names.find(name) is not None, Layout())
    return joined(table, log, names.log)


def joined(table: Table, log: Table, how: Log) -> Table:
    """The table with those columns of a log that it has not.

    Raises:
        InputError: At the first reading without a row of the log, and at a name that the log has twice.
    """
    on = [how.on] if isinstance(how.on, str) else how.on
    to = on if how.to is None else [how.to] if isinstance(how.to, str) else how.to
    keys, theirs = _keys(table, on), _keys(log, to)
    rows = (
        _by_name(table, log, keys, theirs)
        if how.within_s is None
        else _by_time(table, log, how, keys, theirs)
    )
    return table.beside(log, rows)


def _keys(table: Table, columns: list[str]) -> list[str]:
    """What columns say together, row by row."""
    if missing := [name for name in columns if name not in table.names]:
        raise table.header_error(f"no column {missing[0]!r} to join by; columns are {list(table.names)}")
    parts = (table.texts(table.names.index(name)) for name in columns)
    return [" ".join(own) for own in zip(*parts, strict=True)]


def _by_name(table: Table, log: Table, keys: list[str], theirs: list[str]) -> Ids:
    place: dict[str, int] = {}
    for row, key in enumerate(map(squeeze, theirs)):
        if place.setdefault(key, row) != row:
            raise log.error(row, "", f"expected every name once, got {theirs[row][:80]!r} again")
    for row, key in enumerate(keys):
        if squeeze(key) not in place:
            raise table.error(row, "", f"no row of {log.path.name} is called {key[:80]!r}")
    return np.array([place[squeeze(key)] for key in keys], dtype=int)


def _by_time(table: Table, log: Table, how: Log, keys: list[str], theirs: list[str]) -> Ids:
    ours, when = clock(keys), clock(theirs)
    for own, texts, found in ((table, keys, ours), (log, theirs, when)):
        if found is None:
            raise InputError(own.path, "", f"expected times in the column to join by, got {texts[0][:80]!r}")
    assert ours is not None
    assert when is not None
    order = np.argsort(when, kind="stable")
    after = (
        np.searchsorted(when[order], ours).clip(1, len(order) - 1)
        if len(order) > 1
        else np.zeros(len(ours), int)
    )
    near = np.where(ours - when[order][after - 1] <= when[order][after] - ours, after - 1, after)
    rows = np.asarray(order[near])
    apart = np.abs(when[rows] - ours)
    most = f"expected a row of {log.path.name} within {how.within_s:g} s, the nearest is"
    table.refuse(apart > (how.within_s or 0.0), "", lambda row: f"{most} {apart[row]:.4g} s away")
    return rows
