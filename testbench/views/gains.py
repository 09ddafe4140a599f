"""How much less one model errs than another, and in words: 8.6 times smaller (3.0 to 20 in 90 %), or alike.

Of fewer than 20 trials the range is said, with their number: 8.6 times smaller (3.0 to 20 in 3 seeds).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from testbench.trials.spread import ENOUGH, Number, Spread, ends, middle, spread
from testbench.views.schema import ALIKE

UNITS = {"mm": (1.0, ".3f"), "um": (1000.0, ".0f")}
"""So many times a number in mm, and its format, by unit."""
SMALL = 0.04  #: Width of the ratios' interval that is not worth saying.


@dataclass(frozen=True)
class Gain:
    """One model beside another in the same trials: errors of the same statistic under the same conditions.

    The median of the ratios is not the ratio of the medians: each trial has its own.
    """

    ours: str
    theirs: str
    ours_mm: Number
    theirs_mm: Number
    times: Number  #: Their error over ours, trial by trial [1].
    trials: int

    @property
    def alike(self) -> bool:
        """Whether neither is better: the ratio's spread holds 1, or is as good as 1."""
        low, high = ends(self.times)
        return low <= 1 <= high or max(abs(low - 1), abs(high - 1)) <= ALIKE

    @property
    def less(self) -> bool:
        """Whether ours is the smaller in the median."""
        return middle(self.times) >= 1


def gained(ours: str, theirs: str, ours_mm: Sequence[float], theirs_mm: Sequence[float]) -> Gain:
    """Two models in the same trials, at least one."""
    times = [b / a for a, b in zip(ours_mm, theirs_mm, strict=True)]
    ours_, theirs_, ratio = (
        own[0] if all(x == own[0] for x in own) else spread(own) for own in (ours_mm, theirs_mm, times)
    )
    return Gain(ours, theirs, ours_, theirs_, ratio, len(times))


def less(gain: Gain, each: str = "") -> str:
    """How ours errs beside theirs.

    Args:
        gain: Both.
        each: What a trial is, such as "seed", where it is to be said that the ratio is that of each, and
            how far it spreads where neither is better.
    """
    return _words(gain.times, gain.trials, each, alike=gain.alike)


def more(gain: Gain, each: str = "") -> str:
    """How theirs errs beside ours."""
    low, high = ends(gain.times)
    times = Spread(1 / middle(gain.times), 1 / high, 1 / low)
    return _words(times, gain.trials, each, alike=gain.alike)


def beside(gains: Mapping[str, Gain | None], unit: str = "mm") -> str:
    """One model beside others, for the title of a figure; those that are not there are left out."""
    scale, form = UNITS[unit]
    known = {name: own for name, own in gains.items() if own is not None}
    ours = [f"{own.ours} {scale * middle(own.ours_mm):{form}} {unit}" for own in known.values()]
    theirs = [
        f"{name} {scale * middle(own.theirs_mm):{form}} {unit}, {more(own)}" for name, own in known.items()
    ]
    return "; ".join([*ours[:1], *theirs])


def _words(times: Number, trials: int, each: str, *, alike: bool) -> str:
    """Of an error, by what it is smaller."""
    (low, high), size = ends(times), middle(times)
    within = (f" in {trials} {each}s" if trials < ENOUGH else " in 90 %") if each else ""
    if alike:
        both = f", between {ratio(1 / low)} times larger and {ratio(high)} times smaller"
        both += within if trials < ENOUGH else ""
        return f"alike{both if each and low < 1 < high and high - low > SMALL else ''}"
    side, value, between = "smaller", size, (low, high)
    if size < 1:
        side, value, between = "larger", 1 / size, (1 / high, 1 / low)
    ends_shown = [ratio(end) for end in between]
    spread = f" ({' to '.join(ends_shown)}{within})" if ends_shown[0] != ends_shown[1] else ""
    by = f"{each} by {each} " if each and spread and trials >= ENOUGH else ""
    return f"{by}{ratio(value)} times {side}{spread}"


def ratio(value: float) -> str:
    """A ratio in two or three digits: 1.04, 1.7, 8.6, 21, 1,300."""
    if value < 1.1:
        return f"{value:.2f}"
    return f"{value:.1f}" if value < 9.95 else f"{value:,.0f}"
