"""The scale of errors over the workspace: the same for maps that stand side by side, in any view."""

from dataclasses import dataclass

import numpy as np

from testbench.bench.error_places import ErrorPlaces
from testbench.errors import Array

FAR = 10.0  #: Times the median of the best map beyond which an error makes the scale logarithmic [1].
DEEP = 1e-3  #: Least error on a logarithmic scale over the greatest [1].


@dataclass(frozen=True)
class Scale:
    """What colours and sizes mean, the same in all maps that stand side by side."""

    ends: tuple[float, float]  #: Least and greatest error; what is less is drawn as the least [mm].
    logarithmic: bool

    def shares(self, mm: Array) -> Array:
        """Places of errors [mm] on the scale, 0 to 1."""
        if not self.logarithmic:
            return shares(mm, self.ends)
        low, high = np.log10(self.ends)
        return shares(np.log10(np.maximum(mm, self.ends[0])), (low, high))

    def errors(self, share: Array) -> Array:
        """Errors [mm] at places on the scale, 0 to 1."""
        low, high = np.log10(self.ends) if self.logarithmic else self.ends
        found = low + share * (high - low)
        return np.asarray(10**found if self.logarithmic else found)

    @property
    def words(self) -> str:
        """The unit, and the scale where it is not linear."""
        return "mm, logarithmic" if self.logarithmic else "mm"


def scale_of(*errors_mm: Array) -> Scale:
    """The scale of several maps: logarithmic where an error is far above the median of the best map.

    Args:
        errors_mm: Of each map, (n,) [mm]; NaN where there is no bound.
    """
    errors_mm = tuple(mm[np.isfinite(mm)] for mm in errors_mm if np.isfinite(mm).any())
    every = np.concatenate(errors_mm)
    low, high = float(every.min()), float(every.max())
    far = high > FAR * min(float(np.median(mm)) for mm in errors_mm)
    return Scale((max(low, DEEP * high) if far else low, high), far)


def scale_for(found: ErrorPlaces) -> Scale:
    """The one scale of the models that are compared."""
    return scale_of(*(found.errors(name) for name in found.compared))


def shares(errors: Array, ends: tuple[float, float]) -> Array:
    """Place of errors on the scale, 0 to 1; 0 where all are equal.

    Args:
        errors: Any shape [mm].
        ends: Of the scale [mm].
    """
    low, high = ends
    return np.asarray((errors - low) / (high - low) if high > low else np.zeros_like(errors))
