"""What a person must confirm of an arm: every number that nobody measured, by its effect on the sag."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.elastic import Elastic, LinkEntry
from testbench.bench.campaign import Cell
from testbench.bench.sag import Sag, sag
from testbench.errors import Array

UNSURE = ("estimated", "assumed")  #: Origins that want to be confirmed.
ASIDE, OF_ASIDE = 0.01, "share for 10 mm aside"
"""A point is moved so far to see what hangs on it [m]."""


@dataclass(frozen=True)
class Item:
    """A number, or the numbers of one tube, to be confirmed."""

    share: float  #: Of the sag that hangs on it [1].
    words: str  #: What it is, its value, where it comes from.


def to_confirm(cell: Cell, elastic: Elastic, found: Sag) -> list[Item]:
    """Everything estimated or assumed, the largest effect on the tool's deflection first."""
    items = [
        *_payload(elastic),
        *_joints(elastic, found),
        *_links(elastic, found),
        *_points(cell, elastic, found),
    ]
    return sorted(items, key=lambda item: -item.share)


def _payload(elastic: Elastic) -> Iterator[Item]:
    payload = elastic.payload
    if payload is None:
        yield Item(1.0, "payload, not stated: the sag is proportional to it")
    elif payload.origin in UNSURE:
        yield Item(1.0, f"payload {payload.value:g} kg, {payload.origin}: the sag is proportional to it")


def _joints(elastic: Elastic, found: Sag) -> Iterator[Item]:
    first = len(elastic.link)
    for k, joint in enumerate(elastic.joint):
        c = joint.compliance
        if c.origin in UNSURE:
            words = f"{joint.name}'s compliance {1e6 * c.value:.3g} u{c.unit}, {c.origin}"
            yield Item(float(found.shares[first + k]), words)


def _links(elastic: Elastic, found: Sag) -> Iterator[Item]:
    for k, link in enumerate(elastic.link):
        if words := _tube(link):
            yield Item(float(found.shares[k]), f"{link.name}'s {words}")


def _tube(link: LinkEntry) -> str:
    """What of a link is unsure, empty where nothing is."""
    if link.compliance is not None:
        return f"compliance, {link.compliance.origin}" if link.compliance.origin in UNSURE else ""
    assert link.tube is not None  # load_arm has seen one of the two
    t = link.tube
    outer, inner = 1e3 * t.outer_diameter.value, 1e3 * t.inner_diameter.value
    origins = {
        f"length {1e3 * t.length.value:.0f} mm": t.length.origin,
        f"tube {outer:.0f}/{inner:.0f} mm": t.outer_diameter.origin,
        f"E {1e-9 * t.youngs_modulus.value:.0f} GPa": t.youngs_modulus.origin,
    }
    unsure = {words: origin for words, origin in origins.items() if origin in UNSURE}
    if not unsure:
        return ""
    return f"{', '.join(unsure)}, {' and '.join(sorted(set(unsure.values())))}"


def _points(cell: Cell, elastic: Elastic, found: Sag) -> Iterator[Item]:
    """Load point and markers: what 10 mm aside change."""
    names = elastic.to_confirm
    if elastic.load in names:
        yield Item(_load_aside(cell, found), f"load point {elastic.load}, estimated: {OF_ASIDE}")
    asked = [name for name in elastic.markers if name in names]
    if asked:
        # a marker moves with the tool's turn too, and all the more the farther off it is
        share = ASIDE * rms(found.turn) / rms(found.whole)
        yield Item(share, f"markers {', '.join(asked)}, estimated: {OF_ASIDE}")
    if elastic.tool in names:
        yield Item(0.0, f"tool {elastic.tool}, estimated: readings do not need it, tasks do")


def _load_aside(cell: Cell, found: Sag) -> float:
    """Largest change of the sag as the load point moves along an axis of the tool, over the sag."""
    changes = []
    for axis in np.eye(3):
        moved = replace(cell, vjm=replace(cell.vjm, load=cell.vjm.load + ASIDE * axis))
        changes.append(rms(sag(moved).whole - found.whole))
    return max(changes) / rms(found.whole)


def rms(vectors: Array) -> float:
    """Root mean square of the lengths of vectors, (..., 3)."""
    return float(np.sqrt(np.square(vectors).sum(axis=-1).mean()))
