"""True and identified compliances of the links: heatmaps side by side, and every number in a table."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import ViewFit
from rerun.components import Colormap, MagnificationFilter

from testbench.arm.stiffness import eigenvalue_scale
from testbench.errors import Array
from testbench.views.recording.drawing import Drawing
from testbench.views.recording.pen import Pen, text_view

AXES = ("x", "y", "z", "phi_x", "phi_y", "phi_z")
RANGE = 2.0  #: Colours end here: about eleven times the true diagonal [1].
FRAME = (1, 0), (1, 0)
"""Empty rows above and columns on the left, where the viewer writes the names of the axes."""


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


def write_heatmap(pen: Pen, path: str, matrices: Sequence[Array]) -> None:
    """Matrices without unit as one picture of one range of colours, an empty column left of each."""
    data = np.hstack([np.pad(compress(C), FRAME) for C in matrices])
    pen.still(path, rr.Tensor(data, dim_names=("row", "column"), value_range=(-RANGE, RANGE)))


def heatmap_view(path: str, name: str) -> rrb.TensorView:
    """The view of a heatmap; grey is zero, the brighter the larger."""
    name += " (signed log; 1 = true diagonal)"
    mapping = rrb.TensorScalarMapping(colormap=Colormap.CyanToYellow, mag_filter=MagnificationFilter.Nearest)
    return rrb.TensorView(
        origin=path, name=name, scalar_mapping=mapping, view_fit=ViewFit.FillKeepAspectRatio
    )


def link_matrices(drawing: Drawing) -> dict[str, list[Array]]:
    """By link: the true compliance, then that of each shown model, (6, 6) [m/N, rad/(N m)]."""
    identified = [drawing.estimates[k].C_theta for k in drawing.about.shown]
    blocks = [slice(6 * i, 6 * i + 6) for i in range(len(drawing.cell.plant.arm.links))]
    return {
        link.name: [link.compliance, *(C[block, block] for C in identified)]
        for link, block in zip(drawing.cell.plant.arm.links, blocks, strict=True)
    }


def write_compliances(pen: Pen, drawing: Drawing) -> None:
    """One heatmap a link."""
    for link, matrices in link_matrices(drawing).items():
        write_heatmap(pen, f"compliance/{link}", [scaled(C, matrices[0]) for C in matrices])


def compliance_grid(drawing: Drawing) -> rrb.Grid:
    """All links on one screen."""
    heads = " | ".join(drawing.heads)
    views = [heatmap_view(f"compliance/{link}", f"{link}: {heads}") for link in link_matrices(drawing)]
    beside = text_view("compliance_legend", "How to read it")
    return rrb.Grid(*views, beside, grid_columns=2, name="Compliance")
