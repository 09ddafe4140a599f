"""From a plan to plan.json: every number that readers see is taken from here."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from testbench.bench.campaign import Cell
from testbench.bench.plan import Planned
from testbench.design.baselines import COUNTS, RANDOM
from testbench.design.forecast import Forecast
from testbench.design.planning import seen_at_most
from testbench.errors import Array
from testbench.model.vjm import chain
from testbench.views.report import MM, UM, Report

TARGET = 0.1
"""Error for which the fewest poses are told [mm]."""
MORE, LITTLE = 4, 0.10
"""So many more poses that bring less than this share are not worth their time."""
IN_METRES = ("test",)
"""Criteria whose certificate is told in metres too: 1 / sqrt(Phi) and what stays hidden from these loads."""


def report(cell: Cell, planned: Planned) -> Report:
    """The numbers of a plan, in millimetres, degrees and radians.

    Args:
        cell: The arm.
        planned: The plan and what it promises.
    """
    wish = planned.wish
    return {
        **_wish(cell, planned),
        "error_mm": _overall(planned.tasks),
        "workspace_error_mm": _overall(planned.workspace),
        "error_if_prior_twice_as_uncertain_mm": None
        if planned.doubted is None
        else _overall(planned.doubted),
        "random_plans": {
            "plans": RANDOM,
            "median_mm": _finite(MM * np.median(planned.baselines.random[wish.poses])),
            "best_tenth_mm": _finite(MM * _percentile(planned.baselines.random[wish.poses], 10)),
        },
        "certificate": _certificate(planned),
        "plan": _plan(planned),
        "tasks": _tasks(cell, planned),
        "candidates": {
            "found": len(planned.found.q),
            "drawn": planned.found.drawn,
            "rejected": planned.found.rejected,
        },
        "observability": asdict(planned.observability),
        "directions": _directions(planned),
        "curve": [_count(planned, count) for count in sorted({*COUNTS, wish.poses})],
        "greedy_mm": [_finite(MM * error) for error in planned.baselines.greedy],
        "advice": _advice(planned),
    }


def _wish(cell: Cell, planned: Planned) -> Report:
    wish = planned.wish
    station, area = wish.station, wish.area
    uncertainty = None if wish.uncertainty is None else 100 * wish.uncertainty
    return {
        "arm": cell.arm.name,
        "base_m": cell.vjm.base[:3, 3].tolist(),
        "joints": [joint.name for joint in cell.arm.joints],
        "model": wish.structure.name,
        "criterion": wish.criterion,
        "poses": wish.poses,
        "loads_kg": list(wish.loads),
        "sigma_um": UM * wish.sigma,
        "prior": None if uncertainty is None else planned.specification.experiment.metric.prior,
        "uncertainty_percent": uncertainty,
        "tracker_m": None if station is None else list(station.position),
        "acceptance_deg": (
            None if station is None or station.acceptance is None else math.degrees(station.acceptance)
        ),
        "box_m": None if area is None else [list(area.lower), list(area.upper)],
        "sling_m": wish.sling,
        "candidates_wanted": wish.candidates,
        "seed": wish.seed,
    }


def _overall(forecast: Forecast) -> Report:
    return {
        "expected": _finite(MM * forecast.overall),
        "p05": _finite(MM * forecast.overall_low),
        "p95": _finite(MM * forecast.overall_high),
    }


def _certificate(planned: Planned) -> Report:
    """What no plan of as many of the examined poses exceeds; an error is 1 / sqrt(Phi)."""
    plan = planned.plan
    share = min(plan.efficiency, 1.0)
    hidden = planned.influence.hidden if plan.criterion.name == "test" else 0.0
    in_metres = plan.criterion.name in IN_METRES
    reached, least = (math.sqrt(hidden + 1 / phi) for phi in (plan.value, plan.value / share))
    return {
        "efficiency": share,
        "phi": plan.value,
        "phi_bound": plan.relaxed.bound,
        "excess_percent": 100 * (reached / least - 1),
        "reached_mm": MM * reached if in_metres else None,
        "least_mm": MM * least if in_metres else None,
        "examined": len(plan.examined.q),
        "poses_and_loads": len(planned.wish.loads) > 1,
    }


def _plan(planned: Planned) -> list[Report]:
    plan = planned.plan
    travel = np.r_[0.0, np.abs(np.diff(plan.q, axis=0)).max(axis=1)]
    ways = ["start", *("clear" if clear else "via" for clear in planned.clear)]
    return [
        {
            "run": k + 1,
            "q_rad": plan.q[k].tolist(),
            "q_deg": np.rad2deg(plan.q[k]).tolist(),
            "load_kg": float(planned.wish.loads[plan.load[k]]),
            "expected_deflection_mm": float(MM * planned.deflection[k]),
            **_error(planned.poses, k),
            "travel_deg": float(np.rad2deg(travel[k])),
            "way": ways[k],
            "tool_m": place,
        }
        for k, place in enumerate(_places(planned, plan.q))
    ]


def _tasks(cell: Cell, planned: Planned) -> list[Report]:
    tasks = planned.wish.tasks
    shape = len(tasks.q)
    wrench = np.broadcast_to(tasks.load.wrench, (shape, 6))
    point = np.broadcast_to(tasks.load.point, (shape, 3))
    return [
        {
            "task": k + 1,
            "q_deg": np.rad2deg(tasks.q[k]).tolist(),
            "force_N": wrench[k, :3].tolist(),
            "moment_Nm": wrench[k, 3:].tolist(),
            "point_m": point[k].tolist(),
            "expected_deflection_mm": float(MM * planned.task_deflection[k]),
            **_error(planned.tasks, k),
            "tool_m": place,
        }
        for k, place in enumerate(chain(cell.vjm, tasks.q).position.tolist())
    ]


def _places(planned: Planned, q: Array) -> list[list[float]]:
    places: list[list[float]] = chain(planned.specification.experiment.vjm, q).position.tolist()
    return places


def _error(forecast: Forecast, k: int) -> Report:
    return {
        "expected_error_mm": float(MM * forecast.error[k]),
        "expected_error_p05_mm": float(MM * forecast.low[k]),
        "expected_error_p95_mm": float(MM * forecast.high[k]),
    }


def _directions(planned: Planned) -> Report:
    specification, plan, influence = planned.specification, planned.plan, planned.influence
    shown = plan.examined.problem.r
    at_most = seen_at_most(specification, plan.examined.problem)
    return {
        "unknowns": specification.experiment.metric.structure.n,
        "shown": shown,
        "at_most": at_most,
        "seen": planned.observability.seen,
        "outweighed": influence.outweighed if specification.uncertainty is not None else shown,
        "hidden_mm": MM * math.sqrt(influence.hidden),
        "prior_share_percent": 100 * influence.prior_share if specification.uncertainty is not None else 0.0,
    }


def _count(planned: Planned, count: int) -> Report:
    baselines = planned.baselines
    low, middle, high = (MM * _percentile(baselines.random[count], p) for p in (10, 50, 90))
    return {
        "poses": count,
        "greedy_mm": _finite(MM * baselines.greedy[count - 1]),
        "random_median_mm": _finite(middle),
        "random_p10_mm": _finite(low),
        "random_p90_mm": _finite(high),
    }


def _advice(planned: Planned) -> Report:
    """Fewest poses that reach the target, and from where on more always bring little; of greedy plans."""
    error = MM * planned.baselines.greedy
    reached = np.flatnonzero(error <= TARGET)
    ahead = np.full(len(error), np.inf)
    ahead[:-MORE] = error[MORE:]
    with np.errstate(invalid="ignore"):
        pays = np.isinf(error) | (ahead <= (1 - LITTLE) * error)
    judged = len(error) - MORE
    last = np.flatnonzero(pays[:judged])
    enough = int(last[-1]) + 2 if len(last) else 1
    return {
        "target_mm": TARGET,
        "fewest": int(reached[0]) + 1 if len(reached) else None,
        "examined_up_to": len(error),
        "more": MORE,
        "little_percent": 100 * LITTLE,
        "enough": enough if enough <= judged else None,
    }


def _percentile(values: Array, percent: float) -> float:
    """A percentile of numbers of which some may be infinite."""
    return float(np.percentile(values, percent, method="lower"))


def _finite(value: Any) -> float | None:
    """The number, None where it has no bound: JSON knows no infinity."""
    return float(value) if math.isfinite(value) else None
