"""A calibration as arrays ready for drawing, whichever campaign it comes from."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.bench.campaign import Campaign, Cell, Scenario, Truth, settle_both
from testbench.bench.error_places import ErrorPlaces
from testbench.bench.judged import Result
from testbench.bench.rows import FitRow
from testbench.data.dataset import Dataset, Ids, Mask, in_order
from testbench.errors import Array
from testbench.identify import Estimate
from testbench.identify.evaluate import all_deflections
from testbench.plant.shapes import Frames, elastic_frames, rigid_frames
from testbench.views.colours import look
from testbench.views.magnified import round_scale
from testbench.views.recording.arm import origins, reach
from testbench.views.recording.pen import snake
from testbench.views.recording.stream import Header
from testbench.views.recording.style import Drawn, drawn
from testbench.views.schema import Table

ERROR_REACH = 0.2
"""Length of the longest error arrow of the shown models over the reach of the arm, before rounding [1]."""
STEPS = 20  #: Steps of loading, from nothing to the whole load.


@dataclass(frozen=True)
class States:
    """The arm under load, a row each: measured runs, places of the workspace, or steps of loading."""

    deflection: Array  #: Of the markers, measured or true, (rows, m, 3) [m].
    predicted: Array  #: The same by each model, (models, rows, m, 3) [m].
    wrench: Array  #: What acts, (rows, 6) [N, N m].
    whole: Array  #: The whole load, of which steps of loading have a share, (rows, 6) [N, N m].
    rigid: Frames  #: The arm without its load and without any sag.
    ghost: Frames  #: The arm under its load, the deflection magnified.
    scale: float  #: Magnification of the arrows from deflected to predicted markers [1].

    @property
    def errors(self) -> Array:
        """Deflections minus predictions, (models, rows, m, 3) [m]."""
        return np.asarray(self.deflection - self.predicted)

    @property
    def rms(self) -> Array:
        """Errors, root mean square over the markers, (models, rows) [m]."""
        return over_markers(self.errors)


def over_markers(vectors: Array) -> Array:
    """Root mean square of lengths over the markers, (..., m, 3) to (...) [m]."""
    return np.asarray(np.sqrt(np.mean(np.sum(vectors**2, axis=-1), axis=-1)))


@dataclass(frozen=True)
class Calibration:
    """What a recording of a calibration is made of."""

    header: Header  #: Scenario, settings and seed.
    summary: str  #: Markdown: question, answer, worst place, table.
    notes: str  #: Markdown: what is said beside it.
    errors: Table  #: Errors by model over all seeds, in millimetres, for the tab of errors.
    models: Sequence[FitRow]  #: One an estimate.
    best: int  #: Index of the model that the runs are sorted by.
    shown: tuple[int, ...]  #: Indices of the models that are drawn and plotted.
    map: ErrorPlaces  #: Errors by place of the first seed.
    magnification: float  #: Of the drawn deflection [1].


@dataclass(frozen=True)
class Drawing:
    """A campaign and its results, made ready for drawing."""

    about: Calibration  #: Words and models.
    cell: Cell  #: The arm.
    data: Dataset  #: What was measured, identification and check runs.
    noise: bool  #: Whether readings are noisy.
    payload: float | None  #: Hung mass [kg]; None where wrenches act.
    estimates: Sequence[Estimate]  #: One a model.
    checked: Mask  #: Which runs are of the check poses, (runs,).
    rank: Ids  #: Place of each run in worst_first, (runs,); 0 has the largest residual of the best model.
    runs: States  #: What was measured, in dataset order.
    places: States  #: The truth over the workspace, where the compared models differ most first.
    loading: States  #: The first place step by step.
    share: Array  #: Of the load in every step, (steps,) [1].

    @property
    def names(self) -> list[str]:
        """Names of the models."""
        return [model.name for model in self.about.models]

    @property
    def heads(self) -> list[str]:
        """The truth and the names of the shown models."""
        return ["truth", *(self.names[k] for k in self.about.shown)]

    @property
    def lumped(self) -> list[str]:
        """Names of the shown models that have no joints."""
        joints = 6 * len(self.cell.arm.links)  # index of the first one's compliance
        return [self.names[k] for k in self.about.shown if self.estimates[k].structure.a.max() < joints]

    @property
    def paths(self) -> list[str]:
        """The same in snake case, for paths."""
        return [snake(name) for name in self.names]

    @property
    def looks(self) -> list[Drawn]:
        """How each model is drawn."""
        return [drawn(look(m.structure, m.constraint, m.prior)) for m in self.about.models]

    @property
    def residual(self) -> Array:
        """Residual of the worst marker, (models, runs) [m]."""
        return np.asarray(np.linalg.norm(self.runs.errors, axis=-1).max(axis=-1))

    @functools.cached_property
    def reach(self) -> float:
        """Largest distance of a body from the foot of the arm, the scale of symbols [m]."""
        return max(reach(states.rigid) for states in (self.runs, self.places))

    def bodies(self, names: Sequence[str], frames: Frames) -> Array:
        """Origins of named bodies, (rows, len(names), 3) [m]."""
        return origins(self.cell, names, frames)

    def moving(self) -> list[int]:
        """Bodies whose ghost ever stands off them far enough not to flicker through their surface."""
        found: set[int] = set()
        for states in (self.runs, self.places):
            a, b = states.rigid, states.ghost
            shift = np.linalg.norm(b.positions - a.positions, axis=2).max(axis=0)
            turn = np.linalg.norm(b.rotations - a.rotations, axis=(2, 3)).max(axis=0) / np.sqrt(2)
            found |= set(np.flatnonzero(shift + 0.2 * self.reach * turn > 0.005 * self.reach).tolist())
        return sorted(found)


def build_drawing(about: Calibration, cell: Cell, campaign: Campaign, results: Sequence[Result]) -> Drawing:
    """Sort runs and places, and place the arm; one result a model."""
    scenario, data = campaign.scenario, campaign.measured
    estimates = [result.estimate for result in results]
    truth = _in_order(campaign.truth, about.map)
    drawn = _Drawn(about, cell, scenario.truth)
    runs = drawn.states(data, np.array([data.deflection - result.residuals for result in results]))
    places = drawn.states(truth, all_deflections(cell.vjm, estimates, truth))
    share = np.linspace(0, 1, STEPS + 1)
    residual = np.linalg.norm(results[about.best].residuals, axis=-1).max(axis=1)
    rank = np.empty(data.runs, dtype=int)
    rank[np.argsort(-residual, kind="stable")] = np.arange(data.runs)
    return Drawing(
        about=about,
        cell=cell,
        data=data,
        noise=scenario.noise,
        payload=scenario.payload if isinstance(scenario, Scenario) else None,
        estimates=estimates,
        checked=np.isin(data.pose, campaign.check.pose),
        rank=rank,
        runs=runs,
        places=places,
        loading=drawn.loading(truth, places, share),
        share=share,
    )


def _in_order(truth: Dataset, found: ErrorPlaces) -> Dataset:
    """The runs of the truth in the order of the map's places."""
    index = {run: k for k, run in enumerate(truth.run.tolist())}
    return in_order(truth, np.array([index[run] for run in found.run]))


@dataclass(frozen=True)
class _Drawn:
    """What places the arm in its states."""

    about: Calibration
    cell: Cell
    truth: Truth  #: Kind of truth.

    def states(self, data: Dataset, predicted: Array) -> States:
        """Runs of a dataset, their deflections by each model (models, runs, m, 3) [m]."""
        rigid, ghost, _ = self._arm(data.q, data.wrench, data.point)
        largest = np.linalg.norm((data.deflection - predicted)[list(self.about.shown)], axis=-1).max()
        scale = round_scale(ERROR_REACH * reach(rigid), float(largest))
        return States(data.deflection, predicted, data.wrench, data.wrench, rigid, ghost, scale)

    def loading(self, truth: Dataset, places: States, share: Array) -> States:
        """The first place from no load to the whole; the models are linear in the load."""
        q, point, whole = (np.tile(a[0], (len(share), 1)) for a in (truth.q, truth.point, truth.wrench))
        wrench = share[:, None] * whole
        rigid, ghost, deflection = self._arm(q, wrench, point)
        predicted = places.predicted[:, :1] * share[:, None, None]
        return States(deflection, predicted, wrench, whole, rigid, ghost, places.scale)

    def _arm(self, q: Array, wrench: Array, point: Array) -> tuple[Frames, Frames, Array]:
        """Rigid and, magnified, deflected; the true deflection of the markers, (rows, m, 3) [m]."""
        before, after = settle_both(self.cell.plant, self.truth, q, wrench, point)
        theta = self.about.magnification * (after.theta - before.theta)
        ghost = elastic_frames(self.cell.plant, q, theta)
        return rigid_frames(self.cell.room, q), ghost, np.asarray(after.markers - before.markers)
