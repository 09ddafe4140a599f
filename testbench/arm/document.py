"""What the TOML files that people write have in common: strict models, and an error in one line."""

import tomllib
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
