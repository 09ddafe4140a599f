"""Gear errors of a joint: its true angle is a function of the commanded one, whatever it carries.

true q = commanded q + ratio q + sum over k = 1 ... K of sine_k sin(k q) + cosine_k cos(k q)

Teeth, bearings and encoders repeat with a turn of the joint; the wave generator of a strain wave gear draws
one line, at twice the gear ratio. A slide has metres for radians.
"""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, BenchError, check_least

HIGHEST = 1000  #: Highest order of a periodic error [1].


@dataclass(frozen=True)
class GearErrors:
    """How far the joints turn from what they are commanded to.

    The defaults are of the size that tracker readings of a UR10 show: about flat up to order 30.
    """

    sigma: float = 30e-6  #: Standard deviation of every coefficient of the flat spectrum [rad].
    orders: int = 30  #: Its highest order, K; 0 for none.
    ratio: float = 0.0  #: Standard deviation of the relative error of the gear ratio [1].
    line: float = 0.0  #: Amplitude of one more line, of random phase in every joint [rad].
    line_order: int = 1  #: Its order, such as twice the gear ratio.

    def __post_init__(self) -> None:
        for name in ("sigma", "ratio", "line"):
            check_least(getattr(self, name), name)
        for name, least in (("orders", 0), ("line_order", 1)):
            if not least <= getattr(self, name) <= HIGHEST:
                raise BenchError(f"{name}: expected {least} to {HIGHEST}, got {getattr(self, name)}")


@dataclass(frozen=True)
class Gears:
    """The gear errors of one arm, drawn."""

    ratio: Array  #: Relative error of the gear ratio, (n,) [1].
    sine: Array  #: Coefficients of sin(k q), k from 1, (orders, n) [rad].
    cosine: Array  #: Coefficients of cos(k q), (orders, n) [rad].


def draw_gears(errors: GearErrors, joints: int, rng: np.random.Generator) -> Gears:
    """Errors of so many joints; those of an order do not depend on how many orders there are."""
    ratio, phase = rng.standard_normal(joints), rng.uniform(-np.pi, np.pi, joints)
    highest = max(errors.orders, errors.line_order if errors.line else 0)
    spectrum = np.zeros((highest, 2, joints))
    spectrum[: errors.orders] = errors.sigma * rng.standard_normal((errors.orders, 2, joints))
    if errors.line:
        spectrum[errors.line_order - 1] += errors.line * np.array([np.cos(phase), np.sin(phase)])
    return Gears(ratio=errors.ratio * ratio, sine=spectrum[:, 0], cosine=spectrum[:, 1])


def gear_error(gears: Gears, q: Array) -> Array:
    """True minus commanded joint angles at the commanded ones, (runs, n) [rad]."""
    order = np.arange(1, len(gears.sine) + 1)[:, None, None]
    periodic = gears.sine[:, None] * np.sin(order * q) + gears.cosine[:, None] * np.cos(order * q)
    return np.asarray(gears.ratio * q + periodic.sum(axis=0))
