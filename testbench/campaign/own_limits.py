"""What a call of an estimator of one's own may use: memory, processor time, no file, no network.

Memory, time and the size of a file are limited by the process itself. All else is Landlock's, a part of
Linux from 5.13 on: who is under it opens no file for writing, from 6.7 on no connection, signals from 6.12 on
no process but its own, and reads no other's memory. Where the kernel has none, only the first holds.
"""

import ctypes
import math
import os
import resource
from dataclasses import dataclass
from pathlib import Path

SIZE = Path("/proc/self/statm")  #: Begins with the memory that a process has, in pages.
FILE = 2**24  #: Largest file [byte].
CREATE, RESTRICT = 444, 446  #: Landlock's system calls.
NO_NEW_PRIVILEGES = 38
"""What `prctl` is asked for: without it Landlock refuses all but root."""
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
