"""A robot as a list of bodies in SI, whatever its file's format, and the serial chain in it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from testbench.arm.joint_map import JointMap
from testbench.errors import Array, Ids
from testbench.files.robot.equalities import Coupling
from testbench.plant.shapes import Kind

Faces = Ids
Surface = tuple[Array, Faces]
"""Corners, (v, 3) [m], and three of them a triangle, (f, 3)."""


UNLIMITED = 2 * math.pi  #: Of a turning joint without limits, each way [rad].
SLIDE = 1.0  #: Of a sliding joint without limits, each way [m].
Point = tuple[str, Array]
"""Name and position in the tool's frame, (3,) [m]."""


class Note(NamedTuple):
    """What became of something in the file; `testbench.workflows.new_arm` has the words."""

    kind: str
    names: tuple[str, ...] = ()  #: Of links, bodies, joints or files.
    numbers: tuple[float, ...] = ()  #: In SI, (1, kg, m, rad) as the kind has them.


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of a file in its own unit, or of a primitive [m]."""

    vertices: Array  #: (v, 3)
    faces: Faces  #: (f, 3)
    outer: Array  #: The corners that its hull needs, (h, 3)
    rgba: Array | None = None  #: Its colour where the file has one, (4,) [1].


@dataclass(frozen=True, eq=False)
class Shape:
    """A triangle surface fixed in a body; a primitive of the file is one too."""

    kind: Kind  #: As MuJoCo names it.
    size: Array  #: Of a primitive, as MuJoCo counts it, (3,) [m].
    pose: Array  #: In the body's frame, (4, 4) [m].
    mesh: Mesh  #: Its surface in its own axes.
    rgba: Array  #: Colour, (4,) [1].
    visual: bool  #: It is drawn.
    collides: bool  #: It keeps others out.
    bears: bool = True  #: It is of the link, not of a rod beside it.

    @property
    def surface(self) -> Surface:
        """In the body's frame."""
        return moved(self.mesh.vertices, self.pose), self.mesh.faces

    @property
    def cloud(self) -> Array:
        """Corners whose hull is that of the shape, (h, 3) [m]."""
        return moved(self.mesh.outer, self.pose)


def seen(shapes: Sequence[Shape]) -> list[Shape]:
    """Those that are drawn; where none is, those that collide."""
    return [s for s in shapes if s.visual] or [s for s in shapes if s.collides]


class Site(NamedTuple):
    """A frame that the file names on a body: a flange, a tool's centre point, a site, the body itself."""

    name: str  #: As the file says it.
    pose: Array  #: In the body's frame, (4, 4) [m].


@dataclass(frozen=True, eq=False)
class Joint:
    """The joint that moves a body; its axis leads through the body's origin."""

    name: str  #: As the file says it.
    axis: Array  #: Unit axis in the body's frame, (3,) [1].
    prismatic: bool  #: It slides along the axis; else it turns about it.
    lower: float  #: Lower limit [rad or m].
    upper: float  #: Upper limit [rad or m].
    limited: bool  #: The file states the limits; else ours stand in for them.


@dataclass(frozen=True, eq=False)
class Body:
    """A link or body; parents come before their children."""

    name: str  #: As the file says it.
    parent: int  #: Index of the body before; -1 for the first of a tree.
    pose: Array  #: In the parent at q = 0, (4, 4) [m]; in the world for the first.
    joint: Joint | None = None  #: What moves it.
    odd: str = ""  #: Why its joint cannot be one of the arm: "is a free joint".
    follows: str = ""  #: Name of the joint that its joint mimics.
    mass: float = 0.0  #: [kg]
    com: Array = field(default_factory=lambda: np.zeros(3))  #: Centre of mass in the body's frame, (3,) [m].
    #: About the centre of mass in the body's axes, (3, 3) [kg m^2].
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    weighed: bool = True  #: The file states its mass, or most of it.
    shapes: tuple[Shape, ...] = ()
    sites: tuple[Site, ...] = ()

    @property
    def moves(self) -> bool:
        """Whether anything moves it against its parent."""
        return self.joint is not None or bool(self.odd)


@dataclass(frozen=True, eq=False)
class Robot:
    """All bodies of a file."""

    name: str
    bodies: tuple[Body, ...]
    notes: tuple[Note, ...] = ()  #: What the reader left out or stood in for.
    couplings: tuple[Coupling, ...] = ()  #: What its joints must satisfy.
    driven: frozenset[str] = frozenset()  #: Joints that motors drive, as far as the file says.


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial arm as a stranger's file describes it."""

    name: str  #: The robot's name in the file.
    #: From the base to the last link, n + 1, each with all that is fixed to it; the base in the world.
    parts: tuple[Body, ...]
    tip: Site  #: The link, body or site that the tool is, in the last part.
    notes: tuple[Note, ...]  #: What was merged, frozen, renamed or estimated.
    joint_map: JointMap | None = None  #: How its joints follow others; None where none does.

    @property
    def joints(self) -> list[Joint]:
        """Those that move its parts, n."""
        return [part.joint for part in self.parts if part.joint]

    @property
    def n_joints(self) -> int:
        """Number of moving joints, n."""
        return len(self.parts) - 1

    @property
    def mass(self) -> float:
        """Of the whole arm, the base with it [kg]."""
        return sum(part.mass for part in self.parts)


def endless(*, prismatic: bool) -> tuple[float, float]:
    """Limits that stand in for those that a file does not state [rad, m]."""
    return (-SLIDE, SLIDE) if prismatic else (-UNLIMITED, UNLIMITED)


def pose_of(rotation: Array, position: Array) -> Array:
    """A pose, (4, 4), from its rotation, (3, 3), and its position, (3,)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def moved(points: Array, pose: Array) -> Array:
    """Points of a body, (n, 3) [m], in the frame that its pose is in."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])
