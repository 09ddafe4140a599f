"""Errors of the joints themselves: how far each is from its command, linear in unknown coefficients.

A joint's own coordinate theta_j gets sum_k phi_jk(q_j, torque_j) n_jk. Periodic errors of gears and encoders
are a Fourier series of the joint's angle; play takes the side that the torque tells; a spring that stiffens
gives less than in proportion.
"""

from dataclasses import dataclass

import numpy as np

from testbench.arm.folder import Arm
from testbench.errors import Array, BenchError, Ids, check_array

#: Orders of a band share what is expected of their size: first order of every band.
BANDS = (1, 2, 3, 5, 8, 12, 16, 20, 24, 28, 32, 40, 50, 60, 75, 95, 120, 150, 190, 240, 300, 400)
KINDS = ("harmonics", "ratio", "play", "stiffening")
"""What a joint's error may be made of."""
FIRM = 0.1
"""Share of a joint's typical torque above which play is on one side [1]: below it goes over smoothly."""


@dataclass(frozen=True)
class JointErrors:
    """Which errors every joint has."""

    orders: tuple[int, ...] = ()  #: Periodic errors, times a turn of the joint; none of a slide.
    ratio: bool = False  #: An error in proportion to the angle.
    play: bool = False  #: A step where the torque changes its sign.
    stiffening: bool = False  #: Torque times its size.

    def __post_init__(self) -> None:
        """Refuse orders that are not different numbers above 0, by BenchError."""
        if len(set(self.orders)) != len(self.orders) or min(self.orders, default=1) < 1:
            raise BenchError(f"orders: expected different numbers above 0, got {self.orders}")

    @property
    def size(self) -> int:
        """Coefficients a joint, k."""
        return 2 * len(self.orders) + self.ratio + self.play + self.stiffening

    @property
    def kinds(self) -> tuple[str, ...]:
        """What every coefficient of a joint belongs to, (k,): one of `KINDS`."""
        single = (("ratio", self.ratio), ("play", self.play), ("stiffening", self.stiffening))
        return ("harmonics",) * (2 * len(self.orders)) + tuple(kind for kind, on in single if on)

    @property
    def bands(self) -> Ids:
        """Band of every coefficient of a joint, (k,); -1 of what has no order."""
        order = np.tile(self.orders, 2)
        found = np.full(self.size, -1)
        found[: len(order)] = np.searchsorted(BANDS, order, "right") - 1
        return found


def basis(errors: JointErrors, arm: Arm, q: Array, torque: Array, scale: Array) -> Array:
    """Functions phi of every joint, (n, k, runs) [1, rad, m].

    Args:
        errors: Which there are; sines of all orders first, then cosines.
        arm: Whose joints they are.
        q: Actuated joints, (runs, n) [rad, m].
        torque: Load of the joints' springs, (n, runs) [N m, N].
        scale: Typical size of it, (n,) [N m, N].
    """
    q = check_array(q, (None, arm.n_joints), "q [rad, m]")
    hinge = np.array([not joint.prismatic for joint in arm.joints])
    once = np.broadcast_to(np.exp(1j * q), (max(errors.orders, default=0), *q.shape))
    turns = np.cumprod(once, axis=0)[np.array(errors.orders, dtype=int) - 1] * hinge
    parts = [turns.imag, turns.real]
    pull = (torque / np.where(scale > 0, scale, 1.0)[:, None]).T
    if errors.ratio:
        parts.append(q[None])
    if errors.play:
        parts.append(np.tanh(pull / FIRM)[None])
    if errors.stiffening:
        parts.append((pull * np.abs(pull))[None])
    return np.ascontiguousarray(np.concatenate(parts).transpose(2, 0, 1))
