"""The arms that come with testbench: folders in models/, in the checkout or in the installed package."""

from pathlib import Path

from testbench.errors import BenchError

PACKAGE = Path(__file__).resolve().parents[1]
FOLDERS = (PACKAGE / "models", PACKAGE.parent / "models")
"""Where they are: a wheel brings them inside the package."""


def find_arm(name: str) -> Path:
    """The folder of an arm.

    Args:
        name: Of an arm that comes with testbench, such as "kr500_l480", or a path to a folder.

    Raises:
        BenchError: When there is neither.
    """
    if Path(name).is_dir():
        return Path(name)
    found = {folder.name: folder for root in FOLDERS if root.is_dir() for folder in root.iterdir()}
    if name in found:
        return found[name]
    raise BenchError(f"{name}: expected an arm's folder or one of {', '.join(sorted(found))}")
