"""Trials on the cores of this machine."""

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from itertools import chain, islice
from multiprocessing.connection import Connection, wait
from pathlib import Path

from testbench.errors import BenchError
from testbench.trials.chunk import Chunk, Chunks, Work, WorkersLost, do_chunk
from testbench.trials.worker import started

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS"), "1"
)
MOST_A_CORE = 8  #: Most processes of a core: each takes the memory of a program.
SHARE = Path(
    "/sys/fs/cgroup/cpu.max"
)  #: Processor time that a container may use, and the time that it is of.


def on_cores(work: Work, chunks: Iterable[Sequence[int]], *, workers: int | None = None) -> Chunks:
    """The backend of one machine: so many processes with one BLAS thread each; one a core if None.

    No more than there are chunks; if it may be one only, that is this process.

    Raises:
        BenchError: When workers is below 1, or more than help.
        WorkersLost: When a process was killed.
    """
    highest = MOST_A_CORE * cores()
    if workers is not None and not 1 <= workers <= highest:
        raise BenchError(f"workers: expected 1 to {highest}, {MOST_A_CORE} a core, got {workers}")
    rest, most = iter(chunks), workers or cores()
    if most == 1:
        yield from here(work, rest)
    else:
        first = list(islice(rest, most))
        yield from _in_processes(work, chain(first, rest), len(first))


def here(work: Work, chunks: Iterable[Sequence[int]]) -> Chunks:
    """The backend of this process."""
    return (do_chunk(work, seeds) for seeds in chunks)


def cores() -> int:
    """Cores that this process may use."""
    ours = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        used, of = map(int, SHARE.read_text().split())
    except (OSError, ValueError):  # no Linux, or as much as there is
        return ours
    return min(ours, math.ceil(used / of))


def _in_processes(work: Work, chunks: Iterator[Sequence[int]], processes: int) -> Chunks:
    """Every process has one chunk under way."""
    with ExitStack() as stack:
        links = [stack.enter_context(started(ONE_THREAD)) for _ in range(processes)]
        first = zip(links, chunks, strict=False)
        well = all(_give(link, work) and _give(link, seeds) for link, seeds in first)
        busy = set(links)
        while busy and well:
            for link in busy & set(wait(list(busy))):
                found, seeds = _take(link), next(chunks, None)
                if seeds is None:
                    busy.remove(link)
                well = well and found is not None and (seeds is None or _give(link, seeds))
                if found is not None:
                    yield found
    if not well:
        raise WorkersLost("a worker was killed, or crashed, or ran out of memory")


def _give(link: Connection, what: object) -> bool:
    """Whether the process takes it."""
    try:
        link.send(what)
    except ConnectionError:
        return False
    return True


def _take(link: Connection) -> Chunk | None:
    """What the process has found; None when it has ended."""
    try:
        found: Chunk | Exception = link.recv()
    except (EOFError, ConnectionError):
        return None
    if isinstance(found, Exception):
        raise found
    return found
