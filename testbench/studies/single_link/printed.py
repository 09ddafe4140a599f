"""What the printed Eq. (22) and (23) say of the paper's own experiment, and of its optimiser."""

from dataclasses import dataclass

import numpy as np

from testbench.bench.campaign import Cell, stream
from testbench.bench.full_pose import FullPose
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify import gco, reduce
from testbench.identify.regression import f_m
from testbench.studies.paper import EQ_22, EQ_23
from testbench.studies.single_link.judge import (
    Prediction,
    eigenvalues,
    noise_scale,
    prediction_errors,
    rank_beyond_noise,
    rms,
)
from testbench.studies.single_link.pinning import Pinning, pinning
from testbench.studies.single_link.trial import Settings, models, of_every_order

ROUNDINGS = 20_000  #: Matrices that round to Eq. (23), tried for the range of its eigenvalues.
ROUNDED_COSTS = 200  #: F_M taken of so many of them.

Numbers = list[float]
Rows = list[Numbers]


@dataclass(frozen=True)
class Matrix:
    """A compliance and its eigenvalues, ascending [m/N, rad/N, rad/(N m)]."""

    matrix: Rows
    eigenvalues_matrix: Numbers
    eigenvalues_symmetric_part: Numbers


@dataclass(frozen=True)
class SymmetricMatrix:
    """A symmetric compliance and its eigenvalues, ascending."""

    matrix: Rows
    eigenvalues: Numbers


@dataclass(frozen=True)
class OwnOrder:
    """The best of order m on the paper's own data, and its distance to Eq. (23)."""

    m: int
    f_m: float
    eigenvalues: Numbers
    rms_to_eq_23_over_sigma: float


@dataclass(frozen=True)
class OwnData:
    """Eq. (23) on the data of Eq. (22), and what the optimum of these data is."""

    printed_f_m: float
    printed_f_m_within_rounding: Numbers
    eigenvalues_within_rounding: Rows
    rank_within_rounding: int
    optimum_f_m: float
    optimum_f_m_excess_bound: float | None
    optimum_eigenvalues: Numbers
    optimum_rank: int
    optimum_matrix: Rows
    optimum_prediction: Prediction
    order: list[OwnOrder]


@dataclass(frozen=True)
class PrintedMatrices:
    """What the printed matrices tell."""

    pinning: Pinning
    eq_22: Matrix
    eq_23: SymmetricMatrix
    eq_23_from_the_data_of_eq_22: OwnData


def printed_matrices(cell: Cell, asked: Settings, truth: Dataset) -> PrintedMatrices:
    """What the printed Eq. (22) and (23) tell of the paper's experiment, under noise-free check loads."""
    ours = np.array(EQ_23)
    return PrintedMatrices(
        pinning=pinning(cell, asked.campaign),
        eq_22=with_eigenvalues(np.array(EQ_22)),
        eq_23=SymmetricMatrix(ours.tolist(), eigenvalues(ours)[1].tolist()),
        eq_23_from_the_data_of_eq_22=_papers_own_data(cell, asked, truth),
    )


def with_eigenvalues(C: Array) -> Matrix:
    """A compliance, (6, 6), and its eigenvalues."""
    return Matrix(C.tolist(), *(values.tolist() for values in eigenvalues(C)))


def _papers_own_data(cell: Cell, asked: Settings, truth: Dataset) -> OwnData:
    """Least squares of axis loads reads C column by column, so Eq. (22) is the paper's dataset."""
    campaign, ours = asked.campaign, np.array(EQ_23)
    load = np.diag([campaign.force] * 3 + [campaign.moment] * 3)
    data = readings(cell, campaign, load, load @ np.array(EQ_22).T)
    structure = models(cell)[-1].structure
    best, regression = gco(cell.vjm, structure, data), reduce(cell.vjm, structure, data)
    rounded = _rounded(ours)
    values = np.linalg.eigvalsh(rounded)
    costs = [f_m(regression, structure.entries(C)) for C in rounded[:ROUNDED_COSTS]]
    return OwnData(
        printed_f_m=f_m(regression, structure.entries(ours)),
        printed_f_m_within_rounding=[min(costs), max(costs)],
        eigenvalues_within_rounding=np.stack([values.min(axis=0), values.max(axis=0)], axis=1).tolist(),
        rank_within_rounding=int((values.min(axis=0) > 0).sum()),
        optimum_f_m=best.f_m,
        optimum_f_m_excess_bound=best.certificate.f_m_excess_bound if best.certificate else None,
        optimum_eigenvalues=best.eigenvalues[0].tolist(),
        optimum_rank=rank_beyond_noise(campaign, best.C_theta),
        optimum_matrix=best.C_theta.tolist(),
        optimum_prediction=prediction_errors(best.C_theta, truth),
        order=[
            OwnOrder(
                m=m,
                f_m=estimate.f_m,
                eigenvalues=estimate.eigenvalues[0].tolist(),
                rms_to_eq_23_over_sigma=rms((estimate.C_theta - ours) / noise_scale(campaign)),
            )
            for m, estimate in of_every_order(cell, data, asked.starts, 0)
        ],
    )


def _rounded(C: Array) -> Array:
    """Symmetric matrices that round to three printed digits of C, (ROUNDINGS, 6, 6)."""
    half = 10.0 ** (np.floor(np.log10(np.abs(C))) - 2) / 2
    change = np.triu(half * stream(0).uniform(-1, 1, (ROUNDINGS, 6, 6)))
    return np.asarray(C + change + np.triu(change, 1).swapaxes(1, 2))


def readings(cell: Cell, campaign: FullPose, wrench: Array, twist: Array) -> Dataset:
    """A dataset of loads, (runs, 6) [N, N m], and the twists that they caused, (runs, 6) [m, rad]."""
    runs = len(wrench)
    return Dataset(
        markers=cell.arm.markers,
        run=np.arange(runs) + 1,
        pose=np.ones(runs, dtype=int),
        q=np.empty((runs, 0)),
        wrench=wrench,
        point=np.zeros((runs, 3)),
        before=np.zeros((runs, 1, 3)),
        after=twist[:, None, :3],
        sigma=campaign.sigma,
        rotation_before=np.zeros((runs, 3)),
        rotation_after=twist[:, 3:],
        sigma_rotation=campaign.sigma_rotation,
    )
