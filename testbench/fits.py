"""One model fitted to a user's runs as asked: with or without a prior, with or without a robust loss."""

from dataclasses import dataclass

import numpy as np

from testbench.bench import Cell, Model
from testbench.dataset import Dataset
from testbench.errors import BenchError
from testbench.identify import Estimate, least_squares, reduce
from testbench.identify.crossval import FOLDS, choose_strength, fold_poses
from testbench.identify.prior import Metric, Prior, metric, rescaled
from testbench.identify.regularised import Strength, gco_with, least_squares_with
from testbench.identify.robust import Rejected, gco_robust, least_squares_robust

LEAST_POSES = 2
ROBUST_UNCERTAINTY = 0.3
"""Relative uncertainty of a prior beside a robust loss, where none is given."""


@dataclass(frozen=True)
class Wish:
    """How to fit.

    Attributes:
        prior: Expected compliances; None for no prior.
        uncertainty: How far they may be off, relative [1]; None to choose by cross-validation over poses, or
            `ROBUST_UNCERTAINTY` with a robust loss: cross-validation would see the outliers.
        robust: Whether outliers are looked for.
    """

    prior: Prior | None = None
    uncertainty: float | None = None
    robust: bool = False


def fit(cell: Cell, model: Model, data: Dataset, wish: Wish) -> tuple[Estimate, tuple[Rejected, ...]]:
    """Fit a model; the readings that a robust loss rejected beside it.

    Args:
        cell: The arm.
        model: Structure and method.
        data: The runs.
        wish: How.

    Raises:
        BenchError: When the prior does not fit the structure, or too few readings are left.
    """
    plain = model.estimator is least_squares
    own, strength = _prior(cell, model, data, wish) if wish.prior is not None else (None, None)
    if wish.robust:
        call = least_squares_robust if plain else gco_robust
        found = call(cell.vjm, model.structure, data, metric=own, strength=strength)
        return found.estimate, tuple(found.rejected)
    if own is None or strength is None:
        return model.estimator(cell.vjm, model.structure, data), ()
    regularised = least_squares_with if plain else gco_with
    return regularised(reduce(cell.vjm, model.structure, data), own, strength), ()


def _prior(cell: Cell, model: Model, data: Dataset, wish: Wish) -> tuple[Metric, Strength]:
    """The prior in the scale of the data, and how firmly it is believed."""
    assert wish.prior is not None
    regression = reduce(cell.vjm, model.structure, data)
    own = rescaled(metric(wish.prior, cell.vjm, model.structure), regression)
    if wish.uncertainty is not None:
        return own, Strength(wish.uncertainty)
    if wish.robust:
        return own, Strength(ROBUST_UNCERTAINTY)
    poses = len(np.unique(data.pose))
    if poses < LEAST_POSES:
        raise BenchError(
            f"prior: expected at least {LEAST_POSES} poses to cross-validate its uncertainty, got {poses}; "
            "give it (--uncertainty-percent)"
        )
    folds = fold_poses(cell.vjm, model.structure, data, min(FOLDS, poses))
    regularised = least_squares_with if model.estimator is least_squares else gco_with
    return own, choose_strength(folds, own, regularised)[0]
