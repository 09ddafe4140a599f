"""From results to report.json, report.md and figures; what a reader sees is written from the report alone."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from testbench.bench.campaign import Campaign, Result
from testbench.identify import Estimate
from testbench.identify.certify import total_trace
from testbench.identify.evaluate import Normality, Score

Report = dict[str, Any]

MM, UM = 1e3, 1e6
SETS = ("identification", "check", "workspace")


def report(
    name: str, campaign: Campaign, results: Sequence[Result], paper: dict[str, dict[str, float]]
) -> Report:
    """The numbers of one seed, in the layout that checks rely on.

    Args:
        name: The scenario's name.
        campaign: What was measured.
        results: One a model.
        paper: The paper's known cells, by model.
    """
    size = MM * np.linalg.norm(campaign.measured.deflection, axis=-1)
    return {
        "scenario": name,
        "seed": campaign.seed,
        "arm": campaign.scenario.arm,
        "payload_kg": campaign.scenario.payload,
        "truth": campaign.scenario.truth,
        "noise": campaign.scenario.noise,
        "dataset": {
            "runs": campaign.measured.runs,
            "points": campaign.measured.points,
            "poses": len(np.unique(campaign.measured.pose)),
            "identification_runs": campaign.identification.runs,
            "identification_points": campaign.identification.points,
            "check_runs": campaign.check.runs,
            "check_points": campaign.check.points,
            "workspace_poses": campaign.workspace.runs,
            "deflection_min_mm": float(size.min()),
            "deflection_max_mm": float(size.max()),
            "sigma_um": UM * campaign.measured.sigma,
        },
        "models": [_model(result, paper) for result in results],
    }


def _model(result: Result, paper: dict[str, dict[str, float]]) -> Report:
    return {
        **estimate_report(result.model.name, result.estimate, result.seconds),
        **{name: score_report(getattr(result, name)) for name in SETS},
        "residuals": {
            "identification": _normality(result.fit_normality),
            "check": _normality(result.check_normality),
        },
        "paper": paper.get(result.model.name),
    }


def estimate_report(name: str, estimate: Estimate, seconds: float) -> Report:
    """What a method found, without its errors.

    Args:
        name: Of the model.
        estimate: What was found.
        seconds: Wall time of the estimator.
    """
    certificate = estimate.certificate
    return {
        "name": name,
        "method": estimate.method,
        "status": estimate.status,
        "parameters": estimate.structure.n,
        "rank": estimate.regression.rank,
        "unique": estimate.regression.rank == estimate.structure.n,
        "conservative": estimate.conservative,
        "min_eigenvalue": estimate.min_eigenvalue,
        "f_m": estimate.f_m,
        "f_m_floor": estimate.f_m_floor,
        "duality_gap": None if certificate is None else certificate.gap,
        "trace_bounds_rad_per_Nm": None if certificate is None else certificate.trace_bounds.tolist(),
        "held_by_trace_weight": estimate.held_by_trace_weight,
        "total_trace_rad_per_Nm": total_trace(estimate.structure, estimate.pi),
        "solve_seconds": seconds,
        "advice": list(estimate.advice),
    }


def score_report(score: Score) -> Report:
    """Distance errors in millimetres and per cent."""
    return {
        "rms_mm": MM * score.rms,
        "p95_mm": MM * score.p95,
        "max_mm": MM * score.max,
        "p95_relative_percent": None if score.p95_relative is None else 100 * score.p95_relative,
        "max_relative_percent": None if score.max_relative is None else 100 * score.max_relative,
    }


def _normality(normality: Normality) -> Report:
    return {
        "mean_um": UM * normality.mean,
        "std_um": UM * normality.std,
        "lilliefors_p": normality.p_value,
    }


def summarise(reports: Sequence[Report]) -> Report:
    """Reports of several seeds as one: every number becomes its median, 5th and 95th percentile.

    A truth value becomes the share of seeds in which it holds; what is the same in all seeds stays.

    Args:
        reports: One a seed, of the same scenario.
    """
    merged: Report = merge(list(reports))
    merged["seed"] = [r["seed"] for r in reports]
    for k, model in enumerate(merged["models"]):
        solved = sum(r["models"][k]["status"] == "solved" for r in reports)
        if solved < len(reports):
            model["status"] = f"solved in {solved} of {len(reports)} seeds"
    merged["paired"] = _paired(merged, reports)
    return merged


def _paired(merged: Report, reports: Sequence[Report]) -> Report | None:
    """In how many seeds the best conservative model beats the best least squares, on the same data."""
    rows = list(enumerate(merged["models"]))
    ours = [(middle(m["check"]["rms_mm"]), k) for k, m in rows if m["conservative"] is True]
    theirs = [(middle(m["check"]["rms_mm"]), k) for k, m in rows if m["method"] == "least squares"]
    if not ours or not theirs:
        return None
    a, b = min(ours)[1], min(theirs)[1]
    wins = {
        name: sum(r["models"][a][name]["rms_mm"] < r["models"][b][name]["rms_mm"] for r in reports)
        for name in ("check", "workspace")
        if name in merged["models"][a]
    }
    names = {"conservative": merged["models"][a]["name"], "least_squares": merged["models"][b]["name"]}
    return {**names, **wins, "seeds": len(reports)}


def merge(values: list[Any]) -> Any:
    """The same number, list or dictionary of several seeds as one, as in `summarise`."""
    first = values[0]
    if isinstance(first, dict):
        return {key: merge([v[key] for v in values]) for key in first}
    if all(v == first for v in values):
        return first
    if all(isinstance(v, bool) for v in values):
        return sum(values) / len(values)
    if all(isinstance(v, int | float) for v in values):
        p05, median, p95 = np.percentile(values, [5, 50, 95])
        return {"median": float(median), "p05": float(p05), "p95": float(p95)}
    if isinstance(first, list) and all(isinstance(v, list) and len(v) == len(first) for v in values):
        return [merge(list(column)) for column in zip(*values, strict=True)]
    return " | ".join(sorted({str(v) for v in values}))


def middle(value: Any) -> float:
    """The number, or the median where there are several seeds; NaN where there is none."""
    if isinstance(value, dict):
        return float(value["median"])
    return math.nan if value is None else float(value)


def show(value: Any, form: str = ".3f") -> str:
    """A number for people: the median, and the 5th to 95th percentile behind it.

    Args:
        value: A number, a summary of several seeds, or None.
        form: Format of a number.
    """
    if value is None:
        return "-"
    if isinstance(value, dict):
        return f"{value['median']:{form}} ({value['p05']:{form}} to {value['p95']:{form}})"
    return f"{value:{form}}"


def show_truth(value: bool | float) -> str:
    """Yes, no, or the share of seeds."""
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else f"{100 * value:.0f} %"
