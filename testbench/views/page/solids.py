"""The shapes of an arm as few triangles, for a page."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from testbench.errors import Array
from testbench.plant.adopt.thin import decimated
from testbench.plant.shapes import Shape

TRIANGLES = 500  #: Of a mesh at most: an arm turns smoothly on a phone.
AROUND = 20  #: Points on a circle of a round shape.
Faces = npt.NDArray[np.int_]


@dataclass(frozen=True)
class Solid:
    """A closed surface, fixed in a body."""

    body: int  #: Index of its body.
    vertices: Array  #: In the body's axes, (v, 3) [m].
    faces: Faces  #: Corners of each triangle, counter-clockwise from outside, (f, 3).
    brightness: float  #: Of its own colour, 0 to 1.


def solid(shape: Shape) -> Solid:
    """A shape as triangles."""
    vertices, faces = _thin(shape) if shape.mesh is not None else _hull(_surface(shape))
    brightness = float(shape.rgba[:3] @ [0.299, 0.587, 0.114])
    return Solid(shape.body, shape.position + vertices @ shape.rotation.T, faces, brightness)


def _thin(shape: Shape) -> tuple[Array, Faces]:
    """A mesh of few triangles; corners that differ in their normals alone are one."""
    assert shape.mesh is not None
    vertices, inverse = np.unique(shape.mesh.vertices, axis=0, return_inverse=True)
    return decimated(vertices, inverse.ravel()[shape.mesh.faces], TRIANGLES)


def _hull(points: Array) -> tuple[Array, Faces]:
    """Convex hull of points, its triangles seen counter-clockwise from outside."""
    found = ConvexHull(points)
    faces = found.simplices.copy()
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    kept, inverse = np.unique(faces, return_inverse=True)
    return points[kept], inverse.reshape(faces.shape)


def _surface(shape: Shape) -> Array:
    """Points on a box, an ellipsoid, a cylinder or a capsule, whose hull it is, (p, 3) [m]."""
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
    if shape.kind == "box":
        return signs * shape.size
    angle = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(AROUND)])
    radius, _, half = shape.size
    if shape.kind == "cylinder":
        return np.concatenate([radius * circle + [0, 0, z] for z in (-half, half)])
    tilt = np.linspace(-np.pi / 2, np.pi / 2, AROUND // 2 + 1)
    ball = np.concatenate([np.cos(t) * circle + [0, 0, np.sin(t)] for t in tilt])
    ball = np.unique(ball.round(9), axis=0)
    if shape.kind == "capsule":
        return np.concatenate([radius * ball + [0, 0, z] for z in (-half, half)])
    return ball * shape.size
