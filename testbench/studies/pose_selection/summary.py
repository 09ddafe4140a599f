"""The study of pose selection as report.json: every number with its spread, and the recommendation."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from testbench.data.dataset import Dataset
from testbench.studies.pose_selection.ground import FITS, NAME, RANDOM, SCALE, SHAPE, UNCERTAINTY, Ground
from testbench.studies.pose_selection.promise import kept
from testbench.views.report import MM, UM, Report, merge, middle

AIM = 0.1
"""Error at the tasks that a campaign is to reach [mm]."""
STEP, LITTLE = 4, 0.10
"""So many more poses that take less than this share off the error are not worth a hoist."""


@dataclass(frozen=True)
class Findings:
    """What the parts of the study found.

    Attributes:
        plans: One a criterion and number of poses.
        trials: One a seed.
        replanned: One a seed.
        promises: One an arm.
        worth: One a variant.
    """

    plans: Sequence[Report]
    trials: Sequence[Report]
    replanned: Sequence[Report]
    promises: Sequence[Report]
    worth: Sequence[Report]


def summary(ground: Ground, first: Dataset, found: Findings) -> Report:
    """report.json.

    Args:
        ground: What was tried.
        first: Runs of the featured plan, first seed.
        found: What was found.
    """
    study, seeds = ground.study, [r["seed"] for r in found.trials]
    size = MM * np.linalg.norm(first.deflection, axis=-1)
    errors = {fit: _errors(found.trials, fit) for fit in FITS}
    return {
        "scenario": NAME,
        "seed": seeds[0] if len(seeds) == 1 else seeds,
        "arm": ground.folder.resolve().name,
        "payload_kg": study.payload,
        "noise": True,
        "truth": "nonlinear",
        "prior": {
            "scale": SCALE,
            "shape_percent": 100 * SHAPE,
            "believed_within_percent": 100 * UNCERTAINTY,
        },
        "tracker_m": list(study.station),
        "dataset": {
            "runs": first.runs,
            "points": first.points,
            "poses": study.featured,
            "tasks": study.tasks,
            "workspace_poses": study.workspace,
            "deflection_min_mm": float(size.min()),
            "deflection_max_mm": float(size.max()),
            "sigma_um": UM * study.sigma,
        },
        "candidates": {
            "found": len(ground.candidates.q),
            "drawn": ground.candidates.drawn,
            "rejected": ground.candidates.rejected,
        },
        "models": merge([r["models"] for r in found.trials]),
        "where": merge([r["where"] for r in found.trials]),
        "plans": list(found.plans),
        "errors": errors,
        "featured": {fit: _featured(errors[fit], study.featured) for fit in FITS},
        "possible": _possible(ground, found, errors[FITS[0]]),
        "recommendation": recommend(errors[FITS[0]]),
        "replanned": _replanned(found.replanned),
        "promises": kept(found.promises),
        "worth": [{**row, "judged": merge(row["judged"])} for row in found.worth],
        "study": asdict(study),
    }


def _errors(trials: Sequence[Report], fit: str) -> dict[str, list[Report]]:
    """Spread of the errors over the seeds, and the best tenth, by plan and number of poses."""
    found = {}
    for name, rows in merge([r["errors"][fit] for r in trials]).items():
        found[name] = [
            {
                **row,
                "tasks_best_tenth_mm": float(
                    np.percentile([r["errors"][fit][name][k]["tasks_mm"] for r in trials], 10)
                ),
            }
            for k, row in enumerate(rows)
        ]
    return found


def at(rows: Sequence[Report], poses: int) -> Report:
    """The row of so many poses."""
    return next(row for row in rows if row["poses"] == poses)


def high(value: Any) -> float:
    """95th percentile of several seeds, or the number of one."""
    return float(value["p95"] if isinstance(value, dict) else value)


def _featured(errors: dict[str, list[Report]], poses: int) -> Report:
    """The test-pose plan against random poses, and by which factor it beats them."""
    plan, chance = at(errors["test"], poses), at(errors[RANDOM], poses)
    return {
        "poses": poses,
        "test_mm": plan["tasks_mm"],
        "random_mm": chance["tasks_mm"],
        "random_best_tenth_mm": chance["tasks_best_tenth_mm"],
        "ratio_of_medians": middle(plan["tasks_mm"]) / middle(chance["tasks_mm"]),
    }


def _possible(ground: Ground, found: Findings, errors: dict[str, list[Report]]) -> Report:
    """What limits a plan of the featured size: the least promise, and what stays without any noise."""
    poses = ground.study.featured
    plan = next(p for p in found.plans if (p["criterion"], p["poses"]) == ("test", poses))
    calm = {name: merge([r["noise_free"][name] for r in found.trials]) for name in ("test", RANDOM)}
    return {
        "poses": poses,
        "least_promise_mm": plan["expected_tasks_mm"] * plan["efficiency"] ** 0.5,
        "noise_free_mm": calm,
        "noise_free_over_random": middle(calm["test"]) / middle(at(errors[RANDOM], poses)["tasks_mm"]),
    }


def _replanned(found: Sequence[Report]) -> Report:
    """Plans made anew in every seed, against random poses of the same candidates."""
    whole = merge(list(found))
    chance = [r[RANDOM]["tasks_mm"] for r in found]
    plans = [r["test"]["tasks_mm"] for r in found]
    return {
        **whole,
        "seeds": len(found),
        "random_best_tenth_mm": float(np.percentile(chance, 10)),
        "ratio_of_medians": float(np.median(plans) / np.median(chance)),
        "wins": sum(a < b for a, b in zip(plans, chance, strict=True)),
        "least_efficiency": min(r["efficiency"] for r in found),
    }


def recommend(errors: dict[str, list[Report]]) -> Report:
    """How many poses: the fewest that reach the aim in 95 % of all trials, and where more bring little.

    Args:
        errors: Of one way to identify, by plan.
    """
    fewest = {
        name: next((row["poses"] for row in errors[name] if high(row["tasks_mm"]) <= AIM), None)
        for name in ("test", RANDOM)
    }
    rows = errors["test"]
    knee = None
    for row, following in pairwise(rows):
        gain = middle(following["tasks_mm"]) / middle(row["tasks_mm"])
        if 1 - gain ** (STEP / (following["poses"] - row["poses"])) < LITTLE:
            knee = row["poses"]
            break
    return {"aim_mm": AIM, "fewest": fewest, "little_more_beyond": knee}
