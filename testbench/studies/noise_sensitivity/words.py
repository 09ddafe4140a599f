"""The study of noise in words: tables, answers, report.md."""

from rich import box
from rich.table import Table

from testbench.studies.noise_sensitivity.summary import NEAR, PARTS
from testbench.studies.noise_sensitivity.trial import BY, DRIFT, LOST, MISREAD
from testbench.views.report import Report, show
from testbench.views.tables import grid

GAIN = 0.9
"""Error of the weighted fit over that with flat weights that is to be reached at NEAR."""


def title(report: Report) -> str:
    """What was done, in one line."""
    t = report["trials"]
    return (
        f"Noise of {report['sigmas_um'][0]:g} to {report['sigmas_um'][-1]:g} um a reading and axis: "
        f"{t['six_dof']} trials of {PARTS['six_dof']}, {t['gravity']} of {PARTS['gravity']}, "
        f"{t['instrument_linear']} of several instruments; the same random numbers at every level; "
        "medians (5 % to 95 %)"
    )


def table(report: Report, part: str) -> Table:
    """Median RMS error by model and level, for a terminal of 80 columns."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False, title=PARTS[part])
    shown.add_column("RMS error, um, at sigma", no_wrap=True)
    levels = report["sigmas_um"]
    for level in levels:
        shown.add_column(f"{level:g}", justify="right", no_wrap=True)
    for name in dict.fromkeys(row["model"] for row in report["sweeps"][part]):
        own = {r["sigma_um"]: r["rms_um"]["median"] for r in report["sweeps"][part] if r["model"] == name}
        shown.add_row(name, *(f"{_at(own, level):.0f}" for level in levels))
    return shown


def _at(own: dict[float, float], level: float) -> float:
    return own[min(own, key=lambda key: abs(key - level))]


def statements(report: Report) -> list[str]:
    """The answers, each with its numbers; the first one is the headline."""
    return [
        _headline(report),
        _prior(report),
        _paired(report),
        _conservative(report),
        _weights(report),
        _instruments(report),
    ]


def _headline(report: Report) -> str:
    parts = []
    for part, words in PARTS.items():
        slopes = report["slopes"][part]
        plain = {name: own for name, own in slopes.items() if "prior" not in name}
        best = min(plain, key=lambda name: plain[name]["um_per_um"])
        worst = max(plain, key=lambda name: plain[name]["um_per_um"])
        parts.append(
            f"{words}: {plain[best]['um_per_um']:.2f} um ({best}) to {plain[worst]['um_per_um']:.3g} um "
            f"({worst})"
        )
    return f"Error per micrometre of noise, no prior, at the largest noise: {'; '.join(parts)}."


def _prior(report: Report) -> str:
    words = []
    for part, about in PARTS.items():
        slopes = report["slopes"][part]
        for name in (n for n in slopes if "prior" in n):
            bare = slopes[name.split(" ")[0]]
            words.append(
                f"{name}, {about}: {slopes[name]['um_per_um']:.2f} um against {bare['um_per_um']:.3g} "
                f"without, and {slopes[name]['noise_free_um']:.0f} um without noise "
                f"({bare['noise_free_um']:.0f})"
            )
    return f"A prior twice wrong in scale and 30 % in shape: {'; '.join(words)}."


def _paired(report: Report) -> str:
    words = [
        f"{PARTS[row['part']]} at {row['sigma_um']:g} um {show(row['ratio'], '.2f')}, better in "
        f"{100 * row['better_in']:.0f} %"
        for row in report["gco_over_ls"]
    ]
    return f"MGCO56 over MLS56 on the same readings: {'; '.join(words)}."


def _conservative(report: Report) -> str:
    shares: dict[str, list[float]] = {}
    for part in PARTS:
        for row in report["sweeps"][part]:
            if row["sigma_um"] > 0:
                shares.setdefault("LS" if row["model"].startswith("MLS") else "GCO", []).append(
                    row["conservative"]
                )
    return (
        "Conservative, of all noisy fits: "
        + ", ".join(f"{kind} {100 * min(own):.0f} to {100 * max(own):.0f} %" for kind, own in shares.items())
        + "."
    )


def _weights(report: Report) -> str:
    words = []
    met = True
    for truth, rows in report["weighted_over_flat"].items():
        each = ", ".join(f"{row['ratio']:.2f} at {row['distance_m']:g} m" for row in rows)
        met = met and all(row["ratio"] <= GAIN for row in rows if row["distance_m"] == NEAR)
        words.append(f"{truth} truth {each}")
    return (
        f"Laser tracker, full covariance over flat weights: {'; '.join(words)} (aim {GAIN:g} at {NEAR:g} m"
        f"{'' if met else ': MISSED'})."
    )


def _instruments(report: Report) -> str:
    cells = {
        c["model"]: c["rms_um"]["median"]
        for c in report["instruments"]
        if c["part"] == "instrument_linear" and c["x"] in (0.0, NEAR)
    }
    words = ", ".join(f"{name} {value:.0f}" for name, value in cells.items())
    return (
        f"Instruments at {NEAR:g} m, MGCO56 with prior, linear truth, um: {words}. Drift "
        f"{1e6 * DRIFT.shift:g} um and {1e6 * DRIFT.turn:g} urad a run; {100 * LOST:.0f} % lost, "
        f"{100 * MISREAD:.0f} % misread by {1e3 * BY:g} mm, not looked for (identify --robust does)."
    )


def markdown(report: Report) -> str:
    """report.md."""
    first, *others = statements(report)
    lines = [f"# {report['scenario']}", "", f"{title(report)}.", "", f"**{first}**", ""]
    lines += [f"- {text}" for text in others]
    for part, words in PARTS.items():
        lines += ["", f"## {words}: RMS error, um", "", *_sweep(report, part, "rms_um")]
        lines += ["", f"## {words}: 95 % error, um", "", *_sweep(report, part, "p95_um")]
    lines += ["", "## Instruments, RMS error over the workspace, um", "", *_cells(report), ""]
    return "\n".join(lines)


def _sweep(report: Report, part: str, key: str) -> list[str]:
    rows = report["sweeps"][part]
    names, levels = (list(dict.fromkeys(row[k] for row in rows)) for k in ("model", "sigma_um"))
    cell = {(row["model"], row["sigma_um"]): show(row[key], ".1f") for row in rows}
    return grid(["sigma, um", *names], [[f"{x:g}", *(cell[name, x] for name in names)] for x in levels])


def _cells(report: Report) -> list[str]:
    rows = [
        [c["part"].removeprefix("instrument_"), c["model"], f"{c['x']:g}", show(c["rms_um"], ".1f")]
        for c in report["instruments"]
    ]
    return grid(["truth", "instrument", "distance, m", "RMS, um"], rows)
