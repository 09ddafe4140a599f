"""A gravity compensator: a spring from link 1 to link 2 that helps joint 2 to carry the arm.

With length s, the strut pulls its ends together by F = rate (s_held - rest_length) + stiffness (s - s_held),
where s_held is its length in the held, undeflected pose. Two slopes, since a strut is pushed in two ways:
joint 2 turning drives its piston, and only gas or coils push back; under a payload it moves by tenths of a
millimetre, and seal friction or a shut column of oil may hold it far stiffer. Equal slopes, the default, are
the plain spring.

Joint 2 sees the equivalent stiffness K_eq = stiffness s'^2 + F s'', primes being derivatives with respect to
q_2: it vanishes nearly where the strut points at the axis and is largest where it stands square on its lever.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from testbench.errors import Array, BenchError, check_array, check_least
from testbench.plant.equilibrium import Plant

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Compensator:
    """A spring between a point of link 1 and a point of link 2."""

    foot: Point  #: Where it is hinged on link 1, in the frame of that body, (3,) [m].
    head: Point  #: Where it is hinged on link 2, in the frame of that body, (3,) [m].
    rate: float  #: Change of force over change of length as joint 2 turns [N/m].
    rest_length: float  #: Length without force [m].
    #: Change of force over change of length as the arm deflects [N/m]; None for the rate.
    stiffness: float | None = None

    def __post_init__(self) -> None:
        for name in ("foot", "head"):
            check_array(getattr(self, name), (3,), f"{name} of the compensator [m]")
        for name in ("rate", "rest_length", "stiffness"):
            value = getattr(self, name)
            check_least(0.0 if value is None else value, f"{name} of the compensator")


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

stiffness: 1 / 0.144e-6 N/m. 0.144e-6 is [published] for a KR 270 beside 0.302e-6 rad/(N m) of its joint 2,
without its unit; that it is the strut's own compliance in m/N is our reading. K_eq is then at most 4 % of the
stiffness of joint 2, which agrees with the 4.8 % that the paper quotes. `STIFF_COMPENSATOR` is the other
reading.
"""

STIFF_COMPENSATOR = replace(KR500_COMPENSATOR, stiffness=9.6e7)
"""The same number read as a compliance of joint 2 in rad/(N m): K_eq at the best lever is 1 / 0.144e-6 =
6.9e6 N m/rad, half of the stiffness of joint 2. As a plain spring it could not be: turning joint 2 by a
radian would take 400 times the torque of the arm's own weight.
"""


@dataclass(frozen=True)
class Strut:
    """The compensator in one pose."""

    #: Adds its generalised force at data.qpos, kinematics and mj_comPos done, to Q, (nv,) [N, N m].
    add: Callable[[Array], None]
    #: Inverse of C (C^-1 + stiffness g g^T), by Sherman and Morrison, with g = ds / dqpos in the held pose:
    #: how far it stiffens the arm, (nv, nv).
    inverse: Array


def attached(plant: Plant) -> tuple[int, int]:
    """Body ids of link 1 and link 2.

    Raises:
        BenchError: When the arm has fewer than two joints.
    """
    links = plant.arm.links
    if len(links) < 3:
        raise BenchError(
            f"compensator: expected an arm with links 1 and 2, {plant.arm.name} has {len(links)} links"
        )
    return plant.model.body(links[1].name).id, plant.model.body(links[2].name).id


def strut(compensator: Compensator, plant: Plant, data: mujoco.MjData) -> Strut:
    """The compensator in one pose.

    Args:
        compensator: The spring.
        plant: The elastic arm.
        data: Its state, now in the held pose, theta = 0; the strut follows it.
    """
    model, (lower, upper) = plant.model, attached(plant)
    foot, head = np.array(compensator.foot), np.array(compensator.head)
    at, upper_at = data.xpos[lower], data.xpos[upper]
    turned, upper_turned = data.xmat[lower].reshape(3, 3), data.xmat[upper].reshape(3, 3)
    stiffness = compensator.rate if compensator.stiffness is None else compensator.stiffness

    def ends() -> tuple[Array, Array]:
        return at + turned @ foot, upper_at + upper_turned @ head

    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    start, end = ends()
    held = math.dist(start, end)
    preload = compensator.rate * (held - compensator.rest_length)

    def pull(force: float, start: Array, end: Array, Q: Array) -> None:
        along, none = force * (end - start) / math.dist(start, end), np.zeros(3)
        mujoco.mj_applyFT(model, data, along, none, start, lower, Q)
        mujoco.mj_applyFT(model, data, -along, none, end, upper, Q)

    def add(Q: Array) -> None:
        start, end = ends()
        pull(preload + stiffness * (math.dist(start, end) - held), start, end, Q)

    g = np.zeros(model.nv)
    pull(-1.0, start, end, g)
    C_g = plant.C @ g
    return Strut(add, np.eye(model.nv) - stiffness / (1 + stiffness * (g @ C_g)) * np.outer(C_g, g))
