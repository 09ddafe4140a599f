"""TOML and XML as people hand them in: well-formed, without what may reach elsewhere; strict models."""

import os
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Container
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError

from testbench.errors import InputError


class Strict(BaseModel):
    """Tables with these keys and no other, numbers that are finite, nothing converted."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)


SHOWN = 80  #: Characters of a name or value that a message repeats.
UNFIT = "=+-@'"
"""What no name begins with: spreadsheets compute such a cell, and commands take it for a flag."""


def _fit(name: str) -> str:
    if not name.isprintable() or name != name.strip() or name[0] in UNFIT:
        problem = "expected characters that print, no blank at either end, the first none of {unfit}"
        raise PydanticCustomError("name", problem, {"unfit": " ".join(UNFIT)})
    return name


Name = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_fit)]
"""Of a body, joint or marker: letters of any script, and whatever else is seen."""


def inside(folder: Path, file: Path) -> Path | None:
    """A file of a folder, symbolic links followed; None where it lies elsewhere."""
    home = os.path.realpath(folder)
    try:
        real = Path(os.path.realpath(Path(home) / file))
    except ValueError:  # a zero byte
        return None
    return real if real.is_relative_to(home) else None


def unique(name: str, taken: Container[str]) -> str:
    """A name that nothing else has: underscores are put behind it."""
    while name in taken:
        name += "_"
    return name


def parse_toml(path: Path, text: str) -> dict[str, object]:
    """The tables of a file's text.

    Raises:
        InputError: When it is not TOML.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as err:  # also an integer of thousands of digits
        raise InputError(path, "", f"not TOML: {err}") from err


def parse_xml(path: Path, text: str) -> ET.Element:
    """Parse a file's text.

    Returns:
        Its root element.

    Raises:
        InputError: When it is not well-formed, defines entities, or has a number that is none: MuJoCo would
            print a warning of it, and write that into a file.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(path, "", "document types and entities are not allowed")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, LookupError, ValueError) as err:
        raise InputError(path, "", f"not well-formed XML: {err}") from err
    for e in root.iter():
        for key, value in e.attrib.items():
            if "nan" in [word.lstrip("+-") for word in value.lower().split()] and key != "name":
                raise InputError(path, place_of(e), f"{key}: expected numbers, got {value[:SHOWN]!r}")
    return root


def place_of(e: ET.Element) -> str:
    """Name an element of XML for a message: its tag and its name."""
    name = e.get("name", "")[:SHOWN]
    return f"<{e.tag} name={name!r}>" if name else f"<{e.tag}>"
