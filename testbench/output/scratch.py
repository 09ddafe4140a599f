"""Files under way: beside the place that they take in the end, claimed by the process that makes them."""

import contextlib
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from testbench.errors import InputError
from testbench.output.lock import claim, sweep_claims

HOST = re.sub("[^A-Za-z0-9.-]", "", os.uname().nodename)[:40]
READY = ".ready"  #: Name of a folder with files that take their places beside it.
NAME = re.compile(r"\.new-(?P<host>[A-Za-z0-9.-]*)-[0-9a-f]{16}")


def shown(path: Path) -> Path:
    """The place that a path takes in the end, if it leads through a file or a folder under way."""
    return Path(*(part for part in path.parts if part != READY and not NAME.fullmatch(part)))


def sweep(folder: Path) -> None:
    """Remove what processes of this machine were making in a folder when they were killed."""
    sweep_claims(folder)
    for path in folder.iterdir():
        if (found := NAME.fullmatch(path.name)) and found["host"] == HOST:
            with contextlib.suppress(InputError, OSError), claim(path, folder, sure=True):
                remove(path)


@contextlib.contextmanager
def scratch(home: Path) -> Iterator[Path]:
    """A folder under way in another one, ours while its claim is; gone after the block, as others' before."""
    sweep(home)
    path = home / f".new-{HOST}-{secrets.token_hex(8)}"
    with claim(path, home):
        try:
            path.mkdir()
            yield path
        finally:
            remove(path)


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


def sync_all(folder: Path) -> None:
    """Have a folder on the disk, with all that is in it."""
    for path in (*folder.rglob("*"), folder):
        if not path.is_symlink():
            sync(path)


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


def sync_names(folder: Path) -> None:
    """Have the names in a folder on the disk, if it takes them: what has its place stands in any case."""
    with contextlib.suppress(OSError):
        sync(folder)


@contextlib.contextmanager
def temporary_folder() -> Iterator[Path]:
    """A folder where temporary files go; gone after the block, that of a killed process at the next one."""
    with scratch(Path(tempfile.gettempdir())) as folder:
        folder.chmod(0o700)
        yield folder
