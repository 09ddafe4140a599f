"""From a plan of absolute readings to its report: its promise, what stays open, the plans beside it."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from testbench.bench import absolute_plan_report as r
from testbench.bench.absolute_plan_settings import AbsolutePlanSettings
from testbench.bench.campaign import Cell, stream
from testbench.bench.candidates import Candidates
from testbench.bench.error_places import ErrorPlaces, Meaning, bounded_mm, error_places, places_at
from testbench.bench.plan_report import Found, Way
from testbench.bench.plan_summary import margins, overall, travel
from testbench.bench.rows import MM
from testbench.data.series import select_rows
from testbench.design import absolute
from testbench.design.absolute import Union
from testbench.design.criteria import Linear, mean_square
from testbench.design.exchange import greedy
from testbench.design.forecast import Forecast
from testbench.design.planning import Chosen
from testbench.design.rows import Ids, Problem, information
from testbench.errors import Array
from testbench.identify.absolute.pull import pull_of
from testbench.identify.absolute.seen import LOOSE, hidden
from testbench.identify.absolute.seen_words import sentences
from testbench.identify.prior import cad_prior
from testbench.model.vjm import chain, tool_pose
from testbench.plant import has_surroundings

CALIBRATED = "calibrated"  #: Name of the arm after the calibration.
EXPECTED = Meaning("expected error", "of the targets' positions after calibration", "RMS")
RANDOM = 100  #: Random plans that a plan is compared with.
COUNTS = (10, 20, 30, 50, 75, 100, 150, 200)  #: Numbers of poses for which errors are told.


@dataclass(frozen=True)
class Judged:
    """A plan, and what it is judged by."""

    union: Union  #: What is unknown.
    found: Candidates  #: Feasible poses, the first of those examined.
    chosen: Chosen  #: The plan.
    workspace: Array  #: Poses over which it is judged, (poses, n) [rad, m].
    wanted: Array  #: Predictions there, `absolute.position_rows`.
    forecast: Forecast  #: Their errors.


def summary(cell: Cell, settings: AbsolutePlanSettings, judged: Judged) -> r.AbsolutePlanReport:
    """The report of a plan."""
    arm, union, found, chosen = cell.arm, judged.union, judged.found, judged.chosen
    beyond = absolute.joint_rest(union, judged.workspace)
    yardstick, rng = _yardstick(judged), stream(settings.seed, 3)
    return r.AbsolutePlanReport(
        **vars(settings) | {"model": union.unknowns.structure.name},
        arm=arm.name,
        base_m=cell.vjm.base[:3, 3].tolist(),
        joints=[joint.name for joint in arm.joints],
        units=[joint.shown_unit for joint in arm.joints],
        margins=margins(arm, chosen.q),
        surrounded=has_surroundings(cell.room),
        prior=cad_prior(arm).name,
        targets=list(union.pose.markers),
        unknowns=_counts(union, chosen.examined.problem.r),
        error_mm=overall(judged.forecast),
        beyond_mm=MM * float(np.sqrt(np.square(beyond).mean())),
        random_mm=yardstick.random(settings.poses, rng),
        efficiency=min(chosen.efficiency, 1.0),
        examined=len(chosen.examined.q),
        plan=_poses(cell, union, chosen),
        hidden=list(left_open(union, chosen.q)),
        candidates=Found(len(found.q), found.drawn, found.rejected),
        curve=_curve(yardstick, settings.poses, rng),
        map=_map(cell, judged),
    )


def _map(cell: Cell, judged: Judged) -> ErrorPlaces:
    """Errors over the workspace, and the sag there."""
    q = judged.workspace
    at = places_at(cell.arm, q, tool_pose(cell.vjm, q)[0], absolute.sag(judged.union, q))
    return error_places(at, {CALIBRATED: bounded_mm(judged.forecast.error)}, means=EXPECTED)


def left_open(union: Union, q: Array) -> tuple[str, ...]:
    """What poses (poses, n) [rad, m] leave unknown, in words."""
    once = absolute.at(replace(union, pose=select_rows(union.pose, np.arange(1))), q)
    pull = pull_of(
        union.unknowns, union.state, (once,), lambda series: absolute.information_of(union, series.q)
    )
    tells, prior = absolute.information_of(union, q), union.L @ union.L.T
    set_up = union.unknowns.starts["geometry"]
    prior[:set_up, :set_up] = LOOSE**2 * np.eye(set_up)
    return sentences(hidden(union.unknowns, tells, prior, pull))


@dataclass(frozen=True)
class _Yardstick:
    """Plans of the candidates that were drawn, judged over the workspace."""

    problem: Problem
    criterion: Linear  #: I.
    hidden: float  #: Mean square error in directions that no such plan sees [m^2].
    drawn: int  #: Candidates, the first of those examined.

    def error(self, plan: Ids) -> float:
        """RMS error of the targets after some candidates were read [mm]."""
        value = self.criterion.information(information(self.problem, plan))
        return MM * math.sqrt(self.hidden + 1 / value)

    def random(self, poses: int, rng: np.random.Generator) -> r.RandomErrors:
        """Errors of random plans."""
        plans = [rng.choice(self.drawn, poses, replace=self.drawn < poses) for _ in range(RANDOM)]
        low, middle, high = np.percentile([self.error(plan) for plan in plans], [10, 50, 90])
        return r.RandomErrors(RANDOM, float(middle), float(low), float(high))


def _yardstick(judged: Judged) -> _Yardstick:
    problem, wanted = judged.chosen.examined.problem, judged.wanted
    hidden = float(np.trace(mean_square(wanted) @ problem.hidden))
    criterion = Linear("I", mean_square(wanted @ problem.lift))
    return _Yardstick(problem, criterion, max(0.0, hidden), len(judged.found.q))


def _curve(yardstick: _Yardstick, poses: int, rng: np.random.Generator) -> list[r.AbsoluteCurveRow]:
    """Errors by the number of poses, up to some more than the plan has."""
    counts = sorted({poses, *(count for count in COUNTS if count <= max(2 * poses, COUNTS[1]))})
    order = greedy(yardstick.problem, yardstick.criterion, yardstick.problem.rows, counts[-1])
    rows = []
    for count in counts:
        of = yardstick.random(count, rng)
        best = yardstick.error(order[:count])
        rows.append(r.AbsoluteCurveRow(count, best, of.median_mm, of.p10_mm, of.p90_mm))
    return rows


def _counts(union: Union, seen: int) -> r.Counts:
    of: dict[str, int] = {}
    starts = list(union.unknowns.starts.items())
    for (name, start), (_, end) in pairwise(starts):
        kind = name.split()[0]
        of[kind] = of.get(kind, 0) + end - start
    return r.Counts(**of, seen=seen)


def _poses(cell: Cell, union: Union, chosen: Chosen) -> list[r.AbsolutePoseRow]:
    here = absolute.promise(chosen, absolute.position_rows(union, chosen.q))
    (turned, slid), sag = travel(cell.arm, chosen.q), absolute.sag(union, chosen.q)
    tools = chain(cell.vjm, chosen.q).position
    ways: list[Way] = ["start", *("clear" if clear else "via" for clear in chosen.clear)]
    return [
        r.AbsolutePoseRow(
            run=k + 1,
            q=q.tolist(),
            q_shown=(cell.arm.shown * q).tolist(),
            tool_m=tools[k].tolist(),
            expected_sag_mm=float(MM * sag[k]),
            expected_error_mm=float(MM * here.error[k]),
            expected_error_p05_mm=float(MM * here.low[k]),
            expected_error_p95_mm=float(MM * here.high[k]),
            travel_deg=float(turned[k]),
            travel_mm=float(slid[k]),
            way=ways[k],
        )
        for k, q in enumerate(chosen.q)
    ]
