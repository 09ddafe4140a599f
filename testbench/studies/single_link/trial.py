"""Section 5.1 as a study: one link, six loads, least squares against GCO over many draws of noise.

The truth is Eq. (21). Eq. (22) and (23) are one draw of what is counted here over a thousand.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from testbench.arm.stiffness import SYMMETRY_TOLERANCE
from testbench.bench.campaign import Cell, Model, build_cell, stream
from testbench.bench.full_pose import FullPose, random_wrenches, read_runs
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify import Estimate, gco, least_squares
from testbench.identify.estimate import CONSERVATIVE_TOLERANCE
from testbench.identify.factorised import LARGEST_ORDER, LocalSolves
from testbench.model.structure import Structure, free36
from testbench.views.report import UM, Report

NAME = "single_link"
LEAST_SQUARES, SYMMETRIC, GCO = "MLS36", "MLS21", "MGCO21"
STARTS = 8
"""Local solves of every order m: below 6 there are local minima that are not global."""
NO_RANK = 1e-4
"""Eigenvalue, in units of what noise causes, below which it counts as zero: solvers leave 1e-8."""
AT_OPTIMUM = 1e-6
"""Share of F_M by which a local solve may exceed the certified optimum and still have reached it."""


class Study(BaseModel):
    """The study as data: what a manifest must hold to run it again.

    Attributes:
        draws: Draws of noise; draw k has the seed of the run plus k.
        order_draws: The first so many draws are solved for every order m too.
        loads: "axes" for one axis at a time, "random" for six random wrenches within force and moment.
        starts: Local solves of every order.
        campaign: Loads, noise and number of check loads.
    """

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")

    draws: int = Field(ge=1, le=100_000)
    order_draws: int = Field(ge=1, le=100_000)
    loads: Literal["axes", "random"] = "axes"
    starts: int = Field(default=STARTS, ge=1, le=100)
    campaign: FullPose = FullPose(
        arm=NAME,
        poses=1,
        force=10.0,
        moment=10.0,
        sigma=25e-6 / math.sqrt(2),  # of one reading: the paper's noise is that of a deflection
        sigma_rotation=250e-6 / math.sqrt(2),
        check_runs=120,
    )


@dataclass(frozen=True)
class Draw:
    """One draw of noise.

    Attributes:
        identification: Noisy readings under the six loads.
        truth: Noise-free readings under the check loads.
    """

    identification: Dataset
    truth: Dataset


def models(cell: Cell) -> list[Model]:
    """Least squares with 36 entries, the same with 21, and GCO: what symmetry gives, what the constraint."""
    full = partial(Structure.of, cell.arm, links=[link.name for link in cell.arm.links])
    return [
        Model(LEAST_SQUARES, free36(cell.arm), least_squares),
        Model(SYMMETRIC, full(name=SYMMETRIC), least_squares),
        Model(GCO, full(name=GCO), gco),
    ]


def measure(cell: Cell, study: Study, seed: int) -> Draw:
    """Load the true link, read it, and draw loads to check with.

    Args:
        cell: The link.
        study: What to measure.
        seed: Root of all randomness of this draw.
    """
    campaign = study.campaign
    if study.loads == "axes":
        wrench = np.diag([campaign.force] * 3 + [campaign.moment] * 3)
    else:
        wrench = wrenches_within(6, campaign.force, campaign.moment, stream(seed, 2))
    check = wrenches_within(campaign.check_runs, campaign.force, campaign.moment, stream(seed, 0))
    return Draw(
        identification=_read(cell, campaign, wrench, stream(seed, 1)),
        truth=_read(cell, campaign, check, None),
    )


def _read(cell: Cell, campaign: FullPose, wrench: Array, rng: np.random.Generator | None) -> Dataset:
    return read_runs(
        cell, campaign, np.empty((len(wrench), 0)), wrench, np.zeros(len(wrench), dtype=int), rng
    )


def wrenches_within(count: int, force: float, moment: float, rng: np.random.Generator) -> Array:
    """Wrenches spread evenly over the balls |F| <= force and |M| <= moment, (count, 6) [N, N m]."""
    size = np.repeat(np.cbrt(rng.uniform(size=(count, 2))), 3, axis=1)
    return size * random_wrenches(count, force, moment, rng)


def trials(
    folder: Path, study: Study, ordered: Sequence[int], clock: Callable[[], float], seeds: Sequence[int]
) -> list[Report]:
    """What every model and every order m made of some draws.

    Args:
        folder: The arm's.
        study: What to measure.
        ordered: Seeds in which the order m is studied too.
        clock: Wall time [s].
        seeds: Roots of randomness.
    """
    cell = build_cell(folder)
    return [_trial(cell, study, seed, seed in ordered, clock) for seed in seeds]


def _trial(cell: Cell, study: Study, seed: int, ordered: bool, clock: Callable[[], float]) -> Report:
    draw = measure(cell, study, seed)
    load = draw.identification.wrench / ([study.campaign.force] * 3 + [study.campaign.moment] * 3)
    found: Report = {"seed": seed, "condition": float(np.linalg.cond(load)), "models": {}, "C": {}}
    for model in models(cell):
        start = clock()
        estimate = model.estimator(cell.vjm, model.structure, draw.identification)
        seconds = clock() - start
        found["C"][model.name] = estimate.C_theta
        found["models"][model.name] = {
            **_estimate(estimate, seconds),
            **judge(cell, study.campaign, estimate.C_theta, draw.truth),
        }
    if ordered:
        found["order"] = _orders(cell, study, draw, found["models"][GCO]["f_m"], seed)
    return found


def _estimate(estimate: Estimate, seconds: float) -> Report:
    certificate = estimate.certificate
    return {
        "method": estimate.method,
        "status": estimate.status,
        "parameters": estimate.structure.n,
        "rank": estimate.regression.rank,
        "conservative": estimate.conservative,
        "f_m": estimate.f_m,
        "f_m_floor": estimate.f_m_floor,
        "duality_gap": None if certificate is None else certificate.gap,
        "solve_seconds": seconds,
    }


def judge(cell: Cell, campaign: FullPose, C: Array, truth: Dataset) -> Report:
    """Eigenvalues of a compliance, its errors in entries and in predictions.

    Args:
        cell: The link; its compliance is the truth.
        campaign: Scale of the noise.
        C: Compliance, (6, 6) [m/N, rad/N, rad/(N m)].
        truth: Noise-free readings under check loads.
    """
    matrix, symmetric = eigenvalues(C)
    zero = -CONSERVATIVE_TOLERANCE * np.abs(matrix).max()
    return {
        "symmetric": bool(np.abs(C - C.T).max() <= SYMMETRY_TOLERANCE * np.abs(C).max()),
        "min_eigenvalue": float(symmetric[0]),
        "min_eigenvalue_matrix": float(matrix[0]),
        "negative_eigenvalue": bool(symmetric[0] < zero),
        "negative_eigenvalue_matrix": bool(matrix[0] < zero),
        "rank_of_C": rank_beyond_noise(campaign, C),
        "entries": _entry_errors(C - cell.arm.C_theta),
        "prediction": prediction_errors(C, truth),
    }


def eigenvalues(C: Array) -> tuple[Array, Array]:
    """Real parts of the eigenvalues of a matrix, as the paper counts, and those of its symmetric part."""
    return np.sort(np.linalg.eigvals(C).real), np.asarray(np.linalg.eigvalsh((C + C.T) / 2))


def noise_scale(campaign: FullPose) -> Array:
    """Noise of an entry read directly, sqrt(2) sigma over the load, (6, 6) [m/N, 1/N, rad/(N m)]."""
    sigma = np.repeat([campaign.sigma, campaign.sigma_rotation], 3)
    load = np.repeat([campaign.force, campaign.moment], 3)
    return np.asarray(np.sqrt(2) * sigma[:, None] / load)


def rank_beyond_noise(campaign: FullPose, C: Array) -> int:
    """Eigenvalues of the symmetric part that are no rounding of zero, in units of what noise causes."""
    unit = np.sqrt(np.diag(noise_scale(campaign)))
    values = np.linalg.eigvalsh((C + C.T) / 2 / np.outer(unit, unit))
    return int((np.abs(values) > NO_RANK).sum())


def _entry_errors(error: Array) -> Report:
    """RMS over the nine entries of a block."""
    return {
        "translation_rms_um_per_N": UM * rms(error[:3, :3]),
        "coupling_translation_rms_um_per_Nm": UM * rms(error[:3, 3:]),
        "coupling_rotation_rms_urad_per_N": UM * rms(error[3:, :3]),
        "rotation_rms_urad_per_Nm": UM * rms(error[3:, 3:]),
    }


def prediction_errors(C: Array, truth: Dataset) -> Report:
    """RMS distance over the check loads, and as a share of the RMS deflection."""
    predicted = truth.wrench @ C.T
    position, rotation = truth.deflection[:, 0], truth.rotation
    e_position, e_rotation = predicted[:, :3] - position, predicted[:, 3:] - rotation
    return {
        "position_rms_um": UM * math.sqrt(3) * rms(e_position),
        "position_relative_percent": 100 * rms(e_position) / rms(position),
        "rotation_rms_urad": UM * math.sqrt(3) * rms(e_rotation),
        "rotation_relative_percent": 100 * rms(e_rotation) / rms(rotation),
    }


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _orders(cell: Cell, study: Study, draw: Draw, optimum: float, seed: int) -> list[Report]:
    """Every order m of Eq. (20) on one draw, beside the certified optimum of F_M."""
    return [
        {
            "m": m,
            "f_m": estimate.f_m,
            "f_m_over_optimum": estimate.f_m / optimum,
            "reaches_optimum": estimate.f_m <= (1 + AT_OPTIMUM) * optimum,
            "rank_of_C": rank_beyond_noise(study.campaign, estimate.C_theta),
            "conservative": estimate.conservative,
            "eigenvalues": estimate.eigenvalues[0].tolist(),
            "prediction": prediction_errors(estimate.C_theta, draw.truth),
        }
        for m, estimate in of_every_order(cell, draw.identification, study.starts, seed)
    ]


def of_every_order(cell: Cell, data: Dataset, starts: int, seed: int) -> Iterable[tuple[int, Estimate]]:
    """The best of some local solves for m = 1 to 6."""
    structure = models(cell)[-1].structure
    for m in range(1, LARGEST_ORDER + 1):
        rng = stream(seed, 10 + m)
        yield m, LocalSolves(rng, m, starts)(cell.vjm, structure, data)
