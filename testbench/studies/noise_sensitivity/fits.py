"""Models and their fits of clean readings read again with noise, judged by true deflections."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from testbench.bench.baselines import equal_fit
from testbench.bench.campaign import Cell
from testbench.bench.default import with_priors
from testbench.bench.models import Model, named_models
from testbench.bench.rows import UM, DatasetRow
from testbench.bench.wrong_prior import with_wrong_prior, wrong_prior
from testbench.data.dataset import Dataset
from testbench.data.tracker import Tracker, read_orientations, read_positions
from testbench.identify import Constraint, Estimate
from testbench.identify.evaluate import all_deflections, score

ANGLE_PER_LENGTH = 10.0
"""Standard deviation of an orientation over that of a position [rad/m]: 250 urad beside 25 um."""
WEIGHT = 25e-6  #: Sigma by which noise-free readings are weighted [m]: any will do.
LEARNS = ("ALL153",)
"""What `DEFAULT` fits: it alone learns its prior, which takes longer than the fit."""


@dataclass(frozen=True)
class FitRow:
    """A model fitted and judged by true deflections."""

    name: str  #: Of the model.
    structure: str
    constraint: Constraint
    prior: bool
    rms_um: float
    p95_um: float
    conservative: bool
    solved: bool


@dataclass(frozen=True)
class TrialRow(FitRow):
    """One fit of one trial."""

    true_arm: str  #: One of TRUTHS.
    measured: DatasetRow | None = None  #: The dataset, of one case of the trial alone.


def plain_models(cell: Cell, names: Sequence[str]) -> list[Model]:
    """Models without a prior; beside MLS56 stands what is conservative and fits as well."""
    models = named_models(cell, names)
    models.insert(names.index("MLS56") + 1, equal_fit(cell))
    return models


def with_wrong_priors(cell: Cell, models: Sequence[Model], names: Sequence[str], seed: int) -> list[Model]:
    """Models, those of these names with a prior that is wrong and believed as firmly for each, the default.

    Args:
        cell: The arm of the model: the prior is wrong about its folder.
        models: Without a prior.
        names: Of those that are fitted with it too.
        seed: Of the prior's errors.
    """
    default = with_priors(named_models(cell, LEARNS), wrong_prior(cell, seed))
    return [*with_wrong_prior(cell, models, names, seed), *default]


def judged(cell: Cell, model: Model, estimates: Sequence[Estimate], truth: Dataset) -> list[FitRow]:
    """A model's estimates judged by the same true deflections."""
    errors = [score(moved, truth.deflection) for moved in all_deflections(cell.vjm, estimates, truth)]
    return [
        FitRow(
            name=model.name,
            structure=model.structure.name,
            constraint=estimate.constraint,
            prior=estimate.belief is not None,
            rms_um=UM * found.rms,
            p95_um=UM * found.p95,
            conservative=estimate.conservative,
            solved=estimate.status == "solved",
        )
        for estimate, found in zip(estimates, errors, strict=True)
    ]


def reread(clean: Dataset, sigma: float, rng: np.random.Generator) -> Dataset:
    """A noise-free dataset read with noise: for every sigma [m] the same numbers; orientations follow it."""
    tracker = Tracker(sigma, ANGLE_PER_LENGTH * sigma)
    before, after = (read_positions(tracker, p, rng) for p in (clean.before, clean.after))
    data = replace(clean, before=before, after=after, sigma=sigma or WEIGHT)
    if clean.rotation_before is None or clean.rotation_after is None:
        return data
    turned = [
        read_orientations(tracker, Rotation.from_rotvec(r).as_matrix(), rng)
        for r in (clean.rotation_before, clean.rotation_after)
    ]
    sigma_rotation = ANGLE_PER_LENGTH * data.sigma
    return replace(data, rotation_before=turned[0], rotation_after=turned[1], sigma_rotation=sigma_rotation)
