"""What the data cannot see, as a study: the KR 500 under gravity, with and without a prior, right or wrong.

Every method sees the same runs. Errors are those of the true deflections in poses never measured.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from testbench.bench.campaign import Campaign, Cell, Scenario, build_cell, named_models, simulate, stream
from testbench.data.dataset import Dataset
from testbench.data.outliers import spoil
from testbench.errors import Array
from testbench.identify import Estimate, Method, gco, least_squares, reduce, robust, with_prior
from testbench.identify.crossval import (
    FOLDS,
    Fold,
    Regularised,
    choose_strength,
    fold_poses,
    held_out_errors,
    one_standard_error,
)
from testbench.identify.evaluate import predict, score
from testbench.identify.method import ROBUST_UNCERTAINTY
from testbench.identify.metric import Metric, metric, rescaled
from testbench.identify.prior import Prior, Strength, cad_prior, distorted
from testbench.identify.regression import Regression
from testbench.identify.regularised import gco_least_trace, gco_with, least_squares_with
from testbench.identify.stein import gco_stein
from testbench.model.structure import Structure, all153, mgco47, mgco68, mgco147, template56
from testbench.views.report import Report, estimate_report, merge, score_report

NAME = "identifiability"
SHAPE = 0.3
"""Standard deviation of the logarithm of each axis's own factor in a prior that is wrong in shape."""
SCALES = (0.2, 0.5, 1.0, 2.0, 5.0)
POSES = (5, 8, 12, 20, 40)
SCALE = 2.0
"""Scale of the wrong prior where only one is tried."""
NO_WORSE = 1.001
"""Ratio of two errors up to which one is no worse: the solvers' digits."""
BELIEVED = 1e-6
"""Relative uncertainty of a scale that is believed."""
SPOILED, SPOILED_BY = 0.05, 1e-3
"""Share of marker readings that are outliers, and by how much [m]."""

STRUCTURES: dict[str, Callable[[Cell], Structure]] = {
    "joints": lambda cell: Structure.of(cell.arm, joints=[j.name for j in cell.arm.joints], name="joints"),
    "MGCO47": lambda cell: mgco47(cell.arm),
    "MGCO56": lambda cell: template56(cell.arm),
    "MGCO68": lambda cell: mgco68(cell.arm),
    "MGCO147": lambda cell: mgco147(cell.arm),
    "ALL153": lambda cell: all153(cell.arm),
}
PLAIN = ("MLS56", "MGCO56", "MGCO68")
"""Models without a prior."""
METHODS: dict[str, Regularised] = {
    "LS + prior": least_squares_with,
    "GCO + prior": gco_with,
    "GCO + log-det": gco_stein,
}


@dataclass(frozen=True)
class Study:
    """What is tried, beyond what every campaign shares.

    Attributes:
        structures: Names of `STRUCTURES` with a prior.
        scales: Factors by which the prior is wrong.
        poses: Numbers of identification poses.
        choice: Names of `STRUCTURES` among which cross-validation chooses.
    """

    structures: tuple[str, ...] = ("MGCO56", "MGCO68", "ALL153")
    scales: tuple[float, ...] = SCALES
    poses: tuple[int, ...] = POSES
    choice: tuple[str, ...] = ("joints", "MGCO47", "MGCO56", "MGCO68", "MGCO147", "ALL153")


def trials(
    folder: Path, scenario: Scenario, study: Study, clock: Callable[[], float], seeds: Sequence[int]
) -> list[Report]:
    """Reports of some seeds.

    Args:
        folder: The arm's.
        scenario: The campaign; its truth and number of poses are varied.
        study: What is tried.
        clock: Wall time [s].
        seeds: Roots of randomness.
    """
    cell = build_cell(folder)
    return [_trial(cell, scenario, study, seed, clock) for seed in seeds]


def _trial(cell: Cell, scenario: Scenario, study: Study, seed: int, clock: Callable[[], float]) -> Report:
    linear, bent = (
        simulate(cell, scenario.model_copy(update={"truth": truth}), seed)
        for truth in ("linear", "nonlinear")
    )
    prior = _wrong(cell, SCALE, seed)
    return {
        "seed": seed,
        "models": _all_methods(cell, linear, prior, study, clock),
        "nonlinear": _all_methods(cell, bent, prior, study, clock),
        "scales": [
            {"scale": scale, **_prior_only(cell, linear, _wrong(cell, scale, seed))} for scale in study.scales
        ],
        "fixed_scale": _fixed_scale(cell, linear, prior),
        "poses": [_poses(cell, scenario, count, prior, seed) for count in study.poses],
        "choice": _choice(cell, linear, prior, study),
        "outliers": _outliers(cell, linear, prior, seed),
    }


def _wrong(cell: Cell, scale: float, seed: int) -> Prior:
    return distorted(cad_prior(cell.arm), scale=scale, shape=SHAPE, rng=stream(seed, 5))


def _all_methods(
    cell: Cell, campaign: Campaign, prior: Prior, study: Study, clock: Callable[[], float]
) -> list[Report]:
    data = campaign.identification
    rows = []
    for name in PLAIN:
        [model] = named_models(cell, [name])
        rows.append(
            _row(cell, campaign, name, partial(model.estimator, cell.vjm, model.structure, data), clock)
        )
    for name in study.structures:
        structure = STRUCTURES[name](cell)
        own = _metric(cell, data, structure, prior)
        least_trace = partial(gco_least_trace, reduce(cell.vjm, structure, data), own)
        rows.append(_row(cell, campaign, f"{name}, least trace", least_trace, clock))
        folds = fold_poses(cell.vjm, structure, data, _folds(data))
        for method, fit in METHODS.items():
            strength, _ = choose_strength(folds, own, fit)
            if fit is least_squares_with:
                same = gco_with(reduce(cell.vjm, structure, data), own, strength)
            call = partial(fit, reduce(cell.vjm, structure, data), own, strength)
            row = _row(cell, campaign, f"{name}, {method}", call, clock)
            rows.append({**row, "uncertainty_percent": 100 * strength.uncertainty})
            if fit is least_squares_with:
                ratio = _workspace_mm(cell, campaign, same) / row["workspace"]["rms_mm"]
                rows[-1]["gco_over_ls_at_this_strength"] = ratio
    return rows


def _metric(cell: Cell, data: Dataset, structure: Structure, prior: Prior) -> Metric:
    """The metric of a prior in the scale of the data."""
    return rescaled(metric(prior, cell.vjm, structure), reduce(cell.vjm, structure, data))


def _folds(data: Dataset) -> int:
    return min(FOLDS, len(np.unique(data.pose)))


def _row(
    cell: Cell, campaign: Campaign, name: str, call: Callable[[], Estimate], clock: Callable[[], float]
) -> Report:
    start = clock()
    estimate = call()
    seconds = clock() - start
    sets = {
        "identification": campaign.identification,
        "check": campaign.check,
        "workspace": campaign.workspace,
    }
    return {
        **estimate_report(name, estimate, seconds),
        **{
            group: score_report(score(predict(cell.vjm, estimate, data), data.deflection))
            for group, data in sets.items()
        },
        "uncertainty_percent": None,
        "paper": None,
    }


def _workspace_mm(cell: Cell, campaign: Campaign, estimate: Estimate) -> float:
    """RMS error over the workspace [mm]."""
    data = campaign.workspace
    return 1e3 * score(predict(cell.vjm, estimate, data), data.deflection).rms


def _fit(cell: Cell, data: Dataset, name: str, method: Method) -> Estimate:
    """A named structure's unknowns by a method."""
    return method(cell.vjm, STRUCTURES[name](cell), data)


def _prior_only(cell: Cell, campaign: Campaign, prior: Prior) -> Report:
    """Errors over the workspace with a prior, by structure and method [mm]."""
    return {
        f"{name}, {method}": _workspace_mm(
            cell, campaign, _fit(cell, campaign.identification, name, with_prior(plain, prior))
        )
        for name in ("MGCO56", "MGCO68")
        for method, plain in (("LS + prior", least_squares), ("GCO + prior", gco))
    }


def _fixed_scale(cell: Cell, campaign: Campaign, prior: Prior) -> Report:
    """The same prior with its scale believed: what leaving it to the data is worth [mm]."""
    data, found = campaign.identification, {}
    for name in ("MGCO56", "MGCO68"):
        structure = STRUCTURES[name](cell)
        own = metric(prior, cell.vjm, structure)
        folds = fold_poses(cell.vjm, structure, data, _folds(data))
        strength, _ = choose_strength(folds, own, _believed)
        found[name] = _workspace_mm(
            cell, campaign, _believed(reduce(cell.vjm, structure, data), own, strength)
        )
    return found


def _believed(regression: Regression, own: Metric, strength: Strength) -> Estimate:
    """GCO with a prior whose scale is believed."""
    return gco_with(regression, own, Strength(strength.uncertainty, BELIEVED))


def _poses(cell: Cell, scenario: Scenario, count: int, prior: Prior, seed: int) -> Report:
    """Errors over the workspace from so many poses, each measured about twice [mm]."""
    runs = round(count * scenario.identification_runs / scenario.identification_poses)
    update = {"truth": "linear", "identification_poses": count, "identification_runs": runs}
    campaign = simulate(cell, scenario.model_copy(update=update), seed)
    data = campaign.identification
    found = {m.name: m.estimator(cell.vjm, m.structure, data) for m in named_models(cell, PLAIN)}
    for name in ("MGCO56", "MGCO68"):
        found[f"{name}, GCO + prior"] = _fit(cell, data, name, with_prior(gco, prior))
    return {"poses": count, **{name: _workspace_mm(cell, campaign, e) for name, e in found.items()}}


def _choice(cell: Cell, campaign: Campaign, prior: Prior, study: Study) -> Report:
    """Cross-validated errors of every structure with the prior, and which one the rule recommends."""
    data = campaign.identification
    errors: dict[str, tuple[int, Array]] = {}
    workspace = {}
    for name in study.choice:
        structure = STRUCTURES[name](cell)
        own = _metric(cell, data, structure, prior)
        folds: list[Fold] = fold_poses(cell.vjm, structure, data, _folds(data))
        strength, _ = choose_strength(folds, own, gco_with)

        fit = partial(gco_with, metric=own, strength=strength)
        errors[name] = structure.n, held_out_errors(folds, fit)
        workspace[name] = _workspace_mm(cell, campaign, fit(reduce(cell.vjm, structure, data)))
    chosen = one_standard_error(errors)
    return {
        "chosen": {name: name == chosen for name in errors},
        "held_out_f_m": {name: float(e.mean()) for name, (_, e) in errors.items()},
        "workspace_mm": workspace,
        "chosen_workspace_mm": workspace[chosen],
        "best_workspace_mm": min(workspace.values()),
    }


def _outliers(cell: Cell, campaign: Campaign, prior: Prior, seed: int) -> Report:
    """What outliers cost with and without the robust loss, at one strength of the prior [mm]."""
    structure, strength = STRUCTURES["MGCO68"](cell), Strength(ROBUST_UNCERTAINTY)
    spoiled, where = spoil(campaign.identification, SPOILED, SPOILED_BY, stream(seed, 6))
    clean, plain = (
        gco_with(reduce(cell.vjm, structure, data), _metric(cell, data, structure, prior), strength)
        for data in (campaign.identification, spoiled)
    )
    fit = robust(with_prior(gco, prior, strength))(cell.vjm, structure, spoiled)
    return {
        "spoiled": int(where.sum()),
        "rejected": len(fit.rejected),
        "clean_mm": _workspace_mm(cell, campaign, clean),
        "plain_mm": _workspace_mm(cell, campaign, plain),
        "robust_mm": _workspace_mm(cell, campaign, fit),
    }


def summary(folder: Path, scenario: Scenario, first: Campaign, reports: Sequence[Report]) -> Report:
    """report.json of all seeds.

    Args:
        folder: The arm's.
        scenario: The campaign.
        first: That of the first seed.
        reports: One a seed.
    """
    seeds = [r["seed"] for r in reports]
    merged = {key: merge([r[key] for r in reports]) for key in reports[0] if key != "seed"}
    size = 1e3 * np.linalg.norm(first.measured.deflection, axis=-1)
    return {
        "scenario": NAME,
        "seed": seeds[0] if len(seeds) == 1 else seeds,
        "arm": folder.resolve().name,
        "payload_kg": scenario.payload,
        "noise": scenario.noise,
        "truth": "linear",
        "prior": {"scale": SCALE, "shape_percent": 100 * SHAPE},
        "dataset": {
            "runs": first.identification.runs,
            "points": first.identification.points,
            "poses": scenario.identification_poses,
            "workspace_poses": scenario.workspace_poses,
            "deflection_min_mm": float(size.min()),
            "deflection_max_mm": float(size.max()),
            "sigma_um": 1e6 * scenario.sigma,
        },
        **merged,
        "never_worse": _never_worse(reports),
    }


def _never_worse(reports: Sequence[Report]) -> Report:
    """Seed by seed: GCO against LS with the same prior, believed as firmly, by structure."""
    ratios: dict[str, list[float]] = {}
    for report in reports:
        for m in report["models"]:
            if "gco_over_ls_at_this_strength" in m:
                ratios.setdefault(m["name"].split(",")[0], []).append(m["gco_over_ls_at_this_strength"])
    return {
        name: {
            "worst_ratio": max(found),
            "best_ratio": min(found),
            "seeds_worse": sum(ratio > NO_WORSE for ratio in found),
            "seeds": len(found),
        }
        for name, found in ratios.items()
    }
