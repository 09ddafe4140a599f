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


def _of_every_order(cell: Cell, data: Dataset, starts: int, seed: int) -> Iterable[tuple[int, Estimate]]:
    structure = models(cell)[-1].structure
    for m in range(1, LARGEST_ORDER + 1):
        rng = stream(seed, 10 + m)
        yield m, gco_factorised(cell.vjm, structure, data, rng=rng, m=m, starts=starts)


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
        "optimum_prediction": _prediction_errors(best.C_theta, truth),
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
    found = printed_matrices(cell, study, first.truth)
    printed = {
        LEAST_SQUARES: _paper(cell, campaign, np.array(EQ_22), first.truth) | {"f_m": 0.0},
        GCO: _paper(cell, campaign, np.array(EQ_23), first.truth)
        | {"f_m": found["eq_23_from_the_data_of_eq_22"]["printed_f_m"]}
        | dict.fromkeys(("negative_eigenvalue", "negative_eigenvalue_matrix")),  # within its rounding
    }
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
                "paper": printed.get(model.name),
            }
            for model in models(cell)
        ],
        "paired": {other: _paired(results, other) for other in (LEAST_SQUARES, SYMMETRIC)},
        "order_draws": sum("order" in r for r in results),
        "order_range": list(order_range(models(cell)[-1].structure, data.runs)),
        "order": [
            _over_draws(rows) for rows in zip(*(r["order"] for r in results if "order" in r), strict=True)
        ],
        "eq_22_23": found,
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


def _paper(cell: Cell, campaign: FullPose, C: Array, truth: Dataset) -> Report:
    """A printed matrix judged as ours are, on the check loads of the first draw; without its rank."""
    found = judge(cell, campaign, C, truth)
    found.pop("rank_of_C")  # digits that are not printed decide it
    return {"conservative": found["symmetric"], **found}


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


def which_m(report: Report) -> str:
    """The answer to "which m" in one sentence, with its numbers."""
    low, high = report["order_range"]
    *smaller, full = [row for row in report["order"] if low <= row["m"]]
    parts = [
        f"m = {row['m']} {_reached(row['reaches_optimum'])} ({_excess(row['f_m_over_optimum'])}, "
        f"{_position_error(row)} um)"
        for row in smaller
    ]
    return (
        f"Which m? Eq. (20) allows {low:g} to {high:g}. m = 6 {_reached(full['reaches_optimum'])} the "
        "certified "
        f"optimum of F_M (position error {_position_error(full)} um); {'; '.join(parts)}. Medians of "
        f"{report['order_draws']} draws."
    )


def _reached(share: float) -> str:
    words = {0.0: "never reaches", 1.0: "always reaches"}
    return words.get(share, f"in {100 * share:.0f} % of draws reaches")


def _excess(ratio: Any) -> str:
    """Median F_M over the optimum in words, and the 95th percentile where that is another."""
    high = ratio["p95"] if isinstance(ratio, dict) else ratio
    share = [100 * max(0.0, x - 1) for x in (middle(ratio), high)]
    return f"F_M {share[0]:.0f} % above it, 95 % of draws below {share[1]:.0f} %"


def _position_error(row: Report) -> str:
    return f"{middle(row['prediction']['position_rms_um']):.1f}"


ROWS: tuple[tuple[str, tuple[str, ...], str, float], ...] = (
    ("conservative, %", ("conservative",), ".1f", 100),
    ("symmetric, %", ("symmetric",), ".1f", 100),
    ("an eigenvalue < 0, %", ("negative_eigenvalue_matrix",), ".1f", 100),
    ("  of symmetric part, %", ("negative_eigenvalue",), ".1f", 100),
    ("smallest eigenvalue, 1e-6", ("min_eigenvalue_matrix",), ".3f", 1e6),
    ("  of symmetric part, 1e-6", ("min_eigenvalue",), ".3f", 1e6),
    ("F_M", ("f_m",), ".2f", 1),
    ("F_M floor", ("f_m_floor",), ".2f", 1),
    ("position error, um", ("prediction", "position_rms_um"), ".1f", 1),
    ("  of the deflection, %", ("prediction", "position_relative_percent"), ".2f", 1),
    ("rotation error, urad", ("prediction", "rotation_rms_urad"), ".0f", 1),
    ("  of the rotation, %", ("prediction", "rotation_relative_percent"), ".2f", 1),
    ("C force-position, um/N", ("entries", "translation_rms_um_per_N"), ".2f", 1),
    ("C moment-pos., um/(N m)", ("entries", "coupling_translation_rms_um_per_Nm"), ".2f", 1),
    ("C force-rot., urad/N", ("entries", "coupling_rotation_rms_urad_per_N"), ".2f", 1),
    ("C mom.-rot., urad/(N m)", ("entries", "rotation_rms_urad_per_Nm"), ".2f", 1),
)
"""Rows of the table: words, place in a model's report, format, unit."""


def _cell(model: Report | None, path: tuple[str, ...], form: str, factor: float, *, spread: bool) -> str:
    value: Any = model
    for key in path:
        value = None if value is None else value.get(key)
    if value is None:
        return "-"
    if isinstance(value, dict):
        value = {key: factor * x for key, x in value.items()}
        return show(value, form) if spread else format(value["median"] + 0.0, form)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return format(factor * value, form).replace("-0.00", "0.00")


def title(report: Report) -> str:
    """What was measured, in one line."""
    data = report["dataset"]
    loads = "10 N or 10 N m along one axis" if report["loads"] == "axes" else "random within 10 N and 10 N m"
    return (
        f"{report['scenario']}: Eq. (21), {data['runs']} loads ({loads}), noise of a deflection "
        f"{data['sigma_of_a_deflection_um']:g} um and {data['sigma_of_a_deflection_urad']:g} urad, "
        f"{report['draws']} draws from seed {report['seed']}; medians"
    )


def table(report: Report) -> Table:
    """All models, and the paper's printed matrices, for a terminal of 80 columns."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    shown.add_column("", no_wrap=True)
    rows = report["models"]
    for m in rows:
        shown.add_column(m["name"], justify="right", no_wrap=True)
    for words in ("Eq. (22)\nLS", "Eq. (23)\nGCO"):
        shown.add_column(words, justify="right", no_wrap=True, style="italic")
    printed = [m["paper"] for m in rows if m["paper"]]
    for name, path, form, factor in ROWS:
        shown.add_row(name, *(_cell(m, path, form, factor, spread=False) for m in (*rows, *printed)))
    return shown


def verdict(report: Report) -> str:
    """What a person should take home."""
    ls, symmetric, ours = report["models"]
    pairs = {other: report["paired"][other]["gco_better"] for other in (LEAST_SQUARES, SYMMETRIC)}
    draws = report["draws"]

    lines = [
        f"GCO is conservative in {100 * ours['conservative']:.4g} % of {draws} draws, LS in "
        f"{100 * ls['conservative']:.4g} %: it is never symmetric, and has a negative eigenvalue in "
        f"{100 * ls['negative_eigenvalue_matrix']:.0f} % (its symmetric part in "
        f"{100 * ls['negative_eigenvalue']:.0f} %).",
        "LS has F_M = 0: 36 equations for 36 unknowns fit the noise exactly.",
        f"GCO predicts positions better than LS in {pairs[LEAST_SQUARES]['position_rms_um']} of {draws} "
        "draws "
        f"({_position_error(ours)} against {_position_error(ls)} um), rotations in "
        f"{pairs[LEAST_SQUARES]['rotation_rms_urad']}. Most "
        f"of it is symmetry: LS with 21 entries has {_position_error(symmetric)} um (and is conservative in "
        f"{100 * symmetric['conservative']:.0f} %); GCO beats that in {pairs[SYMMETRIC]['position_rms_um']}.",
        report["which_m"],
        _words_on_eq_23(report["eq_22_23"]["eq_23_from_the_data_of_eq_22"]),
    ]
    if report["loads"] == "random":
        share = report["condition_of_the_loads"]
        lines.append(
            f"Random loads: condition number {show(share, '.1f')} instead of 1; LS passes it on in full, GCO "
            f"in part, and errors of one draw may be many times those under axis loads."
        )
    return "\n".join(lines)


def _words_on_eq_23(found: Report) -> str:
    four = found["order"][3]
    return (
        "The paper's own data (Eq. 22 read column by column) have their optimum at F_M "
        f"{found['optimum_f_m']:.3f}, "
        f"rank {found['optimum_rank']}; the printed Eq. (23) has {found['printed_f_m']:.3f} and, within its "
        f"rounding, rank {found['rank_within_rounding']}: m = 4 (inferred), whose best is {four['f_m']:.3f}."
    )


def first_draw(report: Report) -> str:
    """LS and GCO of the first draw side by side in 80 columns, with their eigenvalues."""
    ls, ours = (report["first_draw"][name] for name in (LEAST_SQUARES, GCO))
    pairs = zip(ls["matrix"], ours["matrix"], strict=True)
    lines = [f"{'first draw, 1e-6 SI: LS':<37}    {'GCO'}"]
    lines += [f"{_short_row(a)}    {_short_row(b)}" for a, b in pairs]
    lines += ["eigenvalues"]
    lines += [f"{_short_row(ls['eigenvalues_matrix'])}    {_short_row(ours['eigenvalues_symmetric_part'])}"]
    return "\n".join(lines)


def _short_row(values: Sequence[float]) -> str:
    return " ".join(f"{_short(UM * value):>5}" for value in values)


def _short(value: float) -> str:
    digits = 2 if abs(value) < 10 else 1 if abs(value) < 100 else 0
    return f"{value:.{digits}f}".replace("-0.00", "0.00")


def where(out: Path) -> str:
    """Where the results are."""
    return (
        f"numbers    {out / 'report.json'}, {out / 'report.md'}\n"
        f"readings   {out / 'dataset.csv'} (first draw)\n"
        f"figure     {out / 'single_link.png'}\n"
        f"to repeat  {out / 'manifest.json'}"
    )


def markdown(report: Report) -> str:
    """report.md: verdict, tables, what the printed matrices tell, matrices of the first draw."""
    rows = report["models"]
    printed = [m["paper"] for m in rows if m["paper"]]
    head = ["", *(m["name"] for m in rows), "paper, Eq. (22), LS", "paper, Eq. (23), GCO"]
    body = [
        [
            name.strip(),
            *(_cell(m, path, form, factor, spread=True) for m in (*rows, *printed)),
        ]
        for name, path, form, factor in ROWS
    ]
    ranks = [", ".join(f"{rank}: {count}" for rank, count in m["rank_of_C"].items()) for m in rows]
    body.append(["rank: draws", *ranks, "-", "-"])
    first, *others = verdict(report).split("\n")
    blocks = [
        f"# {report['scenario']}",
        f"{title(report)} (5 % to 95 % of the draws).",
        f"**{first}**",
        *others,
        "\n".join(grid(head, body)),
        "LS has 36 equations for 36 unknowns: F_M = 0 whatever the noise, so F_M says nothing of it. The "
        "floor is "
        "that of noise spread evenly over both terms of F_M, 2 sqrt(3 (1 - 21/36)); with 15 equations to "
        "spare "
        "the RMS of so few stays below its own root mean square, and GCO, which minimises the sum of two "
        "RMS, "
        "moves misfit to the cheaper term. MLS21 is not in the paper: least squares with symmetry and "
        "nothing "
        "else. Prediction errors are distances from the true deflection over "
        f"{report['dataset']['check_runs']} fresh loads spread over |F| <= 10 N, |M| <= 10 N m; entry "
        "errors are "
        "RMS over the nine entries of a block. The paper's columns are its printed matrices under the check "
        "loads of our first draw. An eigenvalue is of the matrix in mixed SI units, as the paper's.",
        *_paired_words(report),
        "## The order m",
        "\n".join(_order_table(report)),
        "## What the printed Eq. (22) and (23) tell",
        *_printed_words(report["eq_22_23"]),
        "## One draw in the manner of Eq. (22) and (23)",
        f"Seed {report['seed']}; dataset.csv holds its readings.",
        *_matrices(report),
    ]
    return "\n\n".join(blocks) + "\n"


def _paired_words(report: Report) -> list[str]:
    head = ["draws in which GCO is closer to the truth", "than MLS36", "than MLS21"]
    wins = [report["paired"][other]["gco_better"] for other in (LEAST_SQUARES, SYMMETRIC)]
    return ["\n".join(grid(head, [[key, *(str(w[key]) for w in wins)] for key in wins[0]]))]


def _order_table(report: Report) -> list[str]:
    head = ["m", "F_M", "F_M / optimum", "reaches it, %", "rank: draws", "eigenvalues, 1e-6 (medians)"]
    head += ["position error, um", "rotation error, urad"]
    body = [
        [
            str(row["m"]),
            show(row["f_m"], ".3f"),
            show(row["f_m_over_optimum"], ".4f"),
            f"{100 * row['reaches_optimum']:.0f}",
            ", ".join(f"{rank}: {count}" for rank, count in row["rank_of_C"].items()),
            " ".join(_short(UM * middle(value)) for value in row["eigenvalues"]),
            show(row["prediction"]["position_rms_um"], ".1f"),
            show(row["prediction"]["rotation_rms_urad"], ".0f"),
        ]
        for row in report["order"]
    ]
    return grid(head, body)


def _printed_words(found: Report) -> list[str]:
    pin, own = found["pinning"], found["eq_23_from_the_data_of_eq_22"]
    columns = " ".join(f"{value:.2f}" for value in pin["position_rms_by_column_over_sigma"])
    expected = pin["negative_eigenvalue_expected"]
    deflection, reading = (
        f"{100 * expected[key]['of_the_matrix']:.0f} % (symmetric part "
        f"{100 * expected[key]['of_its_symmetric_part']:.0f} %)"
        for key in ("if_sigma_is_of_a_deflection", "if_sigma_is_of_a_reading")
    )
    low, high = own["printed_f_m_within_rounding"]
    small = own["eigenvalues_within_rounding"][1]
    best = own["optimum_prediction"]
    return [
        f"Eq. (22) differs from Eq. (21) by an RMS of {pin['position_rms_over_sigma']:.2f} times 25 um / "
        "10 N in "
        f"its translation rows (by column {columns}) and {pin['rotation_rms_over_sigma']:.2f} times 0.25 "
        "mrad / "
        f"10 N m in its rotation rows; the standard error of each is {pin['standard_error_percent']:.0f} "
        "%. Single-"
        "axis loads of 10 N and 10 N m read the columns of C directly and give 1.00 if sigma is the noise "
        "of a "
        "deflection, 1.41 if it is that of each of its two readings. Of all 36 entries the RMS is "
        f"{pin['rms_over_sigma']:.2f}: as large or larger with p = "
        f"{pin['p_as_large_if_sigma_is_of_a_deflection']:.2f} in the first case, as small or smaller with "
        "p = "
        f"{pin['p_as_small_if_sigma_is_of_a_reading']:.2f} in the second, a likelihood ratio of "
        f"{pin['likelihood_ratio_deflection_to_reading']:.1f} for the deflection: likely, not proven. Six "
        "random "
        f"loads would give {show(pin['random_loads_rms_over_sigma'], '.1f')}, as small in "
        f"{100 * pin['random_loads_share_as_small']:.1f} % of cases.",
        f"A negative eigenvalue is to be expected in {deflection} of draws if sigma is that of a "
        "deflection, in "
        f"{reading} if it is that of a reading.",
        f"Eigenvalues of Eq. (22): {_exact(found['eq_22']['eigenvalues_matrix'])}; of its symmetric part: "
        f"{_exact(found['eq_22']['eigenvalues_symmetric_part'])}. Of Eq. (23): "
        f"{_exact(found['eq_23']['eigenvalues'])}. Matrices that round to Eq. (23) have a second "
        "eigenvalue of "
        f"{small[0]:.1e} to {small[1]:.1e}: two are zero within rounding, rank "
        f"{own['rank_within_rounding']}.",
        "Eq. (22) times 10 is the paper's dataset. Its certified optimum over all conservative matrices "
        "has F_M "
        f"{own['optimum_f_m']:.3f} and rank {own['optimum_rank']}; Eq. (23) has {own['printed_f_m']:.3f} "
        f"({low:.2f} to {high:.2f} within rounding). Against the truth the optimum errs by "
        f"{best['position_rms_um']:.1f} um and {best['rotation_rms_urad']:.0f} urad under our check loads.",
        "\n".join(
            grid(
                [
                    "m",
                    "F_M on the paper's data",
                    "eigenvalues, 1e-6",
                    "RMS distance to Eq. (23), sigma / 10 N",
                ],
                [
                    [
                        str(row["m"]),
                        f"{row['f_m']:.3f}",
                        " ".join(_short(UM * value) for value in row["eigenvalues"]),
                        f"{row['rms_to_eq_23_over_sigma']:.2f}",
                    ]
                    for row in own["order"]
                ],
            )
        ),
    ]


def _exact(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.2e}" for value in values)


def _matrices(report: Report) -> list[str]:
    printed = report["eq_22_23"]
    named = (
        ("Eq. (21), truth", report["truth_matrix"]),
        ("LS, first draw", report["first_draw"][LEAST_SQUARES]["matrix"]),
        ("Eq. (22), the paper's LS", printed["eq_22"]["matrix"]),
        ("GCO, first draw", report["first_draw"][GCO]["matrix"]),
        ("Eq. (23), the paper's GCO", printed["eq_23"]["matrix"]),
        ("GCO, certified optimum on the data of Eq. (22)",
         printed["eq_23_from_the_data_of_eq_22"]["optimum_matrix"]),
    )  # fmt: skip
    blocks = []
    for name, matrix in named:
        rows = "\n".join(" ".join(f"{value:10.2e}" for value in row) for row in matrix)
        matrix_values, symmetric_values = eigenvalues(np.array(matrix))
        values = f"eigenvalues                {_exact(matrix_values.tolist())}"
        if matrix != np.transpose(matrix).tolist():
            values += f"\nof the symmetric part      {_exact(symmetric_values.tolist())}"
        blocks.append(f"{name}:\n\n```\n{rows}\n\n{values}\n```")
    return blocks
