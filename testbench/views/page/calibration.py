"""A calibration as it is drawn: the arm over the workspace, in its runs and while it is loaded; errors."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import Campaign, Cell, Truth, settle_both
from testbench.bench.error_places import ErrorPlaces
from testbench.bench.judged import Result
from testbench.bench.rows import MM, FitRow
from testbench.data.dataset import Dataset, in_order
from testbench.errors import Array
from testbench.identify import Estimate
from testbench.identify.evaluate import all_deflections
from testbench.plant.shapes import elastic_frames, origins, rigid_frames
from testbench.views.colours import LOAD, MEASURED, Look, look
from testbench.views.magnified import round_scale
from testbench.views.page.charts import Line, PlaceMap, RunChart
from testbench.views.page.page import Seen
from testbench.views.page.scene import Layer, Poses, Scene

ARROWS = 0.25  #: Length of an arrow longer than 95 % of all over the reach of the arm [1].
OVER = "Error in each pose of the workspace, against the truth, RMS over the markers (mm)"
LEFT = "What is left in each run, against its readings, RMS over the markers (mm)"
WHILE = "Error while the arm is loaded (mm)"
LOADING, STEPS = "Loading", 20
"""Name of the poses of loading, and steps from nothing to the whole load."""
STEEL, SLING = 7850.0, 0.2
"""Density of a drawn weight, a cube [kg/m^3]; length of its sling, or of a force, over the reach [1]."""
EDGES = [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit]
"""Corners of a cube that an edge joins, numbered by their bits."""


@dataclass(frozen=True)
class _Set:
    """Poses, and what each model leaves of their deflections."""

    name: str  #: Of the set.
    names: Sequence[str]  #: Of its poses.
    data: Dataset
    wrong: Array  #: Deflections minus predictions, (models, runs, m, 3) [m].
    first: int = 0  #: Pose that is shown first.
    sweep: str = ""  #: See `Poses`.
    error_mm: Array = field(init=False)  #: Root mean square over the markers of distances, (models, runs).

    def __post_init__(self) -> None:
        """Lengths of what is left."""
        object.__setattr__(self, "error_mm", MM * np.sqrt((self.wrong**2).sum(axis=-1).mean(axis=-1)))


@dataclass(frozen=True)
class _Drawn:
    """What places arms and models."""

    cell: Cell
    truth: Truth
    models: Sequence[FitRow]
    estimates: Sequence[Estimate]
    size: float  #: Magnification of deflections [1].

    def missed(self, data: Dataset) -> Array:
        """True deflections minus those of each model, (models, runs, m, 3) [m]."""
        return np.asarray(data.deflection - all_deflections(self.cell.vjm, self.estimates, data))

    def lines(self, own: _Set) -> list[Line]:
        """Errors of each model."""
        return [Line(m.name, _look(m), mm) for m, mm in zip(self.models, own.error_mm, strict=True)]

    def poses(self, own: _Set, arrows: float) -> Poses:
        """The arm in every pose of a set under its load, and where each model errs."""
        cell, data, M = self.cell, own.data, self.size
        before, after = settle_both(cell.plant, self.truth, data.q, data.wrench, data.point)
        at = before.markers + M * data.deflection
        bent = elastic_frames(cell.plant, data.q, M * (after.theta - before.theta))
        hook = origins(cell.room, [cell.arm.load], bent)[:, 0]
        moved = MM * np.linalg.norm(data.deflection, axis=-1).max(axis=1)
        said = [
            f"Markers move up to {mm:.2f} mm. Error: "
            + ", ".join(f"{m.name} {x:.3f} mm" for m, x in zip(self.models, left, strict=True))
            + f". Joints at {cell.arm.words(q)}."
            for mm, left, q in zip(moved.tolist(), own.error_mm.T.tolist(), data.q, strict=True)
        ]
        errors = [
            Layer(f"error of {m.name}", _look(m).colour, "arrows", at, at - arrows * wrong)
            for m, wrong in zip(self.models, own.wrong, strict=True)
        ]
        return Poses(
            name=own.name,
            names=own.names,
            words=said,
            rigid=rigid_frames(cell.room, data.q),
            bent=bent,
            layers=[
                Layer("markers under load", MEASURED, "dots", at),
                *errors,
                *load_layers(hook, data.wrench, cell.vjm.reach),
            ],
            first=own.first,
            sweep=own.sweep,
        )


def calibration_seen(
    made: tuple[Cell, Campaign, Sequence[Result]], rows: Sequence[FitRow], found: ErrorPlaces, size: float
) -> Seen:
    """What is drawn of a calibration in simulation: the models that are compared, and joints alone.

    Args:
        made: The true arm, what was measured, and results, one a row.
        rows: Models of the report.
        found: Its map; the order of its places is that of the poses.
        size: Magnification of the deflections [1].
    """
    cell, campaign, results = made
    named = [m.name for m in rows]
    shown = [named.index(name) for name in dict.fromkeys((*found.compared, JOINTS)) if name in named]
    models, chosen = [rows[k] for k in shown], [results[k] for k in shown]
    drawn = _Drawn(cell, campaign.scenario.truth, models, [own.estimate for own in chosen], size)
    every, number = campaign.measured, {run: k for k, run in enumerate(campaign.truth.run.tolist())}
    over = in_order(campaign.truth, np.array([number[run] for run in found.run]))
    names = [f"Place {k} of {over.runs}" for k in range(1, over.runs + 1)]
    places = _Set("Workspace, against the truth", names, over, drawn.missed(over))
    residuals = np.array([own.residuals for own in chosen])
    runs = _Set("Runs, against their readings", _named(campaign), every, residuals)
    last = [m.name for m in models].index(found.compared[-1])
    runs = replace(runs, first=int(runs.error_mm[last].argmax()))
    loading = _loading(drawn, in_order(over, np.zeros(STEPS + 1, dtype=int)))
    reach = float(np.linalg.norm(over.before[:, 0], axis=-1).max())
    arrows = round_scale(ARROWS * reach, float(np.quantile(np.linalg.norm(places.wrong, axis=-1), 0.95)))
    return Seen(
        scene=Scene(
            cell,
            f"Deflections x {size:g}, arrows of errors x {arrows:g}.",
            [drawn.poses(own, arrows) for own in (places, runs, loading)],
        ),
        map=PlaceMap(OVER, 0, np.array(found.position_m), drawn.lines(places)),
        runs=[
            RunChart(LEFT, 1, [str(run) for run in every.run], drawn.lines(runs)),
            RunChart(WHILE, 2, [name.split()[0] for name in loading.names], drawn.lines(loading)),
        ],
    )


def _loading(drawn: _Drawn, data: Dataset) -> _Set:
    """One place again and again, its load from nothing to the whole: true equilibria."""
    share = np.linspace(0, 1, len(data.run))
    steps = replace(data, run=np.arange(len(share)), wrench=share[:, None] * data.wrench)
    rests = settle_both(drawn.cell.plant, drawn.truth, steps.q, steps.wrench, steps.point)
    before, after = (rest.markers for rest in rests)
    steps = replace(steps, before=before, after=after)
    names = [f"{100 * own:.0f} % of the load, place 1" for own in share]
    return _Set(LOADING, names, steps, drawn.missed(steps), len(share) - 1, "load")


def load_layers(hook: Array, wrench: Array, reach: float) -> list[Layer]:
    """Forces as arrows from a point, where all pull down as weights on slings; moments as arrows.

    Args:
        hook: Where the load acts, (poses, 3) [m].
        wrench: Force and moment, world axes, (poses, 6) [N, N m].
        reach: Of the arm [m].
    """
    force, moment = wrench[:, :3], wrench[:, 3:]
    if not moment.any() and not force[:, :2].any() and (force[:, 2] <= 0).all():
        return [_weights(hook, -force[:, 2] / GRAVITY, SLING * reach)]
    found = []
    for name, parts in (("force", force), ("moment", moment)):
        size = np.linalg.norm(parts, axis=1, keepdims=True)
        if size.any():
            way = np.where(size > 0, parts / np.where(size > 0, size, 1), np.nan)
            found.append(Layer(name, LOAD, "arrows", hook[:, None], (hook + SLING * reach * way)[:, None]))
    return found


def _weights(hook: Array, mass: Array, sling: float) -> Layer:
    """A sling and the twelve edges of a cube of steel below it."""
    half = np.cbrt(mass / STEEL)[:, None, None] / 2
    corner = np.array([[k & 1, k >> 1 & 1, k >> 2] for k in range(8)]) * 2.0 - 1
    end = hook - [0, 0, sling]
    at = end[:, None] - half * [0, 0, 1] + half * corner
    a, b = np.transpose(EDGES)
    begins = np.concatenate([hook[:, None], at[:, a]], axis=1)
    return Layer("load", LOAD, "lines", begins, np.concatenate([end[:, None], at[:, b]], axis=1))


def _named(campaign: Campaign) -> list[str]:
    """Every run by its number and what it is for."""
    data, used = campaign.measured, set(campaign.identification.pose.tolist())
    pairs = zip(data.run.tolist(), data.pose.tolist(), strict=True)
    return [f"Run {run}, {'fitted' if pose in used else 'check'} pose {pose}" for run, pose in pairs]


def _look(model: FitRow) -> Look:
    return look(model.structure, model.constraint, model.prior)
