"""Which poses pay: plans by every criterion against random poses, verified by full simulation.

Plans are made once, from a prior that is wrong; every trial then measures them on the true arm with noise of
its own and identifies with a wrong prior of its own. Errors are those of true deflections where the robot
works and over the workspace.
"""

from collections.abc import Sequence

from testbench.bench.campaign import build_cell, stream
from testbench.design.specification import promise_of, task_rows
from testbench.studies.pose_selection.ground import (
    CHANCE,
    FITS,
    NOISE,
    RANDOM,
    Chosen,
    Ground,
    at_random,
    candidates,
    plan,
    plan_report,
    specification_for,
    wrong_prior,
)
from testbench.studies.pose_selection.trial import (
    Bench,
    build_bench,
    identify,
    judge,
    measure_plan,
    metrics_of,
    model_row,
    pose_by_pose,
)
from testbench.views.report import MM, Report


def trials(ground: Ground, chosen: dict[tuple[str, int], Chosen], seeds: Sequence[int]) -> list[Report]:
    """Errors of every plan and of random poses, identified in every way, a report a seed.

    Args:
        ground: What all share.
        chosen: Poses by criterion and number.
        seeds: Roots of noise, of the identification's prior and of the random poses.
    """
    cell = build_cell(ground.folder)
    bench = build_bench(cell, ground)
    return [_trial(bench, ground, chosen, seed) for seed in seeds]


def _trial(bench: Bench, ground: Ground, chosen: dict[tuple[str, int], Chosen], seed: int) -> Report:
    metrics = metrics_of(bench.cell, wrong_prior(bench.cell, seed))
    errors: dict[str, dict[str, list[Report]]] = {fit: {} for fit in FITS}
    featured: list[Report] = []
    where: Report = {}
    quiet: Report = {}
    for name in (*ground.study.criteria, RANDOM):
        for poses in ground.study.poses:
            poses_chosen = (
                at_random(ground.candidates.q, poses, stream(seed, CHANCE + poses))
                if name == RANDOM
                else chosen[name, poses]
            )
            data = measure_plan(bench, ground, poses_chosen, stream(seed, NOISE + poses))
            for fit in FITS:
                estimate = identify(bench.vjm, metrics, fit, data)
                judged = judge(bench, estimate)
                errors[fit].setdefault(name, []).append({"poses": poses, **judged})
                if poses == ground.study.featured and fit == FITS[0]:
                    featured.append(model_row(bench, f"{name}, {fit}", estimate, data))
                    where = where or pose_by_pose(bench, estimate)
                    calm = measure_plan(bench, ground, poses_chosen, None)
                    quiet[name] = judge(bench, identify(bench.vjm, metrics, fit, calm))["tasks_mm"]
    return {"seed": seed, "errors": errors, "models": featured, "where": where, "noise_free": quiet}


def replanned(ground: Ground, seeds: Sequence[int]) -> list[Report]:
    """The featured plan made anew every time: other candidates, another wrong prior, other noise.

    Args:
        ground: Tasks, workspace, what is tried.
        seeds: Roots of all of that.
    """
    cell, found = build_cell(ground.folder), []
    bench, study = build_bench(cell, ground), ground.study
    for seed in seeds:
        prior, q = wrong_prior(cell, seed), candidates(cell, study, stream(seed, 3)).q
        specification = specification_for(cell, ground, prior, study.featured)
        best = plan(cell, ground, specification, "test", q, seed)
        guess = at_random(q, study.featured, stream(seed, 4))
        report = plan_report(specification, best)
        by_chance = promise_of(specification, guess.q, guess.load, task_rows(specification))
        for name, chosen in (("test", Chosen(best.q, best.load)), (RANDOM, guess)):
            data = measure_plan(bench, ground, chosen, stream(seed, 7))
            estimate = identify(bench.vjm, metrics_of(cell, prior), FITS[0], data)
            report[name] = judge(bench, estimate)
        found.append(report | {"expected_random_tasks_mm": MM * by_chance.overall})
    return found
