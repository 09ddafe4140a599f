"""TOML and XML of users: parsed if well-formed, without references to the outside; strict data models."""

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
    """Base of data models that admit their keys alone and finite numbers, and convert nothing."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)


MAX_SHOWN = 80  #: Most characters of a name or value that a message repeats.
UNFIT = "=+-@'"
"""Characters that no name begins with: spreadsheets compute such a cell, and commands take it for a flag."""


def _fit(name: str) -> str:
    """Refuse a name that does not print, has blanks at an end, or begins with a character of `UNFIT`."""
    if not name.isprintable() or name != name.strip() or name[0] in UNFIT:
        problem = "expected characters that print, no blank at either end, the first none of {unfit}"
        raise PydanticCustomError("name", problem, {"unfit": " ".join(UNFIT)})
    return name


Name = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_fit)]
"""Name of a body, joint or marker: 1 to 64 printing characters of any script."""


def inside(folder: Path, file: Path) -> Path | None:
    """Resolve a file of a folder, symbolic links followed.

    Args:
        folder: The folder.
        file: Path of the file from the folder.

    Returns:
        The real path; None where it lies outside the folder or cannot be a path.
    """
    home = os.path.realpath(folder)
    try:
        real = Path(os.path.realpath(Path(home) / file))
    except ValueError:  # a zero byte
        return None
    return real if real.is_relative_to(home) else None


def unique(name: str, taken: Container[str]) -> str:
    """Make a name that is not taken, by appending underscores.

    Args:
        name: Name to begin with.
        taken: Names in use.

    Returns:
        The name, unchanged if it is free.
    """
    while name in taken:
        name += "_"
    return name


def parse_toml(path: Path, text: str) -> dict[str, object]:
    """Parse the text of a TOML file.

    Args:
        path: The file, for messages.
        text: Its text.

    Returns:
        Its tables and values by key.

    Raises:
        InputError: When it is not TOML.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as err:  # also an integer of thousands of digits
        raise InputError(path, "", f"not TOML: {err}") from err


def parse_xml(path: Path, text: str) -> ET.Element:
    """Parse the text of an XML file.

    Args:
        path: The file, for messages.
        text: Its text.

    Returns:
        Its root element.

    Raises:
        InputError: When it is not well-formed, defines entities, or has an attribute that contains nan:
            MuJoCo would print a warning, and write it into a file.
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
                raise InputError(path, place_of(e), f"{key}: expected numbers, got {value[:MAX_SHOWN]!r}")
    return root


def place_of(e: ET.Element) -> str:
    """Name an XML element for a message, by its tag and name attribute."""
    name = e.get("name", "")[:MAX_SHOWN]
    return f"<{e.tag} name={name!r}>" if name else f"<{e.tag}>"
