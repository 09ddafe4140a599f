"""Trials on the cores of this machine."""

import os
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from itertools import chain, islice
from multiprocessing import resource_tracker
from typing import Any

from joblib import cpu_count
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from testbench.errors import BenchError
from testbench.output.scratch import interrupts_wait
from testbench.trials.chunk import Chunk, Chunks, Work, WorkersLost, do_chunk

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS"), "1"
)
IDLE = 60  #: Time after which a process without work ends [s]; until then the next study finds it ready.
WATCH = 0.5  #: Time between looks of a process for its parent [s].


def on_cores(work: Work, chunks: Iterable[Sequence[int]], *, workers: int | None = None) -> Chunks:
    """The backend of one machine: so many processes with one BLAS thread each; one a core if None.

    No more than there are chunks; a single one is this process.

    Raises:
        BenchError: When workers is below 1.
        WorkersLost: When a process was killed.
    """
    if workers is not None and workers < 1:
        raise BenchError(f"workers: expected at least 1, got {workers}")
    rest = iter(chunks)
    first = list(islice(rest, workers or cpu_count()))
    if len(first) > 1:
        yield from _in_processes(work, chain(first, rest), len(first))
    else:
        yield from (do_chunk(work, seeds) for seeds in chain(first, rest))


def _in_processes(work: Work, chunks: Iterator[Sequence[int]], processes: int) -> Chunks:
    """Every process has one chunk under way and one ahead."""
    pool = get_reusable_executor(
        max_workers=processes, timeout=IDLE, env=ONE_THREAD, initializer=_end_with, initargs=(os.getpid(),)
    )
    calls = (pool.submit(do_chunk, work, seeds) for seeds in chunks)
    under_way: set[Future[Chunk]] = set()
    try:
        resource_tracker.ensure_running()  # as it starts it lets Ctrl-C through again
        with interrupts_wait():  # a terminal sends it to all processes: this one, which stops them, is enough
            under_way |= set(islice(calls, 2 * processes))
        while under_way:
            done, under_way = wait(under_way, return_when=FIRST_COMPLETED)
            for future in sorted(done, key=lambda future: future.exception() is not None):
                yield future.result()
            under_way |= set(islice(calls, len(done)))
    except BaseException as err:
        _stop(pool, under_way)
        if isinstance(err, TerminatedWorkerError):
            raise WorkersLost("a worker was killed, or crashed, or ran out of memory") from err
        raise


def _end_with(parent: int) -> None:
    """Make this process end soon after its parent, however that one ended."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _stop(pool: Any, under_way: set[Future[Chunk]]) -> None:
    """Kill the processes. loky trips over calls that it has not yet handed out to them."""
    while not all(future.running() or future.done() for future in under_way):
        time.sleep(0.001)
    pool.shutdown(wait=True, kill_workers=True)
