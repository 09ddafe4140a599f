"""What the real UR10's report says joint by joint: their errors by each series, and effects of no model."""

from collections.abc import Sequence

import numpy as np

from testbench.arm.folder import Joint
from testbench.campaign.rows import UM
from testbench.data.series import Series
from testbench.errors import Array
from testbench.identify.absolute.pattern import FIRST
from testbench.report.table import Row, Trials
from testbench.studies.real_ur10 import trial

STRANGE = 2.0
"""Distance of an angle from those that trained, beyond which order 60 has turned by a third [deg]."""
ANGLES = np.arange(-180.0, 180.0, 1.0)  #: Where the error of a joint is compared [deg].
UNSEEN = 1000.0  #: Half interval from which on rows do not show an effect [urad, um].
FEW = 15  #: Angles that both series visited, below which their errors are not compared.
TRAINED = {trial.TO_C: "A", trial.TO_A: "C", trial.BOTH: "both"}
"""What trains on a split."""


def joint_rows(joints: Sequence[Joint], series: Sequence[Series], ladder: Trials) -> list[Row]:
    """A row a joint: its angles, and its error by A, by C and by both."""
    waves = {}
    for name, by in TRAINED.items():
        own = ladder.where(split=name, name=trial.WAVES)["waves"][0]
        waves[by] = UM * np.array(own).reshape(len(joints), 2, -1)  # sines, cosines
    a, c = (np.degrees(one.q) for one in series)
    return [
        _joint(joint.name, a[:, j], c[:, j], {by: own[j] for by, own in waves.items()})
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


def effect_rows(joints: Sequence[Joint], own: Trials) -> list[Row]:
    """Effects that no model has, with half intervals; none of joints that the rows do not show."""
    names = [(f"approach, {joint.name}", "urad") for joint in joints]
    names += [(f"drift of z, {name}", "um") for name in trial.FILES]
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
