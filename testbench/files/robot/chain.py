"""A robot file, URDF or MJCF, as one serial chain: fixed bodies are merged into their carrier.

MuJoCo's compiler merges fixed bodies too, but those below the base into the world, and it drops their names.
"""

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.errors import Array, InputError, shorten
from testbench.files.robot.meshes import combined
from testbench.files.robot.mjcf import read_mjcf
from testbench.files.robot.robot import (
    Body,
    Coupling,
    ImportedChain,
    ImportedShape,
    ImportedSite,
    Note,
    Robot,
    Rows,
    chain_map,
    find_tip,
    in_order,
    map_of,
    path_to,
    read_xml,
    transform_points,
)
from testbench.files.robot.urdf import read_urdf
from testbench.files.robot.write import weigh

MIN_JOINTS, MAX_JOINTS = 3, 9
"""Fewest and most moving joints of an arm."""
FAR, NARROW = 8 * np.pi, np.radians(15.0)
"""Limits beyond the first [rad] may be degrees in the file; ranges below the other [rad] may be radians."""
MAX_BODY_DISTANCE = 50.0
"""Largest distance between two neighbouring bodies [m]."""
HEAVIEST = 1e5
"""Largest mass of a body [kg]."""
MAX_LISTED = 200
"""Most characters of names in a message."""
LONGEST_NAME = 40
"""Most characters of a name: suffixes are added."""
RESERVED = ("world",)
LEFT_OUT = "left out"  #: Kind of a note.
SPECK = 1e-6
"""Mass of a part for which the file states none [kg]."""
READERS = {"robot": read_urdf, "mujoco": read_mjcf}


def read_robot(file: Path) -> Robot:
    """Read all bodies of a URDF, or of an MJCF with the files that it names.

    Args:
        file: The URDF or MJCF.

    Returns:
        The robot.

    Raises:
        InputError: Names the file, the place and what was expected.
    """
    root = read_xml(file)
    if root.tag not in READERS:
        raise InputError(file, "", f"expected URDF (<robot>) or MJCF (<mujoco>) at the top, got <{root.tag}>")
    if root.tag == "robot" and root.find("link") is None:
        raise InputError(
            file, "", "expected links in the URDF, got none; is it an SRDF, or a part of a URDF?"
        )
    return READERS[root.tag](file, root)


def read_chain(file: Path, tip: str | None = None) -> ImportedChain:
    """Read the arm that a robot's file describes, from its first body to the tip.

    Args:
        file: URDF or MJCF.
        tip: The link, body or site that carries the tool; None for the end of the longest chain.

    Returns:
        The arm.

    Raises:
        InputError: Names the file, the place and what was expected.
    """
    robot = read_robot(file)
    end = find_tip(file, robot, tip)
    path = path_to(robot.bodies, end.body)
    if tip is None:
        _refuse_twins(file, robot, path)
    _check_joints(file, robot, path)
    _check_sizes(file, robot)
    rows, spare = map_of(file, robot.bodies, path, robot.couplings, robot.driven)
    carriers = [k for k in path if robot.bodies[k].joint is not None]
    carriers.insert(0, path[path.index(carriers[0]) - 1])
    placed = _place(robot.bodies, path, carriers)
    bodies, notes = weigh(file, robot.bodies, placed)
    rods = _rods(bodies, path, carriers, placed)
    parts = tuple(_part(bodies, placed, part, k, rods) for part, k in enumerate(carriers))
    base = in_order([bodies[k].pose for k in path_to(bodies, carriers[0])])
    parts = (replace(parts[0], pose=base), *parts[1:])
    became = _became(bodies, placed, path, parts, rods)
    site = ImportedSite(end.site.name, placed[end.body].pose @ end.site.pose)
    had = [_left_out(note, robot.couplings, spare) for note in robot.notes]
    chain = ImportedChain(
        robot.name, parts, site, (*(n for n in had if n.names or n.kind != LEFT_OUT), *notes, *became)
    )
    return _coupled(file, *_fit(chain, rows))


def _left_out(note: Note, couplings: Sequence[Coupling], spare: Collection[Coupling]) -> Note:
    """Note elements that are left out; equalities and tendons only if they do not move the arm's joints."""
    if note.kind != LEFT_OUT:
        return note
    used = [coupling.label for coupling in couplings if coupling not in spare]
    read = (
        {"equality"}
        if used and not any("equality" in coupling.label or coupling.bodies for coupling in spare)
        else set()
    )
    read |= {"tendon" for label in used if label.startswith("tendon")}
    return note._replace(names=tuple(name for name in note.names if name not in read))


def _refuse_twins(file: Path, robot: Robot, path: list[int]) -> None:
    """Refuse a robot of two arms of equally many joints: only a tip says which one is meant."""

    def moving(some: Sequence[int]) -> list[int]:
        return [k for k in some if robot.bodies[k].joint and not robot.bodies[k].follows]

    for k in moving(range(len(robot.bodies))):
        other = path_to(robot.bodies, k)
        shared = [body for body in path if body in other]
        own, twin = (moving([body for body in way if body not in shared]) for way in (path, other))
        if len(moving(shared)) < MIN_JOINTS <= len(own) == len(twin):
            ends = " and ".join(repr(robot.bodies[way[-1]].name) for way in (own, twin))
            problem = f"expected one arm, got two of {len(own)} joints, up to {ends}: state one by --tip"
            raise InputError(file, "", problem)


def _check_joints(file: Path, robot: Robot, path: list[int]) -> None:
    """Check that there are three to nine joints that turn or slide."""
    moving = [k for k in path if robot.bodies[k].moves]
    for body in (robot.bodies[k] for k in moving):
        if body.odd:
            name = f"joint {body.joint.name!r}" if body.joint else f"the joint of {body.name!r}"
            raise InputError(file, "", f"{name} {body.odd}; an arm's joints turn or slide")
    names = [joint.name for k in path if (joint := robot.bodies[k].joint)]
    if not MIN_JOINTS <= len(names) <= MAX_JOINTS:
        there, end = shorten(", ".join(names), MAX_LISTED) or "none", robot.bodies[path[-1]].name
        wanted = f"expected {MIN_JOINTS} to {MAX_JOINTS} moving joints up to {end!r}"
        raise InputError(file, "", f"{wanted}, got {len(names)}: {there}; state another tip")


def _check_sizes(file: Path, robot: Robot) -> None:
    for body in robot.bodies:
        far = max(np.abs(body.pose[:3, 3]).max(), np.abs(body.com).max())
        inertia = np.abs(body.inertia).max()
        for value, most, unit, other in (
            (far, MAX_BODY_DISTANCE, "m", "mm"),
            (body.mass, HEAVIEST, "kg", "g"),
            (inertia, HEAVIEST * MAX_BODY_DISTANCE, "kg m^2", "g mm^2"),
        ):
            if not value <= most:
                problem = f"expected at most {most:g} {unit}, got {value:.3g}: is it in {other}?"
                raise InputError(file, body.name, problem)


class Placed(NamedTuple):
    """Hold the part to which a body belongs, and its pose there."""

    part: int  #: Index of its part.
    pose: Array  #: In the part's frame, (4, 4) [m].


def _place(bodies: Sequence[Body], path: list[int], carriers: list[int]) -> dict[int, Placed]:
    """Find the part of every body of the arm, and its pose there; branches stand at zero."""
    placed: dict[int, Placed] = {}
    backwards = np.eye(4)
    for k in reversed(path[: path.index(carriers[1])]):
        placed[k] = Placed(0, backwards)
        backwards = backwards @ np.linalg.inv(bodies[k].pose)
    for k in [*path, *range(len(bodies))]:
        before = placed.get(bodies[k].parent)
        if k in carriers[1:]:
            placed[k] = Placed(carriers.index(k), np.eye(4))
        elif k not in placed and before is not None:
            placed[k] = Placed(before.part, before.pose @ bodies[k].pose)
    return placed


def _rods(
    bodies: Sequence[Body], path: list[int], carriers: list[int], placed: dict[int, Placed]
) -> set[int]:
    """Find bodies behind joints off the arm, except on its last part: rods, drawn at their zero pose."""
    found: set[int] = set()
    last = len(carriers) - 1
    for k, body in enumerate(bodies):  # parents first
        if k in placed and k not in path and placed[k].part < last and (body.moves or body.parent in found):
            found.add(k)
    return found


def _part(
    bodies: Sequence[Body],
    placed: dict[int, Placed],
    part: int,
    carrier: int,
    rods: Collection[int],
) -> Body:
    """Combine all bodies of a part to one; rods neither collide nor carry."""
    body, own = bodies[carrier], [k for k in placed if placed[k].part == part]
    pose = np.eye(4)
    if part:
        pose = placed[body.parent].pose @ body.pose
    mass, com, inertia = combined([_weighed(bodies[k], placed[k].pose) for k in own])
    stated = sum(bodies[k].mass for k in own if bodies[k].weighed)
    return Body(
        name=body.name,
        parent=part - 1,
        pose=pose,
        joint=body.joint,
        mass=mass or SPECK,
        com=com,
        inertia=inertia,
        weighed=2 * stated > mass,
        shapes=tuple(_shape(s, placed[k].pose, rod=k in rods) for k in own for s in bodies[k].shapes),
        sites=tuple(ImportedSite(s.name, placed[k].pose @ s.pose) for k in own for s in bodies[k].sites),
    )


def _weighed(body: Body, pose: Array) -> tuple[float, Array, Array]:
    """Return mass, centre of mass and inertia about it of a body in the frame of its part."""
    R = pose[:3, :3]
    return body.mass, transform_points(body.com, pose), R @ body.inertia @ R.T


def _shape(shape: ImportedShape, pose: Array, *, rod: bool) -> ImportedShape:
    """Move a shape of a body to the frame of its part."""
    shape = replace(shape, pose=pose @ shape.pose)
    return replace(shape, collides=False, bears=False) if rod else shape


def _became(
    bodies: Sequence[Body],
    placed: dict[int, Placed],
    path: list[int],
    parts: Sequence[Body],
    rods: Collection[int],
) -> list[Note]:
    """Note what was merged, fixed, left out or replaced."""
    notes = []
    for index, part in enumerate(parts):
        own = [bodies[k] for k in placed if placed[k].part == index and bodies[k].name != part.name]
        notes.append(Note("merged", (part.name, *(body.name for body in own if body.mass > 0))))
    notes = [note for note in notes if len(note.names) > 1]
    frozen = [k for k, body in enumerate(bodies) if k in placed and k not in path and body.moves]
    named = {
        "frozen": [joint.name if (joint := bodies[k].joint) else bodies[k].name for k in frozen],
        "rods": [bodies[k].name for k in sorted(rods) if bodies[k].shapes],
        "outside": [body.name for k, body in enumerate(bodies) if k not in placed],
    }
    notes += [Note(kind, tuple(names)) for kind, names in named.items() if names]
    for joint in (part.joint for part in parts if part.joint and not part.joint.limited):
        kind = "no limits" if joint.stated is None else "endless limits"
        kind += " of a slide" if joint.prismatic else ""
        notes.append(Note(kind, (joint.name,), (joint.lower, joint.upper, *(joint.stated or ()))))
    hinges = [part.joint for part in parts if part.joint and part.joint.limited and not part.joint.prismatic]
    if far := [joint.name for joint in hinges if max(-joint.lower, joint.upper) > FAR]:
        notes.append(Note("far limits", tuple(far), (FAR,)))
    slides = [part.joint for part in parts if part.joint and part.joint.limited and part.joint.prismatic]
    if far := [joint.name for joint in slides if max(-joint.lower, joint.upper) > MAX_BODY_DISTANCE]:
        notes.append(Note("far limits of a slide", tuple(far), (MAX_BODY_DISTANCE,)))
    if hinges and all(joint.upper - joint.lower < NARROW for joint in hinges):
        notes.append(Note("narrow limits", tuple(joint.name for joint in hinges), (NARROW,)))
    if specks := [part.name for part in parts if part.mass == SPECK and not part.weighed]:
        notes.append(Note("specks", tuple(specks), (SPECK,)))
    return notes


def _coupled(file: Path, chain: ImportedChain, rows: Rows) -> ImportedChain:
    """Add the joint map to the chain, with a note on dependent joints."""
    joint_map = chain_map(file, chain.joints, rows)
    if joint_map is None:
        return chain
    names = [joint.name for joint in chain.joints]
    words = tuple(f"{name} = {joint_map.joint_formula(k)}" for k, name in enumerate(names) if name in rows)
    return replace(chain, joint_map=joint_map, notes=(*chain.notes, Note("follow", words)))


def _fit(chain: ImportedChain, rows: Rows) -> tuple[ImportedChain, Rows]:
    """Rename the chain with names of letters, digits, `_` and `-` that differ in more than case.

    Joints that others follow get such names too.
    """
    links, joints = fit_names(p.name for p in chain.parts), fit_names(joint.name for joint in chain.joints)
    renamed = []
    for part, name, own in zip(chain.parts, links, ("", *joints), strict=True):  # the base has no joint
        sites = zip(part.sites, fit_names(site.name for site in part.sites), strict=True)
        fit = tuple(site._replace(name=site_name) for site, site_name in sites)
        joint = part.joint and replace(part.joint, name=own)
        renamed.append(replace(part, name=name, joint=joint, sites=fit))
    had = [*(part.name for part in chain.parts), *(joint.name for joint in chain.joints)]
    named = zip(had, (*links, *joints), strict=True)
    changed = tuple(f"{old!r} is {new}" for old, new in named if old != new)
    notes = (*chain.notes, Note("renamed", changed)) if changed else chain.notes
    [name] = fit_names([chain.name])
    moving = [joint.name for joint in chain.joints]
    beside = list(dict.fromkeys(name for row, _ in rows.values() for name in row if name not in moving))
    new = dict(zip([*moving, *beside], fit_names([*joints, *beside]), strict=True))
    fit_rows = {
        new[joint]: ({new[other]: c for other, c in row.items()}, q_0)
        for joint, (row, q_0) in rows.items()
        if joint in moving
    }
    return replace(chain, name=name, parts=tuple(renamed), notes=notes), fit_rows


def fit_names(names: Iterable[str]) -> list[str]:
    """Make names of letters, digits, `_` and `-`, each different from all others.

    Args:
        names: Names in a user's file.

    Returns:
        Our names, in the same order.
    """
    found: list[str] = []
    for name in names:
        fit = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_")[:LONGEST_NAME] or "x"
        plain, k = fit, 2
        taken = {other.lower() for other in (*found, *RESERVED)}
        while fit.lower() in taken:
            fit, k = f"{plain}_{k}", k + 1
        found.append(fit)
    return found
