"""The study of pose selection: plans by every criterion, made once for all trials, against random poses."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from testbench.arm.folder import find_arm
from testbench.arm.mjcf import GRAVITY
from testbench.design.exchange import Feasibility
from testbench.design.planning import forecast_errors, make_plan, observability
from testbench.design.rows import task_rows
from testbench.model.vjm import chain
from testbench.plant.site import Payload
from testbench.plant.tracker import Station, trial_rng
from testbench.plant.true_arms import TRUE_ARM_LABELS
from testbench.report.badge import of_rivals
from testbench.report.colours import GREY, SERIES, Look
from testbench.report.figure import Figure, forest, sweeps
from testbench.report.planned_poses import ORDER, OURS, UNSCALED, World
from testbench.report.report import Report, say
from testbench.report.scene import ModelLine, PageContent, PlaceMap, Scene
from testbench.report.schema import Table, columns
from testbench.report.table import Row, Trials, merged, number
from testbench.runs.spread import ends, independent, middle, span, wins
from testbench.studies import campaigns
from testbench.studies.planning import trial
from testbench.studies.planning.trial import (
    ANYWHERE,
    AWAY,
    BARE,
    FITS,
    HOME,
    INCUMBENT,
    NAME,
    PLANNED,
    RANDOM,
    WHOLE,
    PlannedRow,
    PlanningOptions,
    PlanningScene,
    PlanningSettings,
    Scope,
    elsewhere,
    settings,
    specify,
)
from testbench.studies.run import READ, headline, warnings
from testbench.studies.study import Everywhere, Run, Study
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.models import SCALE, SHAPE, UNCERTAINTY, wrong_prior
from testbench.workflows.plan_input import PoseConditions, build_checks, feasible, find
from testbench.workflows.predicted_error import forecast_summary

AWAY_STREAM = 20  #: Streams of the other ground, over those of the first.

Job = tuple[PlanningSettings, str, str, int]
"""A plan to be made: the study on its ground, the fit that it is for, the criterion, how many poses."""


def prepare(asked: PlanningSettings, everywhere: Everywhere) -> PlanningSettings:
    """Make the scenes and all plans, the same for all trials; PoseError for too few feasible poses.

    Args:
        asked: Settings of the study.
        everywhere: Does pieces of work on all cores.

    Returns:
        The settings with their scenes.
    """
    cell = build_cell(find_arm(asked.arm))
    asked = replace(asked, scene=_scene(cell, asked, 0))
    asked = replace(asked, away=_scene(cell, elsewhere(asked), AWAY_STREAM))
    rows = everywhere(partial(_plan_rows, asked), len(_jobs(asked)), PlannedRow, "plans")
    home, away = (tuple(row for row in rows if row.ground == ground.name) for ground in (HOME, AWAY))
    return replace(asked, scene=replace(asked.scene, plans=home), away=replace(asked.away, plans=away))


def _scene(cell: Cell, asked: PlanningSettings, first: int) -> PlanningScene:
    """Candidates, tasks and workspace of a ground; the streams of their randomness begin at `first`."""
    scope, rng = asked.scope, trial_rng(asked.seed, first)
    drawn = (
        (_conditions(scope), scope.candidates, trial_rng(asked.seed, first + 1)),
        (PoseConditions(area=scope.ground.area), scope.tasks, rng),
        (PoseConditions(area=ANYWHERE), scope.workspace, rng),
    )
    found = (find(build_checks(cell, conditions), count, own).q for conditions, count, own in drawn)
    candidates, tasks, workspace = (tuple(map(tuple, q.tolist())) for q in found)
    return PlanningScene(candidates, tasks, workspace)


def _conditions(scope: Scope) -> PoseConditions:
    return PoseConditions(station=Station(scope.ground.station), payload=Payload(scope.payload))


def _jobs(asked: PlanningSettings) -> list[Job]:
    scope, there = asked.scope, elsewhere(asked)
    grounds = [*((asked, fit) for fit in FITS if fit != PLANNED), *((there, fit) for fit in FITS)]
    return [
        *((asked, PLANNED, name, poses) for name in scope.criteria for poses in scope.numbers(name)),
        *((on, fit, "test", scope.featured) for on, fit in grounds),
    ]


def _plan_rows(asked: PlanningSettings, numbers: Sequence[int]) -> list[list[PlannedRow]]:
    """Make plans by their numbers, one list each; `asked` holds the scene."""
    cell, jobs = build_cell(find_arm(asked.arm)), _jobs(asked)
    return [[_plan_row(cell, jobs[k])] for k in numbers]


def _plan_row(cell: Cell, job: Job) -> PlannedRow:
    there, fit, criterion, poses = job
    spec = replace(specify(cell, there, wrong_prior(cell, there.seed), fit), poses=poses)
    start, checks = time.perf_counter(), build_checks(cell, _conditions(there.scope))
    reach, q = Feasibility(lambda q: feasible(checks, q)), np.array(there.scene.candidates)
    best = make_plan(spec, criterion, q, reach, trial_rng(there.seed, 2))
    return PlannedRow(
        ground=there.scope.ground.name,
        fit=fit,
        criterion=criterion,
        poses=poses,
        q_rad=tuple(best.q.ravel().tolist()),
        seconds=time.perf_counter() - start,
        efficiency_percent=100 * best.efficiency,
        expected_tasks_mm=forecast_summary(forecast_errors(best, task_rows(spec))).expected,
        observability=observability(best.examined.problem, best.chosen),
    )


CRITERIA = "plan efficiency_percent expected_tasks_mm tasks_mm workspace_mm"
POSES = "plan poses tasks_mm workspace_mm expected_tasks_mm efficiency_percent"
TARGET_ERROR_MM = 0.1  #: Error at the tasks that a campaign is to reach [mm].
KEPT = "promised count inside_90 below above inside_95 over_promised"
GROUNDS = "ground fit judged planned_mm random_mm over_random planned_better better_than_joints seeds"
KEPT_BY: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "poses": ("plan", {"test": "planned"}),
    "tasks": ("ground", {}),
    "truth": ("truth", TRUE_ARM_LABELS),
    "prior": ("prior", {}),
}
"""What promises are told by: column, and what its words are called."""
PLACES = {"tasks_mm": "at the tasks", "workspace_mm": "over the workspace"}
LOOKS = {
    **{name: Look(SERIES[k], k, prior=False) for k, name in enumerate(("test", "I", "D", "A", "E", "G"))},
    RANDOM: Look(GREY, 0, prior=True),
}
"""Colour and mark of every criterion, random poses dashed."""


def _report(asked: PlanningSettings, seeds: range, trials: Trials) -> Report:
    """Report errors by criterion and number of poses, where planning pays, and whether promises hold."""
    f = _numbers(asked, seeds, trials)
    n, rivals = asked.scope.featured, [row.plan for row in f.criteria if row.plan != "test"]
    own = trials.where(part="measured", poses=n, fit=PLANNED)
    badge = of_rivals(own.add(name=own["plan"]), "test", rivals, "tasks_mm")
    badge = badge and replace(badge, what="task error")  # over the workspace another may be better
    criteria = Table(
        columns(CRITERIA), f.criteria, f"{n} poses by criterion", headline="tasks_mm", looks=LOOKS
    )
    return Report(
        scenario=NAME,
        question=say("Which {n} poses give the best predictions where the robot works?", n=n),
        title=say(
            "{arm} under {payload_kg:g} kg, noise {dataset.sigma_um:g} um, {study.candidates} candidates; "
            "non-linear truth, {seeds}",
            f | {"study": Row(vars(f.study))},
            seeds=campaigns.seeds_label(f.seed),
        ),
        answer=headline(badge, criteria),
        claims=warnings(trials.where(part="measured"), "fit"),
        numbers=f,
        tables={
            "criteria": criteria,
            "grounds": Table(
                columns(GROUNDS), f.grounds, "Where planning pays: two grounds, a plan for every fit"
            ),
            "kept": Table(
                columns(KEPT),
                [*f.kept, f.kept_joints],
                "Promises on true arms of the family, with wrong priors",
            ),
            "enough": Table(
                columns("plan fewest"),
                [Row(plan=name, fewest=n) for name, n in f.recommendation.fewest.items()],
                f"Poses that keep the tasks within {1000 * TARGET_ERROR_MM:g} um in 95 % of the trials",
            ),
            "poses": Table(
                columns(POSES),
                [row for row in f.errors if row.fit == PLANNED],
                f"Errors by number of poses, identified as {PLANNED}",
                headline="tasks_mm",
            ),
        },
        body=["criteria", "enough", "grounds", "kept", "poses", READ],
        badge=badge,
    )


def _numbers(asked: PlanningSettings, seeds: range, trials: Trials) -> Row:
    """Every number of report.json."""
    scope, n = asked.scope, asked.scope.featured
    measured, promises = trials.where(part="measured"), trials.where(part="promise")
    featured = measured.where(poses=n)
    models = [row.model for row in merged(featured.where(fit=PLANNED).keep("plan", "model."), "plan")]
    first = featured.where(plan="test", fit=PLANNED)
    errors = merged(measured.keep("fit", "plan", "poses", *PLACES), "fit", "plan", "poses")
    for row in errors:
        plan = None if row.plan == RANDOM else asked.scene.plan(row.plan, row.poses, PLANNED)
        row |= {key: plan and getattr(plan, key) for key in ("efficiency_percent", "expected_tasks_mm")}
    [each] = merged(first.keep("each_task_mm", "each_place_mm"))
    planned, own = [row for row in errors if row.fit == PLANNED], (*scope.criteria, RANDOM)
    [data] = merged(first.inside("model.measured"))
    return Row(
        seed=campaigns.seeds_of(seeds),
        arm=find_arm(asked.arm).resolve().name,
        payload_kg=scope.payload,
        prior=Row(scale=SCALE, shape_percent=100 * SHAPE, believed_within_percent=100 * UNCERTAINTY),
        tracker_m=scope.ground.station,
        dataset=Row(data, runs=n, poses=n, points=int(data.points), tasks=scope.tasks),
        models=[Row(model, parameters=int(model.parameters), paper=None) for model in models],
        where=each,
        plans=[plan for plan in asked.scene.plans if plan.fit == PLANNED],
        errors=errors,
        recommendation=Row(
            within_mm=TARGET_ERROR_MM, fewest=Row({name: _fewest(planned, name) for name in own})
        ),
        kept=list(_all_kept(promises.where(fit=WHOLE))),
        kept_joints=_kept(INCUMBENT, promises.where(fit=INCUMBENT)),
        grounds=list(_grounds(trials.where(part="ground"))),
        study=scope,
        criteria=[row for row in planned if row.poses == n],
    )


def _fewest(levels: Sequence[Row], plan: str) -> int | None:
    """The fewest poses that keep tasks within TARGET_ERROR_MM in 95 % of the trials, of few trials in all."""
    return next(
        (row.poses for row in levels if row.plan == plan and ends(row.tasks_mm)[1] <= TARGET_ERROR_MM), None
    )


def _all_kept(promises: Trials) -> Iterator[Row]:
    """All promises, then those of each plan, ground, truth and prior."""
    yield _kept("all", promises)
    for what, (column, called) in KEPT_BY.items():
        groups = {called.get(name, name): trials for (name,), trials in promises.groups(column)}
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
        independent=independent((error >= own["expected.p05"]) & (error <= own["expected.p95"]), own["seed"]),
        below=below,
        above=above,
        inside_95=float(np.mean(own["inside"])),
        over_promised=number(error / own["expected.expected"], own["seed"]),
    )


def _grounds(rows: Trials) -> Iterator[Row]:
    """Every fit with its own plan on both grounds, beside random poses and beside joints alone."""
    for (ground,), here in rows.groups("ground"):
        for fit in here.values("fit"):
            ways = (("test", fit), (RANDOM, fit), ("test", INCUMBENT))
            seeds = {*here.where(fit=fit)["seed"].tolist()}
            own = [here.where(plan=plan, fit=name, seed=seeds) for plan, name in ways]
            for key, where in PLACES.items():
                plan, chance, joints = (way[key] for way in own)
                yield Row(
                    ground=ground,
                    fit=fit,
                    judged=where,
                    planned_mm=number(plan),
                    random_mm=number(chance),
                    over_random=float(np.median(plan) / np.median(chance)),
                    planned_better=wins(plan, chance),
                    better_than_joints=wins(plan, joints),
                    seeds=len(plan),
                )


def _figures(found: Report) -> dict[str, Figure]:
    """Draw errors by number of poses, with and without the prior; of one number by criterion."""
    f = Row(found.numbers)
    answer = f"Errors after {f.dataset.poses} poses, planned and random"
    reading = f"RMS errors, {f.arm}, {f.dataset.sigma_um:g} um of noise."
    if len(f.study.poses) == 1:
        note = f"{reading} {PLANNED}, plans by criterion; dotted line: random poses."
        return {"pose_selection.png": forest(found.tables["criteria"], PLACES, answer, note, RANDOM)}
    own = [fit for fit in dict.fromkeys(row.fit for row in f.errors) if fit not in FITS]
    panes = {
        f"{PLACES[key]}{words}": Table(
            columns(f"plan poses {key}"),
            [row for row in f.errors if row.fit == fit],
            looks=LOOKS,
        )
        for fit, key, words in (
            (PLANNED, "tasks_mm", ""),
            (PLANNED, "workspace_mm", ""),
            (BARE, "tasks_mm", ", identified without prior"),
            (INCUMBENT, "tasks_mm", ", Joints-only by least squares"),
            *((fit, "tasks_mm", f", {fit}") for fit in own),
        )
    }
    seeds = len(f.seed) if isinstance(f.seed, list) else 1
    return {
        "pose_selection.png": sweeps(
            panes,
            answer,
            f"{reading} Medians, bands: {span(seeds)} of {seeds} seeds.",
            ("test", RANDOM),
        )
    }


def _write(run: Run[PlanningSettings]) -> PageContent:
    """Draw the featured plan, and where errors remain."""
    settings, cell = run.settings, build_cell(find_arm(run.settings.arm))
    n, scene = settings.scope.featured, settings.scene
    q, places = trial.poses_of(settings, "test", n, settings.seed), np.array(scene.workspace)
    left = np.array([middle(value) for value in run.report.numbers["where"].each_place_mm])
    at = [chain(cell.vjm, np.array(own)).position for own in (q, scene.tasks, scene.candidates, places)]
    world = World(cell, settings.scope.ground.station, at[0], at[1], at[2])
    force = np.tile([0.0, 0.0, -GRAVITY * settings.scope.payload], (n, 1))
    named = {f"Run {k}": f"{cell.arm.pose_text(own)}." for k, own in enumerate(q, start=1)}
    rest = [f"Error {mm:.3f} mm. {cell.arm.pose_text(own)}." for own, mm in zip(places, left, strict=True)]
    plan = world.poses(f"{ORDER}: test", named, q, world.measured(q, force), ordered=True)
    over = "Error of the predicted deflection, median over the trials (mm)"
    return PageContent(
        scene=Scene(cell, UNSCALED, [plan, world.all_over(places, rest, int(left.argmax()))]),
        map=PlaceMap(over, 1, at[3], [ModelLine(f"{PLANNED}, poses by test", OURS, left)]),
    )


STUDY = Study(
    name=NAME,
    about="Plan 4 to 40 poses by six criteria, measure them, identify, and judge where the robot works.",
    options=PlanningOptions,
    settings=settings,
    seeds=(100, 2),
    row=trial.PlanErrorRow,
    trial=trial.trial,
    report=_report,
    printed=("criteria",),
    figures=_figures,
    write=_write,
    prepare=prepare,
    models="fit",
)
