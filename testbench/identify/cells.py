"""Very many runs boiled down in one pass: cell by cell, for several structures at once.

A cell is what is left out, or kept, together: runs whose pose is of one fold and whose load is of one fold.
Memory does not grow with the runs. Two threads share the blocks, always in the same way: sums do not depend
on chance.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol, TypeVar

import numpy as np
from scipy.linalg.lapack import dgeqrf

from testbench.data.dataset import Dataset, Ids, in_order
from testbench.errors import Array
from testbench.identify.parts import Factor, Parts
from testbench.identify.regression import BLOCK_RUNS
from testbench.identify.weighed import check_runs, equations_of, weigh
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, parameter_rows

THREADS = 2
Found = TypeVar("Found")


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


def reduce_cells(vjm: Vjm, structures: Sequence[Structure], blocks: Blocks, cell: Ids) -> list[Parts]:
    """The factors of every structure, a part of each a cell.

    Args:
        vjm: The model.
        structures: The unknowns of several models.
        blocks: The runs, each with a reading where its cell is one.
        cell: Cell of every run, counted from 0; -1 for those that are left out, (runs,).

    Raises:
        BenchError: When a number is too large, or a marker is none of the arm's.
    """
    widest = max(structures, key=lambda s: s.n)
    inside = [s for s in structures if _columns(s, widest) is not None]
    own = [widest, *(s for s in structures if s not in inside)]

    def work(share: Sequence[int]) -> list["_Cells"]:
        found = [_Cells(vjm, s, int(cell.max()) + 1) for s in own]
        for k in share:
            runs, data = blocks.block(k)
            place = cell[runs]
            order = np.argsort(place, kind="stable")
            order = order[place[order] >= 0]
            if len(order):
                check_runs(vjm, data)
                _add(found, in_order(data, order), place[order])
        return found

    one, *more = in_threads(blocks, work)
    for other in more:
        for ours, theirs in zip(one, other, strict=True):
            ours.join(theirs)
    made = {id(cells.structure): cells.parts() for cells in one}
    return [made[id(s)] if id(s) in made else _narrowed(made[id(widest)], s) for s in structures]


class _Cells:
    """Triangular factors of [A | y], cell by cell, of positions and of rotations where they are read."""

    def __init__(self, vjm: Vjm, structure: Structure, cells: int) -> None:
        self.vjm, self.structure, self.cells = vjm, structure, cells
        self.T: list[dict[int, Array]] = []
        self.rest, self.equations = np.zeros((2, cells)), np.zeros((2, cells), dtype=int)

    def fold(self, kind: int, cell: int, rows: Sequence[Array]) -> None:
        """More rows of a cell: blocks of (columns, rows)."""
        while len(self.T) <= kind:
            self.T.append({})
        n = self.structure.n + 1
        before = self.T[kind].get(cell, np.empty((0, n)))
        stacked = np.concatenate([before.T, *rows], axis=1)
        R = dgeqrf(stacked.T, overwrite_a=True)[0]
        self.T[kind][cell] = np.triu(R[:n])

    def join(self, other: "_Cells") -> None:
        """The rows of another share of the blocks."""
        for kind, found in enumerate(other.T):
            for cell, T in found.items():
                self.fold(kind, cell, [T.T])
        self.rest += other.rest
        self.equations += other.equations

    def parts(self) -> Parts:
        """The factors, those of a cell without runs empty."""
        empty = np.empty((0, self.structure.n + 1))
        return Parts(
            self.structure,
            tuple(
                tuple(
                    Factor(T.get(k, empty), float(self.rest[kind, k]), int(self.equations[kind, k]))
                    for k in range(self.cells)
                )
                for kind, T in enumerate(self.T)
            ),
        )


def _add(found: Sequence[_Cells], data: Dataset, place: Ids) -> None:
    """More runs, in the order of their cells, (runs,)."""
    vjm = found[0].vjm
    for kind in range(1 if data.rotation_before is None else 2):
        equations = equations_of(data, rotation=bool(kind))
        for first in range(0, data.runs, BLOCK_RUNS):
            block = slice(first, first + BLOCK_RUNS)
            read, own = weigh(vjm, data, block, 3, rotation=bool(kind)), place[block]
            cells, begin = np.unique(own, return_index=True)
            ends = [*begin[1:], len(own)]
            rest = np.add.reduceat((read.unmade**2).sum(axis=0), begin)
            count = np.add.reduceat(equations[block], begin)
            for one in found:
                one.rest[kind, cells] += rest
                one.equations[kind, cells] += count
                rows = [
                    np.concatenate([A, z[None]])
                    for A, z in zip(parameter_rows(one.structure, read.J, read.u), read.z, strict=True)
                ]
                for k, a, b in zip(cells, begin, ends, strict=True):
                    one.fold(kind, int(k), [A[:, a:b] for A in rows])


def _columns(structure: Structure, widest: Structure) -> Ids | None:
    """Where the parameters of a structure are among those of another one; None where one is not."""
    place = {pair: k for k, pair in enumerate(zip(widest.a.tolist(), widest.b.tolist(), strict=True))}
    pairs = list(zip(structure.a.tolist(), structure.b.tolist(), strict=True))
    if not place.keys() >= set(pairs) or structure.symmetric != widest.symmetric:
        return None
    return np.array([place[pair] for pair in pairs])


def _narrowed(parts: Parts, structure: Structure) -> Parts:
    """The factors of a structure whose columns are among those that were reduced."""
    columns = _columns(structure, parts.structure)
    assert columns is not None
    at = [*columns.tolist(), parts.structure.n]

    def own(factor: Factor) -> Factor:
        return Factor(np.asarray(np.linalg.qr(factor.T[:, at], mode="r")), factor.rest, factor.equations)

    return Parts(structure, tuple(tuple(map(own, kind)) for kind in parts.kinds))
