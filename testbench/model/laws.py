"""What joints do beyond a linear spring: they stiffen, have play, and stick.

Each effect is one more virtual joint in series with the joint's own. How it turns with the torque before and
under the load has a known shape; its size, at least zero, is an unknown like a compliance. So the model stays
linear in all unknowns, and every matrix of it positive semi-definite. With x = c tau, c the joint's nominal
compliance, the shapes are

- stiffening: f(x_1) - x_1 less f(x_0) - x_0, with f + beta f^3 / phi^2 = x the turn of a spring that is
  1 + beta times as stiff at the turn phi;
- backlash: half its width, the side taken from the torque's sign where |x| is well above it;
- friction: half the width of its loop, against the turn; no more than the turn itself. Of a load that was
  put on in the pose and then taken off all of the width, as the joint that it left was held back too;
- compensator, of joint 2 alone: what a strut takes off as the arm deflects, K s^2 / (1 + K s^2) of x_1 - x_0,
  K its stiffness over the joint's at its longest lever, s its lever over that.

tau_0 is the torque of the arm's own weight, less what a compensator carries, tau_1 that under the load too.
Backlash and friction of a gear: Ruderman et al., Modeling and identification of elastic robot joints with
hysteresis and backlash, IEEE Trans. Ind. Electron. 56 (2009); stiffening: catalogues of strain wave gears.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from testbench.arm.folder import Arm, Compensator
from testbench.errors import Array, Ids, InputError, Mask
from testbench.model.structure import Structure
from testbench.model.vjm import Chain, Vjm, cross
from testbench.model.weights import Weights, own_weight, read_weights

KINDS = ("stiffening", "backlash", "friction")
STRUT = "compensator"  #: Kind of joint 2 alone, where there is one.
TURN, STIFFER = 1e-3, 0.1
"""Turn phi [rad, m] and share beta [1] of a joint whose stiffening has the size one."""
PLAY, STICK = 5e-5, 3e-5  #: Half-widths of backlash and of a loop of friction of size one [rad, m].
BESIDE = 0.3  #: Stiffness K of a compensator of size one over that of joint 2 [1].
UNIT_SIZES = {**dict(zip(KINDS, (STIFFER, PLAY, STICK), strict=True)), STRUT: BESIDE / (1 + BESIDE)}
"""What a size of one means [1, rad, rad, 1]; of a compensator the largest share that it takes off a turn."""
TIED = " + joints coupled"  #: End of the name of a structure with couplings between joints.
VJMS = STRUCTURES = 32  #: How many models with laws, and structures without them, are remembered.


@dataclass(frozen=True)
class JointLaws:
    """The shapes of the laws of an arm's joints."""

    compliance: Array  #: Nominal, of every joint, (n,) [rad/(N m), m/N].
    weights: Weights | None  #: What the arm weighs; None where nobody knows.
    compensator: Compensator | None  #: From link 1 to link 2.
    widths: Array | float = 1.0  #: Of friction's loop in half widths, one a run or of all, (runs,) [1].

    @property
    def kinds(self) -> tuple[str, ...]:
        """Of every law's virtual joint."""
        every = tuple(np.repeat(KINDS, len(self.compliance)).tolist())
        return every if self.compensator is None else (*every, STRUT)

    @property
    def joints(self) -> Ids:
        """Joint that each of them turns with, (laws,)."""
        every = np.tile(np.arange(len(self.compliance)), len(KINDS))
        return every if self.compensator is None else np.append(every, 1)

    def load(self, where: Chain, u: Array) -> Array:
        """Turn of every law's virtual joint per unit of its size, (laws, runs) [rad, m].

        Args:
            where: The arm, in the poses.
            u: Torques of the load, (n, runs) [N m, N].
        """
        c, before = self.compliance[:, None], self.before(where)
        x, end = c * before, c * (before + u)
        stiffened = (_spring(end) - end) - (_spring(x) - x)
        taken = PLAY * (np.tanh(end / PLAY) - np.tanh(x / PLAY))
        width = self.widths * STICK
        held = -width * np.clip((end - x) / width, -1, 1)
        return np.concatenate([stiffened, taken, held, self._beside(where) * (c * u)[1]])

    def before(self, where: Chain) -> Array:
        """Torques of own weight and compensator, (n, runs) [N m, N]."""
        n, links = len(self.compliance), 6 * (len(self.compliance) + 1)
        if self.weights is None:
            found = np.zeros((n, len(where.position)))
        else:
            found = own_weight(where, self.weights)[links : links + n].copy()
        if self.compensator is not None:
            lever, _, length = _levers(self.compensator, where)
            found[1] += self.compensator.rate * (length - self.compensator.rest_length) * lever
        return found

    def slope(self, where: Chain, u: Array) -> Array:
        """Change of these turns with the torques, (laws, runs) [rad/(N m), m/N]."""
        c, before = self.compliance[:, None], self.before(where)
        x, end = c * before, c * (before + u)
        stiffened = 1 / (1 + 3 * STIFFER * (_spring(end) / TURN) ** 2) - 1
        taken = 1 - np.tanh(end / PLAY) ** 2
        held = -1.0 * (np.abs(end - x) < STICK)
        return np.concatenate([c * stiffened, c * taken, c * held, c[1] * self._beside(where)])

    def _beside(self, where: Chain) -> Array:
        """What a compensator of size one adds to the turn of joint 2, over that turn, (1 or 0, runs) [1]."""
        if self.compensator is None:
            return np.zeros((0, len(where.position)))
        lever, longest, _ = _levers(self.compensator, where)
        stiffer = BESIDE * (lever / longest) ** 2
        return -(stiffer / (1 + stiffer))[None]


def _levers(spring: Compensator, where: Chain) -> tuple[Array, Array, Array]:
    """Of a spring from link 1 to link 2 its lever about joint 2, the longest one, its length, (runs,) [m]."""
    (foot, R_1), (joint, R_2) = where.bodies[1], where.bodies[2]
    axis, arm = where.J_theta[3:, 6 * (len(where.bodies) - 1) + 1], spring.head @ R_2
    along = foot + spring.foot @ R_1 - joint - arm
    length = np.linalg.norm(along, axis=0)
    lever = (axis * cross(arm, along / length)).sum(axis=0)
    return lever, np.linalg.norm(cross(axis, arm), axis=0), length


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


def sizes_of(vjm: Vjm, C_theta: Array) -> dict[str, dict[str, float]]:
    """Sizes of laws by joint and kind, from C_theta (n_theta, n_theta) of a model that may have some."""
    if vjm.laws is None:
        return {}
    found: dict[str, dict[str, float]] = {joint.name: {} for joint in vjm.arm.joints}
    sizes = np.diag(C_theta)[vjm.arm.n_theta :].tolist()
    for joint, kind, size in zip(vjm.laws.joints, vjm.laws.kinds, sizes, strict=True):
        found[vjm.arm.joints[joint].name][kind] = size
    return found


def as_loaded(vjm: Vjm, taken_off: Mask | None, some: Ids | slice = slice(None)) -> Vjm:
    """The model for some runs of a load put on, or taken off again where a mask, (runs,), says so."""
    if taken_off is None or not isinstance(vjm.laws, JointLaws):
        return vjm
    return replace(vjm, laws=replace(vjm.laws, widths=np.where(taken_off[some], 2.0, 1.0)))


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
        joints = C[:, own, own].T
        np.add.at(joints, vjm.laws.joints, more)
        C[:, own, own] = np.maximum(joints.T, 0.0)
    return C


def with_laws(structure: Structure, arm: Arm) -> Structure:
    """A structure with the laws of an arm's joints; itself where it has them, or the arm has no joints."""
    if structure.laws or not arm.joints:
        return structure
    laws = laws_of(arm)
    more = structure.n_theta + np.arange(len(laws.joints))
    names = [arm.joints[k].name for k in laws.joints]
    return replace(
        structure,
        name=f"{structure.name} + laws",
        n_theta=structure.n_theta + len(more),
        a=np.append(structure.a, more),
        b=np.append(structure.b, more),
        labels=(*structure.labels, *map(" ".join, zip(names, laws.kinds, strict=True))),
        laws=len(more),
    )


@lru_cache(maxsize=STRUCTURES)
def with_ties(structure: Structure) -> Structure:
    """A structure of single joints with couplings between all of them, its last parameters."""
    joints = 6 * structure.links + np.arange(structure.links - 1)
    a, b = (joints[end] for end in np.triu_indices(len(joints), 1))
    name = structure.name + TIED * (len(a) > 0)
    return replace(structure, name=name, a=np.append(structure.a, a), b=np.append(structure.b, b))


@lru_cache(maxsize=STRUCTURES)
def without_ties(structure: Structure) -> Structure:
    """The structure without couplings between joints."""
    keep = np.flatnonzero((structure.a < 6 * structure.links) | (structure.a == structure.b))
    return structure if len(keep) == structure.n else structure.keep(keep, structure.name.removesuffix(TIED))


@lru_cache(maxsize=STRUCTURES)
def without_laws(structure: Structure) -> Structure:
    """The structure of links, and of joints each by itself, the same one for every fit: found once."""
    structure = without_ties(structure)
    if not structure.laws:
        return structure
    keep = np.flatnonzero(structure.a < structure.plain)
    plain = structure.keep(keep, structure.name.removesuffix(" + laws"))
    return replace(plain, n_theta=structure.plain, labels=structure.labels[: structure.plain], laws=0)
