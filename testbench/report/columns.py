"""The quantities of tables: columns.toml declares each once, by its key: heading, unit, format."""

import tomllib
from dataclasses import replace
from pathlib import Path

from testbench.plant.true_arms import CALLED
from testbench.report.schema import TableColumn

WORDS = """
    method status interval quantity values rows number truth what verdict why prediction
    solver split fit joint load way unit instrument arm campaign series
"""
COUNTS = "datasets seeds poses run task line pose seed cases trials readings row"
"""Keys of words and of counts that are their own headings."""
NAMES = {"true_arm": CALLED}  #: What readers call the words of a column.


DECLARED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
EVERY = (
    *(TableColumn(key, key.replace("_", " ")) for key in WORDS.split()),
    *(TableColumn(key, key.replace("_", " "), form="d") for key in COUNTS.split()),
    *(TableColumn(key, **{"called": NAMES.get(key, {}), **own}) for key, own in DECLARED.items()),
)
KNOWN = {column.key: column for column in EVERY}
ROUNDING_UM = KNOWN["rms_um"].rounding  #: Errors below are rounding.


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
