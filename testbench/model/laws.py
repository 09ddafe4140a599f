"""What joints do beyond a linear spring: they stiffen, have play, and stick.

Each effect is a virtual joint in series with the joint's own, whose turn has a known shape over the torque
before and under the load, and an unknown size of at least zero: so the model stays linear in its unknowns.
The torque before the load is that of the arm's own weight, less what a compensator carries.
"""

from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array
from testbench.model.structure import Structure
from testbench.model.vjm import Chain
from testbench.model.weights import Weights, own_weight

KINDS = ("stiffening", "play", "friction")
REF, BETA, PLAY, STICK = 1e-3, 0.1, 5e-5, 3e-5


@dataclass(frozen=True)
class Strut:
    foot: Array
    head: Array
    rate: float
    rest: float


@dataclass(frozen=True)
class JointLaws:
    compliance: Array
    weights: Weights | None
    strut: Strut | None = None
    kinds: tuple[str, ...] = KINDS

    def load(self, where: Chain, u: Array) -> Array:
        c = self.compliance[:, None]
        before = self.before(where, len(u))
        x0, x1 = c * before, c * (before + u)
        bent = x1 - x0
        stiff = (_spring(x1) - x1) - (_spring(x0) - x0)
        play = PLAY * (np.tanh(x1 / PLAY) - np.tanh(x0 / PLAY))
        stick = -STICK * np.clip((bent) / STICK, -1, 1)
        return np.concatenate([stiff, play, stick])

    def before(self, where: Chain, n: int) -> Array:
        runs = len(where.position)
        found = np.zeros((n, runs))
        links = 6 * (n + 1)
        if self.weights is not None:
            found += own_weight(where, self.weights)[links : links + n]
        if self.strut is not None:
            (p1, R1), (p2, R2) = where.bodies[1], where.bodies[2]
            foot, arm = p1 + self.strut.foot @ R1, self.strut.head @ R2
            along = foot - p2 - arm
            s = np.linalg.norm(along, axis=0)
            force = self.strut.rate * (s - self.strut.rest) * along / s
            omega = where.J_theta[3:, links + 1]
            found[1] += (omega * np.cross(arm.T, force.T).T).sum(axis=0)
        return found


def _spring(x: Array) -> Array:
    a = np.sqrt(3 * BETA) / REF
    return np.asarray(2 / a * np.sinh(np.arcsinh(1.5 * a * x) / 3))


def with_laws(structure: Structure, laws: JointLaws) -> Structure:
    n = len(laws.compliance)
    more = structure.n_theta + np.arange(len(laws.kinds) * n)
    joints = structure.labels[-n:]
    labels = (*structure.labels, *(f"{j} {kind}" for kind in laws.kinds for j in joints))
    return replace(
        structure,
        n_theta=structure.n_theta + len(more),
        a=np.r_[structure.a, more],
        b=np.r_[structure.b, more],
        labels=labels,
        laws=len(more),
    )
