"""Error by number of poses, what hides behind what, and what a mixed campaign gains."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.errors import Array
from testbench.report.columns import columns
from testbench.report.table import Row, find
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
HATCHES = {INCUMBENT: "", WITH_GEARS: "..", WITH_LINKS: "//", ALL: ""}  #: Of models whose springs are shown.
WIDTH = 0.16  #: Of a bar, over the distance of groups.


def curves(f: Row) -> Figure:
    """A column an arm: error by poses, compliance of joint 2 by what is left out, error by campaign."""
    swept = len({row.poses for row in f.models}) > 1
    figure = page(13.0 if swept else 9.0)
    part = body(figure)
    draws = {_by_poses: 1.3, _hidden: 1.0, _campaigns: 1.0} if swept else {_hidden: 1.0, _campaigns: 1.0}
    panes = part.subplots(len(draws), len(f.arms), squeeze=False, height_ratios=[*draws.values()])
    for row, draw in zip(panes, draws, strict=True):
        for axes, arm in zip(row, f.arms, strict=True):
            draw(axes, f, arm)
            quiet(axes)
    shared = [own for row in panes[:-1] for own in zip(*row[0].get_legend_handles_labels(), strict=True)]
    known = {label: handle for handle, label in reversed(shared)}  # of two the upper pane's
    known = {label: known[label] for _, label in shared}
    key(part, (list(known.values()), list(known)), columns=3)
    lines = spans(row.error_mm for row in f.campaigns)
    say(
        figure,
        f"{f.featured} poses, error where nothing was measured: "
        + "; ".join(f"{g.arm} {beside({'joint springs': g.springs})}" for g in f.gains),
        f"RMS errors, {f.dataset.sigma_um:g} um a reading; {f.trials} trials, {len(f.arms)} arms in turn. "
        "Marks, dashes, bars of errors: medians; bars of compliances: RMS, of joint 2, beside the true one."
        + f" Band and lines: {lines}."
        * bool(lines),
    )
    return figure


def _by_poses(axes: Axes, f: Row, arm: str) -> None:
    own, (poses, error) = [row for row in f.models if row.arm == arm], columns("poses error_mm")
    for name in dict.fromkeys(row.name for row in own):
        some = [row for row in own if row.name == name]
        draw_line(axes, poses, error, Line(some, LOOKS[name], name, band=name == CHOSEN))
    best = {row.poses: row.optimum_mm.median for row in own if row.name == ALL}
    at = sorted(best)
    axes.plot(at, [best[n] for n in at], ":", color="black", label="noise-only optimum")
    log_ticks(axes, "y", *axes.dataLim.intervaly)
    axes.set_xscale("log")
    axes.set_xticks(at, [str(n) for n in at])
    axes.set_xticks([], minor=True)
    axes.set(xlabel="poses measured", ylabel="RMS error, own weight [mm]")
    axes.set_title(f"{arm}: error where nothing was measured", fontsize="medium")


def _hidden(axes: Axes, f: Row, arm: str) -> None:
    """Bars of root mean square, a line at the median."""
    for k, (model, hatch) in enumerate(HATCHES.items()):
        rows = [find(f.hiding, arm=arm, true_arm=true, name=model) for true in HIDDEN]
        at: Array = np.arange(len(rows)) + np.float64((k - 1.5) * WIDTH)
        _bars(axes, at, [row.off_2_percent for row in rows], (WIDTH, LOOKS[model].hex, hatch, model))
        axes.plot(at, [row.bias_2_percent for row in rows], "_", color="black", markersize=9)
    axes.axhline(0, color=SOFT, linewidth=0.8)
    axes.set_xticks(range(len(HIDDEN)), list(HIDDEN.values()))
    axes.set(xlabel="what the true arm has", ylabel="compliance off [%]")
    axes.set_title(f"{arm}: what hides in a compliance", fontsize="medium")


def _campaigns(axes: Axes, f: Row, arm: str) -> None:
    rows = [row for row in f.campaigns if (row.arm, row.name) == (arm, ALL)]
    for offset, quantity, colour, hatch, label in (
        (-0.18, "error_mm", GCO, "", "own weight"),
        (0.18, "loaded_mm", LOAD, "//", "payload"),
    ):
        at: Array = np.arange(len(rows)) + np.float64(offset)
        heights = [row[quantity].median for row in rows]
        _bars(axes, at, heights, (0.34, hexadecimal(colour), hatch, label))
        axes.vlines(at, *np.transpose([row[quantity].ends for row in rows]), color=SOFT)
    axes.set_xticks(range(len(rows)), [f"{row.campaign}\n{row.poses} poses" for row in rows])
    axes.set(ylabel="RMS error [mm]")
    axes.set_title(f"{arm}: {f.featured} readings, all errors on", fontsize="medium")
    axes.legend(frameon=False, fontsize=SMALL, loc="upper left", ncols=2)
    axes.margins(y=0.25)


def _bars(axes: Axes, at: Array, heights: Sequence[float], style: tuple[float, str, str, str]) -> None:
    """Bars of a width, colour, hatch and label."""
    width, colour, hatch, label = style
    axes.bar(at, heights, width, color=colour, hatch=hatch, edgecolor="white", label=label)
