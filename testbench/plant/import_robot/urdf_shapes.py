"""What a link of a URDF draws and collides with, and where its meshes are."""

import os
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote, urlparse

import numpy as np

from testbench.arm.document import parse_xml
from testbench.errors import Array, InputError, read_text
from testbench.plant.import_robot.chain import Shape, Solid, moved
from testbench.plant.import_robot.mesh_door import MeshError
from testbench.plant.import_robot.meshes import LARGEST, Meshes, check_size
from testbench.plant.import_robot.solids import VISIBLE, solid_shape
from testbench.plant.import_robot.source import inside, need, read_number, read_numbers, read_origin, where

MAX_BYTES = 1_000_000  #: Of a package.xml.
UP = 8  #: Folders above the URDF in which a package is looked for.


def link_shapes(file: Path, link: ET.Element, colours: dict[str, Array], meshes: Meshes) -> tuple[Shape, ...]:
    """All shapes of a link in its frame.

    Args:
        file: The URDF.
        link: Its element.
        colours: The robot's materials by name.
        meshes: Of the whole robot; those that fail are noted there.
    """
    drawn = [s for e in link.findall("visual") for s in _shapes(file, e, colours, meshes)]
    solid = [s for e in link.findall("collision") for s in _shapes(file, e, colours, meshes)]
    if not drawn and link.find("visual") is not None:  # none that can be read
        solid = [replace(s, visual=True) for s in solid]
    return (*drawn, *solid)


def _shapes(file: Path, e: ET.Element, colours: dict[str, Array], meshes: Meshes) -> list[Shape]:
    """Of one <visual> or <collision>."""
    geometry = e.find("geometry")
    if geometry is None or not len(geometry):
        return []
    form, pose, rgba = geometry[0], read_origin(file, e), _colour(file, e, colours)
    if form.tag == "mesh":
        shape = _mesh(file, form, pose, rgba, meshes)
    else:
        solid = _solid(file, form, pose)
        shape = None if solid is None else solid_shape(solid, VISIBLE if rgba is None else rgba)
    if shape is None:
        return []
    return [replace(shape, visual=e.tag == "visual", collides=e.tag == "collision")]


def _colour(file: Path, visual: ET.Element, colours: dict[str, Array]) -> Array | None:
    """Of the element's own material, or of the robot's of that name."""
    material = visual.find("material")
    if material is None:
        return None
    colour = material.find("color")
    if colour is None:
        return colours.get(material.get("name", ""))
    return read_numbers(file, colour, "rgba", "", 4)


def _solid(file: Path, form: ET.Element, pose: Array) -> Solid | None:
    """A primitive; None where it has no extent."""
    if form.tag == "box":
        solid = Solid("box", tuple(map(float, read_numbers(file, form, "size", "", 3) / 2)), pose)
    elif form.tag == "sphere":
        solid = Solid("sphere", (read_number(file, form, "radius", 0),), pose)
    elif form.tag in ("cylinder", "capsule"):
        size = read_number(file, form, "radius", 0), read_number(file, form, "length", 0) / 2
        solid = Solid("cylinder" if form.tag == "cylinder" else "capsule", size, pose)
    else:
        known = "box, sphere, cylinder, capsule or mesh"
        raise InputError(file, where(form), f"expected {known} as a <geometry>")
    if min(solid.size) < 0:
        raise InputError(file, where(form), f"expected sizes of at least 0 m, got {min(solid.size):g}")
    if max(solid.size) > LARGEST:
        raise InputError(file, where(form), f"expected sizes up to {LARGEST:g} m, got {max(solid.size):g}")
    return solid if min(solid.size) > 1e-6 else None


def _mesh(file: Path, form: ET.Element, pose: Array, rgba: Array | None, meshes: Meshes) -> Shape | None:
    """A mesh in the link's frame; None where it cannot be read, which is noted."""
    name, scale = need(file, form, "filename"), read_numbers(file, form, "scale", "1 1 1", 3)
    try:
        mesh = meshes.load(find_mesh(file, name))
        vertices = mesh.vertices * scale
        check_size(vertices)
        outer = moved(mesh.outer * scale, pose)
    except MeshError as err:
        meshes.failed[name.rpartition("/")[2]] = str(err)
        return None
    faces = mesh.faces if np.prod(scale) > 0 else mesh.faces[:, ::-1]  # a mirrored surface turns inside out
    colour = next(c for c in (rgba, mesh.rgba, VISIBLE) if c is not None)
    return Shape(moved(vertices, pose), faces, colour, visual=True, collides=False, outer=outer)


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
    found = inside(folder, file)
    if found is None:
        raise MeshError(f"lies outside of {folder}")
    return found
