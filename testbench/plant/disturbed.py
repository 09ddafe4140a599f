"""The disturbed true arm: a plant with disturbances built in, and its equilibria.

Weight, geometry and foundation change the MuJoCo model; offsets and payload errors what it is given;
compensator and joint laws the forces and springs of its equilibrium. The nominal plant stays as it is.
"""

import copy
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import mujoco
import numpy as np

from testbench.arm.folder import Arm
from testbench.arm.mjcf import find_body
from testbench.errors import Array, check_array
from testbench.plant.build import Plant, compile_mjcf, plant_of, weightless, with_model
from testbench.plant.compensator import attached
from testbench.plant.disturbance import FOUNDATION, Disturbances
from testbench.plant.elastic import AXES, elastic_mjcf, insert_carrier
from testbench.plant.equilibrium import Equilibrium, settle
from testbench.plant.gear import Gears, draw_gears, gear_error
from testbench.plant.joint_law import JointLaw


@dataclass(frozen=True)
class DisturbedPlant:
    """The true arm with its disturbances."""

    #: The arm with true weight, geometry and foundation. `arm` and `load` are as recorded, and so is the
    #: order of theta: the foundation's six coordinates come into C and the residual, not into theta.
    plant: Plant
    disturbances: Disturbances  #: What is disturbed.
    offset: Array  #: True minus commanded joint angles, the same in all poses, (n,) [rad].
    centre: Array  #: True minus recorded hanging point, tool's axes, (3,) [m].
    #: True minus drawn frames of the joints and the tool, (n + 1, 6) [m, rad]: shift along the axes of the
    #: link before, turn about the frame's own.
    frames: Array
    gears: Gears | None  #: Joint errors that depend on the pose; None for none.


def disturb(plant: Plant, disturbances: Disturbances, rng: np.random.Generator) -> DisturbedPlant:
    """The plant with disturbances built in.

    Every disturbance takes its random numbers, on or off: switching one leaves the others as they are. Gears
    have a stream of their own, as their number of orders varies.

    Args:
        plant: The nominal elastic arm; is not changed. With a soft foundation its model is compiled anew from
            `plant.arm`, gravity apart.
        disturbances: What to disturb, and how much.
        rng: Source of offsets and errors.

    Raises:
        BenchError: When a compensator is asked for and the arm has no link 2.
    """
    if disturbances.compensator is not None:
        attached(plant)
    n = plant.arm.n_joints
    offset, frames, centre = rng.standard_normal(n), rng.standard_normal((n + 1, 6)), rng.standard_normal(3)
    true = _on_foundation(plant, disturbances.foundation)
    if not disturbances.own_weight:
        true = weightless(true)
    if (errors := disturbances.geometry) is None:
        frames = np.zeros_like(frames)
    else:
        frames = frames * np.repeat([errors.position, errors.angle], 3)
        true = _displaced(true, frames)
    return DisturbedPlant(
        plant=true,
        disturbances=disturbances,
        offset=disturbances.sensor_offset * offset,
        centre=disturbances.centre_error * centre,
        frames=frames,
        gears=None if disturbances.gear is None else draw_gears(disturbances.gear, n, rng.spawn(1)[0]),
    )


def _on_foundation(plant: Plant, scale: float) -> Plant:
    """The plant on a foundation of `scale` times the usual compliance, 0 for a rigid one."""
    arm = plant.arm
    if not scale:
        return plant
    model = compile_mjcf(arm.rigid, _foundation_mjcf(arm, scale * np.array(FOUNDATION)))
    model.opt.gravity[:] = plant.model.opt.gravity
    true = plant_of(arm, model)
    soft = [model.joint(f"foundation_{axis}").dofadr[0] for axis in AXES]
    true.C[soft, soft] = scale * np.array(FOUNDATION)
    return true


def _foundation_mjcf(arm: Arm, compliance: Array) -> str:
    """The elastic MJCF with a sprung body of six degrees of freedom below the base."""
    root = ET.fromstring(elastic_mjcf(arm))
    base = find_body(arm.rigid, root, arm.links[0].name)
    parent = next(element for element in root.iter() if base in list(element))
    carrier = insert_carrier(parent, base, "foundation", np.eye(3), "foundation")
    for joint, soft in zip(carrier.iter("joint"), compliance, strict=False):
        joint.set("stiffness", repr(float(1 / soft)))
    return ET.tostring(root, encoding="unicode")


def _displaced(plant: Plant, frames: Array) -> Plant:
    """Frames of all joints and of the tool moved and turned, (n + 1, 6) [m, rad].

    Where a frame is, is said by the body that carries the virtual joint before it; how it is turned, by the
    frame's own body.
    """
    arm, model = plant.arm, copy.copy(plant.model)
    for name, error in zip([*(link.name for link in arm.links[1:]), arm.tool], frames, strict=True):
        body = model.body(name).id
        model.body_pos[model.body_parentid[body]] += error[:3]
        mujoco.mju_quatIntegrate(model.body_quat[body], error[3:], 1.0)
    return with_model(plant, model)


def settle_disturbed(
    disturbed: DisturbedPlant,
    q: Array,
    wrench: Array | None = None,
    point: Array | None = None,
    *,
    before: Equilibrium | None = None,
) -> Equilibrium:
    """Static equilibrium of every pose of the disturbed arm.

    Args:
        disturbed: The arm.
        q: Commanded joint angles, (runs, n) [rad, m].
        wrench: Recorded force and moment, world axes, (runs, 6) [N, N m]; None for none.
        point: Where it is recorded to act, in the tool's frame, (runs, 3) [m]; None for the tool's origin.
        before: What the arm rested at before this load, for the friction in its joints; None for joints that
            have just moved to the pose and hold back nothing.

    Returns:
        The poses at rest; theta is measured from the true joint angles.

    Raises:
        NoEquilibrium: When the arm is too soft for its load; names the pose.
    """
    plant, changes = disturbed.plant, disturbed.disturbances
    q = check_array(q, (None, plant.arm.n_joints), "q [rad, m]")
    if wrench is not None:
        wrench = check_array(wrench, (len(q), 6), "wrench [N, N m]") * (1 + changes.mass_error)
        point = np.zeros((len(q), 3)) if point is None else check_array(point, (len(q), 3), "point [m]")
        point = point + disturbed.centre
    if before is not None:
        check_array(before.theta, (len(q), plant.arm.n_theta), "theta before [m, rad]")
    true_q = q + disturbed.offset
    if disturbed.gears is not None:
        true_q = true_q + gear_error(disturbed.gears, q)
    law = None
    if changes.stiffening or changes.backlash or changes.hysteresis:
        law = JointLaw(
            compliance=np.array([joint.compliance for joint in plant.arm.joints]),
            stiffening=changes.stiffening,
            backlash=changes.backlash,
            hysteresis=changes.hysteresis,
            before=None if before is None else before.theta[:, 6 * len(plant.arm.links) :],
        )
    return settle(plant, true_q, wrench, point, law=law, compensator=changes.compensator)


def settle_pair(
    disturbed: DisturbedPlant, q: Array, wrench: Array, point: Array
) -> tuple[Equilibrium, Equilibrium]:
    """The disturbed arm unloaded, then loaded from there."""
    unloaded = settle_disturbed(disturbed, q)
    return unloaded, settle_disturbed(disturbed, q, wrench, point, before=unloaded)
