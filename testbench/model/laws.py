"""Joint laws: what actuated joints do beyond a linear spring. They stiffen, have backlash, and stick.

Each law is one more virtual joint in series with the joint's own spring. How it turns with the torque before
and under the load has a known shape. Its size, at least zero, is an unknown like a compliance. So the model
stays linear in all unknowns, and every block of C_theta stays positive semi-definite. `identify` learns the
sizes, `correct` uses them.

With x = c tau, c the nominal compliance of the joint, the shapes are:

- stiffening: f(x_1) - x_1 - (f(x_0) - x_0), where f + beta f^3 / phi^2 = x is the turn of a spring whose
  stiffness at the turn phi is (1 + beta) times that at zero;
- backlash: b (tanh(x_1 / b) - tanh(x_0 / b)), the half width b of the gap, taken to the side that the sign of
  the torque gives;
- friction: -h clip((x_1 - x_0) / h, -1, 1), the half width h of the hysteresis loop against the turn, and no
  more than the turn itself. For a load that was put on in the pose and then taken off the full width counts,
  because the joint was held back both times;
- compensator, on joint 2 alone: -(x_1 - x_0) K s^2 / (1 + K s^2), the part of the turn that a strut prevents
  as the arm deflects. K is its stiffness over that of the joint at its longest lever, s its lever over the
  longest.

tau_0 is the torque of the arm's own weight, less what a compensator carries; tau_1 adds the torque of the
load. Backlash and friction of a gear: Ruderman et al., Modeling and identification of elastic robot joints
with hysteresis and backlash, IEEE Trans. Ind. Electron. 56 (2009). Stiffening: catalogues of strain wave
gears.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from testbench.arm.folder import Arm, Compensator
from testbench.errors import Array, Ids, InputError, Mask
from testbench.model.load import Weights, own_weight, read_weights
from testbench.model.structure import Structure
from testbench.model.vjm import Chain, Vjm, cross

LAW_KINDS = ("stiffening", "backlash", "friction")
STRUT = "compensator"  #: Kind of law of joint 2 alone, where the arm has a compensator.
UNIT_ROTATION, UNIT_STIFFENING = 1e-3, 0.1
"""Turn phi [rad, m] and beta [1] of stiffening of size one: at phi the spring is 1 + beta times as stiff.

These and the sizes below are units of the unknowns: a prior expects sizes of order one.
"""
#: Half-widths b of backlash and h of the friction loop of size one [rad, m].
UNIT_BACKLASH_RAD, UNIT_FRICTION_RAD = 5e-5, 3e-5
UNIT_COMPENSATOR = 0.3  #: Stiffness K of a compensator of size one over the stiffness of joint 2 [1].
UNIT_SIZES = {
    **dict(zip(LAW_KINDS, (UNIT_STIFFENING, UNIT_BACKLASH_RAD, UNIT_FRICTION_RAD), strict=True)),
    STRUT: UNIT_COMPENSATOR / (1 + UNIT_COMPENSATOR),
}
"""Meaning of a size of one, by kind [1, rad, rad, 1; m for a slide].

For a compensator it is the largest share of a turn that it prevents, K / (1 + K).
"""
TIED_SUFFIX = " + joints coupled"  #: End of the name of a structure with couplings between joints.
VJMS = STRUCTURES = 32  #: Number of models with laws, and of structures, that are remembered.


@dataclass(frozen=True)
class JointLaws:
    """Hold the shapes of the laws of an arm's joints: three per joint, and one of a compensator.

    The laws are ordered by kind: stiffening of all joints, backlash of all, friction of all. Their number is
    3 n, or 3 n + 1 with a compensator.
    """

    compliance: Array  #: Nominal compliance c of every joint, (n,) [rad/(N m), m/N].
    weights: Weights | None  #: Masses of the arm; None where they are unknown.
    compensator: Compensator | None  #: Spring from link 1 to link 2; None where there is none.
    widths: Array | float = 1.0  #: Width of friction's loop in half widths, one for all or (runs,) [1].

    @property
    def kinds(self) -> tuple[str, ...]:
        """Name the kind of every law, (laws,), each one of `LAW_KINDS` or `STRUT`."""
        every = tuple(np.repeat(LAW_KINDS, len(self.compliance)).tolist())
        return every if self.compensator is None else (*every, STRUT)

    @property
    def joints(self) -> Ids:
        """Return the index of the actuated joint that each law turns with, (laws,)."""
        every = np.tile(np.arange(len(self.compliance)), len(LAW_KINDS))
        return every if self.compensator is None else np.append(every, 1)

    def load(self, chain: Chain, u: Array) -> Array:
        """Compute the turn of every law per unit of its size, by the shapes of the module.

        Mathematics: `law-1`, `law-3`, `law-4`, `law-5`, `law-6`.

        Args:
            chain: The arm in its poses, with origins and axes of its bodies.
            u: Torques of the load at the actuated joints, (n, runs) [N m, N].

        Returns:
            Turn per unit of size, (laws, runs) [rad, m].
        """
        c, before = self.compliance[:, None], self.before(chain)
        x, end = c * before, c * (before + u)  # nominal turns x_0 before and x_1 under the load
        stiffened = (_spring(end) - end) - (_spring(x) - x)
        taken = UNIT_BACKLASH_RAD * (np.tanh(end / UNIT_BACKLASH_RAD) - np.tanh(x / UNIT_BACKLASH_RAD))
        width = self.widths * UNIT_FRICTION_RAD
        held = -width * np.clip((end - x) / width, -1, 1)
        return np.concatenate([stiffened, taken, held, self._beside(chain) * (c * u)[1]])

    def before(self, chain: Chain) -> Array:
        """Compute the torques at the joints before the load: own weight, less what a compensator carries.

        Mathematics: `law-2`.

        Args:
            chain: The arm in its poses.

        Returns:
            Torques tau_0, (n, runs) [N m, N]; without the weight's share where weights are unknown.
        """
        n, links = len(self.compliance), 6 * (len(self.compliance) + 1)
        if self.weights is None:
            found = np.zeros((n, len(chain.position)))
        else:
            found = own_weight(chain, self.weights)[links : links + n].copy()
        if self.compensator is not None:
            lever, _, length = _levers(self.compensator, chain)
            found[1] += self.compensator.rate * (length - self.compensator.rest_length) * lever
        return found

    def slope(self, chain: Chain, u: Array) -> Array:
        """Compute the derivative of the laws' turns with respect to the torque of their joint.

        Args:
            chain: The arm in its poses.
            u: Torques of the load at the actuated joints, (n, runs) [N m, N].

        Returns:
            Turn per unit of size and torque, (laws, runs) [rad/(N m), m/N].
        """
        c, before = self.compliance[:, None], self.before(chain)
        x, end = c * before, c * (before + u)  # nominal turns x_0 before and x_1 under the load
        stiffened = 1 / (1 + 3 * UNIT_STIFFENING * (_spring(end) / UNIT_ROTATION) ** 2) - 1  # f' - 1 at x_1
        taken = 1 - np.tanh(end / UNIT_BACKLASH_RAD) ** 2
        held = -1.0 * (np.abs(end - x) < self.widths * UNIT_FRICTION_RAD)
        return np.concatenate([c * stiffened, c * taken, c * held, c[1] * self._beside(chain)])

    def _beside(self, chain: Chain) -> Array:
        """Compute a compensator's share of joint 2's turn, -K s^2 / (1 + K s^2), (1 or 0, runs) [1]."""
        if self.compensator is None:
            return np.zeros((0, len(chain.position)))
        lever, longest, _ = _levers(self.compensator, chain)
        stiffer = UNIT_COMPENSATOR * (lever / longest) ** 2
        return -(stiffer / (1 + stiffer))[None]


def _levers(spring: Compensator, chain: Chain) -> tuple[Array, Array, Array]:
    """Compute a strut's lever about joint 2, its longest lever, and its length, (runs,) [m] each."""
    (foot, R_1), (joint, R_2) = chain.bodies[1], chain.bodies[2]
    axis, arm = chain.J_theta[3:, 6 * (len(chain.bodies) - 1) + 1], spring.head @ R_2
    along = foot + spring.foot @ R_1 - joint - arm
    length = np.linalg.norm(along, axis=0)
    lever = (axis * cross(arm, along / length)).sum(axis=0)
    return lever, np.linalg.norm(cross(axis, arm), axis=0), length


def _spring(x: Array) -> Array:
    """Solve f + beta f^3 / phi^2 = x for its real root f, by the hyperbolic form of Cardano's formula."""
    a = np.sqrt(3 * UNIT_STIFFENING) / UNIT_ROTATION
    return np.asarray(2 / a * np.sinh(np.arcsinh(1.5 * a * x) / 3))


@lru_cache(maxsize=VJMS)
def with_joint_laws(vjm: Vjm) -> Vjm:
    """Add the laws of its joints to a model; their virtual joints come after all others.

    Args:
        vjm: Kinematics, with or without laws.

    Returns:
        The kinematics with laws, n_theta = 7 n + 6 + number of laws; remembered for the next call.
    """
    return replace(vjm, laws=laws_of(vjm.arm))


def laws_of(arm: Arm) -> JointLaws:
    """Build the joint laws of an arm from its folder: compliances, weights and compensator.

    Args:
        arm: Description of the arm.

    Returns:
        The laws. Weights are None where masses cannot be read from the MJCF.
    """
    try:
        weights = read_weights(arm)
    except InputError:  # only MuJoCo can weigh its shapes: as if it weighed nothing
        weights = None
    return JointLaws(np.array([joint.compliance for joint in arm.joints]), weights, arm.compensator)


def sizes_of(vjm: Vjm, C_theta: Array) -> dict[str, dict[str, float]]:
    """Read the sizes of joint laws from the diagonal of C_theta.

    Args:
        vjm: Kinematics, with or without laws.
        C_theta: Compliances and, after them, sizes of laws, (n_theta, n_theta) [m/N, rad/(N m), 1].

    Returns:
        Size by joint's name and kind of law [1], in units of `UNIT_SIZES`; empty for a model without laws.
    """
    if vjm.laws is None:
        return {}
    found: dict[str, dict[str, float]] = {joint.name: {} for joint in vjm.arm.joints}
    sizes = np.diag(C_theta)[vjm.arm.n_theta :].tolist()
    for joint, kind, size in zip(vjm.laws.joints, vjm.laws.kinds, sizes, strict=True):
        found[vjm.arm.joints[joint].name][kind] = size
    return found


def for_load_history(vjm: Vjm, taken_off: Mask | None, some: Ids | slice = slice(None)) -> Vjm:
    """Adapt the friction law to runs in which the load was put on, or put on and taken off again.

    Args:
        vjm: Kinematics, with or without laws.
        taken_off: Runs whose load was taken off again, (all runs,); None for none.
        some: Indices of the runs that are wanted, (runs,), or a slice; all by default.

    Returns:
        The model with a loop of two half widths in those runs and of one in the others; unchanged without
        laws.
    """
    if taken_off is None or not isinstance(vjm.laws, JointLaws):
        return vjm
    return replace(vjm, laws=replace(vjm.laws, widths=np.where(taken_off[some], 2.0, 1.0)))


def model_for(vjm: Vjm, structure: Structure) -> Vjm:
    """Choose the model that fits a structure: with joint laws where the structure has sizes of them.

    Args:
        vjm: Kinematics of the arm.
        structure: Structure of the unknowns.

    Returns:
        The kinematics, with laws or as given.
    """
    return with_joint_laws(vjm) if structure.laws else vjm


def tangent(vjm: Vjm, C_theta: Array, chain: Chain, u: Array) -> Array:
    """Compute the tangent compliance of links and joints at a loaded equilibrium, joint laws included.

    The compliance of a joint is its own plus the sum of size times slope of its laws, and at least zero.

    Mathematics: `law-7`.

    Args:
        vjm: Kinematics, with or without laws.
        C_theta: Compliances and, after them, sizes of laws, (n_theta, n_theta) [m/N, rad/N, rad/(N m), 1].
        chain: The arm at its loaded equilibrium.
        u: Load of links and joints there, own weight excluded, (7 n + 6, runs) [N, N m].

    Returns:
        Compliance for a small further load, (runs, 7 n + 6, 7 n + 6) [m/N, rad/N, rad/(N m)].
    """
    n, plain = vjm.arm.n_joints, vjm.arm.n_theta
    C = np.tile(C_theta[:plain, :plain], (len(chain.position), 1, 1))
    if vjm.laws is not None:
        more = np.diag(C_theta)[plain:, None] * vjm.laws.slope(chain, u[plain - n :])
        own = np.arange(plain - n, plain)
        joints = C[:, own, own].T
        np.add.at(joints, vjm.laws.joints, more)
        C[:, own, own] = np.maximum(joints.T, 0.0)
    return C


def with_laws(structure: Structure, arm: Arm) -> Structure:
    """Add the sizes of all joint laws to a structure's unknowns.

    Args:
        structure: Structure of the compliances.
        arm: Description of the arm.

    Returns:
        The structure with the laws as its last parameters; unchanged if it has them, or the arm has no
        joints.
    """
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
    """Add couplings between all pairs of joints to a structure, as its last parameters.

    Args:
        structure: A structure of uncoupled joints.

    Returns:
        The structure with n (n - 1) / 2 more parameters; remembered for the next call.
    """
    joints = 6 * structure.links + np.arange(structure.links - 1)
    a, b = (joints[end] for end in np.triu_indices(len(joints), 1))
    name = structure.name + TIED_SUFFIX * (len(a) > 0)
    return replace(structure, name=name, a=np.append(structure.a, a), b=np.append(structure.b, b))


@lru_cache(maxsize=STRUCTURES)
def without_ties(structure: Structure) -> Structure:
    """Remove the couplings between joints from a structure.

    Args:
        structure: Any structure.

    Returns:
        The structure whose joints are uncoupled; remembered for the next call.
    """
    keep = np.flatnonzero((structure.a < 6 * structure.links) | (structure.a == structure.b))
    return (
        structure
        if len(keep) == structure.n
        else structure.keep(keep, structure.name.removesuffix(TIED_SUFFIX))
    )


@lru_cache(maxsize=STRUCTURES)
def without_laws(structure: Structure) -> Structure:
    """Remove joint laws and couplings between joints from a structure.

    Args:
        structure: Any structure.

    Returns:
        The structure of compliances of links and single joints; remembered for the next call.
    """
    structure = without_ties(structure)
    if not structure.laws:
        return structure
    keep = np.flatnonzero(structure.a < structure.n_compliance_rows)
    plain = structure.keep(keep, structure.name.removesuffix(" + laws"))
    return replace(
        plain,
        n_theta=structure.n_compliance_rows,
        labels=structure.labels[: structure.n_compliance_rows],
        laws=0,
    )
