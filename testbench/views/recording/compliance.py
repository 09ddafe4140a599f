"""True and identified compliances of the links: heatmaps side by side, and every number in a table."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from testbench.arm.stiffness import eigenvalue_scale
from testbench.errors import Array
from testbench.views.recording.drawing import Drawing
from testbench.views.recording.pen import Pen, text_view
from testbench.views.recording.style import NOISE

AXES = ("x", "y", "z", "phi_x", "phi_y", "phi_z")
LABELS = ("x", "y", "z", "φx", "φy", "φz")  #: The same where there is little room.
RANGE = 2.0  #: Colours end here: about eleven times the true diagonal [1].
SHADES = np.array([(90, 205, 255), (45, 110, 185), (80, 80, 80), (160, 105, 25), (250, 215, 60)])
"""From large and negative over zero, grey, to large and positive."""
KEY = (-10.0, -1.0, 0.0, 1.0, 10.0)  #: Entries that the key shows, over the true diagonal.
SIZE, GAP = 6, 1
"""Cells of a matrix along an edge, and cells between two."""
KEY_ROWS = 2  #: Cells of the key downwards.
MARGIN = 3.0  #: Room for names on the left and above [cells].
LINKS, ALONE = "compliance/links", "compliance/key"


def scaled(C: Array, true: Array) -> Array:
    """A compliance in units of the true diagonal: entries without unit, and the true ones at most 1.

    Args:
        C: Any compliance, (6, 6) [m/N, rad/(N m)].
        true: The true one, (6, 6).
    """
    unit = eigenvalue_scale(true)
    return np.asarray(C / np.outer(unit, unit))


def compress(x: Array) -> Array:
    """Signed logarithm for colours: 0, 1 and 11 become 0, 1 and 2."""
    return np.asarray(np.sign(x) * np.log10(1 + 9 * np.abs(x)))


def colours(x: Array) -> npt.NDArray[np.uint8]:
    """Entries without unit, (...), as red, green and blue, (..., 3)."""
    at, values = np.linspace(-RANGE, RANGE, len(SHADES)), compress(x)
    parts = [np.rint(np.interp(values, at, part)) for part in SHADES.T]
    return np.stack(parts, axis=-1).astype(np.uint8)


def picture(rows: Sequence[Sequence[Array]]) -> npt.NDArray[np.uint8]:
    """Rows of matrices without unit, each (6, 6), with light cells between them, (height, width, 3)."""
    step = SIZE + GAP
    found = np.full((step * len(rows) - GAP, step * len(rows[0]) - GAP, 3), NOISE, dtype=np.uint8)
    for i, row in enumerate(rows):
        for k, C in enumerate(row):
            found[step * i : step * i + SIZE, step * k : step * k + SIZE] = colours(C)
    return found


def write_key(pen: Pen, path: str, C: Array) -> None:
    """One matrix without unit in a large pane, every axis named, above what its colours mean."""
    key = np.full((KEY_ROWS + GAP, SIZE, 3), NOISE, dtype=np.uint8)
    key[GAP:, : len(KEY)] = colours(np.tile(KEY, (KEY_ROWS, 1)))
    pen.still(f"{path}/cells", rr.Image(np.vstack([picture([[C]]), key])))
    middle = np.arange(SIZE) + 0.2
    left, above = np.full(SIZE, -0.7), np.full(SIZE, -0.8)
    below = np.full(len(KEY), SIZE + GAP + KEY_ROWS - 0.1)
    at = [np.column_stack(pair) for pair in ((left, middle), (middle + 0.3, above))]
    at.append(np.column_stack([np.arange(len(KEY)) + 0.5, below]))
    names = [*LABELS, *LABELS, *(f"{x:g}" for x in KEY)]
    pen.names(f"{path}/names", np.vstack(at), names, NOISE)


def key_view(path: str, name: str) -> rrb.Spatial2DView:
    """The view of a key."""
    high = SIZE + KEY_ROWS + 2.0
    bounds = rrb.VisualBounds2D(x_range=(-MARGIN, SIZE + 1.0), y_range=(-MARGIN / 2, high))
    return rrb.Spatial2DView(origin=path, name=f"{name} (1 = true diagonal)", visual_bounds=bounds)


def link_matrices(drawing: Drawing) -> dict[str, list[Array]]:
    """By link: the true compliance, then that of each shown model, (6, 6) [m/N, rad/(N m)]."""
    identified = [drawing.estimates[k].C_theta for k in drawing.about.shown]
    blocks = [slice(6 * i, 6 * i + 6) for i in range(len(drawing.cell.plant.arm.links))]
    return {
        link.name: [link.compliance, *(C[block, block] for C in identified)]
        for link, block in zip(drawing.cell.plant.arm.links, blocks, strict=True)
    }


def write_compliances(pen: Pen, drawing: Drawing) -> None:
    """All links as one picture, a row a link and a column a model, and one matrix large to name the axes."""
    found = link_matrices(drawing)
    rows = [[scaled(C, matrices[0]) for C in matrices] for matrices in found.values()]
    pen.still(f"{LINKS}/cells", rr.Image(picture(rows)))
    step, heads = SIZE + GAP, drawing.heads
    down = step * np.arange(len(found)) + SIZE / 2 - 1.0
    across = step * np.arange(len(heads)) + SIZE / 2
    left = np.column_stack([np.full(len(down), -MARGIN), down])
    pen.names(f"{LINKS}/rows", left, list(found), NOISE)
    pen.names(f"{LINKS}/columns", np.column_stack([across, np.full(len(heads), -2.0)]), heads, NOISE)
    write_key(pen, ALONE, rows[0][0])


def compliance_tab(drawing: Drawing) -> rrb.Container:
    """All links on one screen; beside them how to read it."""
    step = SIZE + GAP
    wide, high = step * len(drawing.heads), step * len(link_matrices(drawing))
    links = rrb.Spatial2DView(
        origin=LINKS,
        name="Compliance of each link (1 = true diagonal), signed log",
        visual_bounds=rrb.VisualBounds2D(x_range=(-2.2 * MARGIN, wide), y_range=(-MARGIN, high)),
    )
    first = next(iter(link_matrices(drawing)))
    key = key_view(ALONE, f"{first}, truth, axes and colours")
    beside = rrb.Vertical(key, text_view("compliance_legend", "How to read it"), row_shares=[3, 2])
    return rrb.Horizontal(links, beside, column_shares=[5, 3], name="Compliance")
