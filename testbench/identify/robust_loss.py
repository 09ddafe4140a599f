"""Robust loss for pairs, frames and calibrations: weights of readings, and noise beyond the stated one.

A reading has three components. Beyond a bend, in standard deviations, its influence is constant, which is
Huber's loss: rows are multiplied by the root of the weight. The noise is estimated by Huber's proposal 2.
"""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array

SCATTER_TOLERANCE = 2.0**-60
"""Error of the estimated noise, over ten times the largest residual [1]."""


@dataclass(frozen=True)
class Loss:
    """Define a robust loss of the length of a reading's residual."""

    threshold: float  #: Length, in standard deviations, beyond which a reading has less than full weight.
    mean_square: float  #: Mean of min(|z|, bend)^2 of normal 3-vectors z.

    def influence(self, length: Array) -> Array:
        """Compute the robust weight of a reading, 0 to 1, from the length of its whitened residual [1].

        Mathematics: `est-16`.
        """
        return np.asarray(np.minimum(1.0, self.threshold / np.maximum(length, self.threshold)))

    def scatter(self, residual: Array, variance: Array, share: float) -> float:
        """Estimate the standard deviation S that explains the residuals in addition to the stated variances.

        Mathematics: `est-17`.

        Args:
            residual: Residuals along axes in which the components of a reading are independent, (n, k) [m,
                rad].
            variance: Stated variances along these axes, (n, k) [m^2, rad^2].
            share: Degrees of freedom over number of equations [1].

        Returns:
            S along an axis [m, rad]; 0 if the stated variances explain the residuals.
        """
        from scipy.optimize import brentq  # here: it takes long to import, and few runs need it

        squares = np.square(residual)

        def excess(s: float) -> float:
            length = (squares / (variance + s**2)).sum(axis=1)
            return float(np.minimum(length, self.threshold**2).mean()) - self.mean_square * share

        high = 10 * float(np.sqrt(squares.max(initial=0.0)))
        if not len(residual) or excess(0.0) <= 0:
            return 0.0
        return high if excess(high) > 0 else float(brentq(excess, 0.0, high, xtol=SCATTER_TOLERANCE * high))


PAIRS = Loss(1.628, 1.928)
"""Loss for pairs while outliers are searched: means of normal 3-vectors keep 95 % efficiency, as single
numbers do with a bend of 1.345."""
FRAMES = Loss(3.0, 2.936)
"""Loss of a registration: 3 % of sound readings have less than full weight. With a bend of 3.5, errors of
frame and targets are 1 to 4 % larger if 5 % of the readings are off by 5 mm (median of 100 draws)."""
READINGS = Loss(3.5, 2.986)
"""Loss of a calibration: 0.7 % of sound readings have less than full weight."""
SQUARE = Loss(1e300, 3.0)
"""Loss of least squares: full weight for all."""
