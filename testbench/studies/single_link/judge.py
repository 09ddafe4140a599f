"""A compliance of the single link judged: eigenvalues, errors of its entries and of its predictions."""

import math
from dataclasses import dataclass

import numpy as np

from testbench.arm.stiffness import SYMMETRY_TOLERANCE
from testbench.bench.campaign import Cell
from testbench.bench.full_pose import FullPose
from testbench.bench.rows import UM
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.estimate import CONSERVATIVE_TOLERANCE
from testbench.trials.spread import Number, Share

NO_RANK = 1e-4
"""Eigenvalue, in units of what noise causes, below which it counts as zero: solvers leave 1e-8."""


@dataclass(frozen=True)
class Entries:
    """RMS errors over the nine entries of a block of C."""

    translation_rms_um_per_N: Number
    coupling_translation_rms_um_per_Nm: Number
    coupling_rotation_rms_urad_per_N: Number
    rotation_rms_urad_per_Nm: Number


@dataclass(frozen=True)
class Prediction:
    """RMS distances under the check loads, and as a share of the RMS deflection."""

    position_rms_um: Number
    position_relative_percent: Number
    rotation_rms_urad: Number
    rotation_relative_percent: Number


@dataclass(frozen=True)
class Judged:
    """A compliance judged.

    Its smallest eigenvalue is that of the symmetric part, or, as the paper counts, the real part of the
    matrix's own, in 1e-6 of mixed SI units.
    """

    symmetric: Share
    symmetric_eigenvalue_micro: Number
    matrix_eigenvalue_micro: Number
    negative_eigenvalue: Share
    negative_eigenvalue_matrix: Share
    entries: Entries
    prediction: Prediction


def judge(cell: Cell, C: Array, truth: Dataset) -> Judged:
    """Eigenvalues of C, (6, 6) [m/N, rad/N, rad/(N m)], and its errors, under noise-free loads too."""
    matrix, symmetric = eigenvalues(C)
    zero = -CONSERVATIVE_TOLERANCE * np.abs(matrix).max()
    error = C - cell.arm.C_theta
    return Judged(
        symmetric=bool(np.abs(C - C.T).max() <= SYMMETRY_TOLERANCE * np.abs(C).max()),
        symmetric_eigenvalue_micro=UM * float(symmetric[0]),
        matrix_eigenvalue_micro=UM * float(matrix[0]),
        negative_eigenvalue=bool(symmetric[0] < zero),
        negative_eigenvalue_matrix=bool(matrix[0] < zero),
        entries=Entries(
            translation_rms_um_per_N=UM * rms(error[:3, :3]),
            coupling_translation_rms_um_per_Nm=UM * rms(error[:3, 3:]),
            coupling_rotation_rms_urad_per_N=UM * rms(error[3:, :3]),
            rotation_rms_urad_per_Nm=UM * rms(error[3:, 3:]),
        ),
        prediction=prediction_errors(C, truth),
    )


def prediction_errors(C: Array, truth: Dataset) -> Prediction:
    """Errors of the deflections that a compliance predicts under the loads of some noise-free readings."""
    predicted = truth.wrench @ C.T
    position, rotation = truth.deflection[:, 0], truth.rotation
    e_position, e_rotation = predicted[:, :3] - position, predicted[:, 3:] - rotation
    return Prediction(
        position_rms_um=UM * math.sqrt(3) * rms(e_position),
        position_relative_percent=100 * rms(e_position) / rms(position),
        rotation_rms_urad=UM * math.sqrt(3) * rms(e_rotation),
        rotation_relative_percent=100 * rms(e_rotation) / rms(rotation),
    )


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


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))
