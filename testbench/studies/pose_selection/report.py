"""What the trials say: plans beside random poses, whether promises hold, what else would help."""

from collections.abc import Iterator
from dataclasses import replace

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import build_cell
from testbench.bench.truths import CALLED
from testbench.data.csvfile import write_csv
from testbench.report.columns import KNOWN, columns
from testbench.report.report import Report, say
from testbench.report.table import Row, Trials
from testbench.studies.pose_selection.drawn import drawn
from testbench.studies.pose_selection.measure import build_bench
from testbench.studies.pose_selection.numbers import numbers
from testbench.studies.pose_selection.settings import BARE, INCUMBENT, NAME, PLANNED, RANDOM, Settings
from testbench.studies.pose_selection.trial import first_runs
from testbench.studies.study import Run
from testbench.trials.spread import middle, most_trials, span
from testbench.views.colours import GREY, SERIES, Look
from testbench.views.figure import Figure, forest, of_seeds, sweeps
from testbench.views.gains import more
from testbench.views.markdown import Markdown, counted
from testbench.views.scene import Seen
from testbench.views.schema import Table, pivot

CRITERIA = "plan efficiency_percent expected_tasks_mm tasks_mm workspace_mm"
PLANS = (
    "criterion poses efficiency_percent observability.seen observability.of expected_tasks_mm "
    "expected_tasks_p05_mm expected_tasks_p95_mm expected_workspace_mm observability.o1 observability.o2 "
    "observability.o3 observability.o4 observability.o5 seconds"
)
FORECASTS = "plan poses expected_mm gco_mm ls_mm gco_over_expected inside_90"
KEPT = "promised count inside_90 below above inside_95 over_promised"
VARIANTS = (
    "variant poses directions with_first_load efficiency_percent expected_tasks_mm tasks_mm workspace_mm"
)
GROUNDS = (
    "ground fit expected_tasks_mm tasks.planned_mm tasks.random_mm tasks.ratio tasks.wins "
    "workspace.planned_mm workspace.random_mm workspace.ratio workspace.wins workspace.better_than_joints"
)
LOOKS = {
    **{name: Look(SERIES[k], k, prior=False) for k, name in enumerate(("test", "I", "D", "A", "E", "G"))},
    RANDOM: Look(GREY, 0, prior=True),
}
"""Colour and mark of every criterion, random poses dashed."""
PLACES = {"tasks_mm": "at the tasks", "workspace_mm": "over the workspace"}
OF_CRITERIA = Markdown(
    "All errors are root mean squares against the true deflection. Criteria: test: error at the tasks; I: "
    "mean error over the workspace; D: volume of the confidence region; A: mean variance of the unknowns; E: "
    "worst seen direction; G: worst error over the workspace."
)
OF_PLANS = Markdown(
    "Efficient: the plan's share of the best value that as many of the poses examined can reach, by the "
    "equivalence theorem. D counts det^(1/r), E the least eigenvalue; test, I, A and G count variances, and "
    "the error's share is their square root."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads over the trials, the number of poses to measure, and who is best."""
    f = numbers(asked, seeds, trials)
    n, best, curved = f.dataset.poses, f.verdict.tasks, _by_poses(f)
    marked = best[0] if len(best) == 1 else ""
    by, pays = f"{n} poses by criterion", "Where planning pays: two grounds, a plan for every fit"
    drawn_arms = "Forecasts on arms drawn from the prior, linear truth"
    true_arms, kept = "Promises on true arms of the family, with wrong priors", [*f.kept, f.kept_joints]
    return Report(
        scenario=NAME,
        question=say("Which {n} poses, to predict best where the robot works?", n=n),
        title=_title(f),
        answer=say(
            "{n} planned poses leave {a.ours_mm:~.3f} mm at the tasks, random ones {a.theirs_mm:~.3f} mm: "
            "{a:less trial}. Joints alone leave {b.theirs_mm:~.3f} mm there from planned poses, "
            "{b:more trial}.",
            n=n,
            a=f.gains.random,
            b=f.gains.joints,
        ),
        worst=say(
            "Worst task {task_mm:.3f} mm, worst place of the workspace {workspace_mm:.3f} mm: medians pose "
            "by pose. Planning {how} with {case}: {ratio:.2f} times the error of random poses.",
            f.worst,
            how="loses most" if f.worst.ratio >= 1 else "gains least",
        ),
        claims=[*_claims(f), *_more(f)],
        numbers=f,
        tables={
            "criteria": Table(columns(CRITERIA), f.criteria, by, marked, "tasks_mm", looks=LOOKS),
            **curved,
            "grounds": Table(columns(GROUNDS), f.grounds, pays),
            "plans": Table(columns(PLANS), f.plans, "Plans"),
            "forecasts": Table(columns(FORECASTS), f.promises, drawn_arms),
            "kept": Table(columns(KEPT), kept, true_arms),
            "variants": Table(columns(VARIANTS), f.worth, "Other ways to measure"),
        },
        body=[
            *("criteria", OF_CRITERIA, *curved, "grounds", _of_grounds(f), "plans", OF_PLANS, "forecasts"),
            *("kept", _of_kept(f), "variants", _of_candidates(f)),
        ],
    )


def _by_poses(f: Row) -> dict[str, Table]:
    """Errors of every fit over the number of poses, criterion by criterion."""
    found = {}
    for fit, levels in f.errors.items():
        rows = [level for own in levels.values() for level in own]
        for key, where in PLACES.items():
            table = Table((), rows, f"Error {where}, mm: {fit}")
            name = f"{key.removesuffix('_mm')}, {fit}"
            found[name] = pivot(table, KNOWN["poses"], KNOWN["plan"], KNOWN[key])
    return found


def _trials(f: Row) -> int:
    return len(f.seed) if isinstance(f.seed, list) else 1


def _title(f: Row) -> Markdown:
    """What was measured."""
    several = "{n} seeds: median ({ends})" if isinstance(f.seed, list) else "seed {seed}"
    return say(
        "{arm} under {payload_kg:g} kg, sigma {dataset.sigma_um:g} um, tracker at {at} m. Plans from "
        "{candidates.found} feasible poses, judged in {dataset.tasks} tasks and {dataset.workspace_poses} "
        f"poses of the workspace. Non-linear truth, {several}.",
        f,
        at=", ".join(f"{metres:g}" for metres in f.tracker_m),
        n=_trials(f),
        ends=span(_trials(f)),
    )


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    own = f.verdict
    yield say(
        "Least error at the tasks of all plans, random poses among them: {tasks}. Over the workspace: "
        "{workspace}.",
        tasks=_best(f, "tasks"),
        workspace=_best(f, "workspace"),
    )
    yield _number(f)
    if own.loses:
        yield say(
            "Planning loses to random poses in {loses} of {n} cases (table of grounds): the criterion "
            "counts the tasks only.",
            loses=len(own.loses),
            n=2 * len(f.grounds),
        )
    else:
        yield Markdown(
            "On both grounds every plan has a smaller median error than random poses, at the tasks and over "
            "the workspace."
        )
    yield say(
        "Promises of `testbench plan`: the 90 % interval of the error holds in {inside_90:yes} of {count} "
        "cases, the 95 % interval of a deflection in {inside_95:yes}.",
        f.kept[0],
    )
    if own.helps:
        yield say(
            "What else would help most: {helps:list}{alike}, {mm:~.3f} mm at the tasks in place of "
            "{base:~.3f} mm.",
            own,
            alike=" (alike)" * (len(own.helps) > 1),
            mm=next(row.tasks_mm for row in f.worth if row.variant == own.helps[0]),
            base=f.worth[0].tasks_mm,
        )
    elif len(f.worth) > 1:
        yield Markdown("None of the other ways to measure leaves less error at the tasks.")


def _best(f: Row, where: str) -> Markdown:
    """The plans of least error somewhere, with it."""
    best = f.verdict[where]
    words = [f"{row.plan} {middle(row[f'{where}_mm']):.3f} mm" for row in f.criteria if row.plan in best]
    return say("{words}{alike}", words=", ".join(words), alike=" (alike)" * (len(best) > 1))


def _number(f: Row) -> Markdown:
    """How many poses to measure."""
    own = f.recommendation
    few = "{fewest.test} planned poses keep" if own.fewest.test else "No number of planned poses tried keeps"
    beyond = " Every step tried still pays." * (len(f.study.poses) > 1)
    if own.little_more_beyond:
        beyond = " Beyond {little_more_beyond} poses {step} more take less than {little_percent:g} % off."
    return say(
        f"{few} the tasks within {{within_mm:g}} mm in {{trials}}; random ones: {{random}}.{beyond}",
        own,
        trials=most_trials(_trials(f)),
        random=own.fewest[RANDOM] or "more than tried",
    )


def _more(f: Row) -> Iterator[Markdown]:
    """What stands under More: why, and how far forecasts and promises hold."""
    own, first = f.verdict, f.featured[PLANNED.name]
    yield say(
        "The planned error is {ratio_of_medians:.2f} of the random median, and {worse} than the best tenth "
        "of random poses ({random_best_tenth_mm:.3f} mm).",
        first,
        worse="no worse" if first.beats_best_tenth else "worse",
    )
    if own.no_better:
        yield say("No better than random poses at the tasks: {no_better:list}.", own)
    yield say(
        "No {poses} of the poses examined have a forecast below {least_promise_mm:.3f} mm. Without any noise "
        "{noise_free_mm.test:.3f} mm stay, with random poses {noise_free_mm.random:.3f} mm: links outside "
        "the model, a wrong prior, an arm that bends.",
        f.possible,
    )
    if others := [fit for fit, row in list(f.featured.items())[1:] if row.ratio_of_medians >= 1]:
        yield say("Identified otherwise than planned for, planning loses with {others:list}.", others=others)
    yield say(
        "Planned anew in {trials}, from other candidates and another wrong prior: {test.tasks_mm:.3f} mm, "
        "random {random.tasks_mm:.3f} mm. The plan is better in {wins} of {seeds}. Every plan is at least "
        "{least_efficiency_percent:.1f} % efficient.",
        f.replanned,
        trials=counted(f.replanned.seeds, "trial"),
    )
    yield say(
        "Forecasts, tried on {arms} linear arms drawn from the prior: simulated over forecast error is "
        "{ratio[0]:.2f} to {ratio[1]:.2f}. The 90 % interval holds {inside[0]:yes} to {inside[1]:yes} of "
        "them. On the true arm, which bends and has links outside the model, the ratio is {true}.",
        own,
        arms=f.promises[0].arms,
        true=", ".join(f"{ratio:.2f} ({poses} poses)" for poses, ratio in own.true_arm),
    )
    yield say(
        "Promises hold least often with {least.promised}: {least.inside_90:yes} and {least.inside_95:yes}. "
        "Simulated over promised error is {whole.over_promised:.2f} in all cases, of joints alone "
        "{joints.over_promised:.2f}: a promise takes the links to be of any shape, and all to be as "
        "soft as the prior is.",
        least=min(f.kept[1:], key=lambda row: float(row.inside_95)),
        whole=f.kept[0],
        joints=f.kept_joints,
    )


def _of_grounds(f: Row) -> Markdown:
    return say(
        "Plans by criterion test, each made for the fit that identifies the runs; random poses from the same "
        "candidates; counts are of seeds. The true arm is another one in every seed, in turn: {arms}. At the "
        "side: another station, other candidates, other tasks. The criterion counts only the tasks, and only "
        "unknowns that the fit has: elsewhere a plan may lose.",
        arms=", ".join(CALLED.get(arm, arm) for arm in f.truths),
    )


def _of_kept(f: Row) -> Markdown:
    return say(
        "Promised as by `testbench plan`, for arms within {believed_within_percent:g} % of the prior; all "
        "links and joints with a learnt prior, in the last row joint compliances by least squares. An "
        "interval of 90 % should hold in 87 to 95 %, one of 95 % in 93 to 98 %: below, promises of that kind "
        "are too bold, above too timid. Their widths were measured on other seeds, over all cases together.",
        f.prior,
    )


def _of_candidates(f: Row) -> Markdown:
    refused = ", ".join(f"{reason} {count}" for reason, count in f.candidates.rejected.items() if count)
    return say(
        "Candidates: {found} feasible of {drawn} drawn evenly over the joint limits. Refused: {refused}.",
        vars(f.candidates),
        refused=refused,
    )


def figures(found: Report) -> dict[str, Figure]:
    """Errors by criterion and by number of poses, what plans bring, and what else would help."""
    f = Row(found.numbers)
    gain, several = f.gains.random, len(f.study.poses) > 1
    answer = (
        f"{f.dataset.poses} planned poses leave {middle(gain.ours_mm):.3f} mm at the tasks, random ones "
        f"{middle(gain.theirs_mm):.3f} mm, {more(gain)}"
    )
    reading = f"RMS errors, {f.arm}, {f.dataset.sigma_um:g} um of noise. {of_seeds(f.seed)}."
    made = {"curves.png": _curves(f, answer, reading.replace("lines:", "bands:"))} if several else {}
    made["featured.png"] = forest(
        found.tables["criteria"],
        PLACES,
        answer,
        f"{reading} {PLANNED.name}, plans by criterion; dotted line: random poses.",
        RANDOM,
    )
    made["grounds.png"] = forest(
        _one_look(
            "fit tasks.ratio workspace.ratio", [r | {"fit": f"{r.fit}, {r.ground}"} for r in f.grounds]
        ),
        {"tasks.ratio": "at the tasks", "workspace.ratio": "over the workspace"},
        f"Planning loses to random poses in {len(f.verdict.loses)} of {2 * len(f.grounds)} cases",
        "Ratios of median errors by fit and ground, plans made for each fit. A plan pays left of the line.",
        1.0,
    )
    if len(f.worth) > 1:
        made["variants.png"] = forest(
            _one_look("variant expected_tasks_mm tasks_mm", f.worth),
            {"expected_tasks_mm": "forecast", "tasks_mm": "simulated"},
            str(next(c for c in found.claims if "help most" in c or "other ways" in c)),
            f"{reading} At the tasks, {PLANNED.name}; dotted line: as the study measures.",
            f.worth[0].variant,
        )
    return made


def _curves(f: Row, answer: str, reading: str) -> Figure:
    """Errors over the number of poses, beside them those without the prior and of joints alone."""
    kinds = (PLANNED, BARE, INCUMBENT)
    levels = [[row for own in f.errors[fit.name].values() for row in own] for fit in kinds]
    rows = [Row(own, bare=bare, joints=joints) for own, bare, joints in zip(*levels, strict=True)]
    others = {
        "bare.tasks_mm": "at the tasks, identified without prior",
        "joints.tasks_mm": "at the tasks, joints alone by least squares",
    }
    shown = [*columns("tasks_mm workspace_mm"), *(replace(KNOWN["tasks_mm"], key=k) for k in others)]
    panes = {
        (PLACES | others)[column.key]: Table((*columns("plan poses"), column), rows, looks=LOOKS)
        for column in shown
    }
    return sweeps(panes, answer, reading, ("test", RANDOM))


def _one_look(keys: str, rows: list[Row]) -> Table:
    """A table whose rows are all of plans for the tasks."""
    name = keys.split(" ")[0]
    return Table(columns(keys), rows, looks={row[name]: LOOKS["test"] for row in rows})


def write(run: Run[Settings]) -> Seen:
    """dataset.csv of the first seed; what is drawn: the featured plan, and where errors remain."""
    cell = build_cell(find_arm(run.settings.arm))
    bench = build_bench(cell, run.settings)
    write_csv(first_runs(bench, run.settings, run.seeds[0]), cell.arm, run.folder / "dataset.csv")
    return drawn(run, bench)
