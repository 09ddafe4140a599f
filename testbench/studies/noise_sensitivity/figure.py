"""Figures of noise and model error: error against noise, instruments, disturbances beside the noise."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.views.figures import GREEN, GREY, ORANGE, PURPLE
from testbench.views.report import Report

SKY, BROWN, OLIVE, TEAL = "#56B4E9", "#B07A48", "#8A8F2A", "#4896A0"
LINES: dict[str, tuple[str, str]] = {
    "MLS32": (BROWN, "v:"),
    "MLS56": (ORANGE, "o-"),
    "MGCO47": (OLIVE, "^-"),
    "MGCO56": (GREEN, "o-"),
    "MGCO68": (PURPLE, "s-"),
    "MGCO69": (PURPLE, "s-"),
    "MGCO147": (SKY, "D-"),
    "MGCO56 + prior": (GREEN, "o--"),
    "MGCO68 + prior": (PURPLE, "s--"),
    "MGCO69 + prior": (PURPLE, "s--"),
}
"""Colour and style of every model; dashed with a prior."""
INSTRUMENTS: dict[str, tuple[str, str]] = {
    "flat weights": (ORANGE, "s--"),
    "weighted": (GREEN, "o-"),
    "weighted, 3 readings averaged": (TEAL, "^-"),
    "weighted, maximum errors": (OLIVE, "^:"),
    "weighted, frame drifts": (PURPLE, "D:"),
    "weighted, 10 % of targets lost": (SKY, "v-"),
    "weighted, 5 % misread by 1 mm": (BROWN, "P:"),
}


def sensitivity(report: Report, file: Path) -> None:
    """Error against noise for both arms, and against distance for the instruments.

    Args:
        report: report.json of the study of noise.
        file: PNG to write.
    """
    figure = Figure(figsize=(15, 5), layout="constrained")
    left, centre, right = figure.subplots(1, 3)
    for axes, part, words in (
        (left, "six_dof", "108 runs of section 5.2, full pose"),
        (centre, "gravity", "KR 500 under its payload, 8 poses"),
    ):
        _lines(axes, report["sweeps"][part], "sigma_um", LINES)
        axes.set_xlabel("noise of one reading along one axis [um]")
        axes.set_title(words, fontsize="medium")
    left.set_ylabel("RMS error of predicted deflection [um]")
    rows = [c for c in report["instruments"] if c["part"] == "instrument_linear"]
    _lines(right, rows, "x", INSTRUMENTS)
    flat = next(c for c in rows if c["model"] == "flat 50 um")["rms_um"]["median"]
    right.axhline(flat, color=GREY, linewidth=0.8)
    at = (1, flat)
    right.annotate("flat 50 um", at, xycoords=("axes fraction", "data"), ha="right", va="bottom", color=GREY)
    right.set_xlabel("distance of the laser tracker [m]")
    right.set_title("laser tracker, MGCO56 with prior, linear truth", fontsize="medium")
    trials = report["trials"]
    figure.suptitle(
        f"What noise costs: medians, bands 5 to 95 %, of {trials['six_dof']}, {trials['gravity']} and "
        f"{trials['instrument_linear']} trials",
        fontsize="medium",
    )
    figure.savefig(file, dpi=120)


def _lines(axes: Axes, rows: list[dict[str, Any]], key: str, looks: dict[str, tuple[str, str]]) -> None:
    for name, (shade, style) in looks.items():
        own = sorted((row for row in rows if row["model"] == name), key=lambda row: row[key])
        if not own:
            continue
        x = [row[key] for row in own]
        axes.plot(x, [row["rms_um"]["median"] for row in own], style, color=shade, label=name, markersize=5)
        low, high = ([row["rms_um"][end] for row in own] for end in ("p05", "p95"))
        axes.fill_between(x, low, high, color=shade, alpha=0.08, linewidth=0)
    axes.set_yscale("symlog", linthresh=1)
    wide = axes.dataLim.ymax > 300 * max(axes.dataLim.ymin, 1)
    steps = (1, 3) if wide else (1, 2, 5)
    ticks = [0, *(step * 10**k for k in range(5) for step in steps)]
    ticks = [tick for tick in ticks if tick <= axes.dataLim.ymax]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_ylim(bottom=min(max(0.7 * axes.dataLim.ymin, 0), 20))
    axes.legend(frameon=False, fontsize="x-small", ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.14))
    axes.spines[["top", "right"]].set_visible(False)


def disturbances(report: Report, file: Path) -> None:
    """What every disturbance costs, without noise and with it.

    Args:
        report: report.json of the study of model error.
        file: PNG to write.
    """
    figure = Figure(figsize=(14, 6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    names = list(reversed(report["sizes"]))
    for axes, noise, words in (
        (left, 0.0, "without noise"),
        (right, report["sigma_um"], f"with noise of {report['sigma_um']:g} um"),
    ):
        _bars(axes, report, names, noise)
        axes.set_title(words, fontsize="medium")
        axes.set_xlabel("RMS error of predicted deflection [um]")
    left.set_yticks(range(len(names)), names)
    handles = left.get_legend_handles_labels()
    figure.legend(*handles, frameon=False, loc="outside lower center", ncols=5)
    figure.suptitle(
        f"{report['arm']}: each disturbance alone and all together, {report['trials']} trials: median, 5 "
        f"to 95 %",
        fontsize="medium",
    )
    figure.savefig(file, dpi=120)


def _bars(axes: Axes, report: Report, names: list[str], noise: float) -> None:
    models = list(dict.fromkeys(c["model"] for c in report["cells"]))
    for j, model in enumerate(models):
        own = {
            c["case"]: c["rms_um"]
            for c in report["cells"]
            if c["model"] == model and abs(c["noise_um"] - noise) < 1e-9
        }
        shade, style = LINES[model]
        filled = shade if style.endswith("--") else "white"
        y = np.arange(len(names)) + 0.14 * (len(models) / 2 - j)
        for place, name in zip(y, names, strict=True):
            axes.plot([own[name]["p05"], own[name]["p95"]], [place, place], color=shade, alpha=0.5)
        axes.plot(
            [own[name]["median"] for name in names],
            y,
            style[0],
            color=shade,
            markerfacecolor=filled,
            label=model,
            markersize=5,
        )
    axes.set_xscale("log")
    ticks = [tick for tick in (10, 30, 100, 300, 1000, 3000, 10_000) if tick <= axes.dataLim.xmax]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)
    axes.grid(axis="y", alpha=0.2)
    axes.spines[["top", "right"]].set_visible(False)
