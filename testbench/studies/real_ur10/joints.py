"""The joints: where they were turned, their periodic errors by order, and their springs."""

from collections.abc import Sequence

import numpy as np

from testbench.arm.folder import Joint
from testbench.bench.rows import UM
from testbench.data.series import Series
from testbench.errors import Array
from testbench.report.table import Row
from testbench.studies.real_ur10.ladder import TWO, WAVES
from testbench.studies.real_ur10.trial import LadderRow

STRANGE = 2.0
"""Distance of an angle from those that trained, beyond which order 60 has turned by a third [deg]."""
ANGLES = np.arange(-180.0, 180.0, 1.0)  #: Where the curve of a joint's error is drawn [deg].
FIRST = 3
"""Lowest order of that curve: an axis that is not where it is drawn looks like orders 1 and 2."""
FEW = 15  #: Angles that both series visited, below which their curves are not compared.
TRAINED = {"A to C": "A", "C to A": "C", "both": "both"}
"""What trains on a split."""


def joint_reports(
    joints: Sequence[Joint], series: Sequence[Series], ladder: Sequence[LadderRow]
) -> list[Row]:
    """One report a joint."""
    a, c = (np.degrees(one.q) for one in series)
    waves = {name: _waves(ladder, name, len(joints)) for name in TRAINED}
    return [
        _report(joints[j].name, a[:, j], c[:, j], {k: w[:, j] for k, w in waves.items()})
        for j in range(len(joints))
    ]


def _waves(ladder: Sequence[LadderRow], name: str, joints: int) -> Array:
    """Sines and cosines of all joints by the readings of a split, (2, n, orders) [urad]."""
    own = next(row.waves for row in ladder if (row.split, row.name, row.judged) == (name, WAVES.name, None))
    return np.asarray(UM * np.array(own).reshape(joints, 2, -1).swapaxes(0, 1))


def _report(name: str, a: Array, c: Array, waves: dict[str, Array]) -> Row:
    of_a, of_c, both = waves.values()
    curves, seen = [_curve(w) for w in (of_a, of_c)], [_far(ANGLES, q) <= STRANGE for q in (a, c)]
    common = seen[0] & seen[1]
    alike = np.corrcoef(curves[0][common], curves[1][common])[0, 1] if common.sum() > FEW else None
    drawn = [
        [float(y) if s else None for y, s in zip(*own, strict=True)] for own in zip(curves, seen, strict=True)
    ]
    return Row(
        joint=name,
        low_A_deg=float(a.min()),
        high_A_deg=float(a.max()),
        low_C_deg=float(c.min()),
        high_C_deg=float(c.max()),
        strange_to_A_percent=float(100 * (_far(c, a) > STRANGE).mean()),
        strange_to_C_percent=float(100 * (_far(a, c) > STRANGE).mean()),
        common_deg=float(common.mean() * 360),
        correlation=None if alike is None else float(alike),
        rms_A_urad=_rms(curves[0][seen[0]]),
        rms_C_urad=_rms(curves[1][seen[1]]),
        rms_both_urad=_rms(_curve(both)[seen[0] | seen[1]]),
        amplitude_A_urad=np.hypot(*of_a).tolist(),
        amplitude_C_urad=np.hypot(*of_c).tolist(),
        amplitude_both_urad=np.hypot(*both).tolist(),
        angle_deg=ANGLES.tolist(),
        curve_A_urad=drawn[0],
        curve_C_urad=drawn[1],
    )


def _curve(waves: Array) -> Array:
    """The error over `ANGLES` by sines and cosines, (2, orders), those below FIRST left out [urad]."""
    angle = np.radians(np.outer(ANGLES, np.arange(1, waves.shape[1] + 1)))[:, FIRST - 1 :]
    sines, cosines = waves[:, FIRST - 1 :]
    return np.asarray(np.sin(angle) @ sines + np.cos(angle) @ cosines)


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


def _far(angles: Array, known: Array) -> Array:
    """Distance of some angles from the nearest of others, modulo a turn [deg]."""
    ring = np.sort(known % 360)
    ring = np.r_[ring[-1] - 360, ring, ring[0] + 360]
    at = angles % 360
    place = np.clip(np.searchsorted(ring, at), 1, len(ring) - 1)
    return np.asarray(np.minimum(at - ring[place - 1], ring[place] - at))


def compliances(ladder: Sequence[LadderRow]) -> list[Row]:
    """Of joint springs without and with joint errors, by A, by C, by both."""
    return [
        Row(trained=TRAINED[row.split], name=row.name, urad_per_Nm=[UM * c for c in row.joints])
        for model in TWO
        for name in TRAINED
        for row in ladder
        if (row.split, row.name, row.judged) == (name, model.name, None)
    ]
