"""What the study asks: which models, which splits, how many poses."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from testbench.identify.absolute.fit import ORDERS
from testbench.studies.real_ur10.ladder import LADDER, QUICK
from testbench.studies.real_ur10.readings import THIN
from testbench.studies.real_ur10.rows import LadderRow

NAME = "real_ur10"
SPLITS = ("both", "blocks", "C to A", "A to C", "rows")
"""The dearest first."""
POSES, FEW = (50, 100, 200, 500, 1000), (60,)
"""Random poses of C that a model learns from; with --quick."""
DEAR, DEAR_SEEDS = 200, 5
"""Poses above which only so many seeds are drawn."""
QUICK_ORDERS = 40  #: Highest order of periodic errors with --quick.
JUDGING = 300  #: Random poses of C, never of those that trained, and about as many of A, that judge these.


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
    poses: tuple[int, ...]  #: Random poses that train.
    dear: tuple[int, ...]  #: Seeds in which more than DEAR poses are drawn too.
    #: Made of the rest by `trained.prepare`; empty before.
    ladder: Annotated[tuple[LadderRow, ...], Field(exclude=True)] = ()


def settings(_: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for."""
    return Settings(
        thin=THIN if quick else 1,
        orders=QUICK_ORDERS if quick else ORDERS,
        models=tuple(one.name for one in (QUICK if quick else LADDER)),
        splits=("both", "blocks", "C to A", "A to C") if quick else SPLITS,
        poses=FEW if quick else POSES,
        dear=tuple(seeds[:DEAR_SEEDS]),
    )
