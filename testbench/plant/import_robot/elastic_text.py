"""elastic.toml of a proposed arm: what to confirm on top, then the numbers."""

import json
from dataclasses import dataclass

from testbench.arm.stiffness import Tube
from testbench.errors import Array
from testbench.plant.import_robot.classes import SPREAD, Class


@dataclass(frozen=True, eq=False)
class LinkRow:
    """A link of the file."""

    name: str
    frame: Array  #: Beam axes as columns, (3, 3) [1].
    tube: Tube
    runs: str  #: Where it runs.
    outline: str  #: What its diameter comes from.


@dataclass(frozen=True)
class JointRow:
    """A joint of the file."""

    name: str
    compliance: float  #: [rad/(N m), m/N]
    unit: str
    kind: str  #: "arm", "wrist" or "slide".


@dataclass(frozen=True, eq=False)
class Rows:
    """What the file says."""

    name: str  #: The robot.
    of: Class  #: What it is built for.
    payload_origin: str
    payload_note: str
    tool: str
    load: str
    markers: tuple[str, ...]
    #: Places that nobody has stated: "tool", "load" or "markers"; words.
    proposed: tuple[tuple[str, str], ...]
    links: tuple[LinkRow, ...]
    joints: tuple[JointRow, ...]


def elastic_text(rows: Rows) -> str:
    """The file."""
    lines = [*_head(rows), *_top(rows)]
    for link in rows.links:
        lines += _link(link, rows.of)
    for joint in rows.joints:
        lines += _joint(joint, rows.of)
    return "\n".join(lines) + "\n"


def _head(rows: Rows) -> list[str]:
    """What a person must confirm, the largest effect on the sag first."""
    payload = f"payload {rows.of.payload:g} kg, {rows.payload_note}: sag and joint compliances follow from it"
    confirm = [
        *([payload] if rows.payload_origin == "estimated" else []),
        f"compliance of the joints, by a law that misses known ones by a factor of {SPREAD:g}",
        f"tubes of the links: diameter by the drawn shape, {rows.of.material.name}, inner 0.9 of outer",
        *(words for _, words in rows.proposed),
    ]
    numbered = [f"#  {k}. {words}." for k, words in enumerate(confirm, start=1)]
    return [
        f"# {_plain(rows.name)}: proposed from its geometry; nobody has measured these numbers.",
        "# To confirm, the largest effect on the sag first; `testbench check` puts numbers to it:",
        *numbered,
        '# Where you know better, change the value and its origin: "published", "inferred" or "assumed".',
        "# Tool, load point and markers are bodies of rigid.xml; take out of to_confirm what stands right.",
    ]


def _top(rows: Rows) -> list[str]:
    names = {"tool": [rows.tool], "load": [rows.load], "markers": rows.markers}
    unsure = [name for what, _ in rows.proposed for name in names[what]]
    payload = _quantity(rows.of.payload, "kg", rows.payload_note, rows.payload_origin)
    return [
        "format = 1",
        f"title = {_word(rows.name)}",
        f"tool = {_word(rows.tool)}",
        f"load = {_word(rows.load)}",
        f"markers = [{', '.join(map(_word, rows.markers))}]",
        f"to_confirm = [{', '.join(map(_word, unsure))}]",
        f"payload = {payload}",
    ]


def _link(link: LinkRow, of: Class) -> list[str]:
    tube, made = link.tube, of.material.name
    return [
        "",
        "[[link]]",
        f"name = {_word(link.name)}",
        f"axis = {_vector(link.frame[:, 0])}",
        f"normal = {_vector(link.frame[:, 1])}",
        f"tube.length = {_quantity(tube.length, 'm', link.runs)}",
        f"tube.outer_diameter = {_quantity(tube.outer_diameter, 'm', link.outline)}",
        f"tube.inner_diameter = {_quantity(tube.inner_diameter, 'm', '0.9 of outer')}",
        f"tube.youngs_modulus = {_quantity(tube.youngs_modulus, 'Pa', made)}",
        f"tube.poissons_ratio = {_quantity(tube.poissons_ratio, '1', made)}",
    ]


def _joint(joint: JointRow, of: Class) -> list[str]:
    note = f"{joint.kind} joint, {of.payload:g} kg at {of.reach:.2f} m"
    return [
        "",
        "[[joint]]",
        f"name = {_word(joint.name)}",
        f"compliance = {_quantity(float(f'{joint.compliance:.2g}'), joint.unit, note)}",
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


def _word(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _plain(text: str) -> str:
    """On one line of a comment."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
