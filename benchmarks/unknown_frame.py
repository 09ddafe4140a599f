"""What an unknown frame and rough targets cost, and whether registration knows its own error.

    python benchmarks/unknown_frame.py --first 1000 --seeds 100

A KR 500 in 10 poses, read by a laser tracker at 4 m. First what a fit predicts wrong over the workspace:
frame and targets as they are; both found, nominal targets 30 mm off; rough targets kept. The prior is wrong
too, twice in scale and 30 % in shape. Then the normalised squared error of frames and targets, which has the
mean 1 where covariances are right.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Annotated

import numpy as np
import typer
from measure import MODELS
from scipy.spatial.transform import Rotation

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.base_frame import register_dataset, transform_to_base, unloaded_series
from testbench.identify.estimate import deflections, score
from testbench.identify.method import gco, with_prior
from testbench.identify.prior import PriorUncertainty, cad_prior, perturb_prior
from testbench.identify.registration import Frame, kabsch, register
from testbench.model.structure import mgco68
from testbench.model.vjm import Vjm, tool_poses
from testbench.plant.disturbance import Disturbances, GeometryErrors
from testbench.plant.true_arms import disturb
from testbench.runs.rows import trial_rng
from testbench.workflows.absolute_campaign import by_trackers
from testbench.workflows.campaign import Scenario, draw_poses, measure_markers, poses_with_weight
from testbench.workflows.cell import Cell, build_cell

ARM, PLACE, POSES, MASS = "kr500_l480", (2.2, -4.0, 1.6), 10, 460.3
ROUGH, NOISE = 0.03, 1e-3  #: Of nominal targets, and of readings where the covariance is judged [m].
CASES = ("known", "found", "rough targets kept")


def of_model(cell: Cell, seed: int, errors: float) -> Array:
    """RMS error over the workspace in every case, (3,) [m]; joints off by `errors` [m, rad]."""
    if errors:
        geometry = Disturbances(own_weight=True, geometry=GeometryErrors(errors, errors))
        cell = replace(cell, truth=disturb(cell.plant, geometry, trial_rng(seed, 9)))
    setup = Scenario(arm=ARM, workspace_poses=100)
    poses = draw_poses(cell, setup, seed)
    clean, truth = (
        measure_markers(cell, setup, poses_with_weight(cell, q, np.arange(len(q)), MASS))
        for q in (poses.station[:POSES], poses.anywhere)
    )
    data = by_trackers(clean, [PLACE], seed)
    off = trial_rng(seed, 5).standard_normal(cell.vjm.markers.shape)
    off *= ROUGH / np.linalg.norm(off, axis=1, keepdims=True)
    rough = replace(cell.vjm, markers=cell.vjm.markers + off)
    prior = perturb_prior(cad_prior(cell.arm), scale=2, shape=0.3, rng=np.random.default_rng([seed, 7]))
    fit, structure = with_prior(gco, prior, PriorUncertainty(0.3)), mgco68(cell.arm)

    def error(vjm: Vjm, runs: Dataset) -> float:
        return score(deflections(vjm, fit(vjm, structure, runs), truth), truth.deflection).rms

    at, seen = (
        x.before.reshape(-1, 3) for x in (clean, data)
    )  # the tracker's noise is 1e-5 of the distances
    turn, shift = kabsch(at, seen)
    frame = {"station 1": Frame(turn, shift)}
    known, found = (
        transform_to_base(register(cell.vjm, unloaded_series(data), {}, frame), data),
        register_dataset(rough, data),
    )
    return np.array([error(cell.vjm, known), error(found.vjm, found.data), error(rough, known)])


def of_frame(cell: Cell, seed: int) -> float:
    """Squared error of two frames and three targets over its covariance and number of unknowns [1]."""
    rng = np.random.default_rng(seed)
    vjm = cell.vjm
    stations = np.arange(3 * POSES) % 2
    lower, upper = cell.arm.limits
    q = rng.uniform(lower, upper, (len(stations), cell.arm.n_joints))
    p, tool = tool_poses(vjm, q)
    R, t = Rotation.random(2, rng=rng).as_matrix(), 5 * rng.standard_normal((2, 3))
    x = p[:, None] + vjm.markers @ tool.transpose(0, 2, 1)
    y = np.einsum("rxy,rmy->rmx", R[stations], x) + t[stations][:, None]
    y += NOISE * rng.standard_normal(y.shape)
    ids, zero = np.arange(len(q)), np.zeros((len(q), 6))
    data = Dataset(cell.arm.markers, ids, ids, q, zero, zero[:, :3], y, y, 50e-6, station=stations)
    rough = dict(zip(cell.arm.markers, vjm.markers + 0.02 * rng.standard_normal((3, 3)), strict=True))
    found = register(vjm, unloaded_series(data), rough)
    e = np.concatenate([*_off(found.frames.values(), R, t), (found.targets - vjm.markers).ravel()])
    return float(e @ np.linalg.solve(found.covariance, e)) / len(e)


def _off(frames: Iterable[Frame], R: Array, t: Array) -> Iterator[Array]:
    for k, frame in enumerate(frames):
        yield Rotation.from_matrix(R[k].T @ frame.rotation).as_rotvec()
        yield frame.translation - t[k]


def main(
    first: Annotated[int, typer.Option(help="First seed.")] = 1000,
    seeds: Annotated[int, typer.Option(min=2, help="How many.")] = 100,
) -> None:
    """Print both."""
    cell = build_cell(MODELS / ARM)
    every = range(first, first + seeds)
    for errors in (0.0, 1e-3):
        rms = np.array([of_model(cell, seed, errors) for seed in every])
        print(
            f"geometric errors {1e3 * errors:g} mm and mrad: error over the workspace, um, and over `known`"
        )
        for case, own, ratio in zip(CASES, rms.T, (rms / rms[:, :1]).T, strict=True):
            print(f"  {case:20} {1e6 * np.median(own):6.1f}  {_spread(ratio)}")
    squares = _spread([of_frame(cell, seed) for seed in every])
    print(f"squared error of frames and targets over its covariance: {squares}")


def _spread(values: object) -> str:
    x = np.asarray(values)
    return f"median {np.median(x):.3f} mean {x.mean():.3f} 90 % {np.percentile(x, 90):.3f}"


if __name__ == "__main__":
    typer.run(main)
