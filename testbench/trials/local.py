"""Trials on the cores of this machine."""

import signal
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from itertools import islice
from typing import Any

from joblib import cpu_count
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from testbench.errors import BenchError
from testbench.trials.chunk import Chunk, Chunks, Work, WorkersLost, do_chunk

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS"), "1"
)
IDLE = 60  #: Time after which a process without work ends [s]; until then the next study finds it ready.


def on_cores(work: Work, chunks: Iterable[Sequence[int]], *, workers: int | None = None) -> Chunks:
    """The backend of one machine: so many processes with one BLAS thread each; one a core if None.

    A single one is this process.

    Raises:
        BenchError: When workers is below 1.
        WorkersLost: When a process was killed.
    """
    if workers is not None and workers < 1:
        raise BenchError(f"workers: expected at least 1, got {workers}")
    processes = workers or cpu_count()
    if processes == 1:
        yield from (do_chunk(work, seeds) for seeds in chunks)
    else:
        yield from _in_processes(work, iter(chunks), processes)


def _in_processes(work: Work, chunks: Iterator[Sequence[int]], processes: int) -> Chunks:
    """Every process has one chunk under way and one ahead."""
    pool = get_reusable_executor(
        max_workers=processes, timeout=IDLE, env=ONE_THREAD, initializer=_leave_interrupts
    )
    calls = (pool.submit(do_chunk, work, seeds) for seeds in chunks)
    under_way = set(islice(calls, 2 * processes))
    try:
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


def _leave_interrupts() -> None:
    """Ctrl-C reaches every process of a terminal: this one, which will stop the others, is enough."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _stop(pool: Any, under_way: set[Future[Chunk]]) -> None:
    """Kill the processes. loky trips over calls that it has not yet handed out to them."""
    while not all(future.running() or future.done() for future in under_way):
        time.sleep(0.001)
    pool.shutdown(wait=True, kill_workers=True)
