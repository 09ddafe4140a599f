"""Results on disk: all of a run or nothing of it."""

import contextlib
import hashlib
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from testbench import __version__
from testbench.errors import InputError

ROOT = Path(__file__).resolve().parents[1]  #: The checkout, where the package runs from one.
PACKAGES = ("mujoco", "pin", "numpy", "scipy", "clarabel", "rerun-sdk")


@contextlib.contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """A scratch folder whose files replace those in `out` once the block has ended well.

    After an error or Ctrl-C the earlier results stand as they were.

    Args:
        out: Folder of the results; made where it does not exist.

    Raises:
        InputError: When the folder cannot be made or written.
    """
    fresh = not out.exists()
    try:
        out.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=".new-", dir=out))
    except OSError as err:
        raise InputError(out, "", f"cannot be written: {err.strerror}") from err
    try:
        yield scratch
        for file in sorted(scratch.iterdir()):
            file.replace(out / file.name)
    except OSError as err:
        raise InputError(Path(err.filename or out), "", f"cannot be written: {err.strerror}") from err
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        if fresh and not any(out.iterdir()):
            out.rmdir()


@contextlib.contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """A scratch folder that becomes `out` once the block has ended well; nothing is left of it otherwise.

    Args:
        out: A folder that does not exist yet.

    Raises:
        InputError: When it exists, or cannot be made or written.
    """
    if os.path.lexists(out):
        raise InputError(out, "", "exists already; expected the name of a new folder")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=".new-", dir=out.parent))
    except OSError as err:
        raise InputError(out, "", f"cannot be written: {err.strerror}") from err
    try:
        (scratch / out.name).mkdir()
        yield scratch / out.name
        (scratch / out.name).rename(out)
    except OSError as err:
        raise InputError(Path(err.filename or out), "", f"cannot be written: {err.strerror}") from err
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def write_whole(text: str, path: Path) -> None:
    """Write a text file; an existing one is replaced only by a whole one.

    Raises:
        InputError: When the file cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        part.write_bytes(text.encode())
        part.replace(path)
    except OSError as err:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise InputError(path, "", f"cannot be written: {err.strerror}") from err


def write_json(value: Any, file: Path) -> None:
    """Write JSON for people and programs: indented, keys in their order, no NaN."""
    file.write_text(json.dumps(value, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def write_manifest(
    folder: Path, *, command: str, scenario: Any, seeds: range, arms: Sequence[Path], **measured: float
) -> None:
    """manifest.json: what it takes to run a study again.

    Args:
        folder: Where to.
        command: The script.
        scenario: What was asked for, as plain data.
        seeds: Roots of randomness.
        arms: Folders of the arms.
        measured: Of the run itself, such as its seconds.
    """
    manifest = {
        "command": command,
        "scenario": scenario,
        "seed": seeds[0],
        "seeds": len(seeds),
        **measured,
        "versions": versions(),
        "git": git_commit(ROOT),
        "models": {arm.resolve().name: digests(arm) for arm in arms},
    }
    write_json(manifest, folder / "manifest.json")


def versions() -> dict[str, str]:
    """Versions of the packages that numbers depend on."""
    return {"testbench": __version__, **{name: metadata.version(name) for name in PACKAGES}}


def sources() -> str:
    """SHA-256 of this package's sources: its version number stays while they change."""
    package = Path(__file__).parent
    whole = hashlib.sha256()
    for file in sorted(package.rglob("*.py")):
        whole.update(f"{file.relative_to(package).as_posix()}\n".encode() + file.read_bytes())
    return whole.hexdigest()


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file of an arm's folder, by its path in it."""
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


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
