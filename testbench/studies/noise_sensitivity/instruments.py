"""A noise-free dataset as laser trackers near and far read it, weighted by what they know of themselves."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from testbench.bench.campaign import stream
from testbench.data.dataset import Dataset
from testbench.data.outliers import spoil
from testbench.data.tracker import Drift, LaserTracker, drifted, precision, read_positions

FLAT_SIGMA = 50e-6  #: Noise of the instrument that reads all axes alike, wherever it stands [m].
FLAT, WEIGHTED, UNWEIGHTED = "flat 50 um", "weighted", "flat weights"
NEAR = 4.0  #: Distance at which instruments are compared [m].
CENTRE = (2.2, 0.0, 1.6)  #: Middle of the work area, section 6 [m].
LOST, MISREAD, BY = 0.1, 0.05, 1e-3
"""Share of targets that are lost, share that are misread, and by how much [m]."""
DRIFT = Drift(shift=20e-6, turn=5e-6)
"""Drift of the frame between the two readings of a run: 20 um and 5 urad (20 um at 4 m) [assumed]."""


def readings(
    clean: Dataset, flat: Dataset, distances: Sequence[float], seed: int
) -> Iterator[tuple[str, float, Dataset]]:
    """Name of the instrument, its distance from the work area [m], its readings; the flat one is nowhere.

    `clean` readings are without noise, `flat` ones have noise alike along all axes.
    """
    yield FLAT, 0.0, flat
    for distance in distances:
        tracker = LaserTracker((CENTRE[0], CENTRE[1] - distance, CENTRE[2]))
        plain = by_laser(clean, tracker, seed)
        yield WEIGHTED, distance, plain
        yield UNWEIGHTED, distance, unweighted(plain)
        yield "weighted, maximum errors", distance, by_laser(clean, replace(tracker, quality="mpe"), seed)
        averaged = by_laser(clean, replace(tracker, repeats=3), seed)
        yield "weighted, 3 readings averaged", distance, averaged
        yield "weighted, frame drifts", distance, by_laser(clean, tracker, seed, DRIFT)
        yield f"weighted, {100 * LOST:.0f} % of targets lost", distance, _lose(plain, seed)
        misread, _ = spoil(plain, MISREAD, BY, stream(seed, 6))
        yield f"weighted, {100 * MISREAD:.0f} % misread by {1e3 * BY:g} mm", distance, misread


def by_laser(clean: Dataset, tracker: LaserTracker, seed: int, drift: Drift | None = None) -> Dataset:
    """A noise-free dataset read by a laser tracker, weighted by what it knows of itself: not of its drift."""
    rng = stream(seed, 1)
    before, after = (read_positions(tracker, p, rng) for p in (clean.before, clean.after))
    if drift is not None:
        after = drifted(after, drift, tracker.station, stream(seed, 2))
    return replace(clean, before=before, after=after, precision=precision(tracker, before, after))


def unweighted(data: Dataset) -> Dataset:
    """The same readings weighted alike along every axis, by the sigma that they have in the mean."""
    assert data.precision is not None
    covariance = np.linalg.inv(data.precision)  # of the difference of two readings
    variance = np.trace(covariance, axis1=2, axis2=3).mean() / 6  # three axes, two readings
    return replace(data, sigma=float(np.sqrt(variance)), precision=None)


def _lose(data: Dataset, seed: int) -> Dataset:
    """The same without some of its targets."""
    assert data.precision is not None
    gone = stream(seed, 3).random((data.runs, len(data.markers))) < LOST
    return replace(data, precision=np.where(gone[..., None, None], 0.0, data.precision))
