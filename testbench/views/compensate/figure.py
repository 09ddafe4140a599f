"""Figure of a corrected program: how far off before and after, where, and what the joints do about it."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator

from testbench.bench.compensate import CorrectedProgram
from testbench.bench.compensate_report import CompensationReport
from testbench.errors import Array
from testbench.views.colours import GCO, MEASURED, hexadecimal
from testbench.views.figure import SMALL, SOFT, page, quiet, say
from testbench.views.magnified import round_scale

BEFORE, AFTER = hexadecimal(MEASURED), hexadecimal(GCO)
SHARE = 0.12  #: Longest error as it is drawn, over the size of the path [1].
MARKED = 40  #: Points up to which each has a dot.
ARROWS = 25  #: Errors that are drawn as arrows.


def overview(found: CorrectedProgram, report: CompensationReport) -> Figure:
    """Errors along the program, the path from its broad side, corrections of the joints."""
    figure = page(9.2)
    above, below = figure.subfigures(2, 1, height_ratios=(1.2, 1))  # type: ignore[misc]  # stubs: one or several
    left, right = above.subplots(1, 2)
    _errors(left, found)
    _path(right, found)
    _joints(below, found)
    half = report.half_95_mm
    after = f"within {half.max:.3f} mm (95 %)" if half else "not bounded everywhere"
    say(
        figure,
        f"{report.verdict} {report.program}: {report.before_mm.max:.2f} mm off at most as programmed, "
        f"corrected {after}".strip(),
        "Errors of the loaded tool, by the model. Green: corrected; intervals are of the widest axis, 95 %, "
        "bars on the path those along its axes.",
    )
    return figure


def magnified(before: Array, size: float) -> float:
    """How many times errors are drawn as large, so that the largest shows beside a path of this size [m]."""
    largest = float(np.linalg.norm(before, axis=1).max()) or 1e-3
    return round_scale(SHARE * size, largest)


def _errors(axes: Axes, found: CorrectedProgram) -> None:
    """Without correction, and the bound of what is left with it."""
    own, at = found.found, np.arange(1, found.program.points + 1)
    few = len(at) <= MARKED
    before, half = 1e3 * np.linalg.norm(own.before, axis=1), 1e3 * own.half.max(axis=1)
    axes.plot(at, before, "o-" if few else "-", color=BEFORE, markersize=4, label="as programmed")
    label = "corrected: 95 % interval"
    if few:
        axes.bar(at, np.where(np.isfinite(half), half, 0), width=0.5, color=AFTER, alpha=0.5, label=label)
    else:
        axes.fill_between(at, 0, half, color=AFTER, alpha=0.35, linewidth=0, label=label)
    bad = ~own.corrected
    if bad.any():
        axes.plot(at[bad], before[bad], "x", color="#404040", markersize=9, label="not corrected")
    axes.set(xlabel="point", ylabel="error of the loaded tool [mm]", ylim=(0, None))
    axes.set_title("How far off", fontsize="medium")
    _below(axes)
    quiet(axes)


def _below(axes: Axes) -> None:
    """The legend of some axes, below them."""
    axes.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=1, fontsize=SMALL)


def _path(axes: Axes, found: CorrectedProgram) -> None:
    """The path as seen along its least extent, errors magnified."""
    own = found.found
    asked = own.target.position
    size = float(np.linalg.norm(np.ptp(asked, axis=0))) or 0.1
    scale = magnified(own.before, size)
    across, up = _plane(asked - asked.mean(axis=0))
    style = "o-" if len(asked) <= MARKED else "-"
    off = asked + scale * own.before
    some = np.unique(np.linspace(0, len(asked) - 1, min(ARROWS, len(asked))).round().astype(int))
    ways = off[some] - asked[some]
    axes.quiver(
        *(asked[some] @ v for v in (across, up)),
        *(ways @ v for v in (across, up)),
        angles="xy", scale_units="xy", scale=1, width=0.004, color=BEFORE, alpha=0.5,
    )  # fmt: skip
    spans = scale * np.where(np.isfinite(own.half[some]), own.half[some], np.nan)
    axes.errorbar(
        asked[some] @ across, asked[some] @ up, xerr=spans @ across, yerr=spans @ up, fmt="none",
        ecolor=AFTER, alpha=0.5, elinewidth=1, capsize=3, label=f"where it may be, 95 %, x {scale:g}",
    )  # fmt: skip
    for path, colour, width, label in (
        (asked, AFTER, 2.5, "asked, and corrected by the model"),
        (off, BEFORE, 1.0, f"as programmed, error x {scale:g}"),
    ):
        axes.plot(path @ across, path @ up, style, color=colour, linewidth=width, markersize=3, label=label)
    axes.set(xlabel=f"{_axis(across)} [m]", ylabel=f"{_axis(up)} [m]")
    axes.set_title("Where", fontsize="medium")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1)
    _below(axes)
    quiet(axes)


def _plane(centred: Array) -> tuple[Array, Array]:
    """The two world axes along which a path is longest, in their order."""
    longest = np.sort(np.argsort(np.ptp(centred, axis=0))[1:])
    return np.eye(3)[longest[0]], np.eye(3)[longest[1]]


def _axis(v: Array) -> str:
    return "xyz"[int(np.abs(v).argmax())]


def _joints(figure: SubFigure, found: CorrectedProgram) -> None:
    """Corrections along the program, a strip a joint, of one scale for all of a unit."""
    own, arm = found.found, found.model.arm
    at = np.arange(1, found.program.points + 1)
    shown = np.array([joint.shown for joint in arm.joints])
    moved, units = shown * (own.q - own.start), [joint.shown_unit for joint in arm.joints]
    down = -(-arm.n_joints // 2)
    grid = figure.subplots(down, 2, sharex=True, squeeze=False)
    strips = grid.T.flat[: arm.n_joints]
    for k, (axes, joint) in enumerate(zip(strips, arm.joints, strict=True)):
        axes.plot(
            at, moved[:, k], "o-" if len(at) <= MARKED else "-", color=AFTER, linewidth=1.4, markersize=3
        )
        axes.axhline(0, color=SOFT, linewidth=0.6)
        most = 1.15 * np.abs(moved[:, [unit == units[k] for unit in units]]).max() or 1.0
        axes.set_ylim(-most, most)
        axes.set_ylabel(f"{joint.name}\n[{joint.shown_unit}]", rotation=0, ha="right", va="center")
        axes.yaxis.set_major_locator(MaxNLocator(2))
        quiet(axes)
    for axes in grid.T.flat[arm.n_joints :]:
        axes.axis("off")
    figure.suptitle("Corrections of the joints", fontsize="medium")
    for axes in grid[-1]:
        axes.set_xlabel("point")
