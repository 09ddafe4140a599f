"""Where in joint space readings lie, and how far they are from a model there: joint by joint, in ranges."""

from collections.abc import Sequence

import numpy as np

from testbench.arm.folder import Joint
from testbench.bench.absolute_report import PlaceRow
from testbench.errors import Array

MOST, LEAST, EACH = 24, 4, 8
"""Ranges of a joint at most and at least, and the poses that each should have on average."""


def places(joints: Sequence[Joint], q: Array, before: Array, after: Array) -> list[PlaceRow]:
    """Ranges of every joint from limit to limit, or over a turn of a hinge that turns farther.

    Args:
        joints: Of the arm.
        q: Of every position that was read, (n, joints) [rad, m].
        before: Its distance from the arm as drawn, (n,) [m].
        after: From the calibrated arm, (n,) [m].
    """
    count = max(LEAST, min(MOST, len(np.unique(q, axis=0)) // EACH))
    return [row for k, joint in enumerate(joints) for row in _ranges(joint, q[:, k], count, before, after)]


def _ranges(joint: Joint, q: Array, count: int, before: Array, after: Array) -> list[PlaceRow]:
    low, high = joint.lower, joint.upper
    if not joint.prismatic and high - low > 2 * np.pi:
        q, (low, high) = (q + np.pi) % (2 * np.pi) - np.pi, (-np.pi, np.pi)
    edges = np.linspace(low, high, count + 1)
    own = np.clip(np.searchsorted(edges, q, "right") - 1, 0, count - 1)
    return [
        PlaceRow(
            joint=joint.name,
            low=float(joint.shown * edges[k]),
            high=float(joint.shown * edges[k + 1]),
            unit=joint.shown_unit,
            n=int((own == k).sum()),
            before_mm=_rms_mm(before[own == k]),
            after_mm=_rms_mm(after[own == k]),
        )
        for k in range(count)
    ]


def _rms_mm(error: Array) -> float | None:
    return float(1e3 * np.sqrt((error**2).mean())) if len(error) else None
