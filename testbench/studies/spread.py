"""Rows of many trials as medians with their spread."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from testbench.views.report import Report

Key = tuple[Any, ...]


def grouped(
    rows: Iterable[dict[str, Any]], by: Sequence[str], values: Sequence[str]
) -> dict[Key, dict[str, list[float]]]:
    """Numbers of all trials by group, in the order in which groups first appear.

    Args:
        rows: One a trial and group, or more.
        by: Columns that make a group.
        values: Columns of numbers.
    """
    found: dict[Key, dict[str, list[float]]] = defaultdict(lambda: {name: [] for name in values})
    for row in rows:
        group = found[tuple(row[name] for name in by)]
        for name in values:
            group[name].append(float(row[name]))
    return dict(found)


def spread(numbers: Sequence[float]) -> Report:
    """Median, 5th and 95th percentile."""
    p05, median, p95 = np.percentile(numbers, [5, 50, 95])
    return {"median": float(median), "p05": float(p05), "p95": float(p95)}
