"""Figure of section 5.2: errors of the five models under both truths, the paper's beside, and the order m."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.views.figures import GREEN, GREY, ORANGE, PURPLE
from testbench.views.report import Report, middle


def six_dof_arm(report: Report, file: Path) -> None:
    """Errors of every model against readings, under both truths; F_M against the order m."""
    figure = Figure(figsize=(13, 4.6), layout="constrained")
    left, centre, right = figure.subplots(1, 3, width_ratios=(1, 1, 1))
    _errors(left, report["models"], "linear truth, as in the paper")
    _errors(centre, report["nonlinear"]["models"], "MuJoCo's non-linear truth")
    left.set_ylabel("95 % error on check runs, against readings [mm]")
    for axes in (left, centre):
        axes.set_ylim(0.03, 1.0)
    left.plot([], [], "D", color=GREY, markeredgecolor="white", markersize=8, label="paper")
    left.legend(frameon=False, fontsize="small", loc="upper left")
    _order(right, report["order"])
    seeds = report["seed"]
    spread = "" if isinstance(seeds, int) else f"; median and 5 to 95 % of {len(seeds)} seeds"
    figure.suptitle(
        f"Section 5.2 on {report['arm']}: least squares orange, GCO green{spread}", fontsize="medium"
    )
    figure.savefig(file, dpi=120)


def _errors(axes: Axes, models: list[dict[str, Any]], title: str) -> None:
    x = np.arange(len(models))
    values = [m["readings"]["p95_mm"] for m in models]
    height = np.array([middle(v) for v in values])
    colours = [GREEN if m["name"].startswith("MGCO") else ORANGE for m in models]
    axes.bar(x, height, color=colours, width=0.6)
    ends = np.array([(v["p05"], v["p95"]) if isinstance(v, dict) else (v, v) for v in values]).T
    axes.errorbar(x, height, yerr=np.abs(ends - height), fmt="none", color=GREY, capsize=4)
    if title.startswith("linear"):
        known = [(m["paper"] or {}).get("readings_p95_mm", np.nan) for m in models]
        axes.plot(x, known, "D", color=GREY, markersize=8, markeredgecolor="white")
    names = [f"{m['name']}\n{h:.3f}" for m, h in zip(models, height, strict=True)]
    axes.set_xticks(x, names, fontsize="small")
    axes.set_yscale("log")
    axes.set_title(title, fontsize="medium")
    axes.spines[["top", "right"]].set_visible(False)


def _order(axes: Axes, order: Report) -> None:
    for name, shade in (("MGCO69", GREEN), ("MGCO56", PURPLE)):
        rows = order[name]
        error = [middle(row["check"]["p95_mm"]) for row in rows]
        axes.plot([row["m"] for row in rows], error, "o-", color=shade, label=f"{name}, F_M above each point")
        for row, y in zip(rows, error, strict=True):
            words = f"{middle(row['f_m']):.3g}"
            place = (row["m"], 1.12 * y)
            axes.text(*place, words, color=shade, fontsize="small", ha="center", va="bottom")
    axes.set_yscale("log")
    axes.set_ylim(0.02, 1.6 * axes.dataLim.ymax)
    axes.set_xlabel("order m of the vector space (Eq. 16)")
    axes.set_ylabel("95 % error on check runs, against the truth [mm]")
    axes.set_title("order m, linear truth", fontsize="medium")
    axes.legend(frameon=False, fontsize="small", loc="upper right")
    axes.spines[["top", "right"]].set_visible(False)
