"""The study of identifiability in words: tables, verdict, report.md."""

from typing import Any

from rich import box
from rich.table import Table

from testbench.studies.identifiability.trial import SPOILED, SPOILED_BY
from testbench.views.report import Report, middle, show, show_truth
from testbench.views.tables import grid

COVERAGE = 0.93, 0.97
"""Share that 95 % intervals are to cover."""
BARS = {"models": 0.12, "nonlinear": 0.15}
"""RMS over the workspace that a model with a prior is to reach, linear and non-linear truth [mm]."""


def title(report: Report) -> str:
    """What was measured, in one line."""
    data, seeds, prior = report["dataset"], report["seed"], report["prior"]
    who = f"seed {seeds}" if isinstance(seeds, int) else f"{len(seeds)} seeds: median (5 % to 95 %)"
    return (
        f"{report['arm']} under {report['payload_kg']:g} kg: {data['runs']} runs in {data['poses']} poses, "
        "sigma "
        f"{data['sigma_um']:g} um; prior {prior['scale']:g} times too soft and {prior['shape_percent']:g} "
        "% wrong "
        f"in shape; errors against the truth in {data['workspace_poses']} poses; {who}"
    )


def table(report: Report) -> Table:
    """Every method for a terminal of 80 columns."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    shown.add_column("model", no_wrap=True)
    headings = ("conser-\nvative", "RMS work-\nspace mm", "5 %\nmm", "95 %\nmm", "non-linear\ntruth mm")
    for heading in headings:
        shown.add_column(heading, justify="right", no_wrap=True)
    for linear, bent in zip(report["models"], report["nonlinear"], strict=True):
        rms, other = linear["workspace"]["rms_mm"], bent["workspace"]["rms_mm"]
        ends = [f"{rms[key]:.3f}" for key in ("p05", "p95")] if isinstance(rms, dict) else ["", ""]
        numbers = [f"{middle(rms):.3f}", *ends, f"{middle(other):.3f}"]
        shown.add_row(linear["name"], show_truth(linear["conservative"]), *numbers)
    return shown


def _rms(rows: list[dict[str, Any]], name: str) -> Any:
    return next(m for m in rows if m["name"] == name)["workspace"]["rms_mm"]


def verdict(report: Report) -> str:
    """What a prior is worth, and where it is not."""
    return "\n".join(statements(report))


def statements(report: Report) -> list[str]:
    """The answers, each with its numbers; the first one is the headline."""
    return [
        _headline(report),
        _unregularised(report),
        _against_ls(report),
        _scales(report),
        _choice(report),
        _outliers(report),
        _coverage(report),
    ]


def _headline(report: Report) -> str:
    names = [m["name"] for m in report["models"] if m["name"].endswith("GCO + prior")]
    words = []
    for key, bar in BARS.items():
        each = [f"{name.split(',')[0]} {show(_rms(report[key], name))}" for name in names]
        met = [name.split(",")[0] for name in names if middle(_rms(report[key], name)) <= bar]
        words.append(f"{', '.join(each)} mm (within {bar} mm: {', '.join(met) or 'none'})")
    return (
        f"GCO with the prior, RMS over the workspace: with linear truth {words[0]}, with non-linear truth "
        f"{words[1]}."
    )


def _unregularised(report: Report) -> str:
    parts = []
    for name in ("MGCO56", "MGCO68"):
        plain, ours = _rms(report["models"], name), _rms(report["models"], f"{name}, GCO + prior")
        parts.append(
            f"{name} {show(plain)} mm without, {middle(plain) / middle(ours):.3g} times the error with it"
        )
    trace = _rms(report["models"], "MGCO68, least trace")
    return (
        f"The prior against none: {'; '.join(parts)}. Least trace in the prior's metric instead, no "
        "compliance "
        f"believed: MGCO68 {show(trace)} mm."
    )


def _against_ls(report: Report) -> str:
    parts = [
        f"{name} {found['best_ratio']:.3f} to {found['worst_ratio']:.3f}, worse in {found['seeds_worse']} of "
        f"{found['seeds']}"
        for name, found in report["never_worse"].items()
    ]
    kept = [
        f"{m['name'].split(',')[0]} {show_truth(m['conservative'])}"
        for m in report["models"]
        if m["name"].endswith("LS + prior")
    ]
    return (
        "GCO over LS with the same prior, believed as firmly, error over the workspace, seed by seed: "
        f"{'; '.join(parts)}. LS with it is conservative in: {'; '.join(kept)}."
    )


def _scales(report: Report) -> str:
    rows = {f"{row['scale']:g}": row["MGCO56, GCO + prior"] for row in report["scales"]}
    listed = ", ".join(f"{scale} times {middle(value):.3f}" for scale, value in rows.items())
    believed = report["fixed_scale"]["MGCO56"]
    return (
        f"Prior of wrong scale (MGCO56, mm): {listed}: the data set the scale. Believed instead, at "
        f"{report['prior']['scale']:g} times: {show(believed)} mm."
    )


def _choice(report: Report) -> str:
    choice = report["choice"]
    often = ", ".join(f"{name} {show_truth(share)}" for name, share in choice["chosen"].items())
    return (
        f"Cross-validation over poses recommends (one standard error, simplest first): {often}; the chosen "
        "one "
        f"errs by {show(choice['chosen_workspace_mm'])} mm, the best of all in hindsight by "
        f"{show(choice['best_workspace_mm'])} mm. Strength and structure are chosen on the same folds."
    )


def _outliers(report: Report) -> str:
    out = report["outliers"]
    cost = 100 * (middle(out["robust_mm"]) / middle(out["clean_mm"]) - 1)
    return (
        f"{100 * SPOILED:g} % of the marker readings off by {1e3 * SPOILED_BY:g} mm (MGCO68, prior of 30 "
        f"%): {show(out['plain_mm'])} mm with the "
        "plain "
        f"loss, {show(out['robust_mm'])} mm with the robust one, {show(out['clean_mm'])} mm without "
        "outliers: "
        f"{cost:+.1f} %."
    )


def _coverage(report: Report) -> str:
    rows = report["coverage"]
    low, high = COVERAGE
    exact = {name: row["covered"] for name, row in rows.items() if "at most" not in name}
    sets = [row["covered"] for name, row in rows.items() if name not in exact]
    inside = sum(low <= share <= high for share in exact.values())
    return (
        f"Intervals of 95 % contain the true deflection in {100 * min(exact.values()):.1f} to "
        f"{100 * max(exact.values()):.1f} % ({inside} of {len(exact)} kinds within {100 * low:g} to "
        f"{100 * high:g} %), set bounds in at least {100 * min(sets):.1f} %. The same arm in "
        f"every dataset: {_bent(report)}."
    )


def _bent(report: Report) -> str:
    return ", ".join(
        f"{100 * row['covered']:.1f} % ({name})" for name, row in report["bent_coverage"].items()
    )


def markdown(report: Report) -> str:
    """report.md: verdict, methods, scales, poses, choice."""
    first, *others = statements(report)
    return "\n".join(
        [
            f"# {report['scenario']}",
            "",
            f"{title(report)}.",
            "",
            f"**{first}**",
            "",
            *(f"- {text}" for text in others),
            "",
            *_methods(report),
            "",
            "The prior is the arm's CAD model, distorted; its common scale is fitted to the data, and how "
            "firmly "
            "it is believed is chosen by cross-validation over poses. LS and GCO see the same prior.",
            "",
            "## Number of poses (RMS over the workspace, mm)",
            "",
            *_rows(report["poses"], "poses"),
            "",
            "## Scale of the prior (RMS over the workspace, mm)",
            "",
            *_rows(report["scales"], "scale"),
            "",
            "## Model choice by cross-validation over poses, with the prior",
            "",
            *_choices(report["choice"]),
            "",
            "The rule takes the simplest model within one standard error of the best F_M on poses held out.",
            "",
            "## Coverage of 95 % intervals of predicted deflections (linear truth)",
            "",
            *_coverage_table(report["coverage"] | report["bent_coverage"]),
            "",
            "With a prior of 10 % the truth of every dataset is drawn from it; the cone hardly binds there. "
            "Set bounds hold for all deflections at once and for every conservative model up to ten times "
            "the prior: wide.",
            "",
        ]
    )


def _methods(report: Report) -> list[str]:
    head = [
        "model",
        "unknowns",
        "seen",
        "conservative",
        "uncertainty, %",
        "RMS check, mm",
        "RMS workspace, mm",
    ]
    head += ["max workspace, mm", "RMS workspace, non-linear truth, mm"]
    rows = [
        [
            m["name"],
            str(m["parameters"]),
            show(m["rank"], ".0f"),
            show_truth(m["conservative"]),
            show(m["uncertainty_percent"], ".0f"),
            show(m["check"]["rms_mm"]),
            show(m["workspace"]["rms_mm"]),
            show(m["workspace"]["max_mm"]),
            show(bent["workspace"]["rms_mm"]),
        ]
        for m, bent in zip(report["models"], report["nonlinear"], strict=True)
    ]
    return grid(head, rows)


def _rows(rows: list[Report], first: str) -> list[str]:
    names = [name for name in rows[0] if name != first]
    return grid([first, *names], [[f"{row[first]:g}", *(show(row[name]) for name in names)] for row in rows])


def _coverage_table(rows: Report) -> list[str]:
    head = ["interval", "datasets", "covered, %", "standard error, %", "mean width, um", "unbounded, %"]
    return grid(
        head,
        [
            [
                name,
                str(row["datasets"]),
                f"{100 * row['covered']:.1f}",
                f"{100 * row['standard_error']:.1f}",
                "-" if row["width_um"] is None else f"{row['width_um']:.0f}",
                f"{100 * row['unbounded']:.0f}",
            ]
            for name, row in rows.items()
        ],
    )


def _choices(choice: Report) -> list[str]:
    return grid(
        ["model", "recommended", "F_M held out", "RMS workspace, mm"],
        [
            [
                name,
                show_truth(share),
                show(choice["held_out_f_m"][name], ".2f"),
                show(choice["workspace_mm"][name]),
            ]
            for name, share in choice["chosen"].items()
        ],
    )
