"""Checks of an output's place before anything is computed: a file, or the folder of one run."""

import contextlib
import os
import re
import stat
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from testbench.errors import InputError
from testbench.runs.manifest import is_run, read_manifest
from testbench.runs.whole import claimed, guests, writing

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
            raise InputError(path, "", f"expected {kind.name} where one is replaced; {INSTEAD}")
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
            raise InputError(out, "", f"expected a folder without {source}, which is read")
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
                problem = f"is not of {command}, and a run folder holds only runs; {ELSEWHERE}"
                raise InputError(out / guest, "", problem)
    except OSError as err:
        raise InputError(out, "", f"cannot be read: {err.strerror}") from err
