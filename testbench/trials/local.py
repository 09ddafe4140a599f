"""Trials on the cores of this machine: each in a program of its own."""

import math
import os
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import chain, islice
from multiprocessing.connection import Connection, wait
from pathlib import Path
from socket import socketpair

from testbench.child import child
from testbench.errors import BenchError
from testbench.trials.engine import Chunk, Chunks, Work, WorkersLost, do_chunk, here

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS"), "1"
)
START = "import sys; sys.path[:] = {path!r}; from {module} import main; main()"
ALONE = ("-P", "-c")  #: Flags of Python: nothing is imported from where it happens to run.
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


@contextmanager
def started(environment: Mapping[str, str], module: str = __name__) -> Iterator[Connection]:
    """A process in the block that runs the `main` of a module; it ends with this one.

    That of this module takes work, then seeds, each answered as by `answer`.
    """
    ours, theirs = socketpair()
    path = [path or str(Path.cwd()) for path in sys.path]
    command = [sys.executable, *ALONE, START.format(path=path, module=module)]
    program = child(command, {**os.environ, **environment}, out=theirs.fileno())
    with Connection(ours.detach()) as link, theirs, program:
        theirs.close()  # then the end of the process is the end of what can be read
        yield link


def answer(work: Work, seeds: Sequence[int]) -> Chunk | Exception:
    """The chunk, or a fault of ours in words, since not every exception can travel."""
    try:
        return do_chunk(work, seeds)
    except Exception:
        return RuntimeError(f"in a worker:\n{traceback.format_exc()}")


def main() -> None:
    """Do chunks until nobody asks. The link is its standard output; what others print goes to the error."""
    with Connection(os.dup(1)) as link, suppress(EOFError, ConnectionError):
        os.dup2(2, 1)
        work = link.recv()
        while True:
            link.send(answer(work, link.recv()))
