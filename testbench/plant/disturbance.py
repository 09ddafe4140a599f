"""Effects in a true arm that the identified model does not contain: each disturbance is one switch.

All are plain numbers in SI, so that a scenario or a manifest can hold them. `testbench.plant.true_arms`
builds them into a plant.

Gear errors of a joint: its true angle as a function of the commanded one, whatever the load.

true q = commanded q + ratio q + sum over k = 1 ... K of sine_k sin(k q) + cosine_k cos(k q)

Errors of teeth, bearings and encoders are periodic in the joint's angle. A slide has metres for radians.
"""

from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.folder import Compensator
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


@dataclass(frozen=True)
class GeometryErrors:
    """Describe errors of every joint's frame, and of the tool's, relative to the nominal geometry."""

    position: float  #: Standard deviation along each axis of the link before it [m].
    angle: float  #: Standard deviation about each of its own axes [rad].

    def __post_init__(self) -> None:
        check_least(self.position, "position")
        check_least(self.angle, "angle")


@dataclass(frozen=True)
class Disturbances:
    """Describe the effects of the true arm other than linear elasticity; all are off by default.

    Quantities in radians at a hinge are in metres at a slide.
    """

    #: Whether its links have weight. Otherwise only the payload, and a compensator, deflect it.
    own_weight: bool = False
    compensator: Compensator | None = None  #: Spring from link 1 to link 2.
    geometry: GeometryErrors | None = None  #: Errors of the nominal geometry.
    #: Standard deviation of each joint's constant offset [rad]: true q = commanded q + offset.
    sensor_offset: float = 0.0
    #: Errors of the gears as functions of the commanded q, in addition to the offset.
    gear: GearErrors | None = None
    #: True over recorded weight of the payload, less one [1]; it scales the whole wrench.
    mass_error: float = 0.0
    #: Standard deviation of the true load point about the recorded one, along each axis of the tool [m];
    #: constant over all runs.
    centre_error: float = 0.0
    #: Share beta by which a joint is stiffer when its spring is turned by a milliradian [1].
    stiffening: float = 0.0
    #: Half-width of the backlash of every joint [rad]; the sign of the torque selects the side.
    backlash: float = 0.0
    #: Half-width of the hysteresis loop of every joint [rad], by friction in its gear.
    hysteresis: float = 0.0
    foundation: float = 0.0  #: Compliance of the foundation over `FOUNDATION` [1].

    def __post_init__(self) -> None:
        for name in ("sensor_offset", "centre_error", "stiffening", "backlash", "hysteresis", "foundation"):
            check_least(getattr(self, name), name)
        check_least(self.mass_error, "mass_error", -1)


KR500_COMPENSATOR = Compensator(
    foot=(-0.48, 0.30, -0.27),
    head=(-0.07, 0.30, 0.26),
    rate=65e3,
    rest_length=0.12,
    stiffness=6.9e6,
)
"""For models/kr500_l480.

foot: the rear end of the strut drawn in rigid.xml [assumed, by eye]. head: 0.27 m from axis 2 inside the
drawn hub, on the line from axis to foot when the upper arm is upright, along which the strut is drawn
[assumed]. rate and rest_length: 41 kN upright, 60 kN stretched, where it carries about the arm's own weight,
16 kN m [assumed].

stiffness: 1 / 0.144e-6 N/m. 0.144e-6 is [published] for a KR 270 with 0.302e-6 rad/(N m) of its joint 2,
without its unit; that it is the strut's own compliance in m/N is our reading. K_eq is then at most 4 % of the
stiffness of joint 2, which agrees with the 4.8 % that the paper quotes. `STIFF_COMPENSATOR` is the other
reading.
"""

STIFF_COMPENSATOR = replace(KR500_COMPENSATOR, stiffness=9.6e7)
"""Compensator of the KR 500 with 0.144e-6 read as a compliance of joint 2 in rad/(N m).

K_eq at the best lever is then 1 / 0.144e-6 = 6.9e6 N m/rad, half of the stiffness of joint 2. A plain spring
of that stiffness is impossible: turning joint 2 by a radian would take 400 times the torque of the arm's own
weight.
"""

FOUNDATION = (1e-9, 1e-9, 0.5e-9, 2.5e-9, 2.5e-9, 1.5e-9)
"""Diagonal of the compliance below the base, at its origin, world axes [m/N, rad/(N m)]. All assumed:
anchored in a concrete floor, 4e8 N m/rad against rocking. The base casting of models/kr500_l480 itself has
6e-9 rad/(N m)."""

NOMINAL = Disturbances(own_weight=True)
"""An arm as its folder describes it."""

TYPICAL = Disturbances(
    own_weight=True,
    compensator=KR500_COMPENSATOR,
    geometry=GeometryErrors(position=0.5e-3, angle=8.7e-4),
    sensor_offset=3.5e-4,
    mass_error=2e-3,
    centre_error=2e-3,
    stiffening=0.1,
    backlash=5e-5,
    hysteresis=3e-5,
    foundation=1.0,
)
"""A heavy arm such as models/kr500_l480.

compensator: says itself what is published and what assumed. geometry: 0.5 mm and 0.05 deg, inside the 0.1 to
2 mm and 0.01 to 0.1 deg usually found when heavy arms are calibrated [assumed]. sensor_offset: 0.02 deg,
joints mastered with an electronic probe [assumed]. mass_error: 0.2 %, a crane scale [assumed]. centre_error:
2 mm, sling in a hook [assumed]. stiffening: joints 30 % stiffer at a milliradian, about the load's turn of
joints 2 and 3 [assumed]; Harmonic Drive's CHA catalogue has 50 to 110 % between a gear's first and third
stiffness [published], for lighter arms. backlash and hysteresis: 2 b = 0.34 and 2 h = 0.21 arc minutes
[assumed], inside the 1 arc minute of lost motion that the same catalogue admits [published]. foundation: all
assumed. gear: off; its errors stand in both readings of a pair and change a deflection by 3e-4 of it
[computed], half of what sensor_offset does.
"""
