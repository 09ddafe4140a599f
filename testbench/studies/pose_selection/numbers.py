"""The numbers of pose selection: every error with its spread, forecasts and promises against what came."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.candidates import REASONS
from testbench.bench.truths import CALLED, TRUTHS
from testbench.bench.wrong_prior import SCALE, SHAPE, UNCERTAINTY
from testbench.errors import Array
from testbench.report.table import Row, Trials, merged, number
from testbench.studies.pose_selection import settings as s
from testbench.studies.pose_selection.settings import PLANNED, RANDOM, Settings
from testbench.trials.gain import gained
from testbench.trials.spread import ends, middle, wins
from testbench.views.schema import best_of

ERRORS = ("tasks_mm", "workspace_mm")
ENOUGH = 0.1  #: Error at the tasks that a campaign is to reach [mm].
STEP, LITTLE = 4, 0.10
"""So many more poses that take less than this share off the error are not worth a hoist."""
KEPT_BY: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "poses": ("plan", {"test": "planned"}),
    "tasks": ("ground", {}),
    "truth": ("truth", CALLED),
    "prior": ("prior", {}),
}
"""What promises are told by: column, and what its words are called."""


def numbers(asked: Settings, seeds: range, trials: Trials) -> Row:
    """Every number of report.json."""
    scope, scene, n = asked.scope, asked.scene, asked.scope.featured
    errors, own = _errors(asked, trials.where(part="measured")), trials.where(poses=n, fit=PLANNED.name)
    featured = own.where(part="measured")
    models = [row.model for row in merged(featured.keep("plan", "model."), "plan")]
    plans = [plan for plan in scene.plans if plan.fit == PLANNED.name]
    promises = trials.where(part="promise")
    f = Row(
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=find_arm(asked.arm).resolve().name,
        payload_kg=scope.payload,
        noise=True,
        truth="nonlinear",
        prior=Row(scale=SCALE, shape_percent=100 * SHAPE, believed_within_percent=100 * UNCERTAINTY),
        tracker_m=scope.ground.station,
        dataset=_dataset(asked, featured.where(plan="test", seed=seeds[0])),
        candidates=Row(
            found=len(scene.candidates),
            drawn=scene.drawn,
            rejected=dict(zip(REASONS, scene.rejected, strict=True)),
        ),
        models=[model | {"parameters": int(model.parameters), "paper": None} for model in models],
        where=merged(featured.where(plan="test").keep("where."))[0].where,
        plans=[plan for plan in plans if not plan.variant],
        errors=errors,
        featured={fit: _featured(levels, n) for fit, levels in errors.items()},
        possible=_possible(own.where(part="noise-free"), _at(errors[PLANNED.name]["test"], n)),
        recommendation=_recommended(errors[PLANNED.name]),
        replanned=_anew(own.where(part="planned anew")),
        promises=[_forecast(*found) for found in trials.where(part="drawn arm").groups("plan", "poses")],
        kept=list(_all_kept(promises.where(fit=s.WHOLE.name))),
        kept_joints=_kept(s.INCUMBENT.name, promises.where(fit=s.INCUMBENT.name)),
        worth=[_variant(plan, trials.where(part="variant")) for plan in plans if plan.variant],
        grounds=[row for there in (asked, s.elsewhere(asked)) for row in _ground(there, trials)],
        truths=list(TRUTHS),
        study=scope,
        criteria=[_at(levels, n) for levels in errors[PLANNED.name].values()],
        gains=_gains(trials.where(part="measured", poses=n)),
    )
    f["verdict"] = _verdict(f)
    case, least = max(cases(f.grounds), key=lambda found: found[1].ratio)
    task, place = (max(map(middle, mm)) for mm in (f.where.tasks_mm, f.where.workspace_mm))
    f["worst"] = Row(task_mm=task, workspace_mm=place, case=case, ratio=least.ratio)
    return f


def _dataset(asked: Settings, first: Trials) -> Row:
    """Runs of the featured plan in the first trial, and where predictions are judged."""
    scope, [own] = asked.scope, merged(first.keep("model.data."))
    counts = {name: int(own.model.data[name]) for name in ("runs", "points")}
    return Row(
        own.model.data | counts, poses=scope.featured, tasks=scope.tasks, workspace_poses=scope.workspace
    )


def _errors(asked: Settings, measured: Trials) -> Row:
    """Errors by fit, by plan, by number of poses; of a plan with its forecast."""
    found = Row()
    for (fit, name, poses), own in measured.groups("fit", "plan", "poses"):
        [level] = merged(own.keep("plan", "poses", *ERRORS))
        plan = None if name == RANDOM else asked.scene.plan(name, poses, PLANNED.name)
        level |= {
            "tasks_best_tenth_mm": float(np.percentile(own["tasks_mm"], 10)),
            "efficiency_percent": plan and plan.efficiency_percent,
            "expected_tasks_mm": plan and plan.expected_tasks_mm,
        }
        found.setdefault(fit, Row()).setdefault(name, []).append(level)
    return found


def _at(levels: Sequence[Row], poses: int) -> Row:
    """The level of so many poses."""
    return next(level for level in levels if level.poses == poses)


def _featured(levels: Row, poses: int) -> Row:
    """The plan for the tasks against random poses of the same number."""
    plan, chance = _at(levels.test, poses), _at(levels[RANDOM], poses)
    return Row(
        poses=poses,
        test_mm=plan.tasks_mm,
        random_mm=chance.tasks_mm,
        random_best_tenth_mm=chance.tasks_best_tenth_mm,
        ratio_of_medians=middle(plan.tasks_mm) / middle(chance.tasks_mm),
        best=best_of({"test": plan.tasks_mm, RANDOM: chance.tasks_mm}).names,
        beats_best_tenth=middle(plan.tasks_mm) <= chance.tasks_best_tenth_mm,
    )


def _possible(calm: Trials, plan: Row) -> Row:
    """What limits a plan of the featured size: the least forecast, and what stays without any noise."""
    return Row(
        poses=plan.poses,
        least_promise_mm=plan.expected_tasks_mm * (plan.efficiency_percent / 100) ** 0.5,
        noise_free_mm=Row({name: number(calm.where(plan=name)["tasks_mm"]) for name in ("test", RANDOM)}),
    )


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
    return Row(
        within_mm=ENOUGH,
        fewest=Row(fewest),
        little_more_beyond=little,
        step=STEP,
        little_percent=100 * LITTLE,
    )


def _anew(own: Trials) -> Row:
    """Plans made anew in every trial, from other candidates and another wrong prior."""
    plan, chance = (own.where(plan=name) for name in ("test", RANDOM))
    ours, theirs = plan["tasks_mm"], chance["tasks_mm"]
    return Row(
        test=merged(plan.keep(*ERRORS))[0],
        random=merged(chance.keep(*ERRORS))[0],
        seeds=len(plan),
        ratio_of_medians=float(np.median(ours) / np.median(theirs)),
        wins=wins(ours, theirs),
        least_efficiency_percent=float(plan["efficiency_percent"].min()),
    )


def _forecast(of: tuple[str, int], own: Trials) -> Row:
    """Forecast and simulated errors at the tasks on drawn arms, root mean squares over them."""
    gco, ls = (own.where(fit=fit.name) for fit in s.ON_ARMS)
    error, low, high = (gco[name] for name in ("tasks_mm", "expected.p05", "expected.p95"))
    expected, gco_mm, ls_mm = map(_rms, (gco["expected.expected"], error, ls["tasks_mm"]))
    return Row(
        plan=of[0],
        poses=int(of[1]),
        expected_mm=expected,
        gco_mm=gco_mm,
        ls_mm=ls_mm,
        gco_over_expected=gco_mm / expected,
        inside_90=float(np.mean((low <= error) & (error <= high))),
        arms=len(gco),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


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


def _variant(plan: s.PlanRow, trials: Trials) -> Row:
    """Another way to measure: its plan, the forecast error at the tasks, simulated errors."""
    return Row(
        variant=plan.variant,
        poses=plan.poses,
        directions=plan.observability.of,
        with_first_load=plan.load.count(0),
        efficiency_percent=plan.efficiency_percent,
        expected_tasks_mm=plan.expected_tasks_mm,
        **merged(trials.where(plan=plan.variant).keep(*ERRORS))[0],
    )


def _ground(asked: Settings, trials: Trials) -> Iterator[Row]:
    """Every fit with its own plan on one ground, beside random poses and beside joints alone."""
    n, ground = asked.scope.featured, asked.scope.ground.name
    here = trials.where(part="ground", ground=ground)
    for fit in s.FITS:
        ways = [
            here.where(plan=plan, fit=own.name)
            for plan, own in (("test", fit), (RANDOM, fit), ("test", s.INCUMBENT))
        ]
        yield Row(
            ground=ground,
            fit=fit.name,
            poses=n,
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
        for name, fit in (("test", PLANNED), (RANDOM, PLANNED), ("test", s.INCUMBENT))
    )
    return Row(
        random=gained("planned", RANDOM, plan, chance),
        joints=gained(PLANNED.name, s.INCUMBENT.name, plan, joints),
    )


def _verdict(f: Row) -> Row:
    """Who is best, of several that are alike all, and whether forecasts hold."""
    *planned, chance = f.criteria
    ratio, inside = ([row[key] for row in f.promises] for key in ("gco_over_expected", "inside_90"))
    first, *others = f.worth
    base = middle(first.tasks_mm)
    return Row(
        tasks=best_of({c.plan: c.tasks_mm for c in f.criteria}).names,
        workspace=best_of({c.plan: c.workspace_mm for c in f.criteria}).names,
        no_better=[c.plan for c in planned if middle(c.tasks_mm) >= middle(chance.tasks_mm)],
        ratio=(min(ratio), max(ratio)),
        inside=(min(inside), max(inside)),
        true_arm=[
            (row.poses, middle(row.tasks_mm) / row.expected_tasks_mm) for row in f.errors[PLANNED.name].test
        ],
        helps=best_of({v.variant: v.tasks_mm for v in others if middle(v.tasks_mm) < base}).names,
        loses=[
            f"{where} ({own.ratio:.2f}, {own.wins} of {own.seeds})"
            for where, own in cases(f.grounds)
            if own.ratio >= 1
        ],
    )


def cases(grounds: Sequence[Row]) -> list[tuple[str, Row]]:
    """Every fit with its own plan, where it is judged, in words."""
    cases = [(f"{own.fit} at the tasks, {own.ground}", own.tasks) for own in grounds]
    return cases + [(f"{own.fit} over the workspace, planned {own.ground}", own.workspace) for own in grounds]
