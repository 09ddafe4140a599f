"""Over the family of true arms: the flag that asks for it, and headlines that differ by true arm."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt
import typer

from testbench.bench.truths import TRUTHS, TrueArmName, member
from testbench.errors import Array
from testbench.trials.spread import Spread, spread

Words = npt.NDArray[np.object_]  #: A word a trial.
LEAST_TRIALS = 2  #: Of a true arm, below which its numbers have no spread.

TrueArmFlag = Annotated[
    TrueArmName, typer.Option(help="The true arm; in the family the next one each seed. The model stays.")
]


@dataclass(frozen=True)
class ByArm:
    """A headline over the trials of one true arm."""

    headline: str  #: What it is a number of, such as a model.
    true_arm: str
    trials: int
    value: Spread  #: In the unit of the headline.


def true_arms(family: str, seeds: Iterable[int]) -> dict[str, int]:
    """In how many trials each true arm is, in the order of the family."""
    counts = Counter(member(family, seed) for seed in seeds)
    return {arm: counts[arm] for arm in TRUTHS if arm in counts}


def by_arm(headline: str, arms: Sequence[str] | Words, values: Sequence[float] | Array) -> list[ByArm]:
    """A headline by true arm where it differs by more than its spread, else nothing.

    It does where the medians of true arms lie further apart than the 5 to 95 % of one is wide, in the median
    over true arms.

    Args:
        headline: What it is a number of.
        arms: True arm of every trial.
        values: Number of every trial.
    """
    names, numbers = np.asarray(arms, dtype=object), np.asarray(values, dtype=float)
    own = {arm: numbers[names == arm] for arm in TRUTHS if arm in set(names)}
    if min(map(len, own.values())) < LEAST_TRIALS:
        return []
    spreads = {arm: spread(found) for arm, found in own.items()}
    medians = [s.median for s in spreads.values()]
    if np.ptp(medians) <= np.median([s.ends[1] - s.ends[0] for s in spreads.values()]):
        return []
    return [ByArm(headline, arm, len(own[arm]), s) for arm, s in spreads.items()]
