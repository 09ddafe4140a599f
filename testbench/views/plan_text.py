"""A plan in words: the answer, the table, one page of Markdown. Everything is read from the report."""

import math
from collections.abc import Sequence
from pathlib import Path

from rich import box
from rich.table import Table

from testbench.views.report import Report, show

MOST_ROWS = 40
"""Rows of the plan that are shown; plan.csv has all of them."""
JUDGED: dict[str, str] = {
    "test": "mean square error at the tasks",
    "I": "mean square error over the workspace",
    "G": "largest mean square error of a pose in the workspace",
    "A": "mean variance of the unknowns",
    "D": "volume of the unknowns' confidence ellipsoid",
    "E": "variance of the least known direction",
}
"""What a criterion makes small."""
TIGHT = 0.8
"""Efficiency from which on a certificate says most of what there is to say."""
LOOSE = "So far from 100 % with few poses the bound may be what is loose, not the plan."
HIDDEN = 0.5
"""Share of the error that no hung weight reduces, above which that is said aloud."""
UNCHECKED = "visibility NOT checked"
"""Where no tracker was given."""


def answer(report: Report) -> str:
    """The whole plan in one sentence."""
    random = report["random_plans"]
    others = (
        "random poses leave the error without a bound"
        if random["median_mm"] is None
        else f"random poses {show(random['median_mm'])} (best tenth {show(random['best_tenth_mm'])})"
    )
    by = "" if report["criterion"] == "test" else f" by criterion {report['criterion']}"
    return (
        f"{count(report['poses'], 'pose')}: error at the tasks {_interval(report['error_mm'])}, at least "
        f"{_share(report)} % efficient{by}; {others}"
    )


def count(number: int, noun: str) -> str:
    """Such as 1 pose, 5,132 poses."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def _interval(error: Report) -> str:
    return f"{show(error['expected'])} mm expected ({show(error['p05'])} to {show(error['p95'])})"


def _share(report: Report) -> int:
    """Efficiency in per cent, never rounded up."""
    share: float = report["certificate"]["efficiency"]
    return math.floor(100 * share)


def certificate(report: Report) -> str:
    """What no other plan of as many poses can do."""
    c = report["certificate"]
    what = "feasible poses and loads" if c["poses_and_loads"] else "feasible poses"
    among = f"No {report['poses']} of the {c['examined']:,} {what} examined"
    if report["poses"] == 1:
        among = f"None of the {c['examined']:,} {what} examined"
    excess = math.ceil(10 * c["excess_percent"]) / 10
    efficient = f"the plan is at least {_share(report)} % efficient"
    loose = "" if c["efficiency"] >= TIGHT else f" {LOOSE}"
    if c["least_mm"] is None:
        return (
            f"{among} can be better than {1 / c['efficiency']:.3f} times this plan by criterion "
            f"{report['criterion']} ({JUDGED[report['criterion']]}): {efficient}, its standard deviations at "
            f"most {excess:.1f} % above the least possible.{loose}"
        )
    return (
        f"{among} can reach less than {c['least_mm']:.4f} mm (root of the {JUDGED[report['criterion']]}; "
        f"this plan {c['reached_mm']:.4f}): {efficient}, its error at most {excess:.1f} % above the least "
        f"possible.{loose}"
    )


def table(report: Report) -> Table:
    """The plan for a terminal of 80 columns."""
    names = [f"q{k}" for k in range(1, len(report["joints"]) + 1)]
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    heads = ["run", *(f"{name}\ndeg" for name in names), "load\nkg", "error\nmm", "travel\ndeg", "way"]
    for heading in heads:
        shown.add_column(heading, justify="right", no_wrap=True)
    for row in report["plan"][:MOST_ROWS]:
        angles = [f"{angle:.1f}" for angle in row["q_deg"]]
        error, travel = f"{row['expected_error_mm']:.3f}", f"{row['travel_deg']:.0f}"
        shown.add_row(str(row["run"]), *angles, f"{row['load_kg']:g}", error, travel, row["way"])
    return shown


def sentences(report: Report) -> list[str]:
    """What stands below the table in a terminal."""
    return [certificate(report), advice(report), *warnings(report), rejections(report)]


def where(out: Path) -> str:
    """Where the results are, and how to open them."""
    return (
        f"plan       {out / 'plan.csv'}; page {out / 'plan.md'}\n"
        f"numbers    {out / 'plan.json'}, {out / 'tasks_expected.csv'}\n"
        f"figure     {out / 'plan.png'}\n"
        f"recording  {out / 'recording.rrd'}; open it with: .venv/bin/testbench view {out}"
    )


def rejections(report: Report) -> str:
    """How the candidates were found, in one line."""
    found, wanted = report["candidates"], report["candidates_wanted"]
    reasons = sorted(found["rejected"].items(), key=lambda item: -item[1])
    refused = ", ".join(f"{reason} {number:,}" for reason, number in reasons if number)
    fewer = "" if found["found"] == wanted else f" of {wanted:,} wanted"
    return (
        f"{count(found['found'], 'feasible pose')}{fewer} of {found['drawn']:,} drawn evenly over the joint "
        f"limits; refused: {refused or 'none'}"
    )


def advice(report: Report) -> str:
    """How many poses to measure."""
    a = report["advice"]
    goal = f"{a['target_mm']:g} mm at the tasks"
    most = a["examined_up_to"]
    fewest = (
        f"No plan of up to {most} poses was found that reaches {goal}"
        if a["fewest"] is None
        else f"{count(a['fewest'], 'pose')} {'reaches' if a['fewest'] == 1 else 'reach'} {goal}"
    )
    more = f"{a['more']} more poses bring less than {a['little_percent']:g} %"
    enough = (
        f"up to {most} poses {a['more']} more always bring {a['little_percent']:g} % or more"
        if a["enough"] is None
        else f"from {a['enough']} on {more}"
    )
    return f"{fewest}; {enough}."


def warnings(report: Report) -> list[str]:
    """What must not be overlooked."""
    found = []
    if report["tracker_m"] is None:
        found.append(f"{UNCHECKED}: no --tracker x,y,z was given")
    hidden = report["directions"]["hidden_mm"]
    if hidden > HIDDEN * report["error_mm"]["expected"]:
        found.append(
            f"the tasks' loads move the arm in directions that hung weights cannot show: {hidden:.3f} mm of "
            "the error rest on the prior alone, whatever is measured"
        )
    blocked = [str(row["run"]) for row in report["plan"] if row["way"] == "via"]
    if blocked:
        found.append(
            f"the straight way collides before {'run' if len(blocked) == 1 else 'runs'} "
            f"{', '.join(blocked)}: go via a pose in between"
        )
    return found


def error_of(row: Report) -> str:
    """Expected error with its 90 % interval."""
    low, high = row["expected_error_p05_mm"], row["expected_error_p95_mm"]
    return f"{row['expected_error_mm']:.3f} ({low:.3f} to {high:.3f})"


def step_words(report: Report) -> Sequence[str]:
    """Every run in a few words, for the recording."""
    angles = [
        ", ".join(f"{name} {angle:.2f}" for name, angle in zip(report["joints"], row["q_deg"], strict=True))
        for row in report["plan"]
    ]
    return [
        f"**Run {row['run']}**: {row['load_kg']:g} kg, deflection {row['expected_deflection_mm']:.2f} mm "
        f"expected, error of its prediction {error_of(row)} mm; {_way(row)}\n\n{q} deg"
        for row, q in zip(report["plan"], angles, strict=True)
    ]


def _way(row: Report) -> str:
    if row["way"] == "start":
        return "the first"
    how = "straight" if row["way"] == "clear" else "via a pose in between"
    return f"{row['travel_deg']:.0f} deg from the run before, {how}"
