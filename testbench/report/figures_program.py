"""Figures of programs: the stiffness of the tool along the path."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from testbench.report.colours import STIFFNESS, TASK, hexadecimal
from testbench.report.figure import MIN_LETTER_SIZE, Figure, page, quiet, say, short
from testbench.report.run_figure import draw_ellipsoids
from testbench.report.scene import ellipsoid_layer
from testbench.runs.rows import Row

SEMI_AXES = ("softest direction", "between", "stiffest direction")
MARKS = "ovs"


def stiffness_figure(rows: Sequence[Row], force: float) -> Figure:
    """Draw the ellipsoids over which a force moves the tool, from the side and from above, and their sizes.

    Args:
        rows: Along the path, see `workflows.ellipsoids`.
        force: Size of the force [N].
    """
    at = np.array([row.at_m for row in rows])
    sides = np.ptp(at, axis=0)
    scale, layer = ellipsoid_layer(rows, force)
    assert layer.semi_axes is not None  # by its kind
    across = int(sides[1] > sides[0])
    figure = page(2.7)
    panes = figure.subplots(1, 3)
    sizes = np.array([row.semi_axes_mm for row in rows])
    soft, stiff = (int(k) for k in (sizes[:, 0].argmax(), sizes[:, 0].argmin()))
    views = {"from the side": [across, 2], "from above": [0, 1]}
    for axes, (name, plane) in zip(panes, views.items(), strict=False):
        axes.plot(*at[:, plane].T, color=hexadecimal(TASK), linewidth=1.0, linestyle=":")
        draw_ellipsoids(axes, at, layer.semi_axes, plane, hexadecimal(layer.colour))
        right = at[soft, plane[0]] <= np.median(at[:, plane[0]])  # inwards
        axes.annotate(
            short(rows[soft].label, 12),
            at[soft, plane],
            xytext=(7 if right else -7, 7),
            textcoords="offset points",
            fontsize=MIN_LETTER_SIZE,
            ha="left" if right else "right",
        )
        axes.set(xlabel=f"{'xyz'[plane[0]]} [m]", ylabel=f"{'xyz'[plane[1]]} [m]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(f"{name.capitalize()}, × {scale:,g}")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(4))
        quiet(axes)
    size_pane(panes[2], rows, force)
    named = [f"“{short(rows[k].label)}”" for k in (soft, stiff)]
    answer = f"Softest at {named[0]}: {force:,.0f} N move the tool by up to {sizes[soft, 0]:.3f} mm"
    if sizes[soft, 0] > sizes[stiff, 0]:
        answer += f"; stiffest at {named[1]}: {sizes[stiff, 0]:.3f} mm"
    reading = (
        f"Ellipsoids at {len(rows)} poses: where {force:,.0f} N of any direction move the loaded tool, "
        f"magnified. Dotted: their order. Named: the softest pose."
    )
    say(figure, answer, reading)
    return figure


def size_pane(axes: Axes, rows: Sequence[Row], force: float) -> None:
    """Draw the semi-axes of the ellipsoids pose by pose.

    Args:
        axes: Where to.
        rows: See `workflows.ellipsoids`.
        force: Size of the force [N].
    """
    k, sizes = np.arange(len(rows)), np.array([row.semi_axes_mm for row in rows])
    for own, name, mark in zip(sizes.T, SEMI_AXES, MARKS, strict=True):
        axes.plot(k, own, f"{mark}-", color=hexadecimal(STIFFNESS), markersize=3.4, label=name)
    axes.set_xticks(k, [short(row.label, 8) for row in rows], rotation=45)
    axes.set(xlabel="pose", ylabel=f"moved by {force:,.0f} N [mm]", ylim=(0, 1.6 * sizes.max() or 1.0))
    axes.set_title("Semi-axes")
    axes.legend(frameon=False, fontsize=MIN_LETTER_SIZE, loc="upper center", ncols=1)
    quiet(axes)
