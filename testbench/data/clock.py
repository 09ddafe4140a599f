"""Dates and times as instruments write them."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from testbench.arm.decimal import is_decimal
from testbench.errors import Array

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
