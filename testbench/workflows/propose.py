"""Proposals for what a robot's file lacks: tubes, joint compliances, payload, tool, markers, load point.

Every rule is plain: docs/robot_files.md has them all, `testbench.workflows.new_arm` their words. The law of
the joints is fitted to the 13 joint compliances that we know from public data: a KR 500 by modal test, a
KR 270 and a UR10 by elastostatic calibration.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from testbench.arm.document import unique
from testbench.arm.elastic import PAYLOAD_RANGE
from testbench.arm.stiffness import Material, Tube
from testbench.errors import Array, BenchError
from testbench.files.robot.robot import Body, ImportedChain, ImportedSite, Note, Point
from testbench.workflows.beam import (
    COINCIDE,
    Beam,
    axial_extent,
    beam_reach,
    beams,
    outer_diameter,
    triangles,
)

ARM_COMPLIANCE = 0.33e-6  #: Of a joint that carries 1000 kg m [rad/(N m)].
POWER = 0.75  #: Compliance falls with this power of payload times reach [1].
WRIST = 6.0  #: Compliance of a joint of the wrist over that of one of the arm [1].
LEVER = 0.1  #: A slide is as stiff as a turning joint at this share of the reach [1].
WRIST_JOINTS = 3  #: Joints after the third are of the wrist, at most so many.
PAYLOAD_OFF = 3.0  #: A guess of a payload misses one arm in ten by more than this factor [1].
CAST_IRON_PAYLOAD = 100.0  #: Payload from which an arm is of cast iron [kg].
CAST_IRON, ALUMINIUM = Material(1.1e11, 0.26), Material(7.0e10, 0.33)
HOLLOW = 0.9  #: Inner over outer diameter, as of our KR 500 [1].
OUTER = 0.30  #: Outer diameter of a link that carries 1000 kg m where no shape tells it [m].
SLENDER = 0.2  #: It grows with this power of payload times reach [1].
SHORT_LINK = 0.05  #: A link shorter than this share of the reach is cut over the whole of its shape [1].
STUB = 0.5  #: No tube is shorter than this share of its diameter: wrists whose joints meet [1].
AROUND = 0.1  #: Distance of the proposed markers from the tool over the reach [1].
BEYOND = 0.05  #: Distance of the proposed load point from the tool, along its axis, over the reach [1].
FLAT = 0.05  #: Markers on a line: their spread across it is less than this share of that along it [1].
MILLIMETRE = 3  #: Digits of a proposed position in metres.

ToldBy = Literal["shape", "none", "pieces", "part"]
"""What tells an outer diameter: the link's shape; or payload and reach, where there is no shape, one in
pieces or one on a part of the link."""


@dataclass(frozen=True, eq=False)
class UserInputs:
    """What an engineer says of an arm that its file does not; None or empty where nothing is said."""

    payload: float | None = None  #: Rated payload [kg].
    tool: Array | None = None  #: Pose of the tool in the frame of the tip, (4, 4) [m].
    markers: tuple[Point, ...] = ()
    load: Array | None = None  #: Load point in the tool's frame, (3,) [m].


@dataclass(frozen=True, eq=False)
class LinkProposal:
    """The tube of a link."""

    name: str
    beam: Beam
    tube: Tube
    told_by: ToldBy  #: Of its outer diameter.
    drawn: float  #: How much of the link has a shape [m].


@dataclass(frozen=True, eq=False)
class Proposal:
    """What `testbench new` writes beside the robot's kinematics."""

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
    """Everything of an arm's folder that the robot's file does not hold.

    Args:
        chain: The robot, as its file has it.
        wishes: What the engineer said of it.

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
    """Compliance of a joint [rad/(N m), m/N].

    Args:
        payload: What the arm is built for [kg].
        long: Its reach [m].
        index: Of the joint, 0 the first.
        n_joints: How many the arm has.
        slides: Whether it slides.
    """
    c = float(ARM_COMPLIANCE * (payload * long / 1000) ** -POWER)
    if slides:
        return c * (LEVER * long) ** 2
    return c * WRIST if in_wrist(index, n_joints) else c


def in_wrist(index: int, n_joints: int) -> bool:
    """Whether a joint is of the wrist: the last ones after the third, three at most."""
    return index >= n_joints - min(WRIST_JOINTS, max(n_joints - 3, 0))


def estimated_payload(mass: float, long: float) -> float:
    """Payload of an arm that states none: the root of its mass [kg] times its reach [m], to two digits [kg].

    A fit to 129 arms that makers rate at 0.3 to 700 kg, two thirds of them weighed by their shapes, has these
    exponents and the factor 1 within its error. It misses them by a factor of 1.9 (root mean square of the
    logarithm), the worst by 5.4.
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


def on_a_line(positions: Array) -> bool:
    """Whether markers, (m, 3) [m], are fewer than three or lie on a line."""
    if len(positions) < 3:
        return True
    along, across, *_ = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    return bool(across <= FLAT * along)


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
