"""Dates and times as instruments write them."""

import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial

import numpy as np

from testbench.arm.decimal import is_decimal
from testbench.errors import Array

STAMP = re.compile(r"(\d{4})(\d\d)(\d\d)[T_ ]?(\d\d)(\d\d)(\d\d)")  #: 20200714163904.

FRACTION = re.compile(r"(.*?:\d\d|[^.,:]*)(?:[.,](\d+))?(\s*[AP]M|Z)?", re.IGNORECASE | re.DOTALL)
FORMS = (
    "%d.%m.%Y %H:%M:%S", "%d/%m/%Y %H:%M:%S", "%m/%d/%Y %H:%M:%S", "%m/%d/%Y %I:%M:%S %p",
    "%Y/%m/%d %H:%M:%S", "%H:%M:%S", "%d.%m.%Y %H:%M", "%d.%m.%y %H:%M:%S",
)  # fmt: skip
"""Ways of writing a time, of which the first that fits all of a column counts."""


def clock(texts: Sequence[str]) -> Array | None:
    """Seconds of dates and times, or of times of a day, all in one way of writing, (n,); None for others."""
    parts = [FRACTION.fullmatch(text) for text in texts]
    if not texts or not all(parts):
        return None
    plain = [f"{part[1]}{part[3] or ''}" for part in parts if part]
    beyond = np.array([float(f"0.{part[2] or 0}") for part in parts if part])
    ways: list[Callable[[str], float | None]] = [_number, seconds, *(partial(_by, form) for form in FORMS)]
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


def seconds(text: str) -> float | None:
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
