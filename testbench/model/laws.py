"""What joints do beyond a linear spring: they stiffen, have play, and stick.

Each effect is one more virtual joint in series with the joint's own. How it turns with the torque before and
under the load has a known shape; its size, at least zero, is an unknown like a compliance. So the model stays
linear in all unknowns, and every matrix of it positive semi-definite. With x = c tau, c the joint's nominal
compliance, the shapes are

- stiffening: f(x_1) - x_1 less f(x_0) - x_0, with f + beta f^3 / phi^2 = x the turn of a spring that is
  1 + beta times as stiff at the turn phi;
- backlash: half its width, the side taken from the torque's sign where |x| is well above it;
- friction: half the width of its loop, against the turn; no more than the turn itself.

tau_0 is the torque of the arm's own weight, less what a compensator carries, tau_1 that under the load too.
Backlash and friction of a gear: Ruderman et al., Modeling and identification of elastic robot joints with
hysteresis and backlash, IEEE Trans. Ind. Electron. 56 (2009); stiffening: catalogues of strain wave gears.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from testbench.arm.folder import Arm, Compensator
from testbench.errors import Array, InputError
from testbench.model.structure import Structure
from testbench.model.vjm import Chain, Vjm
from testbench.model.weights import Weights, own_weight, read_weights

KINDS = ("stiffening", "backlash", "friction")
TURN, STIFFER = 1e-3, 0.1
"""Turn phi [rad, m] and share beta [1] of a joint whose stiffening has the size one."""
PLAY, STICK = 5e-5, 3e-5  #: Half-widths of backlash and of a loop of friction of size one [rad, m].
UNIT_SIZES = STIFFER, PLAY, STICK  #: What a size of one means, in the order of `KINDS` [1, rad, rad].
VJMS = 32  #: How many models with laws are remembered.


@dataclass(frozen=True)
class JointLaws:
    """The shapes of the laws of an arm's joints."""

    compliance: Array  #: Nominal, of every joint, (n,) [rad/(N m), m/N].
    weights: Weights | None  #: What the arm weighs; None where nobody knows.
    compensator: Compensator | None  #: From link 1 to link 2.
    kinds: tuple[str, ...] = KINDS

    def load(self, where: Chain, u: Array) -> Array:
        """Turn of every law's virtual joint per unit of its size, (3 n, runs) [rad, m].

        Args:
            where: The arm, in the poses.
            u: Torques of the load, (n, runs) [N m, N].
        """
        c, before = self.compliance[:, None], self.before(where)
        x, end = c * before, c * (before + u)
        stiffened = (_spring(end) - end) - (_spring(x) - x)
        taken = PLAY * (np.tanh(end / PLAY) - np.tanh(x / PLAY))
        held = -STICK * np.clip((end - x) / STICK, -1, 1)
        return np.concatenate([stiffened, taken, held])

    def before(self, where: Chain) -> Array:
        """Torques of own weight and compensator, (n, runs) [N m, N]."""
        n, links = len(self.compliance), 6 * (len(self.compliance) + 1)
        if self.weights is None:
            found = np.zeros((n, len(where.position)))
        else:
            found = own_weight(where, self.weights)[links : links + n].copy()
        if self.compensator is not None:
            found[1] += _carried(self.compensator, where, where.J_theta[3:, links + 1])
        return found

    def slope(self, where: Chain, u: Array) -> Array:
        """Change of these turns with the torques, (3 n, runs) [rad/(N m), m/N]."""
        c, before = self.compliance[:, None], self.before(where)
        x, end = c * before, c * (before + u)
        stiffened = 1 / (1 + 3 * STIFFER * (_spring(end) / TURN) ** 2) - 1
        taken = 1 - np.tanh(end / PLAY) ** 2
        held = -1.0 * (np.abs(end - x) < STICK)
        return np.concatenate([c * stiffened, c * taken, c * held])


def _carried(spring: Compensator, where: Chain, axis: Array) -> Array:
    """Torque of a spring from link 1 to link 2 about joint 2, whose axis is (3, runs), (runs,) [N m]."""
    (foot, R_1), (joint, R_2) = where.bodies[1], where.bodies[2]
    arm = spring.head @ R_2
    along = foot + spring.foot @ R_1 - joint - arm
    length = np.linalg.norm(along, axis=0)
    force = spring.rate * (length - spring.rest_length) * along / length
    return np.asarray((axis * np.cross(arm, force, axis=0)).sum(axis=0))


def _spring(x: Array) -> Array:
    """The real root f of f + STIFFER f^3 / TURN^2 = x."""
    a = np.sqrt(3 * STIFFER) / TURN
    return np.asarray(2 / a * np.sinh(np.arcsinh(1.5 * a * x) / 3))


@lru_cache(maxsize=VJMS)
def lawful(vjm: Vjm) -> Vjm:
    """The model with its joints' laws, their virtual joints behind all others."""
    return replace(vjm, laws=laws_of(vjm.arm))


def laws_of(arm: Arm) -> JointLaws:
    """The laws of an arm's joints, as its folder tells their shapes."""
    try:
        weights = read_weights(arm)
    except InputError:  # only MuJoCo can weigh its shapes: as if it weighed nothing
        weights = None
    return JointLaws(np.array([joint.compliance for joint in arm.joints]), weights, arm.compensator)


def vjm_of(vjm: Vjm, structure: Structure) -> Vjm:
    """The model that a structure is of: with laws where it has sizes of them."""
    return lawful(vjm) if structure.laws else vjm


def tangent(vjm: Vjm, C_theta: Array, where: Chain, u: Array) -> Array:
    """Compliance of links and joints for a small further load, one a run, (runs, 7 n + 6, 7 n + 6).

    That of a joint is at least zero: one that sticks does not turn back.

    Args:
        vjm: The model.
        C_theta: Its compliances, and sizes of laws if it has some, (n_theta, n_theta).
        where: The arm at rest.
        u: Load of links and joints there, beside own weight, (7 n + 6, runs) [N, N m].
    """
    n, plain = vjm.arm.n_joints, vjm.arm.n_theta
    C = np.tile(C_theta[:plain, :plain], (len(where.position), 1, 1))
    if vjm.laws is not None:
        more = np.diag(C_theta)[plain:, None] * vjm.laws.slope(where, u[plain - n :])
        own = np.arange(plain - n, plain)
        C[:, own, own] = np.maximum(C[:, own, own] + more.reshape(len(KINDS), n, -1).sum(axis=0).T, 0.0)
    return C


def turns(vjm: Vjm, theta: Array) -> Array:
    """Coordinates of links and joints, (runs, 7 n + 6), the turns of laws added to those of their joints."""
    if vjm.laws is None:
        return theta
    plain, joints = theta[:, : vjm.arm.n_theta].copy(), 6 * len(vjm.arm.links)
    more = theta[:, vjm.arm.n_theta :].reshape(len(theta), -1, vjm.arm.n_joints)
    plain[:, joints:] += more.sum(axis=1)
    return plain


def with_laws(structure: Structure) -> Structure:
    """A structure with the laws of all joints; itself where it has them, or the arm has no joints."""
    n = structure.links - 1
    if structure.laws or not n:
        return structure
    more = structure.n_theta + np.arange(len(KINDS) * n)
    joints = structure.labels[-n:]
    return replace(
        structure,
        name=f"{structure.name} + laws",
        n_theta=structure.n_theta + len(more),
        a=np.append(structure.a, more),
        b=np.append(structure.b, more),
        labels=(*structure.labels, *(f"{joint} {kind}" for kind in KINDS for joint in joints)),
        laws=len(more),
    )


def without_laws(structure: Structure) -> Structure:
    """The structure of compliances alone."""
    keep = np.flatnonzero(structure.a < structure.plain)
    plain = structure.keep(keep, structure.name.removesuffix(" + laws"))
    return replace(plain, n_theta=structure.plain, labels=structure.labels[: structure.plain], laws=0)
