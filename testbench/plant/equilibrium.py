"""Static equilibrium of the elastic arm: Newton on MuJoCo's generalised forces, pose after pose.

With the actuated joints held, theta is at rest where K_theta theta = Q(theta), Q the generalised force of
the arm's own weight and of the external wrench. Newton's matrix is K_theta - K_w (Eq. 7). K_w is small for
an arm that can carry its load, so K_theta alone serves until it does not: theta <- C_theta Q(theta) gains two
digits a step. Where it gains less than a factor four, the tangent is taken by finite differences.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt

from testbench.arm.folder import Arm
from testbench.arm.mjcf import read_mjcf
from testbench.errors import Array, InputError, NoEquilibrium, check_array
from testbench.plant.elastic import elastic_mjcf, theta_names

Index = npt.NDArray[np.int_]

STEP_TOLERANCE = 1e-9  #: A pose is in equilibrium when the last Newton step is below this [m, rad].
MAX_ITERATIONS = 50
MAX_SAG = 0.5  #: A virtual joint beyond this [m, rad] is no longer an elastic deflection.


@dataclass(frozen=True)
class Plant:
    """The true arm: a MuJoCo model with sprung virtual joints.

    All its joints are slides and hinges, so that one address serves qpos and qvel.
    """

    arm: Arm  #: Its description.
    model: mujoco.MjModel  #: Elastic MuJoCo model.
    theta: Index  #: Address of each virtual joint, (n_theta,).
    joints: Index  #: Address of each actuated joint, (n,).
    tool: int  #: Body id of the tool.
    markers: Index  #: Body ids of the markers, (m,).
    load: Array  #: Load point in the tool's frame, as MuJoCo reads it, (3,) [m].
    C: Array  #: True compliance in MuJoCo's coordinates, zero at the actuated joints, (nv, nv).


@dataclass(frozen=True)
class Equilibrium:
    """Poses of the arm at rest under a load."""

    theta: Array  #: Virtual joint coordinates, (runs, n_theta) [m, rad].
    markers: Array  #: Marker positions in the world, (runs, m, 3) [m].
    tool: Array  #: Tool positions in the world, (runs, 3) [m].
    rotation: Array  #: Tool orientations, world from tool, (runs, 3, 3) [1].
    residual: Array  #: Largest generalised force out of balance, (runs,) [N, N m].
    step: Array  #: Last Newton step, (runs,) [m, rad].
    iterations: Array  #: Newton steps taken, (runs,).


@dataclass(frozen=True)
class Statics:
    """Forces and springs of one pose, as functions of the MuJoCo data that they were made for.

    At rest the actuated joints are where they are held, and all others at deflect(force()).
    """

    force: Callable[[], Array]  #: Generalised force Q at data.qpos, springs apart, (nv,) [N, N m].
    #: Deflection under a generalised force, zero at the actuated joints, (nv,) [m, rad].
    deflect: Callable[[Array], Array]
    compliance: Callable[[Array], Array]  #: Its derivative at a generalised force, (nv, nv).
    #: Generalised force of the springs at data.qpos, (nv,) [N, N m]; they are told Q, since a joint with play
    #: or friction has no force of its own.
    springs: Callable[[Array], Array]
    #: First guess of the inverse of C (K_theta - K_w), Eq. (7), (nv, nv); None for the identity.
    start: Array | None = None


PoseStatics = Callable[[Plant, mujoco.MjData, int, Array, Array], Statics]
"""Statics of a pose from plant, data at the held joints and theta = 0, number of the run, wrench, point."""


def compile_mjcf(path: Path, text: str) -> mujoco.MjModel:
    """A MuJoCo model from MJCF text whose meshes lie in the folder of `path`.

    Args:
        path: The rigid MJCF that the text comes from; for messages and meshes.
        text: MJCF.

    Raises:
        InputError: When MuJoCo refuses it.
    """
    root = read_mjcf(path)
    meshdir = path.parent.joinpath(*(c.get("meshdir", "") for c in root.iter("compiler")))
    try:
        meshes = {f: (meshdir / f).read_bytes() for m in root.iter("mesh") if (f := m.get("file"))}
        return mujoco.MjModel.from_xml_string(text, meshes)
    except OSError as err:
        raise InputError(path, f"mesh {err.filename}", f"cannot be read: {err.strerror}") from err
    except ValueError as err:
        raise InputError(path, "", " ".join(f"MuJoCo refuses it: {err}".split())) from err


def build_plant(arm: Arm) -> Plant:
    """The elastic MuJoCo model of an arm.

    Raises:
        InputError: When MuJoCo refuses the arm's MJCF.
    """
    return plant_of(arm, compile_mjcf(arm.rigid, elastic_mjcf(arm)))


def plant_of(arm: Arm, model: mujoco.MjModel) -> Plant:
    """The plant of an arm whose elastic model is compiled already."""
    theta = np.array([model.joint(name).dofadr[0] for name in theta_names(arm)])
    C = np.zeros((model.nv, model.nv))
    C[np.ix_(theta, theta)] = arm.C_theta
    return Plant(
        arm=arm,
        model=model,
        theta=theta,
        joints=np.array([model.joint(j.name).dofadr[0] for j in arm.joints], dtype=int),
        tool=model.body(arm.tool).id,
        markers=np.array([model.body(name).id for name in arm.markers]),
        load=_in_tool(model, arm),
        C=C,
    )


def _in_tool(model: mujoco.MjModel, arm: Arm) -> Array:
    """The load point in the tool's frame, (3,) [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tool, load = data.body(arm.tool), data.body(arm.load)
    return np.asarray(tool.xmat.reshape(3, 3).T @ (load.xpos - tool.xpos))


def settle(plant: Plant, q: Array, wrench: Array | None = None, point: Array | None = None) -> Equilibrium:
    """Static equilibrium of every pose under the arm's own weight and a wrench at the tool.

    The wrench keeps its direction in the world and acts at a point fixed in the tool, as a hung weight
    does; without one the arm's own weight is left, without a point it acts at the tool's origin.

    Raises:
        NoEquilibrium: When the arm is too soft for its load; names the pose.
    """
    return settle_by(linear_statics, plant, q, wrench, point)


def settle_by(
    statics: PoseStatics, plant: Plant, q: Array, wrench: Array | None, point: Array | None
) -> Equilibrium:
    """Static equilibrium of every pose, as `settle`, under the forces and springs of `statics`."""
    q = check_array(q, (None, plant.arm.n_joints), "q [rad]")
    runs = len(q)
    wrench = np.zeros((runs, 6)) if wrench is None else check_array(wrench, (runs, 6), "wrench [N, N m]")
    point = np.zeros((runs, 3)) if point is None else check_array(point, (runs, 3), "point [m]")
    model, data = plant.model, mujoco.MjData(plant.model)
    held, rest, unbalanced = np.zeros(model.nv), np.empty((runs, model.nv)), np.empty((runs, model.nv))
    positions, rotations = np.empty((runs, model.nbody, 3)), np.empty((runs, 9))
    step, iterations = np.empty(runs), np.empty(runs, dtype=int)
    qpos, xpos, rotation = data.qpos, data.xpos, data.xmat[plant.tool]
    free = np.setdiff1d(np.arange(model.nv), plant.joints)
    for i in range(runs):
        held[plant.joints] = q[i]
        qpos[:] = held
        pose = statics(plant, data, i, wrench[i], point[i])
        try:
            step[i], iterations[i] = _newton(pose, qpos, held)
        except NoEquilibrium as err:
            raise NoEquilibrium(
                f"{err} at q = {np.rad2deg(q[i]).round(2).tolist()} deg under wrench "
                f"{wrench[i].round(1).tolist()} N, N m: too soft for its load, or buckled"
            ) from None
        Q = pose.force()
        unbalanced[i] = Q + pose.springs(Q)
        rest[i], positions[i], rotations[i] = qpos, xpos, rotation
    return Equilibrium(
        theta=rest[:, plant.theta],
        markers=positions[:, plant.markers],
        tool=positions[:, plant.tool],
        rotation=rotations.reshape(runs, 3, 3),
        residual=np.abs(unbalanced[:, free]).max(axis=1),
        step=step,
        iterations=iterations,
    )


def _newton(pose: Statics, qpos: Array, held: Array) -> tuple[float, int]:
    """Move the virtual joints in `qpos` from `held` to rest; the last step and the number of steps."""
    force, deflect = pose.force, pose.deflect
    inverse, tangents = pose.start, 0
    last = np.inf
    for k in range(1, MAX_ITERATIONS + 1):
        step = held + deflect(force()) - qpos
        if inverse is not None:
            step = inverse @ step
        size = math.sqrt(step @ step)
        qpos += step
        if size < STEP_TOLERANCE:
            if tangents and _unstable(pose, qpos):
                raise NoEquilibrium(f"only an unstable equilibrium after {k} Newton steps, it buckles")
            return size, k
        if not size < MAX_SAG:
            break
        if size > last / 4:
            C, tangents = pose.compliance(force()), tangents + 1
            inverse = np.asarray(np.linalg.inv(_tangent(C, qpos, force)), dtype=float)
        last = size
    raise NoEquilibrium(f"no static equilibrium in {k} Newton steps, the last one {size:.3g} m or rad")


def linear_statics(plant: Plant, data: mujoco.MjData, _: int, wrench: Array, point: Array) -> Statics:
    """The plant's own weight and linear springs, and a wrench at a point of its tool."""
    C = plant.C
    return Statics(
        force=_generalised_force(plant, data, wrench, point),
        deflect=C.dot,  # half a microsecond a step quicker than C @ Q
        compliance=lambda _: C,
        springs=lambda _: _springs(plant.model, data),
    )


def _generalised_force(plant: Plant, data: mujoco.MjData, wrench: Array, point: Array) -> Callable[[], Array]:
    """Generalised force Q(data.qpos) of own weight and wrench, (nv,) [N, N m].

    Velocities are zero, so of MuJoCo's forward pass only kinematics and the bias force are needed.
    """
    model, tool, bias = plant.model, plant.tool, np.empty(plant.model.nv)
    position, rotation = data.xpos[tool], data.xmat[tool].reshape(3, 3)
    f, moment, loaded = wrench[:3], wrench[3:], bool(wrench.any())

    def force() -> Array:
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_rne(model, data, 0, bias)
        Q = -bias
        if loaded:
            mujoco.mj_applyFT(model, data, f, moment, position + rotation @ point, tool, Q)
        return Q

    return force


def _unstable(pose: Statics, qpos: Array) -> bool:
    """Whether K_theta - K_w has an eigenvalue not above zero: those of C (K_theta - K_w) share the signs.

    Asked only where Newton needed the tangent: theta <- C Q(theta) moves away from an unstable point, unless
    the arm is so symmetric that nothing pushes it.
    """
    C_K = _tangent(pose.compliance(pose.force()), qpos, pose.force)
    return bool(np.linalg.eigvals(C_K).real.min() <= 0)


def _tangent(C: Array, qpos: Array, force: Callable[[], Array]) -> Array:
    """I - C dQ/dqpos = C (K_theta - K_w) of Eq. (7), by central differences, (nv, nv)."""
    h = 1e-6
    at = qpos.copy()
    columns = []
    for unit in np.eye(len(at)):
        qpos[:] = at + h * unit
        ahead = force()
        qpos[:] = at - h * unit
        columns.append((ahead - force()) / (2 * h))
    qpos[:] = at
    return np.eye(len(at)) - C @ np.column_stack(columns)


def _springs(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Generalised force of the model's own springs, as MuJoCo sees them, (nv,) [N, N m]."""
    mujoco.mj_tendon(model, data)
    mujoco.mj_passive(model, data)
    return np.asarray(data.qfrc_passive)
