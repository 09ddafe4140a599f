"""What the model to take leaves of a user's runs, and how sure it is in poses that were never measured."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import Cell, clear_poses, stream
from testbench.bench.fit_rows import Fits, Fitted
from testbench.bench.fits import Identified, Runs
from testbench.bench.stiffness_write import weights_known
from testbench.correct.arm_model import of_estimate
from testbench.correct.predicted import predict
from testbench.data.dataset import Dataset, Ids
from testbench.errors import Array, NoEquilibrium, PoseError
from testbench.identify.evaluate import all_deflections, noise_limit
from testbench.model.load import Load
from testbench.model.vjm import tool_pose

PLACES = 200  #: Poses over the workspace.


@dataclass(frozen=True, eq=False)
class Sure:
    """A model's prediction of the tool at every place."""

    moved: Array  #: By the load, world axes, (places, 3) [m].
    half: Array  #: Widest half width of its 95 % interval along an axis, (places,) [m]; infinite if unseen.


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """The tool in poses all over the workspace, under the largest load that was fitted."""

    load: Load
    q: Array  #: Joints, (places, n) [rad, m].
    position: Array  #: Of the unloaded tool, (places, 3) [m].
    taken: str  #: Name of the model to take.
    models: Mapping[str, Sure]  #: Those that are compared, the model to take last.
    missing: tuple[str, ...] = ()  #: Models so soft that the load finds no equilibrium.

    @property
    def deflection(self) -> Array:
        """How far the load moves the tool by the model to take, (places,) [m]."""
        return np.asarray(np.linalg.norm(self.models[self.taken].moved, axis=1))

    @property
    def half(self) -> Array:
        """Half widths of the model to take, (places,) [m]; infinite if unseen."""
        return self.models[self.taken].half

    def of(self, places: Ids) -> "Elsewhere":
        """Some places, in an order."""
        models = {name: Sure(own.moved[places], own.half[places]) for name, own in self.models.items()}
        return replace(self, q=self.q[places], position=self.position[places], models=models)

    def apart(self, name: str) -> Array:
        """How far a model has the tool from where the model to take has it, (places,) [m]."""
        return np.asarray(np.linalg.norm(self.models[name].moved - self.models[self.taken].moved, axis=1))


@dataclass(frozen=True, eq=False)
class Explained:
    """Models of a user's runs, and what they leave."""

    found: Identified
    runs: Runs
    left: Mapping[
        str, Array
    ]  #: Reading minus model by its name, (runs, m, 3) [m]; 0 where a target was lost.
    elsewhere: Elsewhere | None  #: Of the model to take; None where it was not wanted or cannot be had.
    note: str = ""  #: Why not.

    @property
    def noise_limit(self) -> float:
        """What noise alone leaves at the worst target of a run at most, in 95 % of runs [m]."""
        return noise_limit(self.runs.every)

    @property
    def taken(self) -> Array:
        """Longest of the model to take in every run, (runs,) [m]."""
        return longest(self.left[self.found.fits.recommended])


def explained(filed: Cell, cell: Cell, found: Identified, *, widths: bool) -> Explained:
    """Residuals of all models, and the intervals of the one to take.

    Args:
        filed: The arm as its folder has it.
        cell: The same with the targets that were found.
        found: Its fits.
        widths: Whether intervals are wanted.
    """
    runs, names = found.runs, list(found.estimates)
    data = runs.every
    moved = all_deflections(cell.vjm, [found.estimates[name] for name in names], data)
    left = np.where(data.seen[..., None], data.deflection - moved, 0.0)
    by_name = dict(zip(names, left, strict=True))
    if not widths:
        return Explained(found, runs, by_name, None, "intervals were not asked for")
    try:
        return Explained(found, runs, by_name, _elsewhere(filed, found, runs.used))
    except (PoseError, NoEquilibrium) as err:
        return Explained(found, runs, by_name, None, str(err))


def longest(vectors: Array) -> Array:
    """Length of the longest of every run, (runs, m, 3) to (runs,)."""
    return np.asarray(np.linalg.norm(vectors, axis=2).max(axis=1))


def compared(fits: Fits) -> list[Fitted]:
    """Least squares, GCO without prior, joints alone, where they are, and last the model to take."""
    [taken] = [m for m in fits.models if m.name == fits.recommended]
    others = [m for m in fits.models if not m.prior and m is not taken]
    kinds = [
        [m for m in others if m.structure != JOINTS and m.constraint == "none"],
        [m for m in others if m.structure != JOINTS and m.constraint == "psd"],
        [m for m in others if m.structure == JOINTS],
    ]
    return [*(kind[0] for kind in kinds if kind), taken]


def _elsewhere(cell: Cell, found: Identified, data: Dataset) -> Elsewhere:
    """PoseError or NoEquilibrium where the model to take cannot be had."""
    k = int(np.linalg.norm(data.wrench[:, :3], axis=1).argmax())
    load = Load(data.wrench[k], data.point[k])
    q, weights = clear_poses(cell, None, PLACES, stream(0)), weights_known(cell.arm)[0]
    sure: dict[str, Sure] = {}
    missing: list[str] = []
    for model in compared(found.fits):
        own = of_estimate(cell.vjm, found.estimates[model.name], weights)
        try:
            moved = predict(own, q, [load], points=np.zeros((0, 3)))
        except NoEquilibrium:
            if model.name == found.fits.recommended:
                raise
            missing.append(model.name)
        else:
            sure[model.name] = Sure(moved.deflection[:, 0], moved.widest[:, 0])
    position = tool_pose(cell.vjm, q)[0]
    return Elsewhere(load, q, position, found.fits.recommended, sure, tuple(missing))
