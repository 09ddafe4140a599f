"""What manifest.json says of the folder that it lies in."""

import json
from dataclasses import dataclass
from pathlib import Path

NAME = "manifest.json"


@dataclass(frozen=True)
class Manifest:
    """Of a run."""

    command: str | None  #: Whose run it is; None without a manifest of ours.
    files: (
        frozenset[str] | None
    )  #: Its files, by their paths in it; None where it does not say: in older ones.


def read_manifest(folder: Path) -> Manifest:
    """What a folder's manifest.json says; nothing where there is none, or it is not one of ours."""
    try:
        data = json.loads((folder / NAME).read_bytes())
        if "testbench" not in data["versions"]:
            return Manifest(None, None)
        files = data.get("files")
        return Manifest(str(data["command"]), None if files is None else frozenset(map(str, files)))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return Manifest(None, None)


def is_run(folder: Path) -> bool:
    """Whether a folder is that of a run, finished or under way."""
    return read_manifest(folder).command is not None or (folder / "trials.sqlite").is_file()
