"""Elasticity of true arms that constant matrices cannot describe: pose dependence, coupling, slip.

- A link's compliance depends on the pose: C(q) = D C D with D = diag(exp(w s(q) / 2)). s goes from -1 to 1
  with the angles of some joints; w is the size of the change along each axis.
- Joints are coupled: a torque on one joint turns others too, by entries of a symmetric matrix.
- Friction slips gradually (Iwan 1966, in Prandtl's form): a joint has many play operators in parallel, whose
  half widths are uniform from 0 to the slip H. A target that moves away by d takes the joint along by d^2 /
  (2 H) until d = H, then by d - H / 2: stiff at first, and a hysteresis loop in the end.
"""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array


@dataclass(frozen=True)
class Follows:
    """Describe how compliances of links depend on the pose: s = sin(turns q + phase), one per link."""

    share: Array  #: Logarithm of the compliance along every axis of a link at s = 1, (links, 6) [1].
    turns: Array  #: Change of the argument of s with every joint, (links, n) [1, rad/m].
    phase: Array  #: Phase of every link, (links,) [rad].

    def factors(self, q: Array) -> Array:
        """Compute the factors that the pose applies to the roots of the link compliances.

        Args:
            q: Commanded joint angles, (poses, n) [rad, m].

        Returns:
            Factors relative to the compliances of the arm's folder, (poses, 6 links) [1].
        """
        s = np.sin((q[:, None, :] * self.turns).sum(axis=2) + self.phase)
        return np.asarray(np.exp(s[..., None] * self.share / 2).reshape(len(q), -1))


@dataclass(frozen=True)
class Beyond:
    """Hold the elastic behaviour of one arm beyond constant matrices; a field of None has no effect."""

    follows: Follows | None = None
    #: Compliance that couples joints, symmetric with a zero diagonal, (n, n) [rad/(N m)].
    between: Array | None = None
    slip: Array | None = None  #: Largest half width H of the friction of every joint, (n,) [rad, m].


def friction_following(d: Array, slip: Array) -> Array:
    """Compute how far friction elements of half widths from 0 to `slip` follow a target that moved.

    Args:
        d: Motion of the target, (..., n) [rad].
        slip: Largest half width of a joint's elements, broadcast to d [rad].

    Returns:
        Mean motion of the elements, (..., n) [rad].
    """
    far = np.abs(d)
    return np.asarray(np.sign(d) * np.where(far < slip, far**2 / (2 * slip), far - slip / 2))


def slipping_share(d: Array, slip: Array) -> Array:
    """Compute the share of these elements that move on with the target.

    Args:
        d: Motion of the target, (..., n) [rad].
        slip: Largest half width of a joint's elements, broadcast to d [rad].

    Returns:
        Share, (..., n) [1].
    """
    return np.asarray(np.minimum(np.abs(d) / slip, 1.0))
