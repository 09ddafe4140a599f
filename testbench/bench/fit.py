"""One model fitted to a user's runs as asked: with or without a prior, with or without a robust loss."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from testbench.bench.campaign import Cell, Model
from testbench.data.dataset import Dataset
from testbench.errors import BenchError
from testbench.identify import Estimate, least_squares, reduce
from testbench.identify.conic import optimum
from testbench.identify.crossval import (
    Candidate,
    Fit,
    choose_strength,
    every_fold,
    held_out_errors,
    one_standard_error,
)
from testbench.identify.least_squares import minimum_norm
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


def recommend(cell: Cell, models: Sequence[Model], data: Dataset, wish: Wish) -> tuple[str, list[Candidate]]:
    """The simplest model that predicts poses and load levels held out within one standard error of the best.

    Args:
        cell: The arm.
        models: Structures and methods.
        data: The runs, of at least two poses.
        wish: How to fit; outliers stay in, as every model has to face the same readings.

    Returns:
        Its name, and the errors of all.

    Raises:
        BenchError: When there is only one pose, or the prior does not fit a structure.
    """
    errors = {}
    for model in models:
        folds = every_fold(cell.vjm, model.structure, data)
        errors[model.name] = model.structure.n, held_out_errors(folds, _fit_of(cell, model, data, wish))
    return one_standard_error(errors), [Candidate(name, error) for name, (_, error) in errors.items()]


def _fit_of(cell: Cell, model: Model, data: Dataset, wish: Wish) -> Fit:
    """A method on reduced datasets."""
    plain = model.estimator is least_squares
    if wish.prior is None:
        return minimum_norm if plain else optimum
    own, strength = _prior(cell, model, data, wish)
    return partial(least_squares_with if plain else gco_with, metric=own, strength=strength)


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
    folds = every_fold(cell.vjm, model.structure, data)
    regularised = least_squares_with if model.estimator is least_squares else gco_with
    return own, choose_strength(folds, own, regularised)[0]
