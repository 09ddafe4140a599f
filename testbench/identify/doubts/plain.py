"""Mistakes that need no fit: readings that are equal or repeated, absurd sizes, moves against the force."""

import numpy as np

from testbench.data.dataset import Dataset, Ids
from testbench.identify.doubts.doubt import Doubt

FAR = 1.0  #: Distance of a load point from the tool, over the arm's reach, beyond which a unit is wrong [1].
STILL = 0.5  #: Share of the readings that must not move for it to be a mistake of all of them.
AGAINST = 0.8  #: Share of the runs whose targets have to move against the force.


def plain(data: Dataset, reach: float) -> list[Doubt]:
    """Doubts that no fit is needed for, the plainest first; of an arm of this reach [m]."""
    return [*_equal(data), *_repeated(data), *_far(data, reach)]


def _equal(data: Dataset) -> list[Doubt]:
    loaded = np.asarray(data.wrench.any(axis=1))[:, None] & data.seen
    still = np.asarray(loaded & (data.deflection == 0).all(axis=2))
    if not still.any():
        return []
    runs = data.run[still.any(axis=1)]
    if still.sum() > STILL * loaded.sum():
        sentence = f"after equals before in {still.sum()} of {loaded.sum()} readings: was one of them copied?"
    else:
        sentence = f"after equals before in run {_listed(runs)}: was one of them copied?"
    return [Doubt("equal", sentence)]


def _repeated(data: Dataset) -> list[Doubt]:
    """Loaded readings that are those of another pose, to the last digit."""
    read = np.where(data.seen[..., None], data.after, np.nan).reshape(data.runs, -1)
    _, first, own = np.unique(read, axis=0, return_index=True, return_inverse=True)
    again = np.flatnonzero((data.q != data.q[first[own]]).any(axis=1) & data.seen.any(axis=1))
    if not len(again):
        return []
    run, other = data.run[again[0]], data.run[first[own[again[0]]]]
    return [Doubt("repeated", f"run {run} has the loaded readings of run {other}, in another pose: copied?")]


def _far(data: Dataset, reach: float) -> list[Doubt]:
    away = float(np.linalg.norm(data.point, axis=1).max())
    if away <= FAR * reach:
        return []
    sentence = f"the load acts {away:.3g} m from the tool, the arm reaches {reach:.3g} m: millimetres?"
    return [Doubt("load_point", sentence)]


def moved_against(data: Dataset) -> Doubt | None:
    """Whether targets move against the force: an elastic arm gives way."""
    force = data.wrench[:, :3]
    work = np.einsum("rx,rmx->r", force, np.where(data.seen[..., None], data.deflection, 0))
    against, pushed = int((work < 0).sum()), int(force.any(axis=1).sum())  # others turn by a moment alone
    if not against or against < AGAINST * pushed:
        return None
    upwards = (force[:, 2] > 0).mean() > 1 / 2 and np.abs(force[:, :2]).max() < np.abs(force[:, 2]).max() / 10
    hint = "the force points up: its sign?" if upwards else "before and after exchanged, or the force's sign?"
    return Doubt("sign", f"in {against} of {pushed} runs the targets move against the force: {hint}")


def _listed(runs: Ids) -> str:
    return ", ".join(map(str, runs[:5])) + (" ..." if len(runs) > 5 else "")
