"""Where a URDF's mesh is: package://NAME/..., file://... and plain paths."""

import os
from pathlib import Path
from urllib.parse import unquote, urlparse

from testbench.arm.document import parse_xml
from testbench.errors import InputError, read_text
from testbench.plant.import_robot.mesh_door import MeshError

MAX_BYTES = 1_000_000  #: Of a package.xml.
UP = 8  #: Folders above the URDF in which a package is looked for.


def find_mesh(urdf: Path, name: str) -> Path:
    """The file of a mesh.

    Args:
        urdf: The URDF that names it.
        name: As it stands there.

    Raises:
        MeshError: When there is none.
    """
    scheme, _, rest = name.strip().replace("\\", "/").partition("://")
    folder = Path(os.path.realpath(urdf)).parent
    if not rest:
        return _inside(folder.parent, folder / scheme)
    if scheme == "file":
        return Path(unquote(urlparse(name.strip()).path))
    if scheme not in ("package", "model"):
        raise MeshError(f"{scheme}:// is not known; package:// and file:// are")
    package, _, path = rest.partition("/")
    roots = _packages(folder, package)
    for root in roots:
        if (root / path).exists():
            return _inside(root, root / path)
    if not roots:
        raise MeshError(f"no package {package!r} beside the file or in {UP} folders above it")
    raise MeshError(f"not in the package {roots[0]}")


def _packages(folder: Path, name: str) -> list[Path]:
    """Folders of a package: of that name, or with a package.xml that says so, from the URDF upwards."""
    if not name or name in (".", ".."):
        return []
    found = []
    for above in [folder, *folder.parents][:UP]:
        found += [root for root in (above, above / name) if root.name == name and root.is_dir()]
        if _package_name(above / "package.xml") == name:
            found.append(above)
    return found


def _package_name(file: Path) -> str:
    try:
        return (parse_xml(file, read_text(file, MAX_BYTES)).findtext("name") or "").strip()
    except InputError:  # there is none, or it is none
        return ""


def _inside(folder: Path, file: Path) -> Path:
    """The file, if it lies in the folder, symbolic links followed."""
    try:
        real = Path(os.path.realpath(file))
    except ValueError as err:  # a zero byte
        raise MeshError("no path") from err
    if not real.is_relative_to(os.path.realpath(folder)):
        raise MeshError(f"lies outside of {folder}")
    return real
