"""Single poses and readings that lie off while most do not."""

from dataclasses import replace

import numpy as np

from testbench.identify.doubts.doubt import Doubt, length
from testbench.identify.doubts.geometry import Fit, Free, Seen, away, fit
from testbench.identify.doubts.mistakes import exchanges
from testbench.identify.doubts.rigid import STILL

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
