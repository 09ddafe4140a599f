"""One trial: every plan and random poses measured on the true arm, identified in every way, judged.

Every trial has noise, a wrong prior and random poses of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.campaign.campaign import Cell, build_cell, settle_both, stream
from testbench.campaign.perturbed_prior import PRIORS, UNCERTAINTY, prior_of, wrong_prior
from testbench.campaign.predicted_error import Expected, fitted, half_widths, joints_alone, overall
from testbench.campaign.rows import MM, DatasetRow, ErrorRow, FitRow, dataset_row, error_row, fit_row
from testbench.campaign.true_arms import FAMILY, TRUTHS, member, true_cell
from testbench.data.dataset import Dataset, Ids
from testbench.data.tracker import Tracker, read_positions
from testbench.design.forecast import Forecast, widened
from testbench.design.rows import Experiment
from testbench.design.specification import Specification, Tasks, loads_of
from testbench.design.whole_arm import promise_on
from testbench.errors import Array
from testbench.identify import Estimate
from testbench.identify.evaluate import Score, all_deflections, deflections, score
from testbench.identify.metric import metric
from testbench.identify.prior import Prior
from testbench.model.load import Load, weight
from testbench.model.vjm import chain
from testbench.studies.pose_selection import settings as s
from testbench.studies.pose_selection.settings import PLANNED, RANDOM, Fit, PlanRow, Settings

NOISE, CHANCE = 100, 300  #: Streams of a seed for noise and for random poses, plus the number of poses.
Part = Literal["measured", "ground", "promise"]
"""The true arm; one of the family on a ground, with plans for the very fit; what came of a promise there."""


@dataclass(frozen=True)
class Chosen:
    """Poses to measure, (poses, n) [rad], and which load hangs in each, (poses,)."""

    q: Array
    load: Ids


@dataclass(frozen=True)
class Model(FitRow):
    """A fit of the featured number of poses, its runs and its errors; the tasks are its check set."""

    data: DatasetRow
    identification: ErrorRow
    check: ErrorRow
    workspace: ErrorRow


@dataclass(frozen=True)
class Where:
    """RMS error over the markers in every task and in every pose of the workspace."""

    tasks_mm: tuple[float, ...]
    workspace_mm: tuple[float, ...]


@dataclass(frozen=True)
class Bench:
    """The true arm and where predictions are judged."""

    cell: Cell  #: The arm.
    spec: Specification  #: The featured way to measure, with the planner's prior.
    tasks: Dataset  #: Noise-free deflections in the tasks under its one weight.
    workspace: Dataset  #: The same over the workspace.

    def score(self, estimate: Estimate, data: Dataset) -> Score:
        """Errors of predicted deflections."""
        return score(deflections(self.cell.vjm, estimate, data), data.deflection)

    def errors_mm(self, estimates: Sequence[Estimate]) -> list[tuple[float, float]]:
        """RMS distances of predicted from true deflections, at the tasks and over the workspace [mm]."""
        tasks, workspace = (
            [MM * score(own, data.deflection).rms for own in all_deflections(self.cell.vjm, estimates, data)]
            for data in (self.tasks, self.workspace)
        )
        return list(zip(tasks, workspace, strict=True))


@dataclass(frozen=True)
class Row:
    """RMS errors of one fit against the true deflection."""

    part: Part  #: What was measured.
    plan: str  #: Criterion of the plan, or "random".
    poses: int  #: How many were measured.
    fit: str  #: How they were identified.
    tasks_mm: float  #: At the tasks.
    workspace_mm: float | None = None  #: Over the workspace, where it is asked for.
    ground: str = ""  #: Name of the ground, of that part.
    expected: Expected | None = None  #: The promise that was tried.
    truth: str = ""  #: What a promise was tried on: one of truths.TRUTHS.
    prior: str = ""  #: One of wrong_prior.PRIORS.
    inside: float | None = None  #: Share of deflections along an axis inside the half widths of a promise.
    model: Model | None = None  #: Of the featured number of poses.
    where: Where | None = None  #: Errors of the featured plan for the tasks, pose by pose.


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[Row]]:
    """Rows of some seeds; `asked` holds the plans."""
    cell = build_cell(find_arm(asked.arm))
    bench, places = build_bench(cell, asked), (asked, s.elsewhere(asked))
    return [
        of_plans(bench, asked, seed) + [row for there in places for row in of_ground(cell, there, seed)]
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
    return rows


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
        errors = bench.errors_mm([fit.each(bench.cell.vjm, prior, [data])[0] for data in runs])
        for name, (tasks, workspace) in zip(("test", RANDOM), errors, strict=True):
            rows.append(Row("ground", name, n, fit.name, tasks, workspace, asked.scope.ground.name))
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
        error, inside = _against(bench, promise, fit.each(bench.cell.vjm, prior, [data])[0])
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


def build_bench(cell: Cell, asked: Settings) -> Bench:
    """The true arm and its deflections where predictions are judged."""
    spec = specify(cell, asked, wrong_prior(cell, asked.seed))
    places = [(q, spec.tasks.load) for q in (spec.tasks.q, spec.workspace)]
    tasks, workspace = (_read(cell, spec, place, None) for place in places)
    return Bench(cell, spec, tasks, workspace)


def measure(bench: Bench, spec: Specification, chosen: Chosen, rng: np.random.Generator | None) -> Dataset:
    """Runs of the true arm, every pose once; without a source of noise they have none."""
    return _read(bench.cell, spec, (chosen.q, loads_of(spec, chosen.load)), rng)


def _read(
    cell: Cell, spec: Specification, at: tuple[Array, Load], rng: np.random.Generator | None
) -> Dataset:
    """Markers in poses under loads."""
    (q, load), ids = at, np.arange(len(at[0])) + 1
    wrench, point = (np.array(np.broadcast_to(x, (len(q), x.shape[-1]))) for x in (load.wrench, load.point))
    before, after = settle_both(cell.plant, "nonlinear", q, wrench, point)
    tracker, source = Tracker(0.0 if rng is None else spec.experiment.sigma), rng or stream(0)
    return Dataset(
        markers=spec.experiment.vjm.arm.markers,
        run=ids,
        pose=ids,
        q=q,
        wrench=wrench,
        point=point,
        before=read_positions(tracker, before.markers, source),
        after=read_positions(tracker, after.markers, source),
        sigma=spec.experiment.sigma,
    )


def model_row(bench: Bench, name: str, estimate: Estimate, data: Dataset) -> Model:
    """A fit, its runs and its errors; the tasks are its check set."""
    return Model(
        **vars(fit_row(name, estimate, estimate.solver_seconds, prior=True)),
        data=dataset_row(data),
        identification=error_row(bench.score(estimate, data)),
        check=error_row(bench.score(estimate, bench.tasks)),
        workspace=error_row(bench.score(estimate, bench.workspace)),
    )


def pose_by_pose(bench: Bench, estimate: Estimate) -> Where:
    """RMS distance over the markers of every task and every pose of the workspace [mm]."""
    errors = [deflections(bench.cell.vjm, estimate, d) - d.deflection for d in (bench.tasks, bench.workspace)]
    return Where(*(tuple((MM * np.sqrt(np.square(e).sum(axis=2).mean(axis=1))).tolist()) for e in errors))


def specify(cell: Cell, asked: Settings, prior: Prior, fit: Fit = PLANNED) -> Specification:
    """The featured number of poses under one weight, with the arm's own markers, planned for a fit.

    Without a prior of its own a fit's unknowns are still in units of the planner's.
    """
    scope, scene = asked.scope, asked.scene
    load = weight(cell.vjm, scope.payload)
    own = metric(prior, cell.vjm, fit.structure(cell.arm))
    return Specification(
        experiment=Experiment(cell.vjm, own, cell.vjm.markers, scope.sigma),
        loads=(load,),
        tasks=Tasks(np.array(scene.tasks), load),
        workspace=np.array(scene.workspace),
        uncertainty=UNCERTAINTY if fit.prior else None,
        poses=scope.featured,
    )


def poses_of(asked: Settings, name: str, poses: int, seed: int) -> Chosen:
    """The poses of a plan, or random ones of a trial."""
    if name == RANDOM:
        return at_random(np.array(asked.scene.candidates), poses, stream(seed, CHANCE + poses))
    return planned(asked.scene.plan(name, poses, PLANNED.name))


def planned(row: PlanRow) -> Chosen:
    """The poses of a plan."""
    return Chosen(np.array(row.q_rad).reshape(row.poses, -1), np.array(row.load))


def at_random(q: Array, poses: int, rng: np.random.Generator) -> Chosen:
    """Feasible poses without a plan."""
    return Chosen(q[rng.choice(len(q), poses, replace=False)], np.zeros(poses, dtype=int))
