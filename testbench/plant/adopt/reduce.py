"""A tree of bodies as one serial chain: what is fixed is merged, what branches off is frozen."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.errors import Array, InputError
from testbench.plant.adopt.chain import Chain, JointOf, Part, Shape, Site, Solid
from testbench.plant.adopt.names import with_fit_names
from testbench.plant.adopt.tree import Body, Tip, Tree, named_tips, path_to, pose_of, usual_tip
from testbench.plant.adopt.weigh import weigh

FEWEST, MOST = 3, 9  #: Moving joints of an arm.
LONGEST = 50.0  #: Farthest of a body from the body before [m].
HEAVIEST = 1e5  #: Of a body [kg].
SPECK = 1e-6  #: Mass of a part of which the file says nothing [kg].


def reduce_tree(file: Path, tree: Tree, tip: str | None = None) -> Chain:
    """The serial chain from the first body of a tree to the tip.

    Args:
        file: Where the tree is from, for messages.
        tree: All bodies of the file.
        tip: A body or site; None for the end of the longest chain of moving joints.

    Raises:
        InputError: When there is no such tip, or no arm that leads to it.
    """
    end = usual_tip(tree) if tip is None else _named(file, tree, tip)
    path = path_to(tree, end.body)
    _check_joints(file, tree, path)
    _check_sizes(file, tree)
    bodies, notes = weigh(file, tree.bodies, _belonging(tree, path[0]))
    placed = _place(bodies, path)
    carriers = [k for k in path if bodies[k].joint is not None]
    base = path[path.index(carriers[0]) - 1]
    parts = tuple(_part(bodies, placed, k, carrier) for k, carrier in enumerate([base, *carriers]))
    chain = Chain(
        name=tree.name,
        parts=parts,
        tip=placed[end.body].pose @ end.pose,
        tip_name=end.name,
        base=_in_world(bodies, base),
        notes=(*tree.notes, *notes, *_merged(bodies, placed, path, parts)),
    )
    return with_fit_names(chain)


@dataclass(frozen=True, eq=False)
class Placed:
    """Where a body has gone."""

    part: int  #: Index of its part.
    pose: Array  #: In the part's frame, (4, 4) [m].


def _named(file: Path, tree: Tree, name: str) -> Tip:
    tips = named_tips(tree)
    found = [tip for tip in tips if tip.name == name]
    if not found:
        names = ", ".join(sorted({tip.name for tip in tips}))
        raise InputError(file, "", f"no link, body or site {name!r} for the tip; there are {names}")
    return found[0]


def _check_joints(file: Path, tree: Tree, path: list[int]) -> None:
    """Three to nine joints that turn or slide, each by itself."""
    for k in path:
        body = tree.bodies[k]
        if body.odd:
            name = f"joint {body.joint.name!r}" if body.joint else f"the joint of {body.name!r}"
            problem = f"{name} {body.odd}; an arm's joints turn or slide, each by itself"
            raise InputError(file, "", problem)
    names = [joint.name for k in path if (joint := tree.bodies[k].joint)]
    if not FEWEST <= len(names) <= MOST:
        there, end = ", ".join(names) or "none", tree.bodies[path[-1]].name
        wanted = f"expected {FEWEST} to {MOST} moving joints up to {end!r}"
        raise InputError(file, "", f"{wanted}, got {len(names)}: {there}; --tip names another end")


def _check_sizes(file: Path, tree: Tree) -> None:
    for body in tree.bodies:
        numbers = np.concatenate([body.pose.ravel(), body.com, body.inertia.ravel(), [body.mass]])
        if not np.isfinite(numbers).all():
            raise InputError(file, body.name, "expected finite numbers")
        far = max(np.abs(body.pose[:3, 3]).max(), np.abs(body.com).max())
        if far > LONGEST or not 0 <= body.mass <= HEAVIEST:
            got = f"{far:.3g} m and {body.mass:.3g} kg"
            raise InputError(
                file, body.name, f"expected at most {LONGEST:g} m and {HEAVIEST:g} kg, got {got}"
            )


def _belonging(tree: Tree, first: int) -> list[bool]:
    """Which bodies hang on the first one of the arm."""
    belongs = [k == first for k in range(len(tree.bodies))]
    for k, body in enumerate(tree.bodies):
        belongs[k] |= body.parent >= 0 and belongs[body.parent]
    return belongs


def _place(bodies: tuple[Body, ...], path: list[int]) -> dict[int, Placed]:
    """The part of every body of the arm, and its pose there; branches stand at zero."""
    placed: dict[int, Placed] = {}
    first = next(k for k in path if bodies[k].joint is not None)
    base = path[path.index(first) - 1]
    backwards = np.eye(4)
    for k in reversed(path[: path.index(first)]):  # what stands below the base belongs to it
        placed[k] = Placed(0, backwards)
        backwards = backwards @ np.linalg.inv(bodies[k].pose)
    assert np.array_equal(placed[base].pose, np.eye(4))
    moved = 0
    for k in path[path.index(first) :]:
        if bodies[k].joint is not None:
            moved += 1
            placed[k] = Placed(moved, np.eye(4))
        else:
            placed[k] = Placed(moved, placed[bodies[k].parent].pose @ bodies[k].pose)
    for k, body in enumerate(bodies):
        if k not in placed and body.parent in placed:
            before = placed[body.parent]
            placed[k] = Placed(before.part, before.pose @ body.pose)
    return placed


def _in_world(bodies: tuple[Body, ...], k: int) -> Array:
    pose = bodies[k].pose
    while (k := bodies[k].parent) >= 0:
        pose = bodies[k].pose @ pose
    return pose


def _part(bodies: tuple[Body, ...], placed: dict[int, Placed], index: int, carrier: int) -> Part:
    """All bodies of a part as one."""
    own = [(bodies[k], placed[k].pose) for k in placed if placed[k].part == index]
    pose = np.eye(4)
    if index:
        pose = placed[bodies[carrier].parent].pose @ bodies[carrier].pose
    mass, com, inertia = _joined(own)
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


def _joined(own: list[tuple[Body, Array]]) -> tuple[float, Array, Array]:
    """Mass, centre of mass and inertia about it, of bodies together (parallel axes)."""
    mass = sum(body.mass for body, _ in own)
    if mass == 0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    centres = [(pose @ np.append(body.com, 1))[:3] for body, pose in own]
    com = sum((body.mass * c for (body, _), c in zip(own, centres, strict=True)), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for (body, pose), centre in zip(own, centres, strict=True):
        R, d = pose[:3, :3], centre - com
        inertia += R @ body.inertia @ R.T + body.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return mass, com, inertia


def _moved(shape: Shape, pose: Array) -> Shape:
    """A shape of a body in the frame of its part."""
    solid = shape.solid and Solid(shape.solid.kind, shape.solid.size, pose @ shape.solid.pose)
    return replace(shape, vertices=shape.vertices @ pose[:3, :3].T + pose[:3, 3], solid=solid)


def _site(site: Site, pose: Array) -> Site:
    """A site of a body in the frame of its part."""
    placed = pose @ pose_of(site.rotation, site.position)
    return Site(site.name, placed[:3, 3], placed[:3, :3])


def _merged(
    bodies: tuple[Body, ...], placed: dict[int, Placed], path: list[int], parts: tuple[Part, ...]
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
    if outside := [body.name for k, body in enumerate(bodies) if k not in placed]:
        notes.append(f"not of this arm, so left out: {', '.join(outside)}")
    for part in parts:
        if part.joint is not None and part.joint.limits_from == "none":
            notes.append(f"no limits of {part.joint.name} in the file: {_limits(part.joint)} stands in")
    if specks := [part.name for part in parts if part.mass == SPECK and part.inertia_from == "geometry"]:
        notes.append(f"no mass and no shape: {SPECK * 1e6:g} mg stands in for {', '.join(specks)}")
    return notes


def _limits(joint: JointOf) -> str:
    if joint.prismatic:
        return f"{joint.lower:g} to {joint.upper:g} m"
    return f"{math.degrees(joint.lower):.0f} to {math.degrees(joint.upper):.0f} deg"
