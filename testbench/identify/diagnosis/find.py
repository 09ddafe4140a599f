"""Doubts about runs: first what is plain, then where the arm is, then what moves it.

Plain mistakes need no fit: equal or repeated readings, absurd sizes, moves against the force. Pairs do not
show that the tracker, or the targets on the tool, moved, unless that falls between the two of a run. What
shows it is the step that `calibrate` looks for: from one reading on all lie elsewhere than the arm says, by a
move that no error of geometry, spring or slow joint error explains.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset, evenly, in_order, select
from testbench.data.series import Series, select_rows, series_of
from testbench.errors import Array, BenchError, InputError
from testbench.identify.absolute.align import with_targets
from testbench.identify.absolute.fit import first_fit
from testbench.identify.absolute.state import Mount, State, nominal, torque_scale
from testbench.identify.diagnosis import mounting
from testbench.identify.diagnosis.deflected import SINGLE, deflected, scale
from testbench.identify.diagnosis.finding import Finding
from testbench.identify.diagnosis.moves import places
from testbench.identify.diagnosis.own_weight import Unbent, hangs
from testbench.identify.diagnosis.place import Fit, Free, Seen, fit
from testbench.identify.diagnosis.steps import chance, lacking, likeliest, with_shift
from testbench.identify.diagnosis.undone import PRECISE, apart, placed
from testbench.identify.metric import Metric, metric
from testbench.identify.prior import Prior
from testbench.identify.registered import Registered, with_markers
from testbench.identify.registration import Frame
from testbench.identify.weighed import MOST_READINGS, check_runs
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import Vjm, marker_points
from testbench.model.weights import Weights, read_weights
from testbench.progress import stepwise

HUGE = 20.0  #: Deflection over that distance from which loaded readings are of something else.
AT_A_TIME, PARTS = 90, 12  #: Runs that are weighed together, and how often at most.
MENDED = ("frame", "targets")  #: Mistakes that a registration mends: the loads can be looked at all the same.
NEAR = 0.5  #: Distance of a frame from the base below which no tracker stands [m].
ROUGH = 0.1  #: Distance of a target whose place was rough, and was found, that is a doubt [m].


@dataclass(frozen=True)
class HandedIn:
    """What is doubted."""

    vjm: Vjm  #: The arm as its folder has it.
    data: Dataset  #: The runs as they were read.
    found: Registered  #: The same, with frames and targets found from the unloaded readings.
    declared: bool  #: Whether the frame of the readings was said, not guessed.

    @property
    def filed(self) -> Vjm:
        """The arm with the targets of its folder, and with others where they were found."""
        own = dict(zip(self.vjm.arm.markers, self.vjm.markers, strict=True))
        return with_markers(self.found.vjm, own)


def doubts(given: HandedIn, prior: Prior) -> list[Finding]:
    """What may be wrong with runs, the likeliest first.

    Args:
        given: The arm and the runs.
        prior: What the arm's folder expects.

    Returns:
        None for sound runs. A mistake of all poses or readings stands alone: it spoils what else is seen.

    Raises:
        BenchError: When the runs are not of this arm, or hold absurd numbers.
    """
    found = given.found
    check_runs(found.vjm, found.data)
    plain = list(sanity_checks(given.data, given.vjm.reach))
    said, own, seen = _places(given)
    if plain or any(doubt.kind not in MENDED for doubt in said):
        return [*said, *plain]
    data, vjm = found.data, found.vjm
    size = np.median(np.linalg.norm(data.deflection, axis=2)[data.seen])
    if vjm.arm.joints and size > HUGE * seen.scale:
        one = given.data if found.frame == "base" else _of_one_station(given.data)
        doubt, _ = placed(_seen(vjm, one, one.after), _free(found), "loaded")
        if doubt is not None:
            return [doubt, *said]
    level = mounting.level(found)
    if against := list(moved_against(data)):
        hung = _mounted(given, seen, metric(prior, vjm, all153(vjm.arm)), level)
        return [*hung, *said, *([] if hung else against)]
    off = list(apart(seen, own))
    said += [doubt for _, doubt in off]
    kept = select(data, ~np.isin(data.pose, [pose for pose, _ in off])) if off else data
    if not kept.seen.any():
        return said
    stepped, loads = moved(vjm, kept, prior), _loads(vjm, kept, prior, level)
    if any(doubt.kind == "mounting" for doubt in loads):
        return [*loads, *said]
    if all(doubt.kind in SINGLE for doubt in loads):  # else a mistake of all loads may look like a step
        return [*stepped, *said, *loads]
    return [*said, *loads, *stepped]


def _mounted(given: HandedIn, seen: Seen, model: Metric, level: Array | None) -> list[Finding]:
    """How the base stands, where that makes targets move against stated weights."""
    vjm, data = given.found.vjm, given.found.data
    pull = mounting.suspected(vjm, model, data, level)
    if pull is None:
        return []
    if mounting.angle(pull.g, mounting.DOWN) > mounting.REVERSED and not pull.told:
        pi = abs(scale(vjm, model, data)) * (model.L @ model.expected)
        both = Unbent(seen, _seen(vjm, data, data.after), model.structure.matrix(pi))
        if not hangs(both):
            return []
    return [mounting.finding(vjm, pull)]


def _loads(vjm: Vjm, data: Dataset, prior: Prior, level: Array | None) -> list[Finding]:
    """Doubts about loads and deflections: of all of them by some runs, of single ones by all."""
    model = metric(prior, vjm, all153(vjm.arm))
    each = len(data.markers) + (data.sigma_rotation is not None)
    parts = max(1, -(-data.runs // max(1, min(AT_A_TIME, MOST_READINGS // each))))
    chunks = [select(data, np.arange(data.runs) % parts == k) for k in range(min(parts, PARTS))]
    found = deflected(vjm, model, chunks[0], level)
    if any(doubt.kind not in SINGLE for doubt in found):
        return found
    rest = stepwise(chunks[1:], "looking for mistakes")
    more = (doubt for chunk in rest for doubt in deflected(vjm, model, chunk, level) if doubt.kind in SINGLE)
    return sorted([*found, *more], key=lambda doubt: -(doubt.nats or 0))


def _places(given: HandedIn) -> tuple[list[Finding], Fit, Seen]:
    """Doubts about where the arm, its targets and the tracker are; and the readings as they were placed."""
    found = given.found
    guessed = found.frame == "tracker" and not given.declared
    if found.frame == "base" or guessed:
        seen = _seen(given.filed, given.data, given.data.before)
        raw, own = placed(seen, Free())
        if found.registration is None and raw is not None and raw.kind in ("frame", "kinematics"):
            # a tracker's frame is no mistake, but what kept it from being found
            raw = open_places(given.filed, given.data) or (raw if raw.kind == "frame" else None)
        mistaken = raw is not None and raw.kind not in ("frame", "kinematics")
        if found.frame == "base" or mistaken:
            return ([] if raw is None else [raw]), own, seen
    one = _of_one_station(given.data)
    doubt, _ = placed(_seen(found.vjm, one, one.before), _free(found))
    seen = _seen(found.vjm, found.data, found.data.before)
    said = [doubt] if doubt else [*(_near(found) if guessed else ()), *_far_targets(found)]
    return said, fit(seen, Free()), seen


def open_places(vjm: Vjm, data: Dataset) -> Finding | None:
    """The mistake that keeps readings from being brought into the base's frame, if one explains it."""
    names = np.zeros(data.runs) if data.station is None else data.station
    every = (select(data, names == name) for name in np.unique(names))
    found = [placed(_seen(vjm, one, one.before), Free(frame=True, targets=True))[0] for one in every]
    return min(filter(None, found), key=lambda doubt: doubt.kind == "kinematics", default=None)


def _near(found: Registered) -> Iterator[Finding]:
    """Readings that turned out to be in another frame than the base's, too near it to be a tracker's."""
    assert found.registration is not None
    for one in found.registration.frames.values():
        if np.linalg.norm(one.translation) < NEAR:
            yield Finding("frame", (), np.concatenate([one.rotation_vector, one.translation]))
            return


def _far_targets(found: Registered) -> Iterator[Finding]:
    """Targets that were found far from where the arm's folder has them, or one where another is."""
    own = found.registration
    assert own is not None
    off = np.linalg.norm(own.targets - own.nominal, axis=1)
    far = np.flatnonzero(off > ROUGH)
    if not len(far):
        return
    between = np.linalg.norm(own.targets[far, None] - own.nominal[None, far], axis=2)
    if len(far) > 1 and (between.min(axis=1) < ROUGH).all():
        yield Finding("markers", ("targets", *(own.markers[k] for k in far)))
        return
    worst = int(far[np.argmax(off[far])])
    yield Finding("targets", ("targets", own.markers[worst]), own.targets[worst] - own.nominal[worst])


def _of_one_station(data: Dataset) -> Dataset:
    """The runs that the station with most of them read."""
    if data.station is None:
        return data
    names, count = np.unique(data.station, return_counts=True)
    return select(data, data.station == names[count.argmax()])


def _free(found: Registered) -> Free:
    return Free(frame=found.frame == "tracker", targets=found.frame == "tracker")


def _seen(vjm: Vjm, data: Dataset, read: Array) -> Seen:
    """Readings, unloaded or loaded, of the runs with unloaded readings of their own."""
    every = np.concatenate([data.q, np.nan_to_num(data.before.reshape(data.runs, -1))], axis=1)
    runs = np.sort(np.unique(every, axis=0, return_index=True)[1])  # several loads of a pose may share them
    return Seen(
        vjm=vjm,
        q=data.q[runs],
        markers=marker_points(vjm, data.markers),
        read=read[runs],
        there=data.seen[runs],
        scale=PRECISE * vjm.reach,
        names=data.markers,
        runs=data.run[runs],
        poses=data.pose[runs],
    )


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


CHANCE = 0.05
"""Chance of a step as clear anywhere in readings without one, from which it is no doubt."""
FEWEST = 3  #: Poses before and behind a step that is doubted.
ORDERS = 2  #: Periodic errors that may explain it: few poses tell no more.
TARGETS = 30
"""Targets that are looked at, evenly out of more: all of them move together, each has a place to be found."""
NAME = "targets"  #: Of the mount.


def moved(vjm: Vjm, data: Dataset, prior: Prior) -> list[Finding]:
    """Doubts about what moved between two readings, one a station at most; row 2 k is of run k, unloaded.

    Args:
        vjm: The arm, its targets where they are.
        data: The runs in the base's frame, in order of time.
        prior: What the arm's folder expects.
    """
    series = tuple(_in_time(in_order(data, evenly(np.arange(data.runs)))))
    steps = [places(one, FEWEST) for one in series]
    if not vjm.arm.joints or not any(map(len, steps)):
        return []
    try:
        state, noise = first_fit(_start(vjm, series), series, metric(prior, vjm, joints_only(vjm.arm)))
    except BenchError:  # too few readings for where arm and targets are: no step can be told
        return []
    at = lacking(state, series, noise, metric(prior, vjm, all153(vjm.arm)), ORDERS)
    clear = CHANCE / (2 * sum(map(len, steps)))
    found = [with_shift(at, *one) for one in likeliest(at, series, steps) if chance(one[1]) < clear]
    return [replace(step, beside={**step.beside, "pairs": True}) for step in found]


def _in_time(data: Dataset) -> Iterator[Series]:
    """Readings of every station in order of time, numbered 2 run unloaded and 2 run + 1 loaded.

    An unloaded reading that several loads share is one.
    """
    pose = dict(zip(data.run.tolist(), data.pose.tolist(), strict=True))
    stations = 1 if data.station is None else len(np.unique(data.station))
    for every in series_of(data, "station", NAME):
        one = with_targets(every, every.markers[:: -(-len(every.markers) // TARGETS)])
        loaded = np.arange(one.rows) >= one.rows // 2
        poses = np.array([pose[run] for run in one.row.tolist()])
        read = np.column_stack(
            [poses, loaded, np.where(loaded, one.pose, 0), one.position.reshape(one.rows, -1)]
        )
        first = np.unique(read, axis=0, return_index=True)[1]
        first = first[np.argsort((2 * one.pose + loaded)[first])]
        name = one.frame if stations > 1 else ""
        yield select_rows(replace(one, name=name, row=2 * one.row + loaded, pose=poses), first)


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
