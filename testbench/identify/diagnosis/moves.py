"""What moved in the middle of a series: the targets on the tool, or the tracker against the base.

A step in the residuals that nothing else explains (`steps`). `identify` doubts it; `calibrate` takes the rows
behind it as a series with a mount or a frame of its own, fits again and looks again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Ids
from testbench.data.series import Series, select_rows
from testbench.errors import BenchError
from testbench.identify.absolute.align import read_only
from testbench.identify.absolute.noise import Noise
from testbench.identify.absolute.state import State
from testbench.identify.diagnosis.finding import Finding
from testbench.identify.diagnosis.steps import Linear, Step, best, lacking, likeliest, moves
from testbench.identify.metric import Metric

CELLS = 400  #: Steps that are tried at first.
THIN = 1500  #: Rows that are looked at first.
CHANCE = 0.05
"""Chance of a step as clear anywhere in readings without one, from which it is no doubt."""
FEWEST = 3  #: Poses before and behind a step that is doubted.
LEAST = 6  #: The same of one that parts a series: fewer do not tell a frame or a mount.
GAIN = 80.0
"""Sum of squares that such a step takes away at least, over the variance: sound simulated series reach 50,
series of a robot whose frame drifts by 10 um 80."""
SHARE = 0.05  #: Share of the sum of squares that it takes away at least: a robot's drift takes 1 %.
MOST = 5  #: Changes that are looked for.


def places(series: Series, least: int) -> Ids:
    """First rows behind steps that may be tried, so many poses before and behind each."""
    before, behind = _poses_so_far(series.pose), _poses_so_far(series.pose[::-1])[::-1]
    steps = np.flatnonzero(np.diff(series.row)) + 1  # rows of one identifier are of one moment
    return steps[(before[steps - 1] >= least) & (behind[steps] >= least)]


def _poses_so_far(pose: Ids) -> Ids:
    """Different poses up to and with every row, (rows,)."""
    first = np.zeros(len(pose), dtype=int)
    first[np.unique(pose, return_index=True)[1]] = 1
    return np.cumsum(first)


def doubted(at: Linear, series: Sequence[Series]) -> list[Finding]:
    """Steps that chance does not explain, one a series at most; of series in order of time."""
    steps = [places(one, FEWEST) for one in series]
    tried = 2 * sum(map(len, steps))
    found = likeliest(at, series, steps)
    return [_finding(at, one, step, pairs=True) for one, step in found if tried * step.chance < CHANCE]


def _finding(at: Linear, series: Series, step: Step, *, pairs: bool = False) -> Finding:
    """A step as a doubt: its move and turn, how far the targets moved [m], between which rows."""
    beside = {
        "shift": moves(at, series, step),
        "alike": step.alike,
        "place": step.place,
        "before": int(series.row[step.place - 1]),
        "after": int(series.row[step.place]),
        "pairs": pairs,
        "across": bool(series.pose[step.place - 1] == series.pose[step.place]),
    }
    return Finding(f"{step.what}_moved", (series.name, series.frame), step.b, beside, step.gain / 2)


def _clear(state: State, series: Series, noise: Noise, elastic: Metric) -> Finding | None:
    """The greatest step in a series, None where there is none that is worth parting it.

    Args:
        state: The arm without joint errors, with frame and mount of the series.
        series: Its readings; identifiers of rows are in order of time.
        noise: How they scatter about it.
        elastic: Prior of all compliances that there may be.
    """
    one = read_only(in_time(series))
    steps = places(one, LEAST)
    at = lacking(state, (one,), noise, elastic)
    thin = np.linspace(0, one.rows - 1, min(THIN, one.rows)).astype(int)
    tried = steps[np.linspace(0, len(steps) - 1, min(CELLS, len(steps))).astype(int)]
    place = np.unique(np.searchsorted(thin, tried))
    place = place[(place > 0) & (place < len(thin))]
    if not len(place) or not _sure(found := best(at, select_rows(one, thin), place)):
        return None
    if len(tried) < len(steps) or len(thin) < one.rows:
        middle = np.searchsorted(tried, thin[found.place])
        low, high = tried[max(middle - 2, 0)], tried[min(middle + 2, len(tried) - 1)]
        found = best(at, one, np.union1d(tried, steps[(steps >= low) & (steps <= high)]))
    return _finding(at, one, found) if _sure(found) else None


def _sure(step: Step) -> bool:
    return step.gain > GAIN and step.share > SHARE


def in_time(series: Series) -> Series:
    """A series with its rows in order of time: of their identifiers."""
    return select_rows(series, np.argsort(series.row, kind="stable"))


@dataclass(frozen=True)
class Started:
    """A first fit, of series in which nothing moved any more."""

    series: tuple[Series, ...]  #: In parts where something moved.
    state: State
    noise: Noise
    moves: tuple[Finding, ...]  #: What moved, and what that means for series that shared it.


Parts = list[tuple[int, Series]]
"""Parts of series, and which series each is of."""


def settled(
    series: tuple[Series, ...], fitted: Callable[[tuple[Series, ...]], tuple[State, Noise]], elastic: Metric
) -> Started:
    """Fit, part where something moved, fit again.

    Args:
        series: The readings.
        fitted: A first fit of some series, without joint errors.
        elastic: Prior of all compliances that there may be.
    """
    found: list[Finding] = []
    parts: Parts = list(enumerate(series))
    state, noise = fitted(series)
    for _ in range(MOST):
        steps = [_clear(state, one, noise, elastic) for _, one in parts]
        if not any(steps):
            break
        found += filter(None, steps)
        tried, own = _parted(parts, steps)
        try:
            state, noise = fitted(tuple(one for _, one in tried))
        except BenchError as why:
            found.append(Finding("not_parted", (str(why),)))
            break
        parts, found = tried, found + own
    return Started(tuple(one for _, one in parts), state, noise, tuple(found))


def _parted(parts: Parts, steps: Sequence[Finding | None]) -> tuple[Parts, list[Finding]]:
    """Series in two where something moved, which has a name of its own behind the step.

    A mount or frame that moved in one series is shared with no other any more: which part that would share it
    with is not known. Findings say so.
    """
    found: Parts = []
    for (g, series), step in zip(parts, steps, strict=True):
        found += [(g, part) for part in (_halves(series, step) if step else (series,))]
    own: list[Finding] = []
    names = {g: one.name for g, one in reversed(parts)}
    for (g, series), step in zip(parts, steps, strict=True):
        if step is None:
            continue
        name = _shared(series, step)
        for h in sorted({h for h, one in found if h != g and _shared(one, step) == name}):
            found = [
                (
                    i,
                    _named(one, step, f"{name} of {names[h]}")
                    if i == h and _shared(one, step) == name
                    else one,
                )
                for i, one in found
            ]
            own.append(Finding("unshared", (names[h], "mount" if step.kind == "target_moved" else "frame")))
    return found, own


def _shared(series: Series, step: Finding) -> str:
    """Name of what moved in a step, for a series."""
    return series.target if step.kind == "target_moved" else series.frame


def _named(series: Series, step: Finding, name: str) -> Series:
    """A series with another name for what moved in a step."""
    if step.kind == "target_moved":
        return replace(series, target=name)
    return replace(series, frame=name)


def _halves(series: Series, step: Finding) -> tuple[Series, Series]:
    """A series before and behind a step."""
    one, words = in_time(series), f" from row {step.beside['after']}"
    behind = np.arange(series.rows) >= step.beside["place"]
    second = _named(select_rows(one, behind), step, _shared(series, step) + words)
    return select_rows(one, ~behind), replace(second, name=series.name + words)
