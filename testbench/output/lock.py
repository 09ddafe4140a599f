"""Who writes a place: a claim, held by a command from before it computes; and turns at the files of a folder.

Both are locks of the kernel, which lets go of them when their process ends, however it ends.
"""

import contextlib
import errno
import fcntl
import hashlib
import os
import re
import stat
import time
from collections.abc import Iterator
from pathlib import Path

from testbench.errors import InputError

CLAIM = re.compile(r"\.claim-[0-9a-f]{16}")  #: Name of the empty file that is locked.
UNKNOWN = frozenset((errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL, errno.EBADF, errno.ENOSYS))
"""What file systems without locks say; there nobody is kept out."""
LOOKS, PAUSE = 5, 0.02
"""How often a claim is looked at, and the time between [s]: its holder may be leaving."""


@contextlib.contextmanager
def claim(place: Path, folder: Path, *, shared: bool = False, sure: bool = False) -> Iterator[None]:
    """Nobody else claims the place inside of the block.

    Args:
        place: A file or a folder.
        folder: Where the claim lies meanwhile: beside the file, inside of the folder.
        shared: Beside others who do so: of a folder in which a file is written.
        sure: At the first look, and never where there are no locks.

    Raises:
        InputError: When another process has claimed it.
        OSError: When nothing can be made in the folder.
    """
    name = "" if place == folder else place.name
    path = folder / f".claim-{hashlib.sha256(os.fsencode(name)).hexdigest()[:16]}"
    file = _claimed(place, path, fcntl.LOCK_SH if shared else fcntl.LOCK_EX, sure=sure)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            if not shared or locked(file, fcntl.LOCK_EX | fcntl.LOCK_NB):
                path.unlink()
        os.close(file)


def _claimed(place: Path, path: Path, kind: int, *, sure: bool) -> int:
    for _ in range(1 if sure else LOOKS):
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)
        try:
            holder = _try(file, path, kind, sure=sure)
        except BaseException:
            os.close(file)
            raise
        if holder is None:
            return file
        os.close(file)
        time.sleep(PAUSE)
    raise InputError(place, "", f"is being written by {holder}: wait for it, or choose another place")


def _try(file: int, path: Path, kind: int = fcntl.LOCK_EX, *, sure: bool = True) -> str | None:
    """Who holds the open file; None where it is ours from now on."""
    status = os.fstat(file)
    if not stat.S_ISREG(status.st_mode) or status.st_size:
        raise InputError(path, "", "expected an empty file, the claim of a run; move it away")
    if not locked(file, kind | fcntl.LOCK_NB, sure=sure):
        return _holder(status.st_ino)
    with contextlib.suppress(FileNotFoundError):
        if os.path.samestat(status, path.lstat()):
            return None
    return "another run"  # that has just ended, and took its claim away


def locked(file: int, kind: int, *, sure: bool = False) -> bool:
    """Whether an open file is ours from now on; so it is where there are no locks, if we need not be sure."""
    try:
        fcntl.flock(file, kind)
    except BlockingIOError:
        return False
    except OSError as err:
        if sure or err.errno not in UNKNOWN:
            raise
    return True


def _holder(inode: int) -> str:
    """The process that has locked a file, as far as the kernel tells."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/locks").read_text().splitlines():
            _, kind, _, _, pid, file, *_ = line.split()
            if kind == "FLOCK" and file.rpartition(":")[2] == str(inode) and int(pid) > 0:
                return f"another run, process {pid}"
    return "another run"


def sweep_claims(folder: Path) -> None:
    """Remove the claims of processes that were killed."""
    for path in folder.iterdir():
        if CLAIM.fullmatch(path.name):
            with contextlib.suppress(OSError, InputError):
                file = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
                try:
                    if _try(file, path) is None:
                        path.unlink()
                finally:
                    os.close(file)


@contextlib.contextmanager
def turn(folder: Path, *, shared: bool = False) -> Iterator[None]:
    """Nobody else puts files of a run in place inside of the block; waits for whoever does.

    Args:
        folder: Of the run.
        shared: To read it, beside others who read.

    Raises:
        OSError: When it is no folder.
    """
    file = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        locked(file, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
        yield
    finally:
        os.close(file)
