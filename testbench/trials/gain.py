"""How much less one model errs than another: two numbers of one kind and their ratio, trial by trial."""

from collections.abc import Sequence
from dataclasses import dataclass

from testbench.trials.spread import Number, ends, middle, spread

ALIKE = 0.02  #: Share of an error that makes no difference.


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
    """Two models in the same trials, at least one.

    Args:
        ours: Name of one.
        theirs: Name of the other.
        ours_mm: Its errors [mm].
        theirs_mm: The other's in the same trials [mm].
    """
    times = [b / a for a, b in zip(ours_mm, theirs_mm, strict=True)]
    ours_, theirs_, ratio = (
        own[0] if all(x == own[0] for x in own) else spread(own) for own in (ours_mm, theirs_mm, times)
    )
    return Gain(ours, theirs, ours_, theirs_, ratio, len(times))
