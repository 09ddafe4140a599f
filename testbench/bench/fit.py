"""Which model to recommend for a user's runs: the simplest that predicts what was held out."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from testbench.bench.campaign import Cell, Model
from testbench.data.dataset import Dataset
from testbench.errors import Array, check_array
from testbench.identify import Estimate, Method
from testbench.identify.crossval import Candidate, every_fold, held_out_errors, one_standard_error
from testbench.identify.metric import Belief
from testbench.identify.regression import f_m
from testbench.identify.regularised import fit_all


def recommend(
    cell: Cell, models: Sequence[Model], found: Sequence[Estimate], data: Dataset
) -> tuple[str, list[Candidate]]:
    """The simplest model that predicts poses and load levels held out within one standard error of the best.

    Args:
        cell: The arm.
        models: Structures and methods; outliers stay in, as every model has to face the same readings.
        found: What each found in the runs: its prior is believed as firmly in every part of them.
        data: The runs, of at least two poses.

    Returns:
        Its name, and the errors of all.

    Raises:
        BenchError: When there is only one pose.
    """
    pairs = zip(models, found, strict=True)
    candidates = [
        Candidate(m.name, m.structure.n, _errors(cell, m, e.belief, data), e.constraint == "psd")
        for m, e in pairs
    ]
    return one_standard_error(candidates), candidates


def _errors(cell: Cell, model: Model, belief: Belief | None, data: Dataset) -> Array:
    """F_M on what is held out, (folds,); an estimator of one's own sees the other runs as they are."""
    folds = every_fold(cell.vjm, model.structure, data)
    if isinstance(model.estimator, Method):
        return held_out_errors(folds, partial(fit_all, constraint=model.estimator.constraint, belief=belief))
    each = [model.estimator(cell.vjm, model.structure, fold.runs).pi for fold in folds]
    pi = check_array(np.array(each), (len(folds), model.structure.n), f"parameters found by {model.name}")
    return np.array([f_m(fold.held_out, p) for fold, p in zip(folds, pi, strict=True)])
