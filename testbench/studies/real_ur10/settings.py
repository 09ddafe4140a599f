"""What the study asks: which models, which splits, how many poses."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from testbench.identify.absolute.fit import ORDERS
from testbench.studies.real_ur10.ladder import LADDER, QUICK
from testbench.studies.real_ur10.readings import THIN
from testbench.studies.real_ur10.rows import LadderRow

NAME = "real_ur10"
SPLITS = ("both", "blocks", "C to A", "A to C")
"""The dearest first."""
DRAWS: Mapping[int, int] = {50: 20, 100: 20, 200: 6, 500: 3, 1000: 3}
"""Random poses of C that a model learns from, and in how many seeds at most: many are dear."""
QUICK_DRAWS: Mapping[int, int] = {60: 1}
ENOUGH = 50  #: Highest order where the number of poses is in question: more change little and cost twice.
QUICK_ORDERS = 30  #: Highest order of periodic errors with --quick.
JUDGING = 200  #: Random poses of C, never of those that trained, and about as many of A, that judge these.


@dataclass(frozen=True)
class Options:
    """Flags of the study: none, its readings are what they are."""


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    thin: int  #: Every so many rows of the readings are taken.
    orders: int  #: Highest order of periodic errors.
    models: tuple[str, ...]  #: Of the ladder.
    splits: tuple[str, ...]
    first: int  #: The first seed.
    draws: Mapping[int, int]  #: Random poses that train, and in how many seeds, from the first, at most.
    #: Made of the rest by `trained.prepare`; empty before.
    ladder: Annotated[tuple[LadderRow, ...], Field(exclude=True)] = ()


def settings(_: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for."""
    return Settings(
        thin=THIN if quick else 1,
        orders=QUICK_ORDERS if quick else ORDERS,
        models=tuple(one.name for one in (QUICK if quick else LADDER)),
        splits=SPLITS,
        first=seeds[0],
        draws=QUICK_DRAWS if quick else DRAWS,
    )
