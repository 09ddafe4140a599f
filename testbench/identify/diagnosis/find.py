"""Doubts about runs: first what is plain, then where the arm is, then what moves it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset, select
from testbench.errors import Array
from testbench.identify.diagnosis.between import moved
from testbench.identify.diagnosis.deflected import SINGLE, deflected
from testbench.identify.diagnosis.finding import Finding
from testbench.identify.diagnosis.place import Fit, Free, Seen, fit
from testbench.identify.diagnosis.sanity import moved_against, sanity_checks
from testbench.identify.diagnosis.undone import PRECISE, apart, placed
from testbench.identify.metric import metric
from testbench.identify.prior import Prior
from testbench.identify.registered import Registered, with_markers
from testbench.identify.weighed import MOST_READINGS, check_runs
from testbench.model.structure import all153
from testbench.model.vjm import Vjm, marker_points
from testbench.session import stepwise

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
    if against := list(moved_against(data)):
        return [*said, *against]
    off = list(apart(seen, own))
    said += [doubt for _, doubt in off]
    kept = select(data, ~np.isin(data.pose, [pose for pose, _ in off])) if off else data
    if not kept.seen.any():
        return said
    stepped, loads = moved(vjm, kept, prior), _loads(vjm, kept, prior)
    if all(doubt.kind in SINGLE for doubt in loads):  # else a mistake of all loads may look like a step
        return [*stepped, *said, *loads]
    return [*said, *loads, *stepped]


def _loads(vjm: Vjm, data: Dataset, prior: Prior) -> list[Finding]:
    """Doubts about loads and deflections: of all of them by some runs, of single ones by all."""
    model = metric(prior, vjm, all153(vjm.arm))
    each = len(data.markers) + (data.sigma_rotation is not None)
    parts = max(1, -(-data.runs // max(1, min(AT_A_TIME, MOST_READINGS // each))))
    chunks = [select(data, np.arange(data.runs) % parts == k) for k in range(min(parts, PARTS))]
    found = deflected(vjm, model, chunks[0])
    if any(doubt.kind not in SINGLE for doubt in found):
        return found
    rest = stepwise(chunks[1:], "looking for mistakes")
    more = (doubt for chunk in rest for doubt in deflected(vjm, model, chunk) if doubt.kind in SINGLE)
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
