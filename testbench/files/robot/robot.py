"""A robot as a list of bodies in SI units, whatever the format of its file, and the serial chain in it."""

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


UNLIMITED = 2 * math.pi
"""Limit, each way, of a hinge without stated limits [rad]."""
SLIDE = 1.0
"""Limit, each way, of a slide without stated limits [m]."""
Point = tuple[str, Array]
"""Name and position in the tool's frame, (3,) [m]."""


class Note(NamedTuple):
    """Note how an element of the file was treated; `testbench.workflows.new_arm` puts it into words."""

    kind: str
    names: tuple[str, ...] = ()  #: Names of links, bodies, joints or files.
    numbers: tuple[float, ...] = ()  #: In SI, (1, kg, m, rad) as the kind has them.


@dataclass(frozen=True, eq=False)
class ImportedMesh:
    """Hold triangles of a file in its own unit, or of a primitive [m]."""

    vertices: Array  #: Corners, (v, 3).
    faces: Faces  #: Corner indices of every triangle, (f, 3).
    outer: Array  #: Corners that span the convex hull, (h, 3).
    rgba: Array | None = None  #: Colour if the file states one, (4,) [1].


@dataclass(frozen=True, eq=False)
class ImportedShape:
    """Describe a triangle surface fixed in a body; primitives of the file are converted to one."""

    kind: Kind  #: As MuJoCo names it.
    size: Array  #: Of a primitive, as MuJoCo counts it, (3,) [m].
    pose: Array  #: In the body's frame, (4, 4) [m].
    mesh: ImportedMesh  #: Its surface in its own axes.
    rgba: Array  #: Colour, (4,) [1].
    visual: bool  #: Whether it is drawn.
    collides: bool  #: Whether it collides.
    bears: bool = True  #: Whether it belongs to the link, not to a rod of the arm.

    @property
    def surface(self) -> Surface:
        """Return the surface in the body's frame."""
        return transform_points(self.mesh.vertices, self.pose), self.mesh.faces

    @property
    def cloud(self) -> Array:
        """Return corners whose hull is that of the shape, (h, 3) [m]."""
        return transform_points(self.mesh.outer, self.pose)


def visible_shapes(shapes: Sequence[ImportedShape]) -> list[ImportedShape]:
    """Select the shapes that are drawn; if there are none, those that collide.

    Args:
        shapes: Shapes of a body.

    Returns:
        The selected shapes.
    """
    return [s for s in shapes if s.visual] or [s for s in shapes if s.collides]


class ImportedSite(NamedTuple):
    """Describe a named frame on a body: a flange, a tool's centre point, a site, the body itself."""

    name: str  #: Name in the file.
    pose: Array  #: In the body's frame, (4, 4) [m].


@dataclass(frozen=True, eq=False)
class ImportedJoint:
    """Describe the joint that moves a body; its axis passes through the body's origin."""

    name: str  #: Name in the file.
    axis: Array  #: Unit axis in the body's frame, (3,) [1].
    prismatic: bool  #: Whether it slides along the axis; otherwise it turns about it.
    lower: float  #: Lower limit [rad or m].
    upper: float  #: Upper limit [rad or m].
    limited: bool  #: Whether the file states the limits; otherwise they are defaults.


@dataclass(frozen=True, eq=False)
class Body:
    """Describe a link or body; parents come before their children."""

    name: str  #: Name in the file.
    parent: int  #: Index of the body before; -1 for the first of a tree.
    pose: Array  #: In the parent at q = 0, (4, 4) [m]; in the world for the first.
    joint: ImportedJoint | None = None  #: Joint that moves it; None for a fixed body.
    odd: str = ""  #: Why its joint cannot be one of the arm, such as "is a free joint"; "" if it can.
    follows: str = ""  #: Name of the joint that its joint mimics.
    mass: float = 0.0  #: [kg]
    com: Array = field(default_factory=lambda: np.zeros(3))  #: Centre of mass in the body's frame, (3,) [m].
    #: Inertia about the centre of mass in the body's axes, (3, 3) [kg m^2].
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    weighed: bool = True  #: Whether the file states its mass, or most of it.
    shapes: tuple[ImportedShape, ...] = ()
    sites: tuple[ImportedSite, ...] = ()

    @property
    def moves(self) -> bool:
        """Tell whether the body moves against its parent."""
        return self.joint is not None or bool(self.odd)


@dataclass(frozen=True, eq=False)
class Robot:
    """Hold all bodies of a file."""

    name: str
    bodies: tuple[Body, ...]
    notes: tuple[Note, ...] = ()  #: What the reader left out or replaced.
    couplings: tuple[Coupling, ...] = ()  #: Equations between its joints.
    driven: frozenset[str] = frozenset()  #: Joints with motors, as far as the file states them.


@dataclass(frozen=True, eq=False)
class ImportedChain:
    """Describe a serial arm that was read from a user's file."""

    name: str  #: The robot's name in the file.
    #: From the base to the last link, n + 1, each with all that is fixed to it; the base in the world.
    parts: tuple[Body, ...]
    tip: ImportedSite  #: The link, body or site that carries the tool, in the last part.
    notes: tuple[Note, ...]  #: What was merged, frozen, renamed or estimated.
    joint_map: JointMap | None = None  #: Map of dependent joints; None if there are none.

    @property
    def joints(self) -> list[ImportedJoint]:
        """Return the joints that move its parts, n."""
        return [part.joint for part in self.parts if part.joint]

    @property
    def n_joints(self) -> int:
        """Count the moving joints, n."""
        return len(self.parts) - 1

    @property
    def mass(self) -> float:
        """Return the mass of the whole arm with its base [kg]."""
        return sum(part.mass for part in self.parts)


def substitute_limits(*, prismatic: bool) -> tuple[float, float]:
    """Return limits for a joint whose file states none.

    Args:
        prismatic: Whether the joint is a slide.

    Returns:
        Lower and upper limit [rad, m].
    """
    return (-SLIDE, SLIDE) if prismatic else (-UNLIMITED, UNLIMITED)


def pose_of(rotation: Array, position: Array) -> Array:
    """Combine a rotation and a position to a homogeneous pose.

    Args:
        rotation: Rotation matrix, (3, 3).
        position: Origin, (3,) [m].

    Returns:
        The pose, (4, 4).
    """
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def transform_points(points: Array, pose: Array) -> Array:
    """Transform points from the frame of a body to the frame that its pose refers to.

    Args:
        points: Points in the body's frame, (n, 3) [m].
        pose: Pose of the body, (4, 4) [m].

    Returns:
        The points, (n, 3) [m].
    """
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])
