"""Error against noise, and against the distance of the instrument."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.bench.baselines import JOINTS
from testbench.report.campaigns import RMS, existing
from testbench.report.columns import columns
from testbench.report.table import Row
from testbench.studies.noise_sensitivity.instruments import FLAT, WEIGHTED
from testbench.trials.spread import ends, grouped, middle, span
from testbench.views.colours import GCO, GREY, SERIES, Look, look
from testbench.views.figure import SMALL, SOFT, Line, draw_line, page, quiet, say
from testbench.views.schema import Column

SIGMA, DISTANCE = columns("sigma_um distance_m")
SHADES = (GCO, GREY, *SERIES[1:])
"""Of the instruments, which are all read by one model; the second has flat weights."""
BANDS = (JOINTS, "MLS32", "MLS56", "MGCO56", "ALL153 + prior")
"""Models whose spread is drawn: all of them would cover one another."""
SAME = 1e-4  #: Share by which errors may differ and be one line.
LINEAR_UM = 1.0  #: Errors below are drawn on a linear scale: without noise some are exact.


def sensitivity(f: Row, parts: Mapping[str, str], answer: str) -> Figure:
    """Error against noise for both arms, and against distance for the instruments.

    Args:
        f: Numbers of the report.
        parts: Of the sweeps, in words.
        answer: The title.
    """
    figure = page(10.5)
    panes = figure.subplot_mosaic("ab;cc", height_ratios=[1.3, 1])
    for axes, (part, words) in zip((panes["a"], panes["b"]), parts.items(), strict=True):
        for name, own in _alike(f.sweeps[part]).items():
            first = own[0]
            shade = look(first.structure, first.constraint, first.prior)
            draw_line(axes, SIGMA, RMS, Line(own, shade, name, band=first.name in BANDS))
        axes.set_title(words, fontsize="medium")
        _finish(axes, SIGMA, f.sweeps[part])
    _instruments(panes["c"], [row for row in f.instruments if row.truth == "linear"])
    counts = [f.trials[part] for part in (*parts, "instrument")]
    say(
        figure,
        answer,
        f"RMS errors over the workspace. Marks: medians of {', '.join(map(str, counts))} trials; bands, of "
        f"some: {span(min(counts))} of them. "
        f"Filled and dashed: with a prior. Below {LINEAR_UM:g} um the axis is linear.",
    )
    return figure


def _instruments(axes: Axes, rows: Sequence[Row]) -> None:
    """A line an instrument over its distance; the one that stands nowhere is a level."""
    placed = grouped([row for row in rows if row.distance_m > 0], lambda row: row.instrument)
    for k, (name, distances) in enumerate(placed.items()):
        own = Look(SHADES[k], k, prior=False)
        draw_line(axes, DISTANCE, RMS, Line(distances, own, name, band=name == WEIGHTED))
    [flat] = [middle(row.rms_um) for row in rows if row.instrument == FLAT]
    axes.axhline(flat, color=SOFT, linewidth=0.8)
    axes.annotate(FLAT, (1, flat), xycoords=("axes fraction", "data"), ha="right", va="bottom", color=SOFT)
    axes.set_title("laser tracker, MGCO56 with prior, KR 500, linear truth", fontsize="medium")
    _finish(axes, DISTANCE, rows)
    stations = sorted({row.distance_m for row in rows} - {0.0})
    axes.set_xticks(stations, [f"{x:g}" for x in stations])


def _alike(levels: Sequence[Row]) -> dict[str, list[Row]]:
    """Models under their names; those that err alike at every noise are one line under the names of all."""
    found: list[tuple[list[str], list[Row]]] = []
    for name, own in grouped(existing(levels), lambda row: row.name).items():
        errors = [middle(row.rms_um) for row in own]
        same = [
            names
            for names, rows in found
            if np.allclose(errors, [middle(r.rms_um) for r in rows], rtol=SAME, atol=SAME * LINEAR_UM)
        ]
        if same:
            same[0].append(name)
        else:
            found.append(([name], own))
    return {" =\n".join(names): own for names, own in found}


def _finish(axes: Axes, x: Column, rows: Sequence[Row]) -> None:
    """Labels, legend and a logarithmic axis that goes down to no error at all."""
    axes.set_xlabel(f"{x.heading} [{x.unit}]")
    axes.set_ylabel(f"{RMS.heading} [{RMS.unit}]")
    axes.set_yscale("symlog", linthresh=LINEAR_UM)
    low = min(middle(row.rms_um) for row in rows)
    high = 1.2 * max(ends(row.rms_um)[1] for row in rows)
    steps = (1, 3) if high > 300 * max(low, LINEAR_UM) else (1, 2, 5)
    ticks = [0, *(tick for k in range(6) for tick in (step * 10**k for step in steps) if tick <= high)]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_yticks([], minor=True)
    axes.set_ylim(0 if low < LINEAR_UM else 0.7 * low, high)
    axes.legend(
        frameon=False,
        fontsize=SMALL,
        ncols=2,
        handlelength=3,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.14),
    )
    quiet(axes)
