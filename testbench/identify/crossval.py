"""Cross-validation over poses and load levels, to select a model or a weight.

Runs of one pose share its geometry, so that whole poses are held out: the error that counts is at poses that
were never fitted. If the data have several loads, all runs of one load are held out too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, Ids
from testbench.identify.fold import PartitionedRegression
from testbench.identify.regression import Regression

FOLDS = 8
"""Largest number of parts into which the poses, and the loads, are divided; fewer poses make fewer folds."""
CLEARLY = 2.0
"""Standard errors of the paired difference by which a model must be better to replace the first one."""
LEVEL_DIGITS = 1
"""Decimals to which forces [N] and moments [N m] are rounded to tell load levels apart."""


@dataclass(frozen=True)
class Fold:
    """Hold one split of the data: equations that are fitted, and equations that are held out."""

    kept: Ids  #: Numbers of the parts that are fitted.
    parts: PartitionedRegression  #: The equations of these parts.
    held_out: Regression  #: The equations of all other parts.

    @cached_property
    def fitted(self) -> Regression:
        """Return the equations that are fitted, reduced to one regression."""
        return self.parts.joined()


@dataclass(frozen=True)
class Candidate:
    """Hold the held-out errors of one model."""

    name: str  #: For reports.
    errors: Array  #: F_M on the runs held out, one per fold, (folds,) [1].

    @property
    def error(self) -> float:
        """Return the mean F_M over the folds [1]."""
        return paired(self.errors)[0]

    @property
    def standard_error(self) -> float:
        """Return the standard error of that mean over folds [1]."""
        return paired(self.errors)[1]


def divide_poses(data: Dataset) -> Ids:
    """Divide runs into parts for cross-validation: (fold of the pose) * FOLDS + (fold of the load).

    Two loads are of one level if their forces and their moments are equal in length, to `LEVEL_DIGITS`.

    Args:
        data: The runs.

    Returns:
        Part of every run, (runs,); -1 for a run without a reading.
    """
    level = np.linalg.norm(data.wrench.reshape(-1, 2, 3), axis=2)
    force, moment = (np.unique(own, return_inverse=True)[1] for own in level.round(LEVEL_DIGITS).T)
    load = np.unique(force * len(level) + moment, return_inverse=True)[1] % FOLDS
    part = np.unique(data.pose, return_inverse=True)[1] % FOLDS * FOLDS + load
    return np.where(data.seen.any(axis=1), part, -1)


def folds(parts: PartitionedRegression) -> list[Fold]:
    """Make the folds of cross-validation: each group of poses held out, then each load level.

    Args:
        parts: The reduced equations, in the parts of `divide_poses`.

    Returns:
        The folds.

    Raises:
        BenchError: When all runs are of one pose.
    """
    some = parts.all_parts
    pose, load = some // FOLDS, some % FOLDS
    if len(np.unique(pose)) < 2:
        raise BenchError("cross-validation: expected at least 2 poses, got 1")
    held = [own == k for own in (pose, load) for k in np.unique(own)]
    pairs = [(some[~own], some[own]) for own in held if not own.all()]
    return [Fold(kept, parts.some_parts(kept), parts.joined(out)) for kept, out in pairs]


@dataclass(frozen=True)
class Grams:
    """Hold Gram matrices [A | y]^T [A | y] of whitened rows, for k parameters."""

    total: Array  #: Of all equations, (k + 1, k + 1) [1].
    out: Array  #: Of the equations held out in each fold, (folds, k + 1, k + 1) [1].
    equations: Array  #: Number of equations held out in each fold, (folds,).
    all_parts: int  #: Number of all equations.
    terms: int  #: Number of terms of F_M: positions, and rotations if they are read.


def grams(parts: PartitionedRegression | Regression, lift: Array) -> Grams:
    """Compute Gram matrices of all equations and of each group of poses, after a change of parameters.

    Args:
        parts: The reduced equations in parts of `divide_poses`, n parameters; a regression has nothing to
            hold out.
        lift: [pi, 1] by the new parameters and 1, (n + 1, k + 1).

    Returns:
        The Gram matrices; without folds for a regression or a single pose.
    """
    if isinstance(parts, Regression):
        A, y = parts.rows
        rows = np.c_[A, y] @ lift
        total = rows.T @ rows
        total[-1, -1] += sum(term.equations / 3 * term.unexplained for term in parts.terms)
        return Grams(total, np.zeros((0, *total.shape)), np.zeros(0), parts.equations, len(parts.terms))
    folded = parts.factors
    poses, kinds = np.unique(parts.all_parts // FOLDS), {kind for kind, _ in folded.factors}
    found, counts = np.zeros((len(poses), *(lift.shape[1],) * 2)), np.zeros(len(poses))
    for at, T in folded.factors.items():
        k, rows = np.searchsorted(poses, at[1] // FOLDS), T[:, parts.columns] @ lift
        found[k] += rows.T @ rows
        counts[k] += folded.equations[at]
    several = slice(None if len(poses) > 1 else 0)
    return Grams(found.sum(axis=0), found[several], counts[several], int(counts.sum()), len(kinds))


def paired(difference: Array) -> tuple[float, float]:
    """Compute a mean and its standard error over folds, as a paired comparison needs it.

    Args:
        difference: Errors of one model, or differences between two models' errors, one per fold, (folds,)
            [1].

    Returns:
        Mean and standard error [1]; the error is infinite for a single fold.
    """
    n = len(difference)
    error = float(difference.std(ddof=1) / np.sqrt(n)) if n > 1 else np.inf
    return float(difference.mean()) if n else 0.0, error


@dataclass(frozen=True)
class Duel:
    """Hold the result of comparing one model with all others."""

    name: str  #: Name of the model that is selected.
    difference: float  #: Mean held-out error of the selected model minus that of the first one [1].
    standard_error: float  #: Standard error of this difference over folds [1].


def unless_beaten(candidates: Sequence[Candidate], first: str) -> Duel:
    """Select the first model unless another beats its held-out error by `CLEARLY` standard errors.

    Args:
        candidates: All models with their errors, the first one among them.
        first: Name of the model that is preferred.

    Returns:
        The first model, or the best of those that beat it.
    """
    [candidate] = [c for c in candidates if c.name == first]
    duels = [Duel(c.name, *paired(c.errors - candidate.errors)) for c in candidates if c is not candidate]
    better = [d for d in duels if d.difference < -CLEARLY * d.standard_error]
    return min(better, key=lambda d: d.difference, default=Duel(first, 0.0, 0.0))
