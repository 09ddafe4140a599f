"""Which joints put a tool right that is a little off: position first, then as much of its turn as is asked.

With d the joints' motion, J_p and J_r the rows of the Jacobian for position and turn, and Z a base of what
leaves the position alone:

    d = J_p^+ b_p + Z z,    z of least |J_r Z z - (b_r - J_r J_p^+ b_p)|

so the position is met in any pose in which it can be met at all. Near a singular pose of the wrist a turn
costs any motion: there every direction z of small singular value s is damped, s / (s^2 + l^2) for 1 / s, with
l growing smoothly from zero at s = SMALL (Nakamura & Hanafusa 1986); what is not turned is said, and
neighbours on a path stay neighbours. Where joints are left over, d is the shortest.
"""

from typing import Literal

import numpy as np

from testbench.errors import Array

Hold = Literal["pose", "axis", "position"]
"""What of the tool is put right: all, all but its turn about the spindle, or its position alone."""
SMALL = 0.05
"""Singular value [rad a rad] below which turns are damped: there a milliradian costs a degree and more."""
RANK = 1e-7  #: Singular value of J_p over its largest below which a direction cannot be gone.


def solutions(J: Array, hold: Hold, axis: Array) -> Array:
    """Operator G with d = G b, (points, n, 6) [rad/m, rad/rad].

    Args:
        J: Jacobian of the joints at the tool point, translation first, world axes, (points, 6, n) [m, 1].
        hold: What is put right.
        axis: Unit vector of the spindle in the world, (points, 3).
    """
    U, s, Vt = np.linalg.svd(J[:, :3])
    r = s.shape[1]
    keep = s > RANK * s[:, :1]
    inverse = np.where(keep, 1 / np.where(keep, s, 1), 0)
    position = (Vt[:, :r].swapaxes(1, 2) * inverse[:, None]) @ U[:, :, :r].swapaxes(1, 2)
    G = np.zeros((len(J), J.shape[2], 6))
    G[:, :, :3] = position
    if hold == "position" or r == J.shape[2]:
        return G
    Z, turns = Vt[:, r:].swapaxes(1, 2), J[:, 3:]
    if hold == "axis":
        turns = turns - axis[:, :, None] * (axis[:, None] @ turns)
    turning = Z @ _damped(turns @ Z)
    G[:, :, :3] -= turning @ (turns @ position)
    G[:, :, 3:] = turning
    if hold == "axis":
        G[:, :, 3:] -= (turning @ axis[:, :, None]) @ axis[:, None]
    return G


def _damped(B: Array) -> Array:
    """Inverses of (points, 3, k) matrices, damped where they are nearly singular, (points, k, 3)."""
    U, s, Vt = np.linalg.svd(B, full_matrices=False)
    scarce = np.maximum(0, 1 - s / SMALL)
    gain = s / np.maximum(s**2 + (SMALL * scarce) ** 2, np.finfo(float).tiny)
    return np.asarray((Vt.swapaxes(1, 2) * gain[:, None]) @ U.swapaxes(1, 2))
