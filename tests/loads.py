"""Random poses of an arm, the payload that hangs from it in them, and pulls along all axes."""

import numpy as np

from testbench.correct.newton import Aim, InverseStaticsProblem, equilibrium, solve_inverse_statics
from testbench.data.dataset import Dataset
from testbench.identify.posterior import elastic_state
from testbench.model.load import Load, massless_bodies
from testbench.model.structure import all153
from testbench.model.vjm import evaluate_chain, generalised_load, observation_matrix, observation_rows

GRAVITY = 9.81
SIGMA, SIGMA_ROTATION = 25e-6, 250e-6  #: Of a reading along an axis [m, rad].


def at_rest(cell, C_theta, q, wrench, point):
    """Virtual joints of the arm without weight under a load, (runs, n_theta) [m, rad]."""
    return equilibrium(
        elastic_state(cell.vjm, C_theta, massless_bodies(cell.arm)), q, [Load(wrench, point)]
    ).theta


def random_q(cell, rng, runs):
    return rng.uniform(*cell.arm.limits, (runs, cell.arm.n_joints))


def hung(cell, runs, mass=460.3):
    """A hung mass as the truth has it: wrench, (runs, 6) [N, N m], and where it acts, (runs, 3) [m]."""
    wrench = np.zeros((runs, 6))
    wrench[:, 2] = -GRAVITY * mass
    return wrench, np.tile(cell.plant.load_point, (runs, 1))


def rows_of(cell, structure, where, targets=None):
    """Deflections of targets, or of the first marker, as functionals of parameters, (3 runs m, n)."""
    args = evaluate_chain(cell.vjm, where.q), structure, where.wrench, where.point
    targets = cell.vjm.markers[:1] if targets is None else targets
    return observation_matrix(*args, targets).reshape(-1, structure.n_parameters)


def rotation_observation(where, structure, wrench, point):
    """How the tool turns with parameters, (runs, 1, 3, n)."""
    A = np.stack([*observation_rows(structure, where.J_theta[3:], generalised_load(where, wrench, point))])
    return A.transpose(2, 0, 1)[:, None]


def axis_loads(cell, rng, *, noise=1.0, poses=18):
    """Section 5.2: six axis loads a pose, full pose read; linear truth by the model itself."""
    q = np.repeat(rng.uniform(*cell.arm.limits, (poses, cell.arm.n_joints)), 6, axis=0)
    runs, targets, s = len(q), cell.vjm.markers, all153(cell.arm)
    wrench, point = np.tile(1000 * np.eye(6), (poses, 1)), np.zeros((runs, 3))
    C = s.parameters_of(cell.arm.C_theta)
    args = (evaluate_chain(cell.vjm, q), s, wrench, point)
    before, after = noise * SIGMA * rng.standard_normal((2, runs, len(targets), 3))
    turned, again = noise * SIGMA_ROTATION * rng.standard_normal((2, runs, 3))
    return Dataset(
        markers=cell.arm.markers,
        run_id=np.arange(runs) + 1,
        pose_id=np.repeat(np.arange(poses), 6),
        q=q,
        wrench=wrench,
        point=point,
        before=before,
        after=observation_matrix(*args, targets) @ C + after,
        sigma=SIGMA,
        rotation_before=turned,
        rotation_after=(rotation_observation(*args) @ C)[:, 0] + again,
        sigma_rotation=SIGMA_ROTATION,
    )


def correct(state, q, loads, target, aim=None):
    """Joints for which the loaded tool is on its target, all of them free."""
    every = [load.for_poses(len(q)) for load in loads]
    return solve_inverse_statics(
        InverseStaticsProblem(state, q, every, target, aim or Aim(), np.ones(q.shape))
    )
