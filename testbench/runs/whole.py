"""Results that are whole or absent: each is made in a folder beside its place, and renamed into it.

While `model` is written, beside it are `.model.lock`, held by filelock, and the folder `.model.new`:

    .model.new/new/model    what is made, under the name that it will have
    .model.new/earlier      what stood at the place, between two renames
    .model.new/gone         the same, when the new one has taken the place

A kill leaves all of them. Whoever writes at the place next, or reads it, brings them in order: see `_settle`.
"""

import contextlib
import errno
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from testbench.errors import InputError
from testbench.runs.manifest import read_manifest

NEW, EARLIER, GONE = "new", "earlier", "gone"
NOT_PLACED_YET = re.compile(rf"\.[^/]+\.new/{NEW}/")  #: In the path of what is not yet at its place.


@contextlib.contextmanager
def locked(place: Path, *, wait: bool = True) -> Iterator[None]:
    """Keep other processes from writing at a place; a block in another one of the same place holds it too.

    Args:
        place: A file or a folder, there or not; its own folder must exist.
        wait: For a process that writes there.

    Yields:
        Nothing.

    Raises:
        InputError: When one does, and we do not wait.
        OSError: When no lock can be made.
    """
    from filelock import FileLock, Timeout  # here: processes that write nothing need not import it

    file = place.with_name(f".{place.name}.lock")
    lock = FileLock(file, is_singleton=True)
    with tempfile.TemporaryFile(dir=place.parent):  # where none can be made, filelock waits for one
        pass
    try:
        lock.acquire(timeout=-1 if wait else 0)
    except Timeout:
        problem = "is being written by another run: wait for it, or choose another place"
        raise InputError(place, "", problem) from None
    try:
        yield
    finally:
        with contextlib.suppress(FileNotFoundError):
            if lock.lock_counter == 1 and not file.stat().st_size:  # one of another use is not empty
                file.unlink()  # while it is ours: whoever waits for it sees that the file is gone
        lock.release()


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the disk refuses in the block into an InputError of the path."""
    try:
        yield
    except OSError as err:
        shown = Path(NOT_PLACED_YET.sub("", str(path)))
        raise InputError(shown, "", f"cannot be written: {err.strerror or err}") from err


@contextlib.contextmanager
def folder_for(path: Path) -> Iterator[None]:
    """Make a folder and those above it for the block; what was made of them goes if it is empty afterwards.

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
def _beside(place: Path) -> Iterator[Path]:
    """Make a folder beside a place that is ours in the block, and gone afterwards."""
    with folder_for(place.parent), locked(place):
        _settle(place)
        home = _home(place)
        try:
            (home / NEW).mkdir(parents=True)
            yield home
        finally:
            _settle(place)


def _home(place: Path) -> Path:
    return place.with_name(f".{place.name}.new")


def _settle(place: Path) -> None:
    """Bring in order what a killed process left beside a place; its lock must be ours."""
    home = _home(place)
    if not os.path.lexists(home):
        return
    if home.is_symlink() or {path.name for path in home.iterdir()} - {NEW, EARLIER, GONE}:
        raise InputError(home, "", "is not what a killed run leaves; move it away")
    earlier = home / EARLIER
    if os.path.lexists(earlier):
        if not os.path.lexists(place):  # killed between the two renames
            earlier.rename(place)
        elif os.path.lexists(home / NEW / place.name):
            raise InputError(place, "", f"stands in the place of the run that is in {earlier}; move one away")
        else:
            for guest in guests(earlier, read_manifest(earlier).files):
                if not os.path.lexists(place / guest):
                    (place / guest).parent.mkdir(parents=True, exist_ok=True)
                    (earlier / guest).rename(place / guest)
            earlier.rename(home / GONE)  # half removed it would seem to be full of guests
    remove(home)


def guests(folder: Path, named: frozenset[str]) -> Iterator[Path]:
    """List what lies in a run's folder and is none of its files.

    Args:
        folder: Of the run.
        named: Its files, by their paths in it.

    Yields:
        Paths in the folder; that of an inner folder stands for all that is in it, if no file of the run is.
    """
    for path in sorted(folder.iterdir()):
        plain, own = not path.is_symlink(), f"{path.name}/"
        below = frozenset(name.removeprefix(own) for name in named if name.startswith(own))
        if below and plain and path.is_dir():
            yield from (path.name / guest for guest in guests(path, below))
        elif not (plain and path.is_file() and path.name in named):
            yield Path(path.name)


def _place(out: Path) -> Path:
    """Find where a folder is, if it is named by a link, or through one that is in it."""
    return Path(os.path.realpath(out)) if out.is_symlink() or out.name in ("", "..") else out


@contextlib.contextmanager
def claimed(out: Path) -> Iterator[None]:
    """Keep other processes from writing a folder in the block, and bring in order what a killed one left.

    Raises:
        InputError: When another process writes it, or it cannot be written.
    """
    place = _place(out)
    with contextlib.ExitStack() as held:
        with writing(out):
            held.enter_context(folder_for(place.parent))
            held.enter_context(locked(place, wait=False))
            _settle(place)
        yield


@contextlib.contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """Make the folder of a run that takes its place once the block has ended well.

    What lies in an earlier one, and is no file of its run, moves into the new one.

    Args:
        out: Folder of the results; made where it does not exist.

    Raises:
        InputError: When the folder cannot be made or written, or another folder stands where a file goes.
    """
    place = _place(out)
    with writing(out), _beside(place) as home:
        new = home / NEW / place.name
        new.mkdir()
        yield new
        _sync_all(new)
        if os.path.lexists(place):
            for guest in guests(place, read_manifest(place).files):
                if os.path.lexists(new / guest) and (place / guest).is_dir():
                    problem = "expected a file of the run there, got a folder; move it away"
                    raise InputError(out / guest, "", problem)
            place.rename(home / EARLIER)
        new.rename(place)
        sync_names(place.parent)


@contextlib.contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """Make a folder that must not be there yet; see `whole_folder`.

    Raises:
        InputError: When it exists, or cannot be made or written.
    """
    with claimed(out):
        if os.path.lexists(out):
            raise InputError(out, "", "exists already; expected the name of a new folder")
        with whole_folder(out) as folder:
            yield folder


def restore(folder: Path) -> None:
    """Put an earlier run back at its place, where a kill between two renames took it from there.

    Raises:
        InputError: When it cannot be moved.
    """
    place = _place(folder)
    if not os.path.lexists(place) and os.path.lexists(_home(place) / EARLIER):
        with writing(folder), locked(place):
            _settle(place)


@contextlib.contextmanager
def reading(folder: Path) -> Iterator[None]:
    """Have all that is read of a folder in the block be of one run.

    Raises:
        InputError: When another run took its place meanwhile.
    """
    restore(folder)
    before = _identity(folder)
    try:
        yield
    finally:
        if _identity(folder) != before:
            raise InputError(folder, "", "another run took its place while it was read: begin again")


def _identity(folder: Path) -> tuple[int, int] | None:
    with contextlib.suppress(OSError):
        status = folder.stat()
        return status.st_dev, status.st_ino
    return None


@contextlib.contextmanager
def whole_files(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Make files that take their places once the block has ended well, all of them or none.

    No earlier one stands beside a new one: a kill while several are put in place leaves some missing.

    Args:
        paths: The places; their folders are made where they do not exist.

    Yields:
        The files to write, of the same names.

    Raises:
        InputError: When one cannot be written.
    """
    home = Path(os.path.commonpath([path.parent.absolute() for path in paths]))
    with contextlib.ExitStack() as stack:
        for path in paths:
            stack.enter_context(folder_for(path.parent))
        stack.enter_context(writing(paths[-1]))
        beside = stack.enter_context(_beside(home / paths[-1].name))
        parts = [beside / NEW / os.path.relpath(path, home) for path in paths]
        for part in parts:
            part.parent.mkdir(parents=True, exist_ok=True)
        yield parts
        _sync_all(beside)
        if len(paths) == 1:
            parts[0].replace(paths[0])
        else:
            _put(parts, paths, beside)
        for path in paths:
            sync_names(path.parent)


def _put(parts: Sequence[Path], paths: Sequence[Path], beside: Path) -> None:
    """Move files to their places after all earlier ones have left them; after an error those are back."""
    earlier = [beside / GONE / str(k) for k in range(len(paths))]
    (beside / GONE).mkdir()
    try:
        for path, before in zip(paths, earlier, strict=True):
            if path.is_dir() and not path.is_symlink():
                raise IsADirectoryError(errno.EISDIR, f"{path.name} is a folder")
            if os.path.lexists(path):
                path.rename(before)
        for part, path in zip(parts, paths, strict=True):
            part.replace(path)
    except BaseException:  # also of Ctrl-C
        for part, path, before in zip(parts, paths, earlier, strict=True):
            if os.path.lexists(before):
                before.replace(path)
            elif not os.path.lexists(part):
                path.unlink()
        raise


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Make a file that takes the place of `path` once the block has ended well; see `whole_files`."""
    with whole_files([path]) as (part,):
        yield part


def write_whole(text: str, path: Path) -> None:
    """Write a text file; an existing one is replaced only by a whole one.

    Args:
        text: Text of the file.
        path: Path of the file.

    Raises:
        InputError: When the file cannot be written.
    """
    with whole_file(path) as part:
        part.write_bytes(text.encode())


def remove(path: Path) -> None:
    """Remove a file or a folder, if it can be."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()


def _sync_all(folder: Path) -> None:
    """Have a folder on the disk, with all that is in it."""
    for path in (*folder.rglob("*"), folder):
        if not path.is_symlink():
            _sync(path)


def _sync(path: Path) -> None:
    file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW * (not path.is_dir()))
    try:
        os.fsync(file)
    finally:
        os.close(file)


def sync_names(folder: Path) -> None:
    """Have the names in a folder on the disk, if it takes them: what has its place stands in any case."""
    with contextlib.suppress(OSError):
        _sync(folder)
