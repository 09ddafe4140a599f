"""The truth without its non-linearity: first-order deflections from MuJoCo's own Jacobians.

For studies that must tell model error from noise. Same tangent as `settle` at theta = 0; shares no code
with the model side.
"""

import mujoco
import numpy as np

from testbench.errors import Array, check_array
from testbench.plant.equilibrium import Equilibrium, Plant


def settle_linear(plant: Plant, q: Array, wrench: Array, point: Array) -> Equilibrium:
    """First-order equilibrium of a weightless arm: theta = C_theta J_F^T w at theta = 0.

    Returns:
        The displaced poses; residual and step are zero, iterations one.
    """
    q = check_array(q, (None, plant.arm.n_joints), "q [rad]")
    runs, model, data = len(q), plant.model, mujoco.MjData(plant.model)
    wrench = check_array(wrench, (runs, 6), "wrench [N, N m]")
    point = check_array(point, (runs, 3), "point [m]")
    theta = np.empty((runs, model.nv))
    markers, tool = np.empty((runs, len(plant.markers), 3)), np.empty((runs, 3))
    rotation = np.empty((runs, 3, 3))
    for i in range(runs):
        data.qpos[plant.joints] = q[i]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        frame = data.xmat[plant.tool].reshape(3, 3)
        at = data.xpos[plant.tool] + frame @ point[i]
        J_p, J_r = _jacobian(plant, data, at)
        theta[i] = plant.C @ (J_p.T @ wrench[i, :3] + J_r.T @ wrench[i, 3:])
        for k, body in enumerate(plant.markers):
            where = data.xpos[body]
            markers[i, k] = where + _jacobian(plant, data, where)[0] @ theta[i]
        tool[i] = data.xpos[plant.tool] + _jacobian(plant, data, data.xpos[plant.tool])[0] @ theta[i]
        turn = np.empty(9)
        _rotation(J_r @ theta[i], turn)
        rotation[i] = turn.reshape(3, 3) @ frame
    zero = np.zeros(runs)
    return Equilibrium(theta[:, plant.theta], markers, tool, rotation, zero, zero, np.ones(runs, dtype=int))


def _jacobian(plant: Plant, data: mujoco.MjData, point: Array) -> tuple[Array, Array]:
    """Translational and rotational rows at a world point fixed in the tool, each (3, nv)."""
    J_p, J_r = np.zeros((3, plant.model.nv)), np.zeros((3, plant.model.nv))
    mujoco.mj_jac(plant.model, data, J_p, J_r, point, plant.tool)
    return J_p, J_r


def _rotation(vector: Array, out: Array) -> None:
    """Rotation matrix of a rotation vector, row by row into (9,)."""
    quaternion = np.array([1.0, 0, 0, 0])
    mujoco.mju_quatIntegrate(quaternion, vector, 1.0)
    mujoco.mju_quat2Mat(out, quaternion)
