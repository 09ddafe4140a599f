"""What moved in the middle of a series: the targets on the tool, or the tracker against the base.

A step in the residuals that nothing else explains; the rows behind it are taken as a series with a mount or a
frame of its own.
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
from testbench.identify.absolute.steps import Step, What, best, lacking, moves
from testbench.identify.metric import Metric

CELLS = 400  #: Steps that are tried at first.
THIN = 1500  #: Rows that are looked at first.
LEAST = 6  #: Poses before and behind a step: fewer do not tell a frame or a mount.
GAIN = 80.0
"""Sum of squares that a step takes away at least, over the variance: sound simulated series reach 50, series
of a robot whose frame drifts by 10 um 80."""
SHARE = 0.05  #: Share of the sum of squares that it takes away at least: a robot's drift takes 1 %.
TURN = 1e-4  #: Turns below are not worth a word [rad].
MOST = 5  #: Changes that are looked for.


@dataclass(frozen=True)
class Change:
    """A step in the middle of a series."""

    series: str  #: Name of the series.
    place: int  #: Place of the first row behind it, in order of time.
    before: int  #: Identifier of the last row before it.
    after: int  #: Identifier of the first row behind it.
    what: What  #: What moved.
    alike: bool  #: Whether a move of the other explains the readings as well.
    shift: float  #: How far the targets moved, root mean square [m].
    turn: float  #: How far it turned [rad].

    @property
    def words(self) -> str:
        """A sentence."""
        both = "the target or the tracker" if self.alike else f"the {self.what}"
        turn = f" and turned by {1e3 * self.turn:.2g} mrad" if self.turn > TURN else ""
        new = "mounts" if self.what == "target" else "frames"
        return (
            f"{self.series}: {both} moved by {1e3 * self.shift:.2g} mm{turn} between rows "
            f"{self.before} and {self.after}: taken as two {new}"
        )


def change_in(state: State, series: Series, noise: Noise, elastic: Metric) -> Change | None:
    """The greatest step in a series, None where there is none.

    Args:
        state: The arm without joint errors, with frame and mount of the series.
        series: Its readings; identifiers of rows are in order of time.
        noise: How they scatter about it.
        elastic: Prior of all compliances that there may be.
    """
    one = read_only(in_time(series))
    steps = np.flatnonzero(np.diff(one.row)) + 1  # rows of one identifier are of one moment
    before, behind = poses_so_far(one.pose), poses_so_far(one.pose[::-1])[::-1]
    steps = steps[(before[steps - 1] >= LEAST) & (behind[steps] >= LEAST)]
    if not len(steps):
        return None
    at = lacking(state, (one,), noise, elastic)
    thin = np.linspace(0, one.rows - 1, min(THIN, one.rows)).astype(int)
    tried = steps[np.linspace(0, len(steps) - 1, min(CELLS, len(steps))).astype(int)]
    place = np.unique(np.searchsorted(thin, tried))
    found = best(at, select_rows(one, thin), place[(place > 0) & (place < len(thin))])
    if not _sure(found):
        return None
    if len(tried) < len(steps) or len(thin) < one.rows:
        middle = np.searchsorted(tried, thin[found.place])
        low, high = tried[max(middle - 2, 0)], tried[min(middle + 2, len(tried) - 1)]
        found = best(at, one, np.union1d(tried, steps[(steps >= low) & (steps <= high)]))
    if not _sure(found):
        return None
    return Change(
        series=series.name,
        place=found.place,
        before=int(one.row[found.place - 1]),
        after=int(one.row[found.place]),
        what=found.what,
        alike=found.alike,
        shift=moves(at, one, found),
        turn=float(np.linalg.norm(found.b[3:])),
    )


def poses_so_far(pose: Ids) -> Ids:
    """Different poses up to and with every row, (rows,)."""
    first = np.zeros(len(pose), dtype=int)
    first[np.unique(pose, return_index=True)[1]] = 1
    return np.cumsum(first)


def _sure(step: Step) -> bool:
    return step.gain > GAIN and step.share > SHARE


def in_time(series: Series) -> Series:
    """A series with its rows in order of time: of their identifiers."""
    return select_rows(series, np.argsort(series.row, kind="stable"))


def parted(series: Series, change: Change) -> tuple[Series, Series]:
    """A series in two: what moved has a name of its own behind the step."""
    one, rows = in_time(series), np.arange(series.rows)
    first, second = (select_rows(one, own) for own in (rows < change.place, rows >= change.place))
    words = f" from row {change.after}"
    if change.what == "target":
        second = replace(second, target=series.target + words)
    else:
        second = replace(second, frame=series.frame + words)
    return first, replace(second, name=series.name + words)


Groups = tuple[tuple[Series, ...], ...]
"""Of every series its parts."""


@dataclass(frozen=True)
class Started:
    """A first fit, of series in which nothing moved any more."""

    series: tuple[Series, ...]  #: In parts where something moved.
    state: State
    noise: Noise
    notes: tuple[str, ...]  #: What moved, in words.


def settled(
    series: tuple[Series, ...],
    fitted: Callable[[tuple[Series, ...]], tuple[State, Noise]],
    elastic: Metric,
) -> Started:
    """Fit, part where something moved, fit again.

    Args:
        series: The readings.
        fitted: A first fit of some series, without joint errors.
        elastic: Prior of all compliances that there may be.
    """
    notes: list[str] = []
    groups: Groups = tuple((one,) for one in series)
    state, noise = fitted(series)
    for _ in range(MOST):
        changes = [[change_in(state, one, noise, elastic) for one in group] for group in groups]
        if not any(any(own) for own in changes):
            break
        notes += [change.words for own in changes for change in own if change]
        parts, more = _unshared(groups, _all_parted(groups, changes), changes)
        try:
            state, noise = fitted(_flat(parts))
        except BenchError as why:
            notes.append(f"{why}: not parted")
            break
        groups, notes = parts, notes + more
    return Started(_flat(groups), state, noise, tuple(notes))


def _flat(groups: Groups) -> tuple[Series, ...]:
    return tuple(one for group in groups for one in group)


def _all_parted(groups: Groups, changes: Sequence[Sequence[Change | None]]) -> Groups:
    """All parts of every series."""
    return tuple(
        tuple(
            part
            for one, change in zip(group, own, strict=True)
            for part in ((one,) if change is None else parted(one, change))
        )
        for group, own in zip(groups, changes, strict=True)
    )


def _unshared(
    before: Groups, parts: Groups, changes: Sequence[Sequence[Change | None]]
) -> tuple[Groups, list[str]]:
    """Parts, no mount or frame that moved in one series shared with another; and notes that say so.

    Which part the other would share it with is not known.
    """
    found, notes = [list(group) for group in parts], []
    for g, own in enumerate(changes):
        for one, change in zip(before[g], own, strict=True):
            if change is None:
                continue
            name = one.target if change.what == "target" else one.frame
            for other in (k for k in range(len(found)) if k != g):
                new = f"{name} of {found[other][0].name}"
                renamed = [_renamed(part, change.what, name, new) for part in found[other]]
                if any(a is not b for a, b in zip(renamed, found[other], strict=True)):
                    what = "mount" if change.what == "target" else "frame"
                    notes.append(f"{found[other][0].name}: shared that {what}, is taken to have its own")
                found[other] = renamed
    return tuple(tuple(group) for group in found), notes


def _renamed(series: Series, what: What, name: str, new: str) -> Series:
    """A series that has a mount or a frame of its own instead of one."""
    if what == "target":
        return replace(series, target=new) if series.target == name else series
    return replace(series, frame=new) if series.frame == name else series
