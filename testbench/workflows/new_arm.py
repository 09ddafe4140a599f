"""Folder of an arm from a robot's file: rigid.xml, elastic.toml, meshes, and notes on what was read.

Proposals for what a robot's file lacks: tubes, joint compliances, payload, tool, markers, load point.

Every rule is plain: docs/robot_files.md has them all, `testbench.workflows.new_arm` their words. The law of
the joints is fitted to the 13 joint compliances that we know from public data: a KR 500 by modal test, a
KR 270 and a UR10 by elastostatic calibration.

Equivalent beam of a link: its line from joint to joint, and the diameter of its drawn surface.
"""

import json
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from testbench.arm.document import unused_name
from testbench.arm.elastic import PAYLOAD_RANGE, Material, Tube
from testbench.arm.folder import JOINT_COMPLIANCE_UNITS, OFFSET_KEYS
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
from testbench.files.robot.write import rigid_mjcf
from testbench.workflows.arm_check import COINCIDE, PARALLEL, flange_axis, on_a_line

# --- Proposals for what a robot's file lacks ----------------------------------------------------------------

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
    sides = surface[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 3)
    p, q = sides[(sides[:, 0, 0] < x) != (sides[:, 1, 0] < x)].swapaxes(0, 1)
    share = (x - p[:, 0]) / (q[:, 0] - p[:, 0])
    points = p[:, 1:] + share[:, None] * (q[:, 1:] - p[:, 1:])
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
        got = f"got {payload:g} kg, estimated from its mass of {chain.mass:.4g} kg and its reach"
        raise BenchError(f"payload: expected {low:g} to {high:g} kg, {got}; state it by --payload-kg")
    ahead = _ahead(chain, tool, lines[-1], long)
    axes = tool[:3, :3].T @ lines[-1].frame  # beam axes in the tool's frame, as columns
    sites, taken = _sites(chain, tool), [part.name for part in chain.parts]
    taken.append(tool_name := unused_name("tool", taken))
    taken.append(load_name := unused_name("load", taken))
    load = np.round((ahead + BEYOND * long) * axes[:, 0], MILLIMETRE) if wishes.load is None else wishes.load
    markers: list[Point] = []
    for name, place in wishes.markers or sites or _ring(axes, AROUND * long, ahead):
        taken.append(name := unused_name(name, taken))
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
        along = surface @ line.frame[:, 0]
        low, high = float(along.min()), float(along.max())
        told_by = "pieces"
        if line.distance >= SHORT_LINK * long:
            drawn = max(0.0, min(high, line.distance) - max(low, 0.0))
            low = 0.0
            high = line.distance
            told_by = "part"
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


# --- Folder of an arm from a robot's file: rigid.xml, elastic.toml, meshes, and notes on what was read ------

SPREAD = 1.9  #: The law misses the known compliances by this factor, root mean square of the logarithm [1].
CONFIRM = "#  "  #: Before each guess, in elastic.toml.
TOLD = 4  #: Meshes that a note names; the others it counts.
GUESSED = "so from payload and reach"  #: Ends the note of a diameter that no shape tells.
WORDS = {
    "endless limits": "limits of {first} in the file, {2:g} to {3:g} rad, are ignored: {deg[0]:.0f} to "
    "{deg[1]:.0f} deg is assumed",
    "endless limits of a slide": "limits of {first} in the file, {2:g} to {3:g} m, are ignored (are they "
    "mm?): {0:g} to {1:g} m is assumed",
    "far limits of a slide": "limits beyond {0:g} m, whose numbers may be mm: {names}",
    "far limits": "limits beyond {deg[0]:.0f} deg, whose numbers may be degrees, not radians: {names}",
    "follow": "joints that follow others, as [joints] of elastic.toml says: {names}",
    "frozen": "not between base and tool, so held at zero: {names}",
    "geoms weigh": "no <inertial> in the file, so MuJoCo computes masses from the geoms: {names}",
    "left out": "not needed for statics, so left out: {names}",
    "load": "load point on the tool's axis, {mm:.0f} mm beyond the tool",
    "locked": "limits of 0 to 0, so held at zero: {names}",
    "markers": "markers {mm:.0f} mm from the tool",
    "merged": "bodies merged into {first}: {rest}",
    "meshes": "meshes not read; other shapes of their links are used, if any: {names}",
    "narrow limits": "ranges below {deg[0]:.0f} deg, whose numbers may be radians, not degrees: {names}",
    "no limits": "no limits of {first} in the file: {deg[0]:.0f} to {deg[1]:.0f} deg is assumed",
    "no limits of a slide": "no limits of {first} in the file: {0:g} to {1:g} m is assumed",
    "no masses": "no mass in the file: {0:g} kg/m^3 in the shapes is assumed, {1:.4g} kg in all: {names}",
    "outside": "not of this arm, so left out: {names}",
    "placeholders": "every link weighs {0:g} kg in the file, which no arm does: not used",
    "renamed": "names changed to allowed ones: {names}",
    "rods": "not checked for collisions, because their joints are held at zero: {names}; if they are a "
    "balancer, describe its spring in [compensator] of elastic.toml",
    "springs": "springs in the file are left out: {names}; describe a balancer's spring in [compensator] of "
    "elastic.toml",
    "gravcomp": "gravcomp in the file is left out, so these bodies have their weight: {names}",
    "sites": "markers at the sites of the robot's file",
    "specks": "no mass in the file, nor any to estimate: {mg:g} mg is assumed for {names}",
    "tool": "tool at {first!r} of the robot's file",
    "touching": "not checked for collisions, because their hulls touch in most poses: {names}",
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
        reach = beam_reach(chain, chain.tip.pose)
        note = f"from the arm's mass of {chain.mass:.4g} kg and reach of {reach:.2f} m"
        if bare := [part.name for part in chain.parts[1:] if not part.weighed]:
            no = "masses" if len(bare) == chain.n_joints else f"mass of {', '.join(bare)}"
            note += f" (partly assumed: the file has no {no})"
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
        compliance = _quantity(float(f"{c:.2g}"), JOINT_COMPLIANCE_UNITS[joint.prismatic], note)
        text += ["", "[[joint]]", f"name = {_word(joint.name)}", f"compliance = {compliance}"]
    return "\n".join(text) + "\n"


def _joint_rows(chain: ImportedChain) -> list[str]:
    """The table [joints] of joints that follow others."""
    joint_map = chain.joint_map
    if joint_map is None:
        return []
    lines = ["", "[joints]"]
    for k, joint in enumerate(chain.joints):
        row = {
            name: c for name, c in zip(joint_map.file_joint_names, joint_map.L[k].tolist(), strict=True) if c
        }
        offset = 1e3 * joint_map.q_0[k] if joint.prismatic else math.degrees(joint_map.q_0[k])
        if row == {joint.name: 1.0} and not offset:
            continue
        cells = [f"{name} = {c!r}" for name, c in row.items()]  # such names stand without quotes
        cells += [f"{OFFSET_KEYS[joint.prismatic]} = {round(float(offset), 12)!r}"] if offset else []
        lines.append(f"{joint.name} = {{ {', '.join(cells)} }}")
    return lines


def _to_confirm(name: str, proposal: Proposal, payload: str, proposed: Sequence[str]) -> list[str]:
    """Comments: what matters most for the sag first; the payload's note is empty where somebody states it."""
    stated = f"payload {proposal.payload:g} kg, {payload}; the joint compliances depend on this payload"
    confirm = [
        *([stated] if payload else []),
        f"joint compliances, by a rule whose typical error on known robots is a factor of {SPREAD:g}",
        f"links as tubes of {_material(proposal)}; outer diameter from the shapes, inner diameter 0.9 of it",
        *proposed,
    ]
    name = " ".join("".join(c if c.isprintable() else " " for c in name).split())  # on one line
    return [
        f"# {name}: proposed from its geometry; nobody has measured these numbers.",
        "# Please confirm, the largest effect on the deflection first (`testbench check` prints them):",
        *(f"{CONFIRM}{k}. {words}." for k, words in enumerate(confirm, start=1)),
        '# Where you know better, change the value and its origin: "published", "inferred" or "assumed".',
        "# Tool, load point and markers are bodies of rigid.xml. Remove from to_confirm what you checked.",
    ]


def _material(proposal: Proposal) -> str:
    return "aluminium" if proposal.links[0].tube.youngs_modulus == ALUMINIUM.E else "grey cast iron"


def _link_text(link: LinkProposal, made: str) -> list[str]:
    """The tube of a link."""
    tube = link.tube
    beam = link.beam
    distance = 1000 * link.beam.distance
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
