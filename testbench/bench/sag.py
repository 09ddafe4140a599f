"""How far the payload moves the tool over the work area, and how much of that each link and joint does."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.bench.campaign import Cell, stream
from testbench.errors import Array
from testbench.model.vjm import chain, generalised_load

POSES = 96  #: Poses drawn over the joint limits.
FEWEST = 16  #: Clear ones of them; with fewer all count, for the collision shapes do not say which are.
TURN = np.pi  #: A joint that turns farther than once is drawn over one turn [rad].


@dataclass(frozen=True)
class Sag:
    """Deflections of the tool under a hung weight, linear and without the arm's own weight."""

    q: Array  #: Poses, (poses, n) [rad, m].
    parts: Array  #: What each link, then each joint, moves the tool, (parts, poses, 3) [m/kg].
    turn: Array  #: Rotation of the tool, (poses, 3) [rad/kg].

    @cached_property
    def whole(self) -> Array:
        """Deflection, (poses, 3) [m/kg]."""
        return np.asarray(self.parts.sum(axis=0))

    @cached_property
    def size(self) -> Array:
        """Length of the deflection, (poses,) [m/kg]."""
        return np.asarray(np.linalg.norm(self.whole, axis=1))

    @cached_property
    def shares(self) -> Array:
        """Of each link, then each joint: its deflection along the whole, over all poses, (parts,) [1]."""
        along = np.einsum("kpx,px->k", self.parts, self.whole)
        return np.asarray(along / along.sum())


def sag(cell: Cell) -> Sag:
    """The sag of an arm a kilogram of payload, at poses drawn evenly over its joint limits."""
    q = work_area(cell)
    where, n = chain(cell.vjm, q), len(q)
    wrench = np.tile([0, 0, -GRAVITY, 0, 0, 0], (n, 1))
    load = generalised_load(where, wrench, np.tile(cell.vjm.load, (n, 1)))
    theta = cell.arm.C_theta @ load
    moved = [np.einsum("xtp,tp->px", where.J_theta[:3, own], theta[own]) for own in _parts(cell)]
    return Sag(q, np.array(moved), np.einsum("xtp,tp->px", where.J_theta[3:], theta))


def _parts(cell: Cell) -> Iterator[slice]:
    """Virtual joints of each link, then of each joint."""
    links = len(cell.arm.links)
    yield from (slice(6 * k, 6 * k + 6) for k in range(links))
    yield from (slice(6 * links + k, 6 * links + k + 1) for k in range(cell.arm.n_joints))


def work_area(cell: Cell) -> Array:
    """Poses over the joint limits, clear of collision where the shapes can tell, (poses, n) [rad, m]."""
    from testbench.plant import collisions

    lower, upper = cell.arm.limits
    turning = np.array([not joint.prismatic for joint in cell.arm.joints], dtype=bool)
    lower = np.where(turning, np.maximum(lower, np.minimum(upper - TURN, -TURN)), lower)
    upper = np.where(turning, np.minimum(upper, np.maximum(lower + TURN, TURN)), upper)
    q = stream(0).uniform(lower, upper, (POSES, cell.arm.n_joints))
    clear = q[[pair is None for pair in collisions(cell.room, q)]]
    return np.asarray(clear if len(clear) >= FEWEST else q)
