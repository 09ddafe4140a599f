"""Numbers of a calibrated arm with their 95 % intervals, by name and in the units of people.

A joint and the turn of the link before it about its axis are one to the readings, for errors and for
compliances: the first is counted with the second, as in the paper's aggregation.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from testbench.errors import Array
from testbench.identify.absolute.evidence import Choice
from testbench.identify.absolute.fit import Calibration
from testbench.identify.absolute.posterior import posterior_of
from testbench.model.joint_errors import KINDS
from testbench.model.vjm import Vjm

Part = Literal["geometry", "joint errors", "joint compliances", "entries"]
AXES = ("shift x", "shift y", "shift z", "turn x", "turn y", "turn z")
ENTRY = ("x", "y", "z", "phi_x", "phi_y", "phi_z")


@dataclass(frozen=True)
class Interval:
    """A number with its 95 % interval, in the unit in which people read it."""

    part: Part
    name: str  #: Such as "link_2 turn y", "joint_3 sin 12", "joint_2", "link_1 phi_x, phi_x".
    value: float
    half: float  #: The interval is value - half to value + half.
    unit: str


@dataclass(frozen=True)
class Functionals:
    """Numbers of an arm, linear in its unknowns."""

    part: Part
    names: tuple[str, ...]
    of: Array  #: Per unit of every unknown of the calibration, (k, size).
    scale: Array  #: Shown over SI units, (k,).
    units: tuple[str, ...]


def intervals(calibration: Calibration) -> tuple[Interval, ...]:
    """Intervals of all errors and compliances that a calibration has on, each by itself.

    They count with the readings and the learnt priors: an error that readings cannot tell from another one,
    such as two shifts along one axis, has the interval of its prior.
    """
    own, known, found = calibration.own, posterior_of(calibration), []
    for group in functionals(own):
        a = group.of[:, own.columns]
        value, half = group.scale * (a @ known.x), group.scale * known.half_widths(a)
        rows = zip(group.names, value.tolist(), half.tolist(), group.units, strict=True)
        found += [Interval(group.part, *row) for row in rows]
    return tuple(found)


def functionals(own: Choice) -> tuple[Functionals, ...]:
    """All that has a name: geometry, then errors of the joints, joints' compliances, entries of C_theta."""
    return tuple(
        group for group in (_geometry(own), _errors(own), _joints(own), _entries(own)) if group.names
    )


def _geometry(own: Choice) -> Functionals:
    """Constants of the inner links' virtual joints."""
    unknowns = own.unknowns
    links = unknowns.vjm.arm.links[1:-1]
    columns = np.arange(unknowns.size)[unknowns.columns("geometry")]
    return Functionals(
        "geometry",
        tuple(f"{link.name} {axis}" for link in links for axis in AXES),
        np.eye(unknowns.size)[columns],
        np.full(len(columns), 1e3),
        ("mm", "mm", "mm", "mrad", "mrad", "mrad") * len(links),
    )


def _errors(own: Choice) -> Functionals:
    """Coefficients of the joint errors that are on."""
    unknowns, errors = own.unknowns, own.unknowns.errors
    orders, single = errors.orders, [kind for kind in KINDS[1:] if kind in errors.kinds]
    words = [*(f"sin {k}" for k in orders), *(f"cos {k}" for k in orders), *single]
    joints = unknowns.vjm.arm.joints
    names = np.array([f"{joint.name} {word}" for joint in joints for word in words], dtype=object)
    slides = np.repeat([joint.prismatic for joint in joints], len(words))
    periodic = np.tile(np.array(errors.kinds) == "harmonics", len(joints))
    first = unknowns.starts["errors"]
    on = np.isin(first + np.arange(len(names)), own.columns) & ~(slides & periodic)
    at = np.flatnonzero(on)
    units = tuple("um" if slide else "urad" for slide in slides[at])
    return Functionals(
        "joint errors", tuple(names[at]), np.eye(unknowns.size)[first + at], np.full(len(at), 1e6), units
    )


def _joints(own: Choice) -> Functionals:
    """A joint's compliance and that of the link before it about, of a slide along, its axis."""
    unknowns, vjm = own.unknowns, own.unknowns.vjm
    if own.elastic is None:
        return Functionals("joint compliances", (), np.zeros((0, unknowns.size)), np.zeros(0), ())
    joints = vjm.arm.joints
    units = tuple("um/N" if joint.prismatic else "urad/(N m)" for joint in joints)
    names = tuple(joint.name for joint in joints)
    of = np.zeros((len(joints), unknowns.size))
    columns = unknowns.columns("elastic")
    a, b = unknowns.structure.a, unknowns.structure.b
    for k, row in enumerate(_about(vjm)):
        of[k, columns] = row[a] * row[b] * np.where(a == b, 1, 2)
        of[k, columns] += (a == b) & (a == 6 * len(vjm.arm.links) + k)
    return Functionals("joint compliances", names, of, np.full(len(joints), 1e6), units)


def _about(vjm: Vjm) -> Iterator[Array]:
    """Of every joint v with v^T C_theta v the compliance of the link before it about its axis, (n_theta,)."""
    for k, joint in enumerate(vjm.arm.joints):
        row = np.zeros(vjm.arm.n_theta)
        row[6 * k + (0 if joint.prismatic else 3) + np.arange(3)] = vjm.beam_axes[k]
        yield row


def _entries(own: Choice) -> Functionals:
    """Entries of C_theta that are on."""
    unknowns, structure = own.unknowns, own.unknowns.structure
    first = unknowns.starts["elastic"]
    at = own.columns[own.rigid :] - first
    arm, names, units, scale = unknowns.vjm.arm, [], [], []
    links = 6 * len(arm.links)
    for a, b in zip(structure.a[at].tolist(), structure.b[at].tolist(), strict=True):
        if a >= links:
            joint = arm.joints[a - links]
            names.append(joint.name)
            turns = 0 if joint.prismatic else 2
        else:
            names.append(f"{arm.links[a // 6].name} {ENTRY[a % 6]}, {ENTRY[b % 6]}")
            turns = (a % 6 > 2) + (b % 6 > 2)
        units.append(("um/N", "urad/N", "urad/(N m)")[turns])
        scale.append(1e6)
    return Functionals(
        "entries", tuple(names), np.eye(unknowns.size)[first + at], np.array(scale), tuple(units)
    )
