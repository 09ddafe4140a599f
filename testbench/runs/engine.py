"""The engine: it does the trials that a store lacks, in chunks, on the cores of this machine or elsewhere."""

import os
import signal
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass, is_dataclass
from multiprocessing import resource_tracker
from threading import Thread
from typing import Any

import scipy.linalg  # noqa: F401 - its BLAS has to be loaded before it can be limited
from joblib import Parallel, cpu_count, delayed, parallel_config
from threadpoolctl import threadpool_limits

from testbench.errors import BenchError
from testbench.runs.interrupt import STOPS
from testbench.runs.rows import Table, tabled
from testbench.runs.store import TrialStore

RETRIES = 3  #: Times in a row that workers may be lost without a single new result.
Found = Sequence[object]
Work = Callable[[Sequence[int]], Sequence[Found]]
"""Does the trials of some seeds: one sequence of rows a seed, in their order.

It is a function of a module, or a partial of one, and what it is given are names, numbers and settings: arms
and arrays it builds itself, once a chunk. An array that was sent to a worker may lie otherwise in memory,
which changes the last digits that BLAS gives, and results would depend on where they were computed.
Randomness comes from `trial_rng` and the seed. Clocks in the rows are `solve_seconds` and `cpu_seconds`, of a
fit.
"""


@dataclass(frozen=True)
class Chunk:
    """Hold trials that a worker has done."""

    seeds: Sequence[int]  #: Of the trials.
    found: Sequence[Table]  #: Their rows by column.
    problem: str = ""  #: Why there are none; empty if all is well.


class WorkersLost(BenchError):
    """Report that workers died, or the cluster went away, with trials under way."""


Chunks = Generator[Chunk, None, None]
Backend = Callable[[Work, Sequence[Sequence[int]]], Chunks]
"""Runs the work on chunks of seeds and gives them back as they are done, in any order.

It raises WorkersLost where trials may be done again; closed, it stops.
"""


def do_chunk(work: Work, seeds: Sequence[int]) -> Chunk:
    """Do trials with one BLAS thread; a problem comes back as words, since not every exception can travel.

    Args:
        work: Does the trials of some seeds.
        seeds: Seeds of the trials.

    Returns:
        The rows of the seeds, or the problem in words.
    """
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


def here(work: Work, chunks: Sequence[Sequence[int]]) -> Chunks:
    """Do the trials in this process.

    Args:
        work: Does the trials of some seeds.
        chunks: Seeds of every chunk.

    Returns:
        Chunks as they are done.
    """
    return (do_chunk(work, seeds) for seeds in chunks)


def run_study(
    work: Work, store: TrialStore[Any], backend: Backend, *, size: int = 1, remote: bool = False
) -> Iterator[int]:
    """Do all trials that are not stored yet.

    Results depend on the seeds alone: not on the backend, its workers, the order in which they finish, or on
    where a run was stopped and resumed. (Processors of another kind give other last digits.) See `Work`
    for what keeps them bit-equal. A chunk has `size` seeds, 0.1 to 1 s of work: a stop loses the chunks under
    way. A study that is one chunk is done by this process, but where the backend is `remote`, which somebody
    asked for; what is left of a larger one is not, as it may be what workers die of.

    Args:
        work: Does the trials of some seeds.
        store: Where rows are stored.
        backend: Does the chunks.
        size: Seeds of a chunk.
        remote: Whether the backend is on other machines.

    Yields:
        Number of finished trials, first of those from before.

    Raises:
        BenchError: When a trial cannot be done, the store cannot be written, or workers die again and again.
    """
    if size < 1:
        raise BenchError(f"size: expected chunks of at least 1 seed, got {size}")
    done, lost, every = store.count, 0, len(store.experiment.seeds)
    backend = here if every <= size and not remote else backend
    yield done
    while done < every:
        before = done
        try:
            for done in _attempt(work, store, backend, size):
                yield done
        except WorkersLost as err:
            lost = 1 if done > before else lost + 1
            if lost > RETRIES:
                raise _resumable(f"{err} ({lost} times in a row)", store) from err
        except BenchError as err:
            raise _resumable(str(err), store) from err


def _attempt(work: Work, store: TrialStore[Any], backend: Backend, size: int) -> Iterator[int]:
    missing = store.missing()
    todo = [missing[k : k + size] for k in range(0, len(missing), size)]
    with closing(backend(work, todo)) as chunks:
        for chunk in chunks:
            if chunk.problem:
                raise BenchError(chunk.problem)
            store.append(chunk.seeds, chunk.found)
            yield store.count


def _resumable(problem: str, store: TrialStore[Any]) -> BenchError:
    if not store.count:
        return BenchError(problem)
    held = f"{store.count} of {len(store.experiment.seeds)} trials are stored"
    return BenchError(f"{problem}; {held}; --resume continues")


MOST_A_CORE = 8  #: Most processes of a core: each takes the memory of a program.
LOOK = 0.2  #: Time between two looks of a worker for the process that started it [s].


def on_cores(work: Work, chunks: Sequence[Sequence[int]], *, workers: int | None = None) -> Chunks:
    """Run trials on this machine, in at most so many processes; one a core if None.

    No more than there are chunks; if it may be one only, that is this process.

    Args:
        work: Does the trials of some seeds.
        chunks: Seeds of every chunk.
        workers: Number of processes; None for one per core.

    Returns:
        Chunks as they are done.

    Raises:
        BenchError: When workers is below 1, or more than help.
        WorkersLost: When a process was killed.
    """
    cores = cpu_count()
    highest = MOST_A_CORE * cores
    if workers is not None and not 1 <= workers <= highest:
        raise BenchError(f"workers: expected 1 to {highest} ({MOST_A_CORE} per core), got {workers}")
    count = min(workers or cores, len(chunks))
    if count <= 1:
        yield from here(work, chunks)
        return
    # A stop cancels tasks, which the user has asked for: no warning.
    warnings.filterwarnings("ignore", r"\d+ tasks (have been|which were still)", UserWarning)
    # One BLAS thread, and arrays as they are: where they lie in memory changes the last digits of results.
    options = {"inner_max_num_threads": 1, "initializer": _begin, "initargs": (os.getpid(),)}
    try:
        with (
            parallel_config("loky", **options),
            Parallel(count, return_as="generator_unordered", batch_size=1, max_nbytes=None) as pool,
        ):
            # No stop reaches a worker before it has begun: it would say so with a traceback. On Python 3.11
            # the resource tracker, which the first worker would start, unblocks stops.
            resource_tracker.ensure_running()
            signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
            try:
                found = pool(delayed(do_chunk)(work, seeds) for seeds in chunks)
            finally:
                signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
            yield from found
    except BrokenProcessPool as err:
        raise WorkersLost("a worker was killed, or crashed, or ran out of memory") from err


def _begin(parent: int) -> None:
    """Have this worker leave stops to the process that started it, and end soon after that one."""
    for number in STOPS:
        signal.signal(number, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK)
        os._exit(1)

    Thread(target=watch, daemon=True).start()
