"""An arm looked at as a whole: what must be confirmed, by its effect on the sag, and what may be wrong."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.arm.elastic import LinkEntry, read_elastic
from testbench.arm.folder import find_arm
from testbench.arm.mjcf import GRAVITY
from testbench.errors import Array, BenchError, Doubt
from testbench.model.vjm import body_poses, chain, generalised_load
from testbench.plant.shapes import RING
from testbench.workflows.arm_doubts import UPRIGHT, ArmContext, arm_warnings, base_stance, tool_sag
from testbench.workflows.cell import build_cell, check_agreement
from testbench.workflows.rows import rms

UNSURE = ("estimated", "assumed")  #: Origins that want to be confirmed.
SPOKES = 4  #: Lines along a drawn tube.
ASIDE, OF_ASIDE = 0.01, "effect of an offset of 10 mm"
"""A point is moved so far to see what hangs on it [m]."""


class Item(NamedTuple):
    """Hold a number, or the numbers of one tube, to be confirmed."""

    share: float  #: Of the sag that hangs on it [1].
    words: str  #: What it is, its value, where it comes from.


def to_confirm(arm: ArmContext) -> list[Item]:
    """List everything estimated or assumed, the largest effect on the tool's deflection first."""
    return sorted([*_numbers(arm), *_point_items(arm)], key=lambda item: -item.share)


def _numbers(arm: ArmContext) -> Iterator[Item]:
    """Payload, compliances of joints, tubes of links."""
    elastic, payload, shares = arm.elastic, arm.elastic.payload, arm.sag.shares.tolist()
    if payload is None:
        yield Item(1.0, "payload, not stated: the sag is proportional to it")
    elif payload.origin in UNSURE:
        yield Item(1.0, f"payload {payload.value:g} kg, {payload.origin}: the sag is proportional to it")
    for joint, share in zip(elastic.joint, shares[len(elastic.link) :], strict=True):
        c = joint.compliance
        if c.origin in UNSURE:
            yield Item(share, f"{joint.name}'s compliance {1e6 * c.value:.3g} u{c.unit}, {c.origin}")
    for link, share in zip(elastic.link, shares, strict=False):
        if words := _tube(link):
            yield Item(share, f"{link.name}'s {words}")


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


def _point_items(arm: ArmContext) -> Iterator[Item]:
    """Load point and markers: what 10 mm aside change."""
    elastic, cell, names = arm.elastic, arm.cell, arm.elastic.to_confirm
    if elastic.load in names:
        # largest change of the sag as the load point moves along an axis of the tool
        moved = [replace(cell.vjm, load=cell.vjm.load + ASIDE * axis) for axis in np.eye(3)]
        most = max(rms(tool_sag(replace(cell, vjm=vjm)).whole - arm.sag.whole) for vjm in moved)
        yield Item(most / rms(arm.sag.whole), f"load point {elastic.load}, estimated: {OF_ASIDE}")
    asked = [name for name in elastic.markers if name in names]
    if asked:
        # a marker moves with the tool's turn too, and all the more the farther off it is
        share = ASIDE * rms(arm.sag.turn) / rms(arm.sag.whole)
        yield Item(share, f"markers {', '.join(asked)}, estimated: {OF_ASIDE}")
    if elastic.tool in names:
        yield Item(0.0, f"tool {elastic.tool}, estimated: readings do not need it, tasks do")


@dataclass(frozen=True, eq=False)
class Checked(ArmContext):
    """Hold an arm and what was found of it."""

    apart: float  #: Largest distance between the two readings of it [m].
    items: list[Item]  #: To confirm, the largest effect first.
    doubts: list[Doubt]  #: What may be wrong.

    @cached_property
    def poses(self) -> Array:
        """Choose two poses to draw, (2, n) [rad, m]: zero, or as near as limits let, and that of median sag.

        A first joint about the vertical does not change the sag: both poses have it at the same angle.
        """
        zero = self.cell.arm.within(np.zeros(self.cell.arm.n_joints))
        middle = int(np.argsort(self.sag.size)[len(self.sag.size) // 2])
        poses = np.array([zero, self.sag.q[middle]])
        turning, tilt, _ = base_stance(self.cell)
        if turning == 0 and tilt <= UPRIGHT:
            poses[1, 0] = poses[0, 0]
        return self.cell.arm.followed(poses)

    @cached_property
    def worst(self) -> int:
        """Return the pose of the largest sag."""
        return int(np.argmax(self.sag.size))

    @property
    def beams(self) -> Array:
        """Compute where each link's beam begins and how it lies, in both poses, (2, n + 1, 4, 4) [m]."""
        found = np.tile(np.eye(4), (2, len(self.cell.arm.links), 1, 1))
        bodies = body_poses(self.vjm, self.poses)
        for k, (link, (p, R)) in enumerate(zip(self.cell.arm.links, bodies, strict=False)):
            found[:, k, :3, :3], found[:, k, :3, 3] = R @ link.frame, p
        return found

    @property
    def sizes(self) -> Array:
        """Return length and outer diameter of each tube; of a link without one its way, (n + 1, 2) [m]."""
        tubes, ways = [link.tube for link in self.elastic.link], self.vjm.steps
        return np.array(
            [
                (t.length.value, t.outer_diameter.value) if t else (np.linalg.norm(way), 0.0)
                for t, way in zip(tubes, ways, strict=True)
            ]
        )

    @property
    def tube_lines(self) -> tuple[Array, Array]:
        """Compute where the lines that draw the tubes begin and end, in both poses, (2, k, 3) [m]."""
        beams, (length, diameter) = self.beams, self.sizes.T
        start, along = beams[..., :3, 3], beams[..., :3, 0] * length[:, None]
        rings = 0.5 * diameter[:, None, None] * RING[:, :2]  # (tubes, p, 2)
        near = start[:, :, None] + np.einsum("rkxy,kpy->rkpx", beams[..., :3, 1:3], rings)
        far, step = near + along[:, :, None], len(RING) // SPOKES
        lines = (
            (near, np.roll(near, -1, axis=2)),
            (far, np.roll(far, -1, axis=2)),
            (near[:, :, ::step], far[:, :, ::step]),
        )
        begin, end = (
            np.concatenate([x.reshape(2, -1, 3) for x in ends], axis=1) for ends in zip(*lines, strict=True)
        )
        return begin, end

    @property
    def bending(self) -> Array:
        """Compute virtual joints under the payload, a kilogram if it is not stated, (2, n_theta) [m, rad]."""
        arm, q = self.cell.arm, self.poses
        force = np.array([0, 0, -GRAVITY * (arm.payload or 1.0), 0, 0, 0])
        load = np.tile(force, (len(q), 1)), np.tile(self.vjm.load, (len(q), 1))
        return np.asarray((arm.C_theta @ generalised_load(chain(self.vjm, q), *load)).T)

    def doubted(self, name: str) -> bool:
        """Tell whether a doubt is about a link, joint or point of that name."""
        said = [doubt.sentence for doubt in self.doubts]
        return any(s.startswith(f"{name} ") or name in s.partition(":")[0].split(", ") for s in said)


def check(folder: str | Path) -> Checked:
    """Read an arm, look for what must be confirmed and what may be wrong; InputError for a wrong folder."""
    cell = build_cell(folder)
    arm = ArmContext(cell, read_elastic(find_arm(folder) / "elastic.toml"), tool_sag(cell))
    return Checked(
        **vars(arm),
        apart=check_agreement(cell.vjm, cell.plant),
        items=to_confirm(arm),
        doubts=arm_warnings(arm),
    )


def refuse_warnings(folder: str | Path, doubts: Sequence[Doubt]) -> None:
    """Refuse an arm's folder, or runs of it, that raise a warning.

    Args:
        folder: Of the arm; its own warnings come first.
        doubts: Of the runs.

    Raises:
        BenchError: Lists all warnings in one line.
    """
    if said := (*check(folder).doubts, *doubts):
        count = "1 doubt" if len(said) == 1 else f"{len(said)} doubts"
        raise BenchError(f"--strict: {count}: {'; '.join(doubt.sentence for doubt in said)}")
