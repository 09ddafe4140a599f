"""Errors of the joints themselves: transmission errors that are linear in unknown coefficients.

The coordinate of joint j differs from its command by sum_k phi_jk(q_j, tau_j) n_jk. Errors of gears and
encoders are a Fourier series in the joint's angle. Backlash takes the side that the sign of the torque gives.
A stiffening spring adds a term in torque times its absolute value. Absolute calibration (`identify.absolute`)
fits the coefficients n_jk; `correct` uses the same functions phi_jk for its intervals.
"""

from dataclasses import dataclass

import numpy as np

from testbench.arm.folder import Arm
from testbench.errors import Array, BenchError, Ids, check_array

#: First order of each band of Fourier orders [1]: the orders of a band share one expected size.
BANDS = (1, 2, 3, 5, 8, 12, 16, 20, 24, 28, 32, 40, 50, 60, 75, 95, 120, 150, 190, 240, 300, 400)
ERROR_KINDS = ("harmonics", "ratio", "play", "stiffening")
"""Kinds of a joint's error: Fourier harmonics, proportional to the angle, backlash, stiffening."""
BACKLASH_SMOOTHING = 0.1
"""Smoothing of backlash, over a joint's typical torque [1]: the step is tanh(torque / (BACKLASH_SMOOTHING
typical torque)).

At this torque the step has reached 76 % of one side, and at twice it 96 %. A sharp step has no derivative.
"""


@dataclass(frozen=True)
class JointErrors:
    """Select the terms phi_jk of the joints' errors, the same selection for every joint.

    A joint has k coefficients in this order: sines of all orders, cosines of all orders, ratio, backlash,
    stiffening. Terms that are not selected are left out.
    """

    orders: tuple[int, ...] = ()  #: Fourier orders o of sin(o q) and cos(o q), per turn of a hinge [1].
    ratio: bool = False  #: An error in proportion to the angle, as of a wrong gear ratio.
    play: bool = False  #: Backlash: a step where the torque changes its sign.
    stiffening: bool = False  #: Torque times its absolute value: a spring that stiffens or softens.

    def __post_init__(self) -> None:
        """Refuse orders that are not different numbers above 0, by BenchError."""
        if len(set(self.orders)) != len(self.orders) or min(self.orders, default=1) < 1:
            raise BenchError(f"orders: expected different numbers above 0, got {self.orders}")

    @property
    def size(self) -> int:
        """Count the coefficients per joint, k = 2 (number of orders) + 1 for each other term selected."""
        return 2 * len(self.orders) + self.ratio + self.play + self.stiffening

    @property
    def kinds(self) -> tuple[str, ...]:
        """Name the kind of every coefficient of a joint, (k,), each one of `ERROR_KINDS`."""
        single = (("ratio", self.ratio), ("play", self.play), ("stiffening", self.stiffening))
        return ("harmonics",) * (2 * len(self.orders)) + tuple(kind for kind, on in single if on)

    @property
    def bands(self) -> Ids:
        """Return the place in `BANDS` of every coefficient of a joint, (k,); -1 without an order."""
        order = np.tile(self.orders, 2)
        found = np.full(self.size, -1)
        found[: len(order)] = np.searchsorted(BANDS, order, "right") - 1
        return found


def basis(errors: JointErrors, arm: Arm, q: Array, torque: Array, scale: Array) -> Array:
    """Evaluate the functions phi_jk of every joint's own error, sum_k phi_jk(q_j, tau_j) n_jk.

    They are sin(o q) for all orders o, cos(o q) for all orders o, q, tanh(tau / (BACKLASH_SMOOTHING tau_0))
    and tau abs(tau) / tau_0^2, each as far as it is selected. The harmonic terms of a sliding joint are zero.
    A typical torque tau_0 of zero counts as one.

    Mathematics: `law-8`.

    Args:
        errors: Selection of the terms, k per joint.
        arm: The arm, for its number of joints and which of them slide.
        q: Actuated joints, (runs, n) [rad, m].
        torque: Torque tau of every joint's spring, (n, runs) [N m, N].
        scale: Typical torque tau_0 of every joint, (n,) [N m, N].

    Returns:
        Functions phi, (n, k, runs): harmonics, backlash and stiffening [1], ratio [rad, m].

    Raises:
        BenchError: When q has another shape or is not finite.
    """
    q = check_array(q, (None, arm.n_joints), "q [rad, m]")
    hinge = np.array([not joint.prismatic for joint in arm.joints])
    # exp(i o q) for o = 1, 2, ... by repeated products: imaginary part sin(o q), real part cos(o q)
    once = np.broadcast_to(np.exp(1j * q), (max(errors.orders, default=0), *q.shape))
    turns = np.cumprod(once, axis=0)[np.array(errors.orders, dtype=int) - 1] * hinge
    parts = [turns.imag, turns.real]
    # torque over its typical size, (runs, n)
    pull = (torque / np.where(scale > 0, scale, 1.0)[:, None]).T
    if errors.ratio:
        parts.append(q[None])
    if errors.play:
        parts.append(np.tanh(pull / BACKLASH_SMOOTHING)[None])
    if errors.stiffening:
        parts.append((pull * np.abs(pull))[None])
    return np.ascontiguousarray(np.concatenate(parts).transpose(2, 0, 1))
