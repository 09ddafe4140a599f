"""The log of a robot, joined to the readings of an instrument by names, by times or by the order of rows."""

from itertools import product

import numpy as np

from testbench.arm.document import is_decimal
from testbench.errors import InputError, Mask
from testbench.files.guessed_names import WORD
from testbench.files.layouts import Fitting
from testbench.files.mapping import Log
from testbench.files.names import column_meaning, squeeze
from testbench.files.rearranged import keys_of, nearest_times, parts_in, times_of
from testbench.files.table import TableCells

SOON = 30.0  #: Farthest row of a log that may be of a reading [s].


def find_join(table: TableCells, log: TableCells, *fits: Fitting | None) -> tuple[Log, Mask]:
    """Find how rows of a log belong to those of a table: by names that it has once each, else by time.

    Args:
        table: The table.
        log: The log.
        fits: The layouts of both, which may say the columns of times.

    Returns:
        That, and which rows of the table have none, the fewer ones, (rows,).
    """
    every = {name: [*map(squeeze, keys_of(log, [name]))] for name in log.names}
    once = {name: {*texts} for name, texts in every.items() if len({*texts}) == len(texts)}
    for ours, (theirs, texts) in product(dict.fromkeys(table.names), once.items()):
        own = [*map(squeeze, keys_of(table, [ours]))]
        alone = np.array([text not in texts for text in own], dtype=bool)
        if alone.mean() < 0.5 and len({*own}) > 1:
            called = squeeze(ours) == squeeze(theirs) or {*map(column_meaning, (ours, theirs))} == {"name"}
            same = called and {*own} <= texts and all(text.isdecimal() for text in texts)
            if same or not all(map(is_decimal, own)):  # numbers are no names, unless both are called so
                return Log(file=log.path.name, on=[ours], to=[theirs]), alone
    for ours, (theirs, _) in product(dict.fromkeys(table.names), once.items()):
        if {column_meaning(ours), column_meaning(theirs)} == {"name"}:
            rows = parts_in(keys_of(table, [ours]), keys_of(log, [theirs]))
            if (rows >= 0).all() and len({*rows.tolist()}) == log.rows > 1:
                how = Log(file=log.path.name, on=[ours], to=[theirs], parts=True)
                return how, np.zeros(table.rows, dtype=bool)
    both = [_times(own, one) for own, one in zip((table, log), fits, strict=True)]
    if not all(both):
        count = table.rows // max(log.rows, 1)
        if table.rows != count * log.rows or not _in_turn(table, count):
            got = f"{table.rows} readings and {log.rows} rows of the log"
            problem = "expected names or times in columns of both files, or as many rows or poses in both"
            raise InputError(log.path, "", f"{problem}, got {got}")
        return Log(file=log.path.name, rows=count), np.zeros(table.rows, dtype=bool)
    when = [times_of(own, names) for own, names in zip((table, log), both, strict=True)]
    late = np.abs(when[1][nearest_times(*when)] - when[0])
    alone = late > SOON
    apart = float(late[~alone].max() if alone.mean() < 0.5 else late.max())
    if apart > SOON:
        problem = f"expected a row within {SOON:g} s of every reading, but one reading is {apart:.4g} s away"
        raise InputError(log.path, "", f"{problem}; do the clocks agree?")
    how = Log(file=log.path.name, on=both[0], to=both[1], within_s=max(1.0, float(np.ceil(2 * apart))))
    return how, alone


def _times(table: TableCells, fits: Fitting | None) -> list[str]:
    """The columns that say together when a row was read: those of its layout, else by their names."""
    own = [name for name in fits.layout.times if name in table.names] if fits else []
    return own or [name for name in table.names if column_meaning(name) == "when"]


def _in_turn(table: TableCells, count: int) -> bool:
    """Whether rows stand together: their names are those of the targets in each group, or one name."""
    if count <= 1:
        return count == 1
    names = [keys_of(table, [name]) for name in table.names if column_meaning(name) == "name"]
    parts = [zip(*map(WORD.findall, texts), strict=False) for texts in names]
    for texts in (*names, *(words for own in parts for words in own)):
        groups = [{*texts[k : k + count]} for k in range(0, len(texts), count)]
        one_each = {*map(len, groups)} == {1} and len({*texts}) == len(groups)
        if one_each or (len(groups[0]) == count and all(group == groups[0] for group in groups)):
            return True
    return False
