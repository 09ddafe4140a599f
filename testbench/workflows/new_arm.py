"""Folder of an arm from a robot's file: rigid.xml, elastic.toml, meshes, and notes on what was read."""

import json
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

from testbench.arm.folder import COMPLIANCE_UNIT, OFFSETS
from testbench.errors import Array
from testbench.files.robot.robot import ImportedChain, Note
from testbench.files.robot.write import rigid_mjcf
from testbench.workflows.arm_doubts import GUESSED
from testbench.workflows.propose import (
    ALUMINIUM,
    LinkProposal,
    Proposal,
    UserInputs,
    beam_reach,
    in_wrist,
    propose,
)

SPREAD = 1.9  #: The law misses the known compliances by this factor, root mean square of the logarithm [1].
CONFIRM = "#  "  #: Before each guess, in elastic.toml.
TOLD = 4  #: Meshes that a note names; the others it counts.
WORDS = {
    "density": "{0:.4g} kg in the file are {1:.0f} kg/m^3 inside of the shapes: check the masses",
    "follow": "joints that follow others, as [joints] of elastic.toml says: {names}",
    "frozen": "off the arm, so held at zero: {names}",
    "geoms weigh": "no <inertial> in the file, so MuJoCo weighs the geoms: {names}",
    "left out": "not needed for statics, so left out: {names}",
    "load": "load point on the tool's axis, {mm:.0f} mm beyond the tool",
    "locked": "limits of 0 to 0, so held at zero: {names}",
    "markers": "markers {mm:.0f} mm from the tool",
    "merged": "merged into {first}: {rest}",
    "meshes": "meshes not read; other shapes of their links are used, if any: {names}",
    "no limits": "no limits of {first} in the file: {deg[0]:.0f} to {deg[1]:.0f} deg is assumed",
    "no limits of a slide": "no limits of {first} in the file: {0:g} to {1:g} m is assumed",
    "no masses": "no mass in the file: {0:g} kg/m^3 inside of the shapes is assumed, {1:.4g} kg in all: "
    "{names}",
    "outside": "not of this arm, so left out: {names}",
    "placeholders": "every link weighs {0:g} kg in the file, which no arm does: not used",
    "renamed": "names made fit: {names}",
    "rods": "held at zero they do not follow the arm, so their collisions do not count: {names}; "
    "a balancer's spring is for [compensator] of elastic.toml",
    "sites": "markers at the sites of the robot's file",
    "specks": "no mass in the file, nor any to estimate: {mg:g} mg is assumed for {names}",
    "tool": "tool at {first!r} of the robot's file",
    "touching": "hulls that touch in most poses, so their collisions do not count: {names}",
}
"""Sentence of every kind of note."""
RUNS = {
    "along the next joint": "along the next joint's axis: both joints in one point",
    "along the flange": "along the flange's axis: joint and tool in one point",
}
"""Where a beam runs, in words, if those of its kind are not enough."""


def sentence(note: Note) -> str:
    """Write a note in words."""
    names = note.names
    if note.kind == "meshes" and len(names) > TOLD:
        names = (*names[:TOLD], f"and {len(names) - TOLD} more")
    first, value = (*names, "")[0], (*note.numbers, 0.0)[0]
    return WORDS[note.kind].format(
        *note.numbers,
        names=", ".join(names),
        first=first,
        rest=", ".join(names[1:]),
        mm=1000 * value,
        mg=1e6 * value,
        deg=[math.degrees(x) for x in note.numbers],
    )


def write_arm(chain: ImportedChain, wishes: UserInputs, folder: Path) -> list[str]:
    """Write everything of an arm's folder.

    Args:
        chain: The robot, as its file has it.
        wishes: What the engineer said of it.
        folder: An empty one.

    Returns:
        What was understood and done, which rigid.xml says too, and what was guessed, a sentence each.

    Raises:
        BenchError: When MuJoCo refuses the arm.
        OSError: When the folder cannot be written.
    """
    proposal = propose(chain, wishes)
    root, meshes, touching = rigid_mjcf(chain, proposal.tool, [*proposal.markers, proposal.load])
    pairs = tuple(f"{one} and {other}" for one, other in touching)
    notes = [sentence(note) for note in (*chain.notes, *([Note("touching", pairs)] if pairs else []))]
    zero = f"{chain.n_joints} joints; origins lie on their axes, and q = 0 is the zero of the robot's file"
    for k, note in enumerate((zero, *notes)):
        root.insert(k, ET.Comment(f" {re.sub('-(?=-)', '- ', note)} "))  # no comment may hold two hyphens
    ET.indent(root)
    (folder / "rigid.xml").write_text(ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")
    elastic = elastic_toml(chain, wishes, proposal)
    (folder / "elastic.toml").write_text(elastic, encoding="utf-8")
    if meshes:
        (folder / "meshes").mkdir()
    for name, data in meshes.items():
        (folder / "meshes" / name).write_bytes(data)
    guessed = [line.partition(". ")[2] for line in elastic.splitlines() if line.startswith(CONFIRM)]
    return [*notes, *(f"estimated: {words}" for words in guessed)]


def elastic_toml(chain: ImportedChain, wishes: UserInputs, proposal: Proposal) -> str:
    """Write elastic.toml: what to confirm, then the numbers, each with how it is known.

    Args:
        chain: The robot, as its file has it.
        wishes: What the engineer said of it.
        proposal: Numbers that the file lacks.

    Returns:
        The text.
    """
    payload, note = _quantity(proposal.payload, "kg", "as stated by --payload-kg", "published"), ""
    if wishes.payload is None:
        note = f"from its mass of {chain.mass:.4g} kg and reach of {beam_reach(chain, chain.tip.pose):.2f} m"
        if bare := [part.name for part in chain.parts[1:] if not part.weighed]:
            no = "masses" if len(bare) == chain.n_joints else f"mass of {', '.join(bare)}"
            note += f", the file has no {no}"
        payload = _quantity(proposal.payload, "kg", note)
    names = {"tool": [proposal.tool.name], "load": [proposal.load[0]]}
    names["markers"] = names["sites"] = [name for name, _ in proposal.markers]
    proposed = [note._replace(names=(chain.tip.name,)) for note in proposal.proposed]
    text = [
        *_to_confirm(chain.name, proposal, note, [sentence(one) for one in proposed]),
        "format = 1",
        f"title = {_word(chain.name)}",
        f"tool = {_word(proposal.tool.name)}",
        f"load = {_word(proposal.load[0])}",
        f"markers = {_words(names['markers'])}",
        f"to_confirm = {_words([name for note in proposed for name in names[note.kind]])}",
        f"payload = {payload}",
        *_joint_rows(chain),
    ]
    for link in proposal.links:
        text += _link_text(link, _material(proposal))
    for k, (joint, c) in enumerate(zip(chain.joints, proposal.compliances, strict=True)):
        kind = "slide" if joint.prismatic else "wrist" if in_wrist(k, chain.n_joints) else "arm"
        note = f"{kind} joint, {proposal.payload:g} kg at {proposal.reach:.2f} m"
        compliance = _quantity(float(f"{c:.2g}"), COMPLIANCE_UNIT[joint.prismatic], note)
        text += ["", "[[joint]]", f"name = {_word(joint.name)}", f"compliance = {compliance}"]
    return "\n".join(text) + "\n"


def _joint_rows(chain: ImportedChain) -> list[str]:
    """The table [joints] of joints that follow others."""
    joint_map = chain.joint_map
    if joint_map is None:
        return []
    lines = ["", "[joints]"]
    for k, joint in enumerate(chain.joints):
        row = {name: c for name, c in zip(joint_map.names, joint_map.L[k].tolist(), strict=True) if c}
        offset = 1e3 * joint_map.q_0[k] if joint.prismatic else math.degrees(joint_map.q_0[k])
        if row == {joint.name: 1.0} and not offset:
            continue
        cells = [f"{name} = {c!r}" for name, c in row.items()]  # such names stand without quotes
        cells += [f"{OFFSETS[joint.prismatic]} = {round(float(offset), 12)!r}"] if offset else []
        lines.append(f"{joint.name} = {{ {', '.join(cells)} }}")
    return lines


def _to_confirm(name: str, proposal: Proposal, payload: str, proposed: Sequence[str]) -> list[str]:
    """Comments: what matters most for the sag first; the payload's note is empty where somebody states it."""
    confirm = [
        *([f"payload {proposal.payload:g} kg, {payload}; joint compliances depend on it"] if payload else []),
        f"joint compliances, by a rule that differs from known robots by a factor of {SPREAD:g}",
        f"tubes of the links: {_material(proposal)}, outer diameter from the shapes, inner 0.9 of it",
        *proposed,
    ]
    name = " ".join("".join(c if c.isprintable() else " " for c in name).split())  # on one line
    return [
        f"# {name}: proposed from its geometry; nobody has measured these numbers.",
        "# To confirm, the largest effect on the sag first; `testbench check` puts numbers to it:",
        *(f"{CONFIRM}{k}. {words}." for k, words in enumerate(confirm, start=1)),
        '# Where you know better, change the value and its origin: "published", "inferred" or "assumed".',
        "# Tool, load point and markers are bodies of rigid.xml; take out of to_confirm what stands right.",
    ]


def _material(proposal: Proposal) -> str:
    return "aluminium" if proposal.links[0].tube.youngs_modulus == ALUMINIUM.E else "grey cast iron"


def _link_text(link: LinkProposal, made: str) -> list[str]:
    """The tube of a link."""
    tube, beam, distance = link.tube, link.beam, 1000 * link.beam.distance
    runs = RUNS.get(beam.runs, beam.runs)
    if round(beam.distance, 6) < tube.length:
        runs = f"half the diameter: {distance:.0f} mm {runs}"
    told = {
        "shape": "its shape, median of the cuts",
        "none": f"no shape, {GUESSED}",
        "pieces": f"its shape is in pieces, {GUESSED}",
        "part": f"its shape covers {1000 * link.drawn:.0f} of {distance:.0f} mm, {GUESSED}",
    }
    return [
        "",
        "[[link]]",
        f"name = {_word(link.name)}",
        f"axis = {_vector(beam.frame[:, 0])}",
        f"normal = {_vector(beam.frame[:, 1])}",
        f"tube.length = {_quantity(tube.length, 'm', runs)}",
        f"tube.outer_diameter = {_quantity(tube.outer_diameter, 'm', told[link.told_by])}",
        f"tube.inner_diameter = {_quantity(tube.inner_diameter, 'm', '0.9 of outer')}",
        f"tube.youngs_modulus = {_quantity(tube.youngs_modulus, 'Pa', made)}",
        f"tube.poissons_ratio = {_quantity(tube.poissons_ratio, '1', made)}",
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
