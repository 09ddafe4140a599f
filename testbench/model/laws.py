"""Joint laws: nonlinear deflections of an actuated joint in addition to that of its linear spring.

A law is one more virtual joint in series with the spring of an actuated joint. With c the nominal compliance
of the joint and x = c tau its nominal deflection, x_0 is that before the load and x_1 that under the load.
The law deflects the joint by a known function of x_0 and x_1, times a size that is at least zero. The size is
an unknown like a compliance. So the model stays linear in all unknowns, and every block of C_theta stays
positive semi-definite. `identify` learns the sizes, `correct` uses them.

tau_0 is the torque of the arm's own weight, less the torque that a compensator carries; tau_1 adds the torque
of the load.

`joint_laws` holds the laws of every joint by name, a class each: stiffening, backlash, friction. Add one by
`joint_laws["name"] = Law()`, or by an entry point of the group `testbench.joint_laws`. A compensator adds a
law to joint 2 alone: -(x_1 - x_0) K s^2 / (1 + K s^2), the part of the deflection that the strut prevents.
K is its stiffness over that of the joint at its longest lever, s its lever over the longest.

Backlash and friction of a gear: Ruderman et al., Modeling and identification of elastic robot joints with
hysteresis and backlash, IEEE Trans. Ind. Electron. 56 (2009). Stiffening: catalogues of strain wave gears.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol

import numpy as np

from testbench.arm.folder import Arm, Compensator
from testbench.errors import Array, BenchError, Ids, InputError, Mask
from testbench.model.load import BodyMasses, own_weight_load, read_body_masses
from testbench.model.structure import Structure
from testbench.model.vjm import ChainState, Vjm, cross
from testbench.registry import Registry

# --- Shapes of joints that are more than linear springs, a class each: deflection, its slope, its size ------

STIFFENING_DEFLECTION, UNIT_STIFFENING = 1e-3, 0.1
"""Deflection phi [rad, m] and beta [1] of stiffening of size one: at phi it is 1 + beta times as stiff.

These and the sizes below are units of the unknowns: a prior expects sizes of order one.
"""
#: Half-widths b of backlash and h of the friction loop of size one [rad, m].
UNIT_BACKLASH_RAD, UNIT_FRICTION_RAD = 5e-5, 3e-5
LAW_SIZE_PRIOR = 0.5, 0.8
"""Median of the sizes of a law of the joints, and standard deviation of its logarithm [1]."""


@dataclass(frozen=True)
class NominalDeflections:
    """Hold the nominal deflections x = c tau of all joints: nominal compliance c times joint torque tau."""

    x_0: Array  #: Before the load, (n, runs) [rad, m].
    x_1: Array  #: Under the load, (n, runs) [rad, m].
    #: Width of the friction loop over its half width: 1 after a load was put on, 2 after it was also taken
    #: off; one number or (runs,) [1].
    loop_width_factor: Array | float = 1.0


class JointLaw(Protocol):
    """Define a joint law: its deflection and slope per unit of size, and the unit of the size."""

    @property
    def unit(self) -> float:
        """Return the SI value of a law of size one; reports show size times unit."""

    @property
    def unit_symbol(self) -> str:
        """Return the SI unit of `unit` as text, such as "rad"."""

    @property
    def size_prior(self) -> tuple[float, float]:
        """Return the prior of the law's size: median, and standard deviation of the logarithm [1]."""

    @property
    def formula(self) -> str:
        """Return the formula of the deflection as text, with s for the size; `export` writes it to a file."""

    def deflection(self, nominal: NominalDeflections) -> Array:
        """Compute the deflection of a joint in addition to its linear spring, per unit of the law's size.

        Args:
            nominal: Nominal deflections x_0 and x_1 before and under the load.

        Returns:
            Deflection, (n, runs) [rad, m].
        """

    def slope(self, nominal: NominalDeflections) -> Array:
        """Compute the derivative of `deflection` with respect to x_1, the nominal deflection under the load.

        Args:
            nominal: Nominal deflections x_0 and x_1 before and under the load.

        Returns:
            Slope, (n, runs) [1].
        """


@dataclass(frozen=True)
class Stiffening:
    """Describe a joint spring that stiffens: the deflection that it adds to that of a linear spring.

    The added deflection is f(x_1) - x_1 - (f(x_0) - x_0). x_0 and x_1 are the deflections of the linear
    spring before and under the load. f(x) solves f + beta f^3 / phi^2 = x: it is the deflection of a spring
    that is 1 + beta times as stiff at the deflection phi as at zero.
    """

    unit: float = UNIT_STIFFENING
    unit_symbol: str = "1"
    size_prior: tuple[float, float] = LAW_SIZE_PRIOR
    formula: str = (
        f"s (f(x_1) - x_1 - f(x_0) + x_0), f + {UNIT_STIFFENING / STIFFENING_DEFLECTION**2:g} f^3 = x"
    )

    def deflection(self, nominal: NominalDeflections) -> Array:
        """Compute the deflection f(x_1) - x_1 - (f(x_0) - x_0) that a stiffening spring adds to a linear one.

        f(x) solves f + beta f^3 / phi^2 = x.

        Mathematics: `law-3`.

        Args:
            nominal: Nominal deflections x_0 and x_1 before and under the load.

        Returns:
            Deflection per unit of size, (n, runs) [rad, m].
        """
        return (_spring(nominal.x_1) - nominal.x_1) - (_spring(nominal.x_0) - nominal.x_0)

    def slope(self, nominal: NominalDeflections) -> Array:
        """Compute the derivative f'(x_1) - 1 of a stiffening spring's deflection with respect to x_1.

        Args:
            nominal: Nominal deflections x_0 and x_1 before and under the load.

        Returns:
            Slope per unit of size, (n, runs) [1].
        """
        return np.asarray(
            1 / (1 + 3 * UNIT_STIFFENING * (_spring(nominal.x_1) / STIFFENING_DEFLECTION) ** 2) - 1
        )


@dataclass(frozen=True)
class Backlash:
    """Describe the backlash of a gear: the deflection b (tanh(x_1 / b) - tanh(x_0 / b)) across its gap.

    b is half the gap. x_0 and x_1 are the deflections of the joint's linear spring before and under the load;
    their sign selects the side of the gap.
    """

    unit: float = UNIT_BACKLASH_RAD
    unit_symbol: str = "rad"
    size_prior: tuple[float, float] = LAW_SIZE_PRIOR
    formula: str = (
        f"s {UNIT_BACKLASH_RAD:g} (tanh(x_1 / {UNIT_BACKLASH_RAD:g}) - tanh(x_0 / {UNIT_BACKLASH_RAD:g}))"
    )

    def deflection(self, nominal: NominalDeflections) -> Array:
        """Compute the deflection across a gear's gap, b (tanh(x_1 / b) - tanh(x_0 / b)).

        Mathematics: `law-4`.

        Args:
            nominal: Nominal deflections x_0 and x_1 before and under the load.

        Returns:
            Deflection per unit of size, (n, runs) [rad, m].
        """
        b = UNIT_BACKLASH_RAD
        return np.asarray(b * (np.tanh(nominal.x_1 / b) - np.tanh(nominal.x_0 / b)))

    def slope(self, nominal: NominalDeflections) -> Array:
        """Compute the derivative of the backlash deflection with respect to x_1, 1 - tanh(x_1 / b)^2.

        Args:
            nominal: Nominal deflections x_0 and x_1 before and under the load.

        Returns:
            Slope per unit of size, (n, runs) [1].
        """
        return np.asarray(1 - np.tanh(nominal.x_1 / UNIT_BACKLASH_RAD) ** 2)


@dataclass(frozen=True)
class Friction:
    """Describe friction that holds a joint back by the deflection -h clip((x_1 - x_0) / h, -1, 1).

    h is half the width of the hysteresis loop. x_0 and x_1 are the deflections of the joint's linear spring
    before and under the load; friction holds back no more than x_1 - x_0. If a load was put on in the pose
    and then taken off, 2 h replaces h, because friction held the joint back both times.
    """

    unit: float = UNIT_FRICTION_RAD
    unit_symbol: str = "rad"
    size_prior: tuple[float, float] = LAW_SIZE_PRIOR
    formula: str = f"-s {UNIT_FRICTION_RAD:g} clip((x_1 - x_0) / {UNIT_FRICTION_RAD:g}, -1, 1)"

    def deflection(self, nominal: NominalDeflections) -> Array:
        """Compute the deflection that joint friction holds back, -h clip((x_1 - x_0) / h, -1, 1).

        Mathematics: `law-5`.

        Args:
            nominal: Nominal deflections x_0 and x_1 before and under the load, and the width of the loop.

        Returns:
            Deflection per unit of size, (n, runs) [rad, m].
        """
        width = nominal.loop_width_factor * UNIT_FRICTION_RAD
        return np.asarray(-width * np.clip((nominal.x_1 - nominal.x_0) / width, -1, 1))

    def slope(self, nominal: NominalDeflections) -> Array:
        """Compute the derivative of the friction deflection: -1 if the joint sticks, 0 if it slips.

        Args:
            nominal: Nominal deflections x_0 and x_1 before and under the load, and the width of the loop.

        Returns:
            Slope per unit of size, (n, runs) [1].
        """
        return np.asarray(
            -1.0 * (np.abs(nominal.x_1 - nominal.x_0) < nominal.loop_width_factor * UNIT_FRICTION_RAD)
        )


def _spring(x: Array) -> Array:
    """Solve f + beta f^3 / phi^2 = x for its real root f, by the hyperbolic form of Cardano's formula."""
    a = np.sqrt(3 * UNIT_STIFFENING) / STIFFENING_DEFLECTION
    return np.asarray(2 / a * np.sinh(np.arcsinh(1.5 * a * x) / 3))


COMPENSATOR_KIND = "compensator"  #: Kind of the law that a gravity compensator adds to joint 2.
LAW_CHECK_DEFLECTIONS = NominalDeflections(np.array([[-1e-3, 0.0]]), np.array([[2e-3, 1e-3]]))
"""Nominal deflections at which a law that a user adds is tried: one joint, two runs [rad]."""


def _check(name: str, law: JointLaw) -> None:
    """Refuse an object that is no law, before a fit fails of it."""
    wanted = "unit", "unit_symbol", "size_prior", "formula", "deflection", "slope"
    if missing := [attribute for attribute in wanted if not hasattr(law, attribute)]:
        raise BenchError(f"joint law {name!r}: {type(law).__name__} lacks {', '.join(missing)}")
    if name == COMPENSATOR_KIND:
        raise BenchError(f"joint law {name!r}: the name is taken; choose another")
    median, width = law.size_prior
    if not (law.unit > 0 and median > 0 and width > 0):
        raise BenchError(f"joint law {name!r}: expected a unit and a size_prior above 0")
    for part in (law.deflection, law.slope):
        values = np.asarray(part(LAW_CHECK_DEFLECTIONS))
        if values.shape != LAW_CHECK_DEFLECTIONS.x_1.shape or not np.isfinite(values).all():
            raise BenchError(
                f"joint law {name!r}: expected finite numbers (n, runs) from {part.__name__}, got {values!r}"
            )


joint_laws: Registry[JointLaw] = Registry(
    "joint law",
    "testbench.joint_laws",
    {"stiffening": Stiffening(), "backlash": Backlash(), "friction": Friction()},
    _check,
)
"""Laws of every joint by name: those of any arm, and those that users add."""


# --- Joint laws of an arm -----------------------------------------------------------------------------------

#: Stiffness K of a compensator of size one over the stiffness of joint 2 [1].
UNIT_COMPENSATOR_STIFFNESS = 0.3
UNIT_COMPENSATOR_RELIEF = UNIT_COMPENSATOR_STIFFNESS / (1 + UNIT_COMPENSATOR_STIFFNESS)
"""Largest fraction of joint 2's deflection that a compensator of size one prevents, K / (1 + K) [1]."""
COMPENSATOR_SIZE_PRIOR = 0.05, 1.5
"""Median of a compensator's size, and standard deviation of its logarithm [1]: from no stiffness as the arm
deflects to half of that of joint 2."""
COUPLED_JOINTS_SUFFIX = " + joints coupled"  #: End of the name of a structure with couplings between joints.
CACHED_VJMS = CACHED_STRUCTURES = 32  #: Number of models with laws, and of structures, that are remembered.


@dataclass(frozen=True)
class JointLaws:
    """Hold all joint laws of an arm: every kind for every joint, and one for a compensator.

    The laws are ordered by kind: stiffening of all joints, backlash of all, and so on. Their number is the
    number of kinds times n, and one more with a compensator.
    """

    joint_compliances: Array  #: Nominal compliance c of every joint, (n,) [rad/(N m), m/N].
    body_masses: BodyMasses | None  #: Masses of the arm; None where they are unknown.
    compensator: Compensator | None  #: Spring from link 1 to link 2; None where there is none.
    laws_by_kind: Mapping[str, JointLaw]  #: Laws of every joint by kind.
    #: Width of the friction loop over its half width, one or (runs,) [1].
    loop_width_factor: Array | float = 1.0

    @property
    def kinds(self) -> tuple[str, ...]:
        """Name the kind of every joint law, (laws,): a name in `joint_laws`, or "compensator"."""
        every = tuple(np.repeat(list(self.laws_by_kind), len(self.joint_compliances)).tolist())
        return every if self.compensator is None else (*every, COMPENSATOR_KIND)

    @property
    def joint_indices(self) -> Ids:
        """Return the index of the actuated joint that each joint law deflects, (laws,)."""
        every = np.tile(np.arange(len(self.joint_compliances)), len(self.laws_by_kind))
        return every if self.compensator is None else np.append(every, 1)

    def unit_deflections(self, chain: ChainState, load_torques: Array) -> Array:
        """Compute the deflection that every law adds to its joint under a load, per unit of the law's size.

        Mathematics: `law-1`, `law-6`.

        Args:
            chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.
            load_torques: Torques of the load at the actuated joints, (n, runs) [N m, N].

        Returns:
            Deflection per unit of size, (laws, runs) [rad, m].
        """
        nominal, c = self._nominal_deflections(chain, load_torques), self.joint_compliances[:, None]
        deflections = [law.deflection(nominal) for law in self.laws_by_kind.values()]
        return np.concatenate([*deflections, self._compensator_relief(chain) * (c * load_torques)[1:2]])

    def unit_slopes(self, chain: ChainState, load_torques: Array) -> Array:
        """Compute the derivative of the laws' unit deflections with respect to the torque of their joint.

        Args:
            chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.
            load_torques: Torques of the load at the actuated joints, (n, runs) [N m, N].

        Returns:
            Deflection per unit of size and torque, (laws, runs) [rad/(N m), m/N].
        """
        nominal, c = self._nominal_deflections(chain, load_torques), self.joint_compliances[:, None]
        slopes = [c * law.slope(nominal) for law in self.laws_by_kind.values()]
        return np.concatenate([*slopes, c[1:2] * self._compensator_relief(chain)])

    def _nominal_deflections(self, chain: ChainState, u: Array) -> NominalDeflections:
        """Compute the nominal deflections of all joints before and under the load."""
        c, before = self.joint_compliances[:, None], self.torques_before_load(chain)
        return NominalDeflections(c * before, c * (before + u), self.loop_width_factor)

    def torques_before_load(self, chain: ChainState) -> Array:
        """Compute the torques tau_0 at the actuated joints before a load is put on the arm.

        They are the torques of the arm's own weight, less those that a compensator carries. Without known
        masses the arm counts as weightless.

        Mathematics: `law-2`.

        Args:
            chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.

        Returns:
            Torques tau_0, (n, runs) [N m, N].
        """
        n, links = len(self.joint_compliances), 6 * (len(self.joint_compliances) + 1)
        if self.body_masses is None:
            torque = np.zeros((n, len(chain.tool_position)))
        else:
            torque = own_weight_load(chain, self.body_masses)[links : links + n].copy()
        if self.compensator is not None:
            lever, _, length = _levers(self.compensator, chain)
            torque[1] += self.compensator.rate * (length - self.compensator.rest_length) * lever
        return torque

    def _compensator_relief(self, chain: ChainState) -> Array:
        """Compute the relative change of joint 2's deflection by a compensator, -K s^2 / (1 + K s^2).

        Returns:
            Relative change, (1, runs) [1]; (0, runs) without a compensator.
        """
        if self.compensator is None:
            return np.zeros((0, len(chain.tool_position)))
        lever, longest, _ = _levers(self.compensator, chain)
        stiffer = UNIT_COMPENSATOR_STIFFNESS * (lever / longest) ** 2
        return -(stiffer / (1 + stiffer))[None]


def _levers(spring: Compensator, chain: ChainState) -> tuple[Array, Array, Array]:
    """Compute a strut's lever about joint 2, its longest lever, and its length, (runs,) [m] each."""
    (foot, R_1), (joint, R_2) = chain.body_frames[1], chain.body_frames[2]
    axis, arm = chain.J_theta[3:, 6 * (len(chain.body_frames) - 1) + 1], spring.head @ R_2
    along = foot + spring.foot @ R_1 - joint - arm
    length = np.linalg.norm(along, axis=0)
    lever = (axis * cross(arm, along / length)).sum(axis=0)
    return lever, np.linalg.norm(cross(axis, arm), axis=0), length


def add_joint_laws(vjm: Vjm, kinds: Sequence[str] | None = None) -> Vjm:
    """Add joint laws to the kinematics of an arm; their virtual joints come after all others.

    Args:
        vjm: Kinematics of the arm, with or without joint laws.
        kinds: Kinds of the laws, names in `joint_laws`; None for all.

    Returns:
        The kinematics with laws, n_theta = 7 n + 6 + number of laws; cached.
    """
    names = joint_laws if kinds is None else kinds
    return _with_laws_of_kinds(vjm, tuple((name, joint_laws[name]) for name in names))


@lru_cache(maxsize=CACHED_VJMS)
def _with_laws_of_kinds(vjm: Vjm, named_laws: tuple[tuple[str, JointLaw], ...]) -> Vjm:
    return replace(vjm, joint_laws=build_joint_laws(vjm.arm, dict(named_laws)))


def build_joint_laws(arm: Arm, laws_by_kind: Mapping[str, JointLaw] = joint_laws) -> JointLaws:
    """Build the joint laws of an arm from its folder: compliances, masses and compensator.

    Args:
        arm: Description of the arm.
        laws_by_kind: Laws of every joint by kind.

    Returns:
        The laws; `body_masses` is None if masses cannot be read from the MJCF.
    """
    try:
        weights = read_body_masses(arm)
    except InputError:  # only MuJoCo computes masses from shapes: counted as massless
        weights = None
    compliance = np.array([joint.compliance for joint in arm.joints])
    return JointLaws(compliance, weights, arm.compensator, dict(laws_by_kind))


def law_kinds(structure: Structure) -> tuple[str, ...]:
    """List the kinds of joint laws whose sizes are parameters of a structure, in their order."""
    labels = structure.row_labels[structure.n_compliance_rows :] if structure.n_laws else ()
    return tuple(dict.fromkeys(label.rpartition(" ")[2] for label in labels))


def law_size_prior(kind: str) -> tuple[float, float]:
    """Return the prior of a joint law's size: its median, and the standard deviation of its logarithm [1]."""
    return COMPENSATOR_SIZE_PRIOR if kind == COMPENSATOR_KIND else joint_laws[kind].size_prior


def law_unit(kind: str) -> float:
    """Return the SI value of a joint law's size of one, by the kind of the law [1, rad; m for a slide]."""
    return UNIT_COMPENSATOR_RELIEF if kind == COMPENSATOR_KIND else joint_laws[kind].unit


def law_sizes(vjm: Vjm, C_theta: Array) -> dict[str, dict[str, float]]:
    """Read the sizes of joint laws from the diagonal of C_theta.

    Args:
        vjm: Kinematics, with or without joint laws.
        C_theta: Compliances and, after them, sizes of joint laws, (n_theta, n_theta) [m/N, rad/(N m), 1].

    Returns:
        Size by joint's name and kind of joint law [1], a multiple of `law_unit`; empty without joint laws.
    """
    if vjm.joint_laws is None:
        return {}
    by_joint: dict[str, dict[str, float]] = {joint.name: {} for joint in vjm.arm.joints}
    sizes = np.diag(C_theta)[vjm.arm.n_theta :].tolist()
    for joint, kind, size in zip(vjm.joint_laws.joint_indices, vjm.joint_laws.kinds, sizes, strict=True):
        by_joint[vjm.arm.joints[joint].name][kind] = size
    return by_joint


def set_load_history(vjm: Vjm, unloaded_after_load: Mask | None, runs: Ids | slice = slice(None)) -> Vjm:
    """Set the width of the friction loop of every run: one half width, or two where the load was taken off.

    Friction holds a joint back when the load is put on, and again when it is taken off.

    Args:
        vjm: Kinematics, with or without joint laws.
        unloaded_after_load: Whether the load was put on and taken off again, (all runs,); None for no run.
        runs: Indices of the requested runs, (runs,), or a slice; all by default.

    Returns:
        The kinematics with these widths; unchanged without joint laws.
    """
    if unloaded_after_load is None or not isinstance(vjm.joint_laws, JointLaws):
        return vjm
    return replace(
        vjm,
        joint_laws=replace(vjm.joint_laws, loop_width_factor=np.where(unloaded_after_load[runs], 2.0, 1.0)),
    )


def vjm_for_structure(vjm: Vjm, structure: Structure) -> Vjm:
    """Add to the kinematics of an arm the joint laws whose sizes are unknowns of a structure.

    Args:
        vjm: Kinematics of the arm.
        structure: Structure of the unknowns.

    Returns:
        The kinematics with these laws; unchanged if the structure has none.
    """
    kinds = [kind for kind in law_kinds(structure) if kind != COMPENSATOR_KIND]
    return add_joint_laws(vjm, kinds) if kinds else vjm


def tangent_C_theta(vjm: Vjm, C_theta: Array, chain: ChainState, generalised_load: Array) -> Array:
    """Compute the tangent compliance of links and joints at a loaded equilibrium, joint laws included.

    The compliance of a joint is its own plus the sum of size times slope of its laws, and at least zero.

    Mathematics: `law-7`.

    Args:
        vjm: Kinematics, with or without laws.
        C_theta: Compliances and, after them, sizes of laws, (n_theta, n_theta) [m/N, rad/N, rad/(N m), 1].
        chain: The arm at its loaded equilibrium.
        generalised_load: Load of links and joints there, own weight excluded, (7 n + 6, runs) [N, N m].

    Returns:
        Compliance for a small further load, (runs, 7 n + 6, 7 n + 6) [m/N, rad/N, rad/(N m)].
    """
    n, plain = vjm.arm.n_joints, vjm.arm.n_theta
    C = np.tile(C_theta[:plain, :plain], (len(chain.tool_position), 1, 1))
    if vjm.joint_laws is not None:
        more = np.diag(C_theta)[plain:, None] * vjm.joint_laws.unit_slopes(
            chain, generalised_load[plain - n :]
        )
        joint_rows = np.arange(plain - n, plain)
        joints = C[:, joint_rows, joint_rows].T
        np.add.at(joints, vjm.joint_laws.joint_indices, more)
        C[:, joint_rows, joint_rows] = np.maximum(joints.T, 0.0)
    return C


def add_law_parameters(structure: Structure, arm: Arm, kinds: Sequence[str] | None = None) -> Structure:
    """Add the sizes of joint laws to a structure's unknowns.

    Args:
        structure: Structure of the compliances.
        arm: Description of the arm.
        kinds: Kinds of the laws, names in `joint_laws`; None for all.

    Returns:
        The structure with these sizes as its last parameters; unchanged if it has sizes of laws already, or
        the arm has no joints.
    """
    if structure.n_laws or not arm.joints:
        return structure
    laws = build_joint_laws(
        arm, {name: joint_laws[name] for name in (joint_laws if kinds is None else kinds)}
    )
    more = structure.n_theta + np.arange(len(laws.joint_indices))
    names = [arm.joints[k].name for k in laws.joint_indices]
    return replace(
        structure,
        name=f"{structure.name} + laws",
        n_theta=structure.n_theta + len(more),
        rows=np.append(structure.rows, more),
        columns=np.append(structure.columns, more),
        row_labels=(*structure.row_labels, *map(" ".join, zip(names, laws.kinds, strict=True))),
        n_laws=len(more),
    )


@lru_cache(maxsize=CACHED_STRUCTURES)
def add_coupling_parameters(structure: Structure) -> Structure:
    """Add the compliances that couple each pair of joints as last parameters of a structure; cached."""
    joints = 6 * structure.n_links + np.arange(structure.n_links - 1)
    a, b = (joints[end] for end in np.triu_indices(len(joints), 1))
    name = structure.name + COUPLED_JOINTS_SUFFIX * (len(a) > 0)
    return replace(
        structure,
        name=name,
        rows=np.append(structure.rows, a),
        columns=np.append(structure.columns, b),
    )


@lru_cache(maxsize=CACHED_STRUCTURES)
def remove_coupling_parameters(structure: Structure) -> Structure:
    """Remove the compliances that couple joints from the unknowns of a structure; cached."""
    keep = np.flatnonzero((structure.rows < 6 * structure.n_links) | (structure.rows == structure.columns))
    return (
        structure
        if len(keep) == structure.n_parameters
        else structure.select_parameters(keep, structure.name.removesuffix(COUPLED_JOINTS_SUFFIX))
    )


@lru_cache(maxsize=CACHED_STRUCTURES)
def remove_law_parameters(structure: Structure) -> Structure:
    """Remove the sizes of joint laws and the joint couplings from the unknowns of a structure; cached."""
    structure = remove_coupling_parameters(structure)
    if not structure.n_laws:
        return structure
    keep = np.flatnonzero(structure.rows < structure.n_compliance_rows)
    plain = structure.select_parameters(keep, structure.name.removesuffix(" + laws"))
    return replace(
        plain,
        n_theta=structure.n_compliance_rows,
        row_labels=structure.row_labels[: structure.n_compliance_rows],
        n_laws=0,
    )
