"""Error by number of poses, what hides behind what, and what a mixed campaign gains."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.errors import Array
from testbench.studies.absolute_calibration.report import AbsoluteCalibrationReport
from testbench.studies.absolute_calibration.settings import (
    ALL,
    ALL_LS,
    CHOSEN,
    GEOMETRY,
    INCUMBENT,
    JOINTS_ONLY,
    NO_GEARS,
    REAL,
    WITH_GEARS,
    WITH_LINKS,
)
from testbench.studies.absolute_calibration.tables import ERROR, POSES
from testbench.trials.spread import spans
from testbench.views.colours import (
    CHOICE,
    GCO,
    GREY,
    JOINTS,
    JOINTS_PRIOR,
    LEAST_SQUARES,
    LOAD,
    Look,
    hexadecimal,
    look,
)
from testbench.views.figure import SMALL, SOFT, Line, body, draw_line, key, log_ticks, page, quiet, say
from testbench.views.gains import beside

LOOKS = {
    GEOMETRY: Look(GREY, 0, prior=False),
    INCUMBENT: Look(JOINTS, 1, prior=False),
    WITH_GEARS: Look(JOINTS_PRIOR, 2, prior=False),
    WITH_LINKS: look("ALL153", "psd", prior=True),
    ALL_LS: Look(LEAST_SQUARES, 3, prior=True),
    ALL: Look(GCO, 4, prior=True),
    CHOSEN: CHOICE,
}
HIDDEN = {REAL: "all", NO_GEARS: "no joint\nerrors", JOINTS_ONLY: "rigid\nlinks"}
"""True arms by what they have, on the axis."""
WIDTH = 0.16  #: Of a bar, over the distance of groups.


def curves(report: AbsoluteCalibrationReport) -> Figure:
    """A column an arm: error by poses, compliance of joint 2 by what is left out, error by campaign."""
    count = len(report.arms)
    figure = page(13.0)
    part = body(figure)
    rows = part.subplots(3, count, squeeze=False, height_ratios=[1.3, 1, 1])
    for row, draw in zip(rows, (_by_poses, _hidden, _campaigns), strict=True):
        for axes, arm in zip(row, report.arms, strict=True):
            draw(axes, report, arm)
    left, more = (row[0].get_legend_handles_labels() for row in rows[:2])
    known = dict(zip(left[1], left[0], strict=True)) | {
        label: handle for handle, label in zip(*more, strict=True) if label not in left[1]
    }
    key(part, (list(known.values()), list(known)), columns=3)
    say(
        figure,
        f"{report.featured} poses, error where nothing was measured: "
        + "; ".join(f"{g.arm} {beside({'joint springs': g.springs})}" for g in report.gains),
        f"RMS errors, {report.dataset.sigma_um:g} um a reading. Marks: medians; band and lines: "
        f"{spans(row.error_mm for row in report.campaigns) or 'none'}; {report.trials} trials, "
        f"{count} arms in turn. Bars: RMS in the middle row, medians below; dashes: "
        "medians. Compliances: of joint 2, beside the true one.",
    )
    return figure


def _by_poses(axes: Axes, report: AbsoluteCalibrationReport, arm: str) -> None:
    own = [row for row in report.models if row.arm == arm]
    for name in dict.fromkeys(row.name for row in own):
        some = [row for row in own if row.name == name]
        draw_line(axes, POSES, ERROR, Line(some, LOOKS[name], name, band=name == CHOSEN))
    best = sorted((row for row in own if row.name == ALL), key=lambda row: row.poses)
    at = [row.poses for row in best]
    axes.plot(at, [row.optimum_mm.median for row in best], ":", color="black", label="noise-only optimum")
    log_ticks(axes, "y", *axes.dataLim.intervaly)
    axes.set_xscale("log")
    axes.set_xticks(at, [str(n) for n in at])
    axes.set_xticks([], minor=True)
    axes.set(xlabel="poses measured", ylabel="RMS error, own weight [mm]")
    axes.set_title(f"{arm}: error where nothing was measured", fontsize="medium")
    quiet(axes)


def _hidden(axes: Axes, report: AbsoluteCalibrationReport, arm: str) -> None:
    """Bars of root mean square, a line at the median."""
    models = [INCUMBENT, WITH_GEARS, WITH_LINKS, ALL]
    for k, model in enumerate(models):
        rows = [report.hidden(arm, true, model) for true in HIDDEN]
        at: Array = np.arange(len(rows)) + np.float64((k - 1.5) * WIDTH)
        _bars(axes, at, [100 * row.off_2 for row in rows], model)
        axes.plot(at, [100 * row.bias_2 for row in rows], "_", color="black", markersize=9)
    axes.axhline(0, color=SOFT, linewidth=0.8)
    axes.set_xticks(range(len(HIDDEN)), list(HIDDEN.values()))
    axes.set(xlabel="what the true arm has", ylabel="compliance off [%]")
    axes.set_title(f"{arm}: what hides in a compliance", fontsize="medium")
    quiet(axes)


def _bars(axes: Axes, at: Array, heights: Sequence[float], model: str) -> None:
    own = LOOKS[model]
    hatch = "//" if model == WITH_LINKS else ".." if model == WITH_GEARS else ""
    axes.bar(at, heights, WIDTH, color=own.hex, hatch=hatch, edgecolor="white", label=model)


def _campaigns(axes: Axes, report: AbsoluteCalibrationReport, arm: str) -> None:
    rows = [row for row in report.campaigns if (row.arm, row.model) == (arm, ALL)]
    for offset, quantity, colour, hatch, label in (
        (-0.18, "error_mm", GCO, "", "own weight"),
        (0.18, "loaded_mm", LOAD, "//", "payload"),
    ):
        heights = [getattr(row, quantity).median for row in rows]
        at = np.arange(len(rows)) + offset
        axes.bar(at, heights, 0.34, color=hexadecimal(colour), hatch=hatch, edgecolor="white", label=label)
        ends = [getattr(row, quantity).ends for row in rows]
        axes.vlines(at, *np.transpose(ends), color=SOFT)
    axes.set_xticks(range(len(rows)), [f"{row.campaign}\n{row.poses} poses" for row in rows])
    axes.set(ylabel="RMS error [mm]")
    axes.set_title(f"{arm}: {report.featured} readings, all errors on", fontsize="medium")
    axes.legend(frameon=False, fontsize=SMALL, loc="upper left", ncols=2)
    axes.margins(y=0.25)
    quiet(axes)
