"""A calibration as arrays ready for drawing, whichever campaign it comes from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.bench.campaign import Campaign, Cell, Scenario, Truth, settle_both
from testbench.bench.judged import Result
from testbench.bench.rows import FitRow
from testbench.data.dataset import Dataset, Ids, Mask
from testbench.errors import Array
from testbench.identify import Estimate
from testbench.plant.shapes import Frames, elastic_frames, rigid_frames
from testbench.views.colours import look
from testbench.views.recording.arm import origins, reach
from testbench.views.recording.pen import snake
from testbench.views.recording.stream import Header
from testbench.views.recording.style import Drawn, drawn
from testbench.views.schema import Table

RESIDUAL_REACH = 0.1
"""Length of the longest residual arrow of the best model over the reach of the arm, before rounding [1]."""
MAX_RESIDUAL_SCALE = 1e5
STEPS = 20  #: Steps of loading, from nothing to the whole load.


@dataclass(frozen=True)
class Loading:
    """One run loaded step by step."""

    run: int  #: Index of the run.
    share: Array  #: Of the load, (steps,) [1].
    deflection: Array  #: True deflection of the markers, (steps, m, 3) [m].
    predicted: Array  #: The same by each model, (models, steps, m, 3) [m].
    rigid: Frames  #: The arm without load.
    ghost: Frames  #: The arm at every step, its deflection magnified.


@dataclass(frozen=True)
class Calibration:
    """What a recording of a calibration is made of."""

    header: Header  #: Scenario, settings and seed.
    summary: str  #: Markdown: question, answer, table.
    notes: str  #: Markdown: what is said beside it.
    errors: Table  #: Errors by model over all seeds, in millimetres, for the tab of errors.
    models: Sequence[FitRow]  #: One an estimate.
    best: int  #: Index of the model that the runs are sorted by.
    shown: tuple[int, ...]  #: Indices of the models that are visible at first.
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
    errors: Array  #: Measured minus predicted deflections, (models, runs, m, 3) [m].
    checked: Mask  #: Which runs are of the check poses, (runs,).
    rank: Ids  #: Place of each run in worst_first, (runs,); 0 has the largest residual of the best model.
    rigid: Frames  #: The arm without its load and without any sag.
    ghost: Frames  #: The arm under its load, the deflection magnified.
    loading: Loading  #: The worst run step by step.
    residual_scale: float  #: Magnification of the residual arrows [1].

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
        """How each model is drawn, the shown ones bold."""
        found = [look(m.structure, m.constraint, m.prior) for m in self.about.models]
        return [drawn(own, k in self.about.shown) for k, own in enumerate(found)]

    @property
    def lowest(self) -> int:
        """Index of the marker that moves most while the load grows."""
        return int(np.linalg.norm(self.loading.deflection[-1], axis=-1).argmax())

    @property
    def sag(self) -> Array:
        """Deflection of that marker: the true one, then by each model, (1 + models, steps) [m]."""
        every = np.stack([self.loading.deflection, *self.loading.predicted])
        return np.asarray(np.linalg.norm(every[:, :, self.lowest], axis=-1))

    @property
    def residual(self) -> Array:
        """Residual of the worst marker, (models, runs) [m]."""
        return np.asarray(np.linalg.norm(self.errors, axis=-1).max(axis=-1))

    @property
    def worst(self) -> int:
        """Index of the run that worst_first begins with."""
        return int(np.argmin(self.rank))

    @property
    def reach(self) -> float:
        """Largest distance of a body from the foot of the arm in these runs, the scale of symbols [m]."""
        return reach(self.rigid)

    def bodies(self, names: Sequence[str], frames: Frames) -> Array:
        """Origins of named bodies, (runs, len(names), 3) [m]."""
        return origins(self.cell, names, frames)

    def moving(self) -> list[int]:
        """Bodies whose ghost ever stands off them far enough not to flicker through their surface."""
        a, b = self.rigid, self.ghost
        shift = np.linalg.norm(b.positions - a.positions, axis=2).max(axis=0)
        turn = np.linalg.norm(b.rotations - a.rotations, axis=(2, 3)).max(axis=0) / np.sqrt(2)
        return np.flatnonzero(shift + 0.2 * self.reach * turn > 0.005 * self.reach).tolist()


def build_drawing(about: Calibration, cell: Cell, campaign: Campaign, results: Sequence[Result]) -> Drawing:
    """Sort the runs and place the arm; one result a model."""
    scenario = campaign.scenario
    data = campaign.measured
    errors = np.array([result.residuals for result in results])
    residual = np.linalg.norm(errors[about.best], axis=-1).max(axis=1)
    rank = np.empty(data.runs, dtype=int)
    rank[np.argsort(-residual, kind="stable")] = np.arange(data.runs)
    before, after = settle_both(cell.plant, scenario.truth, data.q, data.wrench, data.point)
    rigid = rigid_frames(cell.room, data.q)
    M = about.magnification
    return Drawing(
        about=about,
        cell=cell,
        data=data,
        noise=scenario.noise,
        payload=scenario.payload if isinstance(scenario, Scenario) else None,
        estimates=[result.estimate for result in results],
        errors=errors,
        checked=np.isin(data.pose, campaign.check.pose),
        rank=rank,
        rigid=rigid,
        ghost=elastic_frames(cell.plant, data.q, M * (after.theta - before.theta)),
        loading=_load_up(cell, data, int(np.argmin(rank)), (scenario.truth, M), data.deflection - errors),
        residual_scale=_round_scale(RESIDUAL_REACH * reach(rigid), residual.max()),
    )


def _load_up(cell: Cell, data: Dataset, run: int, shown: tuple[Truth, float], predicted: Array) -> Loading:
    """Equilibria of the true arm from no load to the whole; the models are linear in the load.

    Args:
        cell: The arm.
        data: The runs.
        run: Index of the one to load.
        shown: Kind of truth, and magnification of its deflection [1].
        predicted: Deflections by each model, (models, runs, m, 3) [m].
    """
    truth, magnification = shown
    share = np.linspace(0, 1, STEPS + 1)
    q, point = (np.tile(a[run], (len(share), 1)) for a in (data.q, data.point))
    before, after = settle_both(cell.plant, truth, q, share[:, None] * data.wrench[run], point)
    return Loading(
        run=run,
        share=share,
        deflection=after.markers - before.markers,
        predicted=predicted[:, run, None] * share[:, None, None],
        rigid=rigid_frames(cell.room, q),
        ghost=elastic_frames(cell.plant, q, magnification * (after.theta - before.theta)),
    )


def _round_scale(drawn: float, true: float) -> float:
    """Magnification 1, 2 or 5 times a power of ten, at most drawn / true."""
    scale = min(drawn / max(true, 1e-30), MAX_RESIDUAL_SCALE)
    power = 10.0 ** np.floor(np.log10(scale))
    return float(power * max(k for k in (1, 2, 5) if k * power <= scale * (1 + 1e-9)))
