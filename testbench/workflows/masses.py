"""Masses that hang from an arm: as people write them, as the arm states them, and beyond what it states."""

import math
import re
from collections.abc import Iterable, Sequence

from testbench.arm.document import is_decimal
from testbench.arm.elastic import PAYLOAD_RANGE
from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY
from testbench.errors import BenchError
from testbench.files.names import UNITS, find_unit

OVERLOAD = 1.5  #: Share of the stated payload beyond which a hung mass is doubted.
MASSES = tuple(unit.name for unit in UNITS if unit.si in ("kg", "N"))
QUANTITY = re.compile(r"\s*([-+.\d]+(?:[eE][-+]?\d+)?)\s*([^\d\s].*)?")


def read_mass(text: str) -> float:
    """Read a hung mass: 240, 240kg, 530 lb; or its weight, 2354 N [kg]; BenchError if wrong."""
    parts = QUANTITY.fullmatch(text)
    if parts is None or not is_decimal(parts[1]):
        raise BenchError("expected a mass such as 240, 240kg or 530lb")
    unit = find_unit(parts[2] or "kg")
    if unit is None or unit.name not in MASSES:
        raise BenchError(f"expected one of the units {', '.join(MASSES)}")
    found = float(parts[1]) * unit.scale / (GRAVITY if unit.si == "N" else 1.0)
    low, high = PAYLOAD_RANGE
    if not low <= found <= high:
        raise BenchError(f"expected {low:g} to {high:g} kg")
    return found


def read_masses(text: str) -> list[float]:
    """Read masses, MASS,MASS ... [kg]; BenchError for anything but different ones that can hang."""
    try:
        masses = [read_mass(part) for part in text.split(",")]
    except BenchError as err:
        raise BenchError(f"--loads: {err}, got {text[:80]!r}") from err
    if len(set(masses)) < len(masses):
        raise BenchError(f"--loads: expected different masses, got {text[:80]!r}")
    return masses


def payload_of(arm: Arm, asked: float | None, flag: str) -> float:
    """Return the mass that a flag asks for, else the payload that the arm states, else BenchError.

    Args:
        arm: Description of the arm.
        asked: Mass of the flag [kg]; None if not given.
        flag: Name of the flag.

    Returns:
        Mass [kg].
    """
    if asked is not None:
        return asked
    if arm.payload is None:
        raise BenchError(f"{flag}: expected a mass [kg], as {arm.name} states no payload in elastic.toml")
    return arm.payload


def overload_warnings(arm: Arm, masses: Iterable[float], pulls: Iterable[Sequence[float]] = ()) -> list[str]:
    """Warn of masses or pulls far beyond the payload that the arm states.

    Args:
        arm: Description of the arm.
        masses: Masses [kg].
        pulls: Forces, (3,) each [N].

    Returns:
        Sentences.
    """
    most = OVERLOAD * (math.inf if arm.payload is None else arm.payload)
    mass, force = max(masses), max((math.hypot(*pull) for pull in pulls), default=0.0)
    stated = f"an arm that states a payload of {arm.payload or 0:g} kg"
    found = [f"{mass:.4g} kg hang from {stated}"] * (mass > most)
    return found + [f"{force:.4g} N pull at {stated}"] * (force > GRAVITY * most)
