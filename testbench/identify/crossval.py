"""Cross-validation over poses and load levels: which model to use.

Runs of one pose share its geometry, so that a pose is held out whole: what counts is the error at poses that
were never fitted. So it is with the runs of one load, where the data have several.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, Ids
from testbench.identify.fold import Parts
from testbench.identify.regression import Regression

FOLDS = 8
CLEARLY = 2.0  #: Standard errors by which a model must be better to replace another.
LEVEL_DIGITS = 1  #: Decimals of a force [N] or moment [N m] within which two loads are of one level.


@dataclass(frozen=True)
class Fold:
    """What is fitted, and what is held out."""

    kept: Ids  #: Parts that are fitted.
    parts: Parts  #: These.
    held_out: Regression  #: The others, reduced.

    @cached_property
    def fitted(self) -> Regression:
        """What is fitted, reduced."""
        return self.parts.together()


@dataclass(frozen=True)
class Candidate:
    """One of the models that cross-validation compares."""

    name: str  #: For reports.
    errors: Array  #: F_M on the poses held out, one a fold, (folds,) [1].

    @property
    def error(self) -> float:
        """Mean F_M over the poses held out [1]."""
        return paired(self.errors)[0]

    @property
    def standard_error(self) -> float:
        """Standard error of that mean [1]."""
        return paired(self.errors)[1]


def divided(data: Dataset) -> Ids:
    """Deal out runs: fold of the pose times `FOLDS` plus fold of the load, (runs,); -1 without a reading.

    Loads are of one level whose forces and moments are alike in length.
    """
    level = np.linalg.norm(data.wrench.reshape(-1, 2, 3), axis=2)
    force, moment = (np.unique(own, return_inverse=True)[1] for own in level.round(LEVEL_DIGITS).T)
    load = np.unique(force * len(level) + moment, return_inverse=True)[1] % FOLDS
    part = np.unique(data.pose, return_inverse=True)[1] % FOLDS * FOLDS + load
    return np.where(data.seen.any(axis=1), part, -1)


def folds(parts: Parts) -> list[Fold]:
    """Poses held out, two at least (BenchError), then load levels where there are several; of `divided`."""
    some = parts.every
    pose, load = some // FOLDS, some % FOLDS
    if len(np.unique(pose)) < 2:
        raise BenchError("cross-validation: expected at least 2 poses, got 1")
    held = [own == k for own in (pose, load) for k in np.unique(own)]
    pairs = [(some[~own], some[own]) for own in held if not own.all()]
    return [Fold(kept, parts.some(kept), parts.together(out)) for kept, out in pairs]


@dataclass(frozen=True)
class Grams:
    """Gram matrices of whitened rows [A | y]."""

    total: Array  #: Of all, (n + 1, n + 1).
    out: Array  #: Of what is held out in turn, (folds, n + 1, n + 1).
    equations: Array  #: Of these, (folds,).
    every: int  #: Equations of all.
    terms: int  #: Of F_M.


def grams(parts: Parts | Regression, lift: Array) -> Grams:
    """Gram matrices by the parameters of C', `lift` of [pi, 1] by these."""
    if isinstance(parts, Regression):
        A, y = parts.rows
        rows = np.c_[A, y] @ lift
        total = rows.T @ rows
        total[-1, -1] += sum(term.equations / 3 * term.rest for term in parts.terms)
        return Grams(total, np.zeros((0, *total.shape)), np.zeros(0), parts.equations, len(parts.terms))
    folded = parts.folded
    poses, kinds = np.unique(parts.every // FOLDS), {kind for kind, _ in folded.factors}
    found, counts = np.zeros((len(poses), *(lift.shape[1],) * 2)), np.zeros(len(poses))
    for at, T in folded.factors.items():
        k, rows = np.searchsorted(poses, at[1] // FOLDS), T[:, parts.columns] @ lift
        found[k] += rows.T @ rows
        counts[k] += folded.equations[at]
    several = slice(None if len(poses) > 1 else 0)
    return Grams(found.sum(axis=0), found[several], counts[several], int(counts.sum()), len(kinds))


def paired(difference: Array) -> tuple[float, float]:
    """Mean and its standard error, infinite of one: fold by fold, as some are hard for all models.

    Args:
        difference: Of two models' errors, or the errors of one, of every fold, (folds,).
    """
    n = len(difference)
    error = float(difference.std(ddof=1) / np.sqrt(n)) if n > 1 else np.inf
    return float(difference.mean()) if n else 0.0, error


@dataclass(frozen=True)
class Duel:
    """A model that was asked for first, or what beat it."""

    name: str  #: Of the model that is taken.
    difference: float  #: Mean error of what is taken minus that of the first [1].
    standard_error: float  #: Of this difference, fold by fold [1].


def unless_beaten(candidates: Sequence[Candidate], first: str) -> Duel:
    """The first model, unless others predict what is held out better by more than CLEARLY standard errors.

    Then it is the best of them.
    """
    [own] = [c for c in candidates if c.name == first]
    duels = [Duel(c.name, *paired(c.errors - own.errors)) for c in candidates if c is not own]
    better = [d for d in duels if d.difference < -CLEARLY * d.standard_error]
    return min(better, key=lambda d: d.difference, default=Duel(first, 0.0, 0.0))
