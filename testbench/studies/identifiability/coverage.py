"""How often intervals hold the truth, over many simulated datasets: what a stated confidence is worth.

One reduced dataset gives poses, loads and sigmas; only the noise is drawn anew, in the coordinates of its
triangular factor. Intervals of one draw share its noise, so a share's standard error is over draws.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from testbench.bench.campaign import Cell, Scenario, Truth, build_cell, simulate, stream
from testbench.bench.full_pose import FullPose
from testbench.bench.full_pose import simulate as simulate_full_pose
from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.identify import Estimate, reduce
from testbench.identify.bootstrap import bootstrap, resampler
from testbench.identify.bounds import CEILING, bounds, fit_set
from testbench.identify.conic import optimum
from testbench.identify.intervals import linearise
from testbench.identify.least_squares import minimum_norm
from testbench.identify.metric import Metric, metric
from testbench.identify.prior import Strength, aggregate, cad_prior
from testbench.identify.regression import Regression
from testbench.identify.regularised import gco_with, least_squares_with
from testbench.model.structure import Structure, mgco68, template56
from testbench.model.vjm import observation
from testbench.trials import run_trials
from testbench.views.report import UM, Report

CONFIDENCE = 0.95
DRAWS_LS = 199
DRAWS_GCO = 39
"""Refits of a bootstrap: the interval's order statistics are exact for both."""
REJECTIONS = 1000
BENT_UNCERTAINTY, BENT_POSES = 0.3, 10
"""Of the prior, and poses to predict in, where the truth is not linear."""


@dataclass(frozen=True)
class Case:
    """What datasets are drawn for.

    Attributes:
        regression: Poses, loads and sigmas.
        metric: The structure in the metric of the CAD prior.
        truth: Parameters, (n,).
        functionals: Deflections asked for, (k, n).
    """

    regression: Regression
    metric: Metric
    truth: Array
    functionals: Array


Ends = tuple[Array, Array]
"""Lower and upper ends of intervals, (k,) each."""
Drawn = dict[str, tuple[Array, Array]]
"""Of one dataset and every method: whether each interval holds the truth, and its width, (k,) each."""


def full_pose_case(folder: Path, *, checks: int = 10, seed: int = 1) -> Case:
    """Section 5.2: full poses read, template of 56 unknowns, 32 directions and every deflection seen.

    Args:
        folder: The arm's.
        checks: Deflections in other poses under other wrenches, three components each.
        seed: Of poses and wrenches.
    """
    cell = build_cell(folder)
    structure = template56(cell.arm)
    campaign = simulate_full_pose(cell, FullPose(arm=folder.name, check_runs=checks), seed)
    regression = reduce(cell.vjm, structure, campaign.identification)
    m = metric(cad_prior(cell.arm), cell.vjm, structure)
    truth = structure.entries(aggregate(cell.arm.C_theta, cell.vjm, structure))
    where = campaign.check
    rows = _deflections(cell, structure, where, np.zeros((1, 3)))
    return Case(regression, m, truth, rows)


def gravity_case(
    folder: Path, structure: Callable[..., Structure], *, checks: int = 10, seed: int = 1
) -> Case:
    """Section 6: markers read under a hung weight; most deflections elsewhere are not seen.

    Args:
        folder: The arm's.
        structure: Of the arm, such as `template56`.
        checks: Poses all over the workspace; x, y and z of the first marker in each.
        seed: Of poses.
    """
    cell = build_cell(folder)
    s = structure(cell.arm)
    scenario = Scenario(arm=folder.name, truth="linear", workspace_poses=checks)
    campaign = simulate(cell, scenario, seed)
    regression = reduce(cell.vjm, s, campaign.identification)
    m = metric(cad_prior(cell.arm), cell.vjm, s)
    truth = s.entries(aggregate(cell.arm.C_theta, cell.vjm, s))
    where = campaign.workspace
    rows = _deflections(cell, s, where, cell.vjm.markers[:1])
    return Case(regression, m, truth, rows)


def fitted_coverage(
    case: Case, datasets: int, *, bootstraps: int | None = None, workers: int | None = None
) -> Report:
    """Intervals of least squares and GCO without a prior.

    Args:
        case: Where every functional is seen by the data.
        datasets: Datasets with linearised intervals.
        bootstraps: Those of them with bootstrap intervals too; None for all.
        workers: Processes; None for one a core.
    """
    some = datasets if bootstraps is None else bootstraps
    return _coverage(partial(_fitted, case, some), datasets, workers)


def posterior_coverage(
    case: Case, strength: Strength, datasets: int, *, workers: int | None = None
) -> Report:
    """Posterior intervals where the truth is a draw of the prior.

    The truth of every dataset is x = s e + u N(0, 1) in the metric, drawn again until it is conservative;
    s = 1 where the prior leaves the scale to the data, else s is drawn too.

    Args:
        case: Its truth is not used.
        strength: u, and the uncertainty of the scale.
        datasets: How many, each with a truth of its own.
        workers: Processes; None for one a core.
    """
    return _coverage(partial(_posterior, case, strength), datasets, workers)


def bound_coverage(
    case: Case, datasets: int, *, ceiling: float = CEILING, workers: int | None = None
) -> Report:
    """Set-based bounds: intervals that hold the truth, and datasets in which all do at once.

    Args:
        case: A truth that is conservative and below the ceiling.
        datasets: How many.
        ceiling: Times the prior.
        workers: Processes; None for one a core.
    """
    return _coverage(partial(_bounded, case, ceiling), datasets, workers)


def _fitted(case: Case, bootstraps: int, seeds: Sequence[int]) -> list[Drawn]:
    truth = case.functionals @ case.truth
    again = resampler(case.regression)
    found = []
    for seed in seeds:
        rng = stream(seed)
        regression = again(case.truth, rng)
        fits = {
            "least squares": (minimum_norm(regression), DRAWS_LS),
            "GCO": (optimum(regression), DRAWS_GCO),
        }
        row: Drawn = {}
        for name, (estimate, draws) in fits.items():
            seen = linearise(estimate).intervals(case.functionals, CONFIDENCE)
            row[f"{name}, linearised"] = _judge(truth, (seen.lower, seen.upper))
            if seed < bootstraps:
                again_seen = bootstrap(estimate, case.functionals, CONFIDENCE, draws=draws, rng=rng)
                row[f"{name}, bootstrap"] = _judge(truth, (again_seen.lower, again_seen.upper))
        found.append(row)
    return found


def _deflections(cell: Cell, structure: Structure, where: Dataset, targets: Array) -> Array:
    """Deflections of points of the tool as linear functionals of pi, (3 runs targets, n)."""
    args = (cell.vjm, structure, where.q, where.wrench, where.point)
    return observation(*args, targets=targets).reshape(-1, structure.n)


def _posterior(case: Case, strength: Strength, seeds: Sequence[int]) -> list[Drawn]:
    again = resampler(case.regression)
    found = []
    for seed in seeds:
        rng = stream(seed)
        pi = case.metric.L @ draw_conservative(case.metric, strength, rng)
        regression = again(pi, rng)
        fits: dict[str, Estimate] = {
            "least squares with prior": least_squares_with(regression, case.metric, strength),
            "GCO with prior": gco_with(regression, case.metric, strength),
        }
        row: Drawn = {}
        for name, estimate in fits.items():
            seen = linearise(estimate).intervals(case.functionals, CONFIDENCE)
            row[name] = _judge(case.functionals @ pi, (seen.lower, seen.upper))
        found.append(row)
    return found


def draw_conservative(metric: Metric, strength: Strength, rng: np.random.Generator) -> Array:
    """A conservative draw of a prior, x, (n,): normal draws until one is positive semi-definite.

    Raises:
        BenchError: When there is none: the uncertainty is too large for the blocks.
    """
    for _ in range(REJECTIONS):
        scale = 1.0
        if np.isfinite(strength.scale_uncertainty):
            scale += strength.scale_uncertainty * rng.standard_normal()
        x = scale * metric.expected + strength.uncertainty * rng.standard_normal(len(metric.expected))
        if all(np.linalg.eigvalsh(X)[0] >= 0 for X in metric.matrices(x)):
            return x
    raise BenchError(
        f"prior: expected a conservative model among {REJECTIONS} draws of uncertainty "
        f"{strength.uncertainty:g}, found none"
    )


def _bounded(case: Case, ceiling: float, seeds: Sequence[int]) -> list[Drawn]:
    truth = case.functionals @ case.truth
    again = resampler(case.regression)
    found: list[Drawn] = []
    for seed in seeds:
        models = fit_set(again(case.truth, stream(seed)), case.metric, CONFIDENCE, ceiling=ceiling)
        seen = bounds(models, case.functionals)
        found.append({models.name: _judge(truth, (seen.lower, seen.upper))})
    return found


def bent_coverage(folder: Path, truth: Truth, datasets: int, *, workers: int | None = None) -> Report:
    """Coverage under gravity where the arm is the same in every dataset, its truth linear or not.

    Every dataset has poses of its own. MGCO56 with the right CAD prior, uncertain by 30 %: what the linear
    model leaves out is in no interval.

    Args:
        folder: The arm's.
        truth: Kind of truth.
        datasets: How many.
        workers: Processes; None for one a core.
    """
    return _coverage(partial(_bent, folder, truth), datasets, workers)


def _bent(folder: Path, truth: Truth, seeds: Sequence[int]) -> list[Drawn]:
    cell = build_cell(folder)
    structure, strength = template56(cell.arm), Strength(BENT_UNCERTAINTY)
    own = metric(cad_prior(cell.arm), cell.vjm, structure)
    found: list[Drawn] = []
    for seed in seeds:
        scenario = Scenario(arm=folder.name, truth=truth, workspace_poses=BENT_POSES)
        campaign = simulate(cell, scenario, seed)
        regression, where = reduce(cell.vjm, structure, campaign.identification), campaign.workspace
        rows = _deflections(cell, structure, where, cell.vjm.markers[:1])
        seen = linearise(gco_with(regression, own, strength)).intervals(rows, CONFIDENCE)
        moved = where.deflection[:, 0].ravel()
        found.append({f"GCO with prior, {truth} truth": _judge(moved, (seen.lower, seen.upper))})
    return found


def _judge(truth: Array, ends: Ends) -> tuple[Array, Array]:
    """Whether intervals hold the truth, to a picometre; a NaN holds nothing."""
    lower, upper = ends
    inside = (lower - 1e-12 <= truth) & (truth <= upper + 1e-12)
    return inside.astype(float), upper - lower


def _coverage(study: Callable[[Sequence[int]], list[Drawn]], datasets: int, workers: int | None) -> Report:
    """Shares over draws and functionals by method."""
    if datasets < 2:
        raise BenchError(f"datasets: expected at least 2, got {datasets}")
    size = max(1, datasets // 40)
    chunks = run_trials(study, range(datasets), workers=workers, size=size)
    drawn = [row for chunk in chunks for row in chunk]
    names = dict.fromkeys(name for row in drawn for name in row)
    return {name: _summary([row[name] for row in drawn if name in row]) for name in names}


def _summary(rows: list[tuple[Array, Array]]) -> Report:
    """Share covered, its standard error by draws, and widths.

    Returns:
        "covered" and "standard_error" over draws and intervals; "all_covered", the share of draws in which
        every interval holds the truth; "least_covered" and "most_covered" of a single functional;
        "width_um", mean of the finite ones; "unbounded", share that is not finite; "datasets"; "intervals".
    """
    inside, width = (np.array(part) for part in zip(*rows, strict=True))
    by_draw, by_functional = inside.mean(axis=1), inside.mean(axis=0)
    finite = np.isfinite(width)
    return {
        "confidence": CONFIDENCE,
        "covered": float(inside.mean()),
        "standard_error": float(by_draw.std(ddof=1) / np.sqrt(len(by_draw))),
        "all_covered": float((by_draw == 1).mean()),
        "least_covered": float(by_functional.min()),
        "most_covered": float(by_functional.max()),
        "width_um": float(UM * width[finite].mean()) if finite.any() else None,
        "unbounded": float(1 - finite.mean()),
        "datasets": len(rows),
        "intervals": int(inside.size),
    }


def coverage_table(
    six_dof: Path, heavy: Path, datasets: int, *, bootstraps: int, workers: int | None = None
) -> dict[str, Report]:
    """Coverage of every kind of interval, by its name.

    Args:
        six_dof: Folder of the arm of section 5.2, whose predictions the data see wholly.
        heavy: Folder of the arm under gravity, where a prior decides the rest.
        datasets: How many of each kind.
        bootstraps: Of those with bootstrap intervals.
        workers: Processes; None for one a core.
    """
    case = full_pose_case(six_dof)
    found = fitted_coverage(case, datasets, bootstraps=bootstraps, workers=workers)
    rows = {f"{six_dof.name}, {name}": row for name, row in found.items()}
    for name, structure in (("MGCO56", template56), ("MGCO68", mgco68)):
        case = gravity_case(heavy, structure)
        found = posterior_coverage(case, Strength(0.1), datasets, workers=workers)
        rows |= {f"{heavy.name} {name}, {kind}": row for kind, row in found.items()}
        found = bound_coverage(case, max(2, datasets // 10), workers=workers)
        rows |= {f"{heavy.name} {name}, {kind}": row for kind, row in found.items()}
    return rows


def bent_table(heavy: Path, datasets: int, *, workers: int | None = None) -> dict[str, Report]:
    """Coverage of one arm under both truths, by the kind of truth."""
    truths: tuple[Truth, ...] = ("linear", "nonlinear")
    return {
        name: row
        for truth in truths
        for name, row in bent_coverage(heavy, truth, datasets, workers=workers).items()
    }
