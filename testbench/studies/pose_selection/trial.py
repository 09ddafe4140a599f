"""One trial: every plan and random poses measured on the true arm, identified in every way, judged.

Every trial has noise, a wrong prior and random poses of its own. Beside the plans made once for all, it plans
anew from candidates and a prior of its own, and draws an arm that the prior could have drawn.
"""

from collections.abc import Sequence
from dataclasses import replace

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Cell, build_cell, stream
from testbench.bench.plan_summary import overall
from testbench.bench.truths import FAMILY, member, true_cell
from testbench.bench.wrong_prior import wrong_prior
from testbench.data.dataset import Dataset
from testbench.design.specification import promise_of, task_rows
from testbench.studies.pose_selection.arms import of_drawn_arm
from testbench.studies.pose_selection.kept import of_promise
from testbench.studies.pose_selection.measure import Bench, build_bench, measure, model_row, pose_by_pose
from testbench.studies.pose_selection.plans import candidates, certificate, plan
from testbench.studies.pose_selection.rows import Row
from testbench.studies.pose_selection.settings import FITS, PLANNED, RANDOM, Settings, elsewhere
from testbench.studies.pose_selection.ways import Chosen, at_random, planned, poses_of, specify, variants

NOISE = 100  #: Stream of a seed for noise, plus the number of poses.


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[Row]]:
    """Rows of some seeds; `asked` holds the plans."""
    cell = build_cell(find_arm(asked.arm))
    bench, places = build_bench(cell, asked), (asked, elsewhere(asked))
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
    for fit in FITS:
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
    for fit in FITS:
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
    forecast = promise_of(spec, chance.q, chance.load, task_rows(spec))
    return [replace(rows[0], certificate=certificate(best)), replace(rows[1], expected=overall(forecast))]


def of_variants(bench: Bench, asked: Settings, seed: int) -> list[Row]:
    """The plans of the other ways to measure."""
    rows, prior = [], wrong_prior(bench.cell, seed)
    for words, spec in variants(bench.cell, asked, bench.spec).items():
        chosen = planned(asked.scene.plan("test", spec.poses, PLANNED.name, words))
        data = measure(bench, spec, chosen, stream(seed, 13))
        estimate = PLANNED.identify(spec.experiment.vjm, prior, data)
        rows.append(Row("variant", words, spec.poses, PLANNED.name, *bench.errors_mm([estimate])[0]))
    return rows
