"""Whether a number of two runs differs by more than its spread: in pairs of equal seeds where it can."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from testbench.trials.gain import ALIKE
from testbench.trials.spread import SAME, Number, Spread, ends, middle, spread, triple, wins

FEWEST = 2  #: Pairs that have a spread.

Verdict = Literal["same", "alike", "less", "more"]
"""Of the second number beside the first one; alike are those within 2 %, or that the spread covers."""
By = Literal["pairs", "spreads", "one"]
"""What tells: ratios seed by seed, spreads that do not overlap, or nothing, as a side has one number."""


@dataclass(frozen=True)
class Difference:
    """A number of two runs."""

    a: Number
    b: Number
    difference: float | None  #: b less a, of medians; None beyond all numbers, as the ratio.
    ratio: Number  #: b over a; in pairs with its spread; None where a is not above 0.
    verdict: Verdict
    by: By
    pairs: int | None = None  #: Seeds, if they tell.
    smaller: int | None = None  #: Seeds in which b is smaller.
    larger: int | None = None  #: Seeds in which it is larger.

    @property
    def size(self) -> float:
        """How far from equal, the same both ways: |log(b / a)|, infinite where signs differ."""
        return _size(middle(self.a), middle(self.b))

    @property
    def near(self) -> bool:
        """Whether the two are within 2 %."""
        return self.size < math.log1p(ALIKE)

    @property
    def apart(self) -> bool:
        """Whether the two are not alike."""
        return self.verdict in ("less", "more")


def differ(a: Number, b: Number) -> Difference:
    """A number of two runs by its spreads.

    Args:
        a: Of the first run.
        b: Of the second one.
    """
    first, second = middle(a), middle(b)
    by: By = "spreads" if isinstance(a, Spread) and isinstance(b, Spread) else "one"
    if same(a, b):
        verdict: Verdict = "same"
    elif _overlap(a, b) or _size(first, second) < math.log1p(ALIKE):
        verdict = "alike"
    else:
        verdict = "less" if second < first else "more"
    ratio = _finite(second / first) if first > 0 else None
    return Difference(a, b, _finite(second - first), ratio, verdict, by)


def differ_paired(a: Number, b: Number, ours: Mapping[int, float], theirs: Mapping[int, float]) -> Difference:
    """A number of two runs seed by seed, where both have it above 0 in the same two seeds or more.

    Args:
        a: Of the first run.
        b: Of the second one.
        ours: The first run's by seed.
        theirs: The second run's by seed.
    """
    pairs = [(x, theirs[seed]) for seed, x in ours.items() if seed in theirs]
    ratios = [_finite(y / x) if x > 0 else None for x, y in pairs]
    known = [ratio for ratio in ratios if ratio]
    if ours.keys() != theirs.keys() or len(pairs) < FEWEST or len(known) < len(ratios) or min(known) < 0:
        return differ(a, b)
    ratio = spread(known)
    if np.allclose(triple(ratio), 1, rtol=0, atol=SAME):
        verdict: Verdict = "same"
    elif ratio.ends[0] <= 1 <= ratio.ends[1] or max(abs(end - 1) for end in ratio.ends) <= ALIKE:
        verdict = "alike"
    else:
        verdict = "less" if ratio.median < 1 else "more"
    xs, ys = zip(*pairs, strict=True)
    ahead, behind = wins(ys, xs), wins(xs, ys)
    return Difference(
        a, b, _finite(middle(b) - middle(a)), ratio, verdict, "pairs", len(pairs), ahead, behind
    )


def same(a: Number, b: Number) -> bool:
    """Whether median and spread are the same but for a solver's last digits."""
    return bool(np.allclose(triple(a), triple(b), rtol=SAME, atol=0, equal_nan=True))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _overlap(a: Number, b: Number) -> bool:
    (low, high), (least, most) = ends(a), ends(b)
    return low <= most and least <= high


def _size(first: float, second: float) -> float:
    if first == second:
        return 0.0
    return abs(math.log(second / first)) if first * second > 0 else math.inf
