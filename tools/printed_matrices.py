"""What the printed Eq. (22) and (23) tell of the experiment and optimiser of the paper, for docs/paper.md."""

import math

import numpy as np
from scipy.special import gammainc, gammaincc

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.method import paper_gco
from testbench.identify.regression import f_m, reduce
from testbench.report.schema import Table, TableColumn, columns
from testbench.report.table import Row
from testbench.runs.rows import trial_rng
from testbench.runs.spread import Spread, spread
from testbench.studies.paper.factorised import every_order
from testbench.studies.paper.single_link import (
    SingleLinkSettings,
    eigenvalues,
    models,
    prediction_errors,
    rms,
    wrenches_within,
)
from testbench.studies.paper.verdicts import EQ_22, EQ_23, statement_row, verdict_table
from testbench.workflows.campaign import FullPose
from testbench.workflows.cell import Cell

NO_RANK = 1e-4
"""Eigenvalue, in units of what noise causes, below which it counts as zero: solvers leave 1e-8."""
DRAWS = 20_000  #: Of noise, of random load sets, and of matrices that round to Eq. (23).
ROUNDED_COSTS = 200  #: F_M taken of so many of them.
DEFLECTION, READING = "if_sigma_is_of_a_deflection", "if_sigma_is_of_a_reading"
OWN, PIN = "eq_23_from_the_data_of_eq_22", "pinning"
FACTS = {
    f"{PIN}.rms_over_sigma": (
        "RMS difference of Eq. (22) and (21): 1 if sigma is of a deflection, 1.41 if of a reading"
    ),
    f"{PIN}.p_as_large_if_sigma_is_of_a_deflection": (
        "probability of this or a larger difference, if sigma is of a deflection"
    ),
    f"{PIN}.p_as_small_if_sigma_is_of_a_reading": (
        "probability of this or a smaller difference, if sigma is of a reading"
    ),
    f"{PIN}.likelihood_ratio_deflection_to_reading": (
        "likelihood ratio: sigma of a deflection over sigma of a reading"
    ),
    f"{PIN}.random_loads_rms_over_sigma": "RMS that six random loads would give",
    f"{OWN}.rank_within_rounding": "rank of Eq. (23) within its rounding",
    f"{OWN}.optimum_rank": "rank of the certified optimum",
    f"{OWN}.optimum_prediction.position_rms_um": "position error of the certified optimum, um",
    f"{OWN}.optimum_prediction.rotation_rms_urad": "rotation error of the certified optimum, urad",
}
"""What the table says, by where its number is."""
OFF = TableColumn("rms_to_eq_23_over_sigma", "RMS distance to Eq. (23)", "sigma/load", ".2f")


def tables(found: Row) -> dict[str, Table]:
    """What the printed matrices say, a number a line; the order m on the paper's own data."""
    rows = []
    for path, what in FACTS.items():
        value = found
        for part in path.split("."):
            value = value[int(part) if isinstance(value, list) else part]
        rows.append(Row(what=what, value=value))
    return {
        "facts": Table(columns("what value"), rows),
        "order": Table((*columns("m f_m"), OFF), found[OWN].order),
        "claims": verdict_table([least_cost(found)]),
    }


def least_cost(found: Row) -> Row:
    """Judge the paper's statement of Eq. (23): its F_M, within its rounding, beside the certified optimum."""
    own = found[OWN]
    least, most = own.printed_f_m_within_rounding
    holds = least <= own.optimum_f_m + (own.optimum_f_m_excess_bound or 0.0)
    row = statement_row("Eq. (23) has the least F_M of all conservative matrices", holds, None)
    return Row(row, published=Spread(own.printed_f_m, least, most), found=own.optimum_f_m)


def noise_scale(campaign: FullPose) -> Array:
    """Compute the noise of an entry read directly, (6, 6): sqrt(2) sigma over the load."""
    sigma = np.repeat([campaign.sigma, campaign.sigma_rotation], 3)
    load = np.repeat([campaign.force, campaign.moment], 3)
    return np.asarray(np.sqrt(2) * sigma[:, None] / load)


def rank_beyond_noise(campaign: FullPose, C: Array) -> int:
    """Count eigenvalues of the symmetric part beyond rounding, in units of what noise causes.

    Args:
        campaign: Campaign of the readings.
        C: Compliance, (6, 6) [m/N, rad/(N m)].

    Returns:
        The rank.
    """
    unit = np.sqrt(np.diag(noise_scale(campaign)))
    values = np.linalg.eigvalsh((C + C.T) / 2 / np.outer(unit, unit))
    return int((np.abs(values) > NO_RANK).sum())


def printed_matrices(cell: Cell, asked: SingleLinkSettings, truth: Dataset) -> Row:
    """What the printed Eq. (22) and (23) tell of the paper's experiment, under noise-free check loads."""
    return Row(
        pinning=_pinning(cell, asked.campaign),
        eq_22=with_eigenvalues(np.array(EQ_22)),
        eq_23=with_eigenvalues(np.array(EQ_23)),
        eq_23_from_the_data_of_eq_22=_papers_own_data(cell, asked, truth),
    )


def with_eigenvalues(C: Array) -> Row:
    """A compliance, (6, 6), and its eigenvalues, ascending [m/N, rad/N, rad/(N m)]."""
    own, symmetric = eigenvalues(C)
    return Row(
        matrix=C.tolist(), eigenvalues_matrix=own.tolist(), eigenvalues_symmetric_part=symmetric.tolist()
    )


def _pinning(cell: Cell, campaign: FullPose) -> Row:
    """Which loads the paper had, and whose its sigma is: errors of Eq. (22) over sigma / load."""
    e = (np.array(EQ_22) - cell.arm.C_theta) / noise_scale(campaign)
    total, rng = float((e**2).sum()), trial_rng(0)
    W = wrenches_within(6 * DRAWS, 1.0, 1.0, rng).reshape(-1, 6, 6)
    random = np.sqrt((np.linalg.solve(W, rng.standard_normal(W.shape)) ** 2).mean(axis=(1, 2)))
    expected = {
        key: _expected(cell, campaign, factor) for key, factor in ((DEFLECTION, 1.0), (READING, math.sqrt(2)))
    }
    return Row(
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
        negative_eigenvalue_expected=expected,
        random_loads_rms_over_sigma=spread(random),
        random_loads_share_as_small=float((random <= rms(e)).mean()),
    )


def _expected(cell: Cell, campaign: FullPose, factor: float) -> Row:
    """How often C read directly has a negative eigenvalue, with so many times the noise."""
    noise = noise_scale(campaign) * trial_rng(0).standard_normal((DRAWS, 6, 6))
    C = cell.arm.C_theta + factor * noise
    matrix, symmetric = np.linalg.eigvals(C).real, np.linalg.eigvalsh((C + C.swapaxes(1, 2)) / 2)
    return Row(
        of_the_matrix=float((matrix.min(axis=1) < 0).mean()),
        of_its_symmetric_part=float((symmetric[:, 0] < 0).mean()),
    )


def _papers_own_data(cell: Cell, asked: SingleLinkSettings, truth: Dataset) -> Row:
    """Least squares of axis loads reads C column by column, so Eq. (22) is the paper's dataset."""
    campaign, ours = asked.campaign, np.array(EQ_23)
    load = np.diag([campaign.force] * 3 + [campaign.moment] * 3)
    data = readings(cell, campaign, load, load @ np.array(EQ_22).T)
    structure = models(cell)[-1].structure
    best, regression = paper_gco(cell.vjm, structure, data), reduce(cell.vjm, structure, data)
    rounded = _rounded(ours)
    values = np.linalg.eigvalsh(rounded)
    costs = [f_m(regression, structure.parameters_of(C)) for C in rounded[:ROUNDED_COSTS]]
    return Row(
        printed_f_m=f_m(regression, structure.parameters_of(ours)),
        printed_f_m_within_rounding=[min(costs), max(costs)],
        eigenvalues_within_rounding=np.stack([values.min(axis=0), values.max(axis=0)], axis=1).tolist(),
        rank_within_rounding=int((values.min(axis=0) > 0).sum()),
        optimum_f_m=best.f_m,
        optimum_f_m_excess_bound=best.certificate.f_m_excess_bound if best.certificate else None,
        optimum_rank=rank_beyond_noise(campaign, best.C_theta),
        optimum=with_eigenvalues(best.C_theta),
        optimum_prediction=Row(prediction_errors(best.C_theta, truth)),
        order=[
            Row(
                m=m,
                f_m=estimate.f_m,
                eigenvalues=estimate.eigenvalues[0].tolist(),
                rms_to_eq_23_over_sigma=rms((estimate.C_theta - ours) / noise_scale(campaign)),
            )
            for m, estimate in enumerate(every_order(cell, structure, data, asked.starts, 0), start=1)
        ],
    )


def _rounded(C: Array) -> Array:
    """Symmetric matrices that round to three printed digits of C, (DRAWS, 6, 6)."""
    half = 10.0 ** (np.floor(np.log10(np.abs(C))) - 2) / 2
    change = np.triu(half * trial_rng(0).uniform(-1, 1, (DRAWS, 6, 6)))
    return np.asarray(C + change + np.triu(change, 1).swapaxes(1, 2))


def readings(cell: Cell, campaign: FullPose, wrench: Array, twist: Array) -> Dataset:
    """A dataset of loads, (runs, 6) [N, N m], and the twists that they caused, (runs, 6) [m, rad]."""
    runs = len(wrench)
    return Dataset(
        markers=cell.arm.markers,
        run_id=np.arange(runs) + 1,
        pose_id=np.ones(runs, dtype=int),
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
