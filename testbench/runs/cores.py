"""Trials on the cores of this machine: joblib's processes, one BLAS thread each."""

import os
import signal
import time
import warnings
from collections.abc import Sequence
from concurrent.futures.process import BrokenProcessPool
from threading import Thread

from joblib import Parallel, cpu_count, delayed, parallel_config

from testbench.errors import BenchError
from testbench.runs.engine import Chunks, Work, WorkersLost, do_chunk, here
from testbench.runs.session import STOPS

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
        raise BenchError(f"workers: expected 1 to {highest}, {MOST_A_CORE} a core, got {workers}")
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
            # No stop reaches a worker before it has begun: it would say so with a traceback.
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
