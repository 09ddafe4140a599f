"""Figure of an identified model: which one, what it leaves, what the runs tell, how sure it is elsewhere."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from testbench.bench.baselines import JOINTS
from testbench.bench.explained import Explained, longest
from testbench.bench.rows import MM
from testbench.views.colours import MARKS, Look, look
from testbench.views.figure import SIZES, SMALL, SOFT, dots, log_ticks, page, quiet, say
from testbench.views.fits import COLUMNS
from testbench.views.identified.report import IdentifiedReport
from testbench.views.schema import Column, show

MANY = 60  #: Runs beyond which dots are small.
NAMED = 40  #: Most runs whose number stands on the axis.
TARGETS = 6  #: Targets that the legend names at most.
SHOWN = 24  #: Letters of a name on an axis.
LEAST_MM = 0.01  #: Where an axis of errors ends at least: below is rounding of exact data.
WIDE = 3.0  #: Largest over least error from which an axis is logarithmic [1].


def overview(made: Explained, report: IdentifiedReport) -> Figure:
    """Errors of all models, residuals of the one to take, its seen directions, its intervals."""
    figure = page(13.5)
    above, middle, below = figure.subfigures(3, 1, height_ratios=(1, 1, 1.15))  # type: ignore[misc]  # stubs: one or several
    models, seen = above.subplots(1, 2)
    _models(models, made)
    _residuals(middle.subplots(), made, report)
    _seen(seen, report, _look(made, report.recommended))
    _places(below.subplots(), below, report)
    own = report.taken
    check = f", {own.check.rms_mm:.3f} mm where held back" if own.check else ""
    sure = "" if own.half_width_mm is None else f"; its 95 % interval is \u00b1 {own.half_width_mm:.3f} mm"
    say(
        figure,
        f"{report.arm}: {report.recommended} fits to {own.fit.rms_mm:.3f} mm RMS{check}{sure}",
        "Bold: the model to take. Filled marks: with a prior. Per cent: of each compliance told by the "
        f"readings, beside a prior of {100 * report.seen.prior_uncertainty:.0f} %. Below: half widths of "
        "95 % intervals of the tool's deflection.",
    )
    return figure


def _look(made: Explained, name: str) -> Look:
    [model] = [m for m in made.found.fits.models if m.name == name]
    return look(model.structure, model.constraint, model.prior)


def _models(axes: Axes, made: Explained) -> None:
    """RMS error of every model, of the poses held back where there are any."""
    fits = made.found.fits
    key, words = ("check", "poses held back") if fits.models[0].check else ("identification", "runs fitted")
    column = Column(f"{key}.rms_mm", f"RMS error, {words}", "mm")
    dots(axes, fits.models, COLUMNS[0], column, [_look(made, m.name) for m in fits.models])
    low, high = axes.dataLim.intervalx.tolist()
    if high > WIDE * low > 0:
        log_ticks(axes, "x", low, high)
    else:
        axes.set_xlim(0, max(1.15 * high, LEAST_MM))
    for label, model in zip(axes.get_yticklabels(), fits.models, strict=True):
        label.set_fontweight("bold" if model.name == fits.recommended else "normal")
    axes.set_title("Models", fontsize="medium")


def _residuals(axes: Axes, made: Explained, report: IdentifiedReport) -> None:
    """What is left of every target in every run, over the order of the file."""
    data, rows = made.runs.every, report.residuals
    x, size = np.arange(data.runs), 7.0 if data.runs <= MANY else 3.0
    for k, row in enumerate(rows):
        if row.held_back:
            axes.axvspan(k - 0.5, k + 0.5, color="0.92", linewidth=0)
    own, left = _look(made, report.recommended), MM * np.linalg.norm(made.left[report.recommended], axis=2)
    for m, marker in enumerate(data.markers):
        at = data.seen[:, m]
        face = own.face
        shape = MARKS[m % len(MARKS)]
        label = marker[:SHOWN] if m < TARGETS else None
        axes.plot(
            x[at], left[at, m], shape, color=own.hex, markerfacecolor=face, markersize=size, label=label
        )
    top = max(report.noise_p95_mm, float(left.max()))
    rivals = [name for name in made.left if name.split(" ")[0] == JOINTS and name != report.recommended]
    for name in rivals[:1]:
        other = MM * longest(made.left[name])
        top = max(top, float(other.max()))
        look_of = _look(made, name)
        some = data.seen.any(axis=1)
        axes.plot(
            x[some], other[some], "_", color=look_of.hex, markersize=1.6 * size, label=f"{name}, worst target"
        )
    axes.axhline(
        report.noise_p95_mm,
        color=SOFT,
        linestyle="--",
        linewidth=1.2,
        label="95 % of pure noise, worst target",
    )
    axes.set_xlim(-0.5, data.runs - 0.5)
    axes.set_ylim(0, 1.3 * top)
    if data.runs <= NAMED:
        axes.set_xticks(x, [str(row.run) for row in rows], fontsize=SMALL)
        axes.set_xlabel("run")
    else:
        axes.set_xlabel("run, in the order of the file")
    axes.set_ylabel("residual [mm]")
    held = "; grey: held back" if any(row.held_back for row in rows) else ""
    axes.set_title(f"What {report.recommended} leaves, target by target{held}", fontsize="medium")
    axes.legend(frameon=False, fontsize=SMALL, ncols=5, loc="upper left")
    quiet(axes)


def _seen(axes: Axes, report: IdentifiedReport, own: Look) -> None:
    """How much of each link and joint the readings tell."""
    blocks = report.seen.blocks
    share = [100 * block.data_share for block in blocks]
    y = np.arange(len(blocks))
    axes.barh(y, 100, color="0.93", height=0.7)
    axes.barh(y, share, color=own.hex, height=0.7)
    names = [block.component[:SHOWN] for block in blocks]
    axes.set_yticks(y, [f"{name}  {x:.0f} %" for name, x in zip(names, share, strict=True)])
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    seen = report.seen
    axes.set_xlabel("told by the readings [%]")
    axes.set_title(f"What the runs tell: {seen.seen} of {seen.unknowns} directions", fontsize="medium")
    quiet(axes)


def _places(axes: Axes, figure: SubFigure, report: IdentifiedReport) -> None:
    """Half widths over reach and height; the worst is named."""
    found = report.map
    if found is None:
        axes.axis("off")
        axes.text(0.5, 0.5, "no map over the workspace", ha="center", transform=axes.transAxes, color=SOFT)
        return
    at, half = np.array(found.errors.position_m), found.errors.errors(report.recommended)
    reach, height = np.hypot(at[:, 0], at[:, 1]), at[:, 2]
    known = np.isfinite(half)
    order = np.flatnonzero(known)[np.argsort(half[known])]  # the widest in front
    axes.plot(reach[~known], height[~known], "o", color=SOFT, markerfacecolor="none", markersize=6)
    axes.set_xlabel("distance from the arm's vertical axis [m]")
    axes.set_ylabel("height [m]")
    quiet(axes)
    without = f"; open: no bound ({found.without_bound} of {found.places})" if found.without_bound else ""
    load = f"{found.force_N:.0f} N" + (f", {found.moment_Nm:.0f} N m" if found.moment_Nm else "")
    axes.set_title(f"How sure the tool's deflection is under {load}{without}", fontsize="medium")
    if found.worst is None:
        return
    shown = axes.scatter(reach[order], height[order], c=half[order], cmap=SIZES, s=45)
    figure.colorbar(shown, ax=axes, label="half width, 95 % [mm]")
    k = int(np.nanargmax(half))
    mark = "#202020"
    axes.plot(reach[k], height[k], "o", markersize=15, markerfacecolor="none", color=mark, markeredgewidth=2)
    side = -1 if reach[k] > reach.mean() else 1
    label = axes.annotate(
        f"worst {show(float(half[k]))} mm",
        (reach[k], height[k]),
        (side * 14, 0),
        textcoords="offset points",
        color=mark,
    )
    label.set(weight="bold", ha="left" if side > 0 else "right", va="center")
    label.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5})
