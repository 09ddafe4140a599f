"""The study of pose selection as a report: every number with its spread, the recommendation, the verdict."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.candidates import REASONS
from testbench.bench.plan_report import Found
from testbench.bench.truths import CALLED, TRUTHS
from testbench.bench.wrong_prior import SCALE, SHAPE, UNCERTAINTY
from testbench.studies.pose_selection import report as r
from testbench.studies.pose_selection import settings as s
from testbench.studies.pose_selection.rows import Part, PlanRow, Row, Scene, Where
from testbench.studies.pose_selection.settings import ON_ARMS, PLANNED, RANDOM
from testbench.studies.study import Rows
from testbench.trials.gain import gained
from testbench.trials.spread import Number, ends, grouped, merge, middle, wins
from testbench.views.schema import best_of

ENOUGH = 0.1  #: Error at the tasks that a campaign is to reach [mm].
STEP, LITTLE = 4, 0.10
"""So many more poses that take less than this share off the error are not worth a hoist."""

KEPT_BY: Mapping[str, Callable[[Row], str]] = {
    "poses": lambda row: "planned" if row.plan == "test" else row.plan,
    "tasks": lambda row: row.ground,
    "truth": lambda row: CALLED[row.kept.truth] if row.kept else "",
    "prior": lambda row: row.kept.prior if row.kept else "",
}
"""What promises are told by."""
Groups = Mapping[tuple[Part, str, int, str], Sequence[Row]]
"""Rows of all trials by part, plan, number of poses and fit."""
Levels = Mapping[str, list[r.Level]]  #: Errors by plan, then by number of poses.


def summary(asked: s.Settings, seeds: range, trials: Rows[Row]) -> r.PoseReport:
    """Medians and spreads over the trials."""
    scope, scene, n = asked.scope, asked.scene, asked.scope.featured
    names = (*scope.criteria, RANDOM)
    groups = grouped((x for _, rows in trials for x in rows), lambda x: (x.part, x.plan, x.poses, x.fit))
    errors = {fit.name: _levels(groups, asked, fit.name) for fit in s.FITS}
    own_plans = [plan for plan in scene.plans if plan.fit == PLANNED.name]
    ours, plans = errors[PLANNED.name], [plan for plan in own_plans if not plan.variant]
    models = {name: [x.model for x in groups["measured", name, n, PLANNED.name] if x.model] for name in names}
    first = models["test"][0]
    criteria, forecasts = [at(own, n) for own in ours.values()], _forecasts(groups)
    variants = [_variant(plan, groups) for plan in own_plans if plan.variant]
    whole, joints = (
        [row for name in ("test", RANDOM) for row in groups["promise", name, n, fit.name]]
        for fit in (s.WHOLE, s.INCUMBENT)
    )
    grounds = [
        row for there in (asked, s.elsewhere(asked)) for row in _ground(groups, there.scope, there.scene)
    ]
    where = merge([x.where for x in groups["measured", "test", n, PLANNED.name] if x.where])
    return r.PoseReport(
        scenario=s.NAME,
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=find_arm(asked.arm).resolve().name,
        payload_kg=scope.payload,
        noise=True,
        truth="nonlinear",
        prior=r.Believed(SCALE, 100 * SHAPE, 100 * UNCERTAINTY),
        tracker_m=scope.ground.station,
        dataset=r.Measured(**vars(first.data), poses=n, tasks=scope.tasks, workspace_poses=scope.workspace),
        candidates=Found(len(scene.candidates), scene.drawn, dict(zip(REASONS, scene.rejected, strict=True))),
        models=[r.ModelReport(**vars(merge(own))) for own in models.values()],
        where=where,
        plans=plans,
        errors=errors,
        featured={name: featured(own, n) for name, own in errors.items()},
        possible=_possible(groups, at(ours["test"], n)),
        recommendation=recommend(ours),
        replanned=_anew(groups, n),
        promises=forecasts,
        kept=_all_kept(whole),
        kept_joints=_kept(s.INCUMBENT.name, joints),
        worth=variants,
        grounds=grounds,
        truths=list(TRUTHS),
        study=scope,
        criteria=criteria,
        verdict=verdict(criteria, ours["test"], forecasts, variants, grounds),
        gains=gains(groups, n),
        worst=worst(where, grounds),
    )


def _errors(rows: Sequence[Row]) -> r.Errors:
    return merge([r.Errors(row.tasks_mm, row.workspace_mm) for row in rows])


def _best_tenth(rows: Sequence[Row]) -> float:
    return float(np.percentile([row.tasks_mm for row in rows], 10))


def _levels(groups: Groups, asked: s.Settings, fit: str) -> dict[str, list[r.Level]]:
    found: dict[str, list[r.Level]] = {}
    for name in (*asked.scope.criteria, RANDOM):
        for poses in asked.scope.numbers(name):
            rows = groups["measured", name, poses, fit]
            plan = None if name == RANDOM else asked.scene.plan(name, poses, PLANNED.name)
            level = r.Level(
                **vars(_errors(rows)),
                plan=name,
                poses=poses,
                tasks_best_tenth_mm=_best_tenth(rows),
                efficiency=plan.efficiency if plan else None,
                expected_tasks_mm=plan.expected_tasks_mm if plan else None,
            )
            found.setdefault(name, []).append(level)
    return found


def at(levels: Sequence[r.Level], poses: int) -> r.Level:
    """The level of so many poses."""
    return next(level for level in levels if level.poses == poses)


def featured(errors: Levels, poses: int) -> r.Featured:
    """The plan for the tasks against random poses of the same number."""
    plan, chance = at(errors["test"], poses), at(errors[RANDOM], poses)
    return r.Featured(
        poses=poses,
        test_mm=plan.tasks_mm,
        random_mm=chance.tasks_mm,
        random_best_tenth_mm=chance.tasks_best_tenth_mm,
        ratio_of_medians=middle(plan.tasks_mm) / middle(chance.tasks_mm),
        best=best_of({"test": plan.tasks_mm, RANDOM: chance.tasks_mm}).names,
        beats_best_tenth=middle(plan.tasks_mm) <= chance.tasks_best_tenth_mm,
    )


def _possible(groups: Groups, plan: r.Level) -> r.Possible:
    calm = {
        name: merge([row.tasks_mm for row in groups["noise-free", name, plan.poses, PLANNED.name]])
        for name in ("test", RANDOM)
    }
    return r.Possible(
        poses=plan.poses,
        least_promise_mm=middle(plan.expected_tasks_mm) * middle(plan.efficiency) ** 0.5,
        noise_free_mm=calm,
    )


def recommend(errors: Levels) -> r.Recommendation:
    """How many poses: the fewest that are enough in 95 % of all trials, and where more bring little."""
    fewest = {
        name: next((level.poses for level in errors[name] if ends(level.tasks_mm)[1] <= ENOUGH), None)
        for name in ("test", RANDOM)
    }
    little = None
    for level, following in pairwise(errors["test"]):
        gain = middle(following.tasks_mm) / middle(level.tasks_mm)
        if little is None and 1 - gain ** (STEP / (following.poses - level.poses)) < LITTLE:
            little = level.poses
    return r.Recommendation(ENOUGH, fewest, little, STEP, 100 * LITTLE)


def _anew(groups: Groups, poses: int) -> r.Anew:
    plans, chance = (groups["planned anew", name, poses, PLANNED.name] for name in ("test", RANDOM))
    certificates = [row.certificate for row in plans if row.certificate]
    a, b = ([row.tasks_mm for row in rows] for rows in (plans, chance))
    return r.Anew(
        **vars(merge(certificates)),
        test=_errors(plans),
        random=_errors(chance),
        seeds=len(plans),
        random_best_tenth_mm=_best_tenth(chance),
        ratio_of_medians=float(np.median(a) / np.median(b)),
        wins=wins(a, b),
        least_efficiency=min(middle(c.efficiency) for c in certificates),
    )


def _ground(groups: Groups, scope: s.Scope, scene: Scene) -> list[r.GroundReport]:
    """Every fit with its own plan on one ground, beside random poses and beside joints alone."""
    n, ground = scope.featured, scope.ground.name

    def errors(plan: str, fit: s.Fit) -> tuple[list[float], list[float]]:
        rows = [row for row in groups["ground", plan, n, fit.name] if row.ground == ground]
        return [row.tasks_mm for row in rows], [middle(row.workspace_mm) for row in rows]

    joints, found = errors("test", s.INCUMBENT), []
    for fit in s.FITS:
        ways = (errors("test", fit), errors(RANDOM, fit), joints)
        tasks, workspace = (_against(*own) for own in zip(*ways, strict=True))
        found.append(
            r.GroundReport(
                ground=ground,
                fit=fit.name,
                poses=n,
                expected_tasks_mm=scene.plan("test", n, fit.name).expected_tasks_mm,
                tasks=tasks,
                workspace=workspace,
            )
        )
    return found


def _against(plan: Sequence[float], chance: Sequence[float], joints: Sequence[float]) -> r.Against:
    return r.Against(
        planned_mm=merge(list[Number](plan)),
        random_mm=merge(list[Number](chance)),
        ratio=float(np.median(plan) / np.median(chance)),
        wins=wins(plan, chance),
        better_than_joints=wins(plan, joints),
        seeds=len(plan),
    )


def _forecasts(groups: Groups) -> list[r.ForecastReport]:
    """By plan and number of poses, over all drawn arms."""
    found = []
    for plan, poses in ((p, n) for part, p, n, fit in groups if (part, fit) == ("drawn arm", PLANNED.name)):
        rows, ls = (groups["drawn arm", plan, poses, fit.name] for fit in ON_ARMS)
        known = [(row.tasks_mm, row.expected) for row in rows if row.expected]
        expected, gco = _rms([e.expected for _, e in known]), _rms([row.tasks_mm for row in rows])
        found.append(
            r.ForecastReport(
                plan=plan,
                poses=poses,
                expected_mm=expected,
                gco_mm=gco,
                ls_mm=_rms([row.tasks_mm for row in ls]),
                gco_over_expected=gco / expected,
                inside_90_percent=float(np.mean([e.p05 <= error <= e.p95 for error, e in known])),
                arms=len(rows),
            )
        )
    return found


def _all_kept(rows: Sequence[Row]) -> list[r.KeptReport]:
    """All promises, then those of each plan, ground, truth and prior."""
    found = [_kept("all", rows)]
    for what, key in KEPT_BY.items():
        found += [_kept(f"{what}: {name}", own) for name, own in sorted(grouped(rows, key).items())]
    return found


def _kept(cases: str, rows: Sequence[Row]) -> r.KeptReport:
    known = [(row.tasks_mm, row.expected, row.kept) for row in rows if row.expected and row.kept]
    below, above = ([e < p.p05 for e, p, _ in known], [e > p.p95 for e, p, _ in known])
    return r.KeptReport(
        cases=cases,
        count=len(known),
        inside_90=float(1 - np.mean(below) - np.mean(above)),
        below=float(np.mean(below)),
        above=float(np.mean(above)),
        inside_95=float(np.mean([kept.inside for *_, kept in known])),
        ratio=merge(list[Number]([e / p.expected for e, p, _ in known])),
    )


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _variant(plan: PlanRow, groups: Groups) -> r.VariantReport:
    return r.VariantReport(
        variant=plan.variant,
        poses=plan.poses,
        directions=plan.directions_of_loads,
        with_first_load=plan.load.count(0),
        efficiency=plan.efficiency,
        expected_tasks_mm=plan.expected_tasks_mm,
        judged=_errors(groups["variant", plan.variant, plan.poses, PLANNED.name]),
    )


def verdict(
    criteria: Sequence[r.Level],
    best: Sequence[r.Level],
    forecasts: Sequence[r.ForecastReport],
    variants: Sequence[r.VariantReport],
    grounds: Sequence[r.GroundReport],
) -> r.Verdict:
    """Who is best and whether forecasts hold; of the variants the featured plan is the first."""
    planned = [c for c in criteria if c.plan != RANDOM]
    chance = next(middle(c.tasks_mm) for c in criteria if c.plan == RANDOM)
    ratio, inside = [f.gco_over_expected for f in forecasts], [f.inside_90_percent for f in forecasts]
    errors = {v.variant: middle(v.judged.tasks_mm) for v in variants}
    base = middle(variants[0].judged.tasks_mm)
    return r.Verdict(
        tasks=best_of({c.plan: c.tasks_mm for c in criteria}).names,
        workspace=best_of({c.plan: c.workspace_mm for c in criteria}).names,
        no_better=tuple(c.plan for c in planned if middle(c.tasks_mm) >= chance),
        ratio=(min(ratio), max(ratio)),
        inside=(min(inside), max(inside)),
        true_arm=tuple((p.poses, middle(p.tasks_mm) / middle(p.expected_tasks_mm)) for p in best),
        helps=best_of({name: error for name, error in errors.items() if error < base}).names,
        loses=losing(grounds),
    )


def losing(grounds: Sequence[r.GroundReport]) -> tuple[str, ...]:
    """Where the plan's median error is no less than that of random poses."""
    return tuple(
        f"{where} ({own.ratio:.2f}, {own.wins} of {own.seeds})"
        for where, own in _cases(grounds)
        if own.ratio >= 1
    )


def _cases(grounds: Sequence[r.GroundReport]) -> list[tuple[str, r.Against]]:
    """Every fit with its own plan, where it is judged, in words."""
    cases = [(f"{own.fit} at the tasks, {own.ground}", own.tasks) for own in grounds]
    return cases + [(f"{own.fit} over the workspace, planned {own.ground}", own.workspace) for own in grounds]


def gains(groups: Groups, poses: int) -> r.Gains:
    """The featured plan beside random poses, and beside joints alone from poses planned likewise."""
    plan, chance, joints = (
        [row.tasks_mm for row in groups["measured", name, poses, fit.name]]
        for name, fit in (("test", PLANNED), (RANDOM, PLANNED), ("test", s.INCUMBENT))
    )
    return r.Gains(
        gained("planned", RANDOM, plan, chance), gained(PLANNED.name, s.INCUMBENT.name, plan, joints)
    )


def worst(where: Where, grounds: Sequence[r.GroundReport]) -> r.Worst:
    """The worst task and place, and the case in which planning gains least."""
    case, own = max(_cases(grounds), key=lambda found: found[1].ratio)
    task, place = (max(map(middle, errors)) for errors in (where.tasks_mm, where.workspace_mm))
    return r.Worst(task, place, case, own.ratio)
