"""What `testbench init` finds in a folder, and the project file that it writes."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from testbench.campaign.model_folder import ARM
from testbench.data.mapping import parse_map
from testbench.errors import BenchError
from testbench.shell.project import OwnFile, Project

TABLES = (".csv", ".txt", ".dat", ".tsv", ".log", ".xlsx")  #: Endings of files that may be readings.
HEAD = """\
# What testbench takes in this folder, the current one, where the command line does not say otherwise.
# Lines that begin with # are examples. Paths are from here.
"""


def found_here(folder: Path) -> dict[str, object]:
    """Values by their keys: the only arm, the only URDF, and maps beside the files whose names they have."""
    arms = [path.parent for path in folder.glob(f"*/{ARM[0]}") if (path.parent / ARM[1]).is_file()]
    urdfs = list(folder.glob("*.urdf"))
    maps = {
        path.name: path.with_suffix(".toml") for path in sorted(folder.iterdir()) if path.suffix in TABLES
    }
    own = {name: {"map": str(path)} for name, path in maps.items() if path.is_file() and _is_map(path)}
    found: dict[str, object] = {}
    for key, paths in (("arm", arms), ("urdf", urdfs)):
        found |= {key: str(paths[0])} if len(paths) == 1 else {}
    return found | ({"files": own} if own else {})


def _is_map(path: Path) -> bool:
    try:
        parse_map(path)
    except BenchError:
        return False
    return True


def project_text(values: Mapping[str, object]) -> str:
    """The project file: what is known, and an example of every other key, as a comment."""
    return HEAD + "".join(f"{line}\n" for line in _lines(values))


def _lines(values: Mapping[str, object]) -> Iterator[str]:
    for key, field in Project.model_fields.items():
        if key == "files":
            continue
        value = values.get(key)
        [example] = [value] if value else field.examples or [""]
        yield f"{'' if value else '# '}{key} = {_toml(example)}  # {field.description}"
    own = values.get("files")
    for name, table in own.items() if isinstance(own, Mapping) else ():
        yield f"\n[files.{_toml(name)}]"
        yield from (f"{key} = {_toml(value)}" for key, value in table.items())
    keys = ", ".join(OwnFile.model_fields)
    yield f'\n# [files."june.csv"]  # what holds for one file alone: {keys}\n# load = "150kg"'


def _toml(value: object) -> str:
    """A text, a number or a list of them: as JSON writes it."""
    return json.dumps(value, ensure_ascii=False)
