"""Moves in the middle of a series: of the targets on the tool, or of the tracker against the base.

A step in the residuals that nothing else explains (`steps`). `identify` doubts it; `calibrate` takes the rows
behind it as a series with a mount or a frame of its own, fits again and looks again.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from testbench.data.series import Series, select_rows
from testbench.errors import BenchError, Ids
from testbench.identify.absolute.align import read_only
from testbench.identify.absolute.scatter import Noise
from testbench.identify.absolute.state import ArmState
from testbench.identify.diagnosis.hypothesis import Issue, undo_one_by_one
from testbench.identify.diagnosis.steps import best, nuisance_model, with_shift
from testbench.identify.metric import PriorScaling

CELLS = 400  #: Steps that are tried at first.
THIN = 1500  #: Rows that are looked at first.
LEAST = 6  #: Poses before and behind a step that parts a series: fewer do not tell a frame or a mount.
GAIN = 80.0
"""Sum of squares that such a step takes away at least, over the variance: sound simulated series reach 50,
series of a robot whose frame drifts by 10 um 80."""
SHARE = 0.05  #: Share of the sum of squares that it takes away at least: a robot's drift takes 1 %.
BEHIND = " from row "  #: Ends the name of a series, before the first row of its part.


def places(series: Series, least: int) -> Ids:
    """List the rows at which a step is tried.

    Args:
        series: Readings in order of time.
        least: Fewest different poses before, and after, each step.

    Returns:
        Index of the first row after each step, (steps,), ascending.
    """
    before, behind = _poses_so_far(series.pose), _poses_so_far(series.pose[::-1])[::-1]
    steps = np.flatnonzero(np.diff(series.row)) + 1  # rows of one identifier are of one moment
    return steps[(before[steps - 1] >= least) & (behind[steps] >= least)]


def _poses_so_far(pose: Ids) -> Ids:
    """Different poses up to and with every row, (rows,)."""
    first = np.zeros(len(pose), dtype=int)
    first[np.unique(pose, return_index=True)[1]] = 1
    return np.cumsum(first)


def _clear(state: ArmState, series: Series, noise: Noise, elastic: PriorScaling) -> Issue | None:
    """The greatest step in a series, None where there is none that is worth parting it.

    Args:
        state: The arm without joint errors, with frame and mount of the series.
        series: Its readings; identifiers of rows are in order of time.
        noise: How they scatter about it.
        elastic: Prior of all compliances that there may be.
    """
    one = read_only(in_time(series))
    steps = places(one, LEAST)
    linear = nuisance_model(state, (one,), noise, elastic)
    thin = np.linspace(0, one.rows - 1, min(THIN, one.rows)).astype(int)
    tried = steps[np.linspace(0, len(steps) - 1, min(CELLS, len(steps))).astype(int)]
    place = np.unique(np.searchsorted(thin, tried))
    place = place[(place > 0) & (place < len(thin))]
    if not len(place) or not _sure(issue := best(linear, select_rows(one, thin), place)):
        return None
    if len(tried) < len(steps) or len(thin) < one.rows:
        middle = np.searchsorted(tried, thin[int(issue.numbers["place"])])
        low, high = tried[max(middle - 2, 0)], tried[min(middle + 2, len(tried) - 1)]
        issue = best(linear, one, np.union1d(tried, steps[(steps >= low) & (steps <= high)]))
    return with_shift(linear, one, issue) if _sure(issue) else None


def _sure(step: Issue) -> bool:
    return 2 * (step.nats or 0.0) > GAIN and step.numbers["share"] > SHARE


def in_time(series: Series) -> Series:
    """Sort the rows of a series by their identifiers, which are in order of time.

    Args:
        series: The readings.

    Returns:
        The readings in order of time.
    """
    return select_rows(series, np.argsort(series.row, kind="stable"))


Parts = tuple[Series, ...]
"""Series, in parts where something moved."""
Fitted = tuple[ArmState, Noise]


def settled(
    series: Parts, fitted: Callable[[Parts], Fitted], elastic: PriorScaling
) -> tuple[list[Issue], Parts, Fitted]:
    """Fit series, divide them where targets or tracker moved, and fit again until nothing moves.

    Args:
        series: The readings.
        fitted: Function that fits geometry and springs to series, without joint errors.
        elastic: Prior of all compliances that there may be.

    Returns:
        Issues of what moved and of series that no longer share a mount or frame; the divided series; and
        their fit.

    Raises:
        BenchError: When the first fit fails.
    """

    def undo(parts: Parts, now: Fitted) -> tuple[list[Issue], Parts, Fitted] | None:
        """Fit the parts again, each with its tracker or targets as they moved.

        Args:
            parts: The parts of the series.
            now: Their fit.

        Returns:
            Findings, the parts as divided now, and their fit; None if nothing moved.
        """
        steps = [_clear(now[0], one, now[1], elastic) for one in parts]
        issues = [step for step in steps if step]
        if not issues:
            return None
        apart, shared = _parted(parts, steps)
        try:
            return issues + shared, apart, fitted(apart)
        except BenchError:
            return [*issues, Issue("not_parted", tuple(step.where[0] for step in issues))], parts, now

    return undo_one_by_one(series, fitted(series), undo)


def _parted(parts: Parts, steps: Sequence[Issue | None]) -> tuple[Parts, list[Issue]]:
    """Series in two where something moved, which has a name of its own behind the step.

    A mount or frame that moved in one series is shared with no other any more: which part that would share it
    with is not known. Findings say so.
    """
    found = [part for one, step in zip(parts, steps, strict=True) for part in _halves(one, step)]
    own: dict[tuple[str, str], Issue] = {}
    for series, step in zip(parts, steps, strict=True):
        if step is None:
            continue
        name, whole = _shared(series, step), _whole(series)
        for k, one in enumerate(found):
            if _shared(one, step) == name and _whole(one) != whole:
                found[k] = _named(one, step, f"{name} of {_whole(one)}")
                where = _whole(one), "mount" if step.name == "target_moved" else "frame"
                own[where] = Issue("unshared", where)
    return tuple(found), list(own.values())


def _whole(part: Series) -> str:
    """Name of the series that a part is of."""
    return part.name.partition(BEHIND)[0]


def _shared(series: Series, step: Issue) -> str:
    """Name of what moved in a step, for a series."""
    return series.target if step.name == "target_moved" else series.frame


def _named(series: Series, step: Issue, name: str) -> Series:
    """A series with another name for what moved in a step."""
    if step.name == "target_moved":
        return replace(series, target=name)
    return replace(series, frame=name)


def _halves(series: Series, step: Issue | None) -> Parts:
    """A series before and behind a step, whole where there is none."""
    if step is None:
        return (series,)
    one, words = in_time(series), f"{BEHIND}{step.numbers['after']}"
    behind = np.arange(series.rows) >= step.numbers["place"]
    second = _named(select_rows(one, behind), step, _shared(series, step) + words)
    return select_rows(one, ~behind), replace(second, name=series.name + words)
