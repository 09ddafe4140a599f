"""Numbers of a calibrated arm with their 95 % intervals, by name and in the units of people.

A joint and the turn of the link before it about its axis are one to the readings, for errors and for
compliances: the first is counted with the second, as in the paper's aggregation.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from testbench.errors import Array
from testbench.identify.absolute.evidence import ActiveUnknowns
from testbench.identify.absolute.fit import Calibration
from testbench.identify.absolute.posterior import posterior_of

Part = Literal["geometry", "joint errors", "joint compliances", "entries"]
AXES = ("shift x", "shift y", "shift z", "turn x", "turn y", "turn z")
ENTRY = ("x", "y", "z", "phi_x", "phi_y", "phi_z")
Named = tuple[str, str, Array]
"""A number of an arm: name, unit in which it is shown, and what it is per unit of every unknown, (size,)."""


@dataclass(frozen=True)
class Interval:
    """Hold a number with its 95 % interval, in the unit in which people read it."""

    part: Part
    name: str  #: Such as "link_2 turn y", "joint_3 sin 12", "joint_2", "link_1 phi_x, phi_x".
    value: float
    half: float  #: The interval is value - half to value + half.
    unit: str


@dataclass(frozen=True)
class Functionals:
    """Hold numbers of an arm, linear in its unknowns."""

    part: Part
    names: tuple[str, ...]
    units: tuple[str, ...]
    of: Array  #: Per unit of every unknown of the calibration, (k, size).

    @property
    def scale(self) -> Array:
        """Return the shown units over SI units, (k,)."""
        return np.array([1e3 if unit[0] == "m" else 1e6 for unit in self.units])


def intervals(calibration: Calibration) -> tuple[Interval, ...]:
    """Compute intervals of all errors and compliances that a calibration has on, each by itself.

    They count with the readings and the learnt priors: an error that readings cannot tell from another one,
    such as two shifts along one axis, has the interval of its prior.
    """
    active, known, found = calibration.active, posterior_of(calibration), []
    for group in functionals(active):
        a = group.of[:, active.columns]
        value, half = group.scale * (a @ known.x), group.scale * known.half_widths(a)
        rows = zip(group.names, value.tolist(), half.tolist(), group.units, strict=True)
        found += [Interval(group.part, *row) for row in rows]
    return tuple(found)


def functionals(active: ActiveUnknowns) -> tuple[Functionals, ...]:
    """List all that has a name: geometry, errors of joints, joint compliances, entries of C_theta."""
    parts: dict[Part, list[Named]] = {
        "geometry": list(_geometry(active)),
        "joint errors": list(_errors(active)),
        "joint compliances": [] if active.elastic is None else list(_joints(active)),
        "entries": list(_entries(active)),
    }
    found = []
    for part, named in parts.items():
        if named:
            names, units, rows = zip(*named, strict=True)
            found.append(Functionals(part, names, units, np.array(rows)))
    return tuple(found)


def _geometry(active: ActiveUnknowns) -> Iterator[Named]:
    """Constants of the inner links' virtual joints."""
    every = np.eye(active.unknowns.size)[active.unknowns.columns("geometry")]
    for row, (link, axis) in zip(every, product(active.unknowns.vjm.arm.links[1:-1], AXES), strict=True):
        yield f"{link.name} {axis}", "mm" if axis in AXES[:3] else "mrad", row


def _errors(active: ActiveUnknowns) -> Iterator[Named]:
    """Coefficients of the joint errors that are on."""
    unknowns, errors, every = active.unknowns, active.unknowns.errors, np.eye(active.unknowns.size)
    words = [f"{wave} {k}" for wave in ("sin", "cos") for k in errors.orders]
    words += errors.kinds[len(words) :]
    places = product(unknowns.vjm.arm.joints, zip(words, errors.kinds, strict=True))
    for column, (joint, (word, kind)) in enumerate(places, unknowns.starts["errors"]):
        if column in active.columns and not (joint.prismatic and kind == "harmonics"):
            yield f"{joint.name} {word}", "um" if joint.prismatic else "urad", every[column]


def _joints(active: ActiveUnknowns) -> Iterator[Named]:
    """A joint's compliance and that of the link before it about, of a slide along, its axis."""
    unknowns, arm = active.unknowns, active.unknowns.vjm.arm
    a, b = unknowns.structure.a, unknowns.structure.b
    for k, joint in enumerate(arm.joints):
        v, row = np.zeros(arm.n_theta), np.zeros(unknowns.size)
        v[6 * k + (0 if joint.prismatic else 3) + np.arange(3)] = unknowns.vjm.beam_axes[k]
        row[unknowns.columns("elastic")] = v[a] * v[b] * np.where(a == b, 1, 2)  # v^T C_theta v, of the link
        row[unknowns.columns("elastic")] += (a == b) & (a == 6 * len(arm.links) + k)
        yield joint.name, "um/N" if joint.prismatic else "urad/(N m)", row


def _entries(active: ActiveUnknowns) -> Iterator[Named]:
    """Entries of C_theta that are on."""
    structure, arm, every = active.unknowns.structure, active.unknowns.vjm.arm, np.eye(active.unknowns.size)
    links = 6 * len(arm.links)
    for column in active.columns[active.rigid :].tolist():
        a, b = (int(x[column - active.unknowns.starts["elastic"]]) for x in (structure.a, structure.b))
        if a < links:
            name = f"{arm.links[a // 6].name} {ENTRY[a % 6]}, {ENTRY[b % 6]}"
            turns = (a % 6 > 2) + (b % 6 > 2)
        else:
            name, turns = arm.joints[a - links].name, 0 if arm.joints[a - links].prismatic else 2
        yield name, ("um/N", "urad/N", "urad/(N m)")[turns], every[column]
