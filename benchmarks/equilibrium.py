"""Static equilibrium: Newton against a bare forward pass, and against stepping the arm to rest."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from measure import Row, at_least, at_most, cell, feasible_poses, hung, interleave, note, seconds, spread

from testbench.bench import Cell
from testbench.errors import Array
from testbench.plant import Equilibrium, Plant, settle
from testbench.plant.elastic import DAMPING
from testbench.plant.equilibrium import STEP_TOLERANCE

POSES = 1000
FORWARD_PASSES = 4000
STEPPED_POSES = 6
NEWTON_REPEATS = 40
"""Times the stepped poses are settled in one call: a call's own cost is none of a pose's."""
CHECK_EVERY = 20
"""Steps between two looks at the residual."""
MAX_STEPS = 10_000
SETTINGS = (
    (DAMPING, 0.0005),
    (DAMPING, 0.002),
    (DAMPING, 0.005),
    (DAMPING, 0.02),
    (DAMPING / 4, 0.001),
    (DAMPING / 2, 0.001),
    (DAMPING * 2.5, 0.001),
)
"""Other dampings over stiffness [s] and time steps [s] than the model's own: is the comparison fair?"""


def newton_against_forward_passes() -> list[Row]:
    """Cost of a loaded and an unloaded equilibrium in forward passes of the same model."""
    arm = cell("kr500_l480")
    q = feasible_poses(arm, POSES, seed=1)
    wrench, point = hung(arm, POSES)
    model, data = arm.plant.model, mujoco.MjData(arm.plant.model)
    found = settle(arm.plant, q), settle(arm.plant, q, wrench, point)
    data.qpos[arm.plant.joints], data.qpos[arm.plant.theta] = q[0], found[1].theta[0]
    position, velocity = mujoco.mj_fwdPosition, mujoco.mj_fwdVelocity

    def pairs() -> None:
        settle(arm.plant, q)
        settle(arm.plant, q, wrench, point)

    def passes() -> None:
        for _ in range(FORWARD_PASSES):
            position(model, data)
            velocity(model, data)

    times = interleave(9, pairs, passes)
    pair, forward = times[0] / POSES, times[1] / FORWARD_PASSES
    worst = max(float(e.step.max()) for e in found)
    steps = [float(e.iterations.mean()) for e in found]
    return [
        at_most(
            f"(a) unloaded + loaded equilibrium, {POSES} poses, over a forward pass",
            float(np.median(pair / forward)),
            "x",
            12,
            f"pair {spread(pair, 1e6)} us, pass {spread(forward, 1e6)} us, ratio {spread(pair / forward)}; "
            f"{steps[0]:.1f} + {steps[1]:.1f} Newton steps",
        ),
        at_most("(a) largest last Newton step", worst, "m, rad", STEP_TOLERANCE, "of all poses"),
    ]


@dataclass(frozen=True)
class Stepping:
    """The elastic arm as plain MuJoCo steps it.

    Attributes:
        plant: The arm whose poses are stepped.
        model: Its model, with the centre of its massless load body on the load point.
        load: That body.
    """

    plant: Plant
    model: mujoco.MjModel
    load: int


def build_stepping(plant: Plant, damping: float, timestep: float) -> Stepping:
    """The plant's model with this damping over stiffness [s] and time step [s].

    MuJoCo applies an external force at the centre of a body's mass; the load body has none, so that its
    centre may be put on its origin.
    """
    model = copy.copy(plant.model)
    load = model.body(plant.arm.load).id
    if model.body_mass[load] > 0:
        raise SystemExit(f"{plant.arm.name}: expected a load body without mass")
    model.body_ipos[load] = 0
    model.dof_damping *= damping / DAMPING
    model.tendon_damping *= damping / DAMPING
    model.opt.timestep = timestep
    return Stepping(plant, model, load)


@dataclass(frozen=True)
class Rest:
    """An arm stepped to rest, unloaded and then loaded.

    Attributes:
        seconds: Wall time.
        steps: Steps taken, unloaded and loaded.
        error: Largest distance from Newton's equilibria [m, rad].
    """

    seconds: float
    steps: tuple[int, int]
    error: float

    @property
    def reached(self) -> bool:
        """Whether both came to rest."""
        return max(self.steps) < MAX_STEPS


def step_to_rest(
    stepping: Stepping, q: Array, force: Array, unloaded: Equilibrium, loaded: Equilibrium, pose: int
) -> Rest:
    """Step an arm from theta = 0 to rest, load it, and step it to rest again.

    Rest is when no generalised force of springs, weight and load is out of balance by more than at
    Newton's equilibrium.
    """
    model, theta = stepping.model, stepping.plant.theta
    data = mujoco.MjData(model)
    data.qpos[stepping.plant.joints] = q
    step, smooth, damper = mujoco.mj_step, data.qfrc_smooth, data.qfrc_damper

    def until(residual: float) -> int:
        for steps in range(CHECK_EVERY, MAX_STEPS + 1, CHECK_EVERY):
            step(model, data, CHECK_EVERY)
            if abs((smooth - damper)[theta]).max() <= residual:
                return steps
        return MAX_STEPS

    steps, error = [], 0.0

    def run() -> None:
        nonlocal error
        for rest, load in ((unloaded, np.zeros(3)), (loaded, force)):
            data.xfrc_applied[stepping.load, :3] = load
            steps.append(until(rest.residual[pose]))
            error = max(error, float(abs(data.qpos[theta] - rest.theta[pose]).max()))

    return Rest(seconds(run), (steps[0], steps[1]), error)


def newton_against_stepping() -> list[Row]:
    """Cost of stepping the arm to rest in Newton solves."""
    arm = cell("kr500_l480")
    q = feasible_poses(arm, STEPPED_POSES, seed=2)
    wrench, point = hung(arm, STEPPED_POSES)
    unloaded, loaded = settle(arm.plant, q), settle(arm.plant, q, wrench, point)
    stepping = build_stepping(arm.plant, DAMPING, arm.plant.model.opt.timestep)
    ratios, newton, stepped = [], [], []
    for _ in range(3):
        for pose in range(STEPPED_POSES):
            newton.append(newton_seconds(arm, q[pose]))
            stepped.append(step_to_rest(stepping, q[pose], wrench[pose, :3], unloaded, loaded, pose))
            ratios.append(stepped[-1].seconds / newton[-1])
    times = np.array([rest.seconds for rest in stepped])
    steps = [sum(rest.steps) for rest in stepped]
    each = times / steps
    residual = np.concatenate([unloaded.residual, loaded.residual])
    model = stepping.model
    rows = [
        at_least(
            f"(b) stepping to rest over Newton, {STEPPED_POSES} poses, the least of them",
            min(ratios) if all(rest.reached for rest in stepped) else float("inf"),
            "x",
            300,
            f"ratio {spread(ratios, digits=0)}; stepping {spread(times, 1e3, 0)} ms in {spread(steps, digits=0)} "
            f"steps of {spread(each, 1e6, 0)} us, Newton {spread(newton, 1e6, 0)} us; damping {DAMPING * 1e3:.0f} "
            f"ms x stiffness, step {model.opt.timestep * 1e3:.1f} ms; residual {residual.min():.0e} to "
            f"{residual.max():.0e} N",
        ),
        at_most(
            "(b) largest distance of the two equilibria",
            max(rest.error for rest in stepped),
            "m, rad",
            1e-9,
            "they are the same",
        ),
    ]
    pair = float(np.median(newton))
    return rows + [
        other_setting(arm, damping, timestep, q, wrench, unloaded, loaded, pair)
        for damping, timestep in SETTINGS
    ]


def newton_seconds(arm: Cell, q: Array) -> float:
    """Wall time of an unloaded and a loaded equilibrium of one pose [s]."""
    poses = np.tile(q, (NEWTON_REPEATS, 1))
    wrench, point = hung(arm, NEWTON_REPEATS)
    pair = seconds(lambda: (settle(arm.plant, poses), settle(arm.plant, poses, wrench, point)))
    return pair / NEWTON_REPEATS


def other_setting(
    arm: Cell,
    damping: float,
    timestep: float,
    q: Array,
    wrench: Array,
    unloaded: Equilibrium,
    loaded: Equilibrium,
    newton: float,
) -> Row:
    """The same with another damping and time step, on the first two poses: for judging, without a bar."""
    stepping = build_stepping(arm.plant, damping, timestep)
    rests = [step_to_rest(stepping, q[k], wrench[k, :3], unloaded, loaded, k) for k in range(2)]
    ratios = [rest.seconds / newton for rest in rests]
    stuck = "" if all(rest.reached for rest in rests) else f"; not at rest after {MAX_STEPS} steps"
    return note(
        f"    damping {damping * 1e3:.0f} ms x stiffness, time step {timestep * 1e3:g} ms",
        float(np.median(ratios)),
        "x",
        f"{[sum(rest.steps) for rest in rests]} steps{stuck}",
    )
