"""Effects that no model has, in what one leaves of a series: direction of approach, and drift in hours."""

import numpy as np

from testbench.data.series import Series
from testbench.errors import Array
from testbench.identify.absolute.scatter import residuals
from testbench.identify.absolute.state import State, forward
from testbench.identify.diagnosis.moves import in_time
from testbench.model.vjm import translation_rows

HALF = 1.96  #: Half width of a 95 % interval [standard deviations].
TOGETHER, PARTS = 60, 10
"""Rows, an hour's or more, in which z counts as constant; parts of a series that give the interval."""


def approach(state: State, series: Series) -> Array:
    """How far every joint stands apart by the side that it comes from, and half intervals, (n, 2) [rad, m].

    Least squares over rows that follow the one before in the file; zero where none does.
    """
    one = in_time(series)
    came = np.flatnonzero(np.diff(one.row) == 1)
    sign = np.sign(np.diff(one.q, axis=0)[came]).T
    J = translation_rows(forward(state, one).where, state.mount(one).points)
    A = J.reshape(-1, len(state.theta_0), one.rows)[:3, state.vjm.own, 1 + came] * sign / 2
    A, y = A.transpose(0, 2, 1).reshape(-1, len(sign)), residuals(state, one)[0][:, 1 + came].ravel()
    inverse = np.linalg.pinv(A)
    x = inverse @ y
    scatter = np.linalg.norm(y - A @ x) / np.sqrt(max(len(y), 1))
    return np.stack([x, HALF * scatter * np.linalg.norm(inverse, axis=1)], axis=1)


def drift(state: State, series: Series) -> Array:
    """RMS of how z drifts in base axes, and half its interval, (2,) [m]: means of rows less their scatter."""
    z = residuals(state, in_time(series))[0, 2]
    z = (z - z.mean())[: len(z) // TOGETHER * TOGETHER].reshape(-1, TOGETHER)
    squares = z.mean(axis=1) ** 2 - z.var(axis=1, ddof=1) / TOGETHER
    parts = [part.mean() for part in np.array_split(squares, min(PARTS, len(squares)))]
    rms = np.sqrt(max(squares.mean(), np.finfo(float).tiny))
    return np.array([rms, HALF * np.std(parts, ddof=1) / np.sqrt(len(parts)) / (2 * rms)])
