"""testbench init [KEY=VALUE ...]: the project file of a cell, from what it is told and finds here."""

import json
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.campaign.model_folder import ARM
from testbench.data.mapping import is_map
from testbench.errors import BenchError
from testbench.output.place import Kind, check_file, look
from testbench.output.whole import whole_file
from testbench.shell.options import Force, takes
from testbench.shell.project import NAME, TEMPLATE, parse_project
from testbench.views.terminal import plain_console

PROJECT = Kind("a project file", b"# What testbench takes")
TABLES = (".csv", ".txt", ".dat", ".tsv", ".log", ".xlsx", ".xls", ".ods")
"""Endings of files that may be readings."""


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    values: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KEY=VALUE", help="Such as arm=my_arm tracker=4,-2,1.5; the file has all keys."
        ),
    ] = None
    force: Force = False


@takes(Options)
def command(asked: Options) -> None:
    """Write testbench.toml into this folder: commands that start here need none of its flags."""
    if look(NAME) is not None and not asked.force:
        raise BenchError(f"{NAME}: exists already; edit it, or --force to write it anew")
    told = dict(map(_pair, asked.values or []))
    text = _filled(TEMPLATE.read_text(encoding="utf-8"), _found() | told)
    parse_project(NAME, text)
    check_file(NAME, PROJECT, force=True)
    with whole_file(NAME) as part:
        part.write_text(text, encoding="utf-8")
    taken = [line for line in text.splitlines() if line and not line.startswith("#")]
    several = [
        f"{key} is not set: here are {', '.join(map(str, paths))}; testbench init --force {key}=ONE sets it"
        for key, paths in _candidates().items()
        if len(paths) > 1 and key not in told
    ]
    plain_console().print("\n".join([f"{NAME}:", *taken, *several]), soft_wrap=True)


def _pair(word: str) -> tuple[str, object]:
    """Key and value of a word; what is no value of TOML is a text."""
    key, equals, text = word.partition("=")
    template = TEMPLATE.read_text(encoding="utf-8")
    if not equals or f"\n# {key} = " not in template:
        keys = ", ".join(re.findall(r"^# (\w+) = ", template, re.MULTILINE))
        raise BenchError(f"expected KEY=VALUE with a key of {NAME}, {keys}, got {word[:80]!r}")
    try:
        return key, tomllib.loads(f"v = {text}")["v"]
    except ValueError:
        return key, text


def _candidates() -> dict[str, list[Path]]:
    """Arms and URDFs in this folder."""
    arms = [path.parent for path in Path().glob(f"*/{ARM[0]}") if (path.parent / ARM[1]).is_file()]
    return {"arm": sorted(arms), "urdf": sorted(Path().glob("*.urdf"))}


def _found() -> dict[str, object]:
    """The only arm, the only URDF, and maps beside the tables whose names they have."""
    tables = [path for path in sorted(Path().iterdir()) if path.suffix in TABLES]
    maps = {path.name: path.with_suffix(".toml").name for path in tables if is_map(path.with_suffix(".toml"))}
    return {key: str(paths[0]) for key, paths in _candidates().items() if len(paths) == 1} | {"files": maps}


def _filled(template: str, values: dict[str, object]) -> str:
    """The template with values in place of its examples."""
    lines, maps = template.splitlines(), values.pop("files")
    for k, line in enumerate(lines):
        key, _, rest = line.removeprefix("# ").partition(" = ")
        if key in values and rest:
            lines[k] = (
                f"{key} = {json.dumps(values.pop(key), ensure_ascii=False)}  # {rest.partition('  # ')[2]}"
            )
    assert isinstance(maps, dict)
    lines += [f"\n[files.{json.dumps(name)}]\nmap = {json.dumps(path)}" for name, path in maps.items()]
    return "\n".join(lines) + "\n"
