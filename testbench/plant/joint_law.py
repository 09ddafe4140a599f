"""Joints that are not linear springs: they stiffen, have backlash, and stick.

With x = tau / k_0 the turn of a linear joint under the torque tau, three effects add up:

- stiffening: the spring turns by phi with k_0 phi (1 + beta (phi / phi_ref)^2) = tau;
- backlash of half-width b, on the side that the torque's sign selects: the turn is phi + b tanh(x / b). It is
  taken up where the spring would turn by b, at about the 3 % of the rated torque at which makers measure lost
  motion;
- hysteresis of half-width h: friction holds the joint until the turn y without friction is more than h away,
  then lets it follow: theta = min(max(theta_before, y - h), y + h). This is the play operator (Krasnosel'skii
  and Pokrovskii, Systems with Hysteresis, 1989): a loop 2 h wide, whatever the load. Where friction slips
  gradually, the rest of the way beyond h counts as in `testbench.plant.beyond`.

A slide has forces for torques and metres for radians.
"""

from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array, Ids
from testbench.plant.beyond import friction_following, slipping_share

STIFFENING_ANGLE = 1e-3
"""Turn phi_ref at which a joint's stiffness has grown by the share beta [rad]."""


@dataclass(frozen=True)
class JointLaw:
    """Define the turn of every joint's spring as a function of its torque."""

    compliance: Array  #: Compliance of the joints at no torque, 1 / k_0, (n,) [rad/(N m)].
    stiffening: float  #: beta [1].
    backlash: float  #: Half-width b of the backlash [rad].
    hysteresis: float  #: Half-width h of the hysteresis loop [rad].
    #: Turns from which the joints come, (..., n) [rad]; None for joints without friction history.
    before: Array | None = None
    #: Largest half-width H of friction that slips gradually, (n,) [rad]; None for none.
    slip: Array | None = None

    def of(self, some: Ids | slice) -> "JointLaw":
        """Select the law of some runs."""
        return self if self.before is None else replace(self, before=self.before[some])


def joint_rotation(law: JointLaw, torque: Array) -> Array:
    """Compute the turn theta of joints under a torque.

    Mathematics: `law-3`, `law-9`.

    Args:
        law: Law of the joints.
        torque: Torque, (..., n) [N m].

    Returns:
        Turn, (..., n) [rad].
    """
    target = _target(law, torque)
    if law.before is None:
        return target
    held = np.clip(law.before, target - law.hysteresis, target + law.hysteresis)
    return held if law.slip is None else law.before + friction_following(held - law.before, law.slip)


def tangent_compliance(law: JointLaw, torque: Array) -> Array:
    """Compute the tangent compliance d theta / d torque of joints; zero where friction holds.

    Args:
        law: Law of the joints.
        torque: Torque, (..., n) [N m].

    Returns:
        Compliance, (..., n) [rad/(N m)].
    """
    x = law.compliance * torque
    phi = _spring_turn(law, x)
    rate = 1 / (1 + 3 * law.stiffening * (phi / STIFFENING_ANGLE) ** 2)
    if law.backlash:
        rate += 1 - np.tanh(x / law.backlash) ** 2
    if law.before is not None:
        away = phi + _play(law, x) - law.before
        rate[np.abs(away) < law.hysteresis] = 0
        if law.slip is not None:
            rate *= slipping_share(np.maximum(np.abs(away) - law.hysteresis, 0), law.slip)
    return law.compliance * rate


def _target(law: JointLaw, torque: Array) -> Array:
    """Compute the turn without friction, (..., n) [rad]."""
    x = law.compliance * torque
    return _spring_turn(law, x) + _play(law, x)


def _spring_turn(law: JointLaw, x: Array) -> Array:
    """Solve phi + beta phi^3 / phi_ref^2 = x for its real root phi in closed form, (..., n) [rad]."""
    if not law.stiffening:
        return x
    a = np.sqrt(3 * law.stiffening) / STIFFENING_ANGLE
    return np.asarray(2 / a * np.sinh(np.arcsinh(1.5 * a * x) / 3))


def _play(law: JointLaw, x: Array) -> Array:
    return law.backlash * np.tanh(x / law.backlash) if law.backlash else np.zeros_like(x)
