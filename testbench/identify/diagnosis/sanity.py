"""Mistakes that need no fit: readings that are equal or repeated, absurd sizes, moves against the force."""

from collections.abc import Iterator

import numpy as np

from testbench.data.dataset import Dataset
from testbench.identify.diagnosis.finding import Finding

FAR = 1.0  #: Distance of a load point from the tool, over the arm's reach, beyond which a unit is wrong [1].
STILL = 0.5  #: Share of the readings that must not move for it to be a mistake of all of them.
AGAINST = 0.8  #: Share of the runs whose targets have to move against the force.


def sanity_checks(data: Dataset, reach: float) -> Iterator[Finding]:
    """Doubts that no fit is needed for, the plainest first; of an arm of this reach [m]."""
    loaded = np.asarray(data.wrench.any(axis=1))[:, None] & data.seen
    still = np.asarray(loaded & (data.deflection == 0).all(axis=2))
    if still.any():
        runs = () if still.sum() > STILL * loaded.sum() else data.run[still.any(axis=1)].tolist()
        size = {"count": int(still.sum()), "of": int(loaded.sum())}
        yield Finding("equal", tuple(str(run) for run in runs), beside=size)
    read = np.where(data.seen[..., None], data.after, np.nan).reshape(data.runs, -1)
    _, first, own = np.unique(read, axis=0, return_index=True, return_inverse=True)
    again = np.flatnonzero((data.q != data.q[first[own]]).any(axis=1) & data.seen.any(axis=1))
    if len(again):
        pair = data.run[again[0]], data.run[first[own[again[0]]]]
        yield Finding("repeated", tuple(str(run) for run in pair))
    away = float(np.linalg.norm(data.point, axis=1).max())
    if away > FAR * reach:
        yield Finding("load_point", beside={"away": away, "reach": reach})


def moved_against(data: Dataset) -> Iterator[Finding]:
    """Whether targets move against the force: an elastic arm gives way."""
    force = data.wrench[:, :3]
    work = np.einsum("rx,rmx->r", force, np.where(data.seen[..., None], data.deflection, 0))
    against, pushed = int((work < 0).sum()), int(force.any(axis=1).sum())  # others turn by a moment alone
    if against and against >= AGAINST * pushed:
        along = np.abs(force[:, :2]).max() < np.abs(force[:, 2]).max() / 10
        upwards = bool((force[:, 2] > 0).mean() > 1 / 2 and along)
        yield Finding("sign", beside={"count": against, "of": pushed, "upwards": upwards})
