"""Plan of a study's trials, and the check that stored ones have the same settings, seeds and versions."""

import hashlib
import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from testbench.errors import BenchError, InputError
from testbench.runs import provenance as files
from testbench.runs.rows import MAX_INTEGER, SEED

FORMAT = "testbench trials 5"


@dataclass(frozen=True)
class TrialPlan:
    """Describe what is tried: a scenario and its seeds."""

    name: str  #: The scenario.
    scenario: Mapping[str, Any]  #: All that the results depend on beside the seed, as plain JSON data.
    seeds: range  #: Seeds of the trials, one after the other from the root: range(root, root + trials).

    def __post_init__(self) -> None:
        if not self.seeds or self.seeds.step != 1 or not 0 <= self.seeds[0] <= self.seeds[-1] < MAX_INTEGER:
            raise BenchError(f"seeds: expected one after the other from 0 to below 2**63, got {self.seeds}")

    @property
    def header(self) -> dict[str, Any]:
        """Return what the store's files say of the plan: plain finite JSON data, or BenchError.

        How many trials is not in it: a study may be resumed with more.
        """
        try:
            scenario = json.dumps(self.scenario, sort_keys=True, separators=(",", ":"), allow_nan=False)
        except (TypeError, ValueError) as err:
            raise BenchError(f"scenario: expected plain JSON data: {err}") from err
        return {
            "format": FORMAT,
            "scenario": self.name,
            "sha256": hashlib.sha256(scenario.encode()).hexdigest(),
            SEED: self.seeds[0],
            "versions": numeric_versions(),
            "settings": json.loads(scenario),
        }


def numeric_versions() -> dict[str, str]:
    """List the versions of Python, of packages that compute and of our sources, which may change results."""
    packages = {k: v for k, v in files.versions().items() if k != "rerun-sdk"}
    python = ".".join(platform.python_version_tuple()[:2])  # without the number of the bug fix
    return {"python": python, **packages, "sources": files.sources()}


def check_header(path: Path, found: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Refuse to go on with trials of something else: InputError names what differs in their header.

    Args:
        path: The file, for the message.
        found: Header of the stored trials.
        wanted: Header of this run.
    """
    pairs = {
        "format": (found.get("format"), wanted["format"]),
        "scenario": (found.get("scenario"), wanted["scenario"]),
        **_differences("", found.get("settings"), wanted["settings"]),
        "sha256 of the settings": (found.get("sha256"), wanted["sha256"]),
        "root seed": (found.get(SEED), wanted[SEED]),
        **_differences("version of ", found.get("versions"), wanted["versions"]),
    }
    for name, (have, want) in pairs.items():
        if have != want:
            raise InputError(
                path,
                "",
                f"{name}: the trials in this folder have {have!r}, this run has {want!r}; "
                "resume with what they were started with, or choose another folder",
            )


def _differences(prefix: str, have: object, want: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Pairs of values by key, of both sides."""
    known = have if isinstance(have, dict) else {}
    return {f"{prefix}{key}": (known.get(key), want.get(key)) for key in sorted({*known, *want})}
