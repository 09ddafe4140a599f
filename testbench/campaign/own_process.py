"""Estimators of one's own in processes apart, held to limits: what they do there costs nobody else.

Memory, time and the size of a file are limited by the process itself. All else is Landlock's, a part of
Linux from 5.13 on: who is under it opens no file for writing, from 6.7 on no connection, signals from 6.12 on
no process but its own, and reads no other's memory. Where the kernel has none, only the first holds.
"""

import ctypes
import math
import os
import random
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from io import BytesIO
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, shown
from testbench.identify.prior import Prior
from testbench.identify.regression import Regression
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm
from testbench.trials.local import ONE_THREAD, started

SIZE = Path("/proc/self/statm")  #: Begins with the memory that a process has, in pages.
FILE = 2**24  #: Largest file [byte].
CREATE, RESTRICT = 444, 446  #: Landlock's system calls.
NO_NEW_PRIVILEGES, SUBREAPER = 38, 36
"""What `prctl` is asked for: without the first Landlock refuses all but root; by the second who loses its
parent becomes a child of this process."""
CHILDREN = "/proc/self/task/{}/children"  #: Of a thread; there on Linux.
FILES = {1: 1 << 1 | sum(1 << k for k in range(4, 13)), 2: 1 << 13, 3: 1 << 14}
"""To write, remove and make anything; to link across folders; to truncate: from which version on."""
NETWORK, SCOPED = {4: 0b11}, {6: 0b11}
"""The same of TCP, to bind and to connect, and of abstract sockets and signals."""


class Rules(ctypes.Structure):
    """What is refused: `struct landlock_ruleset_attr`."""

    _fields_ = (("files", ctypes.c_uint64), ("network", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


@dataclass(frozen=True)
class Limits:
    """Of a call."""

    seconds: float = 60.0  #: Longest time [s].
    memory: int = 2 * 10**9  #: Most memory beside what its libraries take [byte].


def limit(asked: Limits) -> None:
    """From now on this process is held to them, and writes nothing."""
    if SIZE.exists():
        pages = int(SIZE.read_text().split()[0])
        _at_most(resource.RLIMIT_AS, pages * resource.getpagesize() + asked.memory)
    _at_most(resource.RLIMIT_CPU, math.ceil(asked.seconds) + 1)
    _at_most(resource.RLIMIT_FSIZE, FILE)
    _landlock()


def _at_most(kind: int, most: int) -> None:
    hard = resource.getrlimit(kind)[1]
    most = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(kind, (most, most))


def _landlock() -> None:
    """Nothing where the kernel has none of it."""
    call = ctypes.CDLL(None, use_errno=True)
    version = call.syscall(CREATE, None, 0, 1)
    if version < 1:
        return
    refused = [sum(bit for least, bit in own.items() if version >= least) for own in (FILES, NETWORK, SCOPED)]
    rules, size = Rules(*refused), 8 * sum(bits > 0 for bits in refused)
    handle = call.syscall(CREATE, ctypes.byref(rules), size, 0)
    call.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    if handle < 0 or call.syscall(RESTRICT, handle, 0):
        raise OSError(ctypes.get_errno(), "Landlock is there and refuses")
    os.close(handle)


SUFFIX = ".py"  #: Of a file; without it a source is a module.
MOST = 2**26  #: Largest answer [byte].
LONGEST = 200  #: Of a message [characters].
WELL, ILL = b"+", b"-"  #: First byte of an answer: an array of numpy follows, or why there is none.
ENDED = "its process ended without an answer"

Given = tuple[Vjm, Structure, Dataset | Regression, Prior | None]
"""What `estimate(kinematics, structure, data, prior)` is called with."""


@dataclass(frozen=True)
class Own:
    """An estimator of one's own: plain data, for manifest.json and for workers."""

    name: str  #: As every view calls it.
    source: str  #: Path of its file, or name of its module.
    function: str
    limits: Limits  #: Of a call.
    sha256: str = ""  #: Of its file.


@dataclass(frozen=True)
class Answer:
    """What a call returned."""

    found: Array  #: Of any shape: parameters (n,) or compliances.
    covariance: Array | None  #: The second of two arrays; None where there was one.
    cpu_seconds: float  #: Processor time of the call.


@contextmanager
def server() -> Iterator[Connection]:
    """A process that answers calls of `ask`, each in a fork of its own: nothing lasts from call to call."""
    with started(ONE_THREAD, module=__name__) as link:
        yield link


def ask(link: Connection, own: Own, given: Given) -> Answer:
    """What an estimator returns, as arrays of any shape.

    Raises:
        BenchError: Why there is nothing.
    """
    data, seconds = _asked(link, own, given)
    stream = BytesIO(data)
    found = np.asarray(np.load(stream, allow_pickle=False))
    more = stream.tell() < len(data)
    return Answer(found, np.asarray(np.load(stream, allow_pickle=False)) if more else None, seconds)


def file_of(link: Connection, own: Own) -> Path:
    """The file that has its function.

    Raises:
        BenchError: When it cannot be imported, or lacks the function.
    """
    return Path(_asked(link, own, None)[0].decode())


def _asked(link: Connection, own: Own, given: Given | None) -> tuple[bytes, float]:
    """Its answer, and the processor time that it took [s]."""
    link.send((own, given))
    answer, seconds = link.recv_bytes(), float(link.recv_bytes())
    if answer[:1] == WELL:
        return answer[1:], seconds
    raise BenchError(shown(" ".join(answer[1:].decode(errors="replace").split()))[:LONGEST])


def main() -> None:
    """Answer until nobody asks. The link is the standard output; what others print goes to the error."""
    sys.dont_write_bytecode = True  # nothing is left beside the file
    if SIZE.exists():
        ctypes.CDLL(None).prctl(SUBREAPER, 1, 0, 0, 0)
    kept = _children()  # who ends this process with its parent
    with Connection(os.dup(1)) as link, suppress(EOFError, ConnectionError):
        os.dup2(2, 1)
        while True:
            own, given = link.recv()
            parts = _apart(link, own, given)
            _end(kept)
            for part in parts:
                link.send_bytes(part)


def _children() -> set[int]:
    """Processes whose parent is this one; none where the system does not list them."""
    listed = Path(CHILDREN.format(os.getpid()))
    return set(map(int, listed.read_text().split())) if listed.exists() else set()


def _end(kept: set[int]) -> None:
    """Kill what a call left: its orphans are children of this process, and theirs when these are gone."""
    while left := _children() - kept:
        for pid in left:
            os.kill(pid, signal.SIGKILL)
        for pid in left:
            os.waitpid(pid, 0)


def _apart(link: Connection, own: Own, given: Given | None) -> tuple[bytes, bytes]:
    """The answer of a fork, and its processor time [s]; it is killed when it is too slow."""
    ours, theirs = Pipe(duplex=False)
    pid = os.fork()
    if not pid:
        try:
            link.close()
            limit(own.limits)
            theirs.send_bytes(_answer(own, given))
        finally:
            os._exit(0)
    theirs.close()
    try:
        slow = f"too slow: stopped after {own.limits.seconds:g} s".encode()
        answer = ours.recv_bytes(MOST) if ours.poll(own.limits.seconds) else ILL + slow
    except (EOFError, OSError):
        answer = ILL + ENDED.encode()
    ours.close()
    os.kill(pid, signal.SIGKILL)
    used = os.wait4(pid, 0)[2]
    return answer, repr(used.ru_utime + used.ru_stime).encode()


def _answer(own: Own, given: Given | None) -> bytes:
    """What its function returns, in bytes; without an argument where its file is."""
    random.seed(0)  # who draws from global generators draws the same in every process
    np.random.seed(0)  # noqa: NPY002
    try:
        function, file = _function(own)
        return WELL + (file.encode() if given is None else _packed(function(*given)))
    except BenchError as err:
        return ILL + str(err).encode(errors="replace")
    except BaseException as err:  # any, SystemExit among them: it is a stranger's
        words = f"raised {type(err).__name__}: {err}".rstrip(": ")
        return ILL + words.encode(errors="replace")


def _function(own: Own) -> tuple[Callable[..., object], str]:
    """The function, imported anew, and the path of its file."""
    if own.source.endswith(SUFFIX):
        spec = spec_from_file_location(f"own_estimator_{own.name}", own.source)
        assert spec
        assert spec.loader  # of any file of Python
        module = module_from_spec(spec)
        sys.modules[module.__name__] = module  # where dataclasses look for their module
        spec.loader.exec_module(module)
    else:
        module = import_module(own.source)
    function, file = getattr(module, own.function, None), getattr(module, "__file__", None)
    if not callable(function):
        raise BenchError(f"it has no function {own.function!r}")
    if file is None:
        raise BenchError("it has no file")
    return function, file


def _packed(found: object) -> bytes:
    """An array in numpy's format, or one of parameters and one of their covariances."""
    stream = BytesIO()
    for part in found if isinstance(found, tuple) and len(found) == 2 else (found,):
        if part is None:
            raise BenchError("expected an array, got None")
        try:
            array = np.asarray(part, dtype=float)
        except (TypeError, ValueError) as err:
            raise BenchError(f"expected an array of numbers, got {type(part).__name__}") from err
        np.save(stream, array, allow_pickle=False)
    return stream.getvalue()
