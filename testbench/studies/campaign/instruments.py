"""The same poses read by several instruments: laser trackers that drift, lose or misread targets."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, Mask, check_least
from testbench.plant.tracker import MAX_DEVIATION, TYPICAL, LaserTracker, precision, read_positions, trial_rng

FLAT, WEIGHTED, UNWEIGHTED = "flat 50 um", "weighted", "flat weights"
CENTRE = (2.2, 0.0, 1.6)  #: Middle of the work area, section 6 [m].
LOST, MISREAD, BY = 0.1, 0.05, 1e-3
"""Share of targets that are lost, share that are misread, and by how much [m]."""


@dataclass(frozen=True)
class Drift:
    """How far the tracker's frame moves between the unloaded and the loaded reading of a run."""

    shift: float  #: Standard deviation of the frame's displacement along each axis [m].
    turn: float  #: The same of its rotation about each axis through the station [rad].

    def __post_init__(self) -> None:
        """Refuse, by BenchError, a number below 0 or too large for a slow drift."""
        for name in ("shift", "turn"):
            if not 0 <= getattr(self, name) <= MAX_DEVIATION:
                raise BenchError(f"drift, {name}: expected 0 to {MAX_DEVIATION:g}, got {getattr(self, name)}")


DRIFT = Drift(shift=20e-6, turn=5e-6)
"""Drift of the frame between the two readings of a run: 20 um and 5 urad (20 um at 4 m) [assumed]."""


def drifted(
    readings: Array, drift: Drift, station: tuple[float, float, float], rng: np.random.Generator
) -> Array:
    """Readings, (runs, m, 3) [m], in a frame that has moved, and turned about its station, for each run."""
    shift, turn = (size * rng.standard_normal((len(readings), 1, 3)) for size in (drift.shift, drift.turn))
    return np.asarray(readings + shift + np.cross(turn, readings - np.array(station)))


def spoil(data: Dataset, share: float, size: float, rng: np.random.Generator) -> tuple[Dataset, Mask]:
    """A dataset with some loaded readings off, each in a random direction; and which those are, (runs, m).

    They are `share` of all [1], rounded to whole readings, off by `size` [m]; orientations stay as they are.

    Raises:
        BenchError: When the share is outside [0, 1] or the size is not a finite number of at least 0.
    """
    if not 0 <= share <= 1:
        raise BenchError(f"share: expected 0 to 1, got {share}")
    check_least(size, "size [m]")
    readings = data.runs * len(data.markers)
    spoiled = np.zeros(readings, dtype=bool)
    spoiled[rng.permutation(readings)[: round(share * readings)]] = True
    mask = spoiled.reshape(data.runs, -1)
    direction = rng.standard_normal(data.after.shape)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return replace(data, after=data.after + size * direction * mask[..., None]), mask


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
        yield "weighted, maximum errors", distance, by_laser(clean, replace(tracker, share=1.0), seed)
        averaged = by_laser(clean, replace(tracker, share=TYPICAL / np.sqrt(3)), seed)
        yield "weighted, 3 readings averaged", distance, averaged
        yield "weighted, frame drifts", distance, by_laser(clean, tracker, seed, DRIFT)
        yield f"weighted, {100 * LOST:.0f} % of targets lost", distance, _lose(plain, seed)
        misread, _ = spoil(plain, MISREAD, BY, trial_rng(seed, 6))
        yield f"weighted, {100 * MISREAD:.0f} % misread by {1e3 * BY:g} mm", distance, misread


def by_laser(clean: Dataset, tracker: LaserTracker, seed: int, drift: Drift | None = None) -> Dataset:
    """A noise-free dataset read by a laser tracker, weighted by what it knows of itself: not of its drift."""
    rng = trial_rng(seed, 1)
    before, after = (read_positions(tracker, p, rng) for p in (clean.before, clean.after))
    if drift is not None:
        after = drifted(after, drift, tracker.station, trial_rng(seed, 2))
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
    gone = trial_rng(seed, 3).random((data.runs, len(data.markers))) < LOST
    return replace(data, precision=np.where(gone[..., None, None], 0.0, data.precision))
