"""True and identified compliances of the links: heatmaps side by side, and every number in a table."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import ViewFit
from rerun.components import Colormap, MagnificationFilter

from testbench.arm.stiffness import eigenvalue_scale
from testbench.errors import Array
from testbench.views.markdown import lines
from testbench.views.recording.drawing import Drawing
from testbench.views.recording.pen import Pen, text_view

AXES = ("x", "y", "z", "phi_x", "phi_y", "phi_z")
RANGE = 2.0
"""Colours end here: about eleven times the true diagonal [1]."""
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


def columns(drawing: Drawing) -> list[str]:
    """Headings of the matrices: truth and the shown models."""
    return ["truth", *(drawing.names[k] for k in drawing.shown)]


def link_matrices(drawing: Drawing) -> dict[str, list[Array]]:
    """By link: the true compliance, then that of each shown model, (6, 6) [m/N, rad/(N m)]."""
    identified = [drawing.estimates[k].C_theta for k in drawing.shown]
    blocks = [slice(6 * i, 6 * i + 6) for i in range(len(drawing.cell.arm.links))]
    return {
        link.name: [link.compliance, *(C[block, block] for C in identified)]
        for link, block in zip(drawing.cell.arm.links, blocks, strict=True)
    }


def write_compliances(pen: Pen, drawing: Drawing) -> None:
    """One heatmap a link."""
    for link, matrices in link_matrices(drawing).items():
        write_heatmap(pen, f"compliance/{link}", [scaled(C, matrices[0]) for C in matrices])


def compliance_grid(drawing: Drawing) -> rrb.Grid:
    """All links on one screen."""
    heads = " | ".join(columns(drawing))
    views = [heatmap_view(f"compliance/{link}", f"{link}: {heads}") for link in link_matrices(drawing)]
    return rrb.Grid(
        *views, text_view("compliance_legend", "How to read it"), grid_columns=2, name="Compliance"
    )


def legend(drawing: Drawing) -> str:
    """What the heatmaps show, and what not to read into them."""
    after = 6 * len(drawing.cell.arm.links)  # where the joints' compliances begin
    lumped = [drawing.names[k] for k in drawing.shown if drawing.estimates[k].structure.a.max() < after]
    sentences = [
        f"Each picture: {', '.join(columns(drawing))} from left to right, rows and columns {', '.join(AXES)} "
        "in the link's beam frame. Entry ij over the root of the true entries ii and jj. Grey: 0; yellow: "
        "positive, brown as large as a true diagonal, bright ten times as large; blue to cyan: negative. "
        "**Blue on a diagonal is a link that gives energy away**.",
        "A model without joints holds the compliance of the joint behind a link in the link: "
        f"{', '.join(lumped)}."
        if lumped
        else "",
        "Entries are not comparable between models: the data see only some directions. Predictions are.",
        "Numbers: tab `Numbers`.",
    ]
    return "\n\n".join(filter(None, sentences))


def numbers(drawing: Drawing) -> str:
    """Eigenvalues of every link, then every entry in SI units."""
    heads, eigen, matrices = columns(drawing), [], []
    for link, found in link_matrices(drawing).items():
        for head, C in zip(heads, found, strict=True):
            S = scaled(C, found[0])
            values = np.linalg.eigvalsh((S + S.T) / 2)
            eigen.append([link, head, *(f"{x:.2e}" for x in values)])
        matrices.append(f"### {link}")
        for head, C in zip(heads, found, strict=True):
            cells = [[axis, *(f"{x:.3e}" for x in row)] for axis, row in zip(AXES, C, strict=True)]
            matrices.append(lines([f"{head} (m/N, rad/N, rad/(N m))", *AXES], cells))
    return "\n\n".join(
        [
            "### Eigenvalues of each link (1)",
            "Of the matrix in units of the true diagonal, ascending; below zero is not conservative.",
            lines(["link", "model", *(f"{k}" for k in range(1, 7))], eigen),
            *matrices,
        ]
    )
