"""Whether the tracker, or the targets on the tool, moved between two readings.

Pairs of readings do not show it unless it falls between the two of a run. What shows it is the step that
`calibrate` looks for: from one reading on all lie elsewhere than the arm says, by a move that no error of
geometry, spring or slow joint error explains.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.special import fdtrc

from testbench.data.dataset import Dataset, Ids, in_order
from testbench.data.series import Series, select_rows, series_of
from testbench.errors import BenchError, InputError
from testbench.identify.absolute.changes import TURN, poses_so_far
from testbench.identify.absolute.fit import first_fit
from testbench.identify.absolute.state import Mount, State, nominal, torque_scale
from testbench.identify.absolute.steps import Linear, Step, best, lacking, moves
from testbench.identify.doubts.doubt import Doubt
from testbench.identify.metric import metric
from testbench.identify.prior import Prior
from testbench.identify.registration import Frame
from testbench.identify.weighed import marker_points
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import Vjm
from testbench.model.weights import Weights, read_weights

CHANCE = 0.05
"""Chance of a step as clear anywhere in readings without one, from which it is no doubt."""
LEAST = 3  #: Poses before and behind a step.
ORDERS = 2  #: Periodic errors that may explain it: few poses tell no more.
MOST = 600  #: Runs that are looked at, evenly out of more.
TARGETS = 30  #: Targets that are looked at, evenly out of more.
NAME = "targets"  #: Of the mount.


def moved(vjm: Vjm, data: Dataset, prior: Prior) -> list[Doubt]:
    """Doubts about what moved between two readings, one a station at most.

    Args:
        vjm: The arm, its targets where they are.
        data: The runs in the base's frame, in order of time.
        prior: What the arm's folder expects.
    """
    data = _fewer_targets(in_order(data, _evenly(data.runs, MOST)))
    series, runs = zip(*_in_time(data), strict=True)
    if not vjm.arm.joints or not any(len(_places(one)) for one in series):
        return []
    try:
        state, noise = first_fit(_start(vjm, series), series, metric(prior, vjm, joints_only(vjm.arm)))
    except BenchError:  # too few readings for where arm and targets are: no step can be told
        return []
    at, found = lacking(state, series, noise, metric(prior, vjm, all153(vjm.arm)), ORDERS), []
    tried = sum(len(_places(one)) for one in series)
    for k, one in enumerate(series):
        if len(_places(one)):
            others = series[:k] + series[k + 1 :]
            both = [best(at, one, _places(one), others, turns=turns) for turns in (False, True)]
            step = min(both, key=_chance)
            if len(both) * tried * _chance(step) < CHANCE:
                words = _sentence(at, one, step, runs[k])
                station = f"station {one.frame.split()[-1]}: " if len(series) > 1 else ""
                name = f"{step.what}_moved"
                found.append(Doubt(name, station + words, step.gain / 2))
    return found


def _evenly(count: int, most: int) -> Ids:
    """So many of some at most, the first and the last among them."""
    return np.linspace(0, count - 1, min(most, count)).astype(int)


def _fewer_targets(data: Dataset) -> Dataset:
    """Some of very many targets: all of them move together, and each has a place to be found."""
    some = _evenly(len(data.markers), TARGETS)
    precision = None if data.precision is None else data.precision[:, some]
    markers = tuple(data.markers[k] for k in some)
    return replace(
        data, markers=markers, before=data.before[:, some], after=data.after[:, some], precision=precision
    )


def _chance(step: Step) -> float:
    """Chance of a step at that place that is as clear, in readings without one."""
    z = len(step.b)
    return float(fdtrc(z, step.free, step.gain / z))


def _in_time(data: Dataset) -> Iterator[tuple[Series, Ids]]:
    """Readings of every station in order of time, numbered 2 k unloaded and 2 k + 1 loaded; and run k.

    An unloaded reading that several loads share is one.
    """
    pose = dict(zip(data.run.tolist(), data.pose.tolist(), strict=True))
    for one in series_of(data, "station", NAME):
        half = one.rows // 2
        loaded = np.arange(one.rows) >= half
        poses = np.array([pose[run] for run in one.row.tolist()])
        read = np.column_stack(
            [poses, loaded, np.where(loaded, one.pose, 0), one.position.reshape(one.rows, -1)]
        )
        first = np.unique(read, axis=0, return_index=True)[1]
        row = 2 * one.pose + loaded
        timed = replace(one, row=row, pose=poses)
        yield select_rows(timed, first[np.argsort(row[first])]), one.row[:half]


def _places(series: Series) -> Ids:
    """First rows behind steps that are tried."""
    before, behind = poses_so_far(series.pose), poses_so_far(series.pose[::-1])[::-1]
    steps = np.arange(1, series.rows)
    return steps[(before[steps - 1] >= LEAST) & (behind[steps] >= LEAST)]


def _start(vjm: Vjm, series: tuple[Series, ...]) -> State:
    """The arm as its folder has it, in the base's frame."""
    try:
        weights = read_weights(vjm.arm)
    except InputError:  # nobody knows what it weighs
        weights = Weights(np.zeros(vjm.arm.n_joints + 2), np.zeros((vjm.arm.n_joints + 2, 3)))
    still, markers = Frame(np.eye(3), np.zeros(3)), series[0].markers
    return replace(
        nominal(vjm, weights, torque_scale(vjm, weights, series)),
        frames={one.frame: still for one in series},
        mounts={NAME: Mount(marker_points(vjm, markers), np.eye(3), markers)},
    )


def _sentence(at: Linear, series: Series, step: Step, runs: Ids) -> str:
    both = "the tracker or the target" if step.alike else f"the {step.what}"
    angle = float(np.linalg.norm(step.b[3:]))
    turn = f" and turned by {1e3 * angle:.2g} mrad" if angle > TURN else ""
    ends = [
        f"the {'loaded' if row % 2 else 'unloaded'} reading of run {runs[row // 2]}"
        for row in series.row[step.place - 1 : step.place + 1].tolist()
    ]
    hint = "was it touched?" if step.what == "target" else "runs behind it need a station of their own"
    if series.pose[step.place - 1] == series.pose[step.place]:
        hint += ", runs across it are wrong by as much"
    size = 1e3 * moves(at, series, step)
    return f"{both} moved by {size:.2g} mm{turn} between {' and '.join(ends)}: {hint}"
