"""What the springs of a true arm do that no matrix of a folder says: they follow the pose, couple, and creep.

- A link's compliance follows the pose: C(q) = D C D with D = diag(exp(w s(q) / 2)), s from -1 to 1 over the
  turns of some joints, w how far each axis follows.
- Joints are coupled: a torque on one turns others too, by entries of a symmetric matrix.
- Friction slips bit by bit (Iwan 1966, in Prandtl's form): a joint is many plays side by side whose half
  widths are uniform from 0 to the slip H. From where it stood, a target that moves away by d takes it along
  by d^2 / (2 H) until d = H, then by d - H / 2: stiff at first, and a loop in the end.
"""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array


@dataclass(frozen=True)
class Follows:
    """How compliances of links follow the pose: s = sin(turns q + phase), one a link."""

    share: Array  #: Logarithm of the compliance along every axis of a link at s = 1, (links, 6) [1].
    turns: Array  #: How s turns with every joint, (links, n) [1, rad/m].
    phase: Array  #: (links,) [rad].

    def factors(self, q: Array) -> Array:
        """Roots of the compliances over those of the folder, (poses, 6 links) [1].

        Args:
            q: Commanded joint angles, (poses, n) [rad, m].
        """
        s = np.sin((q[:, None, :] * self.turns).sum(axis=2) + self.phase)
        return np.asarray(np.exp(s[..., None] * self.share / 2).reshape(len(q), -1))


@dataclass(frozen=True)
class Beyond:
    """What the springs of one arm do beyond its folder's matrices; nothing where a field is None."""

    follows: Follows | None = None
    #: Compliance between joints beside their own, symmetric with a zero diagonal, (n, n) [rad/(N m)].
    between: Array | None = None
    slip: Array | None = None  #: Largest half width H of the friction of every joint, (n,) [rad, m].


def slipped(d: Array, slip: Array) -> Array:
    """Compute how far friction elements of half widths from 0 to `slip` follow a target that moved.

    Args:
        d: Motion of the target, (..., n) [rad].
        slip: Largest half width of a joint's elements, broadcast to d [rad].

    Returns:
        Mean motion of the elements, (..., n) [rad].
    """
    far = np.abs(d)
    return np.asarray(np.sign(d) * np.where(far < slip, far**2 / (2 * slip), far - slip / 2))


def slipping(d: Array, slip: Array) -> Array:
    """Compute the share of these elements that move on with the target.

    Args:
        d: Motion of the target, (..., n) [rad].
        slip: Largest half width of a joint's elements, broadcast to d [rad].

    Returns:
        Share, (..., n) [1].
    """
    return np.asarray(np.minimum(np.abs(d) / slip, 1.0))
