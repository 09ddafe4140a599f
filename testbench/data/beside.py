"""What stands beside absolute readings: torques of the joints, temperature, time."""

import re

import numpy as np

from testbench.arm.decimal import is_decimal
from testbench.arm.folder import Arm
from testbench.data.columns import Column, Columns
from testbench.data.joined import clock, seconds
from testbench.data.names import Slot, torque_columns
from testbench.errors import Array, InputError

ROUNDED = re.compile(r"\d([.,]\d*)?[eE]\+?13|\d{6}0{8}")  #: 2,02011E+13: its hour, and more, is gone.


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
    counted, stamp = columns.get(Slot("time", 1)), columns.get(Slot("time"))
    if counted is not None:
        return _if_full(columns, counted)
    if stamp is None:
        return None, []
    texts = columns.table.texts(stamp.index)
    values = clock(texts)
    counted_in = is_decimal(texts[0]) and seconds(texts[0]) is None  # minutes, perhaps
    if values is not None and not counted_in and (np.ptp(values) > 0 or len(texts) == 1):
        return values - values[0], []
    wrong = next((text for text in texts if seconds(text) is None), None)
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
