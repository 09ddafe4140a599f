"""The numbers of all seeds of the solver comparison as one report, and what was meant to hold."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from testbench.identify.factorised import CLOSE, LARGEST_ORDER
from testbench.studies.solver_comparison.trial import NAME, ORDERS, Study
from testbench.views.report import UM, Report, merge, middle

NEVER_ABOVE = 1e-9
"""Relative difference of F_M that rounding leaves."""
WANTED_RATIO = 1000
"""How much faster than the paper's optimiser the conic program is meant to be."""
SHARP = 1e-6
"""Relative excess of F_M within which local solves end that do not creep along a flat valley."""


def summary(folder: Path, study: Study, reports: Sequence[Report]) -> Report:
    """report.json of all seeds.

    Args:
        folder: The arm's.
        study: What was done.
        reports: One a seed.
    """
    first = reports[0]
    keys = [row["key"] for row in first["solvers"]]
    solvers = [_over_seeds(study, [r["solvers"][k] for r in reports]) for k in range(len(keys))]
    [model] = merge([r["models"] for r in reports])
    final: Report = {
        "scenario": NAME,
        "seed": [r["seed"] for r in reports],
        "arm": folder.resolve().name,
        "model": study.model,
        "m": study.m,
        "noise": study.scenario.noise,
        "truth": study.scenario.truth,
        "dataset": merge([r["dataset"] for r in reports]),
        "solvers": solvers,
        "models": [model],
        "floor_out_of_reach": _out_of_reach(reports),
        "microseconds_f_m": spread([r["microseconds_f_m"] for r in reports]),
        "convergence": {"seed": first["seed"], "points": first["ways"]},
        "runs": [
            {
                "seed": r["seed"],
                **{key: row[key] for key in ("key", "f_m", "seconds", "seconds_to_1_percent")},
            }
            | {"gap_to_bound": r["ways"][row["key"]][-1][1]}
            for r in reports
            for row in r["solvers"]
        ],
        "local_minima": {f"m={m}": _minima_over_seeds(m, reports) for m in ORDERS},
    }
    return final | {"targets": _targets(reports, final)}


def _over_seeds(study: Study, rows: list[Report]) -> Report:
    numbers = (
        "f_m", "excess_f_m", "relative_excess", "duality_gap", "relative_gap", "seconds",
        "seconds_to_1_percent", "ratio_to_conic", "whole_ratio_to_conic", "evaluations",
    )  # fmt: skip
    key = rows[0]["key"]
    solves = [row["local_solves"] for row in rows if row["local_solves"] is not None]
    return {
        "key": key,
        "name": names(study)[key],
        **{number: spread([row[number] for row in rows]) for number in numbers},
        "within_1_percent": sum(row["seconds_to_1_percent"] is not None for row in rows),
        "local_solves": sum(solves) if solves else None,
        "local_solves_elsewhere": sum(row["local_solves_elsewhere"] or 0 for row in rows) if solves else None,
        "conservative": all(row["conservative"] for row in rows),
        "check": {number: spread([row["check"][number] for row in rows]) for number in rows[0]["check"]},
        "status": " | ".join(sorted({row["status"] for row in rows})),
    }


def names(study: Study) -> dict[str, str]:
    """Words for every solver."""
    return {
        "a": f"genetic algorithm of up to {study.generations} generations, then global search (the paper)",
        "a'": f"the same with {study.short_generations} generations",
        "b": "one local solve over b, analytic gradient",
        "b'": "one local solve over b, finite differences",
        "c": f"{study.starts} local solves over b",
        "d": "conic program with certificate",
        "e": "conic program in cvxpy, by SCS",
    }


def spread(values: Sequence[float | None]) -> dict[str, float] | None:
    """Median, 5th and 95th percentile of what there is; None where there is nothing."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    p05, median, p95 = np.percentile(known, [5, 50, 95])
    return {"median": float(median), "p05": float(p05), "p95": float(p95)}


def _out_of_reach(reports: Sequence[Report]) -> int:
    """Seeds whose certified lower bound lies above the F_M of noise alone: no search can stop there."""
    models = [r["models"][0] for r in reports]
    return int(sum(m["f_m"] - m["duality_gap"] > m["f_m_floor"] for m in models))


def _minima_over_seeds(m: int, reports: Sequence[Report]) -> Report:
    """Excess over the global optimum of the same order: the conic one for m = 6, else the best found."""
    several = [(r["seed"], r["minima"][m]) for r in reports if "minima" in r]
    excess, cap = [], []
    for _, found in several:
        best = found["conic_f_m"] if m == LARGEST_ORDER else min(found["f_m"])
        excess += [value / best - 1 for value in found["f_m"]]
        cap.append(min(found["f_m"]) / found["conic_f_m"] - 1)
    values = np.sort(excess)
    return {
        "m": m,
        "reference": "conic optimum" if m == LARGEST_ORDER else "best found of this order",
        "seeds": [seed for seed, _ in several],
        "starts_per_seed": len(several[0][1]["f_m"]),
        "share_within_1e-6": float(np.mean(values <= SHARP)),
        "share_within_1e-5": float(np.mean(values <= CLOSE)),
        "worst": float(values[-1]),
        "median": float(np.median(values)),
        "excess": values.tolist(),
        "best_over_conic": cap,
        "unfinished": sum(found["unfinished"] for _, found in several),
        "f_m_first_seed": sorted(several[0][1]["f_m"]),
    }


def _targets(reports: Sequence[Report], final: Report) -> Report:
    """What was meant to hold, whether it does, and the number."""
    rows = [{row["key"]: row for row in r["solvers"]} for r in reports]
    above = max(row["d"]["f_m"] / row["a"]["f_m"] - 1 for row in rows)
    above_any = max(row["d"]["f_m"] / other["f_m"] - 1 for row in rows for other in row.values())
    gap_excess = max(row["d"]["f_m"] - row["a"]["f_m"] - row["d"]["duality_gap"] for row in rows)
    ratios = [row["a"]["ratio_to_conic"] for row in rows]
    slow = [ratio for ratio in ratios if ratio is None or ratio >= WANTED_RATIO]
    by_key = {row["key"]: row for row in final["solvers"]}
    lean = middle(by_key["a"]["evaluations"]) * middle(final["microseconds_f_m"]) / UM
    counted = [row for row in final["solvers"] if row["key"] in ("a", "a'", "b", "c")]
    elsewhere = sum(row["local_solves_elsewhere"] for row in counted)
    return {
        "conic_never_above_paper": {
            "met": bool(above <= NEVER_ABOVE),
            "largest_relative_excess_of_d_over_a": above,
            "largest_relative_excess_of_d_over_any": above_any,
            "met_up_to_the_certified_gap": bool(gap_excess <= 0),
        },
        "conic_1000_times_faster_than_paper_to_1_percent": {
            "met": len(slow) == len(ratios),
            "seeds_met": len(slow),
            "seeds": len(ratios),
            "ratio": by_key["a"]["ratio_to_conic"],
            "least_ratio": min((ratio for ratio in ratios if ratio is not None), default=None),
        },
        "the_same_without_bookkeeping": {
            "met": bool(lean / middle(by_key["d"]["seconds"]) >= WANTED_RATIO),
            "ratio": lean / middle(by_key["d"]["seconds"]),
            "seconds_of_f_m_alone": lean,
        },
        "all_local_solves_reach_the_conic_f_m": {
            "met": elsewhere == 0,
            "elsewhere": elsewhere,
            "of": sum(row["local_solves"] for row in counted),
            "tolerance": CLOSE,
        },
        "all_conservative": {"met": all(row["conservative"] for row in final["solvers"])},
    }
