"""A gravity compensator: a spring from link 1 to link 2 that helps joint 2 to carry the arm.

With length s, the strut pulls its ends together by F = rate (s_held - rest_length) + stiffness (s - s_held),
where s_held is its length in the held, undeflected pose. Two slopes, since a strut is pushed in two ways:
joint 2 turning drives its piston, and only gas or coils push back; under a payload it moves by tenths of a
millimetre, and seal friction or a shut column of oil may hold it far stiffer. Equal slopes, the default, are
the plain spring.

Joint 2 sees the equivalent stiffness K_eq = stiffness s'^2 + F s'', primes being derivatives with respect to
q_2: it vanishes nearly where the strut points at the axis and is largest where it stands square on its lever.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array, BenchError, check_array, check_least
from testbench.plant.build import Index, Plant
from testbench.plant.state import State, generalised_force, place

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
    """The compensator in some poses, told by their indices."""

    #: Its generalised force where the arm is, (some, nv) [N, N m].
    force: Callable[[State, Index], Array]
    #: Applies the inverse of C (C^-1 + stiffness g g^T), by Sherman and Morrison, with g = ds / dqpos in the
    #: held pose, to steps, (some, nv): how far it stiffens the arm.
    stiffen: Callable[[Array, Index], Array]


def attached(plant: Plant) -> tuple[int, int]:
    """Body ids of link 1 and link 2.

    Raises:
        BenchError: When the arm has fewer than two joints, or joint 2 slides.
    """
    links = plant.arm.links
    if len(links) < 3:
        raise BenchError(
            f"compensator: expected an arm with links 1 and 2, {plant.arm.name} has {len(links)} links"
        )
    if plant.arm.joints[1].prismatic:
        raise BenchError(
            f"compensator: expected a hinge between links 1 and 2 of {plant.arm.name}, got a slide"
        )
    return plant.model.body(links[1].name).id, plant.model.body(links[2].name).id


def strut(compensator: Compensator, plant: Plant, state: State) -> Strut:
    """The compensator in some poses.

    Args:
        compensator: The spring.
        plant: The elastic arm.
        state: Its held poses, theta = 0.
    """
    lower, upper = attached(plant)
    foot, head = np.array(compensator.foot), np.array(compensator.head)
    stiffness = compensator.rate if compensator.stiffness is None else compensator.stiffness

    def pull(state: State, start: Array, end: Array, force: Array) -> Array:
        along = (force / _distance(start, end))[:, None] * (end - start)
        at_foot, at_head = (np.concatenate([f, np.zeros_like(f)], axis=1) for f in (along, -along))
        on_lower = generalised_force(plant, state, lower, at_foot, start)
        return on_lower + generalised_force(plant, state, upper, at_head, end)

    def ends(state: State) -> tuple[Array, Array]:
        return place(state, lower, foot), place(state, upper, head)

    held = _distance(*ends(state))
    g = pull(state, *ends(state), np.full(len(held), -1.0))
    C_g = np.matvec(plant.C, g)
    share = stiffness / (1 + stiffness * np.vecdot(g, C_g))

    def force(state: State, some: Index) -> Array:
        preload = compensator.rate * (held[some] - compensator.rest_length)
        start, end = ends(state)
        return pull(state, start, end, preload + stiffness * (_distance(start, end) - held[some]))

    def stiffen(step: Array, some: Index) -> Array:
        along = share[some] * np.vecdot(g[some], step)
        return np.asarray(step - along[:, None] * C_g[some])

    return Strut(force, stiffen)


def _distance(start: Array, end: Array) -> Array:
    return np.asarray(np.linalg.norm(end - start, axis=1))
