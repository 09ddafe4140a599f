"""Numbers that a robot's file does not hold, from its class: payload, joint compliances, material.

The law of the joints is fitted to the 13 joint compliances that we know from public data, docs/own_arm.md
lists them: a KR 500 by modal test, a KR 270 and a UR10 by elastostatic calibration.
"""

import math
from dataclasses import dataclass

from testbench.arm.stiffness import Tube

ARM_COMPLIANCE = 0.33e-6  #: Of a joint that carries 1000 kg m [rad/(N m)].
POWER = 0.75  #: Compliance falls with this power of payload times reach [1].
WRIST = 6.0  #: Compliance of a joint of the wrist over that of one of the arm [1].
SPREAD = 1.9  #: The law misses the known compliances by this factor, root mean square of the logarithm [1].
LEVER = 0.1  #: A slide is as stiff as a turning joint at this share of the reach [1].
WRIST_JOINTS = 3  #: Joints after the third are of the wrist, at most so many.

PAYLOAD_OFF = 3.0  #: A guess of a payload misses one arm in ten by more than this factor [1].

HEAVY = 100.0  #: Payload from which an arm is of cast iron [kg].
HOLLOW = 0.9  #: Inner over outer diameter, as of our KR 500 [1].
OUTER = 0.30  #: Outer diameter of a link that carries 1000 kg m where no shape tells it [m].
SLENDER = 0.2  #: It grows with this power of payload times reach [1].
GUESSED = "so from payload and reach"  #: Ends the note of a diameter that no shape tells.


@dataclass(frozen=True)
class Material:
    """What links are made of."""

    name: str
    E: float  #: Young's modulus [Pa].
    nu: float  #: Poisson's ratio [1].


CAST_IRON, ALUMINIUM = Material("grey cast iron", 1.1e11, 0.26), Material("aluminium", 7.0e10, 0.33)


@dataclass(frozen=True)
class Class:
    """What an arm is built for."""

    payload: float  #: Rated payload [kg].
    reach: float  #: Stretched length from the first joint to the tool [m].

    @property
    def moment(self) -> float:
        """Payload times reach [kg m]."""
        return self.payload * self.reach

    @property
    def material(self) -> Material:
        """Of its links."""
        return CAST_IRON if self.payload >= HEAVY else ALUMINIUM

    @property
    def outer_diameter(self) -> float:
        """Of a link of unknown shape [m]: between a Panda's 0.10 m and the 0.34 m of our KR 500."""
        return float(OUTER * (self.moment / 1000) ** SLENDER)


def joint_compliance(of: Class, index: int, n_joints: int, prismatic: bool) -> float:
    """Compliance of a joint [rad/(N m), m/N].

    Args:
        of: What the arm is built for.
        index: Of the joint, 0 the first.
        n_joints: How many the arm has.
        prismatic: Whether it slides.
    """
    c = float(ARM_COMPLIANCE * (of.moment / 1000) ** -POWER)
    if prismatic:
        return c * (LEVER * of.reach) ** 2
    return c * WRIST if in_wrist(index, n_joints) else c


def in_wrist(index: int, n_joints: int) -> bool:
    """Whether a joint is of the wrist: the last ones after the third, three at most."""
    return index >= n_joints - min(WRIST_JOINTS, max(n_joints - 3, 0))


def estimated_payload(mass: float, reach: float) -> float:
    """Payload of an arm that states none: the root of its mass [kg] times its reach [m], to two digits [kg].

    A fit to 129 arms that makers rate at 0.3 to 700 kg, two thirds of them weighed by their shapes, has these
    exponents and the factor 1 within its error. It misses them by a factor of 1.9 (root mean square of the
    logarithm), the worst by 5.4.
    """
    return float(f"{math.sqrt(mass) * reach:.2g}")


def tube_of(length: float, outer: float, material: Material) -> Tube:
    """The tube of a link, its dimensions to the millimetre (and a tenth)."""
    D = round(outer, 4)
    return Tube(max(round(length, 6), 1e-3), D, round(HOLLOW * D, 4), material.E, material.nu)
