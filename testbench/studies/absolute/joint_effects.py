"""Joints of a real arm: their errors by each series, and effects that no model has (approach, drift)."""

from collections.abc import Mapping, Sequence

import numpy as np

from testbench.arm.folder import ArmJoint
from testbench.data.series import Series
from testbench.errors import Array
from testbench.identify.absolute.pattern import FIRST
from testbench.identify.absolute.scatter import residuals
from testbench.identify.absolute.state import ArmState, series_equilibrium
from testbench.identify.diagnosis.moves import in_time
from testbench.model.vjm import translation_rows
from testbench.report.table import Row, Trials
from testbench.workflows.rows import UM

STRANGE = 2.0
"""Distance of an angle from those that trained, beyond which order 60 has turned by a third [deg]."""
ANGLES = np.arange(-180.0, 180.0, 1.0)  #: Where the error of a joint is compared [deg].
UNSEEN = 1000.0  #: Half interval from which on rows do not show an effect [urad, um].
FEW = 15  #: Angles that both series visited, below which their errors are not compared.
HALF = 1.96  #: Half width of a 95 % interval [standard deviations].
TOGETHER, PARTS = 60, 10
"""Rows, an hour's or more, in which z counts as constant; parts of a series that give the interval."""


def joint_rows(
    joints: Sequence[ArmJoint], series: Sequence[Series], waves: Mapping[str, Sequence[float]]
) -> list[Row]:
    """Make a row a joint: its angles, and its error by A, by C and by both.

    Args:
        joints: Of the arm, n.
        series: A and C.
        waves: Coefficients of periodic errors by what trained, joint by joint, sines then cosines [rad].

    Returns:
        The rows.
    """
    own = {by: UM * np.array(every).reshape(len(joints), 2, -1) for by, every in waves.items()}
    a, c = (np.degrees(one.q) for one in series)
    return [
        _joint(joint.name, a[:, j], c[:, j], {by: every[j] for by, every in own.items()})
        for j, joint in enumerate(joints)
    ]


def _joint(name: str, a: Array, c: Array, waves: dict[str, Array]) -> Row:
    at_a, at_c = (_far(ANGLES, q) <= STRANGE for q in (a, c))
    common, seen = at_a & at_c, {"A": at_a, "C": at_c, "both": at_a | at_c}
    curves = {by: _curve(own) for by, own in waves.items()}
    alike = np.corrcoef(curves["A"][common], curves["C"][common])[0, 1] if common.sum() > FEW else None
    return Row(
        joint=name,
        strange_to_A_percent=float(100 * (_far(c, a) > STRANGE).mean()),
        strange_to_C_percent=float(100 * (_far(a, c) > STRANGE).mean()),
        common_deg=float(common.mean() * 360),
        correlation=None if alike is None else float(alike),
        **{f"rms_{by}_urad": float(np.sqrt((own[seen[by]] ** 2).mean())) for by, own in curves.items()},
    )


def effect_rows(joints: Sequence[ArmJoint], series: Sequence[str], own: Trials) -> list[Row]:
    """Make rows of effects that no model has, with half intervals; none of joints that the rows do not show.

    Args:
        joints: Of the arm.
        series: Their names.
        own: The row of the model that the effects are left by.

    Returns:
        The rows.
    """
    names = [(f"approach, {joint.name}", "urad") for joint in joints]
    names += [(f"drift of z, {name}", "um") for name in series]
    every = zip(names, np.reshape(own["effects"][0], (-1, 2)).tolist(), strict=True)
    rows = (Row(what=what, value=x, half_95=half, unit=unit) for (what, unit), (x, half) in every)
    return [row for row in rows if 0 < row.half_95 < UNSEEN]


def _curve(waves: Array) -> Array:
    """The error over `ANGLES` by sines and cosines, (2, orders), those below FIRST left out [urad]."""
    angle = np.radians(np.outer(ANGLES, np.arange(1, waves.shape[1] + 1)))[:, FIRST - 1 :]
    sines, cosines = waves[:, FIRST - 1 :]
    return np.asarray(np.sin(angle) @ sines + np.cos(angle) @ cosines)


def _far(angles: Array, known: Array) -> Array:
    """Distance of some angles from the nearest of others, modulo a turn [deg]."""
    ring = np.sort(known % 360)
    ring = np.r_[ring[-1] - 360, ring, ring[0] + 360]
    at = angles % 360
    place = np.clip(np.searchsorted(ring, at), 1, len(ring) - 1)
    return np.asarray(np.minimum(at - ring[place - 1], ring[place] - at))


def approach(state: ArmState, series: Series) -> Array:
    """Compute how far every joint differs by the side from which it comes.

    Least squares over rows that follow the one before in the file; zero where none does.

    Args:
        state: The calibrated arm.
        series: A series of absolute readings.

    Returns:
        Difference and half its interval, (n, 2) [rad, m].
    """
    one = in_time(series)
    came = np.flatnonzero(np.diff(one.row) == 1)
    sign = np.sign(np.diff(one.q, axis=0)[came]).T
    J = translation_rows(series_equilibrium(state, one).chain, state.mount(one).points)
    A = J.reshape(-1, len(state.theta_0), one.rows)[:3, state.vjm.joint_slice, 1 + came] * sign / 2
    A, y = A.transpose(0, 2, 1).reshape(-1, len(sign)), residuals(state, one)[0][:, 1 + came].ravel()
    inverse = np.linalg.pinv(A)
    x = inverse @ y
    scatter = np.linalg.norm(y - A @ x) / np.sqrt(max(len(y), 1))
    return np.stack([x, HALF * scatter * np.linalg.norm(inverse, axis=1)], axis=1)


def drift(state: ArmState, series: Series) -> Array:
    """Compute the RMS drift of z in base axes: means of rows less their scatter.

    Args:
        state: The calibrated arm.
        series: A series of absolute readings.

    Returns:
        RMS and half its interval, (2,) [m].
    """
    z = residuals(state, in_time(series))[0, 2]
    z = (z - z.mean())[: len(z) // TOGETHER * TOGETHER].reshape(-1, TOGETHER)
    squares = z.mean(axis=1) ** 2 - z.var(axis=1, ddof=1) / TOGETHER
    parts = [part.mean() for part in np.array_split(squares, min(PARTS, len(squares)))]
    rms = np.sqrt(max(squares.mean(), np.finfo(float).tiny))
    return np.array([rms, HALF * np.std(parts, ddof=1) / np.sqrt(len(parts)) / (2 * rms)])
