"""Surfaces made small, and written as STL."""

import struct
from typing import TYPE_CHECKING

import numpy as np

from testbench.errors import Array

if TYPE_CHECKING:  # they read meshes by libraries that take long to import
    from testbench.plant.import_robot.meshes import Faces, Surface


def decimated(vertices: Array, faces: "Faces", most: int) -> "Surface":
    """A surface of at most about so many triangles."""
    if len(faces) <= most:
        return vertices, faces
    import fast_simplification

    thin, kept = fast_simplification.simplify(
        np.ascontiguousarray(vertices, dtype=np.float32),
        np.ascontiguousarray(faces, dtype=np.int32),
        target_count=most,
    )
    return np.asarray(thin, dtype=float), np.asarray(kept, dtype=int)


def stl_bytes(vertices: Array, faces: "Faces") -> bytes:
    """A surface as a binary STL file."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.where(size > 0, size, 1)
    rows = np.zeros(len(faces), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("spare", "<u2")])
    rows["n"], rows["v"] = normals, corners
    return bytes(80) + struct.pack("<I", len(faces)) + rows.tobytes()
