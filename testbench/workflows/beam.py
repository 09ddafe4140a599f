"""Equivalent beam of a link: its line from joint to joint, and the diameter of its drawn surface."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from testbench.errors import Array
from testbench.files.robot.robot import ImportedChain, ImportedShape, visible_shapes

COINCIDE = 0.02
"""Distance of joints below which they coincide, as a share of the reach [1]."""
PARALLEL = 0.1
"""Sine of the angle below which two directions count as parallel [1]."""
CUTS = 17
"""Cross sections of a link."""
INNER = 0.1, 0.9
"""First and last cross section, as shares of the length, clear of the flanges [1]."""
MIN_CUTS = 6
"""Fewest cross sections that must meet the surface: at least a third of the link is drawn."""


Runs = Literal["to the next joint", "to the tool", "along the next joint", "along the flange"]
"""Direction of a link's beam; it follows an axis if joints, or joint and tool, coincide."""


@dataclass(frozen=True, eq=False)
class Beam:
    """Describe the line of a link in its part's frame."""

    frame: Array  #: Axes x (along), y, z as columns, (3, 3) [1].
    distance: float  #: Distance from the link's joint to the next one, or to the tool [m].
    runs: Runs  #: Direction of the beam.


def joint_poses(chain: ImportedChain, tool: Array) -> list[Array]:
    """List the pose of the next joint, or of the tool, in every part's frame, (4, 4) each.

    Args:
        chain: The arm.
        tool: Pose of the tool in the last part, (4, 4) [m].

    Returns:
        The poses, n + 1.
    """
    return [*(part.pose for part in chain.parts[1:]), tool]


def beam_reach(chain: ImportedChain, tool: Array) -> float:
    """Compute the stretched length from the first joint to the tool.

    Args:
        chain: The arm.
        tool: Pose of the tool in the last part, (4, 4) [m].

    Returns:
        Length [m].
    """
    return float(sum(np.linalg.norm(end[:3, 3]) for end in joint_poses(chain, tool)[1:]))


def beams(chain: ImportedChain, tool: Array) -> list[Beam]:
    """Find the line of every link.

    Args:
        chain: The arm.
        tool: Pose of the tool in the last part, (4, 4) [m].

    Returns:
        The lines, from base to flange.
    """
    long, every = beam_reach(chain, tool), joint_poses(chain, tool)
    return [_beam(chain, k, end, long) for k, end in enumerate(every)]


def _beam(chain: ImportedChain, k: int, end: Array, long: float) -> Beam:
    """Find the line of link k."""
    offset, last = end[:3, 3], k == chain.n_joints
    distance = float(np.linalg.norm(offset))
    joint, after = chain.parts[k].joint, None if last else chain.parts[k + 1].joint
    following = None if after is None else end[:3, :3] @ after.axis
    runs: Runs = "to the tool" if last else "to the next joint"
    if distance > COINCIDE * long:
        x = offset / distance
    elif following is not None:
        outward = chain.parts[k].com @ following >= 0  # where the part's mass lies
        x, runs = following if outward else -following, "along the next joint"
    else:
        part = chain.parts[k]
        assert joint is not None  # the last part has a joint
        x, runs = flange_axis(joint.axis, part.pose, end, part.com, COINCIDE * long), "along the flange"
    axes = [following, None if joint is None else joint.axis]
    return Beam(_frame(x, [axis for axis in axes if axis is not None]), distance, runs)


def flange_axis(axis: Array, pose: Array, tool: Array, com: Array, least: float) -> Array:
    """Find the direction of the flange: along the last joint's axis, away from the joint before.

    If the joints coincide, it points to the tool; if the tool coincides too, along the axis of its frame that
    is parallel to the joint's; else to the part's mass.

    Args:
        axis: Axis of the last joint, in its part, (3,) [1].
        pose: Pose of the part in the one before, (4, 4) [m].
        tool: Pose of the tool in the part, (4, 4) [m].
        com: Centre of mass of the part, (3,) [m].
        least: Distance below which points coincide [m].

    Returns:
        Unit vector, (3,) [1].
    """
    way, distance = tool[:3, 3], float(np.linalg.norm(tool[:3, 3]))
    sides = [float(axis @ pose[:3, :3].T @ pose[:3, 3]), float(axis @ way)]
    side = next((s for s in sides if abs(s) > least), 0.0)
    if not side and distance > least:  # the last joint turns across
        return np.asarray(way / distance)
    if not side:
        along = tool[:3, :3].T @ axis
        side = float(along[np.abs(along).argmax()])
        side = side if abs(side) > 1 - PARALLEL else float(axis @ com)
    return axis if side >= 0 else -axis


def _frame(x: Array, along: list[Array]) -> Array:
    """Make beam axes whose y follows the first direction not parallel to x, else an axis of the part."""
    for y in [*along, *np.eye(3)]:
        across = y - (x @ y) * x
        size = float(np.linalg.norm(across))
        if size > PARALLEL:
            y = across / size
            return np.column_stack([x, y, np.cross(x, y)])
    raise AssertionError("one of three axes is not x")


def triangles(shapes: Sequence[ImportedShape]) -> Array:
    """List triangles of a part's drawn shapes, or of colliding ones if none is drawn, (f, 3, 3) [m]."""
    bearing = visible_shapes([s for s in shapes if s.bears])
    return np.concatenate([np.empty((0, 3, 3)), *(s.surface[0][s.surface[1]] for s in bearing)])


def axial_extent(surface: Array, axis: Array) -> tuple[float, float]:
    """Compute the extent of a surface along an axis.

    Args:
        surface: Triangles, (f, 3, 3) [m].
        axis: Unit vector, (3,) [1].

    Returns:
        Least and largest coordinate [m].
    """
    along = surface @ axis
    return float(along.min()), float(along.max())


def outer_diameter(surface: Array, frame: Array, span: tuple[float, float]) -> float | None:
    """Compute the diameter of a circle with the area of a cross section's hull, median over the sections.

    Args:
        surface: Triangles in the part's frame, (f, 3, 3) [m].
        frame: Beam axes as columns, (3, 3).
        span: First and last coordinate along the beam axis [m].

    Returns:
        Diameter [m]; None if too few sections meet the surface.
    """
    low, high = (span[0] + share * (span[1] - span[0]) for share in INNER)
    turned = surface @ frame
    least, most = turned[:, :, 0].min(axis=1), turned[:, :, 0].max(axis=1)
    found = [_diameter(turned[(least < x) & (x <= most)], x) for x in np.linspace(low, high, CUTS)]
    met = [d for d in found if d is not None]
    return float(np.median(met)) if len(met) >= MIN_CUTS else None


def _diameter(surface: Array, x: float) -> float | None:
    """Compute the diameter of the section at x of triangles in beam axes, (f, 3, 3)."""
    ends = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        p, q = surface[:, a], surface[:, b]
        cut = (p[:, 0] < x) != (q[:, 0] < x)
        p, q = p[cut], q[cut]
        share = (x - p[:, 0]) / (q[:, 0] - p[:, 0])
        ends.append(p[:, 1:] + share[:, None] * (q[:, 1:] - p[:, 1:]))
    points = np.concatenate(ends)
    if len(points) < 3:
        return None
    try:
        return float(2 * np.sqrt(ConvexHull(points).volume / np.pi))  # of a plane hull the area
    except QhullError:  # a line
        return None
