"""What the study of wrong inputs reports: types of report.json."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.bench.rows import DatasetRow
from testbench.trials.spread import Spread

Z = 1.959964  #: Of a normal quantity, within which 95 % of it lie.


@dataclass(frozen=True)
class Rate:
    """How often something holds, with its 95 % interval (Wilson's score)."""

    of: int
    count: int
    share: float
    low: float
    high: float


def rate(held: Sequence[bool]) -> Rate:
    """Share of at least one."""
    n, share = len(held), float(np.mean(held))
    middle = (share + Z**2 / (2 * n)) / (1 + Z**2 / n)
    half = Z / (1 + Z**2 / n) * np.sqrt(share * (1 - share) / n + Z**2 / (4 * n**2))
    return Rate(n, sum(held), share, max(0.0, float(middle - half)), min(1.0, float(middle + half)))


@dataclass(frozen=True)
class FaultRow:
    """One fault over all data sets that it was planted in."""

    fault: str
    words: str  #: What was done.
    names: str  #: Doubts that are right.
    right: Rate  #: Named by the right doubt first.
    anywhere: float  #: Share in which it is named right, first or later.
    other: float  #: Share in which another doubt is first.
    silent: float  #: Share in which nothing is noticed.
    instead: str  #: Other doubts that are first most often, with their counts.
    before: float | None  #: Share that the two checks before notice, of sets in the base's frame.


@dataclass(frozen=True)
class KindRow:
    """Data sets of one kind."""

    kind: str
    alarms: Rate  #: Sound sets with a doubt.
    right: Rate | None  #: Faults named by the right doubt first; None where none was planted.


@dataclass(frozen=True)
class Alarm:
    """A sound data set with a doubt."""

    trial: int  #: Its seed.
    kind: str
    first: str  #: Name of the first doubt.
    evidence: float | None
    said: str


@dataclass(frozen=True)
class Example:
    """What is said of one data set of the trial that is shown."""

    case: str
    words: str
    first: str  #: Name of the first doubt, empty for none.
    said: str
    right: bool


@dataclass(frozen=True)
class Before:
    """The two checks before, on sets in the base's frame: they notice, but name nothing."""

    noticed: Rate
    alarms: Rate | None  #: Of sound sets.


@dataclass(frozen=True)
class WrongInputsReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    trials: int
    arms: tuple[str, ...]
    truth: tuple[str, ...]  #: The family.
    right: Rate  #: Faults named by the right doubt first, over all data sets.
    anywhere: Rate  #: By the right doubt, first or later.
    silent: Rate  #: Not noticed at all.
    alarms: Rate  #: Sound data sets with a doubt.
    before: Before | None  #: None without a set in the base's frame.
    faults: list[FaultRow]  #: The one that is named most seldom first.
    lost: list[FaultRow]  #: Those that are named too seldom.
    kinds: list[KindRow]
    false_alarms: list[Alarm]
    seconds: Spread  #: Of one data set.
    shown: int  #: Seed of the trial that is shown.
    examples: list[Example]  #: Its data sets.
    dataset: DatasetRow  #: The sound one of it.
