"""Mistakes in readings that fit no frame: each is undone in turn until they do, and named."""

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Literal

import numpy as np

from testbench.data.series import Series, select_rows
from testbench.errors import Array, BenchError
from testbench.identify.absolute.noise import Noise
from testbench.identify.absolute.state import State
from testbench.model.vjm import Vjm

UNITS = ((1e-3, "millimetres"), (25.4e-3, "inches"), (1e3, "metres, divided by 1000 once too often"))
"""What positions may be in instead of metres."""
FEW = 300  #: Rows of a series that tell which way the last joint turns.
BETTER = 0.5  #: Scatter over that of the readings as they are, below which they were mistaken [1].
SAME = 1e-3  #: Difference of angles below which two notations fit alike [rad].
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
    thin = [select_rows(one, np.linspace(0, one.rows - 1, min(FEW, one.rows)).astype(int)) for one in series]
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


def explained(vjm: Vjm, series: Series, fits: Callable[[Series], bool]) -> str:
    """What is wrong with the joint angles or positions of a series, as "they would if ..."; "" if unknown.

    Args:
        vjm: The arm.
        series: Readings that do not fit.
        fits: Whether others would.
    """
    return next((words for words, other in _mended(vjm, series) if fits(other)), "")


def _mended(vjm: Vjm, series: Series) -> Iterator[tuple[str, Series]]:
    names = [joint.name for joint in vjm.arm.joints]
    hinge = np.array([not joint.prismatic for joint in vjm.arm.joints])
    for factor, unit in ((np.pi / 180, "degrees"), (180 / np.pi, "radians, converted once too often")):
        words = f"they would if its joint angles were {unit}"
        yield words, replace(series, q=np.where(hinge, factor, 1.0) * series.q)
    for factor, unit in UNITS:
        yield f"they would if its positions were {unit}", replace(series, position=factor * series.position)
    for j, name in enumerate(names):
        sign = np.where(np.arange(len(names)) == j, -1.0, 1.0)
        yield f"they would if {name} counted the other way", replace(series, q=sign * series.q)
    for j in (j for j in range(len(names)) if hinge[j]):
        for turn in (90, -90, 180):
            q = series.q + np.where(np.arange(len(names)) == j, np.radians(turn), 0.0)
            yield f"they would if {turn} degrees were added to {names[j]}", replace(series, q=q)
    for i, j in combinations(range(len(names)), 2):
        order = np.arange(len(names))
        order[[i, j]] = j, i
        words = f"they would if {names[i]} and {names[j]} were exchanged"
        yield words, replace(series, q=series.q[:, order])
    yield "they would if its joints came in the opposite order", replace(series, q=series.q[:, ::-1])
    yield "they would if its axes were left-handed", replace(series, position=series.position * [1, 1, -1])


def renamed(rotation: Array, turn: Callable[[Array], float], most: float) -> str:
    """Another notation in which orientations would fit, as "they would as ..."; "" if there is none.

    Args:
        rotation: Orientations that do not fit, (rows, 3, 3).
        turn: How far others are off [rad].
        most: How far they may be [rad].
    """
    if turn(rotation.swapaxes(1, 2)) < most:
        return "they would if they were of the tracker in the target's frame"
    tried: dict[str, float] = {}
    for read, axes in ANGLES.items():
        numbers = _numbers(rotation, axes)
        for meant in ANGLES.keys() - {read}:
            tried[f"{meant} where they were read as {read}"] = turn(_rotations(numbers, ANGLES[meant]))
    least = min(tried.values())
    found = sorted(words for words, off in tried.items() if off < least + SAME)
    return f"they would as {', or as '.join(found)}" if least < most else ""


def _numbers(rotation: Array, axes: Axes) -> Array:
    """Three numbers of every rotation, (rows, 3) [rad]."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    R = Rotation.from_matrix(rotation)
    if not axes:
        return np.asarray(R.as_rotvec())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # two angles about one axis: any pair of them will do
        return np.asarray(R.as_euler(axes))


def _rotations(numbers: Array, axes: Axes) -> Array:
    from scipy.spatial.transform import Rotation  # here: the same

    R = Rotation.from_euler(axes, numbers) if axes else Rotation.from_rotvec(numbers)
    return np.asarray(R.as_matrix())
