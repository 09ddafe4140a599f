"""Files in the folder of an arm and of its model: copied, and identified by their SHA-256."""

import shutil
from collections.abc import Iterable
from pathlib import Path

from testbench.arm.folder import Arm
from testbench.arm.mjcf import MAX_MESH_BYTES, assets, read_mjcf
from testbench.errors import open_file
from testbench.runs import manifest as files

DOCUMENT, POSTERIOR, FITS = "model.json", "posterior.npz", "models.json"
ARM = ("rigid.xml", "elastic.toml")  #: Of the arm's folder.
MAX_BYTES, MAX_ROOT = 50_000_000, 300_000_000
"""Largest model.json, and posterior.npz when it is unpacked [byte]."""


def copy_arm(arm: Arm, folder: Path) -> None:
    """Copy the files of an arm with its meshes.

    Args:
        arm: The arm.
        folder: Folder to copy to.
    """
    path = arm.rigid.parent
    for name in _arm_files(path):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        with open_file(path / name, MAX_MESH_BYTES) as source, (folder / name).open("wb") as copy:
            shutil.copyfileobj(source, copy)


def _arm_files(folder: Path) -> tuple[str, ...]:
    """The files of an arm by their paths in its folder: what else lies there is none of ours."""
    rigid = folder / ARM[0]
    return (*ARM, *assets(rigid, read_mjcf(rigid)))


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
        sizes = dict.fromkeys(_arm_files(folder), MAX_MESH_BYTES) | model
        found[folder.resolve().name] = {name: files.digest(folder / name, k) for name, k in sizes.items()}
    return found
