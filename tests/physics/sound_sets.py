"""Sound data sets: arms that are as arms are, readings as an engineer would hand them in.

Drawn are the arm, the true arm of the family, what disturbs it, how wrong the folder is, how many poses,
which loads, how good the tracker is and where it stands, how far targets are from where the folder has them.
"""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset
from testbench.identify.prior import Prior, cad_prior, perturb_prior
from testbench.model.vjm import WorkArea
from testbench.plant.disturbance import TYPICAL_DISTURBANCES, Disturbances
from testbench.plant.equilibrium import solve_unloaded_and_loaded
from testbench.plant.true_arms import FAMILY_TRUE_ARMS, disturb
from testbench.runs.rows import trial_rng
from testbench.workflows.campaign import LoadedPoses, true_cell
from testbench.workflows.cell import Cell, clear_poses

PAYLOAD = {"kr500_l480": 460.3, "arm_6r": 20.0}
"""Largest mass that hangs from each arm [kg]."""
AREA = {
    "kr500_l480": WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0)),
    "arm_6r": WorkArea((-2.5, -2.5, 0.3), (2.5, 2.5, 2.5)),
}
"""Where the tool of each arm may be."""
LEVELS = (0.35, 0.65, 1.0)  #: Shares of the payload that hang one after the other.
LOADS = ("hung", "levels", "pressed")
"""One hung mass; three, one after the other in every pose; forces in all directions, one a run."""
SCALE, SHAPE = 0.35, 0.3
"""Standard deviations of the logarithms of the folder's common factor and of each compliance's own [1]."""
TRACKER, DECLARED, ROUGH = 1 / 3, 0.5, 15e-3
"""Share of the sets in a tracker's frames, and of these that say so; how far their targets are from where the
folder has them [m]."""
QUIET = Disturbances(own_weight=True)


@dataclass(frozen=True)
class Sound:
    """A data set without a mistake."""

    cell: Cell  #: The arm, as its folder has it.
    data: Dataset
    prior: Prior  #: What the folder believes of its compliances.
    loads: str  #: One of LOADS.
    tracker: bool  #: Whether it is in the frames of a tracker's set-ups.
    declared: bool  #: Whether that is said; it is found out otherwise.
    disturbed: bool  #: Whether the true arm does what models do not know.
    mounted: Callable[[np.ndarray], "Sound"]  #: The same arm, mounted otherwise than its folder says.


def sound(cells: Mapping[str, Cell], seed: int, mount: np.ndarray | None = None) -> Sound:
    """The data set of a seed; of an arm whose folder is upright, and which a mount turns, (3, 3).

    Hung masses are stated as of an upright arm. Readings are in the arm's base, or a level tracker's frames.
    """
    mount = np.eye(3) if mount is None else mount
    rng = trial_rng(seed, 30)
    name = str(rng.choice(list(PAYLOAD), p=[0.75, 0.25]))
    cell = cells[name]
    loads = LOADS[seed % len(LOADS)]
    truth = list(FAMILY_TRUE_ARMS)[seed // len(LOADS) % len(FAMILY_TRUE_ARMS)]
    disturbed = bool(rng.random() < 0.5)
    typical = (
        TYPICAL_DISTURBANCES if name == "kr500_l480" else replace(TYPICAL_DISTURBANCES, compensator=None)
    )
    true = true_cell(cell, truth, seed).plant
    true = disturb(true, typical if disturbed else QUIET, trial_rng(seed, 20))
    off = rng.uniform(0, 5e-3) * rng.standard_normal((len(cell.arm.markers), 3))
    model = copy.copy(true.model)
    model.body_pos[true.marker_bodies] += off
    model.opt.gravity[:] = mount.T @ model.opt.gravity
    true = replace(true, model=model)
    poses = clear_poses(cell, AREA[name], int(rng.integers(10, 25)), rng)
    asked = _loaded(cell, poses, loads, rng)
    wrench = (asked.wrench.reshape(-1, 2, 3) @ mount).reshape(-1, 6)  # in the base's axes
    before, after = solve_unloaded_and_loaded(true, asked.q, wrench, asked.point)
    sigma = float(rng.choice([20e-6, 50e-6, 100e-6]))
    first = np.unique(asked.pose_id, return_index=True)[1][
        asked.pose_id - 1
    ]  # one unloaded reading of a pose
    data = Dataset(
        markers=cell.arm.markers,
        run_id=np.arange(len(asked.q)) + 1,
        pose_id=asked.pose_id,
        q=asked.q,
        wrench=asked.wrench,
        point=asked.point,
        before=(before.marker_positions + sigma * rng.standard_normal(before.marker_positions.shape))[first],
        after=after.marker_positions + sigma * rng.standard_normal(after.marker_positions.shape),
        sigma=sigma,
    )
    scale = float(np.exp(SCALE * rng.standard_normal()))
    prior = perturb_prior(cad_prior(cell.arm), scale=scale, shape=SHAPE, rng=rng)
    tracker = bool(rng.random() < TRACKER)
    if tracker:
        cell, data = _in_tracker(cell, data, rng, mount)
    declared = tracker and bool(rng.random() < DECLARED)
    return Sound(cell, data, prior, loads, tracker, declared, disturbed, partial(sound, cells, seed))


def _in_tracker(
    cell: Cell, data: Dataset, rng: np.random.Generator, mount: np.ndarray
) -> tuple[Cell, Dataset]:
    """The readings from one or two set-ups, and an arm's folder that has its targets roughly."""
    stations = int(rng.integers(1, 3))
    station = 1 + data.pose_id * stations // (data.pose_id.max() + 1)
    before, after = data.before.copy(), data.after.copy()
    for k in range(1, stations + 1):
        turn = np.array([0, 0, rng.uniform(-np.pi, np.pi)]) + np.deg2rad(0.5) * rng.standard_normal(3)
        R, t, own = Rotation.from_rotvec(turn).as_matrix() @ mount, rng.uniform(-5, 5, 3), station == k
        before[own], after[own] = (x[own] @ R.T + t for x in (before, after))
    rough = cell.vjm.markers + ROUGH * rng.standard_normal(cell.vjm.markers.shape)
    cell = replace(cell, vjm=replace(cell.vjm, markers=rough))
    return cell, replace(data, before=before, after=after, station=station)


def _loaded(cell: Cell, q: np.ndarray, loads: str, rng: np.random.Generator) -> LoadedPoses:
    """What acts in which pose: of three loads there is one run each."""
    each, payload = len(LEVELS) if loads == "levels" else 1, PAYLOAD[cell.arm.name]
    pose = np.repeat(np.arange(len(q)) + 1, each)
    wrench = np.zeros((len(pose), 6))
    if loads == "pressed":
        direction = rng.standard_normal((len(pose), 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        wrench[:, :3] = GRAVITY * payload * rng.uniform(0.3, 0.7, (len(pose), 1)) * direction
    else:
        wrench[:, 2] = -GRAVITY * payload * np.tile(LEVELS if each > 1 else [1.0], len(q))
    return LoadedPoses(np.repeat(q, each, axis=0), pose, wrench, np.tile(cell.vjm.load_point, (len(pose), 1)))
