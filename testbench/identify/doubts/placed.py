"""Which single mistake would make readings fit the arm's kinematics."""

from dataclasses import dataclass

import numpy as np

from testbench.identify.doubts.doubt import Doubt, length
from testbench.identify.doubts.geometry import PENALTY, Fit, Free, Seen, away, fit
from testbench.identify.doubts.mistakes import Mistake, mistakes
from testbench.identify.doubts.sentences import sentence

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
