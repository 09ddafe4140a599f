"""What the model to take leaves of a user's runs, and how sure it is in poses that were never measured."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from testbench.bench.campaign import Cell, clear_poses, stream
from testbench.bench.fits import Identified, Runs
from testbench.bench.stiffness_write import weights_known
from testbench.correct.arm_model import ArmModel, of_estimate
from testbench.correct.predicted import predict
from testbench.data.dataset import Dataset
from testbench.errors import Array, NoEquilibrium, PoseError
from testbench.identify.evaluate import all_deflections, noise_limit
from testbench.model.load import Load
from testbench.model.vjm import tool_pose

PLACES = 200  #: Poses over the workspace.


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """The tool in poses all over the workspace, under the largest load that was fitted."""

    load: Load
    q: Array  #: Joints, (places, n) [rad, m].
    position: Array  #: Of the unloaded tool, (places, 3) [m].
    deflection: Array  #: How far the load moves it, (places,) [m].
    half: Array  #: Widest half width of its 95 % interval along an axis, (places,) [m]; infinite if unseen.


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


def explained(filed: Cell, cell: Cell, found: Identified, runs: Runs, *, widths: bool) -> Explained:
    """Residuals of all models, and the intervals of the one to take.

    Args:
        filed: The arm as its folder has it.
        cell: The same with the targets that were found.
        found: Its fits.
        runs: What was fitted, and what was held back.
        widths: Whether intervals are wanted.
    """
    data, names = runs.every, list(found.estimates)
    moved = all_deflections(cell.vjm, [found.estimates[name] for name in names], data)
    left = np.where(data.seen[..., None], data.deflection - moved, 0.0)
    by_name = dict(zip(names, left, strict=True))
    if not widths:
        return Explained(found, runs, by_name, None, "intervals were not asked for")
    try:
        model = of_estimate(filed.vjm, found.taken, weights_known(filed.arm)[0])
        return Explained(found, runs, by_name, _elsewhere(filed, model, runs.used))
    except (PoseError, NoEquilibrium) as err:
        return Explained(found, runs, by_name, None, str(err))


def longest(vectors: Array) -> Array:
    """Length of the longest of every run, (runs, m, 3) to (runs,)."""
    return np.asarray(np.linalg.norm(vectors, axis=2).max(axis=1))


def _elsewhere(cell: Cell, model: ArmModel, data: Dataset) -> Elsewhere:
    k = int(np.linalg.norm(data.wrench[:, :3], axis=1).argmax())
    load = Load(data.wrench[k], data.point[k])
    q = clear_poses(cell, None, PLACES, stream(0))
    moved = predict(model, q, [load], points=np.zeros((0, 3)))
    return Elsewhere(load, q, tool_pose(cell.vjm, q)[0], moved.size[:, 0], moved.widest[:, 0])
