"""Numbers of many trials as medians with their spread."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from testbench.errors import Array, Ids

Cells = npt.NDArray[np.generic]

DOTS = 100  #: Trials whose own numbers are kept to be drawn: as many of each kind as stand in a row.
DRAWS = 2000  #: Of a bootstrap.
TAIL = 0.025  #: Share of an interval's chances on each side.
SAME_ERROR = 1e-6  #: Share of an error within which two models are the same.
MIN_PERCENTILE_TRIALS = 20  #: Trials from which on percentiles mean something; of fewer the range is told.


@dataclass(frozen=True)
class Spread:
    """Hold a number over several trials, or with an interval of another kind (`trials` is 0)."""

    median: float  #: The middle of them.
    p05: float  #: 5th percentile.
    p95: float  #: 95th percentile.
    least: float | None = field(default=None, compare=False)
    most: float | None = field(default=None, compare=False)
    trials: int = field(default=0, compare=False)
    values: tuple[float, ...] = field(default=(), compare=False, repr=False)  #: Of `DOTS` trials.
    #: Of the median, 95 %; None of below 6 trials.
    interval: tuple[float, float] | None = field(default=None, compare=False, repr=False)

    @property
    def too_few(self) -> bool:
        """Tell whether there are too few trials for percentiles."""
        return 0 < self.trials < MIN_PERCENTILE_TRIALS

    @property
    def ends(self) -> tuple[float, float]:
        """Return what is shown beside the median: 5th and 95th percentile; of few trials the range."""
        if self.too_few and self.least is not None and self.most is not None:
            return self.least, self.most
        return self.p05, self.p95

    def scaled(self, factor: float) -> "Spread":
        """Multiply median, ends and interval by a factor."""
        middle_, low, high = (factor * own for own in (self.median, self.p05, self.p95))
        least, most = (None if end is None else factor * end for end in (self.least, self.most))
        values = tuple(factor * own for own in self.values)
        inside = self.interval and (factor * self.interval[0], factor * self.interval[1])
        return Spread(middle_, low, high, least, most, self.trials, values, inside)


Number = float | Spread | None
"""A number of one trial, its spread over several, or None where there is none."""
Share = bool | float  #: Whether something holds, or the share of trials in which it does.


def spread(values: Sequence[float] | Array, trials: Cells | None = None) -> Spread:
    """Compute median, 5th and 95th percentile and range of at least one number; NaN where one of them is.

    Args:
        values: Numbers, (n,).
        trials: Labels of their trials, (n,), where several cases share one: trials are then what is counted
            and drawn, each by the median of its cases, and the interval is by trial.

    Returns:
        The summary.
    """
    own = np.asarray(values, dtype=float)
    median, low, high = np.quantile(own, (0.5, 0.05, 0.95)).tolist()
    groups = [] if trials is None else _by_trial(trials)
    if 0 < len(groups) < len(own):
        each = np.array([np.median(own[rows]) for rows in groups])
    else:
        each = own[np.concatenate(groups)] if groups else own
    drawn = np.linspace(0, len(each) - 1, min(len(each), DOTS)).round().astype(int)
    inside = _interval(own, groups)
    return Spread(
        median, low, high, float(own.min()), float(own.max()), len(each), tuple(each[drawn].tolist()), inside
    )


def median_interval(values: Array, trials: Cells | None = None) -> tuple[float, float] | None:
    """Compute the 95 % interval of a median by order statistics, exact for any distribution.

    Args:
        values: Numbers, (n,).
        trials: Labels of their trials, (n,); where several cases share one the interval is a bootstrap that
            draws whole trials, the same each time.

    Returns:
        That of the sign test; None of so few trials that it has none.
    """
    return _interval(np.asarray(values), [] if trials is None else _by_trial(trials))


def _interval(values: Array, groups: Sequence[Ids]) -> tuple[float, float] | None:
    """Return what `median_interval` does, of the places of every trial's cases; none where each is one."""
    order, n = np.argsort(values, kind="stable"), len(values)
    own = values[order]
    count = len(groups) if len(groups) < n and groups else n
    outside = ranks_outside(count)
    if not outside:
        return None
    if count == n:
        return float(own[outside - 1]), float(own[n - outside])
    trial = np.empty(n, dtype=int)
    for k, rows in enumerate(groups):
        trial[rows] = k
    times = redrawn(count)
    upto = np.cumsum(np.eye(count, dtype=int)[trial[order]], axis=0)  # cases of each trial, (n, trials)
    half = times @ upto[-1] / 2
    first = np.zeros(DRAWS, dtype=int)
    last = np.full(DRAWS, n - 1)
    for _ in range(n.bit_length()):  # by halves: the first case up to which half of those drawn lie
        middle_ = (first + last) // 2
        enough = np.einsum("dt,dt->d", times, upto[middle_]) >= half
        first, last = np.where(enough, first, middle_ + 1), np.where(enough, middle_, last)
    low, high = np.quantile(own[last], (TAIL, 1 - TAIL)).tolist()
    return low, high


@lru_cache
def ranks_outside(count: int) -> int:
    """Count the order statistics on each side of the 95 % interval of a median, as the sign test has them.

    Kept, as all columns of a table have as many trials.
    """
    from scipy.special import bdtr  # here: it takes long to import, and few commands compare trials

    return int(np.count_nonzero(bdtr(np.arange(count // 2 + 1), count, 0.5) <= TAIL))


@lru_cache(maxsize=4)
def redrawn(count: int) -> Ids:
    """Draw a bootstrap: how often each of so many trials is in each draw, (DRAWS, count), the same each time.

    Kept, as all columns of a table have as many trials; drawing takes longer than what is done with it.
    """
    times = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), size=DRAWS)
    times.flags.writeable = False
    return times


def independent(holds: Cells, trials: Cells) -> int:
    """Count the independent cases that tell a share as precisely as these, of which some share a trial.

    Args:
        holds: Whether something holds in each case, (n,).
        trials: Labels of their trials, (n,).

    Returns:
        The number of cases over the design effect, the variance of the share by trial over that of as many
        independent cases (Kish, Survey Sampling, 1965); between the numbers of trials and of cases.
    """
    own, groups = np.asarray(holds, dtype=float), _by_trial(trials)
    n, share = len(own), own.mean()
    if share in (0, 1) or len(groups) < 2:
        return len(groups)
    sums = np.array([(own[rows] - share).sum() for rows in groups])
    effect = len(groups) / (len(groups) - 1) * (sums**2).sum() / (n * share * (1 - share))
    return int(np.clip(n / effect, len(groups), n)) if effect else n


def _by_trial(trials: Cells) -> list[Ids]:
    """Places of the cases of every trial."""
    _, own = np.unique(np.asarray(trials), return_inverse=True)
    return np.split(np.argsort(own, kind="stable"), np.cumsum(np.bincount(own))[:-1])


def wins(ours: Sequence[float] | Array, theirs: Sequence[float] | Array) -> int:
    """Count the trials in which ours is smaller by more than a solver's last digits.

    Args:
        ours: Errors of ours, (n,).
        theirs: Errors of the other, (n,).

    Returns:
        The number of trials.
    """
    return int(np.count_nonzero(np.asarray(ours) < (1 - SAME_ERROR) * np.asarray(theirs)))


def middle(value: Number) -> float:
    """Return a number, or its median over trials; NaN where there is none."""
    if isinstance(value, Spread):
        return value.median
    return math.nan if value is None else float(value)


def most(value: Number) -> float:
    """Return a number, or that of the trial in which it is largest."""
    return value.most if isinstance(value, Spread) and value.most is not None else middle(value)


def ends(value: Number) -> tuple[float, float]:
    """Compute the 5th and 95th percentile, of few trials the range; twice a number without spread."""
    return value.ends if isinstance(value, Spread) else (middle(value), middle(value))


def inner(value: Number) -> tuple[float, float] | None:
    """Return what is drawn as a line: the interval of the median; of few trials nothing but their dots."""
    if isinstance(value, Spread) and value.values:
        return None if value.too_few else value.interval
    return ends(value)


def range_of(value: Number) -> tuple[float, ...]:
    """Collect all that is drawn of a number: its trials, or the ends of its line."""
    return (*(value.values if isinstance(value, Spread) else ()), *(inner(value) or ()))


def triple(value: Number) -> tuple[float, float, float]:
    """Return median and ends; three times the number where it has no spread."""
    return (middle(value), *ends(value))


def dotted(values: Iterable[object]) -> str:
    """Say what dots and lines of spreads are in a picture; empty where nothing spreads."""
    spreads = [value for value in values if isinstance(value, Spread) and value.ends[0] < value.ends[1]]
    if not all(value.values for value in spreads):
        return f"lines: {spans(spreads)}"
    counts = sorted({value.trials for value in spreads})
    if not counts:
        return ""
    number = " to ".join(f"{n:,}" for n in dict.fromkeys(counts[:1] + counts[-1:]))
    dots = f"dots: {number} trials" if counts[-1] <= DOTS else f"dots: {DOTS} of {number} trials"
    return dots if counts[-1] < MIN_PERCENTILE_TRIALS else f"{dots}; line: 95 % interval of their median"


def spans(values: Iterable[object]) -> str:
    """Say what the ends of spreads are: percentiles, or of few trials the range; empty without any.

    Args:
        values: Numbers, some of them spreads.

    Returns:
        The words.
    """
    spreads = [own for own in values if isinstance(own, Spread) and own.ends[0] < own.ends[1]]
    counts, few = sorted({own.trials for own in spreads}), {own.too_few for own in spreads}
    if len(few) == 2:
        return f"5 to 95 %, or the range of fewer than {MIN_PERCENTILE_TRIALS} trials"
    number = " to ".join(f"{n:,}" for n in dict.fromkeys(counts[:1] + counts[-1:]))
    told = f" of {number} {'trial' if number == '1' else 'trials'}" if counts and counts[0] else ""
    return ("range" if True in few else "5 to 95 %") + told if spreads else ""


def span(trials: int) -> str:
    """Say what the ends of a spread over so many trials are."""
    return "5 % to 95 %" if trials >= MIN_PERCENTILE_TRIALS else "range"
