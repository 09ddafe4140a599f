"""Where trackers stand, and how their targets sit on the tool."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from testbench.bench.absolute_settings import AbsoluteCampaign
from testbench.bench.campaign import Cell
from testbench.errors import Array
from testbench.plant import Plant, unloaded

NEAREST, FARTHEST = 1.5, 3.0  #: How far from the base a tracker stands, over the arm's reach [1].
LOWEST, HIGHEST = 0.8, 2.0  #: Its height over the base [m].
TILT = 0.02  #: How far from upright it stands, about each horizontal axis, standard deviation [rad].

Generators = Sequence[np.random.Generator]


@dataclass(frozen=True)
class Frame:
    """A frame in another: x there = rotation @ x here + position."""

    rotation: Array  #: (3, 3).
    position: Array  #: (3,) [m].


def draw_stations(cell: Cell, asked: AbsoluteCampaign, rngs: Generators) -> tuple[Frame, ...]:
    """The world in the tracker's frame, of every series: facing anywhere, and never quite upright."""
    found = [_station(cell, asked, k, rng) for k, rng in enumerate(rngs)]
    return tuple(found[:1] * len(found) if asked.share_frame else found)


def _station(cell: Cell, asked: AbsoluteCampaign, k: int, rng: np.random.Generator) -> Frame:
    azimuth, heading = rng.uniform(-np.pi, np.pi, 2)
    distance, height = cell.vjm.reach * rng.uniform(NEAREST, FARTHEST), rng.uniform(LOWEST, HIGHEST)
    tilt = Rotation.from_rotvec([*(TILT * rng.standard_normal(2)), 0.0])
    around = np.array([distance * np.cos(azimuth), distance * np.sin(azimuth), height])
    place = cell.vjm.base[:3, 3] + around
    if asked.trackers is not None:
        place = np.array(asked.trackers[k % len(asked.trackers)])
    R = (tilt * Rotation.from_rotvec([0.0, 0.0, heading])).as_matrix()
    return Frame(R, -R @ place)


def draw_mounts(plant: Plant, asked: AbsoluteCampaign, rngs: Generators) -> tuple[Frame, ...]:
    """The mount of the targets in the tool's frame, of every series."""
    found = [_mount(plant, asked, rng) for rng in rngs]
    return tuple(found[:1] * len(found) if asked.share_target else found)


def _mount(plant: Plant, asked: AbsoluteCampaign, rng: np.random.Generator) -> Frame:
    shift, turn = asked.mount.position * rng.standard_normal(3), asked.mount.angle * rng.standard_normal(3)
    quarters = rng.integers(4) if asked.quarter_turns else 0
    R = Rotation.from_rotvec(np.pi / 2 * quarters * last_axis(plant)) * Rotation.from_rotvec(turn)
    return Frame(R.as_matrix(), shift)


def last_axis(plant: Plant) -> Array:
    """Unit axis of the last joint in the tool's frame, (3,)."""
    arm = plant.arm
    (_, link), (_, tool) = unloaded(plant, np.zeros((1, arm.n_joints)), [arm.links[-1].name, arm.tool])
    axis = plant.model.jnt_axis[plant.joints[-1]]  # hinges and slides only: joint and dof are counted alike
    return np.asarray(tool[0].T @ link[0] @ axis)
