"""The study of pose selection in words: tables, verdict, report.md."""

from typing import Any

from rich import box
from rich.table import Table

from testbench.studies.pose_selection.ground import FITS, RANDOM
from testbench.studies.pose_selection.summary import AIM, LITTLE, STEP, at
from testbench.views.report import Report, middle, show
from testbench.views.tables import grid

RATIO, PROMISE = 0.6, 0.2
"""What a plan is to reach: its share of random's median error, and how far its promise may be off."""
WORDS = {
    "test": "error at the tasks",
    "I": "mean error over the workspace",
    "D": "volume of the confidence region",
    "A": "mean variance of the unknowns",
    "E": "worst seen direction",
    "G": "worst error over the workspace",
    RANDOM: "no plan",
}


def title(report: Report) -> str:
    """What was done, in one line."""
    data, seeds = report["dataset"], report["seed"]
    who = f"seed {seeds}" if isinstance(seeds, int) else f"{len(seeds)} seeds: median (5 % to 95 %)"
    return (
        f"{report['arm']} under {report['payload_kg']:g} kg, sigma {data['sigma_um']:g} um, tracker at "
        f"{report['tracker_m']} m: plans from {report['candidates']['found']} feasible poses; errors against "
        f"the true deflection in {data['tasks']} tasks and {data['workspace_poses']} poses of the workspace; "
        f"non-linear truth; {who}"
    )


def table(report: Report) -> Table:
    """The featured number of poses, criterion by criterion, for a terminal of 80 columns."""
    poses = report["dataset"]["poses"]
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    shown.add_column(f"{poses} poses by", no_wrap=True)
    headings = ("effi-\ncient\n>= %", "promised\ntasks\nmm", "tasks\nmm", "5 %\nmm", "95 %\nmm")
    for heading in (*headings, "work-\nspace\nmm", "tasks,\nno prior\nmm"):
        shown.add_column(heading, justify="right", no_wrap=True)
    for name in report["errors"][FITS[0]]:
        plan = _plan(report, name, poses)
        own, bare = (at(report["errors"][fit][name], poses) for fit in (FITS[0], FITS[2]))
        tasks = own["tasks_mm"]
        ends = [f"{tasks[key]:.3f}" for key in ("p05", "p95")] if isinstance(tasks, dict) else ["", ""]
        shown.add_row(
            name,
            f"{100 * plan['efficiency']:.1f}" if plan else "",
            f"{plan['expected_tasks_mm']:.3f}" if plan else "",
            f"{middle(tasks):.3f}",
            *ends,
            f"{middle(own['workspace_mm']):.3f}",
            f"{middle(bare['tasks_mm']):.3f}",
        )
    return shown


def _plan(report: Report, name: str, poses: int) -> Report | None:
    return next((p for p in report["plans"] if (p["criterion"], p["poses"]) == (name, poses)), None)


def verdict(report: Report) -> str:
    """All answers, one a line."""
    return "\n".join(statements(report))


def statements(report: Report) -> list[str]:
    """The answers, each with its numbers; the first one is the headline."""
    return [
        _headline(report),
        _possible(report),
        _number(report),
        _criteria(report),
        _bare(report),
        _replanned(report),
        _promise(report),
        _reality(report),
        _worth(report),
    ]


def _headline(report: Report) -> str:
    own = report["featured"][FITS[0]]
    plan = _plan(report, "test", own["poses"])
    assert plan is not None
    best = middle(own["test_mm"]) <= own["random_best_tenth_mm"]
    met = own["ratio_of_medians"] <= RATIO and best
    return (
        f"{own['poses']} poses chosen for the tasks leave {show(own['test_mm'])} mm there ({FITS[0]}), "
        f"random ones {show(own['random_mm'])} mm: {own['ratio_of_medians']:.2f} of their median (aim "
        f"{RATIO:g}), and {'no worse' if best else 'worse'} than the best tenth of them "
        f"({own['random_best_tenth_mm']:.3f} mm)"
        f"{'' if met else ': MISSED'}; the plan is at least {100 * plan['efficiency']:.1f} % efficient."
    )


def _possible(report: Report) -> str:
    own = report["possible"]
    calm = own["noise_free_mm"]
    return (
        f"What is possible: no {own['poses']} of the poses examined can promise less than "
        f"{own['least_promise_mm']:.3f} mm, and {show(calm['test'])} mm stay without any noise (random "
        f"{show(calm[RANDOM])}): links outside the model, a wrong prior, an arm that bends; that alone is "
        f"{own['noise_free_over_random']:.2f} of random's median with noise."
    )


def _number(report: Report) -> str:
    advice = report["recommendation"]
    plan, chance = (advice["fewest"][key] or "more than tried" for key in ("test", RANDOM))
    knee = advice["little_more_beyond"]
    more = (
        f"beyond {knee} poses {STEP} more take less than {100 * LITTLE:.0f} % off"
        if knee
        else "every step tried still pays"
    )
    return (
        f"How many: {plan} planned poses keep the tasks within {AIM:g} mm in 95 % of all trials, random ones "
        f"need {chance}; {more}."
    )


def _criteria(report: Report) -> str:
    poses = report["dataset"]["poses"]
    rows = {name: at(own, poses) for name, own in report["errors"][FITS[0]].items()}
    planned = [name for name in rows if name != RANDOM]
    best = {
        key: min(planned, key=lambda name, key=key: middle(rows[name][key]))  # type: ignore[misc]
        for key in ("tasks_mm", "workspace_mm")
    }
    losers = [
        f"{name} {middle(rows[name]['tasks_mm']):.3f} mm"
        for name in planned
        if middle(rows[name]["tasks_mm"]) >= middle(rows[RANDOM]["tasks_mm"])
    ]
    lost = f"; no better than random at the tasks: {', '.join(losers)}" if losers else ""
    return (
        f"By criterion at {poses} poses: best at the tasks {best['tasks_mm']} "
        f"({middle(rows[best['tasks_mm']]['tasks_mm']):.3f} mm), over the workspace {best['workspace_mm']} "
        f"({middle(rows[best['workspace_mm']]['workspace_mm']):.3f} mm; random "
        f"{middle(rows[RANDOM]['workspace_mm']):.3f}){lost}."
    )


def _bare(report: Report) -> str:
    parts = []
    for fit in FITS[1:]:
        own = report["featured"][fit]
        parts.append(
            f"{fit} {middle(own['test_mm']):.3f} against {middle(own['random_mm']):.3f} mm "
            f"({own['ratio_of_medians']:.2f})"
        )
    return f"Identified otherwise from the same {report['dataset']['poses']} poses: {', '.join(parts)}."


def _replanned(report: Report) -> str:
    own = report["replanned"]
    return (
        f"Planned anew from other candidates and another wrong prior in each of {own['seeds']} seeds: "
        f"{show(own['test']['tasks_mm'])} mm against {show(own[RANDOM]['tasks_mm'])} mm, "
        f"{own['ratio_of_medians']:.2f} of random's median, random's best tenth "
        f"{own['random_best_tenth_mm']:.3f} mm; better in {own['wins']}; every plan at least "
        f"{100 * own['least_efficiency']:.1f} % efficient."
    )


def _promise(report: Report) -> str:
    rows = report["promises"]
    off = [row["gco_over_expected"] - 1 for row in rows]
    inside = [row["inside_90_percent"] for row in rows]
    return (
        f"Promises where the model is linear, {rows[0]['arms']} arms drawn from the prior: simulated over "
        f"promised error {1 + min(off):.2f} to {1 + max(off):.2f} (aim within {100 * PROMISE:.0f} %"
        f"{'' if max(map(abs, off)) <= PROMISE else ': MISSED'}); the 90 % interval holds "
        f"{100 * min(inside):.0f} to {100 * max(inside):.0f} % of them."
    )


def _reality(report: Report) -> str:
    ratios = []
    for row in report["errors"][FITS[0]]["test"]:
        plan = _plan(report, "test", row["poses"])
        if plan:
            ratios.append((row["poses"], middle(row["tasks_mm"]) / plan["expected_tasks_mm"]))
    words = ", ".join(f"{poses} poses {ratio:.2f}" for poses, ratio in ratios)
    return (
        "On the true arm, which bends, has links outside the model and no prior drawn for it: simulated over "
        f"promised error {words}."
    )


def _worth(report: Report) -> str:
    base, *others = report["worth"]
    words = ", ".join(
        f"{row['variant']} {row['expected_tasks_mm']:.3f} ({middle(row['judged']['tasks_mm']):.3f})"
        for row in others
    )
    return (
        f"What else would help, promised error at the tasks (simulated median) in mm: {base['variant']} "
        f"{base['expected_tasks_mm']:.3f} ({middle(base['judged']['tasks_mm']):.3f}); {words}."
    )


def markdown(report: Report) -> str:
    """report.md."""
    first, *others = statements(report)
    lines = [f"# {report['scenario']}", "", f"{title(report)}.", "", f"**{first}**", ""]
    lines += [f"- {text}" for text in others]
    for fit in FITS:
        lines += ["", f"## Error at the tasks, mm: {fit}", "", *_curve(report, fit, "tasks_mm")]
        lines += ["", f"## Error over the workspace, mm: {fit}", "", *_curve(report, fit, "workspace_mm")]
    lines += ["", "## Plans", "", *_plans(report), "", _criterion_words(), ""]
    lines += ["## Promises, arms drawn from the prior, linear truth", "", *_promises(report), ""]
    lines += ["## Candidates", "", _candidates(report), ""]
    return "\n".join(lines)


def _curve(report: Report, fit: str, key: str) -> list[str]:
    errors: dict[str, list[Report]] = report["errors"][fit]
    head = ["poses", *errors]
    rows = [
        [str(row["poses"]), *(show(own[k][key]) for own in errors.values())]
        for k, row in enumerate(errors[RANDOM])
    ]
    return grid(head, rows)


def _plans(report: Report) -> list[str]:
    head = ["criterion", "poses", "efficient, at least %", "seen of", "promised tasks, mm (90 %)"]
    head += ["promised workspace, mm", "O1", "O2", "O3", "O4", "O5", "seconds"]
    return grid(head, [_plan_cells(plan) for plan in report["plans"]])


def _plan_cells(plan: dict[str, Any]) -> list[str]:
    return [
        plan["criterion"],
        str(plan["poses"]),
        f"{100 * plan['efficiency']:.1f}",
        f"{plan['directions_seen']} / {plan['directions_of_loads']}",
        f"{plan['expected_tasks_mm']:.3f} ({plan['expected_tasks_p05_mm']:.3f} to "
        f"{plan['expected_tasks_p95_mm']:.3f})",
        f"{plan['expected_workspace_mm']:.3f}",
        *(f"{plan['observability'][key]:.2g}" for key in ("o1", "o2", "o3", "o4", "o5")),
        f"{plan['seconds']:.1f}",
    ]


def _criterion_words() -> str:
    words = "; ".join(f"{name}: {text}" for name, text in WORDS.items() if name != RANDOM)
    return (
        f"Criteria: {words}. Efficient: the plan's share of the best value that as many of the poses "
        "examined can reach, by the equivalence theorem; D by det^(1/r), test, I, A and G by variances (the "
        "error's share is its square root), E by the least eigenvalue."
    )


def _promises(report: Report) -> list[str]:
    head = ["plan", "poses", "promised, mm", "simulated GCO, mm", "LS, mm", "ratio", "in 90 % interval"]
    rows = [
        [
            row["plan"],
            str(row["poses"]),
            *(f"{row[key]:.4f}" for key in ("expected_mm", "gco_mm", "ls_mm")),
            f"{row['gco_over_expected']:.3f}",
            f"{100 * row['inside_90_percent']:.0f} %",
        ]
        for row in report["promises"]
    ]
    return grid(head, rows)


def _candidates(report: Report) -> str:
    own = report["candidates"]
    refused = ", ".join(f"{reason} {n}" for reason, n in own["rejected"].items() if n)
    return (
        f"{own['found']} feasible of {own['drawn']} drawn evenly over the joint limits; refused: {refused}."
    )
