"""One trial: every plan and random poses measured on the true arm, identified in every way, judged.

Every trial has noise, a wrong prior and random poses of its own. Beside the plans made once for all, it plans
anew from candidates and a prior of its own, and draws an arm that the prior could have drawn.
"""

from collections.abc import Sequence
from dataclasses import replace

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import build_cell, stream
from testbench.bench.plan_summary import overall
from testbench.bench.wrong_prior import wrong_prior
from testbench.data.dataset import Dataset
from testbench.design.specification import promise_of, task_rows
from testbench.studies.pose_selection.arms import of_drawn_arm
from testbench.studies.pose_selection.measure import Bench, build_bench, measure, model_row, pose_by_pose
from testbench.studies.pose_selection.plans import candidates, certificate, plan
from testbench.studies.pose_selection.rows import Row
from testbench.studies.pose_selection.settings import FITS, PLANNED, RANDOM, Settings
from testbench.studies.pose_selection.ways import Chosen, at_random, planned, poses_of, specify, variants

NOISE = 100  #: Stream of a seed for noise, plus the number of poses.


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[Row]]:
    """Rows of some seeds; `asked` holds the plans."""
    bench = build_bench(build_cell(find_arm(asked.arm)), asked)
    parts = (of_plans, planned_anew, of_drawn_arm, of_variants)
    return [[row for part in parts for row in part(bench, asked, seed)] for seed in seeds]


def first_runs(bench: Bench, asked: Settings, seed: int) -> Dataset:
    """What a trial measures of the featured plan."""
    n = asked.scope.featured
    return measure(bench, bench.spec, poses_of(asked, "test", n, seed), stream(seed, NOISE + n))


def of_plans(bench: Bench, asked: Settings, seed: int) -> list[Row]:
    """Every plan and random poses, identified in every way."""
    prior, rows = wrong_prior(bench.cell, seed), []
    for name in (*asked.scope.criteria, RANDOM):
        for poses in asked.scope.poses:
            chosen = poses_of(asked, name, poses, seed)
            data = measure(bench, bench.spec, chosen, stream(seed, NOISE + poses))
            for fit in FITS:
                estimate = fit.identify(bench.cell.vjm, prior, data)
                row = Row("measured", name, poses, fit.name, *bench.errors_mm(estimate))
                if (poses, fit) == (asked.scope.featured, PLANNED):
                    model = model_row(bench, f"{name}, {fit.name}", estimate, data)
                    row = replace(row, model=model, where=pose_by_pose(bench, estimate))
                rows.append(row)
            if poses == asked.scope.featured:
                calm = PLANNED.identify(bench.cell.vjm, prior, measure(bench, bench.spec, chosen, None))
                rows.append(Row("noise-free", name, poses, PLANNED.name, *bench.errors_mm(calm)))
    return rows


def planned_anew(bench: Bench, asked: Settings, seed: int) -> list[Row]:
    """The featured plan from other candidates and another wrong prior, beside random poses of those."""
    cell, scope = bench.cell, asked.scope
    prior, q = wrong_prior(cell, seed), candidates(cell, scope, stream(seed, 3)).q
    spec = specify(cell, asked, prior)
    best = plan(cell, scope, spec, "test", (q, seed))
    chance = at_random(q, scope.featured, stream(seed, 4))
    rows = []
    for name, chosen in (("test", Chosen(best.q, best.load)), (RANDOM, chance)):
        estimate = PLANNED.identify(cell.vjm, prior, measure(bench, spec, chosen, stream(seed, 7)))
        rows.append(Row("planned anew", name, scope.featured, PLANNED.name, *bench.errors_mm(estimate)))
    forecast = promise_of(spec, chance.q, chance.load, task_rows(spec))
    return [replace(rows[0], certificate=certificate(best)), replace(rows[1], expected=overall(forecast))]


def of_variants(bench: Bench, asked: Settings, seed: int) -> list[Row]:
    """The plans of the other ways to measure."""
    rows, prior = [], wrong_prior(bench.cell, seed)
    for words, spec in variants(bench.cell, asked, bench.spec).items():
        data = measure(bench, spec, planned(asked.scene.plan("test", spec.poses, words)), stream(seed, 13))
        estimate = PLANNED.identify(spec.experiment.vjm, prior, data)
        rows.append(Row("variant", words, spec.poses, PLANNED.name, *bench.errors_mm(estimate)))
    return rows
