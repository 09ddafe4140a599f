"""The robust loss of pairs, frames and calibrations: how much a reading pulls, and the scatter beside it.

A reading is three numbers. Beyond a bend, in standard deviations, it pulls no harder, which is Huber's loss:
rows are weighed by the root of its pull. The scatter is Huber's proposal 2.
"""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array

FINEST = 2.0**-60  #: Error of a scatter over ten times the largest residual.


@dataclass(frozen=True)
class Loss:
    """A loss of the length of a reading's residual."""

    bend: float  #: Length, in standard deviations, beyond which a reading pulls less.
    mean_square: float  #: Mean of min(|z|, bend)^2 of normal 3-vectors z.

    def pull(self, length: Array) -> Array:
        """By how much a reading pulls less than a sound one, by the length of its whitened residual [1].

        Mathematics: `est-16`.
        """
        return np.asarray(np.minimum(1.0, self.bend / np.maximum(length, self.bend)))

    def spread(self, residual: Array, variance: Array, share: float) -> float:
        """S such that residuals have the length that their variances promise, 0 where they are shorter.

        Mathematics: `est-17`.

        Args:
            residual: Along axes in which the components of a reading are independent, (n, k) [m, rad].
            variance: Of the readings themselves there, (n, k) [m^2, rad^2].
            share: Equations less unknowns over equations [1].

        Returns:
            Standard deviation along an axis beside that of the readings [m, rad].
        """
        from scipy.optimize import brentq  # here: it takes long to import, and few runs need it

        squares = np.square(residual)

        def excess(s: float) -> float:
            length = (squares / (variance + s**2)).sum(axis=1)
            return float(np.minimum(length, self.bend**2).mean()) - self.mean_square * share

        high = 10 * float(np.sqrt(squares.max(initial=0.0)))
        if not len(residual) or excess(0.0) <= 0:
            return 0.0
        return high if excess(high) > 0 else float(brentq(excess, 0.0, high, xtol=FINEST * high))


PAIRS = Loss(1.628, 1.928)
"""Of pairs, while outliers are sought: means of normal 3-vectors keep 95 % of their efficiency, which for
single numbers is a bend of 1.345."""
FRAMES = Loss(3.0, 2.936)
"""Of a registration: 3 % of sound readings pull less. With a bend of 3.5 frame and targets err 1 to 4 % more
where 5 % of the readings are off by 5 mm (median of 100 draws)."""
READINGS = Loss(3.5, 2.986)  #: Of a calibration: 0.7 % of sound ones do.
SQUARE = Loss(1e300, 3.0)  #: Least squares: none pulls less.
