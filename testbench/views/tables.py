"""A report for people: the table, the verdict in words, report.md. Everything is read from the report."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from testbench.views.report import Report, middle, show, show_truth

COLUMNS: tuple[tuple[str, str, str, str], ...] = (
    ("RMS\nid.\nmm", "identification", "rms_mm", "identification_rms_mm"),
    ("RMS\ncheck\nmm", "check", "rms_mm", "check_rms_mm"),
    ("p95\ncheck\nmm", "check", "p95_mm", ""),
    ("max\ncheck\nmm", "check", "max_mm", "check_max_mm"),
    ("max\nrel.\n%", "check", "max_relative_percent", "check_max_relative_percent"),
    ("RMS\nwork-\nspace\nmm", "workspace", "rms_mm", ""),
)
"""Error columns: heading, set, number, the paper's cell."""


def models(report: Report) -> Table:
    """The table of section 6 for a terminal of 80 columns; below a model its spread, the paper's row."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    for k, heading in enumerate(("model", "un-\nknowns", "seen", "conser-\nvative", "F_M", "floor")):
        table.add_column(heading, justify="left" if k == 0 else "right", no_wrap=True)
    columns = [column for column in COLUMNS if column[2] != "p95_mm"]  # for width; report.md has it
    for heading, *_ in columns:
        table.add_column(heading, justify="right", no_wrap=True)
    for model in report["models"]:
        keys = ["median"] if isinstance(report["seed"], int) else ["median", "p05", "p95"]
        for key in keys:
            first = key == "median"
            table.add_row(
                model["name"] if first else f"  {key}",
                str(model["parameters"]) if first else "",
                _number(model["rank"], key, ".0f") if first else "",
                show_truth(model["conservative"]) if first else "",
                _number(model["f_m"], key, ".2f"),
                _number(model["f_m_floor"], key, ".2f") if first and report["noise"] else "",
                *(_number(model[group][number], key, _form(number)) for _, group, number, _ in columns),
                style="bold" if first else "dim",
            )
        if model["paper"]:
            cells = [model["paper"].get(cell) for *_, cell in columns]
            known = ["" if cell is None else f"{cell:.3g}" for cell in cells]
            table.add_row("  paper", *[""] * 5, *known, style="italic")
    return table


def _number(value: Any, key: str, form: str) -> str:
    if value is None:
        return "-"
    return format(value[key] if isinstance(value, dict) else value, form)


def _form(number: str) -> str:
    return ".2f" if number.endswith("percent") else ".3f"


def title(report: Report) -> str:
    """What was measured, in one line."""
    data = report["dataset"]
    seeds = report["seed"]
    noise = f"sigma {data['sigma_um']:g} um" if report["noise"] else "noise-free"
    who = f"seed {seeds}" if isinstance(seeds, int) else f"{len(seeds)} seeds: median (5 % to 95 %)"
    low, high = show(data["deflection_min_mm"], ".2f"), show(data["deflection_max_mm"], ".2f")
    return (
        f"{report['arm']} under {report['payload_kg']:g} kg: {data['runs']} runs in {data['poses']} poses, "
        f"{data['identification_points']} points identify, {data['check_points']} check; markers move "
        f"{low} to {high} mm; {noise}, {report['truth']} truth; {who}"
    )


def verdict(report: Report) -> str:
    """Which model to trust, where, and what the numbers cannot say."""
    rows = report["models"]
    conservative = [m for m in rows if m["conservative"] is True]
    lines = []
    if conservative:
        check = _best(conservative, "check")
        lines.append(
            f"Best conservative model on the check poses: {check['name']}, "
            f"{show(check['check']['rms_mm'])} mm RMS."
        )
        lines.append(_workspace(conservative))
    paired = report.get("paired")
    if paired:
        lines.append(
            f"Seed by seed {paired['conservative']} beats {paired['least_squares']} in {paired['check']} of "
            f"{paired['seeds']} on the check poses, in {paired['workspace']} over the workspace."
        )
    broken = [m["name"] for m in rows if m["conservative"] is not True]
    if broken:
        lines.append(f"Not conservative: {', '.join(broken)}.")
    free = [f"{m['name']} {m['parameters']} / {show(m['rank'], '.0f')}" for m in rows if not m["unique"]]
    if free:
        lines.append(
            f"Not unique (unknowns / directions seen): {', '.join(free)}. Minimum norm (LS) or least "
            "trace (GCO) fills the rest: single entries mean nothing, nor do predictions far from the "
            "measured poses."
        )
    same = _twins(rows)
    if same:
        lines.append(
            f"{same[0]} and {same[1]} predict alike: solved by SVD, redundant columns change nothing."
        )
    unsolved = [f"{m['name']} ({m['status']})" for m in rows if m["status"] != "solved"]
    if unsolved:
        lines.append(f"NOT CERTIFIED: {', '.join(unsolved)}.")
    held = [m["name"] for m in rows if m["held_by_trace_weight"] is not False]
    if held:
        lines.append(
            f"Held by the trace weight alone: {', '.join(held)}. With a smaller weight unseen compliance "
            "grows and fits a little better: not for use away from the measured poses."
        )
    return "\n".join(lines)


def _best(rows: list[dict[str, Any]], group: str) -> dict[str, Any]:
    return min(rows, key=lambda m: middle(m[group]["rms_mm"]))


def _workspace(rows: list[dict[str, Any]]) -> str:
    best = _best(rows, "workspace")
    worst = max(rows, key=lambda m: middle(m["workspace"]["rms_mm"]))
    return (
        f"Over the whole workspace: {best['name']} {show(best['workspace']['rms_mm'])} mm RMS is the best of "
        f"them, {worst['name']} {show(worst['workspace']['rms_mm'])} mm the worst."
    )


def _twins(rows: list[dict[str, Any]]) -> tuple[str, str] | None:
    for i, a in enumerate(rows):
        for b in rows[i + 1 :]:
            x, y = middle(a["check"]["rms_mm"]), middle(b["check"]["rms_mm"])
            if abs(x - y) < 1e-6 * abs(x):
                return a["name"], b["name"]
    return None


def where(out: Path, *, figures: Sequence[str], data: str = "dataset.csv") -> str:
    """Where the results are, and how to open them.

    Args:
        out: Folder of the results.
        figures: Names of the figures.
        data: Name of the data file.
    """
    return (
        f"numbers    {out / 'report.json'}, {out / 'report.md'}, {out / data}\n"
        f"figures    {', '.join(str(out / name) for name in figures)}\n"
        f"recording  {out / 'recording.rrd'}; open it with: .venv/bin/testbench view {out}"
    )


def markdown(report: Report) -> str:
    """report.md: verdict, table, fits and residuals."""
    head = ["model", "unknowns", "seen", "conservative", "F_M", "floor"]
    head += [heading.replace("-\n", "").replace("\n", " ") for heading, *_ in COLUMNS]
    rows = [
        [
            m["name"],
            str(m["parameters"]),
            show(m["rank"], ".0f"),
            show_truth(m["conservative"]),
            show(m["f_m"], ".3f"),
            show(m["f_m_floor"], ".3f") if report["noise"] else "-",
            *(_beside_paper(m, column) for column in COLUMNS),
        ]
        for m in report["models"]
    ]
    first, *others = verdict(report).split("\n")
    return "\n".join(
        [
            f"# {report['scenario']}",
            "",
            f"{title(report)}.",
            *_first_seed(report),
            "",
            f"**{first}**",
            *others,
            "",
            *grid(head, rows),
            "",
            "The paper's number stands in square brackets where it is known. Errors are distances at the "
            "markers: against readings for identification and check (noise included, as in the paper), "
            "against the true deflection for the workspace. The floor of F_M is what noise alone leaves, "
            "sqrt(3 (1 - seen / equations)).",
            "",
            *_fits(report),
            "",
            "The duality gap bounds F_M minus the least F_M of any conservative model whose blocks have at "
            "most the traces in report.json. Residuals are components along one axis; a p below 0.05 rejects "
            "normality.",
            "",
            *(f"- {text}" for m in report["models"] for text in m["advice"]),
            "",
        ]
    )


def _first_seed(report: Report) -> list[str]:
    seeds = report["seed"]
    if isinstance(seeds, int):
        return []
    return [f"Dataset, residual figure and recording are those of seed {seeds[0]}."]


def _beside_paper(model: dict[str, Any], column: tuple[str, str, str, str]) -> str:
    _, group, number, cell = column
    value = show(model[group][number], _form(number))
    known = (model["paper"] or {}).get(cell)
    return value if known is None else f"{value} [{known:.3g}]"


def _fits(report: Report) -> list[str]:
    head = ["model", "method", "status", "duality gap", "smallest eigenvalue", "seconds"]
    for group in ("identification", "check"):
        head += [f"residual mean, {group}, um", "std, um", "Lilliefors p"]
    rows = [
        [
            m["name"],
            m["method"],
            str(m["status"]),
            show(m["duality_gap"], ".1e"),
            show(m["min_eigenvalue"], ".1e"),
            show(m["solve_seconds"], ".3f"),
            *(
                show(m["residuals"][group][key], form) if report["noise"] or key != "lilliefors_p" else "-"
                for group in ("identification", "check")
                for key, form in (("mean_um", ".1f"), ("std_um", ".1f"), ("lilliefors_p", ".2f"))
            ),
        ]
        for m in report["models"]
    ]
    return grid(head, rows)


def grid(head: list[str], rows: list[list[str]]) -> list[str]:
    """A table in Markdown, line by line."""
    lines = [head, ["---"] * len(head), *rows]
    return [f"| {' | '.join(line)} |" for line in lines]
