"""plan.md: a plan on one page. Everything is read from the report."""

from testbench.views.plan_text import (
    JUDGED,
    MOST_ROWS,
    advice,
    answer,
    certificate,
    count,
    error_of,
    rejections,
    warnings,
)
from testbench.views.report import Report, show
from testbench.views.tables import grid

WORST = 3
"""Tasks that the page shows, those of the largest errors."""


def markdown(report: Report) -> str:
    """plan.md: one page."""
    doubts = [line for text in warnings(report) for line in ("", f"**{text}.**")]
    sections = [
        ("", [f"**{answer(report)}.**", "", certificate(report), *doubts]),
        ("Poses in the order of measuring", _poses(report)),
        ("Tasks", _tasks(report)),
        ("How many poses", [*_curve(report), "", advice(report)]),
        ("What this rests on", [f"- {text}" for text in assumptions(report)]),
        ("How the poses were found", _found(report)),
        ("Afterwards", _afterwards(report)),
    ]
    loads = " or ".join(f"{load:g}" for load in report["loads_kg"])
    lines = [f"# Calibration plan: {report['arm']}, {report['model']}, {loads} kg", ""]
    for title, text in sections:
        lines += [*([f"## {title}", ""] if title else []), *text, ""]
    return "\n".join(lines)


def one_page(report: Report) -> str:
    """The table of poses and what else a recording shows of the page."""
    return "\n".join([*_poses(report), "", *_tasks(report)])


def _poses(report: Report) -> list[str]:
    head = ["run", *(f"{name}, deg" for name in report["joints"]), "load, kg", "deflection, mm"]
    head += ["error there, mm", "travel, deg", "way"]
    rows = [
        [
            str(row["run"]),
            *(f"{angle:.2f}" for angle in row["q_deg"]),
            f"{row['load_kg']:g}",
            f"{row['expected_deflection_mm']:.2f}",
            error_of(row),
            f"{row['travel_deg']:.0f}",
            row["way"],
        ]
        for row in report["plan"][:MOST_ROWS]
    ]
    cut = [] if report["poses"] <= MOST_ROWS else ["", f"The first {MOST_ROWS}; all are in plan.csv."]
    return [
        *grid(head, rows),
        *cut,
        "",
        "In each pose: read all markers, hang the weight, read again, lower the weight, go on. Deflection: "
        "RMS over the markers, by the prior. Error: of predicting it after identification, with the 90 % "
        "interval. Travel: of the joint that turns farthest; way: clear where all joints can go straight "
        "without the weight (checked every 5 deg), via where they cannot.",
    ]


def _tasks(report: Report) -> list[str]:
    rows = sorted(report["tasks"], key=lambda row: -row["expected_error_mm"])
    worst = "; ".join(f"task {row['task']}: {error_of(row)}" for row in rows[:WORST])
    best = rows[-1]["expected_error_mm"]
    moved = [row["expected_deflection_mm"] for row in rows]
    return [
        f"{count(len(rows), 'task')}, where the markers move {min(moved):.2f} to {max(moved):.2f} mm under "
        f"the task's load, by the prior. Expected error {best:.3f} to {rows[0]['expected_error_mm']:.3f} mm; "
        f"worst: {worst}. All are in tasks_expected.csv."
    ]


def _curve(report: Report) -> list[str]:
    """One column a number of poses."""
    rows = report["curve"]
    head = ["error at the tasks with", *(count(row["poses"], "pose") for row in rows)]
    ours = ["one after the other, each the best next one, mm", *(_open(row["greedy_mm"]) for row in rows)]
    others = ["random, median, mm", *(_open(row["random_median_mm"]) for row in rows)]
    return grid(head, [ours, others])


def _open(value: float | None) -> str:
    return "no bound" if value is None else f"{value:.3f}"


def assumptions(report: Report) -> list[str]:
    """What the promise takes for granted, and what of it rests on the prior."""
    d = report["directions"]
    first = (
        f"{report['model']} has {d['unknowns']} unknowns; hung loads can show {d['shown']} directions of "
        f"them, the plan sees {d['seen']}"
    )
    return [
        *_of_prior(report, first),
        f"White noise of {report['sigma_um']:g} um on every reading along every axis, the same everywhere; a "
        "linear model, and no error of the model itself: **the real error is larger**. Measure two or three "
        "further poses and check on them.",
        "Collisions are those of the shapes in rigid.xml and the weight on its sling of "
        f"{report['sling_m']:g} m: cables, fixtures and fences are not in them.",
    ]


def _of_prior(report: Report, first: str) -> list[str]:
    d = report["directions"]
    if report["prior"] is None:
        return [
            f"{first}. No prior: the other {d['unknowns'] - d['shown']} stay unknown, and loads that are not "
            "hung may move them."
        ]
    doubted = report["error_if_prior_twice_as_uncertain_mm"]
    return [
        f"Prior: {report['prior']}, {report['uncertainty_percent']:g} % uncertain, its common scale left to "
        f"the data. Were it twice as uncertain, the error would be {show(doubted['expected'])} mm instead of "
        f"{show(report['error_mm']['expected'])}.",
        f"{first}; in {d['outweighed']} of them the readings say more than the prior, the rest leans on it. "
        f"Of the mean square error at the tasks {d['prior_share_percent']:.0f} % is what the prior leaves "
        "open, the rest is noise.",
    ]


def _found(report: Report) -> list[str]:
    o = report["observability"]
    indices = ", ".join(f"O{k} {o[f'o{k}']:.3g}" for k in range(1, 6))
    if o["seen"] < o["of"]:
        indices = f"O1 to O5 are 0, as it leaves {o['of'] - o['seen']} of {o['of']} directions to the prior"
    where = (
        "no tracker"
        if report["tracker_m"] is None
        else f"the tracker at {', '.join(f'{x:g}' for x in report['tracker_m'])} m"
    )
    box = report["box_m"]
    if box is not None:
        low, high = (", ".join(f"{x:g}" for x in corner) for corner in box)
        where += f", the tool between {low} and {high} m"
    return [
        f"{rejections(report)}. Judged for {where}, criterion {report['criterion']} "
        f"({JUDGED[report['criterion']]}), seed {report['seed']}. Observability of the plan, unknowns in "
        f"units of the CAD compliances: {indices}.",
    ]


def _afterwards(report: Report) -> list[str]:
    fit = f"testbench identify ARM measured.csv --model {report['model']}"
    believed = (
        "" if report["prior"] is None else f" --prior --uncertainty-percent {report['uncertainty_percent']:g}"
    )
    return [
        "Rehearse with `testbench simulate ARM plan.csv --out rehearsal.csv`; identify what was measured "
        f"with `{fit}{believed}`: the promise is for this identification.",
    ]
