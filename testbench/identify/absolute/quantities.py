"""The unknowns of a calibration by what an engineer calls them: some columns, or combinations of them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.identify.absolute.unknowns import Unknowns
from testbench.model.structure import TEMPLATE

SINGLE = {"ratio": "gear ratio", "play": "play", "stiffening": "stiffening"}
STRETCH, TWIST, BENDING, COUPLING = "stretch", "torsion", "bending", "coupling beyond a beam"


@dataclass(frozen=True)
class Quantity:
    """Something that has a name."""

    name: str  #: Such as "joint_3's offset".
    part: str  #: "frame", "mount", "geometry", "errors" or "elastic".
    H: Array  #: Its numbers per unit of every unknown, (k, size).


def quantities(unknowns: Unknowns) -> tuple[Quantity, ...]:
    """All of them, in the order of the columns."""
    return (*_set_ups(unknowns), *_geometry(unknowns), *_errors(unknowns), *_elastic(unknowns))


def _of(unknowns: Unknowns, name: str, part: str, columns: Ids) -> Quantity:
    """One whose numbers are columns themselves."""
    return Quantity(name, part, np.eye(unknowns.size)[columns])


def _set_ups(unknowns: Unknowns) -> Iterator[Quantity]:
    every = np.arange(unknowns.size)
    for name in unknowns.frames:
        yield _of(unknowns, f"the frame of {name}", "frame", every[unknowns.columns(f"frame {name}")])
    for name in unknowns.mounts:
        yield _of(unknowns, f"the mount of {name}", "mount", every[unknowns.columns(f"mount {name}")])


def _geometry(unknowns: Unknowns) -> Iterator[Quantity]:
    """Of every inner link the offset of the joint behind it, its other turns and its shifts."""
    arm, first = unknowns.vjm.arm, unknowns.starts["geometry"]
    for k in range(1, arm.n_joints):
        link, joint, axis = arm.links[k].name, arm.joints[k], unknowns.vjm.beam_axes[k]
        own = np.eye(unknowns.size)[first + 6 * (k - 1) + np.arange(6)]
        shift, turn = own[:3], own[3:]
        across = np.linalg.svd(axis[None])[2][1:]  # two axes at right angles to the joint's
        along, other = (shift, turn) if joint.prismatic else (turn, shift)
        kinds = ("shift", "turn") if joint.prismatic else ("turn", "shift")
        yield Quantity(f"{joint.name}'s offset", "geometry", axis[None] @ along)
        yield Quantity(f"{link}'s {kinds[0]}", "geometry", across @ along)
        yield Quantity(f"{link}'s {kinds[1]}", "geometry", other)


def _errors(unknowns: Unknowns) -> Iterator[Quantity]:
    errors, first = unknowns.errors, unknowns.starts["errors"]
    orders = np.tile(errors.orders, 2)
    kinds, bands = np.array(errors.kinds), errors.bands
    for j, joint in enumerate(unknowns.vjm.arm.joints):
        own = first + j * errors.size
        for band in np.unique(bands[bands >= 0]) if not joint.prismatic else ():
            at = np.flatnonzero(bands == band)
            low, high = orders[at].min(), orders[at].max()
            name = f"error of order {low}" if low == high else f"error of orders {low} to {high}"
            yield _of(unknowns, f"{joint.name}'s {name}", "errors", own + at)
        for kind in kinds[bands < 0]:
            name = f"{joint.name}'s {SINGLE[kind]}"
            yield _of(unknowns, name, "errors", own + np.flatnonzero(kinds == kind))


def _elastic(unknowns: Unknowns) -> Iterator[Quantity]:
    arm, structure, first = unknowns.vjm.arm, unknowns.structure, unknowns.starts["elastic"]
    links = 6 * len(arm.links)
    kind = np.array([_kind(a % 6, b % 6) for a, b in zip(structure.a, structure.b, strict=True)])
    for k, link in enumerate(arm.links):
        for name in (STRETCH, TWIST, BENDING, COUPLING):
            own = np.flatnonzero((structure.a // 6 == k) & (structure.a < links) & (kind == name))
            if len(own):
                yield _of(unknowns, f"{link.name}'s {name}", "elastic", first + own)
    for k in np.flatnonzero(structure.a >= links).tolist():
        name = arm.joints[structure.a[k] - links].name
        yield _of(unknowns, f"{name}'s compliance", "elastic", first + np.array([k]))


def _kind(a: int, b: int) -> str:
    """What an entry of a link's compliance stands for."""
    a, b = min(a, b), max(a, b)
    if (a, b) not in TEMPLATE:
        return COUPLING
    return {(0, 0): STRETCH, (3, 3): TWIST}.get((a, b), BENDING)
