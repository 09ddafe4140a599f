"""The truth side: MuJoCo. Shares the arm's description with the model side, and no code."""

from testbench.plant.elastic import elastic_mjcf, write_elastic
from testbench.plant.equilibrium import Equilibrium, Plant, build_plant, settle
from testbench.plant.feasible import Room, build_room, check_poses, collisions
from testbench.plant.linear import settle_linear

__all__ = [
    "Equilibrium",
    "Plant",
    "Room",
    "build_plant",
    "build_room",
    "check_poses",
    "collisions",
    "elastic_mjcf",
    "settle",
    "settle_linear",
    "write_elastic",
]
