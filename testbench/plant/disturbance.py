"""Effects in a true arm that the identified model does not contain: each disturbance is one switch.

All are plain numbers in SI, so that a scenario or a manifest can hold them. `testbench.plant.true_arms`
builds them into a plant.

Gear errors of a joint are periodic in its angle, by teeth, bearings and encoders, whatever the load:

    true q = commanded q + ratio q + sum over k = 1 ... K of sine_k sin(k q) + cosine_k cos(k q)

Joints that are not linear springs stiffen, have backlash, and stick. With x = tau / k_0 the turn of a linear
joint under the torque tau, three effects add up:

- stiffening: the spring turns by phi with k_0 phi (1 + beta (phi / phi_ref)^2) = tau;
- backlash of half-width b, on the side that the torque's sign selects: the turn is phi + b tanh(x / b). It is
  taken up where the spring would turn by b, at about the 3 % of the rated torque at which makers measure lost
  motion;
- hysteresis of half-width h: friction holds the joint until the turn y without friction is more than h away,
  then lets it follow: theta = min(max(theta_before, y - h), y + h). This is the play operator (Krasnosel'skii
  and Pokrovskii, Systems with Hysteresis, 1989): a loop 2 h wide, whatever the load.

Elasticity that constant matrices cannot describe:

- A link's compliance depends on the pose: C(q) = D C D with D = diag(exp(w s(q) / 2)). s goes from -1 to 1
  with the angles of some joints; w is the size of the change along each axis.
- Joints are coupled: a torque on one joint turns others too, by entries of a symmetric matrix.
- Friction slips gradually (Iwan 1966, in Prandtl's form): a joint has many play operators in parallel, whose
  half widths are uniform from 0 to the slip H. A target that moves away by d takes the joint along by d^2 /
  (2 H) until d = H, then by d - H / 2: stiff at first, and a hysteresis loop in the end.

A slide has forces for torques and metres for radians.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from testbench.arm.folder import Compensator
from testbench.errors import Array, BenchError, Ids, check_least

# --- Effects in a true arm that the identified model does not contain: each disturbance is one switch -------

MAX_GEAR_ORDER = 1000  #: Highest order of a periodic error [1].


@dataclass(frozen=True)
class GearErrors:
    """Describe the random errors of the gears.

    The defaults have the size that tracker readings of a UR10 show: roughly constant up to order 30.
    """

    sigma: float = 30e-6  #: Standard deviation of every coefficient of the flat spectrum [rad].
    orders: int = 30  #: Highest order of the spectrum, K; 0 for none.
    ratio: float = 0.0  #: Standard deviation of the relative error of the gear ratio [1].

    def __post_init__(self) -> None:
        for name in ("sigma", "ratio"):
            check_least(getattr(self, name), name)
        if not 0 <= self.orders <= MAX_GEAR_ORDER:
            raise BenchError(f"orders: expected 0 to {MAX_GEAR_ORDER}, got {self.orders}")


@dataclass(frozen=True)
class Gears:
    """Hold the gear errors of one arm, drawn from `GearErrors`."""

    ratio: Array  #: Relative error of the gear ratio, (n,) [1].
    sine: Array  #: Coefficients of sin(k q), k from 1, (orders, n) [rad].
    cosine: Array  #: Coefficients of cos(k q), (orders, n) [rad].


def draw_gears(errors: GearErrors, joints: int, rng: np.random.Generator) -> Gears:
    """Draw the gear errors of all joints; those of one order do not depend on the number of orders.

    Args:
        errors: Sizes of the errors.
        joints: Number of joints.
        rng: Source of randomness.
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
    foundation: float = 0.0  #: Compliance of the foundation over `FOUNDATION_COMPLIANCE` [1].

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

FOUNDATION_COMPLIANCE = (1e-9, 1e-9, 0.5e-9, 2.5e-9, 2.5e-9, 1.5e-9)
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

compensator: its own comment marks published and assumed numbers. geometry: 0.5 mm and 0.05 deg, inside the
0.1 to 2 mm and 0.01 to 0.1 deg usually found when heavy arms are calibrated [assumed]. sensor_offset: 0.02
deg, joints mastered with an electronic probe [assumed]. mass_error: 0.2 %, a crane scale [assumed].
centre_error: 2 mm, sling in a hook [assumed]. stiffening: joints 30 % stiffer at a milliradian, about the
load's turn of joints 2 and 3 [assumed]; Harmonic Drive's CHA catalogue has 50 to 110 % between a gear's first
and third stiffness [published], for lighter arms. backlash and hysteresis: 2 b = 0.34 and 2 h = 0.21 arc
minutes [assumed], inside the 1 arc minute of lost motion that the same catalogue admits [published].
foundation: all assumed. gear: off; its errors are in both readings of a pair and change a deflection by a
share of 3e-4 [computed], half the effect of sensor_offset.
"""


# --- Joints that are not linear springs: they stiffen, have backlash, and stick -----------------------------

STIFFENING_REFERENCE = 1e-3
"""Turn phi_ref at which a joint's stiffness has grown by the share beta [rad]."""


class TrueLaw(Protocol):
    """Define an elastic effect that a user adds to the linear springs of the joints of a true arm."""

    def deflection(self, x: Array) -> Array:
        """Compute the deflection of the joints in addition to that of their linear springs.

        Args:
            x: Deflection of the linear springs by the whole torque, own weight too, (..., n) [rad, m].

        Returns:
            Deflection, (..., n) [rad, m].
        """

    def slope(self, x: Array) -> Array:
        """Compute the derivative of `deflection` with respect to x.

        Args:
            x: Deflection of the linear springs, (..., n) [rad, m].

        Returns:
            Slope, (..., n) [1].
        """


@dataclass(frozen=True)
class TrueJointLaws:
    """Define the deflection of every joint of a true arm as a nonlinear function of its torque."""

    compliance: Array  #: Compliance of the joints at no torque, 1 / k_0, (n,) [rad/(N m)].
    stiffening: float  #: beta [1].
    backlash: float  #: Half-width b of the backlash [rad].
    hysteresis: float  #: Half-width h of the hysteresis loop [rad].
    #: Deflections from which the joints come, (..., n) [rad]; None for joints without friction history.
    start_deflection: Array | None = None
    #: Largest half-width H of friction that slips gradually, (n,) [rad]; None for none.
    slip: Array | None = None
    user_law: TrueLaw | None = None  #: Effect that a user adds; None for none.

    def select(self, runs: Ids | slice) -> "TrueJointLaws":
        """Select the laws of some runs.

        Args:
            runs: Indices of the runs, (k,), or a slice.

        Returns:
            Laws with the friction history of these runs.
        """
        return (
            self
            if self.start_deflection is None
            else replace(self, start_deflection=self.start_deflection[runs])
        )


def joint_deflection(law: TrueJointLaws, torque: Array) -> Array:
    """Compute the deflection theta of nonlinear joints under a torque: stiffening, backlash and friction.

    Mathematics: `law-3`, `law-9`.

    Args:
        law: Law of the joints.
        torque: Torque, (..., n) [N m].

    Returns:
        Turn, (..., n) [rad].
    """
    target = _frictionless_turn(law, torque)
    if law.start_deflection is None:
        return target
    held = np.clip(law.start_deflection, target - law.hysteresis, target + law.hysteresis)
    return (
        held
        if law.slip is None
        else law.start_deflection + gradual_slip_motion(held - law.start_deflection, law.slip)
    )


def joint_tangent_compliance(law: TrueJointLaws, torque: Array) -> Array:
    """Compute the tangent compliance d theta / d torque of joints; zero where friction holds.

    Args:
        law: Law of the joints.
        torque: Torque, (..., n) [N m].

    Returns:
        Compliance, (..., n) [rad/(N m)].
    """
    x = law.compliance * torque
    phi = _spring_turn(law, x)
    rate = 1 / (1 + 3 * law.stiffening * (phi / STIFFENING_REFERENCE) ** 2)
    if law.user_law is not None:
        rate = rate + law.user_law.slope(x)
    if law.backlash:
        rate += 1 - np.tanh(x / law.backlash) ** 2
    if law.start_deflection is not None:
        away = _frictionless_turn(law, torque) - law.start_deflection
        rate[np.abs(away) < law.hysteresis] = 0
        if law.slip is not None:
            rate *= slipping_share(np.maximum(np.abs(away) - law.hysteresis, 0), law.slip)
    return law.compliance * rate


def _frictionless_turn(law: TrueJointLaws, torque: Array) -> Array:
    """Compute the turn without friction, (..., n) [rad]."""
    x = law.compliance * torque
    target = _spring_turn(law, x) + _backlash_turn(law, x)
    return target if law.user_law is None else target + law.user_law.deflection(x)


def _spring_turn(law: TrueJointLaws, x: Array) -> Array:
    """Solve phi + beta phi^3 / phi_ref^2 = x for its real root phi in closed form, (..., n) [rad]."""
    if not law.stiffening:
        return x
    a = np.sqrt(3 * law.stiffening) / STIFFENING_REFERENCE
    return np.asarray(2 / a * np.sinh(np.arcsinh(1.5 * a * x) / 3))


def _backlash_turn(law: TrueJointLaws, x: Array) -> Array:
    return law.backlash * np.tanh(x / law.backlash) if law.backlash else np.zeros_like(x)


@dataclass(frozen=True)
class PoseDependence:
    """Describe how the compliances of links vary with the pose, by a factor exp(log_change s) per axis.

    Every link has one s between -1 and 1: s = sin(phase_rates q + phase).
    """

    log_change: Array  #: Logarithm of the compliance along every axis of a link at s = 1, (links, 6) [1].
    phase_rates: Array  #: Change of the phase of the sine per unit of every joint, (links, n) [1, rad/m].
    phase: Array  #: Phase of every link, (links,) [rad].

    def factors(self, q: Array) -> Array:
        """Compute the factors of the roots of the link compliances, exp(log_change s / 2), in every pose.

        They refer to the compliances of the arm's folder.

        Args:
            q: Commanded joints, (poses, n) [rad, m].

        Returns:
            Factors, (poses, 6 links) [1].
        """
        s = np.sin((q[:, None, :] * self.phase_rates).sum(axis=2) + self.phase)
        return np.asarray(np.exp(s[..., None] * self.log_change / 2).reshape(len(q), -1))


@dataclass(frozen=True)
class SpringEffects:
    """Hold effects of a true arm's springs that constant compliances cannot describe; None for no effect."""

    pose_dependence: PoseDependence | None = None
    #: Compliance that couples joints, symmetric with a zero diagonal, (n, n) [rad/(N m)].
    joint_coupling: Array | None = None
    slip: Array | None = None  #: Largest half width H of the friction of every joint, (n,) [rad, m].
    law: TrueLaw | None = None  #: Turn of the joints in addition to their linear springs.


def gradual_slip_motion(d: Array, slip: Array) -> Array:
    """Compute how far friction elements of half widths from 0 to `slip` follow a target that moved.

    Args:
        d: Motion of the target, (..., n) [rad].
        slip: Largest half width of a joint's elements, (n,), broadcast to d [rad].

    Returns:
        Mean motion of the elements, (..., n) [rad].
    """
    far = np.abs(d)
    return np.asarray(np.sign(d) * np.where(far < slip, far**2 / (2 * slip), far - slip / 2))


def slipping_share(d: Array, slip: Array) -> Array:
    """Compute the share of friction elements that slip when their target has moved, min(|d| / slip, 1).

    Args:
        d: Motion of the target, (..., n) [rad].
        slip: Largest half width of a joint's elements, (n,), broadcast to d [rad].

    Returns:
        Share, (..., n) [1].
    """
    return np.asarray(np.minimum(np.abs(d) / slip, 1.0))
