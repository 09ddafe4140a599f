"""Proposals for what a robot's file lacks: tubes, joint compliances, payload, tool, markers, load point.

Every rule is plain: docs/robot_files.md has them all, `testbench.workflows.new_arm` their words. The law of
the joints is fitted to the 13 joint compliances that we know from public data: a KR 500 by modal test, a
KR 270 and a UR10 by elastostatic calibration.

Equivalent beam of a link: its line from joint to joint, and the diameter of its drawn surface.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from testbench.arm.document import unique
from testbench.arm.elastic import PAYLOAD_RANGE
from testbench.arm.stiffness import Material, Tube
from testbench.errors import Array, BenchError
from testbench.files.robot.robot import (
    Body,
    ImportedChain,
    ImportedShape,
    ImportedSite,
    Note,
    Point,
    visible_shapes,
)
from testbench.workflows.arm_doubts import COINCIDE, PARALLEL, flange_axis, on_a_line

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


ARM_COMPLIANCE = 0.33e-6  #: Of a joint that carries 1000 kg m [rad/(N m)].
POWER = 0.75  #: Compliance falls with this power of payload times reach [1].
WRIST = 6.0  #: Compliance of a joint of the wrist over that of one of the arm [1].
LEVER = 0.1  #: A slide is as stiff as a turning joint at this share of the reach [1].
WRIST_JOINTS = 3  #: Joints after the third are of the wrist, at most so many.
CAST_IRON_PAYLOAD = 100.0  #: Payload from which an arm is of cast iron [kg].
CAST_IRON, ALUMINIUM = Material(1.1e11, 0.26), Material(7.0e10, 0.33)
HOLLOW = 0.9  #: Inner over outer diameter, as of our KR 500 [1].
OUTER = 0.30  #: Outer diameter of a link that carries 1000 kg m where no shape tells it [m].
SLENDER = 0.2  #: It grows with this power of payload times reach [1].
SHORT_LINK = 0.05  #: A link shorter than this share of the reach is cut over the whole of its shape [1].
STUB = 0.5  #: No tube is shorter than this share of its diameter: wrists whose joints meet [1].
AROUND = 0.1  #: Distance of the proposed markers from the tool over the reach [1].
BEYOND = 0.05  #: Distance of the proposed load point from the tool, along its axis, over the reach [1].
MILLIMETRE = 3  #: Digits of a proposed position in metres.

ToldBy = Literal["shape", "none", "pieces", "part"]
"""What tells an outer diameter: the link's shape; or payload and reach, where there is no shape, one in
pieces or one on a part of the link."""


@dataclass(frozen=True, eq=False)
class UserInputs:
    """Hold what an engineer says of an arm that its file does not; None or empty if nothing."""

    payload: float | None = None  #: Rated payload [kg].
    tool: Array | None = None  #: Pose of the tool in the frame of the tip, (4, 4) [m].
    markers: tuple[Point, ...] = ()
    load: Array | None = None  #: Load point in the tool's frame, (3,) [m].


@dataclass(frozen=True, eq=False)
class LinkProposal:
    """Propose the tube of a link."""

    name: str
    beam: Beam
    tube: Tube
    told_by: ToldBy  #: Of its outer diameter.
    drawn: float  #: How much of the link has a shape [m].


@dataclass(frozen=True, eq=False)
class Proposal:
    """Hold what `testbench new` writes beside the robot's kinematics."""

    #: In the last part; called "tool", or with underscores where the robot has one of that name.
    tool: ImportedSite
    load: Point
    markers: tuple[Point, ...]
    payload: float  #: Rated or estimated [kg].
    reach: float  #: Stretched length from the first joint to the tool [m].
    links: tuple[LinkProposal, ...]
    compliances: tuple[float, ...]  #: Of the joints [rad/(N m), m/N].
    #: What nobody has stated, "tool", "load" and "markers" or "sites", with the distance from the tool [m].
    proposed: tuple[Note, ...]


def propose(chain: ImportedChain, wishes: UserInputs) -> Proposal:
    """Propose everything of an arm's folder that the robot's file does not hold.

    Args:
        chain: The robot, as its file has it.
        wishes: What the engineer said of it.

    Returns:
        The proposal.

    Raises:
        BenchError: When no arm has such a payload, or no link such a tube.
    """
    tool = chain.tip.pose if wishes.tool is None else np.asarray(chain.tip.pose @ wishes.tool)
    lines, long = beams(chain, tool), beam_reach(chain, tool)
    payload = (
        estimated_payload(chain.mass, beam_reach(chain, chain.tip.pose))
        if wishes.payload is None
        else wishes.payload
    )
    low, high = PAYLOAD_RANGE
    if not low <= payload <= high:
        got = f"got {payload:g} for the root of its {chain.mass:.4g} kg, times its reach in m"
        raise BenchError(f"payload: expected {low:g} to {high:g} kg, {got}; state it by --payload-kg")
    ahead = _ahead(chain, tool, lines[-1], long)
    axes = tool[:3, :3].T @ lines[-1].frame  # beam axes in the tool's frame, as columns
    sites, taken = _sites(chain, tool), [part.name for part in chain.parts]
    taken.append(tool_name := unique("tool", taken))
    taken.append(load_name := unique("load", taken))
    load = np.round((ahead + BEYOND * long) * axes[:, 0], MILLIMETRE) if wishes.load is None else wishes.load
    markers: list[Point] = []
    for name, place in wishes.markers or sites or _ring(axes, AROUND * long, ahead):
        taken.append(name := unique(name, taken))
        markers.append((name, place))
    stated = {
        Note("tool"): wishes.tool is not None,
        Note("load", (), (ahead + BEYOND * long,)): wishes.load is not None,
        Note("sites" if sites else "markers", (), (AROUND * long,)): bool(wishes.markers),
    }
    n, joints = chain.n_joints, enumerate(chain.joints)
    return Proposal(
        tool=ImportedSite(tool_name, tool),
        load=(load_name, load),
        markers=tuple(markers),
        payload=payload,
        reach=long,
        links=tuple(_link(part, line, payload, long) for part, line in zip(chain.parts, lines, strict=True)),
        compliances=tuple(joint_compliance(payload, long, k, n, slides=j.prismatic) for k, j in joints),
        proposed=tuple(note for note, said in stated.items() if not said),
    )


def joint_compliance(payload: float, long: float, index: int, n_joints: int, *, slides: bool) -> float:
    """Estimate the compliance of a joint.

    Args:
        payload: What the arm is built for [kg].
        long: Its reach [m].
        index: Of the joint, 0 the first.
        n_joints: How many the arm has.
        slides: Whether it slides.

    Returns:
        Compliance [rad/(N m), m/N].
    """
    c = float(ARM_COMPLIANCE * (payload * long / 1000) ** -POWER)
    if slides:
        return c * (LEVER * long) ** 2
    return c * WRIST if in_wrist(index, n_joints) else c


def in_wrist(index: int, n_joints: int) -> bool:
    """Tell whether a joint is of the wrist: the last ones after the third, three at most.

    Args:
        index: Of the joint, 0 the first.
        n_joints: Number of joints.

    Returns:
        True if it is.
    """
    return index >= n_joints - min(WRIST_JOINTS, max(n_joints - 3, 0))


def estimated_payload(mass: float, long: float) -> float:
    """Estimate the payload of an arm that states none: sqrt(mass) times reach, to two digits.

    A fit to 129 arms that makers rate at 0.3 to 700 kg, two thirds of them weighed by their shapes, has these
    exponents and the factor 1 within its error. It misses them by a factor of 1.9 (root mean square of the
    logarithm), the worst by 5.4.

    Args:
        mass: Mass of the arm [kg].
        long: Reach of the arm [m].

    Returns:
        Payload [kg].
    """
    return float(f"{math.sqrt(mass) * long:.2g}")


def _link(part: Body, line: Beam, payload: float, long: float) -> LinkProposal:
    """The tube of a link; of unknown shape between a Panda's 0.10 m and the 0.34 m of our KR 500."""
    surface, drawn = triangles(part.shapes), 0.0
    outer: float | None = None
    told_by: ToldBy = "none"
    if len(surface):
        low, high = axial_extent(surface, line.frame[:, 0])
        told_by = "pieces"
        if line.distance >= SHORT_LINK * long:
            drawn = max(0.0, min(high, line.distance) - max(low, 0.0))
            low, high, told_by = 0.0, line.distance, "part"
        outer = outer_diameter(surface, line.frame, (low, high))
    made = CAST_IRON if payload >= CAST_IRON_PAYLOAD else ALUMINIUM
    D = OUTER * (payload * long / 1000) ** SLENDER if outer is None else outer
    length, D = max(line.distance, STUB * D), round(D, 4)
    try:
        tube = Tube(max(round(length, 6), 1e-3), D, round(HOLLOW * D, 4), made.E, made.nu)
    except BenchError as err:  # a robot smaller or larger than arms are
        raise BenchError(f"tube of link {part.name!r}: {err}") from err
    return LinkProposal(part.name, line, tube, told_by if outer is None else "shape", drawn)


def _sites(chain: ImportedChain, tool: Array) -> tuple[Point, ...]:
    """The sites of the last part in the tool's frame if they can be markers, else none."""
    found = [site for site in chain.parts[-1].sites if site.name != chain.tip.name]
    places = np.array([site.pose[:3, 3] for site in found]).reshape(-1, 3)
    local = (places - tool[:3, 3]) @ tool[:3, :3]
    return () if on_a_line(local) else tuple((s.name, p) for s, p in zip(found, local, strict=True))


def _ahead(chain: ImportedChain, tool: Array, last: Beam, long: float) -> float:
    """How far the drawn end, of a flange or a gripper, is ahead of a tool in the last joint [m]."""
    surface = triangles(chain.parts[-1].shapes).reshape(-1, 3)
    if last.distance > COINCIDE * long or not len(surface):
        return 0.0
    return max(0.0, float(((surface - tool[:3, 3]) @ last.frame[:, 0]).max()))


def _ring(axes: Array, radius: float, ahead: float) -> tuple[Point, ...]:
    """Three markers around the tool's axis."""
    angles = 2 * np.pi * np.arange(3) / 3
    ring = ahead * axes[:, 0] + radius * (
        np.outer(np.cos(angles), axes[:, 1]) + np.outer(np.sin(angles), axes[:, 2])
    )
    return tuple((f"P{k}", np.round(place, MILLIMETRE) + 0.0) for k, place in enumerate(ring, start=1))
