"""A gravity compensator: a spring from link 1 to link 2 that supports joint 2.

With length s, the strut pulls its ends together by F = rate (s_held - rest_length) + stiffness (s - s_held).
s_held is its length in the held, undeflected pose.

There are two slopes because a strut is driven in two ways. When joint 2 turns, it moves the piston, and only
gas or coils push back. Under a payload it moves by tenths of a millimetre, and seal friction or a closed
column of oil may make it far stiffer. Equal slopes, the default, are the plain spring. Joint 2 sees the
equivalent stiffness K_eq = stiffness s'^2 + F s'', with derivatives by q_2. It nearly vanishes where the
strut points at the axis, and is largest where the strut is perpendicular to its lever.
"""

from dataclasses import dataclass

import numpy as np

from testbench.arm.folder import Compensator
from testbench.errors import Array, BenchError, Ids
from testbench.plant.build import Plant
from testbench.plant.state import BodyState, generalised_force, point_position


@dataclass(frozen=True)
class Strut:
    """Hold the compensator in some poses; arguments `some` are indices of them."""

    spring: Compensator
    slope: float  #: Change of force over change of length as the arm deflects [N/m].
    ends: tuple[int, int]  #: Ids of the bodies on which it is hinged.
    length_fixed: Array  #: Length in the held poses, theta = 0, (poses,) [m].
    C_g: Array  #: C g with g = ds / dqpos in the held poses, (poses, nv).
    share: Array  #: k g / (1 + k g C_g), k the slope, (poses, nv).


def hinged_bodies(plant: Plant) -> tuple[int, int]:
    """Find the bodies that the compensator connects: links 1 and 2.

    Args:
        plant: The plant.

    Returns:
        Their ids in MuJoCo.

    Raises:
        BenchError: If the arm has fewer than two joints, or joint 2 is prismatic.
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


def strut(compensator: Compensator, plant: Plant, state: BodyState) -> Strut:
    """Compute the gravity compensator in held poses, theta = 0.

    Args:
        compensator: The compensator.
        plant: The plant that it is attached to.
        state: The held poses.

    Returns:
        The compensator with what the solver needs of these poses.
    """
    ends = hinged_bodies(plant)
    hinges = _hinges(compensator, ends, state)
    held = _length(hinges)
    g = _pull(plant, ends, state, hinges, np.full(len(held), -1.0))
    C_g = np.matvec(plant.C, g)
    k = compensator.rate if compensator.stiffness is None else compensator.stiffness
    share = (k / (1 + k * np.vecdot(g, C_g)))[:, None] * g
    return Strut(compensator, k, ends, held, C_g, share)


def strut_force(strut: Strut, plant: Plant, state: BodyState, some: Ids) -> Array:
    """Compute the generalised force of the compensator in the present poses.

    Mathematics: `law-10`.

    Args:
        strut: The compensator.
        plant: The plant.
        state: The present poses.
        some: Places of the poses that are wanted, (poses,).

    Returns:
        Force on every degree of freedom, (some, nv) [N, N m].
    """
    spring, held = strut.spring, strut.length_fixed[some]
    hinges = _hinges(spring, strut.ends, state)
    force = spring.rate * (held - spring.rest_length) + strut.slope * (_length(hinges) - held)
    return _pull(plant, strut.ends, state, hinges, force)


def correct_for_strut(strut: Strut, step: Array, some: Ids) -> Array:
    """Correct steps of the arm's own springs for the stiffness of the compensator.

    It applies the inverse of C (C^-1 + k g g^T) of the held pose, by Sherman and Morrison.

    Args:
        strut: The compensator.
        step: Steps without it, (some, nv) [m, rad].
        some: Places of the poses, (poses,).

    Returns:
        Steps with it, (some, nv) [m, rad].
    """
    along = np.vecdot(strut.share[some], step)
    return np.asarray(step - along[:, None] * strut.C_g[some])


def _hinges(spring: Compensator, ends: tuple[int, int], state: BodyState) -> tuple[Array, Array]:
    """Compute foot and head in the world, (poses, 3) [m]."""
    return point_position(state, ends[0], np.array(spring.foot)), point_position(
        state, ends[1], np.array(spring.head)
    )


def _length(hinges: tuple[Array, Array]) -> Array:
    return np.asarray(np.linalg.norm(hinges[1] - hinges[0], axis=1))


def _pull(
    plant: Plant, ends: tuple[int, int], state: BodyState, hinges: tuple[Array, Array], force: Array
) -> Array:
    """Compute the generalised force of a pull between both ends, (poses, nv) [N, N m]."""
    along = (force / _length(hinges))[:, None] * (hinges[1] - hinges[0])
    Q = np.zeros(state.weight.shape)
    for body, point, pulled in zip(ends, hinges, (along, -along), strict=True):
        wrench = np.concatenate([pulled, np.zeros_like(pulled)], axis=1)
        Q += generalised_force(plant, state, body, wrench, point)
    return Q
