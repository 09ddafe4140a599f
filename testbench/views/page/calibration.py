"""A calibration on its page: the arm over the workspace and in its runs, and how each model errs there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import Campaign, Cell, settle_both
from testbench.bench.error_places import ErrorPlaces
from testbench.bench.judged import Result
from testbench.bench.rows import MM, FitRow
from testbench.data.dataset import Dataset, in_order
from testbench.errors import Array
from testbench.identify.evaluate import all_deflections
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.views.colours import MEASURED, Look, look
from testbench.views.magnified import round_scale
from testbench.views.page.charts import Line, PlaceMap, RunChart
from testbench.views.page.page import Seen
from testbench.views.page.scene import Layer, Poses, Scene

ARROWS = 0.25  #: Length of an arrow longer than 95 % of all over the reach of the arm [1].
OVER = "Error in each pose of the workspace, against the truth, RMS over the markers (mm)"
LEFT = "What is left in each run, against its readings, RMS over the markers (mm)"


@dataclass(frozen=True)
class Calibrated:
    """A calibration in simulation, for its page."""

    cell: Cell  #: The arm, its truth that of the campaign.
    campaign: Campaign  #: What was measured, and the truth over the workspace.
    results: Sequence[Result]  #: One a model.
    models: Sequence[FitRow]  #: Of the report, in the same order.
    map: ErrorPlaces  #: Of the report; its order of places is that of the page.
    magnification: float  #: Of the deflections [1].


@dataclass(frozen=True)
class _Set:
    """Poses, and what each model leaves of their deflections."""

    name: str  #: Of the set.
    names: Sequence[str]  #: Of its poses.
    data: Dataset
    wrong: Array  #: Deflections minus predictions, (models, runs, m, 3) [m].
    joints: Sequence[str]  #: Joint angles in words.

    @property
    def error_mm(self) -> Array:
        """Root mean square over the markers of their distances, (models, runs)."""
        return np.asarray(MM * np.sqrt((self.wrong**2).sum(axis=-1).mean(axis=-1)))


def calibration_seen(made: Calibrated) -> Seen:
    """What the page of a calibration draws: the models that are compared, and joints alone."""
    named = [m.name for m in made.models]
    shown = [named.index(name) for name in dict.fromkeys((*made.map.compared, JOINTS)) if name in named]
    models = [made.models[k] for k in shown]
    every, over = made.campaign.measured, _ordered(made.campaign.truth, made.map)
    estimates = [made.results[k].estimate for k in shown]
    found = all_deflections(made.cell.vjm, estimates, over)
    residuals = np.array([made.results[k].residuals for k in shown])
    names = [f"Place {k} of {over.runs}" for k in range(1, over.runs + 1)]
    places = _Set("Workspace, against the truth", names, over, over.deflection - found, made.map.joints)
    words = [made.cell.arm.words(q) for q in every.q]
    runs = _Set("Runs, against their readings", _named(made.campaign), every, residuals, words)
    reach = float(np.linalg.norm(over.before[:, 0], axis=-1).max())
    arrows = round_scale(ARROWS * reach, float(np.quantile(np.linalg.norm(places.wrong, axis=-1), 0.95)))
    title = f"Deflections x {made.magnification:g}, arrows of errors x {arrows:g}."
    groups = tuple(_poses(made, own, models, arrows) for own in (places, runs))
    return Seen(
        scene=Scene(made.cell, title, groups),
        map=PlaceMap(OVER, 0, np.array(made.map.position_m), _lines(places, models)),
        runs=[RunChart(LEFT, 1, [str(run) for run in every.run], _lines(runs, models))],
    )


def _ordered(data: Dataset, found: ErrorPlaces) -> Dataset:
    """Runs in the order of a map."""
    order = {run: k for k, run in enumerate(data.run.tolist())}
    return in_order(data, np.array([order[run] for run in found.run]))


def _named(campaign: Campaign) -> list[str]:
    """Every run by its number and what it is for."""
    data, used = campaign.measured, set(campaign.identification.pose.tolist())
    pairs = zip(data.run.tolist(), data.pose.tolist(), strict=True)
    return [f"Run {run}, {'fitted' if pose in used else 'check'} pose {pose}" for run, pose in pairs]


def _look(model: FitRow) -> Look:
    return look(model.structure, model.constraint, model.prior)


def _lines(own: _Set, models: Sequence[FitRow]) -> list[Line]:
    return [Line(m.name, _look(m), mm) for m, mm in zip(models, own.error_mm, strict=True)]


def _poses(made: Calibrated, own: _Set, models: Sequence[FitRow], arrows: float) -> Poses:
    """The arm in every pose of a set, with arrows from where markers go to where each model has them."""
    cell, data, M = made.cell, own.data, made.magnification
    truth = made.campaign.scenario.truth
    before, after = settle_both(cell.plant, truth, data.q, data.wrench, data.point)
    at = before.markers + M * data.deflection
    moved = MM * np.linalg.norm(data.deflection, axis=-1).max(axis=1)
    said = [
        f"Markers move up to {mm:.2f} mm. Error: "
        + ", ".join(f"{m.name} {x:.3f} mm" for m, x in zip(models, left, strict=True))
        + f". Joints at {joints}."
        for mm, left, joints in zip(moved.tolist(), own.error_mm.T.tolist(), own.joints, strict=True)
    ]
    errors = [
        Layer(f"error of {m.name}", _look(m).colour, "arrows", at, at - arrows * wrong)
        for m, wrong in zip(models, own.wrong, strict=True)
    ]
    return Poses(
        name=own.name,
        names=own.names,
        words=said,
        rigid=rigid_frames(cell.room, data.q),
        bent=elastic_frames(cell.plant, data.q, M * (after.theta - before.theta)),
        layers=[Layer("markers under load", MEASURED, "dots", at), *errors],
    )
