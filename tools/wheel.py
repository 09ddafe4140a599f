"""The wheel, in a virtual environment that sees this interpreter's packages, but not the checkout."""

import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PIP = ("-m", "pip", "--quiet", "--disable-pip-version-check", "--no-input")


def build_wheel(source: Path, folder: Path) -> Path:
    """Build the wheel of a source tree, with the build packages that are installed.

    Args:
        source: Folder of pyproject.toml.
        folder: Folder for the wheel, without another one.

    Returns:
        Path of the wheel.
    """
    asked = ["wheel", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", folder, source]
    subprocess.run([sys.executable, *PIP, *asked], check=True)
    [wheel] = folder.glob("*.whl")
    return wheel


def install_wheel(wheel: Path, folder: Path) -> Path:
    """Install a wheel into a new virtual environment.

    Args:
        wheel: Path of the wheel.
        folder: Folder of the environment; one that exists is replaced.

    Returns:
        Path of its Python.
    """
    venv.create(folder, with_pip=False, clear=True)
    python = folder / "bin" / "python"
    install = ["install", "--no-deps", "--no-index", "--no-compile", wheel]
    subprocess.run([sys.executable, *PIP, "--python", python, *install], check=True)
    [site] = (folder / "lib").glob("python3.*/site-packages")
    others = [path for path in sys.path if "site-packages" in Path(path).parts]
    (site / "packages.pth").write_text("\n".join(others) + "\n", encoding="utf-8")
    return python
