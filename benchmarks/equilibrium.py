"""Static equilibrium: Newton against a bare forward pass, and against stepping the arm to rest."""

import copy
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt
from measure import MODELS, Row, at_least, at_most, feasible_poses, hung, interleave, note, seconds, spread
from mujoco.batch import Batch

from testbench.errors import Array
from testbench.plant.build import SPRING_DAMPING_TIME
from testbench.plant.equilibrium import (
    STEP_TOLERANCE,
    ArmEquilibrium,
    create_arm_copies,
    evaluate_bodies,
    solve_equilibrium,
    undeflected_configurations,
)
from testbench.workflows.cell import Cell, build_cell

POSES = 1000
FORWARD_PASSES = 4000
STEPPED_POSES = 8
STEPPED_REPEATS = 3
SETTLED_AT_ONCE = 400
"""Times a pose is settled in one call: the call's own cost is none of a pose's."""
CHECK_EVERY = 20
"""Steps between two looks at the residual."""
MAX_STEPS = 10_000
STALL = 1e-6
"""Residual [N, N m] that stepping reaches in every pose; below it the rounding of stiff springs keeps it."""
SETTINGS = (
    (SPRING_DAMPING_TIME, 0.0005),
    (SPRING_DAMPING_TIME, 0.002),
    (SPRING_DAMPING_TIME, 0.005),
    (SPRING_DAMPING_TIME, 0.02),
    (SPRING_DAMPING_TIME / 4, 0.001),
    (SPRING_DAMPING_TIME / 2, 0.001),
    (SPRING_DAMPING_TIME * 2, 0.001),
    (SPRING_DAMPING_TIME * 5, 0.001),
)
"""Other dampings over stiffness [s] and time steps [s] than the model's own: was the comparison fair?"""


def newton_against_forward_passes() -> list[Row]:
    """Cost of an unloaded and a loaded equilibrium in forward passes of the same model."""
    arm = build_cell(MODELS / "kr500_l480")
    q = feasible_poses(arm, POSES, seed=1)
    wrench, point = hung(arm.vjm, POSES)
    model, data = arm.plant.model, mujoco.MjData(arm.plant.model)
    data.qpos[arm.plant.joint_indices] = q[0]
    data.qpos[arm.plant.theta_indices] = solve_equilibrium(arm.plant, q[:1], wrench[:1], point[:1]).theta[0]
    position, velocity = mujoco.mj_fwdPosition, mujoco.mj_fwdVelocity

    def pairs() -> None:
        solve_equilibrium(arm.plant, q)
        solve_equilibrium(arm.plant, q, wrench, point)

    def passes() -> None:
        for _ in range(FORWARD_PASSES):
            position(model, data)
            velocity(model, data)

    times = interleave(9, pairs, passes)
    pair, forward = times[0] / POSES, times[1] / FORWARD_PASSES
    return [
        at_most(
            f"(a) time of an unloaded and a loaded equilibrium over a forward pass, {POSES} poses",
            np.median(pair / forward),
            "x",
            3.5,
            f"ratio {spread(pair / forward)}: pair {spread(pair, 1e6)} us, pass {spread(forward, 1e6)} us",
        ),
        *two_threads(arm, q),
    ]


def two_threads(arm: Cell, q: Array) -> list[Row]:
    """What a second thread is worth, for judging: Python's lock, or MuJoCo's own loop over poses.

    That loop cannot stop before it has made and factored the mass matrix, which statics does not need.
    """
    wrench, point = hung(arm.vjm, len(q))
    halves = np.array_split(np.arange(len(q)), 2)

    def pairs(some: npt.NDArray[np.int_]) -> None:
        solve_equilibrium(arm.plant, q[some])
        solve_equilibrium(arm.plant, q[some], wrench[some], point[some])

    batch, row = Batch(arm.plant.model, len(q), nthread=2), create_arm_copies(arm.plant)
    batch.bind("qfrc_bias")
    batch.bind("qpos")[:] = held = undeflected_configurations(arm.plant, q)
    with ThreadPoolExecutor(2) as pool:
        one, two, theirs, ours = interleave(
            9,
            lambda: list(map(pairs, halves)),
            lambda: list(pool.map(pairs, halves)),
            lambda: batch.forward(stage=int(mujoco.mjtStage.mjSTAGE_VEL)),
            lambda: evaluate_bodies(row, held),
        )
    shared, apart = one / two, theirs / ours
    return [
        note("    two threads over one, each half of the poses", np.median(shared), "x", spread(shared)),
        note(
            "    MuJoCo's loop on two threads over ours on one, forces of a pose",
            np.median(apart),
            "x",
            f"ratio {spread(apart)}: {spread(theirs / len(q), 1e6)} and {spread(ours / len(q), 1e6)} us",
        ),
    ]


@dataclass(frozen=True)
class Measured:
    """Poses at rest by Newton, for stepping to reach.

    Attributes:
        arm: The arm.
        q: Actuated joint angles, (poses, n) [rad].
        force: Load, (poses, 3) [N].
        rests: At rest without and with the load.
    """

    arm: Cell
    q: Array
    force: Array
    rests: tuple[ArmEquilibrium, ArmEquilibrium]


@dataclass(frozen=True)
class Stepped:
    """An arm stepped to rest, unloaded and then loaded.

    Attributes:
        seconds: Wall time.
        steps: Steps taken, both together.
        reached: Whether both came to rest.
        error: Largest distance of a virtual joint from Newton's equilibria [m, rad].
    """

    seconds: float
    steps: int
    reached: bool
    error: float


def stepping_model(arm: Cell, damping: float, timestep: float) -> mujoco.MjModel:
    """The plant's model with this damping over stiffness [s] and time step [s].

    MuJoCo applies an external force at the centre of a body's mass; the load body has none, so that its
    centre may be put on its origin, the load point.
    """
    model = copy.copy(arm.plant.model)
    load = model.body(arm.arm.load_point).id
    if model.body_mass[load] > 0:
        raise SystemExit(f"{arm.arm.name}: expected a load body without mass")
    model.body_ipos[load] = 0
    model.dof_damping *= damping / SPRING_DAMPING_TIME
    model.tendon_damping *= damping / SPRING_DAMPING_TIME
    model.opt.timestep = timestep
    return model


def step_to_rest(model: mujoco.MjModel, measured: Measured, pose: int) -> Stepped:
    """Step an arm from theta = 0 to rest, load it, and step it to rest again.

    At rest no generalised force of springs, weight and load is out of balance by more than at Newton's
    equilibrium, or by more than stepping can reach. The actuated joints are held by their armature.
    """
    plant, data = measured.arm.plant, mujoco.MjData(model)
    data.qpos[plant.joint_indices] = measured.q[pose]
    load = data.xfrc_applied[model.body(measured.arm.arm.load_point).id]
    step = mujoco.mj_step
    smooth = data.qfrc_smooth
    damper = data.qfrc_damper
    theta = plant.theta_indices

    def left() -> float:
        return float(abs((smooth - damper)[theta]).max())

    def until(residual: float) -> int:
        for steps in range(CHECK_EVERY, MAX_STEPS, CHECK_EVERY):
            step(model, data, CHECK_EVERY)
            if left() <= residual:
                return steps
        return MAX_STEPS

    def residual_of(rest: Array) -> float:
        state = data.qpos.copy(), data.qvel.copy()
        data.qpos[theta], data.qvel[:] = rest, 0
        mujoco.mj_forward(model, data)
        found = left()
        data.qpos[:], data.qvel[:] = state
        return max(STALL, found)

    wall = 0.0
    steps = []
    error = 0.0
    for rest, force in zip(measured.rests, (np.zeros(3), measured.force[pose]), strict=True):
        load[:3] = force
        residual = residual_of(rest.theta[pose])
        wall += seconds(lambda residual=residual: steps.append(until(residual)))  # type: ignore[misc]
        error = max(error, float(abs(data.qpos[theta] - rest.theta[pose]).max()))
    return Stepped(wall, sum(steps), max(steps) < MAX_STEPS, error)


def newton_against_stepping() -> list[Row]:
    """Cost of stepping the arm to rest in Newton solves."""
    arm = build_cell(MODELS / "kr500_l480")
    q = feasible_poses(arm, STEPPED_POSES, seed=2)
    wrench, point = hung(arm.vjm, STEPPED_POSES)
    rests = solve_equilibrium(arm.plant, q), solve_equilibrium(arm.plant, q, wrench, point)
    measured = Measured(arm, q, wrench[:, :3], rests)
    timestep = arm.plant.model.opt.timestep
    model = stepping_model(arm, SPRING_DAMPING_TIME, timestep)
    newton, stepped = [], []
    for _ in range(STEPPED_REPEATS):
        for pose in range(STEPPED_POSES):
            newton.append(newton_seconds(measured, pose))
            stepped.append(step_to_rest(model, measured, pose))
    wall, steps = np.array([s.seconds for s in stepped]), np.array([s.steps for s in stepped])
    reached = all(s.reached for s in stepped)
    ratio = (wall / np.array(newton)).reshape(STEPPED_REPEATS, STEPPED_POSES)
    a_pose = np.median(ratio, axis=0)
    return [
        at_least(
            f"(b) time of stepping to rest over Newton's method, median of {STEPPED_POSES} poses",
            np.median(a_pose) if reached else 0.0,
            "x",
            800,
            f"poses {spread(a_pose, digits=0)}: {spread(wall, 1e3, 0)} ms in {spread(steps, digits=0)} steps "
            f"of {spread(wall / steps, 1e6, 0)} us, Newton {spread(newton, 1e6, 0)} us; damping "
            f"{1e3 * SPRING_DAMPING_TIME:g} ms x stiffness, time step {1e3 * timestep:g} ms",
        ),
        at_most(
            "(b) distance of the two equilibria, largest virtual joint",
            max(s.error for s in stepped),
            "m, rad",
            STEP_TOLERANCE,
            "they are the same",
        ),
        *[other_setting(measured, *setting, newton=float(np.median(newton))) for setting in SETTINGS],
    ]


def newton_seconds(measured: Measured, pose: int) -> float:
    """Wall time of an unloaded and a loaded equilibrium of one pose [s]."""
    plant, q = measured.arm.plant, np.tile(measured.q[pose], (SETTLED_AT_ONCE, 1))
    wrench, point = hung(measured.arm.vjm, SETTLED_AT_ONCE)
    pairs = seconds(lambda: (solve_equilibrium(plant, q), solve_equilibrium(plant, q, wrench, point)))
    return pairs / SETTLED_AT_ONCE


def other_setting(measured: Measured, damping: float, timestep: float, *, newton: float) -> Row:
    """The same with another damping and time step on three poses, for judging: without a bar."""
    model = stepping_model(measured.arm, damping, timestep)
    stepped = [step_to_rest(model, measured, pose) for pose in range(3)]
    ratio = [s.seconds / newton for s in stepped]
    stuck = "" if all(s.reached for s in stepped) else f"; a pose not at rest after {MAX_STEPS} steps"
    return note(
        f"    with damping {1e3 * damping:g} ms x stiffness, time step {1e3 * timestep:g} ms",
        np.median(ratio),
        "x",
        f"poses {spread(ratio, digits=0)} in {spread([s.steps for s in stepped], digits=0)} steps{stuck}",
    )
