"""The mesh files of a stranger's MJCF, read by us and handed to MuJoCo as STL."""

import xml.etree.ElementTree as ET
from pathlib import Path

from testbench.plant.import_robot.mesh_door import MeshError
from testbench.plant.import_robot.meshes import Meshes, check_size
from testbench.plant.import_robot.solids import hull_of
from testbench.plant.import_robot.source import beside, read_numbers
from testbench.plant.import_robot.thin import decimated, stl_bytes

MOST_FACES = 200_000  #: Of a mesh; MuJoCo reads no more.


def read_assets(file: Path, root: ET.Element, folder: Path, meshes: Meshes) -> dict[str, bytes]:
    """The meshes read by us; a mesh that cannot be read goes, with the geoms that show it."""
    assets: dict[str, bytes] = {}
    gone: set[str] = set()
    for asset in root.findall("asset"):
        for e in [e for e in asset.findall("mesh") if "file" in e.attrib]:
            name = e.get("file", "")
            e.set("name", e.get("name") or Path(name).stem)
            try:
                assets[f"{len(assets)}.stl"] = _stl(file, e, folder / name, meshes)
                e.set("file", f"{len(assets) - 1}.stl")
            except MeshError as err:
                meshes.failed[name] = str(err)
                gone.add(e.get("name", ""))
                asset.remove(e)
    for parent in root.iter():
        for geom in [g for g in parent.findall("geom") if g.get("mesh") in gone]:
            parent.remove(geom)
    return assets


def _stl(file: Path, e: ET.Element, path: Path, meshes: Meshes) -> bytes:
    """A mesh file as STL; MuJoCo is told where it is flat."""
    found = beside(file, str(path.absolute()))
    if found is None:
        raise MeshError(f"lies outside of {file.parent}")
    mesh = meshes.load(found)
    check_size(mesh.vertices * read_numbers(file, e, "scale", "1 1 1", 3))
    if hull_of(mesh.outer) is None:
        e.set("inertia", "shell")
    return stl_bytes(*decimated(mesh.vertices, mesh.faces, MOST_FACES))
