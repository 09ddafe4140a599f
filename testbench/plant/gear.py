"""Gear errors of a joint: its true angle as a function of the commanded one, whatever the load.

true q = commanded q + ratio q + sum over k = 1 ... K of sine_k sin(k q) + cosine_k cos(k q)

Errors of teeth, bearings and encoders are periodic in the joint's angle. A slide has metres for radians.
"""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, BenchError, check_least

HIGHEST = 1000  #: Highest order of a periodic error [1].


@dataclass(frozen=True)
class GearErrors:
    """Describe the random errors of the gears.

    The defaults have the size that tracker readings of a UR10 show: roughly constant up to order 30.
    """

    sigma: float = 30e-6  #: Standard deviation of every coefficient of the flat spectrum [rad].
    orders: int = 30  #: Its highest order, K; 0 for none.
    ratio: float = 0.0  #: Standard deviation of the relative error of the gear ratio [1].

    def __post_init__(self) -> None:
        for name in ("sigma", "ratio"):
            check_least(getattr(self, name), name)
        if not 0 <= self.orders <= HIGHEST:
            raise BenchError(f"orders: expected 0 to {HIGHEST}, got {self.orders}")


@dataclass(frozen=True)
class Gears:
    """Hold the gear errors of one arm, drawn from `GearErrors`."""

    ratio: Array  #: Relative error of the gear ratio, (n,) [1].
    sine: Array  #: Coefficients of sin(k q), k from 1, (orders, n) [rad].
    cosine: Array  #: Coefficients of cos(k q), (orders, n) [rad].


def draw_gears(errors: GearErrors, joints: int, rng: np.random.Generator) -> Gears:
    """Draw gear errors of joints; the errors of an order do not depend on how many orders there are.

    Args:
        errors: Sizes of the errors.
        joints: Number of joints.
        rng: Source of randomness.

    Returns:
        The drawn gears.
    """
    ratio, _ = (
        rng.standard_normal(joints),
        rng.uniform(size=joints),
    )  # spare: arms stay those of the published tables
    spectrum = errors.sigma * rng.standard_normal((errors.orders, 2, joints))
    return Gears(ratio=errors.ratio * ratio, sine=spectrum[:, 0], cosine=spectrum[:, 1])


def gear_error(gears: Gears, q: Array) -> Array:
    """Compute true minus commanded joint angles at the commanded ones.

    Mathematics: `law-11`.

    Args:
        gears: The gears.
        q: Commanded joint angles, (runs, n) [rad].

    Returns:
        Error, (runs, n) [rad].
    """
    order = np.arange(1, len(gears.sine) + 1)[:, None, None]
    periodic = gears.sine[:, None] * np.sin(order * q) + gears.cosine[:, None] * np.cos(order * q)
    return np.asarray(gears.ratio * q + periodic.sum(axis=0))
