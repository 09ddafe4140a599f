"""What manifest.json says of the folder that it lies in."""

import hashlib
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

from testbench.errors import InputError, open_file, read_bytes

NAME = "manifest.json"
MOST = 16 * 2**20  #: Largest one that is read [byte].
LARGEST = 2**32  #: Largest file of a run that is looked into [byte].
FILES = 10_000  #: Most that a run has.
File = Annotated[str, Field(pattern=r"^[^\x00]*$")]


class Manifest(BaseModel):
    """What manifest.json must say of a run, and may say."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    command: str  #: Whose run it is; empty where there is none of ours.
    versions: dict[str, str]
    scenario: JsonValue = None
    seed: int = 0  #: The first one.
    seeds: int = 0  #: How many; none where nothing is drawn.
    git: str = "unknown"
    models: dict[str, dict[str, str]] = {}  #: SHA-256 of every file of every arm's folder.
    #: Its files, by their paths in it; None where it does not say: in older ones.
    files: Annotated[frozenset[File], Field(max_length=FILES)] | None = None
    sha256: dict[str, str] = {}  #: Of the files, as far as it says.


NONE = Manifest(command="", versions={})


def read_manifest(folder: Path) -> Manifest:
    """What a folder's manifest.json says; nothing where there is none, or it is not one of ours."""
    try:
        found = Manifest.model_validate_json(read_bytes(folder / NAME, MOST))
    except (InputError, ValidationError):
        return NONE
    return found if "testbench" in found.versions else NONE


def has_digest(path: Path, sha256: str | None) -> bool:
    """Whether a plain file, no link to one, has this SHA-256."""
    try:
        with open_file(path, LARGEST) as file:
            return not path.is_symlink() and hashlib.file_digest(file, "sha256").hexdigest() == sha256
    except InputError:
        return False


def is_run(folder: Path) -> bool:
    """Whether a folder is that of a run, finished or under way."""
    return bool(read_manifest(folder).command) or (folder / "trials.log").is_file()
