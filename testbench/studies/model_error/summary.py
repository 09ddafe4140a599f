"""The study of model error as report.json: what every disturbance costs, beside the noise."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from testbench.studies.model_error.trial import ALL, NAME, NONE, STIFF, Study, sizes
from testbench.studies.spread import grouped, spread
from testbench.views.report import UM, Report

CLAIM = 0.048
"""Largest difference that the paper quotes between errors with and without a gravity compensator [1]."""
COMPENSATORS = ("gravity compensator", STIFF)


def summary(rows: Iterable[dict[str, Any]], study: Study, arm: str, seed: int, trials: int) -> Report:
    """report.json.

    Args:
        rows: Of all trials.
        study: What was tried.
        arm: Name of the arm.
        seed: First root of randomness.
        trials: How many.
    """
    found = grouped(
        rows, ("case", "model", "noise_um"), ("rms_um", "p95_um", "moved_um", "conservative", "solved")
    )
    return {
        "scenario": NAME,
        "seed": list(range(seed, seed + trials)) if trials > 1 else seed,
        "arm": arm,
        "noise": True,
        "truth": "nonlinear",
        "sigma_um": UM * study.sigma,
        "scale": study.scale,
        "trials": trials,
        "workspace_poses": study.workspace,
        "sizes": sizes(study.scale, study.only),
        "cells": [_cell(key, numbers, found) for key, numbers in found.items()],
        "claim": [
            _claim(found, model, case, study)
            for case in COMPENSATORS
            if any(key[0] == case for key in found)
            for model in _models(found)
        ],
        "models": [_model(found, model, case, study) for case in (NONE, ALL) for model in _models(found)],
    }


def _models(found: dict[tuple[Any, ...], Any]) -> list[str]:
    return list(dict.fromkeys(model for _, model, _ in found))


def _cell(
    key: tuple[Any, ...],
    numbers: dict[str, list[float]],
    found: dict[tuple[Any, ...], dict[str, list[float]]],
) -> Report:
    """One case, model and noise: its errors, and what the case adds to the same trial without it."""
    case, model, noise = key
    own, base = np.array(numbers["rms_um"]), np.array(found[NONE, model, noise]["rms_um"])
    return {
        "case": case,
        "model": model,
        "noise_um": noise,
        "rms_um": spread(numbers["rms_um"]),
        "p95_um": spread(numbers["p95_um"]),
        "added_um": spread((own - base).tolist()),
        "moved_um": spread(numbers["moved_um"]),
        "conservative": float(np.mean(numbers["conservative"])),
        "solved": float(np.mean(numbers["solved"])),
    }


def _claim(
    found: dict[tuple[Any, ...], dict[str, list[float]]], model: str, case: str, study: Study
) -> Report:
    """Errors with a compensator over those without: against readings, as in the paper, and the truth."""
    noise = UM * study.sigma
    true = [np.array(found[name, model, noise]["rms_um"]) for name in (case, NONE)]
    read = [np.sqrt(values**2 + 6 * noise**2) for values in true]  # two readings of three axes
    return {
        "case": case,
        "model": model,
        "against_truth": spread((true[0] / true[1] - 1).tolist()),
        "against_readings": spread((read[0] / read[1] - 1).tolist()),
        "within_claim": float(np.mean(np.abs(read[0] / read[1] - 1) <= CLAIM)),
    }


def _model(
    found: dict[tuple[Any, ...], dict[str, list[float]]], model: str, case: str, study: Study
) -> Report:
    numbers = found[case, model, UM * study.sigma]
    return {
        "name": f"{model}, {case}",
        "method": "least squares" if model.startswith("MLS") else "GCO",
        "conservative": float(np.mean(numbers["conservative"])),
        "solved": float(np.mean(numbers["solved"])),
        "workspace": {
            f"{key}_mm": spread([value / 1e3 for value in numbers[f"{key}_um"]]) for key in ("rms", "p95")
        },
        "paper": None,
    }
