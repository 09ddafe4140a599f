"""Files under way: beside the place that they take in the end, named after the process that makes them."""

import contextlib
import os
import re
import secrets
import shutil
import tempfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from testbench.errors import InputError
from testbench.output.lock import sweep_claims
from testbench.stops import stops_wait

HOST = re.sub("[^A-Za-z0-9.-]", "", os.uname().nodename)[:40]
UNKNOWN = "0" * 8  #: Life of a process that cannot be looked up.
NAME = re.compile(r"\.new-(?P<host>[A-Za-z0-9.-]*)-(?P<pid>[0-9]{1,9})-(?P<life>[0-9a-f]{8})-[0-9a-f]{8}")


def scratch_name() -> str:
    """A name that nothing else has."""
    return f".new-{HOST}-{os.getpid()}-{_life(os.getpid())}-{secrets.token_hex(4)}"


def shown(path: Path) -> Path:
    """The place that a path takes in the end, if it leads through a file or a folder under way."""
    return Path(*(part for part in path.parts if not NAME.fullmatch(part)))


def sweep(folder: Path) -> None:
    """Remove what processes of this machine were making in a folder when they were killed."""
    sweep_claims(folder)
    for path in folder.iterdir():
        found = NAME.fullmatch(path.name)
        if found and found["host"] == HOST and not _runs(int(found["pid"]), found["life"]):
            remove(path)


def _runs(pid: int, life: str) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # of another user
        return True
    return _life(pid) in (life, UNKNOWN)


def _life(pid: int) -> str:
    """Tells a process from an earlier one of the same number: when it began, since the machine last did."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()
        boot = Path("/proc/sys/kernel/random/boot_id").read_text()
    except OSError:  # no Linux, or another user's
        return UNKNOWN
    ended = stat[0] in "ZX"  # and nobody has asked about it yet
    return "ended" if ended else f"{zlib.crc32(f'{boot}{stat[19]}'.encode()):08x}"


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """What the disk refuses in the block is told as an InputError of the path, or of what is replaced."""
    try:
        yield
    except OSError as err:
        problem = f"cannot be written: {err.strerror or err}"
        raise InputError(shown(Path(err.filename2 or path)), "", problem) from err


def remove(path: Path) -> None:
    """Remove a file or a folder, if it can be."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()


@contextlib.contextmanager
def folder_for(path: Path) -> Iterator[None]:
    """The folder and those above it are there inside of the block; what was made of them goes if it is empty.

    Raises:
        InputError: When they cannot be made.
    """
    made = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        with writing(path):
            path.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for folder in made:
            with contextlib.suppress(OSError):  # not empty
                folder.rmdir()


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A file to write that takes the place of `path` once the block has ended well; see `whole_files`."""
    with whole_files([path]) as (part,):
        yield part


@contextlib.contextmanager
def whole_files(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Files to write that take the places of `paths` once the block has ended well, all of them or none.

    Args:
        paths: The places; their folders are made where they do not exist.

    Yields:
        The files, of the same names.

    Raises:
        InputError: When one cannot be written.
    """
    parts = [path.parent / scratch_name() / path.name for path in paths]
    with contextlib.ExitStack() as stack:
        for path, part in zip(paths, parts, strict=True):
            stack.enter_context(folder_for(path.parent))
            with writing(path):
                sweep(path.parent)
                stack.callback(remove, part.parent)
                part.parent.mkdir()
        with writing(paths[-1]):
            yield parts
        for part in parts:
            with writing(part):
                sync(part)
        with stops_wait():
            for path, part in zip(paths, parts, strict=True):
                with writing(path):
                    part.replace(path)
                    sync(path.parent)


def sync(path: Path) -> None:
    """Have a file, or the names in a folder, on the disk before anything else is done.

    A folder may be a link, as `runs` often is to one on another disk; a file may not.
    """
    kind = os.O_DIRECTORY if path.is_dir() else os.O_NOFOLLOW
    file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | kind)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def write_whole(text: str, path: Path) -> None:
    """Write a text file; an existing one is replaced only by a whole one.

    Raises:
        InputError: When the file cannot be written.
    """
    with whole_file(path) as part:
        part.write_bytes(text.encode())


@contextlib.contextmanager
def temporary_folder() -> Iterator[Path]:
    """A folder where temporary files go; gone after the block, that of a killed process at the next one."""
    place = Path(tempfile.gettempdir())
    sweep(place)
    folder = place / scratch_name()
    folder.mkdir(mode=0o700)
    try:
        yield folder
    finally:
        remove(folder)
