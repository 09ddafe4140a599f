"""What is believed of the compliances before any data: how compliant, and how sure."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from testbench.arm.folder import Arm
from testbench.display import Displayed
from testbench.errors import Array, BenchError
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

RANGE = 1e-6, 1e6  #: Relative uncertainties of a prior that mean something [1].
SOFTENED = 0.5  #: Share of couplings that links lose whose bearings and flanges give way too [1].
PRIORS = 32  #: How many priors are remembered so.


@dataclass(frozen=True, eq=False, repr=False)
class Prior(Displayed):
    """Expected compliances of an arm; equal to itself alone, and its numbers stay as they are."""

    name: str  #: Where they are from, for reports.
    #: Symmetric, positive definite in every link's and joint's block, (n_theta, n_theta) [m/N, rad/(N m)].
    C_theta: Array

    def about(self) -> dict[str, object]:
        """Where it is from."""
        return {"name": self.name}

    def __post_init__(self) -> None:
        """Keep a copy that nobody can write to: what was worked out from it holds."""
        own = np.array(self.C_theta)
        own.setflags(write=False)
        object.__setattr__(self, "C_theta", own)


@dataclass(frozen=True)
class Strength:
    """How firmly a prior is believed."""

    uncertainty: float  #: Relative standard deviation u of a compliance around its expectation [1].
    #: The same of the factor common to all; infinite leaves it to the data.
    scale_uncertainty: float = np.inf
    coupling: float | None = None  #: u of the entries that no straight beam has; None for that of all others.
    shares: tuple[float, ...] | None = None  #: What u of every block is times these [1]; None for all alike.
    tie: float | None = None  #: u of the entries that couple joints; None for that of all others.

    def __post_init__(self) -> None:
        """Refuse an uncertainty out of RANGE, or one of the scale below 0, by BenchError."""
        low, high = RANGE
        coupling = self.uncertainty if self.coupling is None else self.coupling
        for name, value in (("uncertainty", self.uncertainty), ("coupling", coupling)):
            if not low <= value <= high:
                raise BenchError(f"{name}: expected {low:g} to {high:g}, got {value}")
        if not self.scale_uncertainty >= 0:
            raise BenchError(f"scale_uncertainty: expected 0 or more, got {self.scale_uncertainty}")


def cad_prior(arm: Arm) -> Prior:
    """The compliances of the arm's folder: beams of the links' dimensions, catalogue values of the joints.

    Args:
        arm: The arm.

    Returns:
        Expected compliances, as right as the folder.
    """
    return Prior(f"CAD of {arm.name}", arm.C_theta)


@lru_cache(maxsize=PRIORS)
def softened(prior: Prior) -> Prior:
    """A prior of links that are less of a beam: as compliant along their axes, less coupled."""
    C = prior.C_theta
    return replace(prior, C_theta=(1 - SOFTENED) * C + SOFTENED * np.diag(np.diag(C)))


def distorted(prior: Prior, *, scale: float, shape: float, rng: np.random.Generator) -> Prior:
    """A prior that is wrong: by a common factor, and each diagonal entry by one of its own.

    `shape` is the standard deviation of the logarithm of these [1].

    Raises:
        BenchError: When scale is not above 0 or shape is below 0.
    """
    if not scale > 0 or not shape >= 0:
        raise BenchError(f"prior: expected a scale above 0 and a shape of at least 0, got {scale}, {shape}")
    factor = np.exp(shape / 2 * rng.standard_normal(len(prior.C_theta)))  # on both sides of C
    name = f"{prior.name}, {scale:g} times, shape {100 * shape:g} % off"
    return Prior(name, scale * factor[:, None] * prior.C_theta * factor)


def aggregate(C: Array, vjm: Vjm, structure: Structure) -> Array:
    """C_theta, (n_theta, n_theta), the joints that a structure leaves out put into the links before them."""
    C, first = C.copy(), 6 * len(vjm.arm.links)
    out = np.flatnonzero(structure.block_of[first : first + vjm.arm.n_joints] < 0)
    slides = np.array([joint.prismatic for joint in vjm.arm.joints], dtype=bool)[out]
    rows = 6 * out[:, None] + np.where(slides, 0, 3)[:, None] + np.arange(3)  # that the joint moves
    axis = vjm.beam_axes[out]
    added = C[first + out, first + out, None, None] * axis[:, :, None] * axis[:, None, :]
    C[rows[:, :, None], rows[:, None, :]] += added
    return C
