"""A mistake that is planted in a sound data set, and what planting takes."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.studies.wrong_inputs.sound import Sound

Plant = Callable[[Sound, np.random.Generator], Sound]


@dataclass(frozen=True)
class Fault:
    """A mistake, and the doubts that name it."""

    words: str  #: What was done.
    plant: Plant  #: Does it.
    names: tuple[str, ...]  #: Of doubts that are right.
    #: Whether it can be seen in a data set: in one load no sensor's zero, on one target no exchange.
    possible: Callable[[Sound], bool] = lambda _: True


def of_data(change: Callable[[Sound, Dataset, np.random.Generator], Dataset]) -> Plant:
    """A mistake in the runs."""
    return lambda sound, rng: replace(sound, data=change(sound, sound.data, rng))


def bump(rng: np.random.Generator, size: float) -> Array:
    """A move of this size in any direction, (3,)."""
    direction = rng.standard_normal(3)
    return np.asarray(size * direction / np.linalg.norm(direction))
