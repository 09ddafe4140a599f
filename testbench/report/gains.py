"""How much less one model errs than another: 8.6 times smaller (median of ratios, 95 %: 7.1 to 9.9).

The 95 % interval of the median comes first, then 5 to 95 % of the trials. Of fewer than 20 the range is told,
with their number: 8.6 times smaller (3.0 to 20 in 3 seeds). Where trials differ in which is better, the
interval of the median decides whether there is a clear difference. A share has its interval by Wilson:
79 % (70 to 86 %).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.report.schema import ALIKE
from testbench.runs.spread import ENOUGH, Cells, Number, Spread, ends, median_interval, middle, spread

UNITS = {"mm": (1.0, ".3f"), "um": (1000.0, ".0f")}
"""So many times a number in mm, and its format, by unit."""
SMALL = 0.04  #: Width of the ratios' spread that is not worth saying.
MEDIAN = "median of ratios"  #: What a factor is that does not follow from the medians beside it.
Z95 = 1.959964  #: Of the normal distribution, 97.5 %.


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
    interval: tuple[float, float] | None = None  #: Of the median of the ratios, 95 %; None of below 6 trials.

    @property
    def tie(self) -> bool:
        """Whether nothing tells which is better: the interval holds 1, or all is as good as 1."""
        low, high = ends(self.times)
        if max(abs(low - 1), abs(high - 1)) <= ALIKE:
            return True
        low, high = self.interval or (low, high)
        return low <= 1 <= high

    @property
    def less(self) -> bool:
        """Whether ours is the smaller in the median."""
        return middle(self.times) >= 1


def gained(
    ours: str,
    theirs: str,
    ours_mm: Sequence[float],
    theirs_mm: Sequence[float],
    trials: Cells | None = None,
) -> Gain:
    """Two models in the same trials, at least one.

    Args:
        ours: Name of a model.
        theirs: Name of another.
        ours_mm: Errors, (n,) [mm].
        theirs_mm: The same of the other.
        trials: Labels of the trials, (n,), where several cases share one.
    """
    times = [b / a for a, b in zip(ours_mm, theirs_mm, strict=True)]
    ours_, theirs_, ratio = (
        own[0] if all(x == own[0] for x in own) else spread(own, trials)
        for own in (ours_mm, theirs_mm, times)
    )
    count = len(times) if trials is None else len(np.unique(trials))
    return Gain(ours, theirs, ours_, theirs_, ratio, count, median_interval(np.array(times), trials))


def less(gain: Gain, each: str = "") -> str:
    """How ours errs beside theirs.

    Args:
        gain: Both.
        each: What a trial is, such as "seed", where it is to be said what the spread is of, and how far it
            spreads where neither is better.
    """
    return _words(gain, gain.times, gain.interval, each)


def more(gain: Gain, each: str = "") -> str:
    """How theirs errs beside ours."""
    low, high = ends(gain.times)
    interval = gain.interval and (1 / gain.interval[1], 1 / gain.interval[0])
    return _words(gain, Spread(1 / middle(gain.times), 1 / high, 1 / low), interval, each)


def beside(gains: Mapping[str, Gain | None], unit: str = "mm") -> str:
    """One model beside others, for the title of a figure: without spreads; what is not there is left out."""
    scale, form = UNITS[unit]
    known = {name: own for name, own in gains.items() if own is not None}
    ours = [f"{own.ours} {scale * middle(own.ours_mm):{form}} {unit}" for own in known.values()]
    theirs = [
        f"{name} {scale * middle(own.theirs_mm):{form}} {unit}, {_side(own, 1 / middle(own.times))}"
        + ("" if own.tie or follows(own) else f" ({MEDIAN})")
        for name, own in known.items()
    ]
    return "; ".join([*ours[:1], *theirs])


def follows(gain: Gain) -> bool:
    """Whether the factor that is said is that of the two errors beside it."""
    apart = ratio(middle(gain.theirs_mm) / middle(gain.ours_mm))
    return apart == ratio(middle(gain.times))


def _side(gain: Gain, size: float) -> str:
    """The size alone, of an error that is so many times smaller."""
    if gain.tie:
        return "no clear difference"
    times = ratio(max(size, 1 / size))
    return f"{'less than 1 %' if times == '1.00' else f'{times} times'} {'larger' if size < 1 else 'smaller'}"


def _words(gain: Gain, times: Number, interval: tuple[float, float] | None, each: str) -> str:
    """Of an error, by what it is smaller."""
    (low, high), size, trials = ends(times), middle(times), gain.trials
    of = (f" in {trials} {each}s" if trials < ENOUGH else " in 90 %") if each else ""
    differ = low < 1 < high
    inside, within = interval or (size, size), (low, high)
    if gain.tie:
        spread = f"{_range(within)} times{of}" if differ and each and high - low > SMALL else ""
        return f"{_side(gain, size)}{_bracketed(_median(inside), spread) if spread else ''}"
    if size < 1:
        inside = (1 / inside[1], 1 / inside[0])
        within = within if differ else (1 / high, 1 / low)
    spread = (
        f"{_range(within)}{' times' if differ else ''}{of}" if ratio(within[0]) != ratio(within[1]) else ""
    )
    return f"{_side(gain, size)}{_bracketed(_median(inside) or (MEDIAN if spread else ''), spread)}"


def _range(both: tuple[float, float]) -> str:
    return " to ".join(map(ratio, both))


def _median(interval: tuple[float, float]) -> str:
    """Its interval; empty where both ends look the same."""
    return f"{MEDIAN}, 95 %: {_range(interval)}" if ratio(interval[0]) != ratio(interval[1]) else ""


def _bracketed(*texts: str) -> str:
    """Behind a number."""
    shown = "; ".join(filter(None, texts))
    return f" ({shown})" if shown else ""


def wilson(share: float, n: int) -> tuple[float, float]:
    """95 % interval of a share of n independent trials, by the score test (E. B. Wilson, 1927)."""
    z2 = Z95**2
    middle, half = share + z2 / (2 * n), Z95 * math.sqrt(share * (1 - share) / n + z2 / (4 * n**2))
    return max((middle - half) / (1 + z2 / n), 0.0), min((middle + half) / (1 + z2 / n), 1.0)


def share(value: float, trials: str) -> str:
    """A share of so many independent trials, with its interval: 79 % (70 to 86 %)."""
    low, high = wilson(float(value), int(trials))
    form = ".0f" if value in (0, 1) or 0.01 <= value <= 0.99 else ".1f"
    return f"{100 * value:{form}} % ({100 * low:{form}} to {100 * high:{form}} %)"


def ratio(value: float) -> str:
    """A ratio in two or three digits: 1.04, 1.7, 8.6, 21, 1,300."""
    if value < 1.1:
        return f"{value:.2f}"
    return f"{value:.1f}" if value < 9.95 else f"{value:,.0f}"
