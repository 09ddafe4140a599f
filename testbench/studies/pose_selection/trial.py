"""One trial: every plan and random poses measured on the true arm, identified in every way, judged.

Every trial has noise, a wrong prior and random poses of its own. Beside the plans made once for all, it plans
anew from candidates and a prior of its own, and draws an arm that the prior could have drawn.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.stats import wishart

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Cell, build_cell, stream
from testbench.bench.plan_promise import Expected, fitted, half_widths, joints_alone, overall
from testbench.bench.rows import MM
from testbench.bench.truths import FAMILY, TRUTHS, member, true_cell
from testbench.bench.wrong_prior import PRIORS, UNCERTAINTY, prior_of, wrong_prior
from testbench.data.dataset import Dataset
from testbench.design.forecast import Forecast, widened
from testbench.design.specification import promise_of, task_rows
from testbench.design.whole_arm import promise_on
from testbench.errors import Array
from testbench.identify import Estimate
from testbench.identify.evaluate import deflections
from testbench.identify.metric import Metric
from testbench.model.vjm import chain
from testbench.plant import Plant
from testbench.studies.pose_selection import settings as s
from testbench.studies.pose_selection.measure import (
    Bench,
    Chosen,
    Model,
    Where,
    at_random,
    build_bench,
    measure,
    model_row,
    planned,
    pose_by_pose,
    poses_of,
    specify,
    variants,
)
from testbench.studies.pose_selection.plans import candidates, plan
from testbench.studies.pose_selection.settings import PLANNED, RANDOM, Settings

NOISE, DRAWN = 100, 200
"""Streams of a seed for noise, on the true arm and on a drawn one, plus the number of poses."""
Part = Literal["measured", "noise-free", "planned anew", "drawn arm", "variant", "ground", "promise"]
"""What was measured: the true arm with noise or without, with a plan and a prior of the trial's own, an arm
that the prior could have drawn (linear truth), the true arm in another way, or on one of two grounds with
plans that are made for the very fit; there too, what came of a promise."""


@dataclass(frozen=True)
class Row:
    """RMS errors of one fit against the true deflection."""

    part: Part  #: What was measured.
    plan: str  #: Criterion of the plan, "random", or the variant's name.
    poses: int  #: How many were measured.
    fit: str  #: How they were identified.
    tasks_mm: float  #: At the tasks.
    workspace_mm: float | None = None  #: Over the workspace, where it is asked for.
    ground: str = ""  #: Name of the ground, of that part.
    expected: Expected | None = None  #: Forecast on a drawn arm; the promise that was tried.
    truth: str = ""  #: What a promise was tried on: one of truths.TRUTHS.
    prior: str = ""  #: One of wrong_prior.PRIORS.
    inside: float | None = None  #: Share of deflections along an axis inside the half widths of a promise.
    efficiency_percent: float | None = None  #: Of a plan made anew.
    model: Model | None = None  #: Of the featured number of poses.
    where: Where | None = None  #: Errors of the featured plan for the tasks, pose by pose.


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[Row]]:
    """Rows of some seeds; `asked` holds the plans."""
    cell = build_cell(find_arm(asked.arm))
    bench, places = build_bench(cell, asked), (asked, s.elsewhere(asked))
    parts = (of_plans, planned_anew, of_drawn_arm, of_variants)
    return [
        [row for part in parts for row in part(bench, asked, seed)]
        + [row for there in places for row in of_ground(cell, there, seed)]
        for seed in seeds
    ]


def first_runs(bench: Bench, asked: Settings, seed: int) -> Dataset:
    """What a trial measures of the featured plan."""
    n = asked.scope.featured
    return measure(bench, bench.spec, poses_of(asked, "test", n, seed), stream(seed, NOISE + n))


def of_plans(bench: Bench, asked: Settings, seed: int) -> list[Row]:
    """Every plan and random poses, identified in every way."""
    prior, scope, rows = wrong_prior(bench.cell, seed), asked.scope, []
    levels = [(name, n) for name in (*scope.criteria, RANDOM) for n in scope.numbers(name)]
    chosen = [poses_of(asked, name, n, seed) for name, n in levels]
    read = [
        measure(bench, bench.spec, own, stream(seed, NOISE + n))
        for own, (_, n) in zip(chosen, levels, strict=True)
    ]
    for fit in s.FITS:
        estimates = fit.each(bench.cell.vjm, prior, read)
        found = zip(levels, read, estimates, bench.errors_mm(estimates), strict=True)
        for (name, n), data, estimate, errors in found:
            row = Row("measured", name, n, fit.name, *errors)
            if (n, fit) == (scope.featured, PLANNED):
                model = model_row(bench, f"{name}, {fit.name}", estimate, data)
                row = replace(row, model=model, where=pose_by_pose(bench, estimate))
            rows.append(row)
    return rows + _noise_free(bench, asked, seed)


def _noise_free(bench: Bench, asked: Settings, seed: int) -> list[Row]:
    """The featured number of poses measured without noise: what is left is the model's own error."""
    names, n = (*asked.scope.criteria, RANDOM), asked.scope.featured
    read = [measure(bench, bench.spec, poses_of(asked, name, n, seed), None) for name in names]
    estimates = PLANNED.each(bench.cell.vjm, wrong_prior(bench.cell, seed), read)
    found = zip(names, bench.errors_mm(estimates), strict=True)
    return [Row("noise-free", name, n, PLANNED.name, *errors) for name, errors in found]


def of_ground(cell: Cell, asked: Settings, seed: int) -> list[Row]:
    """Plans for the very fit against random poses, on one ground, the true arm one of the family."""
    n, prior = asked.scope.featured, wrong_prior(cell, seed)
    bench = build_bench(true_cell(cell, member(FAMILY, seed), seed), asked)
    drawn = poses_of(asked, RANDOM, n, seed)
    chance = measure(bench, bench.spec, drawn, stream(seed, NOISE + n))
    rows = of_promise(bench, asked, seed, (RANDOM, drawn, chance))
    for fit in s.FITS:
        chosen = planned(asked.scene.plan("test", n, fit.name))
        runs = (measure(bench, bench.spec, chosen, stream(seed, NOISE + n)), chance)
        if fit == PLANNED:
            rows += of_promise(bench, asked, seed, ("test", chosen, runs[0]))
        errors = bench.errors_mm([fit.identify(bench.cell.vjm, prior, data) for data in runs])
        for name, (tasks, workspace) in zip(("test", RANDOM), errors, strict=True):
            rows.append(Row("ground", name, n, fit.name, tasks, workspace, asked.scope.ground.name))
    return rows


def planned_anew(bench: Bench, asked: Settings, seed: int) -> list[Row]:
    """The featured plan from other candidates and another wrong prior, beside random poses of those.

    In the first trials alone: planning takes longer than all the rest.
    """
    cell, scope = bench.cell, asked.scope
    if seed >= asked.seed + scope.anew:
        return []
    prior, q = wrong_prior(cell, seed), candidates(cell, scope, stream(seed, 3)).q
    spec = specify(cell, asked, prior)
    best = plan(cell, scope, spec, "test", (q, seed))
    chance = at_random(q, scope.featured, stream(seed, 4))
    rows = []
    for name, chosen in (("test", Chosen(best.q, best.load)), (RANDOM, chance)):
        estimate = PLANNED.identify(cell.vjm, prior, measure(bench, spec, chosen, stream(seed, 7)))
        rows.append(Row("planned anew", name, scope.featured, PLANNED.name, *bench.errors_mm([estimate])[0]))
    return [replace(rows[0], efficiency_percent=100 * best.efficiency), rows[1]]


def of_variants(bench: Bench, asked: Settings, seed: int) -> list[Row]:
    """The plans of the other ways to measure."""
    rows, prior = [], wrong_prior(bench.cell, seed)
    for words, spec in variants(bench.cell, asked, bench.spec).items():
        chosen = planned(asked.scene.plan("test", spec.poses, PLANNED.name, words))
        data = measure(bench, spec, chosen, stream(seed, 13))
        estimate = PLANNED.identify(spec.experiment.vjm, prior, data)
        rows.append(Row("variant", words, spec.poses, PLANNED.name, *bench.errors_mm([estimate])[0]))
    return rows


def prior_in_turn(seed: int) -> str:
    """The prior of a seed: another one each time that a truth comes round."""
    return list(PRIORS)[(seed + seed // len(TRUTHS)) % len(PRIORS)]


def of_promise(bench: Bench, asked: Settings, seed: int, measured: tuple[str, Chosen, Dataset]) -> list[Row]:
    """What was promised of all links and joints with a learnt prior, and of joints alone, and what came.

    `measured` are the name of a plan, its poses, and what was read there.
    """
    (plan, chosen, data), name = measured, prior_in_turn(seed)
    prior = prior_of(bench.cell, name, seed)
    whole = specify(bench.cell, asked, prior, s.WHOLE)
    rows = []
    for fit, spec in ((s.WHOLE, whole), (s.INCUMBENT, joints_alone(whole, prior))):
        after = fitted(spec, prior, chosen.q, chosen.load)
        promise = promise_on(after, whole.tasks.q, whole.tasks.load)
        error, inside = _against(bench, promise, fit.identify(bench.cell.vjm, prior, data))
        row = Row("promise", plan, len(chosen.q), fit.name, error, ground=asked.scope.ground.name)
        expected, truth = overall(widened(promise)), member(FAMILY, seed)
        rows.append(replace(row, expected=expected, truth=truth, prior=name, inside=inside))
    return rows


def _against(bench: Bench, promise: Forecast, estimate: Estimate) -> tuple[float, float]:
    """RMS error at the tasks [mm], and the share of deflections along an axis inside their half widths."""
    vjm, tasks = bench.cell.vjm, bench.tasks
    off = deflections(vjm, estimate, tasks) - tasks.deflection
    own = (off @ chain(vjm, tasks.q).rotation).reshape(len(off), -1)  # along the tool's axes, as promised
    rms = float(np.sqrt(np.square(off).sum(axis=2).mean()))
    return MM * rms, float((np.abs(own) <= half_widths(promise)).mean())


def draw(own: Metric, uncertainty: float, rng: np.random.Generator) -> Array:
    """Compliances of an arm that the prior could have drawn, conservative, (n_theta, n_theta).

    X of every block is Wishart with 2 / u^2 degrees of freedom and mean one: x then has the mean and the
    covariance u^2 of the prior, u its relative uncertainty [1], and C = P^1/2 X P^1/2 is positive definite.
    """
    freedom, parts = 2 / uncertainty**2, []
    for n in own.sizes:
        X = np.reshape(wishart(freedom, np.eye(n) / freedom).rvs(random_state=rng), (n, n))
        column, row = np.tril_indices(n)
        parts.append(X[row, column] * np.where(row == column, 1, np.sqrt(2)))
    return own.structure.matrix(own.L @ np.concatenate(parts))


def with_compliance(plant: Plant, C_theta: Array) -> Plant:
    """The plant with other springs, for its linear truth."""
    C = np.zeros_like(plant.C)
    C[np.ix_(plant.theta, plant.theta)] = C_theta
    return replace(plant, C=C)


def of_drawn_arm(bench: Bench, asked: Settings, seed: int) -> list[Row]:
    """Plans and random poses on an arm that the planner's prior could have drawn, linear truth.

    Of the first criterion and of random poses every number is tried, of the others the featured one.
    """
    scope, spec = asked.scope, bench.spec
    names = (*scope.criteria, RANDOM)
    own, ahead, prior = spec.experiment.metric, task_rows(spec), wrong_prior(bench.cell, asked.seed)
    plant = with_compliance(bench.cell.plant, draw(own, UNCERTAINTY, stream(seed, 11)))
    arm = build_bench(replace(bench.cell, truth=plant), asked, "linear")
    every = {
        name: scope.poses if name in (scope.criteria[0], RANDOM) else (scope.featured,) for name in names
    }
    levels = [(name, n, poses_of(asked, name, n, seed)) for name in names for n in every[name]]
    forecasts = [overall(promise_of(spec, own.q, own.load, ahead)) for *_, own in levels]
    read = [measure(arm, spec, own, stream(seed, DRAWN + n)) for _, n, own in levels]
    return [
        Row("drawn arm", name, n, fit.name, error, expected=forecast)
        for fit in s.ON_ARMS
        for (name, n, _), forecast, (error, _) in zip(
            levels, forecasts, arm.errors_mm(fit.each(arm.cell.vjm, prior, read)), strict=True
        )
    ]
