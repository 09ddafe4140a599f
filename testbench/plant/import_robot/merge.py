"""Bodies joined to parts: what is fixed goes with its carrier, what branches off stands at zero."""

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array
from testbench.plant.import_robot.chain import JointOf, Part, Shape, Site, Solid, moved, pose_of
from testbench.plant.import_robot.solids import combined
from testbench.plant.import_robot.tree import Body

SPECK = 1e-6  #: Mass of a part of which the file says nothing [kg].


@dataclass(frozen=True, eq=False)
class Placed:
    """Where a body has gone."""

    part: int  #: Index of its part.
    pose: Array  #: In the part's frame, (4, 4) [m].


def place(bodies: tuple[Body, ...], path: list[int]) -> dict[int, Placed]:
    """The part of every body of the arm, and its pose there; branches stand at zero."""
    placed: dict[int, Placed] = {}
    first = next(k for k in path if bodies[k].joint is not None)
    base = path[path.index(first) - 1]
    backwards = np.eye(4)
    for k in reversed(path[: path.index(first)]):  # what stands below the base belongs to it
        placed[k] = Placed(0, backwards)
        backwards = backwards @ np.linalg.inv(bodies[k].pose)
    assert np.array_equal(placed[base].pose, np.eye(4))
    joints = 0
    for k in path[path.index(first) :]:
        if bodies[k].joint is not None:
            joints += 1
            placed[k] = Placed(joints, np.eye(4))
        else:
            placed[k] = Placed(joints, placed[bodies[k].parent].pose @ bodies[k].pose)
    for k, body in enumerate(bodies):
        if k not in placed and body.parent in placed:
            before = placed[body.parent]
            placed[k] = Placed(before.part, before.pose @ body.pose)
    return placed


def in_world(bodies: tuple[Body, ...], k: int) -> Array:
    """Pose of a body in the world at q = 0, (4, 4) [m]."""
    pose = bodies[k].pose
    while (k := bodies[k].parent) >= 0:
        pose = bodies[k].pose @ pose
    return pose


def held(bodies: tuple[Body, ...], path: list[int], last: int, placed: dict[int, Placed]) -> set[int]:
    """Bodies behind joints off the arm, but for those on its last part: rods drawn where they are not."""
    found: set[int] = set()
    for k, body in enumerate(bodies):  # parents first
        if k in placed and k not in path and placed[k].part < last and (body.moves or body.parent in found):
            found.add(k)
    return found


def part_of(
    bodies: tuple[Body, ...], placed: dict[int, Placed], index: int, carrier: int, rods: Collection[int]
) -> Part:
    """All bodies of a part as one; rods neither touch nor bear."""
    own = [
        (_as_rod(bodies[k]) if k in rods else bodies[k], placed[k].pose)
        for k in placed
        if placed[k].part == index
    ]
    pose = np.eye(4)
    if index:
        pose = placed[bodies[carrier].parent].pose @ bodies[carrier].pose
    mass, com, inertia = combined([_weighed(body, pose) for body, pose in own])
    stated = sum(body.mass for body, _ in own if body.weighed)
    return Part(
        name=bodies[carrier].name,
        joint=bodies[carrier].joint,
        pose=pose,
        mass=mass or SPECK,
        com=com,
        inertia=inertia,
        inertia_from="file" if 2 * stated > mass else "geometry",
        shapes=tuple(_moved(shape, pose) for body, pose in own for shape in body.shapes),
        sites=tuple(_site(site, pose) for body, pose in own for site in body.sites),
    )


def _as_rod(body: Body) -> Body:
    return replace(body, shapes=tuple(replace(s, collides=False, bears=False) for s in body.shapes))


def _weighed(body: Body, pose: Array) -> tuple[float, Array, Array]:
    """Mass, centre of mass and inertia about it of a body in the frame of its part."""
    R = pose[:3, :3]
    return body.mass, moved(body.com, pose), R @ body.inertia @ R.T


def _moved(shape: Shape, pose: Array) -> Shape:
    """A shape of a body in the frame of its part."""
    solid = shape.solid and Solid(shape.solid.kind, shape.solid.size, pose @ shape.solid.pose)
    outer = None if shape.outer is None else moved(shape.outer, pose)
    return replace(shape, vertices=moved(shape.vertices, pose), solid=solid, outer=outer)


def _site(site: Site, pose: Array) -> Site:
    """A site of a body in the frame of its part."""
    placed = pose @ pose_of(site.rotation, site.position)
    return Site(site.name, placed[:3, 3], placed[:3, :3])


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
