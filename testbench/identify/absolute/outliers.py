"""Readings that a calibration hardly believes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.data.series import Series
from testbench.errors import Array
from testbench.identify.absolute.noise import BEND
from testbench.identify.absolute.scatter import residuals
from testbench.identify.absolute.state import State

WILD = 0.5  #: How much a reading counts below which it is an outlier.


@dataclass(frozen=True)
class Outliers:
    """Positions that count less than half, and the worst of them."""

    count: int  #: Positions that count less than half.
    of: int  #: Positions that were read.
    series: str  #: Name of the series of the worst.
    row: int  #: Its identifier.
    distance: float  #: How far it is from the model [m].

    @property
    def words(self) -> str:
        """A sentence."""
        worst = f"the worst is row {self.row} of {self.series}, by {1e3 * self.distance:.3g} mm"
        return (
            f"{self.count} of {self.of} positions are more than {BEND / WILD:g} standard deviations off and "
            f"count less than half; {worst}"
        )


def outliers(state: State, series: Sequence[Series], pulls: Sequence[Array]) -> Outliers | None:
    """Positions that count less than half; None where all count more.

    Args:
        state: The calibrated arm.
        series: The readings.
        pulls: How much each reading counts, of every series (s, rows) [1].
    """
    found, count = [], 0
    for one, pull in zip(series, pulls, strict=True):
        m = len(one.markers)
        wild = (pull[:m].T < WILD) & one.seen
        far = np.where(wild, np.linalg.norm(residuals(state, one)[:m], axis=1).T, 0.0).max(axis=1)
        k, count = int(far.argmax()), count + int(wild.sum())
        found.append((float(far[k]), one.name, int(one.row[k])))
    if not count:
        return None
    distance, name, row = max(found)
    return Outliers(count, sum(int(one.seen.sum()) for one in series), name, row, distance)
