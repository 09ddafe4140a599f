"""Doubts about a user's runs that no fit would show: another frame or unit, before and after exchanged."""

import numpy as np

from testbench.data.dataset import Dataset
from testbench.identify.weighed import marker_points
from testbench.model.vjm import Vjm, chain

FRAME = 0.2
"""Median distance of an unloaded marker from where the rigid arm has it, beyond which frames differ [m]."""


def doubts(vjm: Vjm, data: Dataset) -> tuple[str, ...]:
    """Sentences about what looks wrong; none if all is plausible."""
    where = chain(vjm, data.q)
    nominal = where.position[:, None] + marker_points(vjm, data.markers) @ where.rotation.transpose(0, 2, 1)
    with np.errstate(over="ignore"):  # an absurd reading is far away, however far
        away = float(np.median(np.linalg.norm(data.before - nominal, axis=-1)[data.seen]))
    found = []
    if away > FRAME:
        found.append(
            f"the unloaded markers lie {away:.3g} m (median) from where the arm's kinematics has them: "
            "another frame, unit or order of joints?"
        )
    work = np.einsum("rx,rmx->r", data.wrench[:, :3], data.deflection)
    if (work < 0).mean() > 0.5:
        found.append(
            f"in {(work < 0).sum()} of {data.runs} runs the markers move against the force: before and after "
            "exchanged, or the sign of the load?"
        )
    return tuple(found)
