"""The arms that come with testbench: folders in models/, in the checkout or in the installed package."""

import os
from pathlib import Path

from testbench.errors import InputError

PACKAGE = Path(__file__).resolve().parents[1]
FOLDERS = (PACKAGE / "models", PACKAGE.parent / "models")
"""Where they are: a wheel brings them inside the package."""


def find_arm(name: str | Path) -> Path:
    """The folder of an arm, by its path or the name of one that comes with testbench; it is not read.

    Raises:
        InputError: When there is neither.
    """
    if os.path.isdir(name):  # noqa: PTH112 - a name too long is no folder either
        return Path(name)
    found = {folder.name: folder for root in FOLDERS if root.is_dir() for folder in sorted(root.iterdir())}
    if str(name) in found:
        return found[str(name)]
    ours = ", ".join(sorted(found))
    raise InputError(Path(name), "", f"expected a folder with rigid.xml and elastic.toml, or one of {ours}")
