"""Which single mistake would make readings fit the arm's kinematics."""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array
from testbench.identify.doubts.doubt import Doubt, length, three
from testbench.identify.doubts.geometry import PENALTY, Fit, Free, Seen, away, fit
from testbench.identify.doubts.mistakes import Mistake, mistakes
from testbench.identify.registered import Registered

MM = 1e3
NEAR = 0.5  #: Distance of a frame from the base below which no tracker stands [m].
ROUGH = 0.1  #: Distance of a target whose place was rough, and was found, that is a doubt [m].


def sentence(seen: Seen, mistake: Mistake, own: Fit, before: tuple[Fit, str]) -> str:
    """A mistake and its fit, beside the fit without it, of such readings."""
    start, what = before
    was, now = (length(float(np.median(away(seen, x)))) for x in (start, own))
    words = _words(seen, mistake, own)
    return f"the {what} {words} (they lie {was} from the arm's kinematics, median; so {now})"


def frame_doubt(found: Registered) -> list[Doubt]:
    """Readings that turned out to be in another frame than the base's, too near it to be a tracker's."""
    assert found.registration is not None
    near = [f for f in found.registration.frames.values() if np.linalg.norm(f.translation) < NEAR]
    if not near:
        return []
    moved = _moved(near[0].rotation_vector, near[0].translation)
    words = f"the readings {moved}, too near for a tracker; they are taken as they fit the arm: --frame says"
    return [Doubt("frame", f"{words} what they are in")]


def targets_doubt(found: Registered) -> list[Doubt]:
    """Targets that were found far from where the arm's folder has them, or one where another is."""
    own = found.registration
    assert own is not None
    away = np.linalg.norm(own.targets - own.nominal, axis=1)
    far = np.flatnonzero(away > ROUGH)
    if not len(far):
        return []
    between = np.linalg.norm(own.targets[far, None] - own.nominal[None, far], axis=2)
    names = ", ".join(own.markers[k] for k in far)
    if len(far) > 1 and (between.min(axis=1) < ROUGH).all():
        return [Doubt("markers", f"targets {names} are where others of them are to be: names exchanged?")]
    worst = int(far[np.argmax(away[far])])
    words = (
        f"{own.markers[worst]} is {MM * away[worst]:.0f} mm from where the arm's folder has it on the tool"
    )
    return [Doubt("targets", words)]


def _moved(turn: Array, shift: Array) -> str:
    angle = float(np.linalg.norm(turn))
    axis, at = three(turn / max(angle, 1e-12), 1, 2), three(shift, MM, 0)
    return (
        f"are in a frame turned by {np.rad2deg(angle):.3g} deg about ({axis}) and moved by ({at}) mm "
        "against the arm's base"
    )


def _words(seen: Seen, mistake: Mistake, own: Fit) -> str:
    if mistake.name == "frame":
        return _moved(own.frame.turn, own.frame.t)
    if mistake.name == "targets":
        off = MM * np.linalg.norm(own.markers - seen.markers, axis=1)
        worst = int(np.argmax(off))
        return f"have {seen.names[worst]} {off[worst]:.0f} mm from where the arm's folder has it on the tool"
    if mistake.name == "link":
        step = three(own.step, MM, 0)
        return f"fit if the end of {mistake.words} is ({step}) mm farther, in its axes: is this the arm?"
    if mistake.free.joint is not None:
        joint = seen.vjm.arm.joints[mistake.free.joint]
        size = f"{joint.shown * own.offset:.3g} {joint.shown_unit}"
        also = {0: ", or the frame is turned about it", len(seen.vjm.arm.joints) - 1: ", or the tool is"}
        return f"fit if the zero of {mistake.words} is off by {size}{also.get(mistake.free.joint, '')}"
    return mistake.words


BETTER, LEAST = 0.3, 20.0
"""Nats a reading, and in all, by which a mistake has to make the readings likelier to be a doubt."""
LOOSE, SHARE = ("targets", "link"), 0.9
"""Mistakes of many numbers, and the share of their gain from which others are preferred to them."""
TURN, SHIFT, TARGET = np.deg2rad(0.3), 15e-3, 25e-3
"""Least turn of a frame [rad], least shift of it or of a link, and least way of a target [m], of a doubt."""
ZERO, LAST = (np.deg2rad(0.5), 5e-3), 4.0
"""Least error of a joint's zero that is one [rad, m], and of the last joint's over it: targets may be off."""
LOST = 8.0  #: Median distance over a sound one from which readings do not fit the arm at all.


@dataclass(frozen=True)
class Placed:
    """Readings against the kinematics."""

    doubt: Doubt | None  #: The mistake that explains them, if one does.
    fit: Fit  #: The readings with it mended, or as they are.


def placed(seen: Seen, free: Free, what: str) -> Placed:
    """Look for the mistake that explains readings best.

    Args:
        seen: The readings.
        free: What is free anyway, in a frame that is not the arm's.
        what: Which readings, for sentences.
    """
    start = fit(seen, free)
    tried = [(m, fit(m.seen, m.free)) for m in mistakes(seen, free, start.frame)]
    gains = [start.cost - own.cost - PENALTY * m.numbers for m, own in tried]
    needed = max(LEAST, BETTER * seen.there.sum(), SHARE * max(gains))
    good = [
        (g, m, own) for g, (m, own) in zip(gains, tried, strict=True) if g > needed and _large(seen, m, own)
    ]
    if good:
        gain, mistake, own = max(good, key=lambda x: (x[1].name not in LOOSE, x[0]))
        if np.median(away(mistake.seen, own)) > LOST * seen.scale:
            return Placed(_unfit(seen, start, what), start)
        return Placed(Doubt(mistake.name, sentence(seen, mistake, own, (start, what)), gain), own)
    return Placed(_unfit(seen, start, what), start)


def _large(seen: Seen, mistake: Mistake, own: Fit) -> bool:
    """Whether a mistake is larger than those of sound arms."""
    if mistake.name == "frame":
        return bool(np.linalg.norm(own.frame.turn) > TURN or np.linalg.norm(own.frame.t) > SHIFT)
    if mistake.name == "targets":
        return bool(np.linalg.norm(own.markers - seen.markers, axis=1).max() > TARGET)
    if mistake.name == "link":
        return bool(np.linalg.norm(own.step) > SHIFT)
    if mistake.free.joint is not None:
        joints = seen.vjm.arm.joints
        last = LAST if mistake.free.joint == len(joints) - 1 else 1.0
        return abs(own.offset) > last * ZERO[joints[mistake.free.joint].prismatic]
    return True


def _unfit(seen: Seen, own: Fit, what: str) -> Doubt | None:
    """Whether readings are far off, and no single mistake says why."""
    typical = float(np.median(away(seen, own)))
    if typical <= LOST * seen.scale:
        return None
    words = f"the {what} lie {length(typical)} (median) from the arm's kinematics, and no single mistake "
    return Doubt("kinematics", f"{words}explains it: is this the arm?")
