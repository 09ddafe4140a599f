"""Where a series starts: its frame and mount by the nominal arm, from its positions and orientations alone.

Closed forms of `identify.frames`, refined by `identify.registration`; nothing is asked of nominal targets, so
a mount may be turned by any angle.
"""

from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.data.series import Series, select_rows
from testbench.errors import Array, BenchError
from testbench.identify.absolute.state import Frame, Mount, State, tell
from testbench.identify.registration import Registration, register
from testbench.model.vjm import Vjm

MOST = 300  #: Rows that an alignment uses, evenly spaced.
HALF = 12  #: Rows of half a series below which it may fit anything.
LEAST = 6  #: Rows below which frame and mount of a series are not known.
FAR = 0.02
"""Median distance of readings from the nominal arm, over the targets' distance from its base, beyond which it
is another arm, or its joint angles are in another unit."""


def aligned(state: State, series: tuple[Series, ...]) -> State:
    """The state with a frame and a mount for every series; those that it has are kept.

    Raises:
        BenchError: When a series has too few rows, or does not fit the arm.
    """
    frames, mounts = dict(state.frames), dict(state.mounts)
    for one in series:
        if one.frame in frames and one.target in mounts:
            continue
        frame, mount = align(state, one)
        frames.setdefault(one.frame, frame)
        mounts.setdefault(one.target, mount)
    return replace(state, frames=frames, mounts=mounts)


def align(state: State, series: Series) -> tuple[Frame, Mount]:
    """Frame and mount of one series by the arm's nominal geometry."""
    found = _registered(state.vjm, series)
    if not _fits(found):
        found = _of_a_half(state.vjm, series) or found
    if not _fits(found):
        raise BenchError(_another(state.vjm, series, found))
    rotation = found.frames[0].rotation
    order = [found.markers.index(name) for name in series.markers]
    mount = Mount(found.targets[order], np.eye(3))
    frame = Frame(rotation, found.frames[0].translation)
    if not series.turned.any():
        return frame, mount
    read = select_rows(series, series.turned)
    tool = tell(state, read.q, read.wrench, read.point).where.rotation
    assert read.rotation is not None
    turns = tool.swapaxes(1, 2) @ rotation.T @ read.rotation
    return frame, replace(mount, rotation=_mean(turns))


def _fits(found: Registration) -> bool:
    return found.typical < FAR * found.reach


def _of_a_half(vjm: Vjm, series: Series) -> Registration | None:
    """Frame and mount of the first half, where it fits and the second fits others: something moved far."""
    order = np.argsort(series.row, kind="stable")
    halves = np.array_split(order, 2)
    if len(halves[0]) < HALF:
        return None
    try:
        first, second = (_registered(vjm, select_rows(series, half)) for half in halves)
    except BenchError:
        return None
    return first if _fits(first) and _fits(second) else None


def _registered(vjm: Vjm, series: Series) -> Registration:
    seen = np.flatnonzero(series.seen.any(axis=1))
    if len(seen) < LEAST:
        raise BenchError(
            f"{series.name}: {len(seen)} rows with a reading are too few for its frame and target; expected "
            f"at least {LEAST}, in poses that turn three joints"
        )
    some = select_rows(series, seen[np.linspace(0, len(seen) - 1, min(MOST, len(seen))).astype(int)])
    bare = replace(vjm, arm=replace(vjm.arm, markers=()), markers=np.zeros((0, 3)))
    try:
        return register(bare, _unloaded(some))
    except BenchError as why:
        raise BenchError(f"{series.name}: {why}") from None


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


def _another(vjm: Vjm, series: Series, found: Registration) -> str:
    """Why the readings do not fit: another unit of the joints that would, or another arm."""
    said = (
        f"{series.name}: the readings do not fit this arm, {1e3 * found.typical:.3g} mm (median) in any frame"
    )
    for factor, words in ((np.pi / 180, "degrees"), (180 / np.pi, "radians, converted once too often")):
        hinge = np.array([not joint.prismatic for joint in vjm.arm.joints])
        try:
            other = _registered(vjm, replace(series, q=np.where(hinge, factor, 1.0) * series.q))
        except BenchError:
            continue
        if _fits(other):
            return f"{said}; they would if its joint angles were {words}"
    return f"{said}; another arm, another order or sign of its joints, or other units?"
