"""Disturbances: effects in a true arm that the identified model does not contain.

All are plain numbers in SI. `testbench.plant.true_arms` builds them into a plant.

Gear errors of a joint are periodic in its angle, because of teeth, bearings and encoders. They do not depend
on the load:

    true q = commanded q + ratio error q + sum over k = 1 ... K of sine_k sin(k q) + cosine_k cos(k q)

Joints that are not linear springs stiffen, have backlash, and have friction. With x = tau / k_0 the
deflection of a linear joint under the torque tau, three effects add up:

- stiffening: the spring deflects by phi with k_0 phi (1 + beta (phi / phi_ref)^2) = tau;
- backlash of half-width b: the sign of the torque selects the side, and the deflection is phi + b tanh(x /
  b). The gap closes where the spring would deflect by b, at about the 3 % of the rated torque at which makers
  measure lost motion;
- hysteresis of half-width h: friction holds the joint until the frictionless deflection y is more than h
  away, then lets it follow: theta = min(max(theta_before, y - h), y + h). This is the play operator
  (Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989): a loop of width 2 h, independent of the
  load.

Elasticity that constant matrices cannot describe:

- A link's compliance depends on the pose: C(q) = D C D with D = diag(exp(w s(q) / 2)). s goes from -1 to 1
  with the angles of some joints; w is the size of the change along each axis.
- Joints are coupled: a torque on one joint deflects others too, by entries of a symmetric matrix.
- Friction slips gradually (Iwan 1966, in Prandtl's form): a joint has many play operators in parallel, whose
  half widths are uniform from 0 to H. A target that moves by d takes the joint along by d^2 / (2 H) until d =
  H, then by d - H / 2: stiff at first, and a hysteresis loop in the end.

At a slide torques are forces, and radians are metres.
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
    """Describe the sizes of random gear errors: a Fourier series in the joint angle, and a ratio error.

    The defaults have the size of the errors in tracker readings of a UR10, roughly equal up to order 30.
    """

    sigma: float = 30e-6  #: Standard deviation of every Fourier coefficient, equal for all orders [rad].
    max_order: int = 30  #: Highest Fourier order K; 0 for no periodic error.
    ratio_sigma: float = 0.0  #: Standard deviation of the relative error of the gear ratio [1].

    def __post_init__(self) -> None:
        """Refuse negative or infinite sizes, and orders beyond `MAX_GEAR_ORDER`, by BenchError."""
        for name in ("sigma", "ratio_sigma"):
            check_least(getattr(self, name), name)
        if not 0 <= self.max_order <= MAX_GEAR_ORDER:
            raise BenchError(f"max_order: expected 0 to {MAX_GEAR_ORDER}, got {self.max_order}")


@dataclass(frozen=True)
class GearErrorCoefficients:
    """Hold the coefficients of the gear errors of one arm's joints, drawn by `draw_gear_errors`."""

    ratio_error: Array  #: Relative error of the gear ratio, (n,) [1].
    sine: Array  #: Coefficients of sin(k q), k from 1, (orders, n) [rad].
    cosine: Array  #: Coefficients of cos(k q), (orders, n) [rad].


def draw_gear_errors(sizes: GearErrors, n_joints: int, rng: np.random.Generator) -> GearErrorCoefficients:
    """Draw the gear errors of all joints; those of one order do not depend on the number of orders.

    Args:
        sizes: Sizes of the errors.
        n_joints: Number of joints.
        rng: Random number generator.

    Returns:
        Coefficients of the errors.
    """
    ratio, _ = (
        rng.standard_normal(n_joints),
        rng.uniform(size=n_joints),
    )  # spare: arms stay those of the published tables
    spectrum = sizes.sigma * rng.standard_normal((sizes.max_order, 2, n_joints))
    return GearErrorCoefficients(
        ratio_error=sizes.ratio_sigma * ratio, sine=spectrum[:, 0], cosine=spectrum[:, 1]
    )


def gear_error(coefficients: GearErrorCoefficients, q: Array) -> Array:
    """Compute the gear errors, ratio_error q + sum_k (sine_k sin(k q) + cosine_k cos(k q)).

    They are true minus commanded joint angles.

    Mathematics: `law-11`.

    Args:
        coefficients: Coefficients of the gear errors.
        q: Commanded joint angles, (runs, n) [rad].

    Returns:
        Error, (runs, n) [rad].
    """
    order = np.arange(1, len(coefficients.sine) + 1)[:, None, None]
    periodic = coefficients.sine[:, None] * np.sin(order * q) + coefficients.cosine[:, None] * np.cos(
        order * q
    )
    return np.asarray(coefficients.ratio_error * q + periodic.sum(axis=0))


@dataclass(frozen=True)
class GeometryErrors:
    """Describe the sizes of random errors of the frames of all joints and of the tool, true minus nominal."""

    #: Standard deviation of a frame's position, along each axis of the link before it [m].
    position_sigma: float
    angle_sigma: float  #: Standard deviation of a frame's rotation, about each of its own axes [rad].

    def __post_init__(self) -> None:
        """Refuse negative or infinite sizes, by BenchError."""
        check_least(self.position_sigma, "position_sigma")
        check_least(self.angle_sigma, "angle_sigma")


@dataclass(frozen=True)
class Disturbances:
    """Describe the effects in a true arm other than linear elasticity; all are off by default.

    Quantities in radians at a hinge are in metres at a slide.
    """

    #: Whether the links have weight; if not, only the payload and a compensator deflect the arm.
    own_weight: bool = False
    compensator: Compensator | None = None  #: Gravity compensator, a spring from link 1 to link 2.
    geometry: GeometryErrors | None = None  #: Sizes of the errors of the geometry.
    #: Standard deviation of each joint's constant offset, true minus commanded q [rad].
    joint_offset_sigma: float = 0.0
    #: Sizes of the gear errors, which vary with the commanded q; they add to the offset.
    gear_errors: GearErrors | None = None
    #: Relative error of the payload's recorded mass, true / recorded - 1 [1]; it scales the whole wrench.
    mass_error: float = 0.0
    #: Standard deviation of true minus recorded load point along each axis of the tool [m]; the error is the
    #: same in all runs.
    load_point_sigma: float = 0.0
    #: Relative gain beta of a joint's stiffness at a deflection of 1 mrad [1].
    stiffening: float = 0.0
    #: Half-width of the backlash of every joint [rad]; the sign of the torque selects the side.
    backlash: float = 0.0
    #: Half-width of the hysteresis loop of every joint [rad], by friction in its gear.
    hysteresis: float = 0.0
    #: Compliance of the foundation over `FOUNDATION_COMPLIANCE` [1]; 0 if rigid.
    foundation_factor: float = 0.0

    def __post_init__(self) -> None:
        """Refuse negative or infinite sizes, and a mass error below -1, by BenchError."""
        for name in (
            "joint_offset_sigma",
            "load_point_sigma",
            "stiffening",
            "backlash",
            "hysteresis",
            "foundation_factor",
        ):
            check_least(getattr(self, name), name)
        check_least(self.mass_error, "mass_error", -1)


KR500_COMPENSATOR = Compensator(
    foot=(-0.48, 0.30, -0.27),
    head=(-0.07, 0.30, 0.26),
    rate=65e3,
    rest_length=0.12,
    stiffness=6.9e6,
)
"""Compensator of models/kr500_l480.

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

NOMINAL_DISTURBANCES = Disturbances(own_weight=True)
"""Disturbances of a true arm that is as its folder describes it: own weight alone."""

TYPICAL_DISTURBANCES = Disturbances(
    own_weight=True,
    compensator=KR500_COMPENSATOR,
    geometry=GeometryErrors(position_sigma=0.5e-3, angle_sigma=8.7e-4),
    joint_offset_sigma=3.5e-4,
    mass_error=2e-3,
    load_point_sigma=2e-3,
    stiffening=0.1,
    backlash=5e-5,
    hysteresis=3e-5,
    foundation_factor=1.0,
)
"""Disturbances of a heavy arm such as models/kr500_l480, of usual sizes.

compensator: see `KR500_COMPENSATOR`. geometry: 0.5 mm and 0.05 deg, inside the 0.1 to 2 mm and 0.01 to 0.1
deg usually found when heavy arms are calibrated [assumed]. joint_offset_sigma: 0.02 deg, joints mastered with
an electronic probe [assumed]. mass_error: 0.2 %, a crane scale [assumed]. load_point_sigma: 2 mm, sling in a
hook [assumed]. stiffening: tangent stiffness of joints 30 % higher at a milliradian, about the deflection of
joints 2 and 3 under load [assumed]; Harmonic Drive's CHA catalogue has 50 to 110 % between a gear's first and
third stiffness [published], for lighter arms. backlash and hysteresis: 2 b = 0.34 and 2 h = 0.21 arc minutes
[assumed], inside the 1 arc minute of lost motion that the same catalogue admits [published].
foundation_factor: all assumed. gear_errors: off; they are the same in both readings of a pair and change a
deflection by 0.03 % [computed], half the effect of joint_offset_sigma.
"""


# --- Joints that are not linear springs: they stiffen, have backlash, and stick -----------------------------

STIFFENING_REFERENCE_ANGLE = 1e-3
"""Deflection phi_ref of a joint at which its stiffness is 1 + beta times that at zero [rad]."""


class TrueJointLaw(Protocol):
    """Define the interface of a joint law that a user adds to the joints of a true arm."""

    def deflection(self, linear_deflection: Array) -> Array:
        """Compute the deflection that the law adds to those of the joints' linear springs.

        Args:
            linear_deflection: Deflections c tau of the linear springs under the whole torque, own weight
                included, (..., n) [rad, m].

        Returns:
            Additional deflection, (..., n) [rad, m].
        """

    def slope(self, linear_deflection: Array) -> Array:
        """Compute the derivative of the law's deflection with respect to that of the linear spring.

        Args:
            linear_deflection: Deflections c tau of the linear springs, (..., n) [rad, m].

        Returns:
            Slope, (..., n) [1].
        """


@dataclass(frozen=True)
class NonlinearJoints:
    """Describe joints that stiffen and have backlash and friction, with their friction history."""

    compliance: Array  #: Compliance of every joint at zero torque, 1 / k_0, (n,) [rad/(N m)].
    stiffening: float  #: Relative gain beta of the stiffness at `STIFFENING_REFERENCE_ANGLE` [1].
    backlash: float  #: Half-width b of the backlash [rad].
    hysteresis: float  #: Half-width h of the hysteresis loop [rad].
    #: Deflections before the present load, (runs, n) [rad]; None for joints without friction history.
    start_deflection: Array | None = None
    #: Largest half-width H of friction that slips gradually, (n,) [rad]; None for none.
    max_slip_half_width: Array | None = None
    user_law: TrueJointLaw | None = None  #: Joint law that a user adds; None for none.

    def select(self, runs: Ids | slice) -> "NonlinearJoints":
        """Select some runs, each with its friction history.

        Args:
            runs: Indices of the runs, (k,), or a slice.

        Returns:
            The joints in these runs.
        """
        return (
            self
            if self.start_deflection is None
            else replace(self, start_deflection=self.start_deflection[runs])
        )


def joint_deflection(joints: NonlinearJoints, torque: Array) -> Array:
    """Compute the deflection theta of nonlinear joints under a torque: stiffening, backlash and friction.

    Mathematics: `law-3`, `law-9`.

    Args:
        joints: The joints, with their friction history.
        torque: Torque, (..., n) [N m].

    Returns:
        Deflection, (..., n) [rad].
    """
    target = _frictionless_deflection(joints, torque)
    if joints.start_deflection is None:
        return target
    held = np.clip(joints.start_deflection, target - joints.hysteresis, target + joints.hysteresis)
    if joints.max_slip_half_width is None:
        return held
    # mean motion of play operators with half widths from 0 to H: d^2 / (2 H) up to d = H, then d - H / 2
    motion, H = held - joints.start_deflection, joints.max_slip_half_width
    d = np.abs(motion)
    return np.asarray(joints.start_deflection + np.sign(motion) * np.where(d < H, d**2 / (2 * H), d - H / 2))


def joint_tangent_compliance(joints: NonlinearJoints, torque: Array) -> Array:
    """Compute the tangent compliance d theta / d torque of nonlinear joints; zero if friction holds a joint.

    Args:
        joints: The joints, with their friction history.
        torque: Torque, (..., n) [N m].

    Returns:
        Compliance, (..., n) [rad/(N m)].
    """
    x = joints.compliance * torque
    phi = _spring_deflection(joints, x)
    rate = 1 / (1 + 3 * joints.stiffening * (phi / STIFFENING_REFERENCE_ANGLE) ** 2)
    if joints.user_law is not None:
        rate = rate + joints.user_law.slope(x)
    if joints.backlash:
        rate += 1 - np.tanh(x / joints.backlash) ** 2
    if joints.start_deflection is not None:
        away = _frictionless_deflection(joints, torque) - joints.start_deflection
        rate[np.abs(away) < joints.hysteresis] = 0
        if joints.max_slip_half_width is not None:
            # fraction of play operators that slip, min(d / H, 1)
            d = np.maximum(np.abs(away) - joints.hysteresis, 0)
            rate *= np.minimum(d / joints.max_slip_half_width, 1.0)
    return joints.compliance * rate


def _frictionless_deflection(joints: NonlinearJoints, torque: Array) -> Array:
    """Compute the deflection without friction, (..., n) [rad]."""
    x = joints.compliance * torque
    deflection = _spring_deflection(joints, x)
    if joints.backlash:
        deflection = deflection + joints.backlash * np.tanh(x / joints.backlash)
    return deflection if joints.user_law is None else deflection + joints.user_law.deflection(x)


def _spring_deflection(joints: NonlinearJoints, x: Array) -> Array:
    """Solve phi + beta phi^3 / phi_ref^2 = x for its real root phi in closed form, (..., n) [rad]."""
    if not joints.stiffening:
        return x
    a = np.sqrt(3 * joints.stiffening) / STIFFENING_REFERENCE_ANGLE
    return np.asarray(2 / a * np.sinh(np.arcsinh(1.5 * a * x) / 3))


@dataclass(frozen=True)
class PoseDependence:
    """Describe how link compliances vary with the pose: by the factor exp(log_change s) along an axis.

    Every link has its own s between -1 and 1, s = sin(phase_per_joint q + phase).
    """

    log_compliance_change: Array  #: Log of the factor at s = 1, for every axis of every link, (links, 6) [1].
    phase_per_joint: Array  #: Change of the sine's phase per unit of every joint, (links, n) [1, rad/m].
    phase: Array  #: Phase of every link's sine at q = 0, (links,) [rad].

    def root_factors(self, q: Array) -> Array:
        """Compute the square roots of the factors of the link compliances, exp(log_change s / 2).

        With D the diagonal matrix of these numbers, the compliance in a pose is D C D.

        Args:
            q: Commanded joints, (poses, n) [rad, m].

        Returns:
            Square roots, (poses, 6 links) [1].
        """
        s = np.sin((q[:, None, :] * self.phase_per_joint).sum(axis=2) + self.phase)
        return np.asarray(np.exp(s[..., None] * self.log_compliance_change / 2).reshape(len(q), -1))


@dataclass(frozen=True)
class SpringEffects:
    """Hold elastic effects of a true arm that constant compliances cannot describe; None for no effect."""

    pose_dependence: PoseDependence | None = None  #: Change of link compliances with the pose.
    #: Compliance that couples joints, symmetric with a zero diagonal, (n, n) [rad/(N m)].
    joint_coupling: Array | None = None
    #: Largest half width H of friction that slips gradually, of every joint, (n,) [rad, m].
    max_slip_half_width: Array | None = None
    joint_law: TrueJointLaw | None = None  #: Joint law that adds a deflection to those of the linear springs.
