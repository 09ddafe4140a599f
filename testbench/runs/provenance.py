"""Writer of the manifest of a run: all that is needed to run it again."""

import hashlib
import json
import re
import subprocess
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

from testbench import __version__
from testbench.errors import open_file
from testbench.registry import Registry
from testbench.runs.session import SESSION

T = TypeVar("T")
PACKAGE = Path(__file__).resolve().parents[1]  #: Folder of testbench's modules.
ROOT = PACKAGE.parent  #: The checkout, where the package runs from one.
#: Size up to which a file has a digest [byte]: readings that were read before are smaller.
MAX_DIGEST_BYTES = 10**11
NUMBERS = re.compile(
    r"\[\n\s+(-?\d[-+\d.e,\s]*?)\n\s+\]"
)  #: A list of them alone: no text of JSON has a new line.
PACKAGES = ("mujoco", "pin", "numpy", "scipy", "clarabel", "rerun-sdk")


def write_json(value: Any, file: Path) -> None:
    """Write JSON for people and programs: indented, keys in order, no NaN, lists of numbers in a line.

    Args:
        value: Plain data.
        file: The file.
    """
    text = json.dumps(value, indent=2, allow_nan=False)
    one = NUMBERS.sub(lambda found: f"[{' '.join(found[1].split())}]", text)
    file.write_text(one + "\n", encoding="utf-8")


def write_manifest(
    folder: Path,
    *,
    command: str,
    scenario: Any,
    seeds: range,
    models: Mapping[str, Mapping[str, str]],
    **measured: object,
) -> None:
    """Write manifest.json, the last file: what it takes to run again, and the SHA-256 of all files.

    Args:
        folder: Where to.
        command: The script.
        scenario: What was asked for, as plain data.
        seeds: Roots of randomness; empty where nothing is drawn.
        models: Digests of the files of every arm, by its name.
        measured: Of the run itself, such as its seconds, or digests of what it left elsewhere.
    """
    project = SESSION.get().project
    manifest = {
        "command": command,
        "scenario": scenario,
        **({"seed": seeds[0], "seeds": len(seeds)} if seeds else {}),
        **measured,
        **({"project": project} if project else {}),
        "versions": versions(),
        "git": git_commit(ROOT),
        "models": models,
        "files": sorted({*inside(folder), "manifest.json"}),
        "sha256": {name: digest(folder / name) for name in inside(folder) if name != "manifest.json"},
    }
    write_json(manifest, folder / "manifest.json")


def write_log(folder: Path) -> None:
    """Write run.log: what the command did so far, and when; before the manifest, which has its SHA-256."""
    (folder / "run.log").write_text(SESSION.get().log(), encoding="utf-8")


def inside(folder: Path) -> list[str]:
    """List all files of a folder and of folders in it, by their paths in it."""
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def versions() -> dict[str, str]:
    """Collect the versions of packages that numbers depend on, and digests of the parts that users add."""
    packages = {name: _version(name) for name in PACKAGES}
    from testbench.model.joint_laws import joint_laws  # here: they bring MuJoCo, and help needs none
    from testbench.plant.true_arms import true_arms

    return {"testbench": __version__, **packages, **_parts(joint_laws), **_parts(true_arms)}


def _parts(known: Registry[T]) -> dict[str, str]:
    """Collect the SHA-256 of the file of every part that is not ours."""
    return {
        f"{known.kind} {name}": "added by a script" if file is None else digest(file)
        for name, file in known.origins().items()
    }


@cache
def _version(package: str) -> str:
    return metadata.version(package)  # reads all that is said of the package


def sources() -> str:
    """Compute the SHA-256 of this package's sources: its version number stays while they change."""
    whole = hashlib.sha256()
    for file in sorted(PACKAGE.rglob("*.py")):
        whole.update(f"{file.relative_to(PACKAGE).as_posix()}\n".encode() + file.read_bytes())
    return whole.hexdigest()


def digest(file: Path, max_bytes: int = MAX_DIGEST_BYTES) -> str:
    """Compute the SHA-256 of a file; InputError where it is no plain file, or too large.

    Args:
        file: The file.
        max_bytes: Largest size [byte].

    Returns:
        The digest in hexadecimal.
    """
    with open_file(file, max_bytes) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def git_commit(folder: Path) -> str:
    """Commit of a checkout, "-dirty" behind it if changed; "unknown" for any other folder."""
    if not (folder / ".git").exists():  # an installed package may lie inside of another project's checkout
        return "unknown"
    command = ["git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=40"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return done.stdout.strip()
