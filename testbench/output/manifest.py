"""What manifest.json says of the folder that it lies in."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from testbench.errors import InputError, open_file, read_bytes

NAME = "manifest.json"
MOST = 16 * 2**20  #: Largest one that is read [byte].
LARGEST = 2**32  #: Largest file of a run that is looked into [byte].
FILES = 10_000  #: Most that a run has.


@dataclass(frozen=True)
class Manifest:
    """Of a run."""

    command: str | None  #: Whose run it is; None without a manifest of ours.
    files: (
        frozenset[str] | None
    )  #: Its files, by their paths in it; None where it does not say: in older ones.
    sha256: Mapping[str, str] = field(default_factory=dict)  #: Of the files, as far as it says.


def read_manifest(folder: Path) -> Manifest:
    """What a folder's manifest.json says; nothing where there is none, or it is not one of ours."""
    try:
        data = json.loads(read_bytes(folder / NAME, MOST))
        if "testbench" not in data["versions"]:
            return Manifest(None, None)
        files, sha256 = data.get("files"), dict(data.get("sha256", {}))
        named = None if files is None else _names(files)
        return Manifest(str(data["command"]), named, sha256)
    except (InputError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return Manifest(None, None)


def _names(files: Sequence[object]) -> frozenset[str]:
    """Paths of files, without what no file can be called; a ValueError where there are too many for a run."""
    if len(files) > FILES:
        raise ValueError("too many files")
    return frozenset(filter(_possible, map(str, files)))


def _possible(name: str) -> bool:
    """Whether a file can be called so."""
    try:
        return b"\0" not in os.fsencode(name)
    except UnicodeEncodeError:
        return False


def has_digest(path: Path, sha256: str | None) -> bool:
    """Whether a plain file, no link to one, has this SHA-256."""
    try:
        with open_file(path, LARGEST) as file:
            return not path.is_symlink() and hashlib.file_digest(file, "sha256").hexdigest() == sha256
    except InputError:
        return False


def is_run(folder: Path) -> bool:
    """Whether a folder is that of a run, finished or under way."""
    return read_manifest(folder).command is not None or (folder / "trials.log").is_file()
