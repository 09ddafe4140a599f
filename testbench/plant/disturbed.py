"""The disturbed true arm: a plant with disturbances built in.

Own weight, geometry and foundation change the MuJoCo model. Offsets and payload errors change its inputs.
Compensator and joint laws change the forces and springs of its equilibrium. The nominal plant stays
unchanged. The foundation's six coordinates are part of C, not of theta.
"""

import copy
from dataclasses import replace

import mujoco
import numpy as np

from testbench.errors import Array
from testbench.plant.build import Plant, compile_mjcf, plant_of, weightless, with_model
from testbench.plant.compensator import hinged_bodies
from testbench.plant.disturbance import FOUNDATION, Disturbances, draw_gears
from testbench.plant.elastic import AXES, elastic_mjcf


def disturb(plant: Plant, disturbances: Disturbances, rng: np.random.Generator) -> Plant:
    """Build disturbances into a plant.

    Every disturbance draws its random numbers whether it is on or off: switching one does not change the
    others. Gears have a random stream of their own, because their number of orders varies.

    Args:
        plant: The nominal elastic arm; it stays unchanged. For a soft foundation its model is compiled anew
            from `plant.arm`, and gravity is kept.
        disturbances: Kinds of disturbances, with their sizes.
        rng: Source of offsets and errors.

    Returns:
        The disturbed plant.

    Raises:
        BenchError: If a compensator is requested and the arm has no link 2.
    """
    if disturbances.compensator is not None:
        hinged_bodies(plant)
    n = plant.arm.n_joints
    # All numbers are drawn whatever is switched on, so that one disturbance does not change another.
    offset, frames, centre = rng.standard_normal(n), rng.standard_normal((n + 1, 6)), rng.standard_normal(3)
    true = _on_foundation(plant, disturbances.foundation)
    if not disturbances.own_weight:
        true = weightless(true)
    if (errors := disturbances.geometry) is None:
        frames = np.zeros_like(frames)
    else:
        frames = frames * np.repeat([errors.position, errors.angle], 3)
        true = _displaced(true, frames)
    return replace(
        true,
        disturbances=disturbances,
        offset=disturbances.sensor_offset * offset,
        centre=disturbances.centre_error * centre,
        frames=frames,
        gears=None if disturbances.gear is None else draw_gears(disturbances.gear, n, rng.spawn(1)[0]),
    )


def exactly_loaded(plant: Plant) -> Plant:
    """Copy a plant without errors of the recorded load: its mass and its centre are exact.

    Args:
        plant: The plant.

    Returns:
        The copy.
    """
    exact = replace(plant.disturbances, mass_error=0.0, centre_error=0.0)
    return replace(plant, disturbances=exact, centre=np.zeros(3))


def _on_foundation(plant: Plant, scale: float) -> Plant:
    """Put the plant on a foundation of `scale` times the usual compliance, 0 for a rigid one."""
    arm = plant.arm
    if not scale:
        return plant
    compliance = scale * np.array(FOUNDATION)
    model = compile_mjcf(arm.rigid, elastic_mjcf(arm, compliance))
    model.opt.gravity[:] = plant.model.opt.gravity
    true = replace(plant_of(arm, model), beyond=plant.beyond)
    soft = [model.joint(f"foundation_{axis}").dofadr[0] for axis in AXES]
    true.C[soft, soft] = compliance
    return true


def _displaced(plant: Plant, frames: Array) -> Plant:
    """Move and rotate the frames of all joints and of the tool, (n + 1, 6) [m, rad].

    The body that carries the virtual joint before a frame defines its place; the frame's own body its
    orientation.
    """
    arm, model = plant.arm, copy.copy(plant.model)
    for name, error in zip([*(link.name for link in arm.links[1:]), arm.tool], frames, strict=True):
        body = model.body(name).id
        model.body_pos[model.body_parentid[body]] += error[:3]
        mujoco.mju_quatIntegrate(model.body_quat[body], error[3:], 1.0)
    return with_model(plant, model)
