"""What a trial store holds, line by line: a header that says what is tried, then a line a finished trial.

The lines are JSON with Python's NaN, Infinity and -Infinity, so that every float comes back bit by bit.
"""

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from testbench import files
from testbench.errors import BenchError, InputError
from testbench.trials.rows import Value, flatten

FORMAT = "testbench trials 1"
MAX_LINE = 64 * 2**20
"""Longest line that is read [byte]."""
LARGEST = 2**63
"""Integers of a row lie below it: Parquet's have 64 bits."""
SEED = "seed"

Row = dict[str, Value]
Rows = list[Row]
"""What one trial found: flat rows of numbers and words; None is a missing value, NaN a number."""


@dataclass(frozen=True)
class Experiment:
    """What is tried.

    Attributes:
        name: The scenario.
        scenario: All that the results depend on beside the seed, as plain JSON data.
        seeds: Seeds of the trials, one after the other from the root: range(root, root + trials).
    """

    name: str
    scenario: Mapping[str, Any]
    seeds: range

    def __post_init__(self) -> None:
        if not self.seeds or self.seeds.step != 1 or not 0 <= self.seeds[0] <= self.seeds[-1] < LARGEST:
            raise BenchError(f"seeds: expected one after the other from 0 to below 2**63, got {self.seeds}")

    @property
    def header(self) -> dict[str, Any]:
        """The first line of its store. How many trials is not in it: a study may be resumed with more."""
        scenario = canonical(self.scenario)
        return {
            "format": FORMAT,
            "scenario": self.name,
            "sha256": hashlib.sha256(scenario.encode()).hexdigest(),
            SEED: self.seeds[0],
            "versions": numeric_versions(),
            "settings": json.loads(scenario),
        }


@dataclass(frozen=True)
class Line:
    """A whole line of a store: its number from 1, where it starts and ends [byte], what it says."""

    number: int
    start: int
    end: int
    entry: dict[str, Any]


def canonical(scenario: Mapping[str, Any]) -> str:
    """The one way to write a scenario as JSON.

    Raises:
        BenchError: When it is no plain finite JSON data.
    """
    try:
        return json.dumps(scenario, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError) as err:
        raise BenchError(f"scenario: expected plain JSON data: {err}") from err


def numeric_versions() -> dict[str, str]:
    """Versions of Python, of the packages that compute and of our sources: other ones may change results."""
    packages = {k: v for k, v in files.versions().items() if k != "rerun-sdk"}
    python = python_release(platform.python_version_tuple())
    return {"python": python, **packages, "sources": files.sources()}


def python_release(version: Sequence[str]) -> str:
    """Python's version without the number of the bug fix."""
    return ".".join(version[:2])


def write_line(entry: Mapping[str, Any]) -> bytes:
    """An entry as a line of the store."""
    return json.dumps(entry, separators=(",", ":")).encode() + b"\n"


def read_lines(path: Path, file: BinaryIO) -> Iterator[Line]:
    """The whole lines of a store from its start; a torn last one is left out.

    Raises:
        InputError: At the first line that is too long or no JSON object.
    """
    number, start = 0, 0
    while raw := file.readline(MAX_LINE):
        number += 1
        whole = raw.endswith(b"\n")
        if not whole and len(raw) < MAX_LINE:
            return
        end = start + len(raw)
        yield Line(number, start, end, _parse(path, number, raw if whole else b""))
        start = end


def _parse(path: Path, number: int, raw: bytes) -> dict[str, Any]:
    try:
        entry = json.loads(raw)
    except (ValueError, RecursionError):
        entry = None
    if not isinstance(entry, dict):
        raise corrupt(path, number, f"no JSON object of less than {MAX_LINE} bytes")
    return entry


def corrupt(path: Path, number: int, problem: str) -> InputError:
    """The error of a damaged line."""
    return InputError(
        path, f"line {number}", f"{problem}: the store is damaged; move it away to start afresh"
    )


def check_header(path: Path, entry: Mapping[str, Any], study: Experiment) -> None:
    """Refuse to go on with trials of something else.

    Raises:
        InputError: Naming what differs.
    """
    if (found := entry.get("format")) != FORMAT:
        raise corrupt(path, 1, f"expected format {FORMAT!r}, got {found!r}")
    wanted = study.header
    pairs = {
        "scenario": (entry.get("scenario"), wanted["scenario"]),
        **_differences("", entry.get("settings"), wanted["settings"]),
        "sha256 of the settings": (entry.get("sha256"), wanted["sha256"]),
        "root seed": (entry.get(SEED), wanted[SEED]),
        **_differences("version of ", entry.get("versions"), wanted["versions"]),
    }
    for name, (have, want) in pairs.items():
        if have != want:
            raise InputError(
                path,
                "line 1",
                f"{name}: the trials in this folder have {have!r}, this run has {want!r}; "
                "resume with what they were started with, or choose another folder",
            )


def _differences(prefix: str, have: object, want: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Pairs of values by key, of both sides."""
    known = have if isinstance(have, dict) else {}
    return {f"{prefix}{key}": (known.get(key), want.get(key)) for key in sorted({*known, *want})}


def check_trial(path: Path, line: Line, root: int) -> int:
    """The seed of a stored trial.

    Raises:
        InputError: When the line is not a trial of this root.
    """
    seed = line.entry.get(SEED)
    if isinstance(seed, bool) or not isinstance(seed, int) or not root <= seed < LARGEST:
        raise corrupt(path, line.number, f"seed: expected an integer from {root} on, got {str(seed)[:40]}")
    try:
        plain_rows(line.entry.get("rows"))
    except ValueError as err:
        raise corrupt(path, line.number, str(err)) from err
    return seed


def plain_rows(rows: object) -> Rows:
    """Rows with numpy's numbers as Python's.

    Raises:
        ValueError: When they are not flat rows of numbers and words.
    """
    if isinstance(rows, list | tuple):
        rows = [flatten(row) if is_dataclass(row) else row for row in rows]
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        raise ValueError("rows: expected a list of dicts")
    return [{_name(key): _plain(key, value) for key, value in row.items()} for row in rows]


def _name(key: object) -> str:
    if not isinstance(key, str) or key == SEED:
        raise ValueError(f"rows: expected columns with names other than {SEED!r}, got {key!r}")
    key.encode()  # a lone surrogate raises a ValueError: Parquet holds UTF-8
    return key


def _plain(key: str, value: object) -> Any:
    if isinstance(value, list | tuple):
        return [_plain(key, v) for v in value]
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, str):
        plain.encode()
    if not (plain is None or isinstance(plain, float | int | str)):
        raise ValueError(f"rows: {key}: expected a number, a word or None, got {type(plain).__name__}")
    if isinstance(plain, int) and not -LARGEST <= plain < LARGEST:
        raise ValueError(f"rows: {key}: expected integers of 64 bits, got one of {plain.bit_length()}")
    return plain
