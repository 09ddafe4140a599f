"""Several shots of a point as one reading: their mean, and the noise that their scatter tells."""

from dataclasses import replace

import numpy as np

from testbench.data.columns import Columns
from testbench.data.names import KNOWN, Slot
from testbench.data.rows import first_rows, number_rows

OWN = ("reading", "torque", "temperature", "time", "sigma", "deviation", "spread")
"""Quantities that may differ between shots."""
APART = 2e-3  #: Distance of a shot from the mean of its point beyond which it is of another [m].


def averaged(columns: Columns) -> tuple[Columns, list[str]]:
    """A row a point, where the map says that a file has several shots, and that in words.

    Shots are rows alike in all that says which reading they are: names and loads, without a name the joints.
    The noise of a mean is the pooled scatter over the root of their number, where nothing else says it.
    """
    names, table = columns.names, columns.table
    if not names.layout.average:
        return columns, []
    keys = [c for c in columns.found.values() if c.slot.what not in (*OWN, "joint")]
    if not any(c.slot.what in ("pose", "run") for c in keys):
        keys += columns.every("joint")
    code = number_rows(*(np.array(table.texts(c.index)) for c in keys))
    first, count, squares, free = first_rows(code), np.bincount(code), 0.0, 0
    table = table.take(np.isin(np.arange(table.rows), first))
    for column in columns.every("reading"):
        values = columns.table.numbers(column.index, columns.mark)
        there = np.isfinite(values)
        n = np.bincount(code[there], minlength=len(first))
        mean = np.full(len(first), np.nan)
        np.divide(np.bincount(code[there], values[there], len(first)), n, out=mean, where=n > 0)
        off = (values - mean[code]) * (column.unit.scale if column.unit else 1.0)
        columns.table.refuse(
            np.abs(off) > APART, column.name, f"expected shots of one point within {APART} m"
        )
        squares += float((off[there] ** 2).sum())
        free += int((n[n > 0] - 1).sum())
        table = table.with_numbers(column.index, mean)
    shots, scatter = float(np.median(count)), float(np.sqrt(squares / max(free, 1)))
    words = (
        f"{len(code)} shots are {len(first)} readings, their means; they scatter by {1e6 * scatter:.3g} um"
    )
    silent = columns.said(Slot("sigma")) is None and not columns.every("deviation", "spread")
    if free and scatter > 0 and silent:
        sigma = scatter / np.sqrt(shots)
        names = replace(names, values={**names.values, Slot("sigma"): (sigma, KNOWN["m"])})
        words += f", so sigma is {1e6 * sigma:.3g} um: what all shots of a point share is not in it"
    return replace(columns, names=names, table=table), [words]
