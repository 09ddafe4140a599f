"""What the trials say: plans beside random poses, where planning loses, whether promises hold."""

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.arm.mjcf import GRAVITY
from testbench.campaign.campaign import build_cell
from testbench.campaign.candidates import REASONS
from testbench.campaign.perturbed_prior import SCALE, SHAPE, UNCERTAINTY
from testbench.campaign.rows import MM
from testbench.campaign.true_arms import CALLED, TRUTHS
from testbench.commands.plan_drawn import ORDER, OURS, UNSCALED, World
from testbench.data.write import write_csv
from testbench.design.rows import deflection_rows
from testbench.design.specification import promise_of
from testbench.errors import Array
from testbench.model.vjm import chain
from testbench.report.columns import columns
from testbench.report.report import Report, say
from testbench.report.table import Row, Trials, find, merged, number
from testbench.studies.pose_selection import settings as s
from testbench.studies.pose_selection.settings import BARE, INCUMBENT, PLANNED, RANDOM, Settings
from testbench.studies.pose_selection.trial import build_bench, first_runs, poses_of
from testbench.studies.study import Run
from testbench.trials.spread import ends, middle, most_trials, span, wins
from testbench.views.colours import GREY, SERIES, Look
from testbench.views.figure import Figure, forest, of_seeds, sweeps
from testbench.views.gains import gained, more
from testbench.views.markdown import Markdown
from testbench.views.scene import Line, PlaceMap, RunChart, Scene, Seen
from testbench.views.schema import Table, best_of

ENOUGH = 0.1  #: Error at the tasks that a campaign is to reach [mm].
STEP, LITTLE = 4, 0.10  #: So many more poses that take less than this share off are not worth a hoist.
CRITERIA = "plan efficiency_percent expected_tasks_mm tasks_mm workspace_mm"
OF_CRITERIA = Markdown(
    "RMS errors. *test* counts the error at the tasks, I that over the workspace, G the largest there; D the "
    "volume of the confidence region, A the mean variance, E the worst seen direction."
)
KEPT = "promised count inside_90 below above inside_95 over_promised"
GROUNDS = (
    "ground fit expected_tasks_mm tasks.planned_mm tasks.random_mm tasks.ratio tasks.wins "
    "workspace.planned_mm workspace.random_mm workspace.ratio workspace.wins workspace.better_than_joints"
)
KEPT_BY: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "poses": ("plan", {"test": "planned"}),
    "tasks": ("ground", {}),
    "truth": ("truth", CALLED),
    "prior": ("prior", {}),
}
"""What promises are told by: column, and what its words are called."""
PLACES = {"tasks_mm": "at the tasks", "workspace_mm": "over the workspace"}
LOOKS = {
    **{name: Look(SERIES[k], k, prior=False) for k, name in enumerate(("test", "I", "D", "A", "E", "G"))},
    RANDOM: Look(GREY, 0, prior=True),
}
"""Colour and mark of every criterion, random poses dashed."""


def numbers(asked: Settings, seeds: range, trials: Trials) -> Row:
    """Every number of report.json."""
    scope, scene, n = asked.scope, asked.scene, asked.scope.featured
    measured = trials.where(part="measured")
    errors, featured = _errors(asked, measured), measured.where(poses=n, fit=PLANNED.name)
    first, promises = featured.where(plan="test"), trials.where(part="promise")
    models = [row.model for row in merged(featured.keep("plan", "model."), "plan")]
    data = merged(first.where(seed=seeds[0]).keep("model.data."))[0].model.data
    counts = {name: int(data[name]) for name in ("runs", "points")}
    where = merged(first.keep("where."))[0].where
    f = Row(
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=find_arm(asked.arm).resolve().name,
        payload_kg=scope.payload,
        prior=Row(scale=SCALE, shape_percent=100 * SHAPE, believed_within_percent=100 * UNCERTAINTY),
        tracker_m=scope.ground.station,
        dataset=Row(data, **counts, poses=n, tasks=scope.tasks, workspace_poses=scope.workspace),
        candidates=Row(
            found=len(scene.candidates),
            drawn=scene.drawn,
            rejected=dict(zip(REASONS, scene.rejected, strict=True)),
        ),
        models=[model | {"parameters": int(model.parameters), "paper": None} for model in models],
        where=where,
        plans=[plan for plan in scene.plans if plan.fit == PLANNED.name],
        errors=errors,
        recommendation=_recommended(errors[PLANNED.name]),
        kept=list(_all_kept(promises.where(fit=s.WHOLE.name))),
        kept_joints=_kept(INCUMBENT.name, promises.where(fit=INCUMBENT.name)),
        grounds=[row for there in (asked, s.elsewhere(asked)) for row in _ground(there, trials)],
        study=scope,
        criteria=[find(levels, poses=n) for levels in errors[PLANNED.name].values()],
        gains=_gains(measured.where(poses=n)),
    )
    cases = [
        Row(own[key], case=f"{own.fit} {where} {own.ground}")
        for own in f.grounds
        for key, where in (("tasks", "at the tasks,"), ("workspace", "over the workspace, planned"))
    ]
    task, place = (max(map(middle, mm)) for mm in (where.tasks_mm, where.workspace_mm))
    worst = max(cases, key=lambda case: float(case.ratio))
    f["worst"] = Row(worst, task_mm=task, workspace_mm=place)
    f["verdict"] = Row(
        {key.removesuffix("_mm"): best_of({c.plan: c[key] for c in f.criteria}).names for key in PLACES},
        cases=len(cases),
        loses=[f"{own.case} ({own.ratio:.2f}, {own.wins} of {own.seeds})" for own in cases if own.ratio >= 1],
    )
    return f


def _errors(asked: Settings, measured: Trials) -> Row:
    """Errors by fit, by plan, by number of poses; of a plan with its forecast."""
    found = Row()
    for (fit, name, poses), own in measured.groups("fit", "plan", "poses"):
        [level] = merged(own.keep("plan", "poses", *PLACES))
        plan = None if name == RANDOM else asked.scene.plan(name, poses, PLANNED.name)
        keys = "efficiency_percent", "expected_tasks_mm"
        level |= {key: plan and getattr(plan, key) for key in keys}
        found.setdefault(fit, Row()).setdefault(name, []).append(level)
    return found


def _recommended(levels: Row) -> Row:
    """How many poses: the fewest that are enough in 95 % of all trials, and where more bring little."""
    fewest = {
        name: next((level.poses for level in levels[name] if ends(level.tasks_mm)[1] <= ENOUGH), None)
        for name in ("test", RANDOM)
    }
    little = None
    for level, following in pairwise(levels.test):
        gain = middle(following.tasks_mm) / middle(level.tasks_mm)
        if little is None and 1 - gain ** (STEP / (following.poses - level.poses)) < LITTLE:
            little = level.poses
    return Row(within_mm=ENOUGH, fewest=Row(fewest), little_more_beyond=little, step=STEP)


def _all_kept(promises: Trials) -> Iterator[Row]:
    """All promises, then those of each plan, ground, truth and prior."""
    yield _kept("all", promises)
    for what, (column, called) in KEPT_BY.items():
        groups = {called.get(name, name): own for (name,), own in promises.groups(column)}
        for name in sorted(groups):
            yield _kept(f"{what}: {name}", groups[name])


def _kept(promised: str, own: Trials) -> Row:
    """Shares of 90 % intervals that hold the error, of errors beside them, of 95 % intervals that hold."""
    error = own["tasks_mm"]
    below, above = (float(np.mean(x)) for x in (error < own["expected.p05"], error > own["expected.p95"]))
    return Row(
        promised=promised,
        count=len(own),
        inside_90=1 - below - above,
        below=below,
        above=above,
        inside_95=float(np.mean(own["inside"])),
        over_promised=number(error / own["expected.expected"]),
    )


def _ground(asked: Settings, trials: Trials) -> Iterator[Row]:
    """Every fit with its own plan on one ground, beside random poses and beside joints alone."""
    n, ground = asked.scope.featured, asked.scope.ground.name
    here = trials.where(part="ground", ground=ground)
    for fit in s.FITS:
        ways = [
            here.where(plan=plan, fit=own.name)
            for plan, own in (("test", fit), (RANDOM, fit), ("test", INCUMBENT))
        ]
        yield Row(
            ground=ground,
            fit=fit.name,
            expected_tasks_mm=asked.scene.plan("test", n, fit.name).expected_tasks_mm,
            tasks=_against(*(own["tasks_mm"] for own in ways)),
            workspace=_against(*(own["workspace_mm"] for own in ways)),
        )


def _against(plan: Array, chance: Array, joints: Array) -> Row:
    """Errors of a plan made for the very fit, against random poses, and joints alone from their own plan."""
    return Row(
        planned_mm=number(plan),
        random_mm=number(chance),
        ratio=float(np.median(plan) / np.median(chance)),
        wins=wins(plan, chance),
        better_than_joints=wins(plan, joints),
        seeds=len(plan),
    )


def _gains(own: Trials) -> Row:
    """The featured plan beside random poses, and beside joints alone from poses planned likewise."""
    plan, chance, joints = (
        own.where(plan=name, fit=fit.name)["tasks_mm"].tolist()
        for name, fit in (("test", PLANNED), (RANDOM, PLANNED), ("test", INCUMBENT))
    )
    return Row(
        random=gained("planned", RANDOM, plan, chance),
        joints=gained(PLANNED.name, INCUMBENT.name, plan, joints),
    )


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Who is best, how many poses to measure, where planning loses, whether promises hold."""
    f = numbers(asked, seeds, trials)
    n, [marked, *alike] = f.dataset.poses, f.verdict.tasks
    by, pays = f"{n} poses by criterion", "Where planning pays: two grounds, a plan for every fit"
    kept = "Promises on true arms of the family, with wrong priors"
    several = "{k} seeds: median ({ends})" if isinstance(f.seed, list) else "seed {seed}"
    return Report(
        scenario=s.NAME,
        question=say("Which {n} poses, to predict best where the robot works?", n=n),
        title=say(
            "{arm} under {payload_kg:g} kg, sigma {dataset.sigma_um:g} um, tracker at {at} m. Plans from "
            "{candidates.found} feasible poses, judged in {dataset.tasks} tasks and "
            f"{{dataset.workspace_poses}} poses of the workspace. Non-linear truth, {several}.",
            f,
            at=", ".join(f"{metres:g}" for metres in f.tracker_m),
            k=len(seeds),
            ends=span(len(seeds)),
        ),
        answer=say(
            "{n} planned poses leave {a.ours_mm:~.3f} mm at the tasks, random ones {a.theirs_mm:~.3f} mm: "
            "{a:less trial}. Joint stiffness only leaves {b.theirs_mm:~.3f} mm there from planned poses, "
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
        claims=list(_claims(f, len(seeds))),
        numbers=f,
        tables={
            "criteria": Table(
                columns(CRITERIA), f.criteria, by, "" if alike else marked, "tasks_mm", looks=LOOKS
            ),
            "grounds": Table(columns(GROUNDS), f.grounds, pays),
            "kept": Table(columns(KEPT), [*f.kept, f.kept_joints], kept),
        },
        body=["criteria", OF_CRITERIA, "grounds", _of_grounds(), "kept", _of_kept(f)],
    )


def _claims(f: Row, trials: int) -> Iterator[Markdown]:
    """How many poses, where planning loses, whether promises hold."""
    own = f.recommendation
    few = "{fewest.test} planned poses keep" if own.fewest.test else "No number of planned poses tried keeps"
    beyond = " Every step tried still pays." * (len(f.study.poses) > 1)
    if own.little_more_beyond:
        beyond = " Beyond {little_more_beyond} poses {step} more take less than 10 % off."
    yield say(
        f"{few} the tasks within {{within_mm:g}} mm in {{trials}}; random ones: {{random}}.{beyond}",
        own,
        trials=most_trials(trials),
        random=own.fewest[RANDOM] or "more than tried",
    )
    lost = "On both grounds every plan has a smaller median error than random poses."
    if f.verdict.loses:
        lost = (
            "Planning loses to random poses in {loses} of {cases} cases: the criterion counts the tasks only."
        )
    yield say(lost, loses=len(f.verdict.loses), cases=f.verdict.cases)
    yield say(
        "Promises of `testbench plan`: the 90 % interval of the error holds in {inside_90:yes} of {count} "
        "cases, the 95 % interval of a deflection in {inside_95:yes}.",
        f.kept[0],
    )


def _of_grounds() -> Markdown:
    return say(
        "Plans by criterion test, made for the fit that identifies the runs; counts are of seeds, each with "
        "another true arm: {arms}. At the side: another station, other candidates, other tasks.",
        arms=", ".join(CALLED[arm] for arm in TRUTHS),
    )


def _of_kept(f: Row) -> Markdown:
    return say(
        "Arms within {believed_within_percent:g} % of the prior; all links and joints with a learnt prior, "
        "in the last row joints by least squares. An interval of 90 % should hold in 87 to 95 %, one of 95 % "
        "in 93 to 98 %: below, promises are too bold, above too timid.",
        f.prior,
    )


def figures(found: Report) -> dict[str, Figure]:
    """Errors by number of poses, with and without the prior; of one number by criterion."""
    f = Row(found.numbers)
    gain = f.gains.random
    answer = (
        f"{f.dataset.poses} planned poses leave {middle(gain.ours_mm):.3f} mm at the tasks, random ones "
        f"{middle(gain.theirs_mm):.3f} mm, {more(gain)}"
    )
    reading = f"RMS errors, {f.arm}, {f.dataset.sigma_um:g} um of noise. {of_seeds(f.seed)}."
    if len(f.study.poses) == 1:
        note = f"{reading} {PLANNED.name}, plans by criterion; dotted line: random poses."
        return {"pose_selection.png": forest(found.tables["criteria"], PLACES, answer, note, RANDOM)}
    panes = {
        f"{PLACES[key]}{words}": Table(
            columns(f"plan poses {key}"),
            [row for own in f.errors[fit.name].values() for row in own],
            looks=LOOKS,
        )
        for fit, key, words in (
            (PLANNED, "tasks_mm", ""),
            (PLANNED, "workspace_mm", ""),
            (BARE, "tasks_mm", ", identified without prior"),
            (INCUMBENT, "tasks_mm", ", joint stiffness only by least squares"),
        )
    }
    return {
        "pose_selection.png": sweeps(panes, answer, reading.replace("lines:", "bands:"), ("test", RANDOM))
    }


def write(run: Run[Settings]) -> Seen:
    """dataset.csv of the first seed; what is drawn: the featured plan, and where errors remain."""
    asked, cell = run.settings, build_cell(find_arm(run.settings.arm))
    bench, n, scene = build_bench(cell, asked), asked.scope.featured, asked.scene
    write_csv(first_runs(bench, asked, run.seeds[0]), cell.arm, run.folder / "dataset.csv")
    chosen, places = poses_of(asked, "test", n, run.seeds[0]), np.array(scene.workspace)
    ahead = deflection_rows(bench.spec.experiment, chosen.q, bench.spec.loads[0])
    error = MM * promise_of(bench.spec, chosen.q, chosen.load, ahead).error
    left = np.array([middle(value) for value in run.report.numbers["where"].workspace_mm])
    at = [chain(cell.vjm, np.array(q)).position for q in (chosen.q, scene.tasks, scene.candidates, places)]
    world = World(cell, asked.scope.ground.station, *at[:3])
    runs, rest = (
        [f"Error {mm:.3f} mm. {cell.arm.words(own)}." for own, mm in zip(q, errors, strict=True)]
        for q, errors in ((chosen.q, error), (places, left))
    )
    force = np.tile([0.0, 0.0, -GRAVITY * asked.scope.payload], (n, 1))
    named = {f"Run {k}": words for k, words in enumerate(runs, start=1)}
    plan = world.poses(ORDER, named, chosen.q, world.measured(chosen.q, force))
    over = "Error of the predicted deflection, median over the trials (mm)"
    ahead_mm = "Error to expect after identification, in each planned pose (mm)"
    return Seen(
        scene=Scene(cell, UNSCALED, [plan, world.all_over(places, rest, int(left.argmax()))]),
        map=PlaceMap(over, 1, at[3], [Line(PLANNED.name, OURS, left)]),
        runs=[RunChart(ahead_mm, 0, "run", [str(k) for k in range(1, n + 1)], [Line("plan", OURS, error)])],
    )
