"""The page of an arm: its two poses with beams, tubes, joints, markers and payload, and what to confirm."""

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.bench.checked import Checked
from testbench.errors import Array
from testbench.model.vjm import chain, generalised_load, tool_points
from testbench.plant.corners import RING
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.views.checked.words import tables
from testbench.views.colours import GREY, LOAD, NOMINAL
from testbench.views.magnified import arrow_scale
from testbench.views.page.page import Seen
from testbench.views.page.scene import Layer, Poses, Scene

BENT, ARROW, AXIS = 0.12, 0.2, 0.12  #: Lengths of sag, of the load's arrow and of axes over the reach [1].
SPOKES = 4  #: Lines along a tube.


def seen(checked: Checked) -> Seen:
    """What the page of an arm draws."""
    cell, q = checked.cell, checked.poses
    theta = _sag(checked)
    straight = rigid_frames(cell.room, q)
    moved = elastic_frames(cell.plant, q, theta).positions[:, -1] - straight.positions[:, -1]
    M = arrow_scale(moved, BENT * cell.vjm.reach)
    said = f"joints at {cell.arm.words(q[0])}", f"joints at {cell.arm.words(q[1])}"
    payload = "1 kg" if cell.arm.payload is None else f"{cell.arm.payload:g} kg"
    group = Poses(
        name="Poses",
        names=["Zero, or as near as the limits let", "Pose of median sag"],
        words=[f"{words[0].upper()}{words[1:]}." for words in said],
        rigid=straight,
        bent=elastic_frames(cell.plant, q, M * theta),
        layers=[*_beams(checked), *_tool(checked)],
        first=1,
    )
    title = f"Sag under {payload} by the folder's compliances x {M:g}. Tubes at their true diameter."
    return Seen(scene=Scene(cell, title, [group]), tables=tables(checked))


def _sag(checked: Checked) -> Array:
    """Virtual joints under the payload, a kilogram if it is not stated, (2, n_theta) [m, rad]."""
    cell, q = checked.cell, checked.poses
    force = -GRAVITY * (cell.arm.payload or 1.0)
    load = np.tile([0, 0, force, 0, 0, 0], (len(q), 1)), np.tile(cell.vjm.load, (len(q), 1))
    return np.asarray((cell.arm.C_theta @ generalised_load(chain(cell.vjm, q), *load)).T)


def _beams(checked: Checked) -> list[Layer]:
    """Tubes as lines, their axes as arrows, joints with their names; what is doubted has a question mark."""
    arm, beams = checked.cell.arm, checked.beams
    length, diameter = checked.sizes.T
    start, along = beams[..., :3, 3], beams[..., :3, 0] * length[:, None]
    rings = 0.5 * diameter[:, None, None] * RING[:, :2]  # (tubes, p, 2)
    near = start[:, :, None] + np.einsum("rkxy,kpy->rkpx", beams[..., :3, 1:3], rings)
    far, step = near + along[:, :, None], len(RING) // SPOKES
    begin = _flat(near, far, near[:, :, ::step])
    end = _flat(np.roll(near, -1, axis=2), np.roll(far, -1, axis=2), far[:, :, ::step])
    links = [link.name + " ?" if checked.doubted(link.name) else "" for link in arm.links]
    joints = [joint.name + " ?" * checked.doubted(joint.name) for joint in arm.joints]
    return [
        Layer("tubes", NOMINAL, "lines", begin, end),
        Layer("beam axes", NOMINAL, "arrows", start, start + along, labels=links if any(links) else ()),
        Layer("joints", GREY, "dots", start[:, 1:], labels=joints),
    ]


def _flat(*points: Array) -> Array:
    """Points of all tubes one after the other, each (2, tubes, p, 3) to (2, k, 3)."""
    return np.concatenate([part.reshape(len(part), -1, 3) for part in points], axis=1)


def _tool(checked: Checked) -> list[Layer]:
    """Markers, payload, and the axes of the base."""
    cell, reach = checked.cell, checked.reach
    hook = tool_points(cell.vjm, checked.poses, cell.vjm.load[None])
    base, out = cell.vjm.base[:3, 3], AXIS * reach * cell.vjm.base[:3, :3].T
    payload = "payload not stated" if cell.arm.payload is None else f"payload {cell.arm.payload:g} kg"
    markers = tool_points(cell.vjm, checked.poses, cell.vjm.markers)
    return [
        Layer("markers", NOMINAL, "dots", markers, labels=cell.arm.markers),
        Layer(payload, LOAD, "arrows", hook, hook - np.array([0, 0, ARROW * reach])),
        Layer("axes of the base", GREY, "arrows", np.tile(base, (1, 3, 1)), (base + out)[None], labels="xyz"),
    ]
