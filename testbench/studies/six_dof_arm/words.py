"""Section 5.2 in words: tables, the paper's statements against our numbers, and which order m."""

from typing import Any

from rich import box
from rich.table import Table

from testbench.studies.paper import SECTION_5_2
from testbench.views.report import Report, middle, show, show_truth
from testbench.views.tables import grid

SAME = 1.02
"""An order m serves as well as 6 where F_M and the check error exceed those of m = 6 by less."""
FACTOR = 1.5
"""Two errors agree within this factor."""
CLOSE = 0.05
"""Share by which the error of a model may exceed the least and still count as best."""
TWINS = 1e-6
"""Relative difference of errors below which two models predict alike."""
CELLS = (
    ("p95_mm", "readings_p95_mm", "mm, 95 %"),
    ("max_relative_percent", "readings_max_relative_percent", "% at most"),
)
"""Cells of Table II: our number, the paper's cell, its unit."""


def which_m(order: Report) -> str:
    """The answer to "which m" in one sentence, with its numbers.

    Args:
        order: Rows of every order by model.
    """
    parts = []
    for name, rows in order.items():
        least = next(row for row in rows if _serves(row, rows[-1]))
        shown = [row for row in rows if row["m"] in (least["m"] - 1, least["m"], rows[-1]["m"])]
        parts.append(f"{name} from m = {least['m']} on ({'; '.join(map(_order_in_words, shown))})")
    return (
        "Which m? m = 6, the size of a compliance: from the size of the largest block on no local minimum "
        "can "
        "be worse than the global one. F_M and check error are already as good as with m = 6 for "
        f"{', for '.join(parts)}."
    )


def _order_in_words(row: Report) -> str:
    return f"m = {row['m']}: F_M {middle(row['f_m']):.4g}, 95 % {middle(row['check']['p95_mm']):.3f} mm"


def _serves(row: Report, full: Report) -> bool:
    """Whether an order does as well as m = 6."""
    cost = middle(row["f_m"]) <= SAME * middle(full["f_m"])
    return cost and middle(row["check"]["p95_mm"]) <= SAME * middle(full["check"]["p95_mm"])


def claims(report: Report) -> list[Report]:
    """The paper's statements of section 5.2, and what our numbers say of each.

    Args:
        report: The rest of report.json.
    """
    models = {m["name"]: m for m in report["models"]}
    cells = [
        _cell(name, models[name]["readings"][key], SECTION_5_2[name][cell], unit)
        for name in ("MGCO56", "MLS32", "MLS56", "MGCO69", "MGCO147")
        for key, cell, unit in CELLS
        if cell in SECTION_5_2[name]
    ]
    return [
        _conservative(models),
        *cells,
        _best(models),
        _same(report),
        _redundant(models),
        _linear(report, models),
    ]


def _conservative(models: dict[str, Report]) -> Report:
    ours = {name: m["conservative"] for name, m in models.items()}
    holds = all(value is name.startswith("MGCO") for name, value in ours.items())
    return {
        "claim": "only the GCO models are conservative (Table I)",
        "verdict": "confirmed" if holds else "not confirmed",
        "why": ", ".join(f"{name}: {show_truth(value)}" for name, value in ours.items()),
    }


def _cell(name: str, ours: Any, known: float, unit: str) -> Report:
    factor = middle(ours) / known
    agrees = 1 / FACTOR <= factor <= FACTOR
    why = f"ours {show(ours, '.3g')}, {factor:.2f} times the paper's"
    if isinstance(ours, dict) and ours["p05"] <= known <= ours["p95"]:
        why += ", which lies inside our spread over seeds"
    elif agrees:
        why += ", outside our spread over seeds" if isinstance(ours, dict) else ""
    else:
        why += (
            ": the dimensions of the paper's arm stand in a reference that we do not have, and what "
            f"{name} leaves out or adds weighs differently on ours"
        )
    return {
        "claim": f"{name}: {known:g} {unit}",
        "verdict": "confirmed" if agrees else "not confirmed",
        "why": why,
    }


def _best(models: dict[str, Report]) -> Report:
    errors = {name: middle(m["check"]["p95_mm"]) for name, m in models.items()}
    least = min(errors.values())
    first = [name for name, error in errors.items() if error <= (1 + CLOSE) * least]
    return {
        "claim": "MGCO56 is the best model",
        "verdict": "confirmed" if first == ["MGCO56"] else "not confirmed",
        "why": f"least 95 % error against the truth, within {100 * CLOSE:g} %: {', '.join(first)}",
    }


def _same(report: Report) -> Report:
    paired = report["paired"]
    ratio = paired["mgco56_over_mls32_p95_check"]
    same = 1 / FACTOR <= middle(ratio) <= FACTOR
    return {
        "claim": "MGCO56 and MLS32 are nearly the same",
        "verdict": "confirmed" if same else "not confirmed",
        "why": (
            f"on the same data MGCO56's 95 % error against the truth is {show(ratio)} times that of MLS32; "
            f"it is the better one in {paired['mgco56_better_than_mls32']} of {paired['seeds']} seeds"
        ),
    }


def _redundant(models: dict[str, Report]) -> Report:
    more, less = (models[name]["check"]["p95_mm"] for name in ("MLS56", "MLS32"))
    alike = abs(middle(more) / middle(less) - 1) < TWINS
    spread, seen = show(models["MLS32"]["readings"]["p95_mm"]), middle(models["MLS56"]["rank"])
    return {
        "claim": "MLS56 does worse than MLS32",
        "verdict": "not confirmed" if alike else "confirmed",
        "why": (
            f"solved by SVD the two predict alike to rounding: {models['MLS56']['parameters'] - seen:g} "
            f"redundant columns change nothing. The paper's {_paper('MLS56')} against {_paper('MLS32')} mm "
            "is "
            f"no more than noise makes of one model: {spread} mm"
        )
        if alike
        else f"ours {show(more)} against {show(less)} mm",
    }


def _linear(report: Report, models: dict[str, Report]) -> Report:
    bent = next(m for m in report["nonlinear"]["models"] if m["name"] == "MGCO56")
    ours, theirs = bent["check"]["p95_mm"], models["MGCO56"]["check"]["p95_mm"]
    hurts = middle(ours) > FACTOR * middle(theirs)
    return {
        "claim": "a linear model is enough (the paper's truth is linear)",
        "verdict": "not confirmed on this arm" if hurts else "confirmed",
        "why": (
            f"with the non-linear truth MGCO56's 95 % error is {show(ours)} mm, with linear truth "
            f"{show(theirs)} mm, both against the truth"
        ),
    }


def title(report: Report) -> str:
    """What was measured, in one line."""
    data, seeds = report["dataset"], report["seed"]
    who = f"seed {seeds}" if isinstance(seeds, int) else f"{len(seeds)} seeds: median (5 % to 95 %)"
    low, high = show(data["deflection_min_mm"], ".1f"), show(data["deflection_max_mm"], ".1f")
    sigma, turn = (data[key] for key in ("sigma_um", "sigma_urad"))
    return (
        f"{report['arm']}: {data['runs']} runs in {data['poses']} poses under single-axis loads, full pose "
        f"read with {sigma:.3g} um and {turn:.3g} urad a reading; {data['check_runs']} check runs, "
        f"deflections {low} to {high} mm; {who}"
    )


def table(report: Report) -> Table:
    """Tables I and II for a terminal of 80 columns, the paper's cells below ours."""
    found = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    found.add_column("model", no_wrap=True)
    headings = ["un-\nknowns", "conser-\nvative", "F_M", "95 %\nmm", "RMS\nmm", "95 %\n%", "max\n%"]
    headings += ["true\n95 %\nmm", "bent\n95 %\nmm"]
    for heading in headings:
        found.add_column(heading, justify="right", no_wrap=True)
    for model, bent in zip(report["models"], report["nonlinear"]["models"], strict=True):
        numbers = [model["readings"][key] for key in ("p95_mm", "rms_mm", "p95_relative_percent")]
        numbers += [model["readings"]["max_relative_percent"], model["check"]["p95_mm"]]
        numbers += [bent["check"]["p95_mm"]]
        head = [str(model["parameters"]), show_truth(model["conservative"]), f"{middle(model['f_m']):.2f}"]
        found.add_row(model["name"], *head, *(f"{middle(n):.3f}" for n in numbers), style="bold")
        if isinstance(report["seed"], list):
            for key in ("p05", "p95"):
                spread = [n[key] if isinstance(n, dict) else n for n in numbers]
                found.add_row(f"  {key}", "", "", "", *(f"{n:.3f}" for n in spread), style="dim")
        known = model["paper"] or {}
        cells = [known.get(cell) for _, cell, _ in CELLS]
        shown = ["" if cell is None else f"{cell:.3f}" for cell in cells]
        found.add_row("  paper", "", "", "", shown[0], "", "", shown[1], "", "", style="italic")
    return found


def verdict(report: Report) -> str:
    """What section 5.2 says, checked: what is not confirmed stands with its reason."""
    rows = report["claims"]
    confirmed = [row["claim"] for row in rows if row["verdict"].startswith("confirmed")]
    others = [
        f"{row['verdict'].capitalize()}: {row['claim']}; {row['why']}."
        for row in rows
        if row["claim"] not in confirmed
    ]
    return "\n".join([_headline(report), f"Confirmed: {'; '.join(confirmed)}.", *others, report["which_m"]])


def markdown(report: Report) -> str:
    """report.md: Tables I and II for both truths, statements, the order m."""
    return "\n".join(
        [
            f"# {report['scenario']}",
            "",
            f"{title(report)}.",
            "",
            f"**{_headline(report)}**",
            "",
            "## Tables I and II, linear truth (as the paper)",
            "",
            *models_table(report["models"], paper=True),
            "",
            "The paper's number stands in square brackets where its text gives it. *Readings*: errors "
            "against noisy check runs; *truth*: against the same runs without noise. The paper does not say "
            "which; its numbers are near ours against readings.",
            "",
            "## The same with MuJoCo's non-linear truth, own weight included",
            "",
            *models_table(report["nonlinear"]["models"], paper=False),
            "",
            "## The paper's statements",
            "",
            *claims_table(report),
            "",
            "## The order m, Eq. 20",
            "",
            f"{report['which_m']}",
            "",
            f"Linear truth, {len(report['order']['seeds'])} seeds, best of several local solves of the "
            "factorised problem; F_M also over the optimum of the conic program. The template of MGCO56 "
            "splits a link into blocks of size 1 and 2, so that m = 2 already reaches all of it.",
            "",
            *orders_table(report["order"]),
            "",
        ]
    )


def claims_table(report: Report) -> list[str]:
    """The paper's statements, in Markdown."""
    rows = [[row["claim"], row["verdict"], row["why"]] for row in report["claims"]]
    return grid(["statement", "verdict", "why"], rows)


def _headline(report: Report) -> str:
    models = {m["name"]: m["readings"]["p95_mm"] for m in report["models"]}
    always = [m["name"] for m in report["models"] if m["conservative"] is True]
    return (
        f"MGCO56 errs by {show(models['MGCO56'])} mm (95 % of the check runs; paper {_paper('MGCO56')}), "
        "MLS32 "
        f"by {show(models['MLS32'])} mm (paper {_paper('MLS32')}); conservative in every seed: "
        f"{', '.join(always) or 'none'}."
    )


def _paper(name: str) -> str:
    """The paper's 95 % error [mm]."""
    return f"{SECTION_5_2[name]['readings_p95_mm']:.3f}"


def models_table(models: list[Report], *, paper: bool) -> list[str]:
    """Tables I and II in Markdown; with the paper's cells in brackets where asked for."""
    head = [
        "model",
        "unknowns",
        "seen",
        "conservative",
        "F_M",
        "floor",
        "95 % readings, mm",
        "RMS readings, mm",
    ]
    head += ["95 % readings, %", "max readings, %", "95 % truth, mm", "RMS truth, mm", "max truth, %"]
    rows = []
    for m in models:
        known = (m["paper"] or {}) if paper else {}
        row = [m["name"], str(m["parameters"]), show(m["rank"], ".0f"), show_truth(m["conservative"])]
        row += [show(m["f_m"]), show(m["f_m_floor"])]
        for group, key, form in (
            ("readings", "p95_mm", ".3f"),
            ("readings", "rms_mm", ".3f"),
            ("readings", "p95_relative_percent", ".2f"),
            ("readings", "max_relative_percent", ".2f"),
            ("check", "p95_mm", ".3f"),
            ("check", "rms_mm", ".3f"),
            ("check", "max_relative_percent", ".2f"),
        ):
            cell = known.get(f"{group}_{key}")
            row.append(show(m[group][key], form) + ("" if cell is None else f" [{cell:g}]"))
        rows.append(row)
    return grid(head, rows)


def orders_table(order: Report) -> list[str]:
    """F_M, rank, eigenvalue and error of every order m, in Markdown."""
    head = [
        "model",
        "m",
        "F_M",
        "F_M over optimum",
        "largest rank",
        "smallest scaled eigenvalue",
        "95 % check, mm",
    ]
    return grid(
        head,
        [
            [
                name,
                str(row["m"]),
                show(row["f_m"], ".4g"),
                show(row["f_m_over_optimum"], ".5f"),
                show(row["rank"], ".0f"),
                show(row["min_scaled_eigenvalue"], ".1e"),
                show(row["check"]["p95_mm"]),
            ]
            for name, rows in order.items()
            if name != "seeds"
            for row in rows
        ],
    )
