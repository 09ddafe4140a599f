"""A dataset boiled down part by part, so that parts can be left out: what cross-validation does in turn."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset, Ids
from testbench.errors import Array
from testbench.identify.regression import BLOCK_RUNS, Regression, Term, regression_of
from testbench.identify.weighed import check_runs, equations_of, weigh
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, parameter_rows


@dataclass(frozen=True)
class Factor:
    """Positions or rotations of a part, in standard deviations sqrt(2) sigma."""

    T: Array  #: Triangular factor of [A | y], (r, n + 1), with r at most n + 1.
    rest: float  #: Squared norm of what no rigid tool can make.
    equations: int  #: Scalar equations behind it.


@dataclass(frozen=True)
class Parts:
    """A structure on a dataset in parts."""

    structure: Structure  #: The unknowns, n of them.
    kinds: tuple[tuple[Factor, ...], ...]  #: Positions of every part, then rotations where they are read.

    def together(self, some: Sequence[int]) -> Regression:
        """The regression of these parts, one at least."""
        terms = (_term(self.structure.n, [parts[k] for k in some]) for parts in self.kinds)
        return regression_of(self.structure, tuple(terms))


def reduce_parts(vjm: Vjm, structure: Structure, data: Dataset, part: Ids) -> Parts:
    """Boil a dataset down part by part, each run once.

    Args:
        vjm: The model.
        structure: The unknowns.
        data: The runs, each with a reading.
        part: Part of every run, counted from 0, (runs,).

    Raises:
        BenchError: When the dataset is empty or names a marker that the arm lacks.
    """
    check_runs(vjm, data)
    kinds = (False,) if data.rotation_before is None else (False, True)
    return Parts(structure, tuple(_factors(vjm, structure, data, part, rotation=k) for k in kinds))


def _factors(
    vjm: Vjm, structure: Structure, data: Dataset, part: Ids, *, rotation: bool
) -> tuple[Factor, ...]:
    columns, parts = structure.n + 1, int(part.max()) + 1
    T, rest = [np.empty((0, columns)) for _ in range(parts)], np.zeros(parts)
    for first in range(0, data.runs, BLOCK_RUNS):
        block = slice(first, first + BLOCK_RUNS)
        read, own = weigh(vjm, data, block, 3, rotation=rotation), part[block]
        A = np.stack([*parameter_rows(structure, read.J, read.u)])
        rows = np.concatenate([A, read.z[:, None]], axis=1)  # reading, column, run
        for k in np.unique(own):
            more = rows[:, :, own == k].swapaxes(1, 2).reshape(-1, columns)
            T[k] = np.linalg.qr(np.vstack([T[k], more]), mode="r")
        rest += np.bincount(own, weights=(read.unmade**2).sum(axis=0), minlength=parts)
    equations = np.bincount(part, weights=equations_of(data, rotation=rotation), minlength=parts)
    return tuple(Factor(T[k], float(rest[k]), int(equations[k])) for k in range(parts))


def _term(n: int, factors: Sequence[Factor]) -> Term:
    """Rows of some parts over sqrt(N), as in F_M, Eq. (19)."""
    equations = sum(factor.equations for factor in factors)
    points, rest = equations / 3, sum(factor.rest for factor in factors)
    rows = np.vstack([factor.T for factor in factors]) / math.sqrt(points)
    found = rows if len(factors) == 1 else np.linalg.qr(rows, mode="r")
    T = np.zeros((n + 1, n + 1))
    T[: len(found)] = found
    return Term(R=T[:n, :n], z=T[:n, n], rest=float(T[n, n] ** 2) + rest / points, equations=equations)
