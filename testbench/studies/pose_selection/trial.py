"""The true arm of the study of pose selection: measured in planned poses, identified, judged."""

from dataclasses import dataclass, replace

import numpy as np

from testbench.bench.campaign import Cell, Truth, settle_both, stream
from testbench.data.dataset import Dataset
from testbench.data.tracker import Tracker, read_positions
from testbench.design.rows import Load
from testbench.errors import Array
from testbench.identify import Estimate, reduce
from testbench.identify.conic import optimum
from testbench.identify.evaluate import predict, score
from testbench.identify.metric import Metric, metric, rescaled
from testbench.identify.prior import Prior, Strength
from testbench.identify.regularised import gco_with
from testbench.model.vjm import Vjm
from testbench.plant import Equilibrium
from testbench.studies.pose_selection.ground import STRUCTURES, UNCERTAINTY, Chosen, Ground, hung
from testbench.views.report import MM, Report, estimate_report, score_report


@dataclass(frozen=True)
class Bench:
    """The true arm, what is read of it and where predictions are judged.

    Attributes:
        cell: The arm.
        vjm: The model, perhaps with more markers.
        truth: Linear or not.
        sigma: Of one reading along one axis [m].
        tasks: Noise-free deflections in the tasks.
        workspace: The same over the workspace.
    """

    cell: Cell
    vjm: Vjm
    truth: Truth
    sigma: float
    tasks: Dataset
    workspace: Dataset


def build_bench(cell: Cell, ground: Ground, vjm: Vjm | None = None, truth: Truth = "nonlinear") -> Bench:
    """The true arm and its true deflections where predictions are judged.

    Args:
        cell: The arm.
        ground: Tasks and workspace.
        vjm: The model, if it has other markers than the arm.
        truth: "nonlinear" or "linear".
    """
    vjm, load = vjm or cell.vjm, hung(cell, ground.study.payload)
    rng = stream(ground.seed, 9)
    quiet = [
        measured(cell, cell.vjm, truth, q, load, ground.study.sigma, None, rng)
        for q in (ground.tasks, ground.workspace)
    ]
    return Bench(cell, vjm, truth, ground.study.sigma, *quiet)


def measured(
    cell: Cell,
    vjm: Vjm,
    truth: Truth,
    q: Array,
    load: Load,
    sigma: float,
    noise: float | None,
    rng: np.random.Generator,
) -> Dataset:
    """Runs of the true arm, every pose once.

    Args:
        cell: The arm.
        vjm: Its markers may be more than the arm's: the others are fixed to the tool.
        truth: "nonlinear" or "linear".
        q: Poses, (runs, n) [rad].
        load: The same in all, or one a run.
        sigma: By which the fit weights readings [m].
        noise: Standard deviation of a reading along an axis [m]; None for no noise.
        rng: Source of the noise.
    """
    runs = len(q)
    wrench = np.array(np.broadcast_to(load.wrench, (runs, 6)))
    point = np.array(np.broadcast_to(load.point, (runs, 3)))
    more = vjm.markers[len(cell.arm.markers) :]

    def read(state: Equilibrium) -> Array:
        extra = state.tool[:, None] + more @ state.rotation.swapaxes(1, 2)
        return read_positions(Tracker(noise or 0.0), np.hstack([state.markers, extra]), rng)

    ids = np.arange(runs) + 1
    before, after = settle_both(cell.plant, truth, q, wrench, point)
    return Dataset(
        markers=vjm.arm.markers,
        run=ids,
        pose=ids,
        q=q,
        wrench=wrench,
        point=point,
        before=read(before),
        after=read(after),
        sigma=sigma,
    )


def measure_plan(bench: Bench, ground: Ground, chosen: Chosen, rng: np.random.Generator | None) -> Dataset:
    """Runs of a plan under its one weight, without noise if there is no source of it."""
    load, noise = hung(bench.cell, ground.study.payload), None if rng is None else bench.sigma
    source = rng or stream(0)  # of no effect without noise
    return measured(bench.cell, bench.vjm, bench.truth, chosen.q, load, bench.sigma, noise, source)


def metrics_of(cell: Cell, prior: Prior) -> dict[str, Metric]:
    """Every structure in the metric of a prior."""
    return {name: metric(prior, cell.vjm, build(cell)) for name, build in STRUCTURES.items()}


def identify(vjm: Vjm, metrics: dict[str, Metric], fit: str, data: Dataset) -> Estimate:
    """GCO of a structure, with the prior or without.

    Args:
        vjm: The model.
        metrics: Structures in the metric of the prior.
        fit: One of FITS.
        data: The runs.
    """
    own = metrics[fit.split(" ")[0]]
    regression = reduce(vjm, own.structure, data)
    if fit.endswith("prior"):
        return gco_with(regression, rescaled(own, regression), Strength(UNCERTAINTY))
    return optimum(regression)


def judge(bench: Bench, estimate: Estimate) -> Report:
    """RMS distance of predicted from true deflections [mm]."""
    return {
        "tasks_mm": _rms_mm(bench, estimate, bench.tasks),
        "workspace_mm": _rms_mm(bench, estimate, bench.workspace),
    }


def pose_by_pose(bench: Bench, estimate: Estimate) -> Report:
    """RMS distance over the markers of every task and every pose of the workspace [mm]."""
    found = {}
    for key, data in (("tasks_mm", bench.tasks), ("workspace_mm", bench.workspace)):
        error = predict(bench.cell.vjm, estimate, data) - data.deflection
        found[key] = (MM * np.sqrt(np.square(error).sum(axis=2).mean(axis=1))).tolist()
    return found


def _rms_mm(bench: Bench, estimate: Estimate, data: Dataset) -> float:
    return MM * score(predict(bench.cell.vjm, estimate, data), data.deflection).rms


def model_row(bench: Bench, name: str, estimate: Estimate, data: Dataset) -> Report:
    """A row of the report's models: the tasks are its check set."""
    sets = {"identification": (bench.vjm, data), "check": (bench.cell.vjm, bench.tasks)}
    sets["workspace"] = (bench.cell.vjm, bench.workspace)
    scores = {
        key: score_report(score(predict(vjm, estimate, runs), runs.deflection))
        for key, (vjm, runs) in sets.items()
    }
    return {**estimate_report(name, estimate, estimate.solver_seconds), **scores, "paper": None}


def with_marker(vjm: Vjm, offset: tuple[float, float, float], name: str) -> Vjm:
    """The model with one more target fixed to the tool, at `offset` in its frame [m]."""
    arm = replace(vjm.arm, markers=(*vjm.arm.markers, name))
    return replace(vjm, arm=arm, markers=np.vstack([vjm.markers, offset]))
