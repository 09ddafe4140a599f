"""What was checked before doubts: two things, which nothing but a glance at the file would do better."""

import numpy as np

from testbench.bench.campaign import Cell
from testbench.data.dataset import Dataset
from testbench.identify.weighed import marker_points
from testbench.model.vjm import tool_points

FAR = 0.2  #: Median distance of an unloaded target from where the rigid arm has it [m].
AGAINST = 0.5  #: Share of the runs whose targets move against the force.


def noticed(cell: Cell, data: Dataset) -> bool:
    """Whether one of them speaks: unloaded targets far from the arm, or most runs move against the force."""
    nominal = tool_points(cell.vjm, data.q, marker_points(cell.vjm, data.markers))
    away = np.median(np.linalg.norm(data.before - nominal, axis=2))
    work = np.einsum("rx,rmx->r", data.wrench[:, :3], data.deflection)
    return bool(away > FAR or (work < 0).mean() > AGAINST)
