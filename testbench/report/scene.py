"""Contents of pictures, pages and recordings of a run: arms in poses, loads, layers, charts, maps."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset, select_evenly
from testbench.errors import Array, Ids
from testbench.model.structure import JOINTS_ONLY
from testbench.plant.shapes import BodyFrames, rigid_frames
from testbench.report.colours import GREY, LOAD, MEASURED, SCALE, STIFFNESS, Colour, Look
from testbench.report.schema import Table, show
from testbench.runs.rows import Row
from testbench.workflows.model_names import in_words

if TYPE_CHECKING:  # imports that take long
    from testbench.workflows.cell import Cell

MAX_POSES, MAX_LARGE_ERRORS = 240, 40
"""Poses that are drawn at most, and those of largest error among them: nobody looks at more."""
LONGEST_AXIS, LEAST_PATH = 0.15, 0.3
"""Length of most semi-axes of ellipsoids over the size of their path [1], and that size at least [m]."""
OUTLINE = 48  #: Corners of the outline of an ellipsoid.
MAX_MAGNIFICATION = 1e5  #: Largest magnification: what is below rounding is not drawn.
APART = 10.0  #: Times the median of the best map beyond which an error makes the scale logarithmic [1].
DEEP = 1e-3  #: Least error on a logarithmic scale over the greatest [1].


@dataclass(frozen=True)
class Layer:
    """Marks of one kind, the same number in every pose, or the same in all of them.

    Dots, small ones, arrows, lines, cylinders; tubes, coloured by a number each; weights on cords; trackers
    on tripods; ellipsoids; faces, which are squares that are seen through, each with its normal.
    """

    name: str  #: For the legend.
    colour: Colour
    kind: Literal[
        "dots",
        "specks",
        "arrows",
        "lines",
        "cylinders",
        "tubes",
        "weights",
        "trackers",
        "ellipsoids",
        "faces",
    ]
    at: Array  #: Where they are or begin, (poses, k, 3), of what stands still (1, k, 3) [m]; NaN: none.
    #: Where arrows, lines, cylinders, tubes, cords of weights and normals of faces end, as many [m].
    to: Array | None = None
    labels: Sequence[str] = ()  #: What stands beside each, (k,); none if empty.
    shown: bool = True  #: Whether it is visible at first.
    values: Array | None = None  #: Of tubes, on one scale in the scene, (k,) [mm]; NaN where there is none.
    #: Of cylinders, and of weights, which are as high as wide; of faces half a side [m].
    radius: float = 0.0
    semi_axes: Array | None = None  #: Of ellipsoids, which stand still, one axis per row, (k, 3, 3) [m].


@dataclass(frozen=True)
class PoseGroup:
    """Poses of one kind, such as the runs."""

    name: str  #: Of the kind, such as "Runs".
    names: Sequence[str]  #: Of each pose, such as "run 3".
    words: Sequence[str]  #: What is said of each, plain text.
    rigid: BodyFrames  #: The arm without load.
    bent: BodyFrames | None  #: Under load, its deflection magnified.
    layers: Sequence[Layer] = ()
    first: int = 0  #: Index of the pose that is shown first.
    worst: int | None = None  #: Index of the worst, where the first is typical: see `typical_first`.
    #: What the eye sees from the broad side, (n, 3) [m]; all that is drawn if None. Groups of the first one's
    #: poses with this are insets beside it.
    near: Array | None = None
    ordered: bool = False  #: Whether the poses follow each other, as along a path.
    #: Whether a reader lands on the first whatever its errors are: see `typical_first`.
    fixed: bool = False


def ellipsoid_layer(rows: Sequence[Row], force: float) -> tuple[float, Layer]:
    """Make a layer of the ellipsoids over which a force moves the tool, and say how much it is magnified.

    Args:
        rows: Along a path, see `workflows.program_numbers`.
        force: Size of the force [N].
    """
    axes = np.array([np.array(row.semi_axes_mm)[:, None] / 1e3 * np.array(row.directions) for row in rows])
    at = np.array([row.at_m for row in rows])
    scale = arrow_scale(axes[:, 0], LONGEST_AXIS * max(LEAST_PATH, float(np.linalg.norm(np.ptp(at, axis=0)))))
    name = f"where {force:,.0f} N in any direction move the tool"
    return scale, Layer(name, STIFFNESS, "ellipsoids", at[None], semi_axes=scale * axes)


def shadow(semi_axes: Array, plane: Sequence[int]) -> Array:
    """Compute the outline of an ellipsoid seen along an axis, about its centre.

    The points A u, u of length one, fill an ellipse with the root of A A^T, A the semi-axes in the plane.

    Args:
        semi_axes: One per row, (3, 3) [m].
        plane: World axes to the right and up.

    Returns:
        Corners, (n, 2) [m].
    """
    A = semi_axes[:, list(plane)].T
    values, Q = np.linalg.eigh(A @ A.T)
    turns = np.linspace(0, 2 * np.pi, OUTLINE, endpoint=False)
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    return np.asarray(circle * np.sqrt(np.maximum(values, 0)) @ Q.T)


def workspace(
    cell: "Cell", q: Array, words: Sequence[str], layers: Sequence[Layer], first: int = 0
) -> PoseGroup:
    """The arm in poses all over the workspace, (n, joints) [rad, m], and what is said of each."""
    names = [f"Place {k} of {len(q)}" for k in range(1, len(q) + 1)]
    return PoseGroup("Workspace", names, words, rigid_frames(cell.room, q), None, layers, first)


@dataclass(frozen=True)
class Scene:
    """An arm in poses."""

    cell: "Cell"
    title: str  #: What is magnified, and how much.
    groups: Sequence[PoseGroup]  #: The first one is shown first.

    @property
    def insets(self) -> list[PoseGroup]:
        """The groups that show parts of the first one from near."""
        first, *others = self.groups
        return [group for group in others if group.near is not None and group.rigid is first.rigid]

    @property
    def tube_scale(self) -> "ErrorScale | None":
        """What the colours of all tubes mean; None where there are none."""
        sizes = [layer.values for group in self.groups for layer in group.layers if layer.values is not None]
        return scale_of(*sizes) if any(np.isfinite(mm).any() for mm in sizes) else None

    @property
    def tube_words(self) -> str:
        """Say what the colours of all tubes mean; nothing where there are none."""
        scale = self.tube_scale
        if scale is None:
            return ""
        low, high = map(show, scale.ends)
        return f"Tubes are coloured by the error there: dark blue {low} mm to light green {high} mm."


@dataclass(frozen=True)
class ModelLine:
    """The numbers of one model."""

    name: str
    look: Look
    values: Array  #: (n,), in the unit of its chart; NaN where there is none.
    ends: tuple[Array, Array] | None = None  #: Lower and upper end of an interval of each, (n,) both.

    @property
    def words(self) -> str:
        """Return its name in words, without an article: what stands beside what is drawn."""
        return in_words(self.name).removeprefix("the ")


@dataclass(frozen=True)
class RunChart:
    """A number for each pose of a group of the scene, and each model."""

    title: str  #: What the numbers are, with unit.
    group: int  #: Index of the group in the scene.
    across: str  #: What the labels are, such as "run".
    labels: Sequence[str]  #: Of the poses, a few letters each.
    lines: Sequence[ModelLine]
    limit: float | None = None  #: A level across all poses, in the same unit; NaN: none.
    note: str = ""  #: What else there is to say of them.
    limit_is: str = "noise alone, 95 %"  #: What the level is.
    leads: bool = True  #: Whether the last line stands out: the model that is asked about.


@dataclass(frozen=True)
class PlaceMap:
    """Errors at the tool's places in poses of a group of the scene, one map a model on one colour scale."""

    title: str  #: What the errors are, with unit.
    group: int  #: Index of the group in the scene.
    at: Array  #: Tool positions, (n, 3) [m]; NaN where there is none: not drawn.
    lines: Sequence[ModelLine]
    heading: str = "Where it errs"
    without: str = ""  #: What a ring means, a place without a value.
    worst_is: str = "worst"  #: What is written at the largest number of the last line.

    @property
    def difference(self) -> tuple[ModelLine, ModelLine] | None:
        """The last model, the winner, and joint stiffness beside it; None where one is not there."""
        model_lines = [line for line in self.lines[:-1] if line.name == JOINTS_ONLY]
        return (self.lines[-1], model_lines[0]) if model_lines else None


@dataclass(frozen=True)
class PageContent:
    """What of a run is drawn, beside its words."""

    scene: Scene | None = None
    map: PlaceMap | None = None
    runs: Sequence[RunChart] = ()  #: Only beside a scene.
    tables: Sequence[Table] = ()  #: Those that can be sorted and drawn, the first one first.


def charts_of(page: PageContent, k: int) -> list[RunChart]:
    """Charts of a group and of others of the same poses; its map as one where it has none."""
    every = page.scene.groups if page.scene else ()
    same = [j for j, other in enumerate(every) if other.rigid is every[k].rigid]
    charts = [chart for chart in page.runs if chart.group in same and len(chart.labels) > 1]
    if charts or page.map is None or page.map.group != k:
        return charts
    return [RunChart(page.map.title, k, "pose", every[k].names, page.map.lines)]


def sorting_numbers(poses: PoseGroup, charts: Sequence[RunChart]) -> list[Array]:
    """Numbers of lines that are largest in the worst pose, or that which is shown first, (poses,) each."""
    count, worst = len(poses.names), poses.first if poses.worst is None else poses.worst
    sizes = [np.nan_to_num(line.values, nan=-np.inf) for chart in charts for line in chart.lines]
    return [own for own in sizes if len(own) == count and own[worst] == own.max()]


def typical_first(page: PageContent) -> PageContent:
    """The same, opened where the last line that is largest in the worst pose has its median."""
    if page.scene is None:
        return page
    groups = []
    for k, pose_group in enumerate(page.scene.groups):
        if pose_group.fixed:
            groups.append(pose_group)
            continue
        lead = sorting_numbers(pose_group, charts_of(page, k))[-1:]
        order = [k for size in lead for k in np.argsort(size, kind="stable") if np.isfinite(size[k])]
        middle = int(order[(len(order) - 1) // 2]) if order else pose_group.first
        groups.append(
            pose_group
            if middle == pose_group.first
            else replace(pose_group, first=middle, worst=pose_group.first)
        )
    return replace(page, scene=replace(page.scene, groups=groups))


# --- Which poses are drawn, and how many times enlarged -----------------------------------------------------


def largest_and_even(size: Array, rows: Ids, far: int = MAX_LARGE_ERRORS) -> Ids:
    """Places of the largest of some rows and of others evenly, in their order.

    Args:
        size: Error, or deflection, of every row, (n,).
        rows: Those to choose from.
        far: How many of the largest; of a path one, as its neighbours are as large.
    """
    largest = rows[np.argsort(-size[rows], kind="stable")[:far]]
    return np.union1d(largest, select_evenly(rows, MAX_POSES - far))


def of_all(shown: int, total: int, noun: str) -> str:
    """What a title says where not all are drawn: "240 of 1,000 runs, the worst among them"; else nothing."""
    return "" if shown == total else f"{shown} of {total:,} {noun}, the worst among them"


def at_one_target(at: Array, errors: Mapping[str, Array], lead: str) -> tuple[Array, dict[str, Array]]:
    """Errors of models at one target a pose: that where a model errs most. Arrows of more are a tangle.

    Args:
        at: Where arrows begin, (poses, m, 3) [m].
        errors: Of models, (poses, m, 3) [m]; NaN where a target was not read.
        lead: The model.

    Returns:
        Where they begin and the errors there, (poses, 1, 3) [m].
    """
    size = np.linalg.norm(errors[lead], axis=-1)
    one = np.nan_to_num(size, nan=-1.0).argmax(axis=-1)[:, None, None]
    return np.take_along_axis(at, one, 1), {
        name: np.take_along_axis(off, one, 1) for name, off in errors.items()
    }


def arrow_scale(vectors: Array, longest: float) -> float:
    """Magnification by which 95 % of arrows, (..., 3) [m], are drawn no longer than that [m]; NaN: none.

    It is 1, 2 or 5 times a power of ten, and at most `MAX_MAGNIFICATION`.
    """
    size = np.linalg.norm(vectors, axis=-1)
    known = size[np.isfinite(size)]
    true = float(np.quantile(known, 0.95)) if known.size else 0.0
    scale = min(longest / max(true, 1e-30), MAX_MAGNIFICATION)
    power = 10.0 ** math.floor(math.log10(scale))
    return float(power * max(k for k in (1, 2, 5) if k * power <= scale * (1 + 1e-9)))


# --- Scales of maps -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ErrorScale:
    """What colours and sizes mean, the same in all maps or tubes that stand side by side."""

    ends: tuple[float, float]  #: Least and greatest error; what is less is drawn as the least [mm].
    logarithmic: bool

    def _at(self, mm: Array) -> Array:
        """Errors as they are spaced."""
        return np.log10(mm) if self.logarithmic else mm

    def shares(self, mm: Array) -> Array:
        """Places of errors [mm] on the scale, 0 to 1; 0 where all are equal."""
        low, high = self._at(np.array(self.ends))
        at = self._at(np.maximum(mm, self.ends[0]))
        return np.asarray((at - low) / (high - low if high > low else 1.0))

    def errors(self, share: Array) -> Array:
        """Errors [mm] at places on the scale, 0 to 1."""
        low, high = self._at(np.array(self.ends))
        found = low + share * (high - low)
        return np.asarray(10**found if self.logarithmic else found)

    @property
    def words(self) -> str:
        """The unit, and the scale where it is not linear."""
        return "mm, logarithmic" if self.logarithmic else "mm"


def scale_of(*errors_mm: Array) -> ErrorScale:
    """The scale of several maps: logarithmic where an error is far above the median of the best map.

    Args:
        errors_mm: Of each map, (n,) [mm]; NaN where there is no bound.
    """
    errors_mm = tuple(mm[np.isfinite(mm)] for mm in errors_mm if np.isfinite(mm).any())
    every = np.concatenate(errors_mm)
    low, high = float(every.min()), float(every.max())
    far = high > APART * min(float(np.median(mm)) for mm in errors_mm)
    return ErrorScale((max(low, DEEP * high) if far else low, high), far)


def shades(share: Array) -> npt.NDArray[np.uint8]:
    """Colours of places on a scale, 0 to 1, (n,) to (n, 3): the greater the error, the brighter."""
    at = np.linspace(0, 1, len(SCALE))
    parts = [np.rint(np.interp(share, at, part)) for part in zip(*SCALE, strict=True)]
    return np.column_stack(parts).astype(np.uint8)


def tube_colours(layer: Layer, scale: ErrorScale | None) -> npt.NDArray[np.uint8]:
    """Colours of the parts of a tube on the scale of all, (k, 3); grey where there is no error."""
    values = np.full(layer.at.shape[1], np.nan) if layer.values is None else layer.values
    colours = np.tile(np.array(GREY, dtype=np.uint8), (len(values), 1))
    known = np.isfinite(values)
    if scale is not None and known.any():
        colours[known] = shades(scale.shares(values[known]))
    return colours


STEEL = 7850.0  #: Density by which the size of a weight follows from its mass [kg/m^3].
CORD, ARROW = 0.1, 0.2
"""Length of a weight's cord, and of the arrow of the largest force, over the reach [1]."""
UPRIGHT = 1e-6  #: Of a force, most of what is not straight down in a weight [1].
KINDS = 4  #: Most masses or forces that have a label each.
GAUGE, GAUGE_RADIUS = 0.05, 0.008  #: Length and radius of a gauge over the reach [1].
NORMAL = 0.6  #: Length of the arrow of a face's normal over half a side [1].
LEGS, HEIGHT, SPREAD = 3, 1.2, 0.35  #: Of a tripod; how high and how wide it stands at most [m].


def on_tool(cell: "Cell", frames: BodyFrames, point: Array) -> Array:
    """Compute the places of points that are fixed in the tool's frame, of the arm as it is drawn.

    Args:
        cell: The arm.
        frames: Its bodies, straight or bent.
        point: In the tool's frame, (poses, 3) [m].

    Returns:
        Places, (poses, 3) [m].
    """
    tool = cell.room.body_names.index(cell.arm.tool)
    turned = np.einsum("rxy,ry->rx", frames.rotations[:, tool], point)
    return np.asarray(frames.positions[:, tool] + turned)


def loads(hook: Array, force: Array, reach: float) -> list[Layer]:
    """Draw weights for forces that point straight down, arrows for all others, each with its size.

    Args:
        hook: Where they act, (poses, 3) [m].
        force: World axes, (poses, 3) [N].
        reach: Of the arm [m].

    Returns:
        A layer for each mass, or one for all if there are many; and one of all other forces.
    """
    size = np.linalg.norm(force, axis=1)
    hung = (np.linalg.norm(force[:, :2], axis=1) <= UPRIGHT * size) & (force[:, 2] < 0)
    layers = []
    mass = np.array([float(f"{kg:.4g}") for kg in size / GRAVITY])
    name, kinds = _kinds(mass, hung, "kg", "load")
    for label, some in kinds:
        radius = float(np.cbrt(mass[some].max() / (2 * np.pi * STEEL)))
        at = _of(hook, some)
        own = f"load, {label}" if len(kinds) > 1 else name
        to, labels = at - [0, 0, CORD * reach], [label] if label else ()
        layers.append(Layer(own, LOAD, "weights", at, to, labels=labels, radius=radius))
    longest = ARROW * reach / max(float(size.max(initial=0.0)), 1e-30)
    newton = np.array([float(f"{own:.3g}") for own in size])
    name, kinds = _kinds(newton, ~hung & (size > 0), "N", "force")
    if kinds:
        at = np.concatenate([_of(hook, some) for _, some in kinds], axis=1)
        way = longest * force[:, None]
        outward = ((force * hook).sum(axis=1) > 0)[:, None, None]  # an arrow into the arm would be hidden
        tail, tip = np.where(outward, at, at - way), np.where(outward, at + way, at)
        layers.append(Layer(name, LOAD, "arrows", tail, tip, labels=[label for label, _ in kinds if label]))
    return layers


def _kinds(size: Array, some: Array, unit: str, noun: str) -> tuple[str, list[tuple[str, Array]]]:
    """Name all that acts, and label each size with the poses (poses,) where it does; of many sizes none."""
    sizes = np.unique(size[some].round(6)).tolist()
    name = f"{noun}, {sizes[0]:,.5g} to {sizes[-1]:,.5g} {unit}" if len(sizes) > 1 else noun
    if len(sizes) > KINDS:
        return name, [("", some)]
    return name, [(f"{own:,.5g} {unit}", some & (size.round(6) == own)) for own in sizes]


def label_places(layer: Layer) -> Array:
    """Compute where the labels of a layer stand, (poses, k, 3) [m].

    Those of weights stand below them, those of arrows at the end that is farther from the base, where the arm
    is not, those of faces at the tips of their normals, and all others where marks begin.
    """
    if layer.to is None:
        return layer.at
    if layer.kind == "weights":
        return np.asarray(layer.to - np.array([0, 0, 2 * layer.radius]))
    if layer.kind == "arrows":
        nearer = np.linalg.norm(layer.to, axis=2) < np.linalg.norm(layer.at, axis=2)
        return np.where(nearer[..., None], layer.at, layer.to)
    return layer.to if layer.kind == "faces" else layer.at


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
    if data.line_direction is None or data.line_length is None:
        return []
    along, length = (
        np.where(data.is_line_reading[..., None], data.line_direction, 0.0),
        data.line_length[..., None],
    )
    marker = np.where(data.is_line_reading[..., None] & (length > 0), data.before, np.nan)
    meters = Layer("distances", MEASURED, "lines", marker - length * along, marker)
    layers = gauges(data.before, np.where(length > 0, 0.0, along), tool, reach)
    return [*layers, meters] if np.isfinite(marker).any() else layers


def faces(points: Array, normals: Array, half: float, names: Sequence[str]) -> Layer:
    """Draw plane faces as squares with their normals.

    Args:
        points: Middle of every face, (k, 3) [m].
        normals: Unit normals, (k, 3) [1].
        half: Half a side of the squares [m].
        names: Of the faces, k.

    Returns:
        The layer.
    """
    at = np.reshape(points, (1, -1, 3))
    tips = at + NORMAL * half * np.reshape(normals, (1, -1, 3))
    return Layer("faces", MEASURED, "faces", at, tips, labels=names, radius=half)


def squares(layer: Layer) -> Array:
    """Compute the corners of the squares of faces, one after the other around each, (k, 4, 3) [m]."""
    assert layer.to is not None  # by its kind
    [at], [to] = layer.at, layer.to
    x, y = np.moveaxis(frames_along(to - at)[:, :, :2], 2, 0)
    around = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return np.asarray(at[:, None] + layer.radius * (around[:, :1] * x[:, None] + around[:, 1:] * y[:, None]))


def frames_along(way: Array) -> Array:
    """Rotations whose z axes are along vectors, (n, 3) to (n, 3, 3)."""
    z = way / np.linalg.norm(way, axis=1, keepdims=True)
    x = np.cross(np.eye(3)[np.abs(z).argmin(axis=1)], z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def legs(head: Array) -> Array:
    """Compute the legs of the tripods of trackers, (k, 3) to (3 k, 2, 3) [m], down to the floor if near."""
    down = np.where((head[:, 2] > 0) & (head[:, 2] < 2 * HEIGHT), head[:, 2], HEIGHT)
    turn = 2 * np.pi * np.arange(LEGS) / LEGS
    way = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(LEGS)])
    feet = head[:, None] + SPREAD * down[:, None, None] * way - down[:, None, None] * np.array([0, 0, 1.0])
    return np.stack([np.broadcast_to(head[:, None], feet.shape), feet], axis=2).reshape(-1, 2, 3)
