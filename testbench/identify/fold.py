"""Readings boiled down: rows of equations folded by QR into triangular factors, part by part; parts add up.

A part is what is left out, or kept, together: runs whose pose is of one fold and whose load is of one fold, a
block of joint space. Memory does not grow with the rows. Two threads share the blocks of a large file, always
in the same way: sums do not depend on chance.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol, TypeVar

import numpy as np
from scipy.linalg.lapack import dtpqrt

from testbench.data.dataset import Dataset, Ids
from testbench.errors import Array
from testbench.identify.regression import Regression, regression_of, term_of, triangle
from testbench.identify.weighed import check_runs, weigh
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, parameter_rows

BLOCK_RUNS = 384  #: Runs reduced at a time: long enough for LAPACK, short enough for the cache.
SORTED = 32 * BLOCK_RUNS  #: Runs whose parts are brought together before.
PANEL = 16  #: Columns that LAPACK eliminates at a time: few, as the blocks are short.
TOGETHER = 8  #: Parts that are added up at a time.
THREADS = 2
Found = TypeVar("Found")


class Folded:
    """Triangular factors of rows [A | y], of every kind of equations and part."""

    def __init__(self, columns: int) -> None:
        """No rows of so many columns."""
        self.columns = columns
        #: (columns, columns) each, or all rows where they are fewer.
        self.factors: dict[tuple[int, int], Array] = {}
        #: Of each the scalar equations, and the squared norm of what no unknown can make.
        self.sums: defaultdict[tuple[int, int], Array] = defaultdict(lambda: np.zeros(2))

    def add(self, kind: int, part: int, lines: Array) -> None:
        """More rows of a part, (columns, rows), whose memory is used up."""
        n, at = self.columns, (kind, part)
        T = self.factors.get(at)
        if T is None or len(T) < n:
            lines = lines if T is None else np.concatenate([T.T, lines], axis=1)
            if lines.shape[1] < n:
                self.factors[at] = lines.T
                return
            T = np.zeros((n, n), order="F")
        panel = min(PANEL, n)
        self.factors[at] = dtpqrt(0, panel, T, lines.T, overwrite_a=True, overwrite_b=True)[0]

    def merge(self, kind: int, part: int, T: Array) -> None:
        """The rows of a part elsewhere, by their factor."""
        n, at = self.columns, (kind, part)
        own = self.factors.get(at, T[:0])
        if len(T) < n:
            self.add(kind, part, T.T.copy())
        elif len(own) < n:
            self.factors[at] = T.copy(order="F")
            if len(own):
                self.add(kind, part, own.T.copy())
        else:
            more = T.copy(order="F")
            self.factors[at] = dtpqrt(n, min(PANEL, n), own, more, overwrite_a=True, overwrite_b=True)[0]

    def join(self, other: "Folded") -> None:
        """The rows of another share."""
        for at, T in other.factors.items():
            self.merge(*at, T)
        for at, sums in other.sums.items():
            self.sums[at] += sums

    def factor(self, kind: int, parts: Sequence[int], columns: Ids | slice = slice(None)) -> Array:
        """Triangular factor of all rows of some parts, some columns of it, (columns, columns)."""
        whole, few = Folded(len(np.arange(self.columns)[columns])), []
        for T in (self.factors[kind, k] for k in parts if (kind, k) in self.factors):
            if len(T) == self.columns and isinstance(columns, slice):
                whole.merge(0, 0, T)
            else:
                few.append(T[:, columns])
        for first in range(0, len(few), TOGETHER):
            whole.add(0, 0, np.vstack(few[first : first + TOGETHER]).T.copy())
        T = whole.factors.get((0, 0), np.zeros((0, whole.columns)))
        return T if len(T) == whole.columns else triangle(T)


@dataclass(frozen=True)
class Parts:
    """A structure on a dataset in parts."""

    structure: Structure  #: The unknowns, n of them.
    folded: Folded  #: Of these or more, readings last, in standard deviations sqrt(2) sigma.
    columns: Ids | slice  #: Those of the unknowns and of the readings.

    @property
    def every(self) -> Ids:
        """The parts that there are."""
        return np.unique([part for _, part in self.folded.factors])

    def together(self, parts: Ids | None = None) -> Regression:
        """The regression of some parts, one at least, or all: rows over sqrt(N), as in F_M, Eq. (19)."""
        terms, some = [], (self.every if parts is None else parts).tolist()
        for kind in sorted({kind for kind, _ in self.folded.factors}):
            equations, rest = np.sum([self.folded.sums[kind, k] for k in some], axis=0)
            T = self.folded.factor(kind, some, self.columns) / math.sqrt(equations / 3)
            terms.append(term_of(T, float(rest / (equations / 3)), int(equations)))
        return regression_of(self.structure, tuple(terms))


class Blocks(Protocol):
    """Runs block by block."""

    def __len__(self) -> int:
        """How many blocks there are."""

    def block(self, k: int) -> tuple[Ids, Dataset]:
        """A block: indices of its runs among all, and these; for any thread."""


def in_threads(blocks: Blocks, work: Callable[[Sequence[int]], Found]) -> list[Found]:
    """What is found in shares of the blocks, each by a thread of its own."""
    shares = [range(k, len(blocks), THREADS) for k in range(THREADS)]
    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(work, shares))


def reduce(vjm: Vjm, structure: Structure, data: Dataset) -> Regression:
    """Boil a dataset down to the triangular factors of its weighted rows; memory does not grow with the runs.

    Raises:
        BenchError: When the dataset is empty or names a marker that the arm lacks.
    """
    [parts] = reduce_parts(vjm, [structure], data, np.broadcast_to(0, data.runs))
    return parts.together()


def reduce_parts(vjm: Vjm, structures: Sequence[Structure], runs: Dataset | Blocks, part: Ids) -> list[Parts]:
    """The rows of several models on runs that are held, or come block by block, in parts.

    Args:
        vjm: The model.
        structures: The unknowns of every model.
        runs: The runs.
        part: Part of every run, counted from 0; -1 for those that are left out, as those without a
            reading, (runs,).

    Raises:
        BenchError: When there is no run, a number is too large, or a marker is none of the arm's.
    """
    widest = max(structures, key=lambda s: s.n)
    places = [_columns(s, widest) for s in structures]
    own = [widest, *(s for s, place in zip(structures, places, strict=True) if place is None)]

    def of(some: Iterable[tuple[Ids | slice, Dataset]]) -> list[Folded]:
        found = [Folded(s.n + 1) for s in own]
        for at, data in some:
            if isinstance(runs, Dataset) or part[at].max() >= 0:
                check_runs(vjm, data)
                _add(vjm, list(zip(own, found, strict=True)), data, part[at])
        return found

    if isinstance(runs, Dataset):
        first = of([(slice(None), runs)])
    else:
        blocks = runs
        first, *more = in_threads(blocks, lambda share: of(blocks.block(k) for k in share))
        for other in more:
            for ours, theirs in zip(first, other, strict=True):
                ours.join(theirs)
    alone = iter(first[1:])
    return [
        Parts(s, next(alone), slice(None)) if place is None else Parts(s, first[0], place)
        for s, place in zip(structures, places, strict=True)
    ]


def _add(vjm: Vjm, found: Sequence[tuple[Structure, Folded]], data: Dataset, part: Ids) -> None:
    """More runs, and the part of each, (runs,)."""
    for many in range(0, data.runs, SORTED):
        order = many + np.argsort(part[many : many + SORTED], kind="stable")
        order = order[part[order] >= 0]
        for first in range(0, len(order), BLOCK_RUNS):
            runs = order[first : first + BLOCK_RUNS]
            parts, begin = np.unique(part[runs], return_index=True)
            spans = list(zip(parts.tolist(), pairwise([*begin.tolist(), len(runs)]), strict=True))
            for kind in range(1 if data.rotation_before is None else 2):
                _add_kind(vjm, found, (data, runs, spans), kind)


def _add_kind(
    vjm: Vjm,
    found: Sequence[tuple[Structure, Folded]],
    some: tuple[Dataset, Ids, list[tuple[int, tuple[int, int]]]],
    kind: int,
) -> None:
    """Positions or rotations of some runs, those of a part from one place to another."""
    data, runs, spans = some
    read = weigh(vjm, data, runs, rotation=bool(kind))
    for structure, folded in found:
        for k, (a, b) in spans:
            folded.sums[kind, k] += read.equations[a:b].sum(), read.rest[a:b].sum()
        for A, z in zip(parameter_rows(structure, read.J, read.u), read.z, strict=True):
            for k, (a, b) in spans:
                folded.add(kind, k, np.concatenate([A[:, a:b], z[None, a:b]]))


def _columns(structure: Structure, widest: Structure) -> Ids | slice | None:
    """Where a structure's parameters and the readings are among those of another; None where one is not."""
    if structure is widest:
        return slice(None)
    place = {pair: k for k, pair in enumerate(zip(widest.a.tolist(), widest.b.tolist(), strict=True))}
    pairs = list(zip(structure.a.tolist(), structure.b.tolist(), strict=True))
    alike = (structure.symmetric, structure.n_theta) == (widest.symmetric, widest.n_theta)
    if not alike or not place.keys() >= set(pairs):
        return None
    return np.array([*(place[pair] for pair in pairs), widest.n])
