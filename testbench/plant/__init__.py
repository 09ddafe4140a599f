"""The truth side: MuJoCo. Shares the arm's description with the model side, and no code.

Arguments are the same everywhere: q are actuated joints, (runs, n) [rad, m]; wrench is force and moment in
world axes, (runs, 6) [N, N m]; point is where it acts, in the tool's frame, (runs, 3) [m]. What has another
shape or is not finite is a `BenchError`.
"""

import logging

import mujoco

from testbench.plant.build import Plant, build_plant, weightless, with_markers
from testbench.plant.compensator import (
    KR500_COMPENSATOR,
    STIFF_COMPENSATOR,
    Compensator,
)
from testbench.plant.disturbance import TYPICAL, Disturbances, GeometryErrors
from testbench.plant.disturbed import DisturbedPlant, disturb, settle_disturbed, settle_pair, true_angles
from testbench.plant.elastic import elastic_mjcf
from testbench.plant.equilibrium import Equilibrium, part_of, settle, unloaded
from testbench.plant.feasible import Room, build_room, check_poses, collisions, has_surroundings
from testbench.plant.gear import GearErrors, Gears, gear_error
from testbench.plant.linear import settle_linear
from testbench.plant.site import Contact, Kind, Payload, Site, build_site, contacts, hidden

log = logging.getLogger(__name__)
log.addHandler(logging.NullHandler())  # a problem is one line on standard error; who listens hears this too
mujoco.set_mju_user_warning(log.warning)  # else to MUJOCO_LOG.TXT where one stands

__all__ = [
    "KR500_COMPENSATOR",
    "STIFF_COMPENSATOR",
    "TYPICAL",
    "Compensator",
    "Contact",
    "Disturbances",
    "DisturbedPlant",
    "Equilibrium",
    "GearErrors",
    "Gears",
    "GeometryErrors",
    "Kind",
    "Payload",
    "Plant",
    "Room",
    "Site",
    "build_plant",
    "build_room",
    "build_site",
    "check_poses",
    "collisions",
    "contacts",
    "disturb",
    "elastic_mjcf",
    "gear_error",
    "has_surroundings",
    "hidden",
    "part_of",
    "settle",
    "settle_disturbed",
    "settle_linear",
    "settle_pair",
    "true_angles",
    "unloaded",
    "weightless",
    "with_markers",
]
