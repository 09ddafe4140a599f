"""Runs as laser trackers read them: in frames of their own, turned at random about the vertical."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.decimal import read_decimals
from testbench.campaign.campaign import stream
from testbench.campaign.plan_input import Place
from testbench.campaign.tracker import LaserTracker, precision, read_positions
from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.plant.site import check_position


def places(texts: Sequence[str]) -> list[Place]:
    """Places of trackers in the world [m], from texts such as "4,-1,1.5"; BenchError for what is far away."""
    found = []
    for text in texts:
        try:
            x, y, z = read_decimals(part.strip() for part in text.split(","))
        except ValueError as err:
            raise BenchError(
                f"--tracker: expected x,y,z in metres, such as 4,-1,1.5, got {text[:80]!r}"
            ) from err
        check_position((x, y, z))
        found.append((x, y, z))
    return found


def by_trackers(clean: Dataset, trackers: Sequence[Place], seed: int) -> Dataset:
    """Readings without noise, in world axes, as trackers at places (3,) [m] in turn read them, a pose each.

    Positions are in the frame of the tracker that read them, which has its origin there, an upright z axis
    and any direction, with the covariance of every deflection; stations from 1 where there are several.
    """
    pose = np.unique(clean.pose, return_inverse=True)[1].ravel()
    station = pose % len(trackers)
    rng, noise = stream(seed, 2), stream(seed, 1)
    before, after = np.empty_like(clean.before), np.empty_like(clean.after)
    for k, (place, angle) in enumerate(zip(trackers, rng.uniform(-np.pi, np.pi, len(trackers)), strict=True)):
        R = _upright(angle)
        for own, true in ((before, clean.before), (after, clean.after)):
            own[station == k] = (true[station == k] - np.array(place)) @ R.T
    tracker = LaserTracker((0.0, 0.0, 0.0))
    before, after = (read_positions(tracker, x, noise) for x in (before, after))
    P = precision(tracker, before, after)
    return replace(
        clean,
        before=before,
        after=after,
        sigma=float(np.sqrt(np.trace(np.linalg.inv(P), axis1=2, axis2=3).mean() / 6)),
        precision=P,
        station=station + 1 if len(trackers) > 1 else None,
    )


def _upright(angle: float) -> Array:
    """Tracker from world: turned about the vertical by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
