"""What acts on the arm and what reads it, as it stands in a cell: weights, forces, trackers."""

from collections.abc import Sequence

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.plant.shapes import BodyFrames
from testbench.report.colours import LOAD, MEASURED
from testbench.report.scene import Layer
from testbench.workflows.cell import Cell

STEEL = 7850.0  #: Density by which the size of a weight follows from its mass [kg/m^3].
CORD, ARROW = (
    0.1,
    0.2,
)  #: Length of a weight's cord, and of the arrow of the largest force, over the reach [1].
UPRIGHT = 1e-6  #: Of a force, most of what is not straight down in a weight [1].
KINDS = 4  #: Most masses or forces that have a label each.
GAUGE, GAUGE_RADIUS = 0.05, 0.008  #: Length and radius of a gauge over the reach [1].
LEGS, HEIGHT, SPREAD = 3, 1.2, 0.35  #: Of a tripod; how high and how wide it stands at most [m].


def on_tool(cell: Cell, frames: BodyFrames, point: Array) -> Array:
    """Places of points that are fixed in the tool's frame, of the arm as it is drawn.

    Args:
        cell: The arm.
        frames: Its bodies, straight or bent.
        point: In the tool's frame, (poses, 3) [m].

    Returns:
        Places, (poses, 3) [m].
    """
    tool = cell.room.names.index(cell.arm.tool)
    turned = np.einsum("rxy,ry->rx", frames.rotations[:, tool], point)
    return np.asarray(frames.positions[:, tool] + turned)


def loads(hook: Array, force: Array, reach: float) -> list[Layer]:
    """Weights where a force points straight down, arrows of all other forces, each with its size.

    Args:
        hook: Where they act, (poses, 3) [m].
        force: World axes, (poses, 3) [N].
        reach: Of the arm [m].

    Returns:
        A layer for each mass, or one for all if there are many; and one of the other forces.
    """
    size = np.linalg.norm(force, axis=1)
    hung = (np.linalg.norm(force[:, :2], axis=1) <= UPRIGHT * size) & (force[:, 2] < 0)
    layers = []
    mass = np.array([float(f"{kg:.4g}") for kg in size / GRAVITY])
    for name, label, some in _kinds(mass, hung, "kg", "load"):
        radius = float(np.cbrt(mass[some].max() / (2 * np.pi * STEEL)))
        at = _of(hook, some)
        layers.append(
            Layer(name, LOAD, "weights", at, at - [0, 0, CORD * reach], labels=label, radius=radius)
        )
    longest = ARROW * reach / max(float(size.max(initial=0.0)), 1e-30)
    newton = np.array([float(f"{own:.3g}") for own in size])
    for name, label, some in _kinds(newton, ~hung & (size > 0), "N", "force"):
        at = _of(hook, some)
        way = longest * force[:, None]
        outward = ((force * hook).sum(axis=1) > 0)[:, None, None]  # an arrow into the arm would be hidden
        tail, tip = np.where(outward, at, at - way), np.where(outward, at + way, at)
        layers.append(Layer(name, LOAD, "arrows", tail, tip, labels=label))
    return layers


def _kinds(size: Array, some: Array, unit: str, noun: str) -> list[tuple[str, Sequence[str], Array]]:
    """Names, labels and poses (poses,) of what acts there: one for each size, or for all of many."""
    sizes = np.unique(size[some].round(6))
    if len(sizes) > KINDS:
        return [(f"{noun}, {sizes[0]:,.5g} to {sizes[-1]:,.5g} {unit}", (), some)]
    several = len(sizes) > 1
    return [
        (
            f"{noun}, {own:,.5g} {unit}" if several else noun,
            [f"{own:,.5g} {unit}"],
            some & (size.round(6) == own),
        )
        for own in sizes.tolist()
    ]


def _of(points: Array, some: Array) -> Array:
    """Points of some poses, (poses, 3) to (poses, 1, 3); NaN in all others."""
    return np.where(some[:, None], points, np.nan)[:, None]


def trackers(stations: Array, names: Sequence[str] = ("tracker",)) -> Layer:
    """Draw trackers where they stand, with their names.

    Args:
        stations: Where, (k, 3) [m].
        names: Of the trackers, k.

    Returns:
        The layer.
    """
    return Layer("tracker", MEASURED, "trackers", np.reshape(stations, (1, -1, 3)), labels=names)


def gauges(at: Array, direction: Array, tool: Array, reach: float) -> list[Layer]:
    """Draw gauges: cylinders along their directions, which touch the markers from outside of the tool.

    Args:
        at: Where they touch, (poses, m, 3) [m].
        direction: Their directions, unit vectors, (poses, m, 3) [1]; zero where there is none.
        tool: Where the tool is, (poses, 3) [m].
        reach: Of the arm [m].

    Returns:
        A layer; none without a gauge.
    """
    there = direction.any(axis=2, keepdims=True)
    outward = np.sign(np.vecdot(at - tool[:, None], direction))[..., None]
    tip = np.where(there, at, np.nan)
    end = tip + GAUGE * reach * np.where(outward < 0, -1.0, 1.0) * direction
    layer = Layer("gauges", MEASURED, "cylinders", tip, end, radius=GAUGE_RADIUS * reach)
    return [layer] if np.isfinite(tip).any() else []


def read_along(data: Dataset, tool: Array, reach: float) -> list[Layer]:
    """Draw what reads along lines: gauges, and lines from fixed points, at the unloaded markers.

    Args:
        data: The runs, in the base's frame.
        tool: Where the tool is, (runs, 3) [m].
        reach: Of the arm [m].

    Returns:
        The layers; none for positions alone.
    """
    if data.direction is None or data.reach is None:
        return []
    along, length = np.where(data.lines[..., None], data.direction, 0.0), data.reach[..., None]
    marker = np.where(data.lines[..., None] & (length > 0), data.before, np.nan)
    meters = Layer("distances", MEASURED, "lines", marker - length * along, marker)
    layers = gauges(data.before, np.where(length > 0, 0.0, along), tool, reach)
    return [*layers, meters] if np.isfinite(marker).any() else layers


def legs(head: Array) -> Array:
    """Legs of the tripods of trackers, (k, 3) to (3 k, 2, 3) [m]: down to the floor if that is near."""
    down = np.where((head[:, 2] > 0) & (head[:, 2] < 2 * HEIGHT), head[:, 2], HEIGHT)
    turn = 2 * np.pi * np.arange(LEGS) / LEGS
    way = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(LEGS)])
    feet = head[:, None] + SPREAD * down[:, None, None] * way - down[:, None, None] * np.array([0, 0, 1.0])
    return np.stack([np.broadcast_to(head[:, None], feet.shape), feet], axis=2).reshape(-1, 2, 3)
