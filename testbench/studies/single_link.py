"""Section 5.1 as a study: one link, six loads, least squares against GCO over many draws of noise.

The truth is Eq. (21). Eq. (22) and (23) are one draw of what is counted here over a thousand.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from rich import box
from rich.table import Table
from scipy import stats

from testbench.bench import Cell, Model, build_cell, stream
from testbench.dataset import Dataset
from testbench.errors import Array
from testbench.full_pose import FullPose, random_wrenches, read_runs
from testbench.identify import Estimate, gco, least_squares, reduce
from testbench.identify.estimate import CONSERVATIVE_TOLERANCE
from testbench.identify.factorised import LARGEST_ORDER, gco_factorised, order_range
from testbench.identify.regression import f_m
from testbench.paper import EQ_22, EQ_23
from testbench.report import MM, UM, Report, merge, middle, show
from testbench.stiffness import SYMMETRY_TOLERANCE
from testbench.structure import Structure, free36
from testbench.tables import grid

NAME = "single_link"
LEAST_SQUARES, SYMMETRIC, GCO = "MLS36", "MLS21", "MGCO21"
STARTS = 8
"""Local solves of every order m: below 6 there are local minima that are not global."""
NO_RANK = 1e-4
"""Eigenvalue, in units of what noise causes, below which it counts as zero: solvers leave 1e-8."""
AT_OPTIMUM = 1e-6
"""Share of F_M by which a local solve may exceed the certified optimum and still have reached it."""
ROUNDINGS = 20_000
"""Matrices that round to Eq. (23), and random load sets, tried for the statistics of the printed numbers."""
ROUNDED_COSTS = 200
"""F_M taken of so many of them."""


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
    return read_runs(cell, campaign, np.empty((len(wrench), 0)), wrench, np.zeros(len(wrench), dtype=int), rng)


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
        "prediction": _prediction_errors(C, truth),
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


def _prediction_errors(C: Array, truth: Dataset) -> Report:
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
            "prediction": _prediction_errors(estimate.C_theta, draw.truth),
        }
        for m, estimate in _of_every_order(cell, draw.identification, study.starts, seed)
    ]


def _of_every_order(
    cell: Cell, data: Dataset, starts: int, seed: int
) -> Iterable[tuple[int, Estimate]]:
    structure = models(cell)[-1].structure
    for m in range(1, LARGEST_ORDER + 1):
        rng = stream(seed, 10 + m)
        yield m, gco_factorised(cell.vjm, structure, data, rng=rng, m=m, starts=starts)


def printed_matrices(cell: Cell, study: Study) -> Report:
    """What the printed Eq. (22) and (23) tell of the paper's experiment.

    Args:
        cell: The link.
        study: Noise and starts.
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
        "eq_23_from_the_data_of_eq_22": _papers_own_data(cell, study, ls, ours),
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
        "random_loads_rms_over_sigma": merge(random.tolist()),
        "random_loads_share_as_small": float((random <= rms(e)).mean()),
    }


def _papers_own_data(cell: Cell, study: Study, ls: Array, ours: Array) -> Report:
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
        "order": [
            {
                "m": m,
                "f_m": estimate.f_m,
                "eigenvalues": estimate.eigenvalues[0].tolist(),
                "rms_to_eq_23_over_sigma": rms((estimate.C_theta - ours) / noise_scale(campaign)),
            }
            for m, estimate in _of_every_order(cell, data, study.starts, 0)
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


SHARES = ("conservative", "symmetric", "negative_eigenvalue", "negative_eigenvalue_matrix", "reaches_optimum")


def summary(cell: Cell, study: Study, first: Draw, results: Sequence[Report]) -> Report:
    """report.json: numbers of all draws as median, 5th and 95th percentile, truth values as shares.

    Args:
        cell: The link.
        study: What was measured.
        first: The first draw, whose readings are in dataset.csv.
        results: One a draw.
    """
    campaign, data = study.campaign, first.identification
    size = MM * np.linalg.norm(data.deflection, axis=-1)
    printed = {LEAST_SQUARES: EQ_22, GCO: EQ_23}
    final: Report = {
        "scenario": NAME,
        "seed": results[0]["seed"],
        "draws": len(results),
        "arm": campaign.arm,
        "truth": campaign.truth,
        "noise": campaign.noise,
        "noise_per": "deflection",
        "loads": study.loads,
        "condition_of_the_loads": merge([r["condition"] for r in results]),
        "dataset": {
            "runs": data.runs,
            "points": data.points,
            "check_runs": first.truth.runs,
            "deflection_min_mm": float(size.min()),
            "deflection_max_mm": float(size.max()),
            "sigma_um": UM * campaign.sigma,
            "sigma_urad": UM * campaign.sigma_rotation,
            "sigma_of_a_deflection_um": UM * math.sqrt(2) * campaign.sigma,
            "sigma_of_a_deflection_urad": UM * math.sqrt(2) * campaign.sigma_rotation,
        },
        "models": [
            {
                "name": model.name,
                **_over_draws([r["models"][model.name] for r in results]),
                **_over_matrices(cell, [r["C"][model.name] for r in results]),
                "paper": _paper(cell, campaign, printed.get(model.name), first.truth),
            }
            for model in models(cell)
        ],
        "paired": {other: _paired(results, other) for other in (LEAST_SQUARES, SYMMETRIC)},
        "order_draws": sum("order" in r for r in results),
        "order_range": list(order_range(models(cell)[-1].structure, data.runs)),
        "order": [_over_draws(rows) for rows in zip(*(r["order"] for r in results if "order" in r), strict=True)],
        "eq_22_23": printed_matrices(cell, study),
        "first_draw": {name: _first(C) for name, C in results[0]["C"].items()},
        "truth_matrix": cell.arm.C_theta.tolist(),
        "units": "matrices: m/N, 1/N, rad/(N m); eigenvalues in these mixed units, as the paper's",
    }
    return {**final, "which_m": which_m(final)}


def _over_draws(rows: Sequence[Report]) -> Report:
    ranks = [row["rank_of_C"] for row in rows]
    merged: Report = merge(list(rows))
    shares = {key: sum(row[key] for row in rows) / len(rows) for key in SHARES if key in merged}
    counts = {str(rank): ranks.count(rank) for rank in sorted(set(ranks))}
    return {**merged, **shares, "rank_of_C": counts}


def _over_matrices(cell: Cell, found: Sequence[Array]) -> Report:
    error = np.array(found) - cell.arm.C_theta
    return {
        "entry_rms": np.sqrt((error**2).mean(axis=0)).tolist(),
        "entry_bias": error.mean(axis=0).tolist(),
        "min_eigenvalues": [float(eigenvalues(C)[0][0]) for C in found],
    }


def _paper(cell: Cell, campaign: FullPose, printed: Any, truth: Dataset) -> Report | None:
    """The printed matrix judged as ours are, on the check loads of the first draw."""
    if printed is None:
        return None
    C = np.array(printed)
    return {**judge(cell, campaign, C, truth), "conservative": bool((C == C.T).all())}


def _paired(results: Sequence[Report], other: str) -> Report:
    """In how many draws GCO has the smaller error of the two on the same data."""
    keys = [(group, key) for group in ("prediction", "entries") for key in results[0]["models"][GCO][group]]
    wins = {
        key: sum(bool(r["models"][GCO][group][key] < r["models"][other][group][key]) for r in results)
        for group, key in keys
        if "relative" not in key
    }
    return {"draws": len(results), "gco_better": wins}


def _first(C: Array) -> Report:
    matrix, symmetric = eigenvalues(C)
    return {
        "matrix": C.tolist(),
        "eigenvalues_matrix": matrix.tolist(),
        "eigenvalues_symmetric_part": symmetric.tolist(),
    }
