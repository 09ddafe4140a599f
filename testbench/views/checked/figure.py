"""Picture of an arm: two poses from the side with beams, tubes, markers and load; what to confirm."""

from collections.abc import Sequence
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Polygon
from scipy.spatial import ConvexHull, QhullError

from testbench.bench.checked import Checked
from testbench.bench.confirm import Item
from testbench.errors import Array
from testbench.plant.corners import RING, corners
from testbench.plant.shapes import body_names, rigid_frames, visual_shapes
from testbench.views.checked.words import listed, sag_words
from testbench.views.colours import LOAD, NOMINAL, hexadecimal
from testbench.views.data.words import count
from testbench.views.figure import SOFT, page, quiet, say

DARK = "#404040"
MARKER, WEIGHT = hexadecimal(NOMINAL), hexadecimal(LOAD)
ARROW = 0.2  #: Length of the load's arrow over the reach [1].
MARKED = 17.0  #: Of a marker's name from it [pt].
ROOM = 0.42  #: Height of a number to confirm [in].
ASIDE = 30.0  #: Of a joint's number from the joint [pt].
AXIS = 0.12  #: Length of the axes of the base over the reach [1].
MARGIN = 0.15  #: Space around the arm over the reach [1].
BARS = 9  #: Numbers to confirm that are shown.
LETTERS = 110  #: In a line of a doubt.
TITLES = "Zero pose", "Pose of median sag"


def picture(checked: Checked) -> Figure:
    """The arm in two poses, and what must be confirmed."""
    items, lines = listed(checked, BARS), _lines(checked)
    room = ROOM * (len(items) + 0.5 * len(lines) + 1.2)
    figure = page(5.3 + room)
    above, below = figure.subfigures(2, 1, height_ratios=(4.2, room + 0.3))  # type: ignore[misc]  # stubs: one or several
    left, centre = above.subplots(1, 2)
    right = below.subplots()
    for k, axes in enumerate((left, centre)):
        _side(axes, checked, k)
        axes.set_title(TITLES[k], fontsize="medium")
    _confirm(right, items, lines)
    arm = checked.cell.arm
    words = count(len(checked.doubts), "doubt") if checked.doubts else "no doubts"
    say(
        figure,
        f"{arm.name}: {sag_words(checked)}; {words}",
        "Above: shapes as drawn in grey, tubes at their true diameter as lines, beam axes as arrows. Below: "
        "numbers to confirm, by the share of the sag that hangs on them.",
    )
    return figure


def _side(axes: Axes, checked: Checked, k: int) -> None:
    """One pose from the side: along the horizontal that the arm reaches along, and up."""
    cell, reach = checked.cell, checked.reach
    frames = rigid_frames(cell.room, checked.poses[k : k + 1])
    place = dict(zip(body_names(cell.room), frames.positions[0], strict=True))
    plane = _plane(frames.positions[0, 1:] - cell.vjm.base[:3, 3], reach)
    hook = place[cell.arm.load] @ plane
    seen = [hook - [0, ARROW * reach], *(place[name] @ plane for name in (cell.arm.tool, *cell.arm.markers))]
    for shape in visual_shapes(cell.room):
        p, R = frames.positions[0, shape.body], frames.rotations[0, shape.body]
        outline = _hull((p + corners(shape) @ R.T) @ plane)
        axes.add_patch(Polygon(outline, facecolor=SOFT, alpha=0.16, linewidth=0))
        seen += list(outline)
    _base(axes, cell.vjm.base, plane, reach)
    _beams(axes, checked, checked.beams[k], plane)
    _tool(axes, checked, place, plane)
    low, high = np.min(seen, axis=0) - MARGIN * reach, np.max(seen, axis=0) + MARGIN * reach
    axes.dataLim.set_points(np.array([low, high]))  # not what patches add: a wrong tube may be long
    axes.margins(0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="horizontal, the way the arm reaches [m]", ylabel="up [m]")
    quiet(axes)


def _plane(offsets: Array, reach: float) -> Array:
    """What projects on the drawing: the horizontal on which the arm reaches farthest, and up, (3, 2)."""
    flat = offsets[:, :2]
    far = flat[np.linalg.norm(flat, axis=1).argmax()]
    size = float(np.linalg.norm(far))
    x, y = far / size if size > 0.05 * reach else (1.0, 0.0)
    return np.array([[x, 0], [y, 0], [0, 1]])


def _beams(axes: Axes, checked: Checked, beams: Array, plane: Array) -> None:
    """Tubes at their true diameter, their axes as arrows, joints as dots with their numbers."""
    for link, pose, (length, diameter) in zip(checked.cell.arm.links, beams, checked.sizes, strict=True):
        start, x = pose[:3, 3], pose[:3, 0]
        ring = diameter / 2 * RING @ pose[:3, [1, 2, 0]].T
        ends = np.concatenate([start + ring, start + length * x + ring]) @ plane
        thick = 2.8 if checked.doubted(link.name) else 1.0
        axes.add_patch(Polygon(_hull(ends), fill=False, edgecolor=DARK, linewidth=thick))
        a, b = start @ plane, (start + length * x) @ plane
        _arrow(axes, a, b, DARK, 1.4)
        if thick > 1:
            _label(axes, (a + b) / 2, f"{link.name} ?", DARK, (0, 0))
    for k, (joint, pose) in enumerate(zip(checked.cell.arm.joints, beams[1:], strict=True)):
        at = pose[:3, 3] @ plane
        axes.plot(*at, "o", color=DARK, markersize=4)
        words = f"{joint.name} ?" if checked.doubted(joint.name) else f"{k + 1}"
        way = (beams[k][:3, 0] + pose[:3, 0]) @ plane
        off = ASIDE * np.array([-way[1], way[0]]) / max(float(np.linalg.norm(way)), 0.1)
        _label(axes, at, words, DARK, tuple(off if k % 2 else -off))


def _tool(axes: Axes, checked: Checked, place: dict[str, Array], plane: Array) -> None:
    """Markers, load point and its weight."""
    arm = checked.cell.arm
    tool = place[arm.tool] @ plane
    for name in arm.markers:
        point = place[name] @ plane
        axes.plot(*np.transpose([tool, point]), color=MARKER, linewidth=0.8)
        axes.plot(*point, "o", color=MARKER, markersize=7)
        out = point - tool
        _label(axes, point, name, MARKER, tuple(MARKED * out / max(float(np.linalg.norm(out)), 1e-9)))
    hook = place[arm.load] @ plane
    down = hook - [0, ARROW * checked.reach]
    axes.plot(*np.transpose([tool, hook]), color=WEIGHT, linewidth=0.8)
    _arrow(axes, hook, down, WEIGHT, 3.0)
    words = "no payload" if arm.payload is None else f"{arm.payload:g} kg"
    _label(axes, down, words, WEIGHT, (0, -12))


def _base(axes: Axes, base: Array, plane: Array, reach: float) -> None:
    """The axes of the base, those that do not point at the eye."""
    origin = base[:3, 3] @ plane
    for k, name in enumerate("xyz"):
        tip = (base[:3, 3] + AXIS * reach * base[:3, k]) @ plane
        if np.linalg.norm(tip - origin) > 0.8 * AXIS * reach:
            _arrow(axes, origin, tip, "black", 1.6)
            _label(axes, tip, name, "black", (8, 6))
    _label(axes, origin, "base", "black", (-18, -12))


def _arrow(axes: Axes, start: Array, end: Array, colour: str, width: float) -> None:
    ends = (start[0], start[1]), (end[0], end[1])
    patch = FancyArrowPatch(*ends, arrowstyle="-|>", color=colour, shrinkA=0, shrinkB=0)
    patch.set(linewidth=width, mutation_scale=6 + 4 * width)
    axes.add_patch(patch)


def _label(axes: Axes, at: Array, words: str, colour: str, off: tuple[float, ...]) -> None:
    """Words off a point [pt]; names of a stranger's file are no formulas."""
    axes.annotate(
        words,
        (at[0], at[1]),
        xytext=(off[0], off[1]),
        textcoords="offset points",
        color=colour,
        weight="bold",
        clip_on=True,
        ha="center",
        va="center",
    )


def _hull(points: Array) -> Array:
    """The corners of the hull of points in the plane, (corners, 2); of points on a line its ends."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        along = points @ (points[-1] - points[0])
        return np.asarray(points[[int(along.argmin()), int(along.argmax())]])


def _lines(checked: Checked) -> list[str]:
    """What stands below the numbers to confirm: how many more there are, and doubts."""
    rest = len(checked.items) - len(listed(checked, BARS))
    found = [f"and {rest} more of less effect"] if rest else []
    for doubt in checked.doubts:
        found += wrap(f"Doubt: {doubt.sentence}", LETTERS)
    return found


def _confirm(axes: Axes, items: Sequence[Item], lines: Sequence[str]) -> None:
    """A bar a number, its length the share of the sag that hangs on it; other lines below."""
    for k, item in enumerate(items):
        axes.text(0, k, item.words, va="bottom")
        axes.barh(k + 0.2, 100 * item.share, height=0.3, color=SOFT)
        axes.text(100 * item.share + 1, k + 0.2, f"{100 * item.share:.0f} %", va="center", weight="bold")
    for k, line in enumerate(lines):
        axes.text(0, len(items) + 0.1 + 0.5 * k, line, va="bottom")
    axes.set(xlim=(0, 110), ylim=(len(items) + 0.5 * len(lines) + 0.1, -0.6), yticks=[], xticks=[])
    axes.set_title("To confirm, and the share of the sag that hangs on it", loc="left", weight="bold")
    axes.spines[:].set_visible(False)
