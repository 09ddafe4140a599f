"""What hangs from an arm where nothing else is said, and what is more than it is made for."""

import math
import re
from collections.abc import Iterable, Sequence

from testbench.arm.decimal import is_decimal
from testbench.arm.elastic import PAYLOAD_RANGE
from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY
from testbench.data.units import UNITS, find_unit
from testbench.errors import BenchError

OVERLOAD = 1.5  #: Share of the stated payload beyond which a hung mass is doubted.

MASSES = tuple(unit.name for unit in UNITS if unit.si in ("kg", "N"))
QUANTITY = re.compile(r"\s*([-+.\d]+(?:[eE][-+]?\d+)?)\s*([^\d\s].*)?")


def read_mass(text: str) -> float:
    """A hung mass: 240, 240kg, 530 lb; or its weight, 2354 N [kg]; BenchError for none, or out of range."""
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


def payload_of(arm: Arm, asked: float | None, flag: str) -> float:
    """The mass that was asked for by a flag, else the payload that the arm states [kg], else BenchError."""
    if asked is not None:
        return asked
    if arm.payload is None:
        raise BenchError(f"{flag}: expected a mass [kg], as {arm.name} states no payload in elastic.toml")
    return arm.payload


def overloaded(arm: Arm, masses: Iterable[float]) -> str | None:
    """A sentence where the largest of the masses [kg] is far more than the arm states, else None."""
    mass = max(masses)
    if arm.payload is None or mass <= OVERLOAD * arm.payload:
        return None
    return f"{mass:.4g} kg hang from an arm that states a payload of {arm.payload:g} kg"


def overpulled(arm: Arm, pulls: Iterable[Sequence[float]]) -> str | None:
    """The same of forces that pull at the load point, (3,) each [N]; None of none."""
    force = max((math.hypot(*pull) for pull in pulls), default=0.0)
    if arm.payload is None or force <= OVERLOAD * GRAVITY * arm.payload:
        return None
    return f"{force:.4g} N pull at an arm that states a payload of {arm.payload:g} kg"
