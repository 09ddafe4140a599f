"""What the robot's file does not say, proposed: tubes, joint compliances, payload, tool, markers, load point.

Every rule is plain and every number says "estimated" and how: docs/own_arm.md has them all. elastic.toml
says what to confirm on top, then the numbers.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass

from testbench.arm.elastic import PAYLOAD_RANGE
from testbench.arm.folder import COMPLIANCE_UNIT
from testbench.errors import Array, BenchError
from testbench.plant.import_robot.beam import Beam, beams, extent, outer_diameter, reach, triangles
from testbench.plant.import_robot.chain import Chain, Part
from testbench.plant.import_robot.classes import (
    GUESSED,
    SPREAD,
    Class,
    estimated_payload,
    in_wrist,
    joint_compliance,
    tube_of,
)
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
    names = {"tool": [tool_name], "load": [load_name], "markers": [name for name, _ in markers]}
    origin = "estimated" if wishes.payload is None else "published"
    text = _to_confirm(chain.name, of, origin, payload_note, placed.proposed)
    text += [
        "format = 1",
        f"title = {_word(chain.name)}",
        f"tool = {_word(tool_name)}",
        f"load = {_word(load_name)}",
        f"markers = {_words(names['markers'])}",
        f"to_confirm = {_words([name for what, _ in placed.proposed for name in names[what]])}",
        f"payload = {_quantity(payload, 'kg', payload_note, origin)}",
    ]
    for part, line in zip(chain.parts, lines, strict=True):
        text += _link(part, line, of)
    for k in range(chain.n_joints):
        text += _joint(chain, k, of)
    elastic = "\n".join(text) + "\n"
    return Proposal(tool, tool_name, placed.load, load_name, tuple(markers), elastic)


def _to_confirm(
    name: str, of: Class, origin: str, note: str, proposed: Sequence[tuple[str, str]]
) -> list[str]:
    """What a person must confirm, the largest effect on the sag first."""
    payload = f"payload {of.payload:g} kg, {note}: sag and joint compliances follow from it"
    confirm = [
        *([payload] if origin == "estimated" else []),
        f"compliance of the joints, by a law that misses known ones by a factor of {SPREAD:g}",
        f"tubes of the links: diameter by the drawn shape, {of.material.name}, inner 0.9 of outer",
        *(words for _, words in proposed),
    ]
    return [
        f"# {_plain(name)}: proposed from its geometry; nobody has measured these numbers.",
        "# To confirm, the largest effect on the sag first; `testbench check` puts numbers to it:",
        *(f"#  {k}. {words}." for k, words in enumerate(confirm, start=1)),
        '# Where you know better, change the value and its origin: "published", "inferred" or "assumed".',
        "# Tool, load point and markers are bodies of rigid.xml; take out of to_confirm what stands right.",
    ]


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


def _link(part: Part, line: Beam, of: Class) -> list[str]:
    """The tube of a link."""
    outer, note = _outer(part, line, of)
    length, runs = line.distance, line.runs
    if length < STUB * outer:
        length, runs = STUB * outer, f"half the diameter: {1000 * length:.0f} mm {line.runs}"
    try:
        tube = tube_of(length, outer, of.material)
    except BenchError as err:  # a robot smaller or larger than arms are
        raise BenchError(f"tube of link {part.name!r}: {err}") from err
    made = of.material.name
    return [
        "",
        "[[link]]",
        f"name = {_word(part.name)}",
        f"axis = {_vector(line.frame[:, 0])}",
        f"normal = {_vector(line.frame[:, 1])}",
        f"tube.length = {_quantity(tube.length, 'm', runs)}",
        f"tube.outer_diameter = {_quantity(tube.outer_diameter, 'm', note)}",
        f"tube.inner_diameter = {_quantity(tube.inner_diameter, 'm', '0.9 of outer')}",
        f"tube.youngs_modulus = {_quantity(tube.youngs_modulus, 'Pa', made)}",
        f"tube.poissons_ratio = {_quantity(tube.poissons_ratio, '1', made)}",
    ]


def _joint(chain: Chain, k: int, of: Class) -> list[str]:
    """The compliance of a joint."""
    joint = chain.parts[k + 1].joint
    assert joint is not None  # every part but the base has one
    c = joint_compliance(of, k, chain.n_joints, joint.prismatic)
    kind = "slide" if joint.prismatic else "wrist" if in_wrist(k, chain.n_joints) else "arm"
    note = f"{kind} joint, {of.payload:g} kg at {of.reach:.2f} m"
    return [
        "",
        "[[joint]]",
        f"name = {_word(joint.name)}",
        f"compliance = {_quantity(float(f'{c:.2g}'), COMPLIANCE_UNIT[joint.prismatic], note)}",
    ]


def _quantity(value: float, unit: str, note: str, origin: str = "estimated") -> str:
    return f'{{ value = {_number(value)}, unit = "{unit}", origin = "{origin}", note = {_word(note)} }}'


def _number(value: float) -> str:
    """TOML wants a point or an exponent in a float."""
    text = f"{value:.9g}"
    return text if set(text) & set(".en") else text + ".0"


def _vector(v: Array) -> str:
    """Unit vectors to nine digits: at six they are no longer at right angles to one in a million."""
    return f"[{', '.join(_number(round(float(x), 9) + 0.0) for x in v)}]"


def _words(texts: Sequence[str]) -> str:
    return f"[{', '.join(map(_word, texts))}]"


def _word(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _plain(text: str) -> str:
    """On one line of a comment."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
