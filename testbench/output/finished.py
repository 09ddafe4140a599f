"""A finished run as its folder tells of it, perhaps a stranger's: plain JSON data, finite, of modest size."""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict, JsonValue, ValidationError
from pydantic_core import from_json

from testbench.errors import InputError, read_text, shown
from testbench.output import manifest

REPORT = "report.json"
MOST, LONGEST = 16 * 2**20, 20_000
"""Largest file [byte] and longest text in it [characters] that are read."""
LARGEST = 2**63  #: Integers lie below.


class Manifest(BaseModel):
    """What manifest.json must say of a run, and may say."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    command: str
    scenario: JsonValue
    seed: int = 0  #: The first one.
    seeds: int = 0  #: How many; none where nothing is drawn.
    versions: dict[str, str]
    git: str = "unknown"
    models: dict[str, dict[str, str]] = {}  #: SHA-256 of every file of every arm's folder.


@dataclass(frozen=True)
class Finished:
    """A run."""

    folder: Path  #: As it was named.
    manifest: Manifest
    report: Mapping[str, JsonValue]  #: report.json.
    digest: str  #: SHA-256 of the data in report.json.

    @property
    def file(self) -> Path:
        """Where the report is."""
        return self.folder / REPORT

    @property
    def several(self) -> bool:
        """Whether numbers are over several seeds."""
        return self.manifest.seeds > 1


def read_run(folder: Path) -> Finished:
    """What the folder of a finished run says.

    Raises:
        InputError: When manifest.json or report.json is missing or is none; names the file and the place.
    """
    about, report = folder / manifest.NAME, folder / REPORT
    data = read_plain(about)
    try:
        told = Manifest.model_validate(data)
    except ValidationError as err:
        raise told_as(about, err) from err
    plain = read_plain(report)
    if not isinstance(plain, dict):
        raise InputError(report, "", f"expected a table of keys, got {type(plain).__name__}")
    text = json.dumps(plain, sort_keys=True)
    return Finished(folder, told, plain, hashlib.sha256(text.encode()).hexdigest())


def told_as(file: Path, err: ValidationError) -> InputError:
    """The first finding of pydantic in a file, in one line."""
    first = err.errors(include_url=False, include_context=False)[0]
    place = ".".join(map(str, first["loc"]))
    if first["type"] == "missing":
        return InputError(file, place, "expected it, there is none")
    return InputError(file, place, f"{first['msg']}, got {str(first.get('input'))[:80]!r}")


def read_plain(path: Path) -> JsonValue:
    """JSON data with finite numbers and texts of printable characters.

    Raises:
        InputError: When the file cannot be read, is too large or too deep, is no JSON, or has a number that
            is not finite; names the place.
    """
    text = read_text(path, MOST)
    try:
        found: JsonValue = from_json(text)
    except ValueError as err:  # also one of thousands of digits, and data that are too deep
        raise InputError(path, "", f"not JSON: {err}") from err
    try:
        return _checked(found)
    except _Wrong as err:
        raise InputError(path, ".".join(reversed(err.place)), str(err)) from err


class _Wrong(Exception):
    """A value that is no data of ours, with the keys that lead to it, the innermost first."""

    def __init__(self, problem: str) -> None:
        super().__init__(problem)
        self.place: list[str] = []


def _checked(value: JsonValue) -> JsonValue:
    if isinstance(value, dict):
        return {_text(key): _at(key, own) for key, own in value.items()}
    if isinstance(value, list):
        return [_at(k, own) for k, own in enumerate(value)]
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, float) and not math.isfinite(value):
        raise _Wrong(f"expected a finite number, got {value}")
    if isinstance(value, int) and not -LARGEST <= value < LARGEST:
        raise _Wrong("expected an integer of 64 bits, got a larger one")
    return value


def _at(key: object, value: JsonValue) -> JsonValue:
    try:
        return _checked(value)
    except _Wrong as err:
        err.place.append(str(key)[:80])
        raise


def _text(text: str) -> str:
    """The text; what would steer a terminal is replaced."""
    if len(text) > LONGEST:
        raise _Wrong(f"expected a text of at most {LONGEST} characters, got {len(text)}")
    return "\n".join(map(shown, text.split("\n")))
