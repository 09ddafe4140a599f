"""Poses evaluated by MuJoCo, many at once, and generalised forces of loads on bodies."""

from collections.abc import Collection
from dataclasses import dataclass

import mujoco
import numpy as np

from testbench.errors import Array
from testbench.plant.build import Plant


@dataclass(frozen=True)
class BodyState:
    """Hold gravity forces and Jacobians of some poses, and the poses of requested bodies, by their ids."""

    weight: Array  #: Generalised force of the arm's own weight, (poses, nv) [N, N m].
    #: Rotation, and motion at `centre`, per unit of every coordinate: MuJoCo's cdof, (poses, nv, 6) [1, m].
    motion: Array
    centre: Array  #: Its point of reference in the world, (poses, 3) [m].
    position: dict[int, Array]  #: Of the bodies in the world, (poses, 3) each [m].
    rotation: dict[int, Array]  #: World from body, (poses, 3, 3) each [1].


@dataclass(frozen=True)
class ArmsInRow:
    """Hold the copies of the arm in one MuJoCo state; every call of `solve_equilibrium` has its own."""

    model: mujoco.MjModel
    data: mujoco.MjData
    qpos: Array  #: Configuration of every arm, (arms, nv) [m, rad].
    motion: Array  #: As in `BodyState`, (arms, nv, 6).
    centre: Array  #: As in `BodyState`, (arms, 3).
    position: Array  #: Of every body but the world: body b is at b - 1, (arms, bodies, 3) [m].
    rotation: Array  #: World from body, (arms, bodies, 3, 3) [1].


def open_row(plant: Plant) -> ArmsInRow:
    """Make the MuJoCo model with copies of the plant's arm in a row, which are evaluated together.

    Args:
        plant: The plant.

    Returns:
        The model with views of its arrays, one row per copy.
    """
    model, data = plant.abreast, mujoco.MjData(plant.abreast)
    nv, bodies, root = plant.model.nv, plant.model.nbody - 1, plant.model.body_rootid[plant.tool]
    return ArmsInRow(
        model=model,
        data=data,
        qpos=data.qpos.reshape(-1, nv),
        motion=data.cdof.reshape(-1, nv, 6),
        centre=data.subtree_com[1:].reshape(-1, bodies, 3)[:, root - 1],
        position=data.xpos[1:].reshape(-1, bodies, 3),
        rotation=data.xmat[1:].reshape(-1, bodies, 3, 3),
    )


def evaluate(row: ArmsInRow, qpos: Array, bodies: Collection[int] = ()) -> BodyState:
    """Evaluate configurations in MuJoCo, as many at a time as there are arms in the row.

    Velocities are zero, so of MuJoCo's forward pass only kinematics and the bias force are needed.

    Args:
        row: The arms.
        qpos: Configurations, (poses, nv) [m, rad].
        bodies: Ids of the bodies whose places are wanted; without any, `motion` and `centre` are left out.

    Returns:
        Places of the bodies, and the generalised force of the arm's own weight.
    """
    model, data, (arms, nv) = row.model, row.data, row.qpos.shape
    poses, room = len(qpos), -(-len(qpos) // arms) * arms
    bias = np.empty((room, nv))
    placed = room if bodies else 0
    motion, centre = np.empty((placed, nv, 6)), np.empty((placed, 3))
    position = {body: np.empty((room, 3)) for body in bodies}
    rotation = {body: np.empty((room, 3, 3)) for body in bodies}
    # One call of MuJoCo for each row of arms; the last row is filled up.
    for start in range(0, room, arms):
        some = slice(start, start + arms)
        row.qpos[: poses - start] = qpos[some]
        mujoco.mj_fwdKinematics(model, data)
        mujoco.mj_rne(model, data, 0, bias[some].reshape(-1))
        if bodies:
            motion[some], centre[some] = row.motion, row.centre
        for body in bodies:
            position[body][some], rotation[body][some] = row.position[:, body - 1], row.rotation[:, body - 1]
    return BodyState(
        weight=-bias[:poses],
        motion=motion[:poses],
        centre=centre[:poses],
        position={body: p[:poses] for body, p in position.items()},
        rotation={body: R[:poses] for body, R in rotation.items()},
    )


def point_position(state: BodyState, body: int, point: Array) -> Array:
    """Compute the world position of a point of a body in every pose.

    Args:
        state: The poses.
        body: Number of the body.
        point: Point in the body's frame, (3,) or (poses, 3) [m].

    Returns:
        Position, (poses, 3) [m].
    """
    return np.asarray(state.position[body] + np.matvec(state.rotation[body], point))


def generalised_force(plant: Plant, state: BodyState, body: int, wrench: Array, point: Array) -> Array:
    """Compute the generalised force J^T w of a wrench on a body at a world point.

    Args:
        plant: The arm.
        state: Its poses.
        body: The body's id.
        wrench: Force and moment, world axes, (poses, 6) [N, N m].
        point: Point where the force acts, world axes, (poses, 3) [m].

    Returns:
        (poses, nv) [N, N m].
    """
    force, moment = wrench[:, :3], wrench[:, 3:]
    about_centre = moment + _cross(point - state.centre, force)
    Q = np.matvec(state.motion, np.concatenate([about_centre, force], axis=1))
    return np.asarray(Q * plant.carries[body])


def body_motion(plant: Plant, state: BodyState, body: int, theta: Array) -> tuple[Array, Array]:
    """Compute how a body's origin moves and how the body rotates under small deflections, J theta.

    Args:
        plant: The arm.
        state: Its poses.
        body: The body's id.
        theta: Deflection in MuJoCo's coordinates, (poses, nv) [m, rad].

    Returns:
        Translation [m] and rotation vector [rad], world axes, (poses, 3) each.
    """
    twist = np.vecmat(theta * plant.carries[body], state.motion)
    turn, shift = twist[:, :3], twist[:, 3:]
    return shift + _cross(turn, state.position[body] - state.centre), turn


def _cross(a: Array, b: Array) -> Array:
    """Compute vector products a x b, (poses, 3): np.cross takes five times as long."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
