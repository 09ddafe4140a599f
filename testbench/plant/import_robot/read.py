"""A stranger's robot file, URDF or MJCF, as one serial chain: what is fixed is merged."""

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbench.errors import InputError
from testbench.plant.import_robot.chain import Chain, Part
from testbench.plant.import_robot.merge import held, in_world, part_of, place, what_became
from testbench.plant.import_robot.mjcf import read_mjcf_tree
from testbench.plant.import_robot.source import read_xml
from testbench.plant.import_robot.tree import Tip, Tree, named_tips, path_to, usual_tip
from testbench.plant.import_robot.urdf import read_urdf
from testbench.plant.import_robot.weigh import weigh

FEWEST, MOST = 3, 9  #: Moving joints of an arm.
LONGEST = 50.0  #: Farthest of a body from the body before [m].
HEAVIEST = 1e5  #: Of a body [kg].
LONGEST_NAME = 40  #: Characters of a name: room for what is put behind it.
RESERVED = ("world",)


def read_chain(file: Path, tip: str | None = None) -> Chain:
    """The arm that a robot's file describes.

    Args:
        file: URDF, or MJCF with the files that it names.
        tip: The link, body or site that carries the tool; None for the end of the longest chain.

    Raises:
        InputError: Names the file, the place and what was expected.
    """
    root = read_xml(file)
    if root.tag == "robot":
        tree = read_urdf(file, root)
    elif root.tag == "mujoco":
        tree = read_mjcf_tree(file, root)
    else:
        raise InputError(file, "", f"expected URDF (<robot>) or MJCF (<mujoco>) at the top, got <{root.tag}>")
    return reduce_tree(file, tree, tip)


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
    placed = place(bodies, path)
    carriers = [k for k in path if bodies[k].joint is not None]
    base = path[path.index(carriers[0]) - 1]
    rods = held(bodies, path, len(carriers), placed)
    parts = tuple(part_of(bodies, placed, k, carrier, rods) for k, carrier in enumerate([base, *carriers]))
    chain = Chain(
        name=tree.name,
        parts=parts,
        tip=placed[end.body].pose @ end.pose,
        tip_name=end.name,
        base=in_world(bodies, base),
        notes=(*tree.notes, *notes, *what_became(bodies, placed, path, parts, rods)),
    )
    return with_fit_names(chain)


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
        inertia = np.abs(body.inertia).max()
        if inertia > HEAVIEST * LONGEST:
            problem = f"expected an inertia of at most {HEAVIEST * LONGEST:g} kg m^2, got {inertia:.3g}"
            raise InputError(file, body.name, problem)


def _belonging(tree: Tree, first: int) -> list[bool]:
    """Which bodies hang on the first one of the arm."""
    belongs = [k == first for k in range(len(tree.bodies))]
    for k, body in enumerate(tree.bodies):
        belongs[k] |= body.parent >= 0 and belongs[body.parent]
    return belongs


def with_fit_names(chain: Chain) -> Chain:
    """The chain with names of letters, digits, `_` and `-` that differ in more than upper and lower case."""
    parts = fit_names(part.name for part in chain.parts)
    joints = iter(fit_names(part.joint.name for part in chain.parts if part.joint))
    renamed = tuple(
        replace(
            part,
            name=name,
            joint=part.joint and replace(part.joint, name=next(joints)),
            sites=tuple(replace(s, name=fit) for s, fit in zip(part.sites, _sites(part), strict=True)),
        )
        for part, name in zip(chain.parts, parts, strict=True)
    )
    pairs = [(old.name, new.name) for old, new in zip(chain.parts, renamed, strict=True)]
    pairs += [
        (old.joint.name, new.joint.name)
        for old, new in zip(chain.parts, renamed, strict=True)
        if old.joint and new.joint
    ]
    changed = [f"{old!r} is {new}" for old, new in pairs if old != new]
    notes = (f"names made fit: {', '.join(changed)}",) if changed else ()
    [name] = fit_names([chain.name])
    return replace(chain, name=name, parts=renamed, notes=(*chain.notes, *notes))


def _sites(part: Part) -> list[str]:
    return fit_names(site.name for site in part.sites)


def fit_names(names: Iterable[str]) -> list[str]:
    """Names of letters, digits, `_` and `-`, each different from all others."""
    found: list[str] = []
    for name in names:
        fit = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_")[:LONGEST_NAME] or "x"
        plain, k = fit, 2
        taken = {other.lower() for other in (*found, *RESERVED)}
        while fit.lower() in taken:
            fit, k = f"{plain}_{k}", k + 1
        found.append(fit)
    return found
