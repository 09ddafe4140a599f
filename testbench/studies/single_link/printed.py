"""What the printed Eq. (22) and (23) say of the paper's own experiment, and of its optimiser."""

import math

import numpy as np
from scipy import stats

from testbench.bench.campaign import Cell, stream
from testbench.bench.full_pose import FullPose
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify import gco, reduce
from testbench.identify.regression import f_m
from testbench.studies.paper import EQ_22, EQ_23
from testbench.studies.single_link.trial import (
    Study,
    eigenvalues,
    models,
    noise_scale,
    of_every_order,
    prediction_errors,
    rank_beyond_noise,
    rms,
    wrenches_within,
)
from testbench.views.report import Report, merge

ROUNDINGS = 20_000
"""Matrices that round to Eq. (23), and random load sets, tried for the statistics of the printed numbers."""
ROUNDED_COSTS = 200
"""F_M taken of so many of them."""


def printed_matrices(cell: Cell, study: Study, truth: Dataset) -> Report:
    """What the printed Eq. (22) and (23) tell of the paper's experiment.

    Args:
        cell: The link.
        study: Noise and starts.
        truth: Noise-free readings under check loads.
    """
    ls, ours = np.array(EQ_22), np.array(EQ_23)
    matrix, symmetric = eigenvalues(ls)
    return {
        "pinning": _pinning(cell, study.campaign, ls),
        "eq_22": {
            "matrix": ls.tolist(),
            "eigenvalues_matrix": matrix.tolist(),
            "eigenvalues_symmetric_part": symmetric.tolist(),
        },
        "eq_23": {"matrix": ours.tolist(), "eigenvalues": eigenvalues(ours)[1].tolist()},
        "eq_23_from_the_data_of_eq_22": _papers_own_data(cell, study, ls, ours, truth),
    }


def _pinning(cell: Cell, campaign: FullPose, ls: Array) -> Report:
    """Errors of Eq. (22) in units of the paper's sigma over 10 N, 10 N m: which loads, whose sigma."""
    e = (ls - cell.arm.C_theta) / noise_scale(campaign)
    total = float((e**2).sum())
    rng = stream(0)
    W = wrenches_within(6 * ROUNDINGS, 1.0, 1.0, rng).reshape(-1, 6, 6)
    random = np.sqrt((np.linalg.solve(W, rng.standard_normal(W.shape)) ** 2).mean(axis=(1, 2)))
    return {
        "entries": e.size,
        "position_rms_over_sigma": rms(e[:3]),
        "rotation_rms_over_sigma": rms(e[3:]),
        "standard_error_percent": 100 / math.sqrt(e.size),
        "position_rms_by_column_over_sigma": [rms(column) for column in e[:3].T],
        "rotation_rms_by_column_over_sigma": [rms(column) for column in e[3:].T],
        "rms_over_sigma": rms(e),
        "p_as_large_if_sigma_is_of_a_deflection": float(stats.chi2.sf(total, e.size)),
        "p_as_small_if_sigma_is_of_a_reading": float(stats.chi2.cdf(total / 2, e.size)),
        "likelihood_ratio_deflection_to_reading": float(np.exp(e.size * np.log(2) / 2 - total / 4)),
        "negative_eigenvalue_expected": _expected(cell, campaign),
        "random_loads_rms_over_sigma": merge(random.tolist()),
        "random_loads_share_as_small": float((random <= rms(e)).mean()),
    }


def _expected(cell: Cell, campaign: FullPose) -> Report:
    """How often C read directly has a negative eigenvalue, by what the paper's sigma belongs to."""
    noise = noise_scale(campaign) * stream(0).standard_normal((ROUNDINGS, 6, 6))
    shares: Report = {}
    for name, factor in (("if_sigma_is_of_a_deflection", 1.0), ("if_sigma_is_of_a_reading", math.sqrt(2))):
        C = cell.arm.C_theta + factor * noise
        symmetric = np.linalg.eigvalsh((C + C.swapaxes(1, 2)) / 2)
        matrix = np.linalg.eigvals(C).real
        shares[name] = {
            "of_the_matrix": float((matrix.min(axis=1) < 0).mean()),
            "of_its_symmetric_part": float((symmetric[:, 0] < 0).mean()),
        }
    return shares


def _papers_own_data(cell: Cell, study: Study, ls: Array, ours: Array, truth: Dataset) -> Report:
    """Least squares of axis loads reads C column by column, so Eq. (22) is the paper's dataset."""
    campaign = study.campaign
    load = np.diag([campaign.force] * 3 + [campaign.moment] * 3)
    data = readings(cell, campaign, load, load @ ls.T)
    structure = models(cell)[-1].structure
    best, regression = gco(cell.vjm, structure, data), reduce(cell.vjm, structure, data)
    half = 10.0 ** (np.floor(np.log10(np.abs(ours))) - 2) / 2
    change = np.triu(half * stream(0).uniform(-1, 1, (ROUNDINGS, 6, 6)))
    rounded = ours + change + np.triu(change, 1).swapaxes(1, 2)
    values = np.linalg.eigvalsh(rounded)
    costs = [f_m(regression, structure.entries(C)) for C in rounded[:ROUNDED_COSTS]]
    return {
        "printed_f_m": f_m(regression, structure.entries(ours)),
        "printed_f_m_within_rounding": [min(costs), max(costs)],
        "eigenvalues_within_rounding": np.stack([values.min(axis=0), values.max(axis=0)], axis=1).tolist(),
        "rank_within_rounding": int((values.min(axis=0) > 0).sum()),
        "optimum_f_m": best.f_m,
        "optimum_duality_gap": best.certificate.gap if best.certificate else None,
        "optimum_eigenvalues": best.eigenvalues[0].tolist(),
        "optimum_rank": rank_beyond_noise(campaign, best.C_theta),
        "optimum_matrix": best.C_theta.tolist(),
        "optimum_prediction": prediction_errors(best.C_theta, truth),
        "order": [
            {
                "m": m,
                "f_m": estimate.f_m,
                "eigenvalues": estimate.eigenvalues[0].tolist(),
                "rms_to_eq_23_over_sigma": rms((estimate.C_theta - ours) / noise_scale(campaign)),
            }
            for m, estimate in of_every_order(cell, data, study.starts, 0)
        ],
    }


def readings(cell: Cell, campaign: FullPose, wrench: Array, twist: Array) -> Dataset:
    """A dataset of given deflections.

    Args:
        cell: The link.
        campaign: The sigmas.
        wrench: Loads, (runs, 6) [N, N m].
        twist: What they caused, (runs, 6) [m, rad].
    """
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
