"""All trials of a run, for what is said of them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from testbench.trials.store import TrialStore

R = TypeVar("R")


@dataclass(frozen=True)
class Whole(Generic[R]):
    """All trials of a run that has come to its end: seed and rows, in the order of the seeds."""

    store: TrialStore[R]
    path: Path  #: The same in Parquet.

    def __iter__(self) -> Iterator[tuple[int, Sequence[R]]]:
        return self.store.trials()
