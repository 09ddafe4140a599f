"""Whether an output may go to a place, asked before anything is computed."""

import contextlib
import os
import re
import stat
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from testbench.errors import InputError
from testbench.output.lock import claim
from testbench.output.manifest import is_run
from testbench.output.scratch import folder_for, writing

LONGEST = 255  #: Longest name of a file [byte].
HEAD = 4096  #: How much of a file says what it is [byte].
INSTEAD = "choose another name, or replace it by --force"


@dataclass(frozen=True)
class Kind:
    """A kind of file that a command writes."""

    name: str  #: For people, such as "a dataset".
    begins: bytes  #: Regular expression of its beginning.


PNG = Kind("a PNG picture", rb"\x89PNG\r\n")
GIF = Kind("a GIF picture", rb"GIF8[79]a")
MP4 = Kind("an MP4 film", rb"(?s:....)ftyp")


@contextlib.contextmanager
def claim_file(path: Path, kind: Kind, *, inputs: Sequence[Path] = (), force: bool = False) -> Iterator[None]:
    """The file is this command's alone inside of the block, before anything is computed.

    Args and Raises: as of `check_file`; InputError too when another run has it.
    """
    check_file(path, kind, inputs=inputs, force=force)
    with contextlib.ExitStack() as stack:
        with writing(path):
            stack.enter_context(folder_for(path.parent))
            stack.enter_context(claim(path.parent, path.parent, shared=True))  # no run's folder meanwhile
            stack.enter_context(claim(path, path.parent))
        yield


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
    """What stands at a path, links not followed; None if nothing does.

    Raises:
        InputError: When nothing can stand there.
    """
    if any(len(os.fsencode(part)) > LONGEST for part in path.parts):
        raise InputError(path, "", f"cannot be written: a name has more than {LONGEST} bytes")
    with writing(path), contextlib.suppress(FileNotFoundError):
        return path.lstat()
    return None


def same(path: Path, other: Path) -> bool:
    """Whether two paths lead to one file."""
    try:
        return path.samefile(other)
    except OSError:
        return False


def inside(path: Path, folder: Path) -> bool:
    """Whether a path leads into a folder."""
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))


def check_writable(folder: Path, path: Path) -> None:
    """Refuse a folder in which no file can be made, or which cannot be made.

    Raises:
        InputError: Names `path`.
    """
    while not os.path.lexists(folder) and folder != folder.parent:
        folder = folder.parent
    with writing(path), tempfile.TemporaryFile(dir=folder):
        pass
