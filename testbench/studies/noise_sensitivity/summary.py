"""The study of noise as report.json: every error with its spread, and what they say."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from testbench.data.dataset import Dataset
from testbench.studies.noise_sensitivity.trial import GRAVITY, NAME, PRIOR, SIX_DOF, WITH_PRIOR, Study
from testbench.studies.spread import grouped, spread
from testbench.views.report import MM, UM, Report

PARTS = {"six_dof": "108 runs of section 5.2", "gravity": "KR 500, 8 poses"}
NEAR = 4.0
"""Distance at which weights are compared [m]."""


def summary(rows: Iterable[dict[str, Any]], study: Study, seed: int, trials: int) -> Report:
    """report.json.

    Args:
        rows: Of all trials.
        study: What was tried.
        seed: First root of randomness.
        trials: How many.
    """
    found = grouped(rows, ("part", "model", "x"), ("rms_um", "p95_um", "conservative", "solved"))
    cells = [
        {
            "part": part,
            "model": model,
            "x": x,
            "rms_um": spread(v["rms_um"]),
            "p95_um": spread(v["p95_um"]),
            "conservative": float(np.mean(v["conservative"])),
            "solved": float(np.mean(v["solved"])),
            "trials": len(v["rms_um"]),
        }
        for (part, model, x), v in found.items()
    ]
    sweeps = {part: _sweep(cells, part) for part in PARTS}
    return {
        "scenario": NAME,
        "seed": list(range(seed, seed + trials)) if trials > 1 else seed,
        "noise": True,
        "truth": {"six_dof": "linear", "gravity": "nonlinear", "instrument": "both"},
        "trials": {"six_dof": trials, **{p: _trials(cells, p) for p in ("gravity", "instrument_linear")}},
        "sigmas_um": [UM * s for s in study.sigmas],
        "sweeps": sweeps,
        "slopes": {part: _slopes(rows) for part, rows in sweeps.items()},
        "instruments": [c for c in cells if str(c["part"]).startswith("instrument")],
        "weighted_over_flat": {
            truth: _weighted(cells, f"instrument_{truth}") for truth in ("linear", "nonlinear")
        },
        "gco_over_ls": _paired(found),
        "models": _models(cells),
    }


def dataset(first: Dataset) -> Report:
    """What the dataset of the run's folder holds."""
    size = MM * np.linalg.norm(first.deflection, axis=-1)
    return {
        "runs": first.runs,
        "points": first.points,
        "deflection_min_mm": float(size.min()),
        "deflection_max_mm": float(size.max()),
        "sigma_um": UM * first.sigma,
    }


def _trials(cells: list[Report], part: str) -> int:
    return max((c["trials"] for c in cells if c["part"] == part), default=0)


def _sweep(cells: list[Report], part: str) -> list[Report]:
    """Error by sigma and model."""
    return [{**c, "sigma_um": UM * c["x"]} for c in cells if c["part"] == part]


def _slopes(rows: list[Report]) -> dict[str, Report]:
    """Median error per sigma at the largest one, and without noise, by model."""
    top = max((row["sigma_um"] for row in rows), default=0.0)
    found: dict[str, Report] = {}
    for row in rows:
        own = found.setdefault(row["model"], {})
        if row["sigma_um"] == 0:
            own["noise_free_um"] = row["rms_um"]["median"]
        if row["sigma_um"] == top and top > 0:
            own["um_per_um"] = row["rms_um"]["median"] / top
    return found


def _weighted(cells: list[Report], part: str) -> list[Report]:
    """Full covariances against flat weights at every distance."""
    errors = {(c["model"], c["x"]): c["rms_um"]["median"] for c in cells if c["part"] == part}
    return [
        {"distance_m": x, "ratio": errors["weighted", x] / errors["flat weights", x]}
        for model, x in errors
        if model == "weighted"
    ]


def _paired(found: dict[tuple[Any, ...], dict[str, list[float]]]) -> list[Report]:
    """Trial by trial, on the same readings: GCO's error over that of LS with the same structure."""
    rows = []
    for part in PARTS:
        for x in sorted({key[2] for key in found if key[0] == part and key[2] > 0}):
            ours, theirs = (np.array(found[part, name, x]["rms_um"]) for name in ("MGCO56", "MLS56"))
            rows.append(
                {
                    "part": part,
                    "sigma_um": UM * x,
                    "ratio": spread((ours / theirs).tolist()),
                    "better_in": float(np.mean(ours < theirs)),
                }
            )
    return rows


def _models(cells: list[Report]) -> list[Report]:
    """A row a model at the level nearest the paper's trackers: 25 um (section 5.2), 50 um (section 6)."""
    rows = []
    for part, sigma, plain in (("six_dof", 25.0, SIX_DOF), ("gravity", 50.0, GRAVITY)):
        names = (*plain, *(name + PRIOR for name in WITH_PRIOR[part]))
        levels = [(abs(UM * c["x"] - sigma), c["x"]) for c in cells if c["part"] == part]
        nearest = min(levels, default=(0.0, 0.0))[1]
        for c in cells:
            if c["part"] == part and c["model"] in names and c["x"] == nearest:
                key = "check" if part == "six_dof" else "workspace"
                scores = {
                    f"{name}_mm": {k: v / 1e3 for k, v in c[f"{name}_um"].items()} for name in ("rms", "p95")
                }
                rows.append(
                    {
                        "name": f"{c['model']}, {PARTS[part]}",
                        "method": "least squares" if c["model"].startswith("MLS") else "GCO",
                        "conservative": c["conservative"],
                        "solved": c["solved"],
                        key: scores,
                        "paper": None,
                    }
                )
    return rows
