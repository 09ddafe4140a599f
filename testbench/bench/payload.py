"""What hangs from an arm where nothing else is said, and what is more than it is made for."""

import math
from collections.abc import Iterable, Sequence

from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY
from testbench.errors import BenchError

OVERLOAD = 1.5  #: Share of the stated payload beyond which a hung mass is doubted.


def payload_of(arm: Arm, asked: float | None, flag: str) -> float:
    """The mass that was asked for by a flag, else the payload that the arm states [kg].

    Raises:
        BenchError: When neither is there.
    """
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
