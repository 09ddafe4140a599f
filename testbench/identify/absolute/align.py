"""Where a series starts: its frame and mount by the nominal arm, from its positions and orientations alone.

Closed forms of `identify.frames`, refined by `identify.registration`; nothing is asked of nominal targets, so
a mount may be turned by any angle.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.folder import Joint
from testbench.data.dataset import Dataset
from testbench.data.series import Series, select_rows
from testbench.errors import Array, BenchError
from testbench.identify.absolute.state import Frame, Mount, State, in_batches, tell
from testbench.identify.diagnosis.notation import explained, renamed
from testbench.identify.frames import Found, points, starts, unloaded
from testbench.identify.registration import register
from testbench.model.vjm import Vjm, tool_pose

MOST = 300  #: Rows that an alignment uses, evenly spaced.
FEW = 60  #: The same where it is tried what would mend readings.
HALF = 12  #: Rows of half a series below which it may fit anything.
TURNING, STILL = (
    3,
    1e-3,
)  #: Joints that turn in a series at least; by less than so much one does not [rad, m].
LEAST = 6  #: Poses below which frame and mount of a series are not known.
FAR = 0.02
"""Median distance of readings from the nominal arm, over the tool's distance from its base, beyond which it
is another arm, or its joint angles are in another unit."""
TURNED = 0.1  #: Median angle of orientations from it beyond which they are in another notation [rad].


def align(state: State, series: Series) -> tuple[Frame, Mount]:
    """Frame and mount of one series by the arm's nominal geometry.

    Where something moved far in mid-series, those of its first half.
    """
    _check(series, state.vjm.arm.joints)
    found = _tried(state, series, MOST)
    if isinstance(found, Aligned) and found.fits:
        return found.frame, found.mount
    half = _of_a_half(state, series)
    if half is not None:
        return half.frame, half.mount
    raise BenchError(f"{series.name}: {_why(state, series, found)}")


@dataclass(frozen=True)
class Aligned:
    """Frame and mount of a series, and how well they fit."""

    frame: Frame
    mount: Mount
    typical: float  #: Median distance of readings from the nominal arm [m].
    turn: float  #: Median angle of orientations from it [rad]; 0 without any.
    reach: float  #: Median distance of the tool from the arm's base [m].

    @property
    def near(self) -> bool:
        """Whether positions fit."""
        return self.typical < FAR * self.reach

    @property
    def fits(self) -> bool:
        """Whether positions and orientations fit."""
        return self.near and self.turn < TURNED


def _check(series: Series, joints: Sequence[Joint]) -> None:
    """Refuse a series without enough readings, by BenchError."""
    lost = [name for k, name in enumerate(series.markers) if not series.seen[:, k].any()]
    if lost:
        raise BenchError(f"{series.name}: {', '.join(lost)} was never read; leave such a target out")
    poses = len(np.unique(series.q[series.seen.any(axis=1)], axis=0))
    numbers = 6 + 3 * len(series.markers) + 3 * bool(series.turned.any())
    if poses < LEAST:
        raise BenchError(
            f"{series.name}: {poses} poses with a reading are too few for the {numbers} numbers of its frame "
            f"and mount; expected at least {LEAST}, in which {TURNING} joints turn"
        )
    turning = [j.name for j, size in zip(joints, np.ptp(series.q, axis=0), strict=True) if size > STILL]
    if len(turning) < min(TURNING, len(joints)):
        raise BenchError(
            f"{series.name}: only {' and '.join(turning)} turn; expected {TURNING} joints that do, for the "
            f"{numbers} numbers of its frame and mount"
        )


def _tried(state: State, series: Series, most: int) -> Aligned | BenchError:
    """Frame and mount by so many rows, or why there are none."""
    seen = np.flatnonzero(series.seen.any(axis=1))
    some = select_rows(series, seen[np.linspace(0, len(seen) - 1, min(most, len(seen))).astype(int)])
    vjm = state.vjm
    bare = replace(vjm, arm=replace(vjm.arm, markers=()), markers=np.zeros((0, 3)))
    try:
        found = register(bare, _unloaded(some))
    except BenchError as why:
        return why
    rotation = found.frames[0].rotation
    frame = Frame(rotation, found.frames[0].translation)
    order = [found.markers.index(name) for name in series.markers]
    turns = _turns(state, some, rotation)
    mount = _mean(turns) if len(turns) else np.eye(3)
    turn = float(np.median(_angle(mount.T @ turns))) if len(turns) else 0.0
    return Aligned(
        frame, Mount(found.targets[order], mount, series.markers), found.typical, turn, reach(vjm, some)
    )


def reach(vjm: Vjm, series: Series) -> float:
    """Median distance of the tool from the arm's base in the poses of a series [m]."""
    tool, _ = tool_pose(vjm, series.q)
    return float(np.median(np.linalg.norm(tool - vjm.base[:3, 3], axis=1)))


def _turns(state: State, series: Series, rotation: Array) -> Array:
    """The tool from the target by every orientation, (read, 3, 3), in a frame turned by a rotation."""
    read = select_rows(series, series.turned)
    if not read.rows:
        return np.zeros((0, 3, 3))
    assert read.rotation is not None
    parts = (tell(state, some.q, some.wrench, some.point) for some in in_batches(read))
    tool = np.concatenate([told.where.rotation for told in parts])
    return np.asarray(tool.swapaxes(1, 2) @ rotation.T @ read.rotation)


def _angle(R: Array) -> Array:
    """Of rotations, (runs, 3, 3), their angles [rad]."""
    cosine = (np.trace(R, axis1=1, axis2=2) - 1) / 2
    return np.asarray(np.arccos(np.clip(cosine, -1, 1)))


def _of_a_half(state: State, series: Series) -> Aligned | None:
    """Frame and mount of the first half, where it fits and so does the second: something moved far."""
    halves = np.array_split(np.argsort(series.row, kind="stable"), 2)
    if len(halves[0]) < HALF:
        return None
    parts = [select_rows(series, half) for half in halves]
    if not all(_fits_roughly(state, part) for part in parts):
        return None
    first, second = (_tried(state, part, MOST) for part in parts)
    return first if _fit(first) and _fit(second) and isinstance(first, Aligned) else None


def _fit(found: Aligned | BenchError) -> bool:
    return isinstance(found, Aligned) and found.fits


def _unloaded(series: Series) -> Dataset:
    """A series as a dataset that has never been loaded: sag is left to the errors of the arm."""
    precision = None
    if series.precision is not None:
        precision = np.where(series.seen[..., None, None], np.eye(3) / (2 * series.sigma**2), 0.0)
    return Dataset(
        markers=series.markers,
        run=np.arange(series.rows),
        pose=np.arange(series.rows),
        q=series.q,
        wrench=np.zeros((series.rows, 6)),
        point=np.zeros((series.rows, 3)),
        before=series.position,
        after=series.position,
        sigma=series.sigma,
        precision=precision,
    )


def _mean(R: Array) -> Array:
    """The rotation nearest to many, (runs, 3, 3); their median sense is not asked: it is a start."""
    U, _, Vt = np.linalg.svd(R.sum(axis=0))
    return np.asarray(U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt)


def _why(state: State, series: Series, found: Aligned | BenchError) -> str:
    """Why readings do not fit, and what would mend them."""
    few = select_rows(series, np.linspace(0, series.rows - 1, min(FEW, series.rows)).astype(int))

    def fits(other: Series) -> bool:
        return _fits_roughly(state, other)

    if isinstance(found, Aligned) and found.near:
        turn = f"{np.degrees(found.turn):.3g} degrees (median)"
        said = f"its positions fit this arm, its orientations do not, {turn} from any mount"
        mended = explained(state.vjm, few, fits) or _renamed(state, series, found)
        return f"{said}; {mended or 'another notation of angles?'}"
    said = "the readings do not fit this arm"
    if isinstance(found, Aligned):
        said += f", {1e3 * found.typical:.3g} mm (median) in any frame"
    mended = explained(state.vjm, few, fits)
    if mended:
        return f"{said}; {mended}"
    ratio = _size(series.position[series.seen]) / _size(tool_pose(state.vjm, series.q)[0])
    spread = f"they spread {ratio:.3g} times as far as its tool"
    return f"{said}; {spread}: another arm, another order of its joints, or other units?"


def _fits_roughly(state: State, series: Series) -> bool:
    """Whether the closed form of frame and mount fits, which is tried a hundred times faster."""
    seen, m = unloaded(state.vjm, _unloaded(series)), len(series.markers)
    none = Found(np.full((1, 3, 3), np.nan), np.full((1, 3), np.nan), np.full((m, 3), np.nan))
    for found in starts(seen, none):
        x = points(seen, found.targets) @ found.rotation[0].T + found.translation[0]
        typical = float(np.median(np.linalg.norm(seen.y - x, axis=1)))
        turns = _turns(state, series, found.rotation[0])
        turn = float(np.median(_angle(_mean(turns).T @ turns))) if len(turns) else 0.0
        return typical < FAR * reach(state.vjm, series) and turn < TURNED
    return False


def _renamed(state: State, series: Series, found: Aligned) -> str:
    """Another notation in which orientations would fit."""
    some = select_rows(series, np.flatnonzero(series.turned)[:FEW])

    def turn(rotation: Array) -> float:
        turns = _turns(state, replace(some, rotation=rotation), found.frame.rotation)
        return float(np.median(_angle(_mean(turns).T @ turns)))

    assert some.rotation is not None
    return renamed(some.rotation, turn, TURNED)


def _size(x: Array) -> float:
    """Root mean square distance of points, (n, 3), from their middle."""
    return float(np.sqrt(x.var(axis=0).sum()))
