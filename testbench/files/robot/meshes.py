"""Mesh files of a robot, STL, OBJ, PLY and COLLADA: read as triangles of one colour, reduced, and written.

Primitives as triangles, and masses of closed surfaces.
"""

import io
import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from testbench.errors import Array, InputError, read_bytes
from testbench.files.robot.robot import ImportedMesh, Note
from testbench.plant.shapes import (
    Faces,
    GeomKind,
    Surface,
    convex_hull_vertices,
    half_sizes,
    primitive_surface,
)

MIN_INERTIA = 1e-9
"""Least moment of inertia of a body about any axis [kg m^2]."""
Weighed = tuple[float, Array, Array]
"""Mass [kg] or volume [m^3], its centre, (3,) [m], and inertia about that, (3, 3) [kg m^2] or [m^5]."""
VISIBLE = np.array([0.6, 0.6, 0.6, 1.0])
"""Colour if the file states none."""


def primitive(kind: GeomKind, size: Array) -> ImportedMesh:
    """Make the surface of a primitive in its own axes.

    Args:
        kind: Name of the primitive in MuJoCo, such as "capsule".
        size: Its half sizes or radius in MuJoCo's convention, (3,) [m].

    Returns:
        Its triangles.
    """
    corners, faces = primitive_surface(kind, half_sizes(kind, size))
    return ImportedMesh(corners, faces, corners)


def integrals(surface: Surface) -> Weighed:
    """Compute volume, centroid and inertia of a closed surface.

    Args:
        surface: Its vertices [m] and faces.

    Returns:
        Volume [m^3], centroid, (3,) [m], and inertia about it at unit density, (3, 3) [m^5].
    """
    import trimesh  # takes as long to import as MuJoCo

    found = trimesh.triangles.mass_properties(surface[0][surface[1]])
    return float(found.volume), found.center_mass, np.asarray(found.inertia)


def combined(parts: Sequence[Weighed]) -> Weighed:
    """Combine bodies to one mass, centre of mass and inertia, by the parallel axis theorem.

    With d from the common centre to that of a body, it adds I + m (d^T d 1 - d d^T).

    Args:
        parts: Mass m [kg], centre of mass, (3,) [m], and inertia I about it, (3, 3) [kg m^2], of each body.

    Returns:
        The same of all bodies; zeros if they have no mass.
    """
    mass = sum(own for own, _, _ in parts)
    if mass == 0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    centre = sum((own * c for own, c, _ in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for own, c, tensor in parts:
        d = c - centre
        inertia += tensor + own * (d @ d * np.eye(3) - np.outer(d, d))
    return mass, centre, inertia


def plausible(inertia: Array) -> Array:
    """Compute the nearest inertia that a body can have: no principal moment exceeds the sum of the others.

    Args:
        inertia: Any inertia about the centre of mass, (3, 3) [kg m^2].

    Returns:
        Inertia with positive integrals of x^2, y^2 and z^2 over the mass, (3, 3) [kg m^2].
    """
    moments, axes = np.linalg.eigh((inertia + inertia.T) / 2)
    least = max(MIN_INERTIA, 1e-6 * float(np.abs(moments).max()))
    second = np.maximum(moments.sum() / 2 - moments, least / 2)  # integrals of x^2, y^2, z^2
    return np.asarray(axes @ np.diag(second.sum() - second) @ axes.T)


MESH_SUFFIXES = ("stl", "obj", "ply", "dae")
MAX_BYTES = 64_000_000
"""Largest mesh file [byte]."""
MAX_TOTAL = 100_000_000
"""Largest size of all mesh files of a robot [byte]."""
MAX_FACES = 500_000
"""Most triangles of a mesh."""
MAX_ALL_FACES = 1_000_000
"""Most triangles of a robot, counted as often as a mesh is used."""
MAX_MESH_SIZE = 30.0
"""Largest size of a mesh [m]; beyond it the unit is wrong."""
CELLS = 2**20 - 1
"""Cells of the grid from the origin on which corners of one place are merged."""


class MeshError(Exception):
    """Report a mesh that cannot be read; the import continues without it and notes it."""


@dataclass(eq=False)
class Meshes:
    """Hold the mesh files that were read, each once, and those that could not be read, with the reasons."""

    read: dict[Path, ImportedMesh] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    size: int = 0  #: Size of all that was read [byte].
    faces: int = 0  #: Triangles of all that was requested.

    def load(self, file: Path) -> ImportedMesh:
        """Read the triangles of a file; every file is read once.

        Args:
            file: The mesh file.

        Returns:
            The mesh.

        Raises:
            MeshError: If the file cannot be read, or all meshes together are too large.
        """
        if file not in self.read:
            kind = file.suffix[1:].lower()
            if kind not in MESH_SUFFIXES:
                raise MeshError(f"expected a mesh: {', '.join(MESH_SUFFIXES)}")
            _check("triangles in all shapes", self.faces, MAX_ALL_FACES)
            try:
                data = read_bytes(file, MAX_BYTES)
            except InputError as err:
                raise MeshError(str(err).removeprefix(f"{file}: ")) from err
            self.size += len(data)
            _check("bytes in all meshes", self.size, MAX_TOTAL)
            vertices, faces, rgba = _parsed(data, kind)
            self.read[file] = ImportedMesh(vertices, faces, convex_hull_vertices(vertices), rgba)
        self.faces += len(self.read[file].faces)
        _check("triangles in all shapes", self.faces, MAX_ALL_FACES)
        return self.read[file]

    def notes(self) -> list[Note]:
        """List the meshes that the arm lacks, with the reasons."""
        names = tuple(f"{name} ({why})" for name, why in self.failed.items())
        return [Note("meshes", names)] if names else []


def _check(what: str, count: int, most: int) -> None:
    """Refuse too much of something: beyond the limit, no further mesh is read."""
    if count > most:
        raise MeshError(f"expected at most {most} {what}, got {count}; simplify the mesh")


def _parsed(data: bytes, kind: str) -> tuple[Array, Faces, Array | None]:
    """Parse corners, each place once, triangles and colour; any failure of a parser is a MeshError."""
    try:
        with warnings.catch_warnings(action="ignore"):  # of numbers too large, which are refused below
            vertices, faces, rgba = _triangles(data, kind)
    except MeshError:
        raise
    except Exception as err:  # parsers fail in every way on untrusted files
        why = " ".join(str(err).split())[:120] or type(err).__name__
        raise MeshError(f"not read as {kind}: {why}") from err
    if not np.isfinite(vertices).all():
        raise MeshError("expected finite numbers")
    _check("triangles", len(faces), MAX_FACES)
    vertices, faces = _welded(vertices, faces)
    if not len(faces):
        raise MeshError("no triangle has an area")
    return vertices, faces, rgba


def _triangles(data: bytes, kind: str) -> tuple[Array, Faces, Array | None]:
    """Parse corners, triangles and colour, without checks."""
    import trimesh

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # what it says of textures is not for the user
    data = _as_utf8(data, kind)
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=None, process=False)
    parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    if not parts:
        raise MeshError(f"no triangles in this {kind}")
    vertices, faces = joined([(p.vertices, p.faces) for p in parts])
    # metres in a unit as COLLADA states it; its up axis is ignored, as by robots' viewers
    units = str(scene.units or "")
    return vertices * (float(units.partition(" ")[0]) if "*" in units else 1.0), faces, _main_colour(parts)


def _as_utf8(data: bytes, kind: str) -> bytes:
    """Turn text of an older encoding into UTF-8; refuse a binary STL of another length than it states.

    trimesh reads a binary STL of a wrong length as text, and guesses an encoding by a package that may be
    missing.
    """
    if kind not in ("stl", "obj"):
        return data
    stated = 84 + 50 * int.from_bytes(data[80:84], "little")
    if kind == "stl" and len(data) == stated:
        return data
    try:
        data.decode()
    except UnicodeDecodeError as err:
        if kind == "stl" and not data.lstrip().startswith(b"solid"):
            raise MeshError(f"expected {stated} bytes of binary STL, got {len(data)}: cut short?") from err
        return data.decode("latin-1").encode()
    return data


def _main_colour(parts: Sequence[object]) -> Array | None:
    """Find the colour with the most area in a COLLADA or OBJ file."""
    areas: dict[tuple[float, ...], float] = {}
    for part in parts:
        colour = _colour(part)
        if colour is not None:
            areas[colour] = areas.get(colour, 0.0) + float(getattr(part, "area", 0.0))
    return np.array(max(areas, key=lambda colour: areas[colour])) if areas else None


def _colour(part: object) -> tuple[float, ...] | None:
    """Return the colour of one part; None if the file states none."""
    material = getattr(getattr(part, "visual", None), "material", None)
    colour = getattr(material, "main_color", None)
    if colour is None or getattr(material, "name", "") == "material_0":  # trimesh's own grey
        return None
    return tuple(float(x) / 255 for x in colour[:4])


def _welded(vertices: Array, faces: Faces) -> Surface:
    """Merge corners in one place; drop triangles without area."""
    unit = float(np.abs(vertices).max()) / CELLS or 1.0
    first, inverse = distinct(vertices / unit + CELLS)
    return vertices[first], with_area(inverse[faces])


def distinct(cells: npt.NDArray[np.number]) -> tuple[Faces, Faces]:
    """Group rows of three numbers from 0 to 2 CELLS that are equal after rounding.

    Args:
        cells: The rows, (k, 3).

    Returns:
        The first row of each group, in rising order of the groups, and the group of every row.
    """
    number = np.round(cells).astype(np.int64) @ np.array([1 << 42, 1 << 21, 1])
    _, first, kind = np.unique(number, return_index=True, return_inverse=True)
    return first, kind


def joined(surfaces: Sequence[Surface]) -> Surface:
    """Join several surfaces to one.

    Args:
        surfaces: Vertices, (v, 3), and faces, (f, 3), of each.

    Returns:
        Vertices and faces of all.
    """
    import trimesh

    vertices, faces = trimesh.util.append_faces([v for v, _ in surfaces], [f for _, f in surfaces])
    return np.asarray(vertices, dtype=float), np.asarray(faces, dtype=int)


def with_area(faces: Faces) -> Faces:
    """Keep the triangles with three different corners.

    Args:
        faces: Indices of the corners, (f, 3).

    Returns:
        The triangles that are kept, (g, 3).
    """
    a, b, c = faces.T
    return np.asarray(faces[(a != b) & (b != c) & (c != a)])


def check_size(vertices: Array) -> None:
    """Refuse a surface that cannot be a robot's in metres.

    Args:
        vertices: Its vertices, (v, 3) [m].

    Raises:
        MeshError: When it is larger than MAX_MESH_SIZE, or too far from the origin.
    """
    size = float(np.ptp(vertices, axis=0).max())
    if not size <= MAX_MESH_SIZE or not float(np.abs(vertices).max()) <= 2 * MAX_MESH_SIZE:
        raise MeshError(f"{size:.3g} m large; is a scale of 0.001 missing?")


def stl_bytes(vertices: Array, faces: Faces) -> bytes:
    """Write a surface as a binary STL file.

    Args:
        vertices: Corners, (v, 3) [m].
        faces: Corner indices of every triangle, (f, 3).

    Returns:
        The content of the file.
    """
    import trimesh

    return bytes(trimesh.exchange.stl.export_stl(trimesh.Trimesh(vertices, faces, process=False)))
