"""The serial chain that a robot's file is reduced to: parts, joints, masses and surfaces, in SI."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from testbench.errors import Array


@dataclass(frozen=True, eq=False)
class Solid:
    """A primitive of the file."""

    kind: Literal["box", "sphere", "cylinder", "capsule", "ellipsoid"]  #: As MuJoCo names it.
    size: tuple[float, ...]  #: As MuJoCo counts it: half sizes, radius, radius and half length [m].
    pose: Array  #: In the part's frame, (4, 4) [m].


@dataclass(frozen=True, eq=False)
class Shape:
    """A triangle surface fixed in a part; a primitive of the file is one too."""

    vertices: Array  #: Corners in the part's frame, (v, 3) [m].
    faces: npt.NDArray[np.int_]  #: Three corners a triangle, (f, 3).
    rgba: Array  #: Colour, (4,) [1].
    visual: bool  #: It is drawn.
    collides: bool  #: It keeps others out.
    solid: Solid | None = None  #: The primitive that the surface stands for, where it is one.
    bears: bool = True  #: It is of the link, not of a rod beside it.
    outer: Array | None = None  #: Those of its corners that its hull needs, (h, 3) [m]; None for all.

    @property
    def cloud(self) -> Array:
        """Corners whose hull is that of the shape, (h, 3) [m]."""
        return self.vertices if self.outer is None else self.outer


def seen(shapes: Sequence[Shape]) -> list[Shape]:
    """Those that are drawn; where none is, those that collide."""
    return [s for s in shapes if s.visual] or [s for s in shapes if s.collides]


@dataclass(frozen=True, eq=False)
class Site:
    """A frame that the file names on a part: a flange, a tool's centre point, a site."""

    name: str  #: As the file says it.
    position: Array  #: In the part's frame, (3,) [m].
    rotation: Array  #: Part from site, (3, 3) [1].


@dataclass(frozen=True, eq=False)
class JointOf:
    """The joint that moves a part; its axis leads through the part's origin."""

    name: str  #: As the file says it.
    axis: Array  #: Unit axis in the part's frame, (3,) [1].
    prismatic: bool  #: It slides along the axis; else it turns about it.
    lower: float  #: Lower limit [rad or m].
    upper: float  #: Upper limit [rad or m].
    limits_from: Literal["file", "none"]  #: "none": the file has no limits, ours stand in for them.


@dataclass(frozen=True, eq=False)
class Part:
    """One rigid body of the chain, with all that is fixed to it."""

    name: str  #: Its link or body in the file.
    joint: JointOf | None  #: What moves it against the part before; None for the base.
    pose: Array  #: In the part before at q = 0, (4, 4) [m]; the identity for the base.
    mass: float  #: Of all that is fixed to it [kg].
    com: Array  #: Centre of mass in the part's frame, (3,) [m].
    inertia: Array  #: About the centre of mass in the part's axes, (3, 3) [kg m^2].
    inertia_from: Literal["file", "geometry"]  #: "geometry": estimated, the file has no masses.
    shapes: tuple[Shape, ...]  #: Its surfaces.
    sites: tuple[Site, ...]  #: Frames that the file names on it.


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial arm as a stranger's file describes it."""

    name: str  #: The robot's name in the file.
    parts: tuple[Part, ...]  #: From the base to the last link, n + 1.
    tip: Array  #: Pose of the tool in the last part, (4, 4) [m].
    tip_name: str  #: The link, body or site that the tool is.
    base: Array  #: Pose of the base part in the world, (4, 4) [m].
    notes: tuple[str, ...]  #: What was understood, merged, frozen or estimated, a sentence each.

    @property
    def n_joints(self) -> int:
        """Number of moving joints, n."""
        return len(self.parts) - 1

    @property
    def mass(self) -> float:
        """Of the whole arm, the base with it [kg]."""
        return sum(part.mass for part in self.parts)


def pose_of(rotation: Array, position: Array) -> Array:
    """A pose, (4, 4), from its rotation, (3, 3), and its position, (3,)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def moved(points: Array, pose: Array) -> Array:
    """Points of a body, (n, 3) [m], in the frame that its pose is in."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def turned(rpy: Array) -> Array:
    """Rotation by roll, pitch, yaw [rad] about the fixed x, then y, then z, as URDF's rpy, (3, 3)."""
    return np.asarray(Rotation.from_euler("xyz", rpy).as_matrix())
