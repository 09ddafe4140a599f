"""Where the tool is, what the tracker reads and where a weight hangs: as asked for, else proposed."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array
from testbench.plant.import_robot.beam import COINCIDE, Beam, triangles
from testbench.plant.import_robot.chain import Chain
from testbench.plant.import_robot.wishes import Wishes

AROUND = 0.1  #: Distance of the proposed markers from the tool over the reach [1].
BEYOND = 0.05  #: Distance of the proposed load point from the tool, along its axis, over the reach [1].
FLAT = 0.05  #: Markers on a line: their spread across it is less than this share of that along it [1].
MILLIMETRE = 3  #: Digits of a proposed position in metres.


@dataclass(frozen=True, eq=False)
class Points:
    """Points of the tool, in its frame."""

    markers: tuple[tuple[str, Array], ...]  #: Name and position, (3,) [m].
    load: Array  #: Where a weight hangs, (3,) [m].
    #: What nobody has stated, "tool", "load" or "markers", and in words.
    proposed: tuple[tuple[str, str], ...]


def tool_pose(chain: Chain, wishes: Wishes) -> Array:
    """Pose of the tool in the last part, (4, 4) [m]."""
    return chain.tip if wishes.tool is None else np.asarray(chain.tip @ wishes.tool)


def points(chain: Chain, wishes: Wishes, last: Beam, reach: float) -> Points:
    """Markers and load point.

    Args:
        chain: The arm.
        wishes: What was asked for.
        last: Beam of the last link: the tool's axis goes on in its direction.
        reach: Stretched length of the arm [m].
    """
    tool = tool_pose(chain, wishes)
    ahead = _ahead(chain, tool, last, reach)
    axes = tool[:3, :3].T @ last.frame  # beam axes in the tool's frame, as columns
    sites = _sites(chain, tool)
    proposed: list[tuple[str, str]] = []
    if wishes.tool is None:
        proposed.append(("tool", f"tool at {chain.tip_name!r} of the robot's file"))
    if wishes.load is None:
        proposed.append(
            ("load", f"load point {1000 * (ahead + BEYOND * reach):.0f} mm beyond the tool on its axis")
        )
    if not wishes.markers:
        origin = (
            "at the sites of the robot's file" if sites else f"{1000 * AROUND * reach:.0f} mm off the tool"
        )
        proposed.append(("markers", f"markers {origin}"))
    markers = wishes.markers or sites or _ring(axes, AROUND * reach, ahead)
    load = np.round((ahead + BEYOND * reach) * axes[:, 0], MILLIMETRE) if wishes.load is None else wishes.load
    return Points(markers, load, tuple(proposed))


def on_a_line(positions: Array) -> bool:
    """Whether markers, (m, 3) [m], are fewer than three or lie on a line."""
    if len(positions) < 3:
        return True
    along, across, *_ = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    return bool(across <= FLAT * along)


def unique(name: str, taken: Iterable[str]) -> str:
    """A name that nothing else has: underscores are put behind it."""
    others = set(taken)
    while name in others:
        name += "_"
    return name


def _sites(chain: Chain, tool: Array) -> tuple[tuple[str, Array], ...]:
    """The sites of the last part in the tool's frame if they can be markers, else none."""
    found = [site for site in chain.parts[-1].sites if site.name != chain.tip_name]
    places = np.array([site.position for site in found]).reshape(-1, 3)
    local = (places - tool[:3, 3]) @ tool[:3, :3]
    return () if on_a_line(local) else tuple((s.name, p) for s, p in zip(found, local, strict=True))


def _ahead(chain: Chain, tool: Array, last: Beam, reach: float) -> float:
    """How far the drawn end, of a flange or a gripper, is ahead of a tool in the last joint [m]."""
    surface = triangles(chain.parts[-1].shapes).reshape(-1, 3)
    if last.distance > COINCIDE * reach or not len(surface):
        return 0.0
    return max(0.0, float(((surface - tool[:3, 3]) @ last.frame[:, 0]).max()))


def _ring(axes: Array, radius: float, ahead: float) -> tuple[tuple[str, Array], ...]:
    """Three markers around the tool's axis."""
    angles = 2 * np.pi * np.arange(3) / 3
    ring = ahead * axes[:, 0] + radius * (
        np.outer(np.cos(angles), axes[:, 1]) + np.outer(np.sin(angles), axes[:, 2])
    )
    return tuple((f"P{k}", np.round(place, MILLIMETRE) + 0.0) for k, place in enumerate(ring, start=1))
