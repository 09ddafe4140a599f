"""Doubts about runs: first what is plain, then where the arm is, then what moves it."""

from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from testbench.data.dataset import Dataset, Ids, select
from testbench.errors import Array
from testbench.identify.doubts.deflected import SINGLE, deflected, single
from testbench.identify.doubts.doubt import Doubt, length
from testbench.identify.doubts.geometry import STILL, Fit, Free, Seen, away, fit
from testbench.identify.doubts.mistakes import exchanges
from testbench.identify.doubts.moved import moved as moved_between
from testbench.identify.doubts.placed import frame_doubt, placed, targets_doubt
from testbench.identify.doubts.plain import moved_against, plain
from testbench.identify.metric import metric
from testbench.identify.prior import Prior
from testbench.identify.registered import Registered, with_markers
from testbench.identify.weighed import MOST_READINGS, check_runs, marker_points
from testbench.model.structure import all153
from testbench.model.vjm import Vjm

APART = 8.0  #: Distance of a reading over a sound one from which it is wrong by itself.


def apart(seen: Seen, own: Fit) -> list[tuple[int, Doubt]]:
    """Single poses, and single unloaded readings, that lie off while most do not; with their pose."""
    off = np.linalg.norm(own.residual, axis=2)
    found = []
    for row in np.flatnonzero((off > APART * seen.scale).any(axis=1)):
        pose, typical, run = int(seen.poses[row]), float(np.median(off[row][seen.there[row]])), seen.runs[row]
        if typical > APART / 2 * seen.scale:
            why = _why(seen, own, int(row))
            words = f"run {run}: its unloaded readings lie {length(typical)} off: {why}"
            found.append((pose, Doubt("pose", words)))
        else:
            k = int(np.argmax(off[row]))
            words = f"run {run}: {seen.names[k]} was read {length(off[row, k])} off, the others were not"
            found.append((pose, Doubt("reading", words)))
    return found


def _why(seen: Seen, own: Fit, pose: int) -> str:
    """Which targets of a pose may have each other's names, or which joint angle may be wrong."""
    one = replace(
        seen,
        q=seen.q[[pose]],
        markers=own.markers,
        read=(seen.read[[pose]] - own.frame.t) @ own.frame.R,
        there=seen.there[[pose]],
    )
    for order in exchanges(one, STILL):
        read, there = one.read[:, order], one.there[:, order]
        if away(one, fit(replace(one, read=read, there=there), Free())).max() < APART * seen.scale:
            wrong = ", ".join(seen.names[k] for k, other in enumerate(order) if k != other)
            return f"they fit if {wrong} have each other's names"
    fits = [fit(one, Free(joint=k)) for k in range(seen.q.shape[1])]
    best = int(np.argmin([f.loss for f in fits]))
    joint = seen.vjm.arm.joints[best]
    if float(np.median(away(one, fits[best]))) > APART * seen.scale:
        return "is its pose right?"
    return f"they fit if {joint.name} stood {joint.shown * fits[best].offset:.3g} {joint.shown_unit} farther"


PRECISE = 1.5e-3  #: How far targets of a sound arm lie from its kinematics, over its reach [1].
HUGE = 20.0  #: Deflection over that distance from which loaded readings are of something else.
AT_A_TIME, PARTS = 90, 12  #: Runs that are weighed together, and how often at most.
MENDED = ("frame", "targets")  #: Mistakes that a registration mends: the loads can be looked at all the same.


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


def doubts(given: HandedIn, prior: Prior) -> list[Doubt]:
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
    plainly = plain(given.data, given.vjm.reach)
    said, own, seen = _places(given)
    if plainly or any(doubt.name not in MENDED for doubt in said):
        return [*said, *plainly]
    data, vjm = found.data, found.vjm
    moved = np.median(np.linalg.norm(data.deflection, axis=2)[data.seen])
    if vjm.arm.joints and moved > HUGE * seen.scale:
        one = given.data if found.frame == "base" else _of_one_station(given.data)
        loaded = placed(_seen(vjm, one, one.after), _free(found), "loaded readings")
        if loaded.doubt is not None:
            return [loaded.doubt, *said]
    if against := moved_against(data):
        return [*said, against]
    off = apart(seen, own)
    said += [doubt for _, doubt in off]
    model = metric(prior, vjm, all153(vjm.arm))
    kept = select(data, ~np.isin(data.pose, [pose for pose, _ in off])) if off else data
    if not kept.seen.any():
        return said
    each = len(kept.markers) + (kept.sigma_rotation is not None)
    parts = max(1, -(-kept.runs // max(1, min(AT_A_TIME, MOST_READINGS // each))))
    chunks = [select(kept, np.arange(kept.runs) % parts == k) for k in range(min(parts, PARTS))]
    stepped, loads = moved_between(vjm, kept, prior), deflected(vjm, model, chunks[0])
    if all(doubt.name in SINGLE for doubt in loads):
        loads += chain.from_iterable(single(vjm, model, chunk) for chunk in chunks[1:])
        loads.sort(key=lambda d: -(d.evidence or 0))
    if all(doubt.name in SINGLE for doubt in loads):  # else a mistake of all loads may look like a step
        return [*stepped, *said, *loads]
    return [*said, *loads, *stepped]


def _places(given: HandedIn) -> tuple[list[Doubt], Fit, Seen]:
    """Doubts about where the arm, its targets and the tracker are; and the readings as they were placed."""
    found = given.found
    guessed = found.frame == "tracker" and not given.declared
    if found.frame == "base" or guessed:
        seen = _seen(given.filed, given.data, given.data.before)
        raw = placed(seen, Free(), "unloaded readings")
        if found.registration is None and raw.doubt is not None and raw.doubt.name == "kinematics":
            raw = replace(raw, doubt=open_places(given.filed, given.data))
        mistaken = raw.doubt is not None and raw.doubt.name not in ("frame", "kinematics")
        if found.frame == "base" or mistaken:
            return ([] if raw.doubt is None else [raw.doubt]), raw.fit, seen
    one = _of_one_station(given.data)
    doubt = placed(_seen(found.vjm, one, one.before), _free(found), "unloaded readings").doubt
    seen = _seen(found.vjm, found.data, found.data.before)
    own = fit(seen, Free())
    if doubt is not None:
        return [doubt], own, seen
    said = frame_doubt(found) if guessed else []
    return [*said, *targets_doubt(found)], own, seen


def open_places(vjm: Vjm, data: Dataset) -> Doubt | None:
    """The mistake that keeps readings from being brought into the base's frame, if one explains it."""
    one = _of_one_station(data)
    return placed(_seen(vjm, one, one.before), Free(frame=True, targets=True), "unloaded readings").doubt


def _of_one_station(data: Dataset) -> Dataset:
    """The runs that the station with most of them read."""
    if data.station is None:
        return data
    names, count = np.unique(data.station, return_counts=True)
    return select(data, data.station == names[count.argmax()])


def _free(found: Registered) -> Free:
    return Free(frame=found.frame == "tracker", targets=found.frame == "tracker")


def _different(data: Dataset) -> Ids:
    """Runs with unloaded readings of their own: several loads of a pose may share them."""
    read = np.concatenate([data.q, np.nan_to_num(data.before.reshape(data.runs, -1))], axis=1)
    return np.sort(np.unique(read, axis=0, return_index=True)[1])


def _seen(vjm: Vjm, data: Dataset, read: Array) -> Seen:
    """Readings, unloaded or loaded, of the runs with unloaded readings of their own."""
    runs = _different(data)
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
