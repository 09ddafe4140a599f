"""Joints that are not linear springs: they stiffen, have backlash, and stick.

With x = tau / k_0 the turn of a linear joint under the torque tau, three effects add up:

- stiffening: the spring turns by phi with k_0 phi (1 + beta (phi / phi_ref)^2) = tau;
- backlash of half-width b, on the side that the torque's sign selects: the turn is phi + b tanh(x / b). It is
  taken up where the spring would turn by b, at about the 3 % of the rated torque at which makers measure lost
  motion;
- hysteresis of half-width h: friction holds the joint until the turn y without friction is more than h away,
  then lets it follow: theta = min(max(theta_before, y - h), y + h). This is the play operator (Krasnosel'skii
  and Pokrovskii, Systems with Hysteresis, 1989): a loop 2 h wide, whatever the load. Where friction slips
  gradually, the rest of the way beyond h counts as in `testbench.plant.joint_law`.

A slide has forces for torques and metres for radians.

Elasticity of true arms that constant matrices cannot describe: pose dependence, coupling, slip.

- A link's compliance depends on the pose: C(q) = D C D with D = diag(exp(w s(q) / 2)). s goes from -1 to 1
  with the angles of some joints; w is the size of the change along each axis.
- Joints are coupled: a torque on one joint turns others too, by entries of a symmetric matrix.
- Friction slips gradually (Iwan 1966, in Prandtl's form): a joint has many play operators in parallel, whose
  half widths are uniform from 0 to the slip H. A target that moves away by d takes the joint along by d^2 /
  (2 H) until d = H, then by d - H / 2: stiff at first, and a hysteresis loop in the end.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from testbench.errors import Array, Ids

STIFFENING_TURN = 1e-3
"""Turn phi_ref at which a joint's stiffness has grown by the share beta [rad]."""


class TrueLaw(Protocol):
    """Define an elastic effect of the joints that a user adds to a true arm, beside the linear spring."""

    def turn(self, x: Array) -> Array:
        """Compute the turn beside the linear one.

        Args:
            x: Turn of the linear springs under the whole torque, own weight included, (..., n) [rad, m].

        Returns:
            Turn, (..., n) [rad, m].
        """

    def slope(self, x: Array) -> Array:
        """Compute the derivative of `turn` with respect to x.

        Args:
            x: Turn of the linear springs, (..., n) [rad, m].

        Returns:
            Slope, (..., n) [1].
        """


@dataclass(frozen=True)
class TrueJointLaws:
    """Define the turn of every joint's spring as a function of its torque."""

    compliance: Array  #: Compliance of the joints at no torque, 1 / k_0, (n,) [rad/(N m)].
    stiffening: float  #: beta [1].
    backlash: float  #: Half-width b of the backlash [rad].
    hysteresis: float  #: Half-width h of the hysteresis loop [rad].
    #: Turns from which the joints come, (..., n) [rad]; None for joints without friction history.
    start: Array | None = None
    #: Largest half-width H of friction that slips gradually, (n,) [rad]; None for none.
    slip: Array | None = None
    user_law: TrueLaw | None = None  #: Effect that a user adds; None for none.

    def select(self, runs: Ids | slice) -> "TrueJointLaws":
        """Select the law of some runs."""
        return self if self.start is None else replace(self, start=self.start[runs])


def joint_rotation(law: TrueJointLaws, torque: Array) -> Array:
    """Compute the turn theta of joints under a torque.

    Mathematics: `law-3`, `law-9`.

    Args:
        law: Law of the joints.
        torque: Torque, (..., n) [N m].

    Returns:
        Turn, (..., n) [rad].
    """
    target = _frictionless_turn(law, torque)
    if law.start is None:
        return target
    held = np.clip(law.start, target - law.hysteresis, target + law.hysteresis)
    return held if law.slip is None else law.start + friction_motion(held - law.start, law.slip)


def tangent_compliance(law: TrueJointLaws, torque: Array) -> Array:
    """Compute the tangent compliance d theta / d torque of joints; zero where friction holds.

    Args:
        law: Law of the joints.
        torque: Torque, (..., n) [N m].

    Returns:
        Compliance, (..., n) [rad/(N m)].
    """
    x = law.compliance * torque
    phi = _spring_turn(law, x)
    rate = 1 / (1 + 3 * law.stiffening * (phi / STIFFENING_TURN) ** 2)
    if law.user_law is not None:
        rate = rate + law.user_law.slope(x)
    if law.backlash:
        rate += 1 - np.tanh(x / law.backlash) ** 2
    if law.start is not None:
        away = _frictionless_turn(law, torque) - law.start
        rate[np.abs(away) < law.hysteresis] = 0
        if law.slip is not None:
            rate *= slipping_share(np.maximum(np.abs(away) - law.hysteresis, 0), law.slip)
    return law.compliance * rate


def _frictionless_turn(law: TrueJointLaws, torque: Array) -> Array:
    """Compute the turn without friction, (..., n) [rad]."""
    x = law.compliance * torque
    target = _spring_turn(law, x) + _backlash_turn(law, x)
    return target if law.user_law is None else target + law.user_law.turn(x)


def _spring_turn(law: TrueJointLaws, x: Array) -> Array:
    """Solve phi + beta phi^3 / phi_ref^2 = x for its real root phi in closed form, (..., n) [rad]."""
    if not law.stiffening:
        return x
    a = np.sqrt(3 * law.stiffening) / STIFFENING_TURN
    return np.asarray(2 / a * np.sinh(np.arcsinh(1.5 * a * x) / 3))


def _backlash_turn(law: TrueJointLaws, x: Array) -> Array:
    return law.backlash * np.tanh(x / law.backlash) if law.backlash else np.zeros_like(x)


@dataclass(frozen=True)
class Follows:
    """Describe how compliances of links depend on the pose: s = sin(turns q + phase), one per link."""

    log_change: Array  #: Logarithm of the compliance along every axis of a link at s = 1, (links, 6) [1].
    joint_rates: Array  #: Change of the argument of s with every joint, (links, n) [1, rad/m].
    phase: Array  #: Phase of every link, (links,) [rad].

    def factors(self, q: Array) -> Array:
        """Compute the factors that poses, (poses, n) [rad, m], apply to the roots of the link compliances.

        They refer to the compliances of the arm's folder, (poses, 6 links) [1].
        """
        s = np.sin((q[:, None, :] * self.joint_rates).sum(axis=2) + self.phase)
        return np.asarray(np.exp(s[..., None] * self.log_change / 2).reshape(len(q), -1))


@dataclass(frozen=True)
class Beyond:
    """Hold the elastic behaviour of one arm beyond constant matrices; a field of None has no effect."""

    follows: Follows | None = None
    #: Compliance that couples joints, symmetric with a zero diagonal, (n, n) [rad/(N m)].
    between: Array | None = None
    slip: Array | None = None  #: Largest half width H of the friction of every joint, (n,) [rad, m].
    law: TrueLaw | None = None  #: Turn of the joints beside their linear springs.


def friction_motion(d: Array, slip: Array) -> Array:
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
    """Compute the share of these elements that move on with the target.

    Args:
        d: Motion of the target, (..., n) [rad].
        slip: Largest half width of a joint's elements, (n,), broadcast to d [rad].

    Returns:
        Share, (..., n) [1].
    """
    return np.asarray(np.minimum(np.abs(d) / slip, 1.0))
