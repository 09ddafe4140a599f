"""A chunk of trials, as it goes to a worker and comes back; the same on every backend."""

from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass, is_dataclass

import scipy.linalg  # noqa: F401 - its BLAS has to be loaded before it can be limited
from threadpoolctl import threadpool_limits

from testbench.errors import BenchError
from testbench.trials.rows import Table, tabled

Found = Sequence[object]
Work = Callable[[Sequence[int]], Sequence[Found]]
"""Does the trials of some seeds: one sequence of rows a seed, in their order.

It is a function of a module, or a partial of one, and what it is given are names, numbers and settings: arms
and arrays it builds itself, once a chunk. An array that was sent to a worker may lie otherwise in memory,
which changes the last digits that BLAS gives, and results would depend on where they were computed.
Randomness comes from `bench.stream` and the seed. The one clock in the rows is `solve_seconds`, of a fit.
"""


@dataclass(frozen=True)
class Chunk:
    """Trials that a worker has done."""

    seeds: Sequence[int]  #: Of the trials.
    found: Sequence[Table]  #: Their rows by column.
    problem: str = ""  #: Why there are none; empty if all is well.


class WorkersLost(BenchError):
    """Workers died, or the cluster went away, with trials under way."""


Chunks = Generator[Chunk, None, None]
Backend = Callable[[Work, Iterable[Sequence[int]]], Chunks]
"""Runs the work on chunks of seeds and gives them back as they are done, in any order.

It raises WorkersLost where trials may be done again. Seeds are drawn as they are needed; closed, it stops.
"""


def do_chunk(work: Work, seeds: Sequence[int]) -> Chunk:
    """Do trials with one BLAS thread; a problem comes back as words, since not every exception can travel."""
    try:
        with threadpool_limits(1):
            results = work(seeds)
        return Chunk(seeds, _tables(seeds, results))
    except (BenchError, ImportError, OSError) as err:
        return Chunk(seeds, (), f"seeds {seeds[0]} to {seeds[-1]}: {err}")


def _tables(seeds: Sequence[int], results: Sequence[Found]) -> list[Table]:
    if len(results) != len(seeds):
        raise BenchError(f"expected rows for {len(seeds)} trials, got {len(results)}")
    wrong = {type(row).__name__ for rows in results for row in rows if not is_dataclass(row)}
    if wrong:
        raise BenchError(f"rows: expected dataclasses, got {', '.join(sorted(wrong))}")
    return [tabled(rows) for rows in results]
