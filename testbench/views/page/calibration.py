"""A calibration on its page: the arm over the workspace and in its runs, and how each model errs there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.bench.campaign import Campaign, Cell, settle_both
from testbench.bench.judged import Result
from testbench.bench.rows import MM
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.evaluate import all_deflections
from testbench.model.vjm import chain
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.views.colours import MEASURED, Look
from testbench.views.magnified import round_scale
from testbench.views.page.charts import Line, PlaceMap, RunChart
from testbench.views.page.page import Seen
from testbench.views.page.scene import Layer, Poses, Scene

ARROWS = 0.25  #: Length of an arrow longer than 95 % of all over the reach of the arm [1].
OVER = "Error in each pose of the workspace, against the truth, RMS over the markers (mm)"
LEFT = "What is left in each run, against its readings, RMS over the markers (mm)"


@dataclass(frozen=True)
class Shown:
    """What is drawn of a calibration, and how."""

    results: Sequence[Result]  #: Of the models that are drawn; the first and the last one are compared.
    names: Sequence[str]  #: What these are called.
    looks: Sequence[Look]
    magnification: float  #: Of the deflections [1].


@dataclass(frozen=True)
class _Set:
    """Poses, and what each model leaves of their deflections."""

    name: str  #: Of the set.
    names: Sequence[str]  #: Of its poses.
    data: Dataset
    wrong: Array  #: Deflections minus predictions, (models, runs, m, 3) [m].

    @property
    def error_mm(self) -> Array:
        """Root mean square over the markers of their distances, (models, runs)."""
        return np.asarray(MM * np.sqrt((self.wrong**2).sum(axis=-1).mean(axis=-1)))


def calibration_seen(cell: Cell, campaign: Campaign, shown: Shown) -> Seen:
    """What the page of a calibration draws.

    Args:
        cell: The arm, its truth that of the campaign.
        campaign: What was measured, and the truth all over the workspace.
        shown: The models.
    """
    every, over = campaign.measured, campaign.truth
    found = all_deflections(cell.vjm, [result.estimate for result in shown.results], over)
    residuals = np.array([result.residuals for result in shown.results])
    names = [f"Pose {k + 1} of the workspace" for k in range(over.runs)]
    places = _Set("Workspace, against the truth", names, over, over.deflection - found)
    runs = _Set("Runs, against their readings", _named(campaign), every, residuals)
    reach = float(np.linalg.norm(over.before[:, 0], axis=-1).max())
    typical = float(np.quantile(np.linalg.norm(places.wrong, axis=-1), 0.95))
    arrows = round_scale(ARROWS * reach, typical)
    apart = np.abs(places.error_mm[0] - places.error_mm[-1])
    title = f"Deflections x {shown.magnification:g}, arrows of errors x {arrows:g}."
    settled = (cell, campaign)
    groups = (
        _poses(settled, places, shown, arrows, int(apart.argmax())),
        _poses(settled, runs, shown, arrows, 0),
    )
    position = chain(cell.vjm, over.q).position
    return Seen(
        scene=Scene(cell, title, groups),
        map=PlaceMap(OVER, 0, position, _lines(places, shown)),
        runs=[RunChart(LEFT, 1, [str(run) for run in every.run], _lines(runs, shown))],
    )


def _named(campaign: Campaign) -> list[str]:
    """Every run by its number and what it is for."""
    data, used = campaign.measured, set(campaign.identification.pose.tolist())
    pairs = zip(data.run.tolist(), data.pose.tolist(), strict=True)
    return [f"Run {run}, {'fitted' if pose in used else 'check'} pose {pose}" for run, pose in pairs]


def _lines(own: _Set, shown: Shown) -> list[Line]:
    return [Line(*one) for one in zip(shown.names, shown.looks, own.error_mm, strict=True)]


def _poses(settled: tuple[Cell, Campaign], own: _Set, shown: Shown, arrows: float, first: int) -> Poses:
    """The arm in every pose of a set, with arrows from where markers go to where each model has them."""
    (cell, campaign), data, M = settled, own.data, shown.magnification
    before, after = settle_both(cell.plant, campaign.scenario.truth, data.q, data.wrench, data.point)
    at = before.markers + M * data.deflection
    models = zip(shown.names, shown.looks, own.wrong, strict=True)
    layers = [
        Layer(f"error of {name}", look.colour, "arrows", at, at - arrows * wrong)
        for name, look, wrong in models
    ]
    moved = MM * np.linalg.norm(data.deflection, axis=-1).max(axis=1)
    said = [
        f"Markers move up to {mm:.2f} mm. Error: "
        + ", ".join(f"{name} {x:.3f} mm" for name, x in zip(shown.names, left, strict=True))
        + f". Joints at {cell.arm.words(q)}."
        for mm, left, q in zip(moved.tolist(), own.error_mm.T.tolist(), data.q, strict=True)
    ]
    return Poses(
        name=own.name,
        names=own.names,
        words=said,
        rigid=rigid_frames(cell.room, data.q),
        bent=elastic_frames(cell.plant, data.q, M * (after.theta - before.theta)),
        layers=[Layer("markers under load", MEASURED, "dots", at), *layers],
        first=first,
    )
