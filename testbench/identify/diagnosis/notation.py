"""Mistakes in absolute readings that fit no frame: undone until they do, with orientations as targets."""

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, combinations
from typing import Literal

import numpy as np

from testbench.data.series import Series, select_rows
from testbench.errors import Array, BenchError
from testbench.identify.absolute.align import Misfit
from testbench.identify.absolute.noise import Noise
from testbench.identify.absolute.state import State
from testbench.identify.diagnosis.finding import Finding
from testbench.identify.diagnosis.place import Free, Seen
from testbench.identify.diagnosis.shifted import slipped
from testbench.identify.diagnosis.undone import BETTER as NATS
from testbench.identify.diagnosis.undone import CHOICE, LOST, PRECISE, Hypothesis, placed
from testbench.model.vjm import Vjm

ROWS = (
    300  #: Rows of a series, evenly out of all, that tell what is wrong, or which way the last joint turns.
)
BETTER = 0.5  #: Scatter over that of the readings as they are, below which they were mistaken [1].
ARM = 0.3  #: Distance of the targets that stand for an orientation from the one that has it [m].
FREE = Free(frame=True, targets=True, lost=True)  #: What is not known of a series.
Axes = Literal["XYZ", "xyz", "ZYX", "zyx", "ZYZ", "zyz", "ZXZ", "zxz", ""]
ANGLES: Mapping[str, Axes] = {
    "intrinsic xyz": "XYZ",
    "extrinsic xyz": "xyz",
    "intrinsic zyx": "ZYX",
    "extrinsic zyx": "zyx",
    "intrinsic zyz": "ZYZ",
    "extrinsic zyz": "zyz",
    "intrinsic zxz": "ZXZ",
    "extrinsic zxz": "zxz",
    "vector": "",
}
"""Usual notations of an orientation by three angles, as a map names them and as SciPy does."""


def check_last_joint(
    vjm: Vjm, series: Sequence[Series], fitted: Callable[[tuple[Series, ...]], tuple[State, Noise]]
) -> None:
    """Refuse readings that fit much better with the last joint turned the other way, by BenchError.

    With a target near its axis they fit a frame either way. Orientations tell.

    Args:
        vjm: The arm.
        series: The readings.
        fitted: A first fit of some series.
    """
    if any(one.rotation is not None for one in series):
        return
    thin = [select_rows(one, np.linspace(0, one.rows - 1, min(ROWS, one.rows)).astype(int)) for one in series]
    sign = np.where(np.arange(vjm.arm.n_joints) == vjm.arm.n_joints - 1, -1.0, 1.0)
    try:
        other = fitted(tuple(replace(one, q=sign * one.q) for one in thin))[1].open_position
    except BenchError:
        return
    own = fitted(tuple(thin))[1].open_position
    if other < BETTER * own:
        raise BenchError(
            f"{series[0].name}: the readings fit this arm to {1e3 * own:.2g} mm along an axis; they would to "
            f"{1e3 * other:.2g} mm if {vjm.arm.joints[-1].name} counted the other way"
        )


def check_order(vjm: Vjm, series: Sequence[Series]) -> None:
    """Refuse a series whose rows slipped against their poses somewhere, by Misfit."""
    for one in series:
        if found := _slipped(vjm, one):
            raise Misfit(f"{one.name}: its rows from {found.where[1]} on do not fit those before", one)


def unplaced(vjm: Vjm, series: Series) -> Finding | None:
    """The mistake that keeps a series from fitting the arm in any frame, if one explains it."""
    if found := _slipped(vjm, series):
        return found
    some = np.linspace(0, series.rows - 1, min(ROWS, series.rows)).astype(int)
    one = select_rows(series, some)  # of all: joints may move one after the other
    seen = _seen(vjm, one, one.rotation)
    rolled = ((shift, np.roll(series.q, shift, axis=0)[some]) for shift in (1, -1))
    orders = (Hypothesis("order", replace(seen, q=q), FREE, (), shift, CHOICE) for shift, q in rolled)
    notations = (
        Hypothesis("notation", _seen(vjm, one, rotation), FREE, names, numbers=CHOICE)
        for names, rotation in _notations(one)
    )
    moved = ((names, _seen(vjm, replace(one, position=own), one.rotation)) for names, own in _axes(one))
    axes = (Hypothesis("axes", own, FREE, names, numbers=CHOICE) for names, own in moved)
    return placed(seen, FREE, "all", chain(orders, notations, axes))[0]


def _slipped(vjm: Vjm, series: Series) -> Finding | None:
    """The row from which on readings are those of the pose before or after."""
    seen = _seen(vjm, series, series.rotation)
    slip = slipped(seen, FREE, LOST * seen.scale, NATS)
    if slip is None:
        return None
    where = "all", str(seen.runs[slip.first])
    return Finding("order", where, np.array([slip.shift]), {"was": slip.was, "now": slip.now})


def _axes(series: Series) -> Iterator[tuple[tuple[str, ...], Array]]:
    """Positions with two axes exchanged, or the sign of one; orientations alone tell which."""
    if series.rotation is None:
        return
    for k, name in enumerate("xyz"):
        yield (name,), series.position * np.where(np.arange(3) == k, -1.0, 1.0)
    for i, j in combinations(range(3), 2):
        order = np.arange(3)
        order[[i, j]] = j, i
        yield ("xyz"[i], "xyz"[j]), series.position[..., order]


def _notations(series: Series) -> Iterator[tuple[tuple[str, ...], Array]]:
    """Orientations in other notations: what is meant, and as what it was read; all that are the same."""
    if series.rotation is None:
        return
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    some = np.where(series.turned[:, None, None], series.rotation, np.eye(3))
    yield (), some.swapaxes(1, 2)
    R, found = Rotation.from_matrix(some), dict[bytes, tuple[tuple[str, ...], Array]]()
    for read, axes in ANGLES.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # two angles about one axis: any pair of them will do
            numbers = R.as_euler(axes) if axes else R.as_rotvec()
        for meant, order in ANGLES.items():
            own = Rotation.from_euler(order, numbers) if order else Rotation.from_rotvec(numbers)
            matrix = own.as_matrix()
            same = (matrix.round(3) + 0.0).tobytes()
            names, _ = found.get(same, ((), matrix))
            if meant != read:
                found[same] = (*names, meant, read), matrix
    yield from found.values()


def _seen(vjm: Vjm, series: Series, rotation: Array | None) -> Seen:
    """A series with three more targets for an orientation, nothing known of where any of them is."""
    read, there = series.position, series.seen
    if rotation is not None:
        turned = series.turned[:, None] & there[:, :1]
        more = read[:, :1] + ARM * np.where(turned[..., None], rotation.swapaxes(1, 2), 0)
        read, there = np.concatenate([read, more], axis=1), np.hstack([there, np.repeat(turned, 3, axis=1)])
    return Seen(
        vjm=vjm,
        q=series.q,
        markers=np.zeros((read.shape[1], 3)),
        read=read,
        there=there,
        names=series.markers,
        runs=series.row,
        poses=series.pose,
        scale=PRECISE * vjm.reach,
    )
