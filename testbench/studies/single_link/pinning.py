"""What the errors of the printed Eq. (22) say of the paper's experiment: which loads, whose sigma."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import gammainc, gammaincc

from testbench.bench.campaign import Cell, stream
from testbench.bench.full_pose import FullPose
from testbench.studies.paper import EQ_22
from testbench.studies.single_link.judge import noise_scale, rms
from testbench.studies.single_link.trial import wrenches_within
from testbench.trials.spread import Spread, spread

DRAWS = 20_000  #: Draws of noise, and random load sets, tried for the statistics.


@dataclass(frozen=True)
class Expected:
    """Share of draws in which C, read directly, has a negative eigenvalue."""

    of_the_matrix: float
    of_its_symmetric_part: float


@dataclass(frozen=True)
class Pinning:
    """Errors of Eq. (22) in units of the paper's sigma over 10 N, 10 N m: which loads, whose sigma."""

    entries: int
    position_rms_over_sigma: float
    rotation_rms_over_sigma: float
    standard_error_percent: float
    position_rms_by_column_over_sigma: list[float]
    rotation_rms_by_column_over_sigma: list[float]
    rms_over_sigma: float
    p_as_large_if_sigma_is_of_a_deflection: float
    p_as_small_if_sigma_is_of_a_reading: float
    likelihood_ratio_deflection_to_reading: float
    negative_eigenvalue_expected: Mapping[str, Expected]
    random_loads_rms_over_sigma: Spread
    random_loads_share_as_small: float


def pinning(cell: Cell, campaign: FullPose) -> Pinning:
    """Which loads the paper's experiment had, and what its sigma belongs to."""
    ls = np.array(EQ_22)
    e = (ls - cell.arm.C_theta) / noise_scale(campaign)
    total = float((e**2).sum())
    rng = stream(0)
    W = wrenches_within(6 * DRAWS, 1.0, 1.0, rng).reshape(-1, 6, 6)
    random = np.sqrt((np.linalg.solve(W, rng.standard_normal(W.shape)) ** 2).mean(axis=(1, 2)))
    return Pinning(
        entries=e.size,
        position_rms_over_sigma=rms(e[:3]),
        rotation_rms_over_sigma=rms(e[3:]),
        standard_error_percent=100 / math.sqrt(e.size),
        position_rms_by_column_over_sigma=[rms(column) for column in e[:3].T],
        rotation_rms_by_column_over_sigma=[rms(column) for column in e[3:].T],
        rms_over_sigma=rms(e),
        p_as_large_if_sigma_is_of_a_deflection=float(gammaincc(e.size / 2, total / 2)),
        p_as_small_if_sigma_is_of_a_reading=float(gammainc(e.size / 2, total / 4)),
        likelihood_ratio_deflection_to_reading=float(np.exp(e.size * np.log(2) / 2 - total / 4)),
        negative_eigenvalue_expected={
            "if_sigma_is_of_a_deflection": _expected(cell, campaign, 1.0),
            "if_sigma_is_of_a_reading": _expected(cell, campaign, math.sqrt(2)),
        },
        random_loads_rms_over_sigma=spread(random.tolist()),
        random_loads_share_as_small=float((random <= rms(e)).mean()),
    )


def _expected(cell: Cell, campaign: FullPose, factor: float) -> Expected:
    """How often C read directly has a negative eigenvalue, with so many times the noise."""
    noise = noise_scale(campaign) * stream(0).standard_normal((DRAWS, 6, 6))
    C = cell.arm.C_theta + factor * noise
    symmetric = np.linalg.eigvalsh((C + C.swapaxes(1, 2)) / 2)
    matrix = np.linalg.eigvals(C).real
    return Expected(float((matrix.min(axis=1) < 0).mean()), float((symmetric[:, 0] < 0).mean()))
