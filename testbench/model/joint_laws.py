"""Shapes of joints that are more than linear springs, a class each: the turn, its slope, and its size.

A law gives the turn of a joint beside its compliance, per unit of a size. The size is an unknown of the fit.
With x = c tau, c the nominal compliance of a joint, x_0 is the turn before the load and x_1 under it.

`joint_laws` holds the laws of every joint by name. Add one by `joint_laws["name"] = Law()`, or by an entry
point of the group `testbench.joint_laws`.

Backlash and friction of a gear: Ruderman et al., Modeling and identification of elastic robot joints with
hysteresis and backlash, IEEE Trans. Ind. Electron. 56 (2009). Stiffening: catalogues of strain wave gears.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from testbench.errors import Array, BenchError
from testbench.registry import Registry, check_has

UNIT_ROTATION, UNIT_STIFFENING = 1e-3, 0.1
"""Turn phi [rad, m] and beta [1] of stiffening of size one: at phi the spring is 1 + beta times as stiff.

These and the sizes below are units of the unknowns: a prior expects sizes of order one.
"""
#: Half-widths b of backlash and h of the friction loop of size one [rad, m].
UNIT_BACKLASH_RAD, UNIT_FRICTION_RAD = 5e-5, 3e-5
LAW_PRIOR = 0.5, 0.8
"""Median of the sizes of a law of the joints, and standard deviation of its logarithm [1]."""


@dataclass(frozen=True)
class JointTurns:
    """Hold the nominal turns of all joints in all runs."""

    x_0: Array  #: Before the load, (n, runs) [rad, m].
    x_1: Array  #: Under the load, (n, runs) [rad, m].
    #: Width of friction's loop in half widths, 1 for a load put on, 2 for one taken off; one or (runs,) [1].
    widths: Array | float = 1.0


class JointLaw(Protocol):
    """Define what the model asks of a law: its turn per unit of size, the slope, and what a size means."""

    @property
    def unit(self) -> float:
        """Return what a size of one means in SI units; reports show size times unit."""

    @property
    def unit_words(self) -> str:
        """Return the unit of that number, such as "rad"."""

    @property
    def size_prior(self) -> tuple[float, float]:
        """Return the median of the size before any reading, and the deviation of its logarithm [1]."""

    @property
    def formula(self) -> str:
        """Return the turn as text, s its size, for the file of numbers beside an exported URDF."""

    def turn(self, at: JointTurns) -> Array:
        """Compute the turn beside the linear one per unit of size.

        Args:
            at: Nominal turns before and under the load.

        Returns:
            Turn, (n, runs) [rad, m].
        """

    def slope(self, at: JointTurns) -> Array:
        """Compute the derivative of `turn` with respect to x_1.

        Args:
            at: Nominal turns before and under the load.

        Returns:
            Slope, (n, runs) [1].
        """


@dataclass(frozen=True)
class Stiffening:
    """Describe springs that stiffen: f(x_1) - x_1 - (f(x_0) - x_0), f + beta f^3 / phi^2 = x.

    f is the turn of a spring whose stiffness at the turn phi is (1 + beta) times that at zero.
    """

    unit: float = UNIT_STIFFENING
    unit_words: str = "1"
    size_prior: tuple[float, float] = LAW_PRIOR
    formula: str = f"s (f(x_1) - x_1 - f(x_0) + x_0), f + {UNIT_STIFFENING / UNIT_ROTATION**2:g} f^3 = x"

    def turn(self, joint_turns: JointTurns) -> Array:
        """Compute the turn that a stiffening spring adds to the linear one, (n, runs) [rad, m].

        Mathematics: `law-3`.
        """
        return (_spring(joint_turns.x_1) - joint_turns.x_1) - (_spring(joint_turns.x_0) - joint_turns.x_0)

    def slope(self, joint_turns: JointTurns) -> Array:
        """Compute f' - 1 at x_1, (n, runs) [1]."""
        return np.asarray(1 / (1 + 3 * UNIT_STIFFENING * (_spring(joint_turns.x_1) / UNIT_ROTATION) ** 2) - 1)


@dataclass(frozen=True)
class Backlash:
    """Describe gaps in the gear: b (tanh(x_1 / b) - tanh(x_0 / b)), b half the gap.

    The sign of the torque selects the side of the gap.
    """

    unit: float = UNIT_BACKLASH_RAD
    unit_words: str = "rad"
    size_prior: tuple[float, float] = LAW_PRIOR
    formula: str = (
        f"s {UNIT_BACKLASH_RAD:g} (tanh(x_1 / {UNIT_BACKLASH_RAD:g}) - tanh(x_0 / {UNIT_BACKLASH_RAD:g}))"
    )

    def turn(self, joint_turns: JointTurns) -> Array:
        """Compute the turn across the gap, (n, runs) [rad, m].

        Mathematics: `law-4`.
        """
        b = UNIT_BACKLASH_RAD
        return np.asarray(b * (np.tanh(joint_turns.x_1 / b) - np.tanh(joint_turns.x_0 / b)))

    def slope(self, joint_turns: JointTurns) -> Array:
        """Compute 1 - tanh(x_1 / b)^2, (n, runs) [1]."""
        return np.asarray(1 - np.tanh(joint_turns.x_1 / UNIT_BACKLASH_RAD) ** 2)


@dataclass(frozen=True)
class Friction:
    """Describe friction that holds the joint: -h clip((x_1 - x_0) / h, -1, 1), h half the hysteresis loop.

    It holds back no more than the turn itself. For a load that was put on in the pose and then taken off the
    full width counts, because the joint was held back both times.
    """

    unit: float = UNIT_FRICTION_RAD
    unit_words: str = "rad"
    size_prior: tuple[float, float] = LAW_PRIOR
    formula: str = f"-s {UNIT_FRICTION_RAD:g} clip((x_1 - x_0) / {UNIT_FRICTION_RAD:g}, -1, 1)"

    def turn(self, joint_turns: JointTurns) -> Array:
        """Compute the turn that friction holds back, (n, runs) [rad, m].

        Mathematics: `law-5`.
        """
        width = joint_turns.widths * UNIT_FRICTION_RAD
        return np.asarray(-width * np.clip((joint_turns.x_1 - joint_turns.x_0) / width, -1, 1))

    def slope(self, joint_turns: JointTurns) -> Array:
        """Compute -1 where friction holds the joint, and 0 where it slips, (n, runs) [1]."""
        return np.asarray(
            -1.0 * (np.abs(joint_turns.x_1 - joint_turns.x_0) < joint_turns.widths * UNIT_FRICTION_RAD)
        )


def _spring(x: Array) -> Array:
    """Solve f + beta f^3 / phi^2 = x for its real root f, by the hyperbolic form of Cardano's formula."""
    a = np.sqrt(3 * UNIT_STIFFENING) / UNIT_ROTATION
    return np.asarray(2 / a * np.sinh(np.arcsinh(1.5 * a * x) / 3))


STRUT = "compensator"  #: Kind of law of joint 2 alone, where the arm has a compensator.
TRIAL_TURNS = JointTurns(np.array([[-1e-3, 0.0]]), np.array([[2e-3, 1e-3]]))
"""Turns at which a law that is added is tried: one joint, two runs."""


def _check(name: str, law: JointLaw) -> None:
    """Refuse an object that is no law, before a fit fails of it."""
    check_has("joint law", name, law, ("unit", "unit_words", "size_prior", "formula", "turn", "slope"))
    if name == STRUT:
        raise BenchError(f"joint law {name!r}: the name is taken; take another one")
    median, width = law.size_prior
    if not (law.unit > 0 and median > 0 and width > 0):
        raise BenchError(f"joint law {name!r}: expected a unit and a size_prior above 0")
    for part in (law.turn, law.slope):
        found = np.asarray(part(TRIAL_TURNS))
        if found.shape != TRIAL_TURNS.x_1.shape or not np.isfinite(found).all():
            raise BenchError(
                f"joint law {name!r}: expected finite numbers (n, runs) from {part.__name__}, got {found!r}"
            )


joint_laws: Registry[JointLaw] = Registry(
    "joint law",
    "testbench.joint_laws",
    {"stiffening": Stiffening(), "backlash": Backlash(), "friction": Friction()},
    _check,
)
"""Laws of every joint by name: those of any arm, and those that users add."""
