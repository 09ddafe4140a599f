"""Priors: compliances expected before any reading, and their relative uncertainty.

`cad_prior` makes one from the arm's folder. `metric` turns it into rows that are added to those of the data,
and `hierarchy` learns its scales and uncertainties from the readings.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from testbench.arm.folder import Arm
from testbench.display import Displayed
from testbench.errors import Array, BenchError, check_type
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

UNCERTAINTY_RANGE = 1e-6, 1e6
"""Range of accepted relative uncertainties of a prior [1]; `Strength` refuses others."""
SOFTENING = 0.5
"""Share of the couplings (off-diagonal compliances) that `with_weaker_coupling` removes from every link [1].

It stands for bearings and flanges that are elastic in addition to the beam between them.
"""
CACHED_PRIORS = 32
"""Number of softened priors that are cached, so that their metrics are found again."""


@dataclass(frozen=True, eq=False, repr=False)
class Prior(Displayed):
    """Hold the expected compliances of an arm; read-only, and equal only to itself."""

    name: str  #: Origin of the numbers, for reports.
    #: Aggregated compliance, symmetric and positive definite in every link's and joint's block, (n_theta,
    #: n_theta) [m/N, rad/(N m), rad/N].
    C_theta: Array

    def about(self) -> dict[str, object]:
        """Return the rows of the small table that shows a prior."""
        return {"name": self.name}

    def __post_init__(self) -> None:
        """Keep a read-only copy, so that cached metrics of this prior stay valid."""
        own = np.array(self.C_theta)
        own.setflags(write=False)
        object.__setattr__(self, "C_theta", own)


@dataclass(frozen=True)
class Strength:
    """Hold the relative uncertainty of a prior; `metric.precision_root` turns it into weights."""

    uncertainty: float  #: Relative standard deviation u of an entry of x around its expectation [1].
    #: Relative standard deviation of the factor common to all compliances [1]; infinite leaves the factor to
    #: the data.
    scale_uncertainty: float = np.inf
    #: u of the entries inside a link that no straight beam has [1]; None for `uncertainty`.
    coupling: float | None = None
    #: Factor on u of every block, (blocks,) [1]; None for 1 everywhere.
    shares: tuple[float, ...] | None = None
    tie: float | None = None  #: u of the entries that couple two joints [1]; None for `uncertainty`.

    def __post_init__(self) -> None:
        """Refuse by BenchError an uncertainty outside `UNCERTAINTY_RANGE`, or below zero of the scale."""
        low, high = UNCERTAINTY_RANGE
        coupling = self.uncertainty if self.coupling is None else self.coupling
        for name, value in (("uncertainty", self.uncertainty), ("coupling", coupling)):
            if not low <= value <= high:
                raise BenchError(f"{name}: expected {low:g} to {high:g}, got {value}")
        if not self.scale_uncertainty >= 0:
            raise BenchError(f"scale_uncertainty: expected 0 or more, got {self.scale_uncertainty}")


def cad_prior(arm: Arm) -> Prior:
    """Make the prior of an arm's folder: beams of the links' dimensions, catalogue stiffness of the joints.

    Args:
        arm: The arm.

    Returns:
        Expected compliances, as accurate as the folder.

    Raises:
        BenchError: When the argument is no arm.
    """
    check_type(arm, Arm, "arm")
    return Prior(f"CAD of {arm.name}", arm.C_theta)


@lru_cache(maxsize=CACHED_PRIORS)
def with_weaker_coupling(prior: Prior) -> Prior:
    """Make a prior whose links are less like beams: equal on the diagonal, weaker couplings.

    Mathematics: `prior-6`.

    Args:
        prior: Expected compliances.

    Returns:
        C (1 - SOFTENING) + SOFTENING diag(C); cached.
    """
    C = prior.C_theta
    return replace(prior, C_theta=(1 - SOFTENING) * C + SOFTENING * np.diag(np.diag(C)))


def perturbed(prior: Prior, *, scale: float, shape: float, rng: np.random.Generator) -> Prior:
    """Make a wrong prior: D C D times a common factor, D diagonal and random.

    Args:
        prior: Expected compliances.
        scale: Common factor [1].
        shape: Standard deviation of the logarithm of every diagonal entry's own factor [1].
        rng: Source of randomness.

    Returns:
        The wrong prior; it is positive definite as before.

    Raises:
        BenchError: When scale is not above 0 or shape is below 0.
    """
    if not scale > 0 or not shape >= 0:
        raise BenchError(f"prior: expected a scale above 0 and a shape of at least 0, got {scale}, {shape}")
    factor = np.exp(shape / 2 * rng.standard_normal(len(prior.C_theta)))  # on both sides of C
    name = f"{prior.name}, {scale:g} times, shape {100 * shape:g} % off"
    return Prior(name, scale * factor[:, None] * prior.C_theta * factor)


def aggregate(C: Array, vjm: Vjm, structure: Structure) -> Array:
    """Add the compliance of joints that a structure leaves out to the link before them, as the paper does.

    Mathematics: `prior-5`.

    Args:
        C: Compliance, (n_theta, n_theta) [m/N, rad/(N m), rad/N].
        vjm: The arm's virtual joint model.
        structure: The unknowns.

    Returns:
        C with C_link + c a a^T, a the joint's axis in the link's frame, for each such joint, (n_theta,
        n_theta).
    """
    C, first = C.copy(), 6 * len(vjm.arm.links)
    out = np.flatnonzero(structure.block_of[first : first + vjm.arm.n_joints] < 0)
    slides = np.array([joint.prismatic for joint in vjm.arm.joints], dtype=bool)[out]
    rows = 6 * out[:, None] + np.where(slides, 0, 3)[:, None] + np.arange(3)  # that the joint moves
    axis = vjm.beam_axes[out]
    added = C[first + out, first + out, None, None] * axis[:, :, None] * axis[:, None, :]
    C[rows[:, :, None], rows[:, None, :]] += added
    return C
