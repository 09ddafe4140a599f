"""Where a program asks the tool to be."""

import numpy as np

from testbench.correct.newton import Asked, Target
from testbench.correct.rest import Rest, rest
from testbench.errors import Array
from testbench.identify.absolute.state import State
from testbench.model.vjm import tool_pose


def asked(state: State, q: Array, meant: Asked, point: Array) -> Target:
    """What programmed joints ask for.

    Args:
        state: The arm.
        q: Joints of the program, (points, n) [rad, m].
        meant: "unloaded" corrects what loads do; "drawn" also geometry, joint errors and own weight.
        point: Tool point in the tool's frame, (3,) [m].
    """
    if meant == "drawn":
        position, rotation = tool_pose(state.vjm, q)
        found = Rest(np.zeros((len(q), 0)), position, rotation)
    else:
        found = rest(state, q)
    return Target(found.at(point), found.rotation)
