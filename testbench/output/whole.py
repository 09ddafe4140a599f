"""Files under way, claimed by who makes them, and the whole ones that then take the places of others.

Several are brought to a folder of their own first, which in one step is named READY and something. From then
on they are on their way: the earlier ones leave their places, and they go there. A kill leaves no mixture.
"""

import contextlib
import errno
import hashlib
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from testbench.errors import InputError
from testbench.output.lock import claim, sweep_claims, turn
from testbench.stops import stops_wait

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


EARLIER = "earlier"  #: Folder of files that have left their places.


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A file to write that takes the place of `path` once the block has ended well; see `whole_files`."""
    with whole_files([path]) as (part,):
        yield part


@contextlib.contextmanager
def whole_files(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Files to write that take the places of `paths` once the block has ended well, all of them or none.

    A kill while several are put in place leaves none of the earlier ones beside a new one, but some missing:
    the next block with the same places puts those there.

    Args:
        paths: The places; their folders are made where they do not exist.

    Yields:
        The files, of the same names.

    Raises:
        InputError: When one cannot be written.
    """
    home = Path(os.path.commonpath([path.parent.absolute() for path in paths]))
    ready = home / ready_name(home, paths)
    with contextlib.ExitStack() as stack:
        for path in paths:
            stack.enter_context(folder_for(path.parent))
        with writing(paths[0]), turn(home), stops_wait():
            _move(ready, paths)
            own = stack.enter_context(scratch(home))
        with writing(paths[-1]):
            parts = [_part(own, k, path) for k, path in enumerate(paths)]
            for folder in (own / EARLIER, *(part.parent for part in parts)):
                folder.mkdir()
            yield parts
            sync_all(own)
        with writing(paths[0]), turn(home), stops_wait():
            if len(parts) == 1:
                parts[0].replace(paths[0])
            else:
                _put(own, ready, paths)
        for path in paths:
            sync_names(path.parent)


def ready_name(home: Path, paths: Sequence[Path]) -> str:
    """Of the folder in `home` with files that are whole and on their way to these places."""
    names = "\0".join(os.path.relpath(path, home) for path in paths)
    return f"{READY}-{hashlib.sha256(os.fsencode(names)).hexdigest()[:16]}"


def _part(folder: Path, k: int, path: Path) -> Path:
    """Where the k-th of several files is under way."""
    return folder / str(k) / path.name


def _put(own: Path, ready: Path, paths: Sequence[Path]) -> None:
    """Make the files of a folder those of several places, from which they are moved on from then on."""
    earlier = ready / EARLIER
    try:
        _move(ready, paths)
        own.rename(ready)
        _move(ready, paths)
    except OSError as err:
        if earlier.is_dir() and not any(earlier.iterdir()):  # all are back
            remove(ready)
        raise OSError(err.errno, err.strerror) from err  # without the names of what is under way


def _move(ready: Path, paths: Sequence[Path]) -> None:
    """Bring those files to their places that are not there yet, after all earlier ones have left theirs.

    Raises:
        OSError: When one cannot be moved; those that were are moved back.
    """
    new = [(_part(ready, k, path), path) for k, path in enumerate(paths)]
    coming = [(part, path) for part, path in new if part.is_file() and not part.is_symlink()]
    leaving = [(path, ready / EARLIER / part.parent.name) for part, path in coming if os.path.lexists(path)]
    for path, _ in leaving:
        if path.is_dir() and not path.is_symlink():
            raise IsADirectoryError(errno.EISDIR, "is a folder", path)
    done: list[tuple[Path, Path]] = []
    try:
        for move in (*leaving, *coming):
            move[0].rename(move[1])
            done.append(move)
    except OSError:
        for before, now in reversed(done):
            now.rename(before)
        raise
    if ready.is_dir() and not ready.is_symlink():
        remove(ready)


def write_whole(text: str, path: Path) -> None:
    """Write a text file; an existing one is replaced only by a whole one.

    Raises:
        InputError: When the file cannot be written.
    """
    with whole_file(path) as part:
        part.write_bytes(text.encode())
