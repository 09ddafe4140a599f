"""report.json of section 5.1: all draws together."""

import math
from collections.abc import Sequence

import numpy as np

from testbench.bench.campaign import Cell
from testbench.bench.full_pose import FullPose
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.factorised import order_range
from testbench.studies.paper import EQ_22, EQ_23
from testbench.studies.single_link.printed import printed_matrices
from testbench.studies.single_link.trial import (
    GCO,
    LEAST_SQUARES,
    NAME,
    SYMMETRIC,
    Draw,
    Study,
    eigenvalues,
    judge,
    models,
)
from testbench.studies.single_link.words import which_m
from testbench.views.report import MM, UM, Report, merge

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
