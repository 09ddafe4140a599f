"""Absolute readings that fit the arm and are wrong: the last joint's sign, rows that slipped."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from testbench.data.series import Series, select_rows
from testbench.errors import BenchError
from testbench.identify.absolute.align import Misfit
from testbench.identify.absolute.scatter import Noise
from testbench.identify.absolute.state import ArmState
from testbench.identify.diagnosis.kinematics import ROWS, of_series
from testbench.identify.diagnosis.screens import slip
from testbench.model.vjm import Vjm

BETTER = 0.5  #: Scatter over that of the readings as they are, below which they were mistaken [1].


def check_last_joint(
    vjm: Vjm, series: Sequence[Series], fitted: Callable[[tuple[Series, ...]], tuple[ArmState, Noise]]
) -> None:
    """Refuse readings that fit much better with the last joint's sign reversed.

    A target near the last joint's axis lets them fit a frame with either sign. With orientations, which show
    the sign, nothing is checked here.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings.
        fitted: Function that fits geometry and springs to series, and returns state and noise.

    Raises:
        BenchError: When the scatter with the sign reversed is below BETTER times the scatter as read.
    """
    if any(one.rotation is not None for one in series):
        return
    thin = [select_rows(one, np.linspace(0, one.rows - 1, min(ROWS, one.rows)).astype(int)) for one in series]
    sign = np.where(np.arange(vjm.arm.n_joints) == vjm.arm.n_joints - 1, -1.0, 1.0)
    try:
        other = fitted(tuple(replace(one, q=sign * one.q) for one in thin))[1].open_position
    except BenchError:
        return
    own = fitted(tuple(thin))[1].open_position
    if other < BETTER * own:
        raise BenchError(
            f"{series[0].name}: the readings fit this arm to {1e3 * own:.2g} mm along an axis; they would to "
            f"{1e3 * other:.2g} mm if {vjm.arm.joints[-1].name} counted the other way"
        )


def check_order(vjm: Vjm, series: Sequence[Series]) -> None:
    """Refuse a series whose rows slipped against their poses.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings.

    Raises:
        Misfit: When the rows of one series belong to other poses from some row on.
    """
    for one in series:
        if found := slip(of_series(vjm, one)):
            first = one.row[found.first]
            raise Misfit(f"{one.name}: its rows from {first} on do not fit those before", one)
