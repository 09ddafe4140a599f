"""Cross-validation over poses and load levels: how firmly to believe a prior, and which model to use.

Runs of one pose share its geometry, so that a pose is held out whole: what counts is the error at poses that
were never fitted. So it is with the runs of one load, where the data have several.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from testbench.data.dataset import Dataset, Mask, select
from testbench.errors import Array, BenchError
from testbench.identify.estimate import Estimate
from testbench.identify.metric import Metric
from testbench.identify.prior import Strength
from testbench.identify.regression import Regression, f_m, reduce
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

UNCERTAINTIES = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.3, 2.0)
"""Relative uncertainties of a prior that cross-validation tries [1]."""
FOLDS = 8
LEVEL_DIGITS = 1
"""Decimals of a force [N] or moment [N m] within which two loads are of one level."""

Fit = Callable[[Regression], Estimate]
Regularised = Callable[[Regression, Metric, Strength], Estimate]


@dataclass(frozen=True)
class Fold:
    """The runs outside and inside the poses that are held out.

    Attributes:
        runs: The runs of the other poses.
        fitted: The same, reduced.
        held_out: Those of the poses held out, reduced.
    """

    runs: Dataset
    fitted: Regression
    held_out: Regression


@dataclass(frozen=True)
class Candidate:
    """One of the choices that cross-validation compares.

    Attributes:
        name: For reports.
        errors: F_M on the poses held out, one a fold, (folds,) [1].
    """

    name: str
    errors: Array

    @property
    def error(self) -> float:
        """Mean F_M over the poses held out [1]."""
        return float(self.errors.mean())

    @property
    def standard_error(self) -> float:
        """Standard error of that mean [1]."""
        return float(self.errors.std(ddof=1) / np.sqrt(len(self.errors)))


def fold_poses(vjm: Vjm, structure: Structure, data: Dataset, folds: int = FOLDS) -> list[Fold]:
    """Split a dataset by pose into folds, each reduced.

    Args:
        vjm: The model.
        structure: The unknowns.
        data: The runs.
        folds: How many; poses are dealt out in turn.

    Raises:
        BenchError: When there are fewer poses than folds, or fewer than two folds.
    """
    poses = np.unique(data.pose)
    if not 2 <= folds <= len(poses):
        raise BenchError(
            f"cross-validation: expected 2 to {len(poses)} folds, as many as poses at most, got {folds}"
        )
    return [_fold(vjm, structure, data, np.isin(data.pose, poses[k::folds])) for k in range(folds)]


def fold_loads(vjm: Vjm, structure: Structure, data: Dataset) -> list[Fold]:
    """A fold for every load level, held out whole; none where the data have only one.

    Args:
        vjm: The model.
        structure: The unknowns.
        data: The runs; loads whose force and moment have the same length are one level.
    """
    size = np.stack([np.linalg.norm(part, axis=1) for part in np.split(data.wrench, 2, axis=1)], axis=1)
    levels, level = np.unique(size.round(LEVEL_DIGITS), axis=0, return_inverse=True)
    if len(levels) < 2:
        return []
    return [_fold(vjm, structure, data, level.ravel() == k) for k in range(len(levels))]


def read(data: Dataset) -> Dataset:
    """The runs in which a target was read at all."""
    return select(data, np.asarray(data.seen.any(axis=1)))


def every_fold(vjm: Vjm, structure: Structure, data: Dataset, folds: int = FOLDS) -> list[Fold]:
    """Folds over poses, as many as there are up to `folds`, and over load levels where there are several.

    Raises:
        BenchError: When there is only one pose.
    """
    data = read(data)
    poses = len(np.unique(data.pose))
    return fold_poses(vjm, structure, data, min(folds, poses)) + fold_loads(vjm, structure, data)


def _fold(vjm: Vjm, structure: Structure, data: Dataset, held_out: Mask) -> Fold:
    runs = select(data, ~held_out)
    return Fold(runs, reduce(vjm, structure, runs), reduce(vjm, structure, select(data, held_out)))


def held_out_errors(folds: Sequence[Fold], fit: Fit) -> Array:
    """F_M on the poses held out, fitted to the others, (folds,) [1]."""
    return np.array([f_m(fold.held_out, fit(fold.fitted).pi) for fold in folds])


def choose_strength(
    folds: Sequence[Fold], metric: Metric, fit: Regularised, uncertainties: Sequence[float] = UNCERTAINTIES
) -> tuple[Strength, list[Candidate]]:
    """The uncertainty of a prior that predicts poses held out best, its scale left to the data.

    Args:
        folds: The dataset, split.
        metric: The structure in the metric of the prior.
        fit: The method that will use it.
        uncertainties: What to try [1].
    """
    tried = []
    for u in uncertainties:
        errors = held_out_errors(folds, partial(_at, fit, metric, Strength(u)))
        tried.append(Candidate(f"uncertainty {100 * u:g} %", errors))
    best = int(np.argmin([candidate.error for candidate in tried]))
    return Strength(uncertainties[best]), tried


def _at(fit: Regularised, metric: Metric, strength: Strength, regression: Regression) -> Estimate:
    return fit(regression, metric, strength)


def one_standard_error(candidates: Mapping[str, tuple[int, Array]]) -> str:
    """The simplest model whose error is within one standard error of the best (Breiman et al. 1984).

    Args:
        candidates: By name the number of unknowns and the errors on the poses held out, (folds,).

    Returns:
        Its name.
    """
    rows = {name: (n, Candidate(name, errors)) for name, (n, errors) in candidates.items()}
    best = min((candidate for _, candidate in rows.values()), key=lambda candidate: candidate.error)
    good = [name for name, (_, c) in rows.items() if c.error <= best.error + best.standard_error]
    return min(good, key=lambda name: (rows[name][0], rows[name][1].error))
