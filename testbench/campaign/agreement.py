"""MuJoCo and Pinocchio read an arm each for itself; before anything is done with it they must agree."""

from typing import TYPE_CHECKING

import numpy as np

from testbench.errors import Array, InputError
from testbench.model.vjm import Vjm, body_poses

if TYPE_CHECKING:
    from testbench.plant import Plant

AGREEMENT, POSES = 1e-9, 8
"""Distance between the two readings [m] over one metre plus that from the origin, and poses compared."""


def check_agreement(vjm: Vjm, plant: "Plant") -> float:
    """Compare where truth and model place links, tool, load point and markers.

    Returns:
        The largest distance; axes of links and tool count at a metre [m].

    Raises:
        InputError: When a body is farther away than rounding explains; names it.
    """
    from testbench.plant import unloaded

    arm = vjm.arm
    lower, upper = arm.limits
    q = np.random.default_rng(0).uniform(lower, upper, (POSES, arm.n_joints))
    ours = [np.dstack([R, p]) for p, R in body_poses(vjm, q)]  # axes and origin as columns
    ours += [_point(ours[-1], point) for point in (vjm.load, *vjm.markers)]
    names = (*(link.name for link in arm.links), arm.tool, arm.load, *arm.markers)
    largest = 0.0
    for name, own, (p, R) in zip(names, ours, unloaded(plant, q, names), strict=True):
        theirs = np.dstack([R, p])[..., -own.shape[2] :]
        apart = float(np.abs(own - theirs).max())
        if not apart <= AGREEMENT * (1 + float(np.abs(p).max())):
            problem = f"MuJoCo and Pinocchio place it {apart:.1e} m apart"
            raise InputError(arm.rigid, f"<body name={name!r}>", problem)
        largest = max(largest, apart)
    return largest


def _point(tool: Array, point: Array) -> Array:
    """A point of the tool in the world, as a column, (poses, 3, 1) [m]: the model knows no axes there."""
    return tool[..., 3:] + tool[..., :3] @ point[:, None]
