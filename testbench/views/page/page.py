"""The page of a run in one file: its words, pictures, and what is drawn as data for its scripts."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from testbench import files
from testbench.errors import Array
from testbench.plant.import_robot.thin import decimated
from testbench.plant.shapes import Frames, Shape, quaternions, visual_shapes
from testbench.views.colours import SCALE, hexadecimal
from testbench.views.markdown import Told, as_plain
from testbench.views.page import html
from testbench.views.page.html import Json, grid, look_plain
from testbench.views.scene import Layer, Line, PlaceMap, Poses, RunChart, Scene, Seen

NAME = "report.html"
MARKED, FACTS = ("answer", "worst", "statements"), ("question", "title")
"""Blocks of Markdown, and those that are text."""
MICRO = 1e4  #: Places are written as whole tenths of a millimetre, turns as whole parts of ten thousand.
TRIANGLES = 500  #: Of a mesh at most: an arm turns smoothly on a phone.
AROUND = 20  #: Points on a circle of a round shape.
Faces = npt.NDArray[np.int_]


def write_page(folder: Path, scenario: str, words: Told, seen: Seen) -> None:
    """report.html of a run, from its words, what is drawn, and the pictures that lie in its folder.

    Args:
        folder: Of the run; all its other files are there but the manifest.
        scenario: What was run, such as "Gravity calibration".
        words: Of its report.
        seen: What is drawn.
    """
    pictures = [{"name": png.name, "data": html.embedded(png)} for png in sorted(folder.glob("*.png"))]
    text = html.fill(
        scenario=scenario,
        words={name: words.block(name) for name in MARKED}
        | {name: as_plain(words.block(name)) for name in FACTS},
        rest=words.block("body"),
        drawn=seen_plain(seen),
        pictures=pictures,
        others=[name for name in (*files.inside(folder), "manifest.json") if name != NAME],
        versions=files.versions(),
    )
    (folder / NAME).write_text(text, encoding="utf-8")


def seen_plain(seen: Seen) -> Json:
    """All that is drawn."""
    return {
        "scene": _scene(seen.scene) if seen.scene else None,
        "map": map_plain(seen.map) if seen.map else None,
        "runs": [chart_plain(chart) for chart in seen.runs],
        "tables": [grid(table) for table in seen.tables],
        "ramp": SCALE,
    }


def chart_plain(chart: RunChart) -> Json:
    """A chart."""
    return {
        "title": chart.title,
        "group": chart.group,
        "across": chart.across,
        "labels": list(chart.labels),
        "lines": [_line(line) for line in chart.lines],
        "limit": None if chart.limit is None or not np.isfinite(chart.limit) else chart.limit,
        "note": chart.note,
    }


def map_plain(found: PlaceMap) -> Json:
    """A map."""
    at = [[round(x, 3) for x in row] if np.isfinite(row).all() else None for row in found.at.tolist()]
    return {
        "title": found.title,
        "group": found.group,
        "heading": found.heading,
        "without": found.without,
        "at": at,
        "lines": [_line(line) for line in found.lines],
    }


def _line(line: Line) -> Json:
    found = {"name": line.name, **look_plain(line.look), "values": _short(line.values)}
    return found if line.ends is None else found | {"ends": [_short(end) for end in line.ends]}


def _short(values: Array) -> list[float | None]:
    """Four digits of each."""
    return [float(f"{x:.4g}") if np.isfinite(x) else None for x in values.tolist()]


def _scene(scene: Scene) -> Json:
    return {
        "title": scene.title,
        "solids": [_solid(solid(shape)) for shape in visual_shapes(scene.cell.room)],
        "groups": [_group(group) for group in scene.groups],
    }


def _group(own: Poses) -> Json:
    return {
        "name": own.name,
        "names": list(own.names),
        "words": list(own.words),
        "first": own.first,
        "near": None if own.near is None else _near(own.near),
        "rigid": frames_plain(own.rigid),
        "bent": None if own.bent is None else frames_plain(own.bent),
        "layers": [_layer(layer) for layer in own.layers],
    }


def _layer(layer: Layer) -> Json:
    return {
        "name": layer.name,
        "colour": hexadecimal(layer.colour),
        "kind": layer.kind,
        "at": [_whole(row) for row in layer.at],
        "to": None if layer.to is None else [_whole(row) for row in layer.to],
        "labels": list(layer.labels),
        "shown": layer.shown,
    }


def _near(points: Array) -> Json:
    """What is in view, and the angles of the eye across its two longest extents, from above or beyond."""
    middle = points.mean(axis=0)
    axis = np.linalg.svd(points - middle)[2][2]
    beyond = middle + np.array([0, 0, np.abs(points).max()])
    axis = axis if axis @ beyond > 0 else -axis
    yaw, pitch = np.arctan2(axis[1], axis[0]), np.arcsin(np.clip(axis[2], -1, 1))
    return {"at": points.round(3).tolist(), "yaw": round(float(yaw), 3), "pitch": round(float(pitch), 3)}


def frames_plain(frames: Frames) -> list[list[int | None]]:
    """By pose: of every body its origin and its turn as a quaternion, x, y, z, w."""
    turns = quaternions(frames.rotations)
    return [_whole(row) for row in np.concatenate([frames.positions, turns], axis=2)]


def _whole(numbers: Array) -> list[int | None]:
    """Numbers as whole parts of ten thousand, row by row; null where there is none."""
    return [round(x) if np.isfinite(x) else None for x in (MICRO * np.ravel(numbers)).tolist()]


@dataclass(frozen=True)
class Solid:
    """A closed surface, fixed in a body."""

    body: int  #: Index of its body.
    vertices: Array  #: In the body's axes, (v, 3) [m].
    faces: Faces  #: Corners of each triangle, counter-clockwise from outside, (f, 3).
    brightness: float  #: Of its own colour, 0 to 1.


def _solid(own: Solid) -> Json:
    return {
        "body": own.body,
        "v": _whole(own.vertices),
        "f": own.faces.ravel().tolist(),
        "bright": round(own.brightness, 3),
    }


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
    from scipy.spatial import ConvexHull  # here: it takes long to import, and most arms are meshes

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
