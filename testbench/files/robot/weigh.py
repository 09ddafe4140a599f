"""Estimates of masses that a file does not state, from the volume of its shapes."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from testbench.errors import InputError
from testbench.files.robot.robot import Body, ImportedShape, Note
from testbench.files.robot.solids import Weighed, combined, hull_of, integrals

DENSITY = 1200.0
"""Mass of an arm over the volume of the convex hulls of its colliding shapes [kg/m^3]. Twelve arms of known
mass, 11 to 1310 kg, are between 910 and 1610."""
PLAUSIBLE = 300.0, 4000.0
"""Range of that density for stated masses [kg/m^3]; beyond it they are doubtful."""
PLACEHOLDERS = 4
"""Number of links with one and the same mass from which masses count as placeholders."""


def weigh(file: Path, bodies: Sequence[Body], of_arm: Iterable[int]) -> tuple[list[Body], list[Note]]:
    """Estimate the masses of bodies without a stated mass from their geometry.

    Args:
        file: The robot's file, for messages.
        bodies: All bodies.
        of_arm: Places of those that belong to the arm.

    Returns:
        The bodies, and notes on the estimated masses.

    Raises:
        InputError: If the file has neither masses nor shapes.
    """
    own, weighed, notes = sorted(of_arm), list(bodies), []
    masses = [bodies[k].mass for k in own if bodies[k].weighed and bodies[k].mass > 0]
    if len(masses) >= PLACEHOLDERS and min(masses) == max(masses):
        notes.append(Note("placeholders", (), (masses[0],)))
        for k in own:
            weighed[k] = replace(bodies[k], weighed=False, mass=0.0 if bodies[k].shapes else bodies[k].mass)
    some = any(weighed[k].mass > 0 for k in own)
    seen = any(shape.visual for k in own for shape in bodies[k].shapes)
    missing = [k for k in own if _is_missing(weighed[k], some, seen)]
    if not missing and not some:
        raise InputError(file, "", "expected masses, or shapes to estimate them from; there are neither")
    for k in missing:
        volume, centre, inertia = _integrals(bodies[k].shapes)
        weighed[k] = replace(weighed[k], mass=DENSITY * volume, com=centre, inertia=DENSITY * inertia)
    if missing:
        names, total = tuple(bodies[k].name for k in missing), sum(weighed[k].mass for k in missing)
        notes.append(Note("no masses", names, (DENSITY, total)))
    rest = [weighed[k] for k in own if k not in missing]
    if drawn := [body.name for body in rest if not body.weighed and body.mass > 0]:
        notes.append(Note("geoms weigh", tuple(drawn)))
    return weighed, notes + _implausible_masses(rest)


def _is_missing(body: Body, some: bool, seen: bool) -> bool:
    """Tell whether a mass must be estimated.

    A fixed link without mass is a mere frame if other links have mass, and a mere safety hull if others are
    drawn.
    """
    fixed = not body.moves and body.parent >= 0
    frame = some or (seen and not any(shape.visual for shape in body.shapes))
    return not body.weighed and body.mass == 0 and bool(body.shapes) and not (fixed and frame)


def _implausible_masses(bodies: Sequence[Body]) -> list[Note]:
    """Note stated masses that do not fit the shapes."""
    known = [b for b in bodies if b.mass > 0 and b.shapes]
    volume, mass = sum(_integrals(b.shapes)[0] for b in known), sum(b.mass for b in known)
    low, high = PLAUSIBLE
    if volume == 0 or low <= mass / volume <= high:
        return []
    return [Note("density", (), (mass, mass / volume))]


def _integrals(shapes: Sequence[ImportedShape]) -> Weighed:
    """Compute volume, centroid and inertia at unit density of the hulls of colliding or drawn shapes."""
    chosen = [s for s in shapes if s.collides] or shapes
    return combined([integrals(hull) for s in chosen if (hull := hull_of(s.cloud))])
