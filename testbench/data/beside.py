"""What stands beside absolute readings: torques of the joints, temperature, time."""

import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial

import numpy as np

from testbench.arm.decimal import is_decimal
from testbench.arm.folder import Arm
from testbench.data.columns import Column, Columns
from testbench.data.names import Slot, torque_columns
from testbench.errors import Array, InputError

ROUNDED = re.compile(r"\d([.,]\d*)?[eE]\+?13|\d{6}0{8}")  #: 2,02011E+13: its hour, and more, is gone.
STAMP = re.compile(r"(\d{4})(\d\d)(\d\d)[T_ ]?(\d\d)(\d\d)(\d\d)")  #: 20200714163904.

FRACTION = re.compile(r"(.*?:\d\d|[^.,:]*)(?:[.,](\d+))?(\s*[AP]M|Z)?", re.IGNORECASE | re.DOTALL)
FORMS = (
    "%d.%m.%Y %H:%M:%S", "%d/%m/%Y %H:%M:%S", "%m/%d/%Y %H:%M:%S", "%m/%d/%Y %I:%M:%S %p",
    "%Y/%m/%d %H:%M:%S", "%H:%M:%S", "%d.%m.%Y %H:%M", "%d.%m.%y %H:%M:%S",
)  # fmt: skip
"""Ways of writing a time, of which the first that fits all of a column counts."""


def read_torques(columns: Columns, arm: Arm) -> Array | None:
    """Torques of the joints, (rows, n) [N m, N]; None without such columns.

    Raises:
        InputError: When a joint has none.
    """
    found = columns.whole(torque_columns(arm))
    return np.column_stack([columns.full(column) for column in found]) if found else None


def read_temperature(columns: Columns) -> tuple[Array | None, list[str]]:
    """Temperature, (rows,) [degree Celsius]; None where a cell holds no number."""
    column = columns.get(Slot("temperature"))
    if column is None:
        return None, []
    return _if_full(columns, column)


def read_time(columns: Columns) -> tuple[Array | None, list[str]]:
    """Time since the first row, (rows,) [s]; None where the cells are no times."""
    seconds, stamp = columns.get(Slot("time", 1)), columns.get(Slot("time"))
    if seconds is not None:
        return _if_full(columns, seconds)
    if stamp is None:
        return None, []
    texts = columns.table.texts(stamp.index)
    found = {text: _seconds(text) for text in dict.fromkeys(texts)}
    wrong = next((text for text, value in found.items() if value is None), None)
    if wrong is not None and len(found) > 1 and (told := clock(texts)) is not None:
        return told - told[0], []
    if wrong is None and (len(found) > 1 or len(texts) == 1):
        values = np.array([found[text] for text in texts], dtype=float)
        return values - values[0], []
    if wrong is not None and ROUNDED.fullmatch(wrong):
        return None, [f"{stamp.name}: {wrong!r} is a time that a spreadsheet rounded: no time is read"]
    got = f"{wrong[:40]!r}" if wrong is not None else f"{texts[0][:40]!r} in every row"
    return None, [f"{stamp.name}: expected 20200714163904 or 2020-07-14 16:39:04, got {got}: no time is read"]


def _if_full(columns: Columns, column: Column) -> tuple[Array | None, list[str]]:
    """A column of numbers, (rows,), or why it is not read: no reading is refused for what stands beside."""
    try:
        return columns.full(column), []
    except InputError:
        return None, [f"{column.name}: blank or no number in a row, not read"]


def clock(texts: Sequence[str]) -> Array | None:
    """Seconds of dates and times, or of times of a day, all in one way of writing, (n,); None for others."""
    parts = [FRACTION.fullmatch(text) for text in texts]
    if not texts or not all(parts):
        return None
    plain = [f"{part[1]}{part[3]}" for part in parts if part]
    beyond = np.array([float(f"0.{part[2] or 0}") for part in parts if part])
    ways: list[Callable[[str], float | None]] = [_number, _seconds, *(partial(_by, form) for form in FORMS)]
    for way in ways:
        found = [way(text) for text in plain]
        if None not in found:
            return np.asarray(np.array(found, dtype=float) + beyond)
    return None


def _number(text: str) -> float | None:
    return float(text) if is_decimal(text) and not STAMP.fullmatch(text) else None


def _by(form: str, text: str) -> float | None:
    try:
        return datetime.strptime(text, form).replace(tzinfo=UTC).timestamp()
    except ValueError:
        return None


def _seconds(text: str) -> float | None:
    """Seconds of a date and time since 1970; None for anything else."""
    stamp = STAMP.fullmatch(text)
    try:
        when = (
            datetime.strptime("".join(stamp.groups()), "%Y%m%d%H%M%S")
            if stamp
            else datetime.fromisoformat(text)
        )
    except ValueError:
        return None
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()
