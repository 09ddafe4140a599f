"""Priors that are wrong on purpose, and models that are fitted with them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from testbench.arm.stiffness import rotated_compliance
from testbench.errors import Array, BenchError
from testbench.identify.prior import Prior, Strength, cad_prior, perturbed
from testbench.plant.tracker import trial_rng
from testbench.workflows.cell import Cell
from testbench.workflows.model_selection import with_priors
from testbench.workflows.models import Model

SCALE, SHAPE, UNCERTAINTY = 2.0, 0.3, 0.3
"""How wrong a prior is, by a common factor and axis by axis, and how firmly it is believed."""
WRONG_FACTOR, WRONG_ROTATION = 10.0, np.deg2rad(20)
"""How wrong one link or the joints are, as a factor, and by how much beam axes are turned [rad]."""

Spoil = Callable[[Array, int, np.random.Generator], Array]
"""What is done to C_theta, (n_theta, n_theta), of so many links."""


@dataclass(frozen=True)
class Wrong:
    """Describe what is wrong with a prior."""

    spoil: Spoil
    words: str
    #: What is WRONG_FACTOR too soft or too stiff: a link, or all joints.
    far: Literal["link", "joints"] | None = None


def wrong_prior(cell: Cell, seed: int, scale: float = SCALE) -> Prior:
    """Spoil the CAD prior: `scale` times too soft and SHAPE wrong axis by axis, another one for every seed.

    Args:
        cell: The arm with its model and its truth.
        seed: Seed of the trial.
        scale: Factor of all compliances [1].

    Returns:
        The prior.
    """
    return perturbed(cad_prior(cell.arm), scale=scale, shape=SHAPE, rng=trial_rng(seed, 5))


def prior_of(cell: Cell, name: str, seed: int) -> Prior:
    """Make a prior by the name of its error: right, or `wrong_prior` with something more.

    Args:
        cell: The arm with its model and its truth.
        name: One of PRIORS.
        seed: Seed of the trial.

    Returns:
        The prior.
    """
    if name not in PRIORS:
        raise BenchError(f"no prior {name!r}; priors are {', '.join(PRIORS)}")
    if name == UNPERTURBED:
        return cad_prior(cell.arm)
    wrong = wrong_prior(cell, seed)
    C = PRIORS[name].spoil(wrong.C_theta.copy(), len(cell.arm.links), trial_rng(seed, 9))
    return Prior(f"{wrong.name}; {name}", C)


def wrong_link(cell: Cell, seed: int) -> int:
    """Return which link `prior_of` has wrong by WRONG_FACTOR in the prior that has one so, from 0.

    Args:
        cell: The arm with its model and its truth.
        seed: Seed of the trial.

    Returns:
        Index of the link.
    """
    return int(trial_rng(seed, 9).integers(len(cell.arm.links)))


def with_wrong_prior(cell: Cell, models: Sequence[Model], names: Sequence[str], seed: int) -> list[Model]:
    """Add models with a prior that is wrong to those without.

    Args:
        cell: The arm with its model and its truth.
        models: The models.
        names: Models that are fitted with the prior too.
        seed: Seed of the prior's errors.

    Returns:
        All models.
    """
    chosen = [m for m in models if m.name in names]
    return [*models, *with_priors(cell.arm, chosen, wrong_prior(cell, seed), Strength(UNCERTAINTY))]


def _one_link(C: Array, links: int, rng: np.random.Generator) -> Array:
    """One link WRONG_FACTOR too soft or too stiff."""
    k = 6 * int(rng.integers(links))
    C[k : k + 6, k : k + 6] *= _far(rng)
    return C


def _joints(C: Array, links: int, rng: np.random.Generator) -> Array:
    """All joints WRONG_FACTOR too soft, or all too stiff."""
    C[6 * links :, 6 * links :] *= _far(rng)
    return C


def _axes(C: Array, links: int, rng: np.random.Generator) -> Array:
    """The beam axes of every link turned by WRONG_ROTATION, each about a random axis."""
    for own in (slice(6 * k, 6 * k + 6) for k in range(links)):
        C[own, own] = rotated_compliance(C[own, own], rng.standard_normal(3), WRONG_ROTATION)
    return C


def _far(rng: np.random.Generator) -> float:
    return WRONG_FACTOR if rng.random() < 0.5 else 1 / WRONG_FACTOR


UNPERTURBED = "right"
PRIORS: Mapping[str, Wrong] = {
    UNPERTURBED: Wrong(lambda C, *_: C, "the folder's compliances"),
    "scaled": Wrong(
        lambda C, *_: C,
        f"{SCALE:g} times too soft, and {100 * SHAPE:.0f} % off axis by axis, as all that follow",
    ),
    "link": Wrong(_one_link, f"one link {WRONG_FACTOR:g} times too soft or too stiff", far="link"),
    "joints": Wrong(_joints, f"all joints {WRONG_FACTOR:g} times too soft or too stiff", far="joints"),
    "axes": Wrong(_axes, f"beam axes of every link turned by {np.rad2deg(WRONG_ROTATION):.0f} degrees"),
    "uncoupled": Wrong(lambda C, *_: np.diag(np.diag(C)), "no couplings inside a link"),
}
"""By name what is wrong with a prior; all but the right one are SCALE and SHAPE wrong before."""
