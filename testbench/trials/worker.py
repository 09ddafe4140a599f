"""A process that does chunks of trials: a program of its own, begun by `local`."""

import os
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from socket import socketpair

from testbench.child import child
from testbench.trials.chunk import Chunk, Work, do_chunk

START = "import sys; sys.path[:] = {path!r}; from testbench.trials.worker import main; main()"
ALONE = ("-P", "-c")  #: Flags of Python: nothing is imported from where it happens to run.


@contextmanager
def started(environment: Mapping[str, str]) -> Iterator[Connection]:
    """A process in the block: takes work, then seeds, each answered as by `answer`; it ends with this one.

    Args:
        environment: More of its environment.
    """
    ours, theirs = socketpair()
    path = [path or str(Path.cwd()) for path in sys.path]
    command = [sys.executable, *ALONE, START.format(path=path)]
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
