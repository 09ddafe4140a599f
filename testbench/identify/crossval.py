"""Cross-validation over poses and load levels: which model to use.

Runs of one pose share its geometry, so that a pose is held out whole: what counts is the error at poses that
were never fitted. So it is with the runs of one load, where the data have several.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset, Ids, Mask, select
from testbench.errors import Array, BenchError
from testbench.identify.parts import Parts, reduce_parts
from testbench.identify.regression import Regression, f_m
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

FOLDS = 8
CLEARLY = 2.0  #: Standard errors by which a model must be better to replace another.
LEVEL_DIGITS = 1  #: Decimals of a force [N] or moment [N m] within which two loads are of one level.

Fits = Callable[[Sequence[Regression]], Array]
"""Parameters of many datasets of one structure, (datasets, n)."""


@dataclass(frozen=True)
class Fold:
    """The runs outside and inside the poses that are held out."""

    data: Dataset  #: All runs.
    kept: Mask  #: Those of the other poses, (runs,).
    fitted: Regression  #: These, reduced.
    held_out: Regression  #: Those of the poses held out, reduced.

    @property
    def runs(self) -> Dataset:
        """The runs of the other poses."""
        return select(self.data, self.kept)


@dataclass(frozen=True)
class Divided:
    """What is fitted, and what is held out, reduced."""

    fitted: Regression
    held_out: Regression


@dataclass(frozen=True)
class Candidate:
    """One of the models that cross-validation compares."""

    name: str  #: For reports.
    errors: Array  #: F_M on the poses held out, one a fold, (folds,) [1].

    @property
    def error(self) -> float:
        """Mean F_M over the poses held out [1]."""
        return float(self.errors.mean())

    @property
    def standard_error(self) -> float:
        """Standard error of that mean [1]."""
        return float(self.errors.std(ddof=1) / np.sqrt(len(self.errors)))


def fold_poses(vjm: Vjm, structure: Structure, data: Dataset) -> list[Fold]:
    """Deal the poses, two at least (BenchError), out in turn to at most `FOLDS` folds, each reduced."""
    return _folds(vjm, structure, data, pose_parts(data.pose))


def pose_parts(pose: Ids) -> Ids:
    """Fold of every run by its pose, (runs,); BenchError for a single pose."""
    poses, place = np.unique(pose, return_inverse=True)
    if len(poses) < 2:
        raise BenchError("cross-validation: expected at least 2 poses, got 1")
    return np.asarray(place % FOLDS)


def load_parts(level: Array) -> Ids:
    """Fold of every run by its load, (runs,), of lengths of force and moment, (runs, 2) [N, N m].

    Levels are dealt out in turn where there are more than `FOLDS`; all are in one fold where there is one.
    """
    force, moment = (np.unique(part, return_inverse=True)[1] for part in level.round(LEVEL_DIGITS).T)
    return np.asarray(np.unique(force * len(level) + moment, return_inverse=True)[1] % FOLDS)


def fold_loads(vjm: Vjm, structure: Structure, data: Dataset) -> list[Fold]:
    """At most `FOLDS` folds over the load levels, each held out whole; none where the data have only one.

    Loads whose force and moment have the same length are one level.
    """
    size = np.stack([np.linalg.norm(part, axis=1) for part in np.split(data.wrench, 2, axis=1)], axis=1)
    level = load_parts(size)
    return _folds(vjm, structure, data, level) if level.any() else []


def every_fold(vjm: Vjm, structure: Structure, data: Dataset) -> list[Fold]:
    """Folds over poses (two at least, or BenchError) and over load levels, of the runs with a reading."""
    read = np.asarray(data.seen.any(axis=1))
    data = data if read.all() else select(data, read)
    return fold_poses(vjm, structure, data) + fold_loads(vjm, structure, data)


def _folds(vjm: Vjm, structure: Structure, data: Dataset, part: Ids) -> list[Fold]:
    """Each part, (runs,), held out in turn."""
    parts, every = reduce_parts(vjm, structure, data, part), range(part.max() + 1)
    others = [[i for i in every if i != k] for k in every]
    return [Fold(data, part != k, parts.together(others[k]), parts.together([k])) for k in every]


def divided(parts: Parts, cells: Ids) -> list[Divided]:
    """The folds of `every_fold` of parts that are cells, numbered pose fold times `FOLDS` plus load fold.

    Args:
        parts: One a cell.
        cells: Those with runs.
    """
    folds = []
    for part in (cells // FOLDS, cells % FOLDS):
        every = np.unique(part)
        if len(every) > 1:
            folds += [(cells[part != k].tolist(), cells[part == k].tolist()) for k in every]
    return [Divided(parts.together(kept), parts.together(held)) for kept, held in folds]


def held_out_errors(folds: Sequence[Fold | Divided], fits: Fits) -> Array:
    """F_M on the poses held out, fitted to the others, (folds,) [1]."""
    found = fits([fold.fitted for fold in folds])
    return np.array([f_m(fold.held_out, pi) for fold, pi in zip(folds, found, strict=True)])


@dataclass(frozen=True)
class Duel:
    """A model that was asked for first, or what beat it."""

    name: str  #: Of the model that is taken.
    difference: float  #: Mean error of what is taken minus that of the first [1].
    standard_error: float  #: Of this difference, fold by fold [1].


def unless_beaten(candidates: Sequence[Candidate], first: str) -> Duel:
    """The first model, unless others predict what is held out better by more than CLEARLY standard errors.

    Then it is the best of them. Errors are compared fold by fold, as a hard pose is hard for all.
    """
    [own] = [c for c in candidates if c.name == first]
    duels = [_duel(c, own) for c in candidates if c is not own]
    better = [d for d in duels if d.difference < -CLEARLY * d.standard_error]
    return min(better, key=lambda d: d.difference, default=Duel(first, 0.0, 0.0))


def _duel(one: Candidate, first: Candidate) -> Duel:
    difference = one.errors - first.errors
    error = float(difference.std(ddof=1) / np.sqrt(len(difference)))
    return Duel(one.name, float(difference.mean()), error)
