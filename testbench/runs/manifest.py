"""The manifest of a run: all that is needed to run it again. Those that are read may be untrusted."""

import hashlib
import json
import math
import re
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, JsonValue, ValidationError
from pydantic_core import from_json

from testbench.arm.document import first_invalid_value
from testbench.arm.mjcf import MAX_MESH_BYTES, asset_paths, read_mjcf
from testbench.errors import InputError, open_file, printable, read_bytes, read_text
from testbench.registry import Registry
from testbench.runs.interrupt import SESSION

NAME = "manifest.json"
MAX_BYTES = 16 * 2**20  #: Largest one that is read [byte].
MAX_INTEGER = 2**63  #: Integers of JSON data are below it.


class Manifest(BaseModel):
    """Describe what manifest.json must say of a run, and may say."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    command: str  #: Whose run it is; empty where there is none of ours.
    versions: dict[str, str]
    scenario: JsonValue = None
    seed: int = 0  #: The first one.
    seeds: int = 0  #: How many; none where nothing is drawn.
    git: str = "unknown"
    models: dict[str, dict[str, str]] = {}  #: SHA-256 of every file of every arm's folder.
    files: frozenset[str] = frozenset()  #: By their paths in it.
    sha256: dict[str, str] = {}  #: Of the files, as far as it says.


EMPTY_MANIFEST = Manifest(command="", versions={})


def read_manifest(folder: Path) -> Manifest:
    """Read a folder's manifest.json; EMPTY_MANIFEST where there is none, or it is not one of ours."""
    try:
        found = Manifest.model_validate_json(read_bytes(folder / NAME, MAX_BYTES))
    except (InputError, ValidationError):
        return EMPTY_MANIFEST
    return found if "testbench" in found.versions else EMPTY_MANIFEST


def is_run(folder: Path) -> bool:
    """Tell whether a folder is that of a run, finished or under way."""
    return bool(read_manifest(folder).command) or any(folder.glob("trials/*.parquet"))


REPORTS = "report.json", "plan.json"  #: Numbers of a run, by the name that its command gives them.


@dataclass(frozen=True)
class Finished:
    """Hold a finished run: its folder, manifest and report."""

    folder: Path  #: As it was named.
    manifest: Manifest
    file: Path  #: Where its numbers are: report.json, of a plan plan.json.
    report: Mapping[str, JsonValue]  #: What is in it.
    digest: str  #: SHA-256 of that.

    @property
    def several(self) -> bool:
        """Tell whether numbers are over several seeds."""
        return self.manifest.seeds > 1


def read_run(folder: Path) -> Finished:
    """Read the folder of a finished run.

    Raises:
        InputError: When it is no folder, or manifest.json or report.json is missing or wrong; names the file
            and the place.
    """
    if not folder.is_dir():
        raise InputError(folder, "", f"expected the folder of a run, with {NAME}")
    about, files = folder / NAME, [folder / name for name in REPORTS]
    report = next(filter(Path.is_file, files), files[0])
    try:
        told = Manifest.model_validate_json(json.dumps(read_plain(about)))
    except ValidationError as err:
        raise input_error(about, err) from err
    plain = read_plain(report)
    if not isinstance(plain, dict):
        raise InputError(report, "", f"expected a table of keys, got {type(plain).__name__}")
    text = json.dumps(plain, sort_keys=True)
    return Finished(folder, told, report, plain, hashlib.sha256(text.encode()).hexdigest())


def input_error(file: Path, err: ValidationError) -> InputError:
    """Make the first finding of pydantic in a file an error of one line.

    Args:
        file: The file.
        err: What pydantic found.

    Returns:
        The error.
    """
    keys, _, problem = first_invalid_value(err)
    return InputError(file, ".".join(map(str, keys)), problem)


def read_plain(path: Path) -> JsonValue:
    """Read JSON data; what would steer a terminal or a browser in its texts is replaced.

    Raises:
        InputError: When the file cannot be read, is too large or too deep, is no JSON, or has a number that
            is infinite or too large; names the place.
    """
    text = read_text(path, MAX_BYTES)
    try:
        found: JsonValue = from_json(text, allow_inf_nan=False)
    except ValueError as err:  # also one of thousands of digits, and data that are too deep
        raise InputError(path, "", f"not JSON: {err}") from err
    return _checked(path, found, ())


def _checked(path: Path, value: JsonValue, place: tuple[str, ...]) -> JsonValue:
    """Check numbers and clean texts of JSON data; the keys of `place` lead to them."""
    if isinstance(value, dict):
        cleaned = {printable(key): own for key, own in value.items()}
        return {key: _checked(path, own, (*place, key)) for key, own in cleaned.items()}
    if isinstance(value, list):
        return [_checked(path, own, (*place, str(k))) for k, own in enumerate(value)]
    if isinstance(value, str):
        return "\n".join(map(printable, value.split("\n")))
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(path, ".".join(place), f"expected a finite number, got {value}")
    if isinstance(value, int) and not -MAX_INTEGER <= value < MAX_INTEGER:
        raise InputError(path, ".".join(place), "expected an integer of 64 bits, got a larger one")
    return value


PACKAGE = Path(__file__).resolve().parents[1]  #: Folder of testbench's modules.
ROOT = PACKAGE.parent  #: The checkout, where the package runs from one.
#: Size up to which a file has a digest [byte]: readings that were read before are smaller.
MAX_DIGEST_BYTES = 10**11
NUMBERS = re.compile(
    r"\[\n\s+(-?\d[-+\d.e,\s]*?)\n\s+\]"
)  #: A list of them alone: no text of JSON has a new line.
DISTRIBUTION = "robot-testbench"  #: Our own package, by the name under which pip installs it.
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
    tables: Sequence[Registry[Any]] = (),
    **measured: object,
) -> None:
    """Write manifest.json, the last file: what it takes to run again, and the SHA-256 of all files.

    Args:
        folder: Where to.
        command: The script.
        scenario: What was asked for, as plain data.
        seeds: Roots of randomness; empty where nothing is drawn.
        models: Digests of the files of every arm, by its name.
        tables: Tables of the parts that a simulation uses, see `versions`.
        measured: Of the run itself, such as its seconds, or digests of what it left elsewhere.
    """
    project = SESSION.get().project
    manifest = {
        "command": command,
        "scenario": scenario,
        **({"seed": seeds[0], "seeds": len(seeds)} if seeds else {}),
        **measured,
        **({"project": project} if project else {}),
        "versions": versions(*tables),
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


def versions(*tables: Registry[Any]) -> dict[str, str]:
    """Collect the versions of packages that numbers depend on, and digests of the parts that users add.

    Args:
        tables: Tables of parts beside the joint laws, such as true arms in a simulation.

    Returns:
        Versions by package, and SHA-256 by part.
    """
    packages = {name: _version(name) for name in PACKAGES}
    from testbench.model.laws import joint_laws  # here: they bring MuJoCo, and help needs none

    parts = {name: sha for known in (joint_laws, *tables) for name, sha in _parts(known).items()}
    return {"testbench": _version(DISTRIBUTION), **packages, **parts}


def _parts(known: Registry[Any]) -> dict[str, str]:
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


ARM_FILES = ("rigid.xml", "elastic.toml")  #: Of an arm's folder.
DOCUMENT, POSTERIOR = "model.json", "posterior.npz"  #: What an identified model adds to them.
MAX_ROOT = 300_000_000  #: Largest posterior.npz when it is unpacked [byte].


def arm_files(folder: Path) -> tuple[str, ...]:
    """List the files of an arm with its meshes, by their paths in its folder."""
    rigid = folder / ARM_FILES[0]
    return (*ARM_FILES, *asset_paths(rigid, read_mjcf(rigid)))


def digests(folders: Iterable[Path]) -> dict[str, dict[str, str]]:
    """Compute the SHA-256 of every file of arms, or of models of arms.

    Args:
        folders: Folders of the arms or models.

    Returns:
        Digests by the folder's name and the file's path in it.
    """
    found = {}
    for folder in folders:
        model = {name: MAX_ROOT for name in (DOCUMENT, POSTERIOR) if (folder / name).is_file()}
        sizes = dict.fromkeys(arm_files(folder), MAX_MESH_BYTES) | model
        found[folder.resolve().name] = {name: digest(folder / name, k) for name, k in sizes.items()}
    return found


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
