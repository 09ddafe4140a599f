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
import stat
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from testbench.errors import InputError
from testbench.runs.manifest import is_run, read_manifest

# --- Results that are whole or absent: each is made in a folder beside its place, and renamed into it -------

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
        raise InputError(home, "", "is not a leftover of a killed run; move it away")
    earlier = home / EARLIER
    if os.path.lexists(earlier):
        if not os.path.lexists(place):  # killed between the two renames
            earlier.rename(place)
        elif os.path.lexists(home / NEW / place.name):
            raise InputError(
                place,
                "",
                f"a killed process moved an earlier run to {earlier}: move one of the two runs away",
            )
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
            raise InputError(folder, "", "another run replaced it while it was read: try again")


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


# --- Checks of an output's place before anything is computed: a file, or the folder of one run --------------

MAX_FILE_NAME = 250  #: Longest name of a file [byte]: five more make that of its lock.
HEAD = 4096  #: How much of a file says what it is [byte].
INSTEAD = "choose another name, or replace it by --force"


@dataclass(frozen=True)
class Kind:
    """Describe a kind of file that a command writes."""

    name: str  #: For people, such as "a dataset".
    begins: bytes  #: Regular expression of its beginning.


PNG = Kind("a PNG picture", rb"\x89PNG\r\n")


def check_file(path: Path, kind: Kind, *, inputs: Sequence[Path] = (), force: bool = False) -> None:
    """Refuse a file that must not be replaced, or cannot be written.

    Args:
        path: Where to write; its folder need not exist.
        kind: What is written.
        inputs: Files and folders that the same command reads.
        force: Whether a link, or a file of another kind, may be replaced.

    Raises:
        InputError: When it is an input or a file of one, a folder or a device; without force, when it is a
            link, a file of another kind or a guest in a run's folder; when it cannot be written.
    """
    status = look(path)
    if status is not None and not stat.S_ISREG(status.st_mode) and not stat.S_ISLNK(status.st_mode):
        raise InputError(path, "", "expected the name of a file, got a folder or a device")
    ours = status is None or stat.S_ISLNK(status.st_mode) or not status.st_size or _is(path, kind)
    for source in inputs:
        if same(path, source) or (not ours and inside(path, source)):
            raise InputError(path, "", "is read by this command; choose another name")
    if status is not None and not force:
        if stat.S_ISLNK(status.st_mode):
            raise InputError(path, "", f"is a symbolic link; {INSTEAD}")
        if not ours:
            raise InputError(path, "", f"exists and is not {kind.name}; {INSTEAD}")
    if not force and is_run(path.parent):
        problem = "a run folder holds only runs; choose another place, or add to it by --force"
        raise InputError(path, "", problem)
    check_writable(path.parent, path)


def _is(path: Path, kind: Kind) -> bool:
    with writing(path), path.open("rb") as file:
        return re.match(kind.begins, file.read(HEAD)) is not None


def look(path: Path) -> os.stat_result | None:
    """Find what stands at a path, links not followed; None if nothing does.

    Raises:
        InputError: When nothing can stand there.
    """
    if any(len(os.fsencode(part)) > MAX_FILE_NAME for part in path.parts):
        raise InputError(path, "", f"cannot be written: a name has more than {MAX_FILE_NAME} bytes")
    with writing(path), contextlib.suppress(FileNotFoundError):
        return path.lstat()
    return None


def inside(path: Path, folder: Path) -> bool:
    """Tell whether a path leads into a folder, or to it.

    Args:
        path: Path of the file.
        folder: The folder.

    Returns:
        True if it does.
    """
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))


def same(path: Path, other: Path) -> bool:
    """Tell whether two paths lead to one file.

    Args:
        path: A path.
        other: Another path.

    Returns:
        True if both exist and are one file.
    """
    try:
        return path.samefile(other)
    except OSError:
        return False


def check_writable(folder: Path, path: Path) -> None:
    """Refuse a folder in which no file can be made, or which cannot be made.

    Args:
        folder: The folder.
        path: Path for the message.

    Raises:
        InputError: Names `path`.
    """
    while not os.path.lexists(folder) and folder != folder.parent:
        folder = folder.parent
    with writing(path), tempfile.TemporaryFile(dir=folder):
        pass


UNDER_WAY = frozenset(("trials", "prepared"))
"""What a study keeps in its folder beside the files of a finished run."""
ELSEWHERE = "choose another folder, or write into this one by --force"


@contextlib.contextmanager
def claim_folder(
    out: Path | None,
    command: str,
    *,
    own: frozenset[str] = UNDER_WAY,
    inputs: Sequence[Path] = (),
    force: bool,
) -> Iterator[None]:
    """Keep the folder for this command alone inside of the block, before anything is computed.

    Args and Raises: as of `check_folder`; InputError too when another run has it.

    Args:
        out: Folder of the results; None for no folder.
        command: Name of the command.
        own: Names of files that may be replaced.
        inputs: Files that the command reads, which must not be there.
        force: Whether files of another command are replaced.

    Yields:
        Nothing.
    """
    if out is None:
        yield
        return
    check_folder(out, command, own=own, inputs=inputs, force=force)
    with claimed(out):
        check_folder(out, command, own=own, inputs=inputs, force=force)
        yield


def check_folder(
    out: Path, command: str, *, own: frozenset[str] = UNDER_WAY, inputs: Sequence[Path] = (), force: bool
) -> None:
    """Refuse a folder that holds something else than a run of a command, or cannot be written.

    Args:
        out: Folder of the results; it need not exist.
        command: Whose run it is, as manifest.json names it.
        own: Names of what such a run may leave without a manifest.
        inputs: Files and folders that the same command reads.
        force: Whether files of another kind may stay there, and a run of another kind may be replaced.

    Raises:
        InputError: Names the file that is not of such a run.
    """
    status = look(out)
    for source in inputs:
        if inside(source, out):
            holds = "is read by this command" if source == out else f"holds {source}, which the command reads"
            raise InputError(out, "", f"{holds}; choose another folder")
    if status is not None and not out.is_dir():
        raise InputError(out, "", "expected a folder, got a file, a device or a link to nothing")
    if not force:
        if status is not None and stat.S_ISLNK(status.st_mode):
            raise InputError(out, "", f"is a symbolic link; {ELSEWHERE}")
        if is_run(out.absolute().parent):
            raise InputError(out, "", f"lies in the folder of a run; {ELSEWHERE}")
        if status is not None:
            _check_held(out, command, own)
    if inside(Path(), out) or out.is_mount():
        raise InputError(out, "", "is the working folder or a mount; expected the name of a folder in it")


def _check_held(out: Path, command: str, own: frozenset[str]) -> None:
    """Refuse a folder with a run of another command, or with anything that is none of its run."""
    manifest = read_manifest(out)
    if manifest.command not in (command, ""):
        raise InputError(out, "", f"holds a run of {manifest.command}, expected {command}; {ELSEWHERE}")
    try:
        for guest in guests(out, manifest.files):
            if guest.parts[0] not in own:
                problem = f"was not written by {command}, and a run folder holds only runs; {ELSEWHERE}"
                raise InputError(out / guest, "", problem)
    except OSError as err:
        raise InputError(out, "", f"cannot be read: {err.strerror}") from err
