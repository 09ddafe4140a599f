"""Which angles of the joints were never read, and how many of further poses go there."""

from collections.abc import Iterator, Sequence

import numpy as np

from testbench.arm.folder import Arm, Joint
from testbench.data.series import Series
from testbench.errors import Array, Ids
from testbench.report.table import Row

BINS = 72  #: Ranges of a joint: 5 degrees each of a hinge that turns once.


def filled(arm: Arm, series: Sequence[Series], q: Array) -> Iterator[Row]:
    """Of every joint how much was not read, and how many of the poses (poses, n) [rad, m] go there."""
    for j, joint in enumerate(arm.joints):
        read = np.zeros(BINS, dtype=bool)
        for one in series:
            read[_bin(joint, one.q[one.seen.any(axis=1), j])] = True
        there = ~read[_bin(joint, q[:, j])]
        yield Row(joint=joint.name, unread_percent=100 * float((~read).mean()), poses=int(there.sum()))


def _bin(joint: Joint, own: Array) -> Ids:
    """Range of every angle, from limit to limit, or over a turn of a hinge that turns farther."""
    low, high = joint.lower, joint.upper
    if not joint.prismatic and high - low > 2 * np.pi:
        own, low, high = own % (2 * np.pi), 0.0, 2 * np.pi
    at = np.floor(BINS * (own - low) / (high - low)).astype(int)
    return np.asarray(np.clip(at, 0, BINS - 1))
