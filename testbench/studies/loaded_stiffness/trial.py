"""Eq. (7) as a study: what the linear model loses under heavy loads, and what K_w gives back."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from testbench.arm.folder import Arm
from testbench.bench.campaign import Cell, stream
from testbench.data.dataset import Mask
from testbench.errors import Array
from testbench.model.loaded import (
    geometric_stiffness,
    load_jacobian,
    loaded_compliance,
    loaded_deflection,
    loaded_equilibrium,
    secant_deflection,
)
from testbench.model.poses import WorkArea, random_poses
from testbench.model.vjm import chain
from testbench.plant import Plant, build_plant, collisions, settle
from testbench.views.report import MM, Report

NAME = "loaded_stiffness"
TRUTHS = ("weightless", "own weight")
METHODS = {
    "linear": "Eq. (6): J C_theta J^T w, all at theta = 0",
    "secant": "Eq. (7) with K_w at theta = 0, as one stiffness for the whole load",
    "integrated": "Eq. (7) from no load to the whole: equilibrium under load",
}
AT_TOOL = np.zeros((1, 3))


class Study(BaseModel):
    """The study as data: what a manifest must hold to run it again.

    Attributes:
        arm: The arm's folder.
        max_load: Heaviest hung weight [N]; the lightest is a tenth of it.
        loads: How many weights, evenly spread on a log scale.
        poses: How many poses.
        workspace: Where the tool has to be.
    """

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)

    arm: str
    max_load: float = Field(default=10_000.0, ge=1, le=100_000)
    loads: int = Field(default=7, ge=2, le=100)
    poses: int = Field(default=200, ge=1, le=10_000)
    workspace: WorkArea = WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0))


@dataclass(frozen=True)
class Loading:
    """All poses under one weight.

    Attributes:
        load: The weight [N].
        true: Deflection of the tool by truth, (poses, 3) [m].
        predicted: The same by method, (poses, 3) [m].
        tangent_difference: Largest relative difference of the tangent compliance between model and truth [1].
    """

    load: float
    true: dict[str, Array]
    predicted: dict[str, Array]
    tangent_difference: float


def weightless(arm: Arm) -> Plant:
    """The true arm without gravity: what is left of its non-linearity is that of Eq. (7)."""
    plant = build_plant(arm)
    plant.model.opt.gravity[:] = 0
    return plant


def draw(cell: Cell, study: Study, seed: int) -> Array:
    """Poses all over the workspace, free of collision, (poses, n) [rad]."""

    def clear(q: Array) -> Mask:
        return np.array([pair is None for pair in collisions(cell.room, q)], dtype=bool)

    return random_poses(cell.vjm, study.workspace, study.poses, clear, stream(seed))


def hang(cell: Cell, plants: dict[str, Plant], q: Array, load: float, increment: float) -> Loading:
    """One weight in every pose: true deflections, predicted ones, and the tangents under it.

    Args:
        cell: The arm.
        plants: By truth.
        q: Poses, (poses, n) [rad].
        load: Force straight down [N].
        increment: Change of force for the numerical tangent [N].
    """
    wrench = np.zeros((len(q), 6))
    wrench[:, 2] = -load
    point = np.tile(cell.vjm.load, (len(q), 1))
    true = {name: deflect(plant, q, wrench, point) for name, plant in plants.items()}
    theta = loaded_equilibrium(cell.vjm, cell.arm.C_theta, q, wrench, point).theta
    C = tangent(cell, q, theta, wrench, point)
    expected = numerical_tangent(plants["weightless"], q, wrench, point, increment)
    off = np.linalg.norm(C - expected, axis=(1, 2)) / np.linalg.norm(expected, axis=(1, 2))
    return Loading(load, true, predict(cell, q, theta, wrench, point), float(off.max()))


def deflect(plant: Plant, q: Array, wrench: Array, point: Array) -> Array:
    """True deflection of the tool, from unloaded to loaded, (poses, 3) [m]."""
    return np.asarray(settle(plant, q, wrench, point).tool - settle(plant, q).tool)


def predict(cell: Cell, q: Array, theta: Array, wrench: Array, point: Array) -> dict[str, Array]:
    """Deflection of the tool by method, with the true compliances, (poses, 3) [m]."""
    unloaded, C_theta = chain(cell.vjm, q), cell.arm.C_theta
    K_w = geometric_stiffness(unloaded, wrench, point)
    predictions = (
        secant_deflection(unloaded, C_theta, wrench, point, AT_TOOL),
        secant_deflection(unloaded, C_theta, wrench, point, AT_TOOL, K_w),
        loaded_deflection(cell.vjm, q, theta, AT_TOOL),
    )
    return {name: moved[:, 0] for name, moved in zip(METHODS, predictions, strict=True)}


def tangent(cell: Cell, q: Array, theta: Array, wrench: Array, point: Array) -> Array:
    """Compliance of the loaded arm at the load's point against forces, Eq. (7), (poses, 3, 3) [m/N]."""
    loaded = chain(cell.vjm, q, theta)
    K_w = geometric_stiffness(loaded, wrench, point)
    C = loaded_compliance(load_jacobian(loaded, point), cell.arm.C_theta, K_w)
    return np.asarray(C[:, :3, :3])


def numerical_tangent(plant: Plant, q: Array, wrench: Array, point: Array, increment: float) -> Array:
    """The same by central differences of the true equilibria, (poses, 3, 3) [m/N]."""

    def position(extra: Array) -> Array:
        rest = settle(plant, q, wrench + extra, point)
        return np.asarray(rest.tool + np.einsum("rxy,ry->rx", rest.rotation, point))

    steps = increment * np.eye(3, 6)
    columns = [(position(step) - position(-step)) / (2 * increment) for step in steps]
    return np.stack(columns, axis=2)


def errors(loading: Loading) -> Iterator[tuple[str, str, Array, Array]]:
    """Truth, method, error (predicted minus true) and true deflection of every pose, (poses, 3) [m]."""
    for truth, moved in loading.true.items():
        for method, predicted in loading.predicted.items():
            yield truth, method, predicted - moved, moved


def summary(study: Study, seed: int, loadings: list[Loading]) -> Report:
    """The numbers of report.json."""
    return {
        "scenario": NAME,
        "seed": seed,
        "arm": study.arm,
        "poses": study.poses,
        "loads_N": [loading.load for loading in loadings],
        "methods": METHODS,
        "rows": [
            {"load_N": loading.load, "truth": truth, "method": method, **statistics(error, moved)}
            for loading in loadings
            for truth, method, error, moved in errors(loading)
        ],
        "tangent": [
            {"load_N": loading.load, "max_relative_difference": loading.tangent_difference}
            for loading in loadings
        ],
    }


def statistics(error: Array, moved: Array) -> dict[str, float]:
    """Errors over all poses in millimetres, and as a share of each pose's deflection.

    Args:
        error: Of every pose, (poses, 3) [m].
        moved: True deflection, (poses, 3) [m].
    """
    distance, size = np.linalg.norm(error, axis=1), np.linalg.norm(moved, axis=1)
    share = 100 * distance / size
    values = {
        "deflection_rms_mm": MM * rms(size),
        "rms_mm": MM * rms(distance),
        "max_mm": MM * distance.max(),
        "vertical_rms_mm": MM * rms(error[:, 2]),
        "rms_percent": 100 * rms(distance) / rms(size),
        "max_percent": share.max(),
    }
    for unit, sample in (("mm", MM * distance), ("percent", share)):
        p05, median, p95 = np.percentile(sample, [5, 50, 95])
        values |= {f"median_{unit}": median, f"p05_{unit}": p05, f"p95_{unit}": p95}
    return {key: float(value) for key, value in values.items()}


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def write_errors(file: Path, arm: Arm, q: Array, loadings: list[Loading]) -> None:
    """A row for each pose, load, truth and method; world axes, error is predicted minus true."""
    angles = [[repr(float(angle)) for angle in pose] for pose in q]
    names = [f"{joint.name}_rad" for joint in arm.joints]
    vectors = [f"{what}_{x}_m" for what in ("deflection", "error") for x in "xyz"]
    with file.open("w", encoding="utf-8", newline="") as text:
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(["run", "pose", *names, "load_N", "truth", "method", *vectors, "error_m"])
        for k, loading in enumerate(loadings):
            for truth, method, error, moved in errors(loading):
                distance = np.linalg.norm(error, axis=1)
                numbers = np.column_stack([moved, error, distance]).tolist()
                for i, pose in enumerate(angles):
                    case = [loading.load, truth, method]
                    rows.writerow([k * len(q) + i + 1, i + 1, *pose, *case, *numbers[i]])
