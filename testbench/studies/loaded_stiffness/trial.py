"""Eq. (7) tried: true deflections under heavy weights all over the workspace, and predicted ones."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import typer

from testbench.arm.folder import find_arm
from testbench.campaign.campaign import Cell, build_cell, clear_poses, stream
from testbench.correct.rest import rest
from testbench.errors import Array
from testbench.identify.arm_model import bending
from testbench.model.load import Load
from testbench.model.loaded import (
    displacement,
    geometric_stiffness,
    loaded_deflection,
    secant,
)
from testbench.model.poses import WorkArea
from testbench.model.structure import joints_only
from testbench.model.vjm import chain, observation
from testbench.model.weights import no_weights
from testbench.plant.build import Plant, weightless
from testbench.plant.equilibrium import settle

FULL, QUICK = (7, 200), (4, 30)  #: How many weights, and poses a seed.
WORKSPACE = WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0))  #: Where the tool has to be.
AT_TOOL = np.zeros((1, 3))

Truth = Literal["weightless", "own weight"]
Method = Literal["linear", "secant", "integrated", "joints"]
"""Eq. (6); Eq. (7) with K_w at theta = 0 for the whole load, or from no load to the whole; joints alone."""


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    arm: Annotated[str, typer.Option(help="Folder of the arm, or the name of one of ours.")] = "kr500_l480"
    max_load_n: Annotated[
        float, typer.Option(min=1, max=100_000, help="Heaviest hung weight; the least is a tenth.")
    ] = 10_000.0


@dataclass(frozen=True, kw_only=True)
class Settings(Options):
    """What is tried."""

    loads: int = FULL[0]  #: How many weights, evenly spread on a log scale.
    poses: int = FULL[1]  #: How many poses a seed.

    @property
    def weights(self) -> list[float]:
        """The hung weights, ascending, (loads,) [N]."""
        return [float(w) for w in np.geomspace(self.max_load_n / 10, self.max_load_n, self.loads)]


@dataclass(frozen=True)
class PoseRow:
    """One weight in one pose, by one truth and one method."""

    pose: int  #: Number of the pose, from 1.
    q_rad: tuple[float, ...]  #: Actuated joint angles, (n,).
    load_N: float  #: Hung weight.
    truth: Truth  #: With or without the arm's own weight.
    method: Method  #: What predicts.
    deflection_m: tuple[float, ...]  #: True deflection of the tool, world, (3,).
    error_m: tuple[float, ...]  #: Predicted minus true, world, (3,).


def settings(options: Options, quick: bool, _: range) -> Settings:
    """What the flags ask for."""
    loads, poses = QUICK if quick else FULL
    return Settings(**vars(options), loads=loads, poses=poses)


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[PoseRow]]:
    """Rows of some seeds, each with poses of its own."""
    cell = build_cell(find_arm(asked.arm))
    plants: dict[Truth, Plant] = {"weightless": weightless(cell.plant), "own weight": cell.plant}
    found = []
    for seed in seeds:
        q = clear_poses(cell, WORKSPACE, asked.poses, stream(seed))
        found.append([row for load in asked.weights for row in hang(cell, plants, q, load)])
    return found


def hang(cell: Cell, plants: Mapping[Truth, Plant], q: Array, load: float) -> list[PoseRow]:
    """One weight [N] in every pose (poses, n) [rad]: deflections true and predicted."""
    wrench = np.zeros((len(q), 6))
    wrench[:, 2] = -load
    point = np.tile(cell.vjm.load, (len(q), 1))
    predicted, rows = predict(cell, q, wrench, point), []
    for truth, plant in plants.items():
        moved = settle(plant, q, wrench, point).tool - settle(plant, q).tool
        every = predicted | {"joints": joints_alone(cell, q, wrench, point, moved)}
        rows += [
            PoseRow(
                pose=i + 1,
                q_rad=tuple(angles.tolist()),
                load_N=load,
                truth=truth,
                method=method,
                deflection_m=tuple(moved[i].tolist()),
                error_m=tuple((foretold[i] - moved[i]).tolist()),
            )
            for method, foretold in every.items()
            for i, angles in enumerate(q)
        ]
    return rows


def predict(cell: Cell, q: Array, wrench: Array, point: Array) -> dict[Method, Array]:
    """Deflection of the tool by method, with the true compliances, (poses, 3) [m]."""
    unloaded, C_theta = chain(cell.vjm, q), cell.arm.C_theta
    theta = rest(bending(cell.vjm, C_theta, no_weights(cell.arm)), q, [Load(wrench, point)]).theta
    K_w = geometric_stiffness(unloaded, wrench, point)
    return {
        "linear": displacement(unloaded, secant(unloaded, C_theta, wrench, point), AT_TOOL)[:, 0],
        "secant": displacement(unloaded, secant(unloaded, C_theta, wrench, point, K_w), AT_TOOL)[:, 0],
        "integrated": loaded_deflection(cell.vjm, q, theta, AT_TOOL)[:, 0],
    }


def joints_alone(cell: Cell, q: Array, wrench: Array, point: Array, moved: Array) -> Array:
    """Deflection of the tool by joint compliances fitted to these very deflections, (poses, 3) [m].

    Linear as Eq. (6), links rigid, least squares without noise: no campaign leaves joints alone less.
    """
    A = observation(chain(cell.vjm, q), joints_only(cell.arm), wrench, point, AT_TOOL)[:, 0]
    pi = np.linalg.lstsq(A.reshape(-1, A.shape[-1]), moved.ravel())[0]
    return np.asarray(A @ pi)
