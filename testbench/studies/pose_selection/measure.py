"""The true arm: measured in poses of a plan, identified, judged where the robot works."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.bench.campaign import Cell, Truth, settle_both, stream
from testbench.bench.rows import MM, dataset_row, error_row, fit_row
from testbench.bench.wrong_prior import wrong_prior
from testbench.data.dataset import Dataset
from testbench.data.tracker import Tracker, read_positions
from testbench.design.specification import Specification, loads_of
from testbench.errors import Array
from testbench.identify import Estimate
from testbench.identify.evaluate import Score, all_deflections, deflections, score
from testbench.model.load import Load
from testbench.plant import Equilibrium
from testbench.studies.pose_selection.rows import Model, Where
from testbench.studies.pose_selection.settings import Settings
from testbench.studies.pose_selection.ways import Chosen, specify


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
    places = (spec.tasks.q, spec.workspace)
    tasks, workspace = (_read(spec, _settle(cell, truth, q, spec.tasks.load), None) for q in places)
    return Bench(cell, truth, spec, tasks, workspace)


def measure(bench: Bench, spec: Specification, chosen: Chosen, rng: np.random.Generator | None) -> Dataset:
    """Runs of the true arm, every pose once; without a source of noise they have none."""
    return _read(spec, _settle(bench.cell, bench.truth, chosen.q, loads_of(spec, chosen.load)), rng)


@dataclass(frozen=True)
class _Settled:
    """The true arm in any poses, unloaded and loaded."""

    q: Array
    load: Load
    before: Equilibrium
    after: Equilibrium


def _settle(cell: Cell, truth: Truth, q: Array, load: Load) -> _Settled:
    wrench = np.array(np.broadcast_to(load.wrench, (len(q), 6)))
    point = np.array(np.broadcast_to(load.point, (len(q), 3)))
    return _Settled(q, Load(wrench, point), *settle_both(cell.plant, truth, q, wrench, point))


def _read(spec: Specification, arm: _Settled, rng: np.random.Generator | None) -> Dataset:
    """Its markers; those beyond the arm's own are fixed to its tool."""
    own = spec.experiment.vjm.arm.markers
    more = spec.experiment.targets[arm.before.markers.shape[1] :]
    tracker, source = Tracker(0.0 if rng is None else spec.experiment.sigma), rng or stream(0)

    def read(state: Equilibrium) -> Array:
        extra = state.tool[:, None] + more @ state.rotation.swapaxes(1, 2)
        return read_positions(tracker, np.hstack([state.markers, extra]), source)

    ids = np.arange(len(arm.q)) + 1
    return Dataset(
        markers=own,
        run=ids,
        pose=ids,
        q=arm.q,
        wrench=arm.load.wrench,
        point=arm.load.point,
        before=read(arm.before),
        after=read(arm.after),
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
