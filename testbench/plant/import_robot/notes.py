"""What became of a stranger's bodies, a sentence each: for the one who must confirm it."""

import math
from collections.abc import Collection

from testbench.plant.import_robot.chain import JointOf, Part
from testbench.plant.import_robot.merge import SPECK, Placed
from testbench.plant.import_robot.tree import Body


def what_became(
    bodies: tuple[Body, ...],
    placed: dict[int, Placed],
    path: list[int],
    parts: tuple[Part, ...],
    rods: Collection[int],
) -> list[str]:
    """What was merged, frozen, left out or stood in for, a sentence each."""
    notes = []
    for index, part in enumerate(parts):
        own = [bodies[k] for k in placed if placed[k].part == index and bodies[k].name != part.name]
        if heavy := [body.name for body in own if body.mass > 0]:
            notes.append(f"merged into {part.name}: {', '.join(heavy)}")
    frozen = [
        body.joint.name if body.joint else body.name
        for k, body in enumerate(bodies)
        if k in placed and k not in path and body.moves
    ]
    if frozen:
        notes.append(f"off the arm, so held at zero: {', '.join(frozen)}")
    if touching := [bodies[k].name for k in sorted(rods) if bodies[k].shapes]:
        names = ", ".join(touching)
        notes.append(f"held at zero they do not follow the arm, so their collisions do not count: {names}")
    if outside := [body.name for k, body in enumerate(bodies) if k not in placed]:
        notes.append(f"not of this arm, so left out: {', '.join(outside)}")
    for part in parts:
        if part.joint is not None and part.joint.limits_from == "none":
            notes.append(f"no limits of {part.joint.name} in the file: {_limits(part.joint)} stands in")
    if specks := [part.name for part in parts if part.mass == SPECK and part.inertia_from == "geometry"]:
        notes.append(
            f"no mass in the file, nor any to estimate: {SPECK * 1e6:g} mg stands in for {', '.join(specks)}"
        )
    return notes


def _limits(joint: JointOf) -> str:
    if joint.prismatic:
        return f"{joint.lower:g} to {joint.upper:g} m"
    return f"{math.degrees(joint.lower):.0f} to {math.degrees(joint.upper):.0f} deg"
