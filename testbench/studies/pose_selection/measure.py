"""The true arm: measured in poses of a plan, identified, judged where the robot works."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.bench.campaign import Cell, Truth, settle_both, stream
from testbench.bench.plan import hung
from testbench.bench.rows import MM, DatasetRow, ErrorRow, FitRow, dataset_row, error_row, fit_row
from testbench.bench.wrong_prior import UNCERTAINTY, wrong_prior
from testbench.data.dataset import Dataset, Ids
from testbench.data.tracker import Tracker, read_positions
from testbench.design.rows import Experiment
from testbench.design.specification import Specification, Tasks, loads_of
from testbench.errors import Array
from testbench.identify import Estimate
from testbench.identify.evaluate import Score, all_deflections, deflections, score
from testbench.identify.identifiability_help import OFFSET, with_marker
from testbench.identify.metric import metric
from testbench.identify.prior import Prior
from testbench.model.load import Load
from testbench.plant import Equilibrium
from testbench.studies.pose_selection.settings import PLANNED, RANDOM, Fit, PlanRow, Settings

MORE = 4  #: Further poses: the yardstick of what else could be done.
CHANCE = 300  #: Stream of a seed for random poses, plus their number.


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
    truth: Truth  #: "nonlinear" or "linear".
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


def build_bench(cell: Cell, asked: Settings, truth: Truth = "nonlinear") -> Bench:
    """The true arm and its deflections where predictions are judged."""
    spec = specify(cell, asked, wrong_prior(cell, asked.seed))
    places = [(q, spec.tasks.load) for q in (spec.tasks.q, spec.workspace)]
    tasks, workspace = (_read(cell, truth, spec, place, None) for place in places)
    return Bench(cell, truth, spec, tasks, workspace)


def measure(bench: Bench, spec: Specification, chosen: Chosen, rng: np.random.Generator | None) -> Dataset:
    """Runs of the true arm, every pose once; without a source of noise they have none."""
    return _read(bench.cell, bench.truth, spec, (chosen.q, loads_of(spec, chosen.load)), rng)


def _read(
    cell: Cell, truth: Truth, spec: Specification, at: tuple[Array, Load], rng: np.random.Generator | None
) -> Dataset:
    """Markers in poses under loads; those beyond the arm's own are fixed to its tool."""
    q, load = at
    wrench, point = (
        np.array(np.broadcast_to(own, (len(q), own.shape[-1]))) for own in (load.wrench, load.point)
    )
    before, after = settle_both(cell.plant, truth, q, wrench, point)
    more = spec.experiment.targets[before.markers.shape[1] :]
    tracker, source = Tracker(0.0 if rng is None else spec.experiment.sigma), rng or stream(0)

    def read(state: Equilibrium) -> Array:
        extra = state.tool[:, None] + more @ state.rotation.swapaxes(1, 2)
        return read_positions(tracker, np.hstack([state.markers, extra]), source)

    ids = np.arange(len(q)) + 1
    return Dataset(
        markers=spec.experiment.vjm.arm.markers,
        run=ids,
        pose=ids,
        q=q,
        wrench=wrench,
        point=point,
        before=read(before),
        after=read(after),
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
    load = hung(cell, scope.payload)
    own = metric(prior, cell.vjm, fit.structure(cell.arm))
    return Specification(
        experiment=Experiment(cell.vjm, own, cell.vjm.markers, scope.sigma),
        loads=(load,),
        tasks=Tasks(np.array(scene.tasks), load),
        workspace=np.array(scene.workspace),
        uncertainty=UNCERTAINTY if fit.prior else None,
        poses=scope.featured,
    )


def variants(cell: Cell, asked: Settings, own: Specification) -> dict[str, Specification]:
    """The featured way to measure, and what could be done beyond it, in words.

    A second hanging point is `OFFSET` beside the first along the tool's y, a fourth marker as far off the
    plane of the three.
    """
    n, mass, every = own.poses, asked.scope.payload, own.experiment
    half, one, fourth = hung(cell, mass / 2), own.loads[0], with_marker(every.vjm, every.vjm.markers, "P4")
    beside = replace(one, point=one.point + np.array([0.0, OFFSET, 0.0]))
    found = {
        f"{n} poses, one weight, three markers": own,
        f"{MORE} more poses": replace(own, poses=n + MORE),
        "every reading taken twice": replace(own, experiment=replace(every, sigma=every.sigma / np.sqrt(2))),
        "half the weight as second load": replace(own, loads=(*own.loads, half)),
        f"a second hanging point {OFFSET:g} m beside": replace(own, loads=(*own.loads, beside)),
        "a fourth marker": replace(own, experiment=replace(every, vjm=fourth, targets=fourth.markers)),
    }
    return dict(list(found.items())[: asked.scope.variants])


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
