"""The truth side: MuJoCo. Shares the arm's description with the model side, and no code."""

from testbench.plant.elastic import elastic_mjcf, write_elastic
from testbench.plant.equilibrium import Equilibrium, Plant, build_plant, settle
from testbench.plant.feasible import Room, build_room, check_poses, collisions
from testbench.plant.linear import settle_linear
from testbench.plant.site import Contact, Kind, Payload, Site, build_site, contacts, hidden

__all__ = [
    "Contact",
    "Equilibrium",
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
    "elastic_mjcf",
    "hidden",
    "settle",
    "settle_linear",
    "write_elastic",
]
