"""Figure of a corrected program: how far off before and after, where, and what the joints do about it."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator

from testbench.bench.compensate import CorrectedProgram
from testbench.bench.compensate_report import CompensationReport
from testbench.errors import Array
from testbench.views.colours import GREENS, MEASURED, hexadecimal
from testbench.views.figure import SOFT, quiet

BEFORE, AFTER = hexadecimal(MEASURED), hexadecimal(GREENS[0])
SHARE = 0.12  #: Longest error as it is drawn, over the size of the path [1].
ROUND = (1, 2, 5)  #: Steps of a magnification.
MARKED = 60  #: Points up to which each has a dot.


def overview(found: CorrectedProgram, report: CompensationReport) -> Figure:
    """Errors along the program, the path from its broad side, corrections of the joints."""
    figure = Figure(figsize=(16, 5.6), layout="constrained")
    grid = figure.add_gridspec(1, 3, width_ratios=(1.1, 1, 1))
    left, centre, right = (figure.add_subfigure(grid[0, k]) for k in range(3))
    _errors(left.subplots(), found)
    _path(centre.subplots(), found)
    _joints(right, found)
    half = report.half_95_mm
    after = f"within {half.max:.3f} mm (95 %)" if half else "not bounded everywhere"
    figure.suptitle(
        f"{report.program}: {report.before_mm.max:.2f} mm off at most as programmed, corrected {after}",
        fontsize="large",
    )
    return figure


def magnified(before: Array, size: float) -> float:
    """How many times errors are drawn as large, so that the largest shows beside a path of this size [m]."""
    largest = float(np.linalg.norm(before, axis=1).max()) or 1e-3
    wanted = SHARE * size / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (*ROUND, 10) if step * power <= wanted))


def _errors(axes: Axes, found: CorrectedProgram) -> None:
    """Without correction, and the bound of what is left with it."""
    own, at = found.found, np.arange(1, found.program.points + 1)
    style = "o-" if len(at) <= MARKED else "-"
    before, half = 1e3 * np.linalg.norm(own.before, axis=1), 1e3 * own.half.max(axis=1)
    axes.plot(at, before, style, color=BEFORE, markersize=3, linewidth=1.2, label="as programmed")
    axes.fill_between(at, 0, half, color=AFTER, alpha=0.35, linewidth=0, label="corrected: 95 % interval")
    bad = ~own.corrected
    if bad.any():
        axes.plot(at[bad], before[bad], "x", color="#404040", markersize=9, label="not corrected")
    axes.set(xlabel="point", ylabel="error of the loaded tool [mm]", title="How far off", ylim=(0, None))
    axes.legend(frameon=False)
    quiet(axes)


def _path(axes: Axes, found: CorrectedProgram) -> None:
    """The path as seen along its least extent, errors magnified."""
    own = found.found
    asked = own.target.position
    centred = asked - asked.mean(axis=0)
    size = float(np.linalg.norm(np.ptp(asked, axis=0))) or 0.1
    scale = magnified(own.before, size)
    across, up = _plane(centred)
    names = [f"{_axis(v)} [m]" for v in (across, up)]
    off = asked + scale * own.before
    for path, colour, width, label in (
        (off, BEFORE, 1.2, f"as programmed, error x {scale:g}"),
        (asked + scale * own.after, AFTER, 3.5, f"corrected, by the model, x {scale:g}"),
        (asked, SOFT, 1.0, "asked"),
    ):
        axes.plot(path @ across, path @ up, color=colour, linewidth=width, label=label)
    axes.set(xlabel=names[0], ylabel=names[1], title="Where")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.legend(frameon=False, loc="upper left", fontsize="small")
    quiet(axes)


def _plane(centred: Array) -> tuple[Array, Array]:
    """The two world axes along which a path is longest, in their order."""
    longest = np.sort(np.argsort(np.ptp(centred, axis=0))[1:])
    return np.eye(3)[longest[0]], np.eye(3)[longest[1]]


def _axis(v: Array) -> str:
    return "xyz"[int(np.abs(v).argmax())]


def _joints(figure: SubFigure, found: CorrectedProgram) -> None:
    """Corrections along the program, a strip a joint."""
    own, arm = found.found, found.model.arm
    at, moved = np.arange(1, found.program.points + 1), own.q - own.start
    strips = figure.subplots(arm.n_joints, 1, sharex=True, squeeze=False)[:, 0]
    for k, (axes, joint) in enumerate(zip(strips, arm.joints, strict=True)):
        axes.plot(at, joint.shown * moved[:, k], color=AFTER, linewidth=1.4)
        axes.axhline(0, color=SOFT, linewidth=0.6)
        axes.set_ylabel(f"{joint.name}\n[{joint.shown_unit}]", rotation=0, ha="right", va="center")
        axes.yaxis.set_major_locator(MaxNLocator(2))
        quiet(axes)
    strips[0].set_title("Corrections of the joints")
    strips[-1].set_xlabel("point")
