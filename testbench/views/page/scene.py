"""An arm to be turned by hand in a page: its solids, where they are in every pose, and what is read there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from testbench.bench.campaign import Cell
from testbench.errors import Array
from testbench.plant.shapes import Frames, visual_shapes
from testbench.views.colours import Colour, hexadecimal
from testbench.views.page.solids import Solid, solid

MICRO = 1e4  #: Places are written as whole tenths of a millimetre, turns as whole parts of ten thousand.

Json = Mapping[str, object]


@dataclass(frozen=True)
class Layer:
    """Dots, small ones, arrows or lines, the same number in every pose, or the same in all of them."""

    name: str  #: For the legend.
    colour: Colour
    kind: Literal["dots", "specks", "arrows", "lines"]
    at: Array  #: Where they are or begin, (poses, k, 3), of what stands still (1, k, 3) [m]; NaN: none.
    to: Array | None = None  #: Where arrows and lines end, as many [m].
    labels: Sequence[str] = ()  #: What stands beside each, (k,); none if empty.
    shown: bool = True  #: Whether it is visible at first.


@dataclass(frozen=True)
class Poses:
    """Poses of one kind, such as the runs."""

    name: str  #: Of the kind, such as "Runs".
    names: Sequence[str]  #: Of each pose, such as "run 3".
    words: Sequence[str]  #: What is said of each, plain text.
    rigid: Frames  #: The arm without load.
    bent: Frames | None  #: Under load, its deflection magnified.
    layers: Sequence[Layer] = ()
    first: int = 0  #: Index of the pose that is shown first.
    #: What the eye sees from the broad side, (n, 3) [m]; all that is drawn if None.
    near: Array | None = None


@dataclass(frozen=True)
class Scene:
    """An arm in poses."""

    cell: Cell
    title: str  #: What is magnified, and how much.
    groups: Sequence[Poses]  #: The first one is shown first.

    def plain(self) -> Json:
        """As JSON data."""
        return {
            "title": self.title,
            "solids": [_solid(solid(shape)) for shape in visual_shapes(self.cell.room)],
            "groups": [_group(group) for group in self.groups],
        }


def _solid(own: Solid) -> Json:
    return {
        "body": own.body,
        "v": _whole(own.vertices),
        "f": own.faces.ravel().tolist(),
        "bright": round(own.brightness, 3),
    }


def _group(own: Poses) -> Json:
    return {
        "name": own.name,
        "names": list(own.names),
        "words": list(own.words),
        "first": own.first,
        "near": None if own.near is None else _near(own.near),
        "rigid": _frames(own.rigid),
        "bent": None if own.bent is None else _frames(own.bent),
        "layers": [
            {
                "name": layer.name,
                "colour": hexadecimal(layer.colour),
                "kind": layer.kind,
                "at": [_whole(row) for row in layer.at],
                "to": None if layer.to is None else [_whole(row) for row in layer.to],
                "labels": list(layer.labels),
                "shown": layer.shown,
            }
            for layer in own.layers
        ],
    }


def _near(points: Array) -> Json:
    """What is in view, and the angles of the eye across its two longest extents, from above or beyond."""
    middle = points.mean(axis=0)
    axis = np.linalg.svd(points - middle)[2][2]
    beyond = middle + np.array([0, 0, np.abs(points).max()])
    axis = axis if axis @ beyond > 0 else -axis
    yaw, pitch = np.arctan2(axis[1], axis[0]), np.arcsin(np.clip(axis[2], -1, 1))
    return {"at": points.round(3).tolist(), "yaw": round(float(yaw), 3), "pitch": round(float(pitch), 3)}


def _frames(frames: Frames) -> list[list[int | None]]:
    """By pose: of every body its origin and its turn as a quaternion, x, y, z, w."""
    shape = frames.rotations.shape[:2]
    turns = Rotation.from_matrix(frames.rotations.reshape(-1, 3, 3)).as_quat().reshape(*shape, 4)
    return [_whole(row) for row in np.concatenate([frames.positions, turns], axis=2)]


def _whole(numbers: Array) -> list[int | None]:
    """Numbers as whole parts of ten thousand, row by row; null where there is none."""
    return [round(x) if np.isfinite(x) else None for x in (MICRO * np.ravel(numbers)).tolist()]
