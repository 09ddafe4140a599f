"""TOML and XML as people hand them in: well-formed, without what may reach elsewhere; strict models."""

import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from testbench.errors import InputError


class Strict(BaseModel):
    """Tables with these keys and no other, numbers that are finite, nothing converted."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)


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
    """The root element of a file's text.

    Raises:
        InputError: When it is not well-formed, or defines entities.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(path, "", "document types and entities are not allowed")
    try:
        return ET.fromstring(text)
    except (ET.ParseError, LookupError, ValueError) as err:
        raise InputError(path, "", f"not well-formed XML: {err}") from err
