"""The files of a new run for those of an earlier one: a kill at any moment leaves the one or the other.

A new run that is whole and on the disk is named READY, in one step. From then on it is the run of the folder:
its files are moved out of READY to their places, manifest.json last. Whoever opens the folder next and finds
READY there moves what is left.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from testbench.errors import InputError
from testbench.output import manifest
from testbench.output.lock import turn
from testbench.output.manifest import has_digest, read_manifest
from testbench.output.whole import READY, folder_for, remove, sync_all, sync_names, writing
from testbench.stops import stops_wait


def put_in_place(out: Path, scratch: Path) -> None:
    """Make the files of a folder in `out` the run of `out`.

    Raises:
        InputError: When something else stands where one goes; nothing is moved then.
        OSError: When the disk refuses it.
    """
    sync_all(scratch)
    with turn(out), stops_wait(), contextlib.ExitStack() as stack:
        _complete(out)
        for file in _files(scratch):
            _check_place(out, file)
        for file in _files(scratch):
            stack.enter_context(folder_for((out / file).parent))  # now, as the disk may be full
        scratch.rename(out / READY)
        _complete(out)


def settle(folder: Path, *, read: bool = False) -> None:
    """Finish what a killed process began to put in place; waits for one that does.

    Args:
        folder: Of a run.
        read: By who reads it, perhaps a stranger's: no file is touched but those of its runs.

    Raises:
        InputError: When it cannot be finished, or no killed process left it so.
    """
    if _is_folder(folder / READY):
        with writing(folder), turn(folder), stops_wait():
            for file in sorted(_unlike(folder)) if read else ():
                problem = "is of no run that was killed while it was put in place; move it away"
                raise InputError(file, "", problem)
            _complete(folder)


def _unlike(out: Path) -> Iterator[Path]:
    """Files that are to be moved, replaced or removed, and are not those that the manifests name."""
    old, new = read_manifest(out), read_manifest(out / READY)
    coming = [file.as_posix() for file in _files(out / READY) if file != Path(manifest.NAME)]
    both = [(out / READY, name, new) for name in coming]
    both += [(out, name, old) for name in {*coming, *_going(out)} if os.path.lexists(out / name)]
    for folder, name, own in both:
        if not has_digest(folder / name, own.sha256.get(name)):
            yield folder / name


@contextlib.contextmanager
def reading(folder: Path) -> Iterator[None]:
    """All that is read of a folder inside of the block is of one run.

    Raises:
        InputError: When what a killed process began to put in place cannot be finished.
    """
    settle(folder, read=True)
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # whoever reads will tell
            stack.enter_context(turn(folder, shared=True))
        yield


def _complete(out: Path) -> None:
    """Move what is in READY; the manifest last, by which is known which files of the earlier run go."""
    ready = out / READY
    if not _is_folder(ready):
        return
    sync_names(out)
    for name in _going(out):
        if inside((out / name).parent, out):  # as it was written; a name that leads elsewhere was not
            with contextlib.suppress(OSError):  # removed by hand, or the folder of another file
                (out / name).unlink()
                os.removedirs((out / name).parent)
    for file in _files(ready):
        _check_place(out, file)
        (out / file).parent.mkdir(parents=True, exist_ok=True)
        (ready / file).replace(out / file)
    sync_names(out)
    remove(ready)


def _going(out: Path) -> frozenset[str]:
    """Files of the earlier run that the new one has not; none once its manifest has its place."""
    new = read_manifest(out / READY)
    return read_manifest(out).files - new.files if new.command else frozenset()


def inside(path: Path, folder: Path) -> bool:
    """Whether a path leads into a folder."""
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))


def _files(folder: Path) -> list[Path]:
    """Those of a run by their paths in its folder, the manifest last."""
    found = [path.relative_to(folder) for path in folder.rglob("*") if not _is_folder(path)]
    return sorted(found, key=lambda file: (file == Path(manifest.NAME), file))


def _check_place(out: Path, file: Path) -> None:
    """Refuse a file in place of a folder, or below something that is none."""
    if _is_folder(out / file):
        raise InputError(out / file, "", "expected a file of the run there, got a folder; move it away")
    for parent in file.parents[:-1]:
        if os.path.lexists(out / parent) and not _is_folder(out / parent):
            raise InputError(out / parent, "", "expected a folder of the run there; move it away")


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()
