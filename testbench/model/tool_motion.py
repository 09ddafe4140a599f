"""How the joints move the tool of the drawn arm: its pose and the Jacobian of the actuated joints."""

import numpy as np

from testbench.errors import Array
from testbench.model.vjm import Vjm, body_poses, cross


def tool_motion(vjm: Vjm, q: Array) -> tuple[Array, Array, Array]:
    """Where the tool is, and how every joint moves it, in world axes, all links and springs rigid.

    Args:
        vjm: The model.
        q: Actuated joints, (runs, n) [rad, m].

    Returns:
        Positions, (runs, 3) [m], orientations, world from tool, (runs, 3, 3), and Jacobians of the joints at
        the tool's origin, translation first, (runs, 6, n) [m, 1].
    """
    _, *bodies, (position, rotation) = body_poses(vjm, q)
    J = np.zeros((6, vjm.arm.n_joints, len(q)))
    for k, (joint, axis, (origin, R)) in enumerate(zip(vjm.arm.joints, vjm.axes, bodies, strict=True)):
        along = (R @ axis).T
        if joint.prismatic:
            J[:3, k] = along
        else:
            J[:3, k], J[3:, k] = cross(along, (position - origin).T), along
    return position, rotation, J.transpose(2, 0, 1)
