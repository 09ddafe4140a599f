"""What the robot's file does not say, proposed: tubes, joint compliances, payload, tool, markers, load point.

Every rule is plain and every number says "estimated" and how: docs/own_arm.md has them all.
"""

from dataclasses import dataclass

from testbench.arm.elastic import PAYLOAD_RANGE
from testbench.arm.folder import COMPLIANCE_UNIT
from testbench.errors import Array, BenchError
from testbench.plant.import_robot.beam import Beam, beams, extent, outer_diameter, reach, triangles
from testbench.plant.import_robot.chain import Chain, Part
from testbench.plant.import_robot.classes import (
    GUESSED,
    Class,
    estimated_payload,
    in_wrist,
    joint_compliance,
    tube_of,
)
from testbench.plant.import_robot.elastic_text import JointRow, LinkRow, Rows, elastic_text
from testbench.plant.import_robot.points import points, tool_pose, unique
from testbench.plant.import_robot.wishes import Wishes

SHORT = 0.05  #: A link shorter than this share of the reach is cut over the whole of its shape [1].
STUB = 0.5  #: No tube is shorter than this share of its diameter: wrists whose joints meet [1].


@dataclass(frozen=True, eq=False)
class Proposal:
    """What `testbench new` writes beside the robot's kinematics."""

    tool: Array  #: Pose of the tool in the last part, (4, 4) [m].
    tool_name: str  #: Of its body: "tool", or with underscores where the robot has one of that name.
    load: Array  #: Load point in the tool's frame, (3,) [m].
    load_name: str  #: Of its body.
    markers: tuple[tuple[str, Array], ...]  #: Name of the body and position in the tool's frame, (3,) [m].
    elastic: str  #: Text of elastic.toml.


def propose(chain: Chain, wishes: Wishes) -> Proposal:
    """Everything of an arm's folder that the robot's file does not hold.

    Args:
        chain: The robot, as its file has it.
        wishes: What the engineer said of it.

    Returns:
        Places of tool, load point and markers, and the text of elastic.toml; all that nobody stated has the
        origin "estimated".
    """
    tool = tool_pose(chain, wishes)
    lines, long = beams(chain, tool), reach(chain, tool)
    payload, payload_note = _payload(chain, wishes)
    of = Class(payload, long)
    placed = points(chain, wishes, lines[-1], long)
    taken = [part.name for part in chain.parts]
    tool_name = unique("tool", taken)
    load_name = unique("load", [*taken, tool_name])
    markers: list[tuple[str, Array]] = []
    for name, place in placed.markers:
        name = unique(name, [*taken, tool_name, load_name, *(other for other, _ in markers)])
        markers.append((name, place))
    rows = Rows(
        name=chain.name,
        of=of,
        payload_origin="estimated" if wishes.payload is None else "published",
        payload_note=payload_note,
        tool=tool_name,
        load=load_name,
        markers=tuple(name for name, _ in markers),
        proposed=placed.proposed,
        links=tuple(_link(p, line, of) for p, line in zip(chain.parts, lines, strict=True)),
        joints=tuple(_joint(chain, k, of) for k in range(chain.n_joints)),
    )
    return Proposal(tool, tool_name, placed.load, load_name, tuple(markers), elastic_text(rows))


def _payload(chain: Chain, wishes: Wishes) -> tuple[float, str]:
    """Payload [kg] and how it is known."""
    if wishes.payload is not None:
        return wishes.payload, "as stated by --payload-kg"
    bare = [part.name for part in chain.parts[1:] if part.inertia_from != "file"]
    long = reach(chain, chain.tip)
    note = f"root of its {chain.mass:.4g} kg, times {long:.2f} m of reach"
    if bare:
        no = "masses" if len(bare) == chain.n_joints else f"mass of {', '.join(bare)}"
        note += f", the file has no {no}"
    payload, (low, high) = estimated_payload(chain.mass, long), PAYLOAD_RANGE
    if not low <= payload <= high:
        raise BenchError(f"payload: expected {low:g} to {high:g} kg, got {note}; state it by --payload-kg")
    return payload, note


def _outer(part: Part, line: Beam, of: Class) -> tuple[float, str]:
    """Outer diameter of a link's tube [m], and how it is known."""
    surface = triangles(part.shapes)
    if not len(surface):
        return of.outer_diameter, f"no shape, {GUESSED}"
    low, high = extent(surface, line.frame[:, 0])
    where = "in pieces"
    if line.distance >= SHORT * of.reach:
        drawn = max(0.0, min(high, line.distance) - max(low, 0.0))
        where = f"on {1000 * drawn:.0f} of {1000 * line.distance:.0f} mm"
        low, high = 0.0, line.distance
    outer = outer_diameter(surface, line.frame, (low, high))
    if outer is None:
        return of.outer_diameter, f"its shape is {where}, {GUESSED}"
    return outer, "its shape, median of the cuts"


def _link(part: Part, line: Beam, of: Class) -> LinkRow:
    """The tube of a link."""
    outer, note = _outer(part, line, of)
    length, runs = line.distance, line.runs
    if length < STUB * outer:
        length, runs = STUB * outer, f"half the diameter: {1000 * length:.0f} mm {line.runs}"
    try:
        tube = tube_of(length, outer, of.material)
    except BenchError as err:  # a robot smaller or larger than arms are
        raise BenchError(f"tube of link {part.name!r}: {err}") from err
    return LinkRow(part.name, line.frame, tube, runs, note)


def _joint(chain: Chain, k: int, of: Class) -> JointRow:
    """The compliance of a joint."""
    joint = chain.parts[k + 1].joint
    assert joint is not None  # every part but the base has one
    c = joint_compliance(of, k, chain.n_joints, joint.prismatic)
    kind = "slide" if joint.prismatic else "wrist" if in_wrist(k, chain.n_joints) else "arm"
    return JointRow(joint.name, c, COMPLIANCE_UNIT[joint.prismatic], kind)
