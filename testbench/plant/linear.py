"""The truth without its non-linearity: first-order deflections from MuJoCo's own Jacobians.

For studies that must tell model error from noise. Same tangent as `settle` at theta = 0; shares no code
with the model side.
"""

import mujoco
import numpy as np

from testbench.errors import Array, check_array
from testbench.plant.build import Plant
from testbench.plant.equilibrium import Equilibrium, hold, in_parts
from testbench.plant.shapes import rotation_of
from testbench.plant.state import Row, evaluate, generalised_force, moved, place


def settle_linear(plant: Plant, q: Array, wrench: Array, point: Array) -> Equilibrium:
    """First-order equilibrium of a weightless arm: theta = C_theta J_F^T w at theta = 0.

    Returns:
        The displaced poses; residual and step are zero, iterations one.
    """
    q = check_array(q, (None, plant.arm.n_joints), "q [rad, m]")
    wrench = check_array(wrench, (len(q), 6), "wrench [N, N m]")
    point = check_array(point, (len(q), 3), "point [m]")

    def settled(some: slice, row: Row) -> Equilibrium:
        return _settle(plant, row, q[some], wrench[some], point[some])

    return in_parts(plant, len(q), settled)


def _settle(plant: Plant, row: Row, q: Array, wrench: Array, point: Array) -> Equilibrium:
    tool, markers = plant.tool, plant.markers.tolist()
    state = evaluate(row, hold(plant, q), {tool, *markers})
    at = place(state, tool, point)
    theta = np.matvec(plant.C, generalised_force(plant, state, tool, wrench, at))
    places = [state.position[body] + moved(plant, state, body, theta)[0] for body in (*markers, tool)]
    turns = np.tile([1.0, 0, 0, 0], (len(q), 1))
    for quaternion, vector in zip(turns, moved(plant, state, tool, theta)[1], strict=True):
        mujoco.mju_quatIntegrate(quaternion, vector, 1.0)
    zero = np.zeros(len(q))
    return Equilibrium(
        theta=theta[:, plant.theta],
        markers=np.stack(places[:-1], axis=1),
        tool=places[-1],
        rotation=np.reshape([rotation_of(turn) for turn in turns], (-1, 3, 3)) @ state.rotation[tool],
        residual=zero,
        step=zero,
        iterations=np.ones(len(q), dtype=int),
    )
