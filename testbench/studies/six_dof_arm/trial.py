"""Section 5.2 as a study: the illustrative 6R arm, five models, two kinds of truth, and the order m."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from testbench.arm.stiffness import eigenvalue_scale
from testbench.bench.campaign import Cell, Model, build_cell, named_models, stream
from testbench.bench.full_pose import Campaign, FullPose, Result, identify, judge, simulate
from testbench.errors import Array
from testbench.identify import Estimate, LocalSolves, gco
from testbench.identify.factorised import LARGEST_ORDER
from testbench.studies.paper import SECTION_5_2
from testbench.studies.six_dof_arm.words import claims, which_m
from testbench.views.report import MM, UM, Report, estimate_report, merge, score_report

NAME = "six_dof_arm"
MODELS = ("MLS56", "MLS32", "MGCO147", "MGCO69", "MGCO56")
"""The models of Table I, in the paper's order."""
ORDER_MODELS = ("MGCO69", "MGCO56")
RANK_TOLERANCE = 1e-6
"""Eigenvalue of a block of unit diagonal below which it counts as zero."""


def trials(
    folder: Path,
    scenario: FullPose,
    ordered: Sequence[int],
    starts: int,
    clock: Callable[[], float],
    seeds: Sequence[int],
) -> list[Report]:
    """Reports of some seeds.

    Args:
        folder: The arm's.
        scenario: What to measure; its truth is replaced by each in turn.
        ordered: Seeds in which the order m is studied too.
        starts: Local solves of every order m: below 6 there are local minima that are not global.
        clock: Wall time [s].
        seeds: Roots of randomness.
    """
    cell = build_cell(folder)
    models = named_models(cell, MODELS)
    reports = []
    for seed in seeds:
        campaigns = {
            t: simulate(cell, scenario.model_copy(update={"truth": t}), seed) for t in ("linear", "nonlinear")
        }
        report = {
            t: {
                "dataset": _dataset(campaign),
                "models": [_model(r) for r in identify(cell, campaign, models, clock)],
            }
            for t, campaign in campaigns.items()
        }
        if seed in ordered:
            report["order"] = {name: _order(cell, campaigns["linear"], name, starts) for name in ORDER_MODELS}
        reports.append({"seed": seed, **report})
    return reports


def _dataset(campaign: Campaign) -> Report:
    scenario = campaign.scenario
    size = MM * np.linalg.norm(campaign.truth.deflection, axis=-1)
    return {
        "runs": campaign.identification.runs,
        "points": campaign.identification.points,
        "poses": scenario.poses,
        "check_runs": campaign.truth.runs,
        "check_runs_drawn": campaign.drawn,
        "deflection_min_mm": float(size.min()),
        "deflection_max_mm": float(size.max()),
        "sigma_um": UM * scenario.sigma,
        "sigma_urad": UM * scenario.sigma_rotation,
    }


def _model(result: Result) -> Report:
    return {
        **estimate_report(result.model.name, result.estimate, result.seconds),
        "identification": score_report(result.identification),
        "check": score_report(result.check),
        "readings": score_report(result.readings),
        "paper": SECTION_5_2.get(result.model.name),
    }


def _order(cell: Cell, campaign: Campaign, name: str, starts: int) -> list[Report]:
    """F_M, rank, eigenvalues and check error of every order m of one model."""
    [model] = named_models(cell, [name])
    best = gco(cell.vjm, model.structure, campaign.identification)
    rows = []
    for m in range(1, LARGEST_ORDER + 1):
        estimator = LocalSolves(stream(campaign.seed, 10 + m), m, starts)
        estimate = estimator(cell.vjm, model.structure, campaign.identification)
        check = judge(cell, campaign, Model(name, model.structure, estimator), estimate, 0.0).check
        scaled = _scaled_eigenvalues(estimate)
        rows.append(
            {
                "m": m,
                "f_m": estimate.f_m,
                "f_m_over_optimum": estimate.f_m / best.f_m,
                "rank": max(int((e > RANK_TOLERANCE * e[-1]).sum()) for e in scaled),
                "min_eigenvalue": estimate.min_eigenvalue,
                "min_scaled_eigenvalue": float(min(e[0] for e in scaled if len(e) > 1)),
                "max_eigenvalue": float(max(e[-1] for e in estimate.eigenvalues)),
                "conservative": estimate.conservative,
                "check": score_report(check),
            }
        )
    return rows


def _scaled_eigenvalues(estimate: Estimate) -> list[Array]:
    """Eigenvalues of every block scaled to unit diagonal, ascending."""
    found = []
    for block in estimate.structure.blocks:
        C = estimate.C_theta[np.ix_(block, block)]
        d = eigenvalue_scale(C)
        found.append(np.asarray(np.linalg.eigvalsh(C / np.outer(d, d))))
    return found


def summary(folder: Path, scenario: FullPose, per: str, reports: Sequence[Report]) -> Report:
    """report.json of all seeds.

    Args:
        folder: The arm's.
        scenario: What was measured.
        per: Whether the paper's sigma is one of a "deflection" or of a "reading".
        reports: One a seed.
    """
    seeds = [r["seed"] for r in reports]
    linear, nonlinear = (merge([r[truth] for r in reports]) for truth in ("linear", "nonlinear"))
    ordered = [r for r in reports if "order" in r]
    final = {
        "scenario": NAME,
        "seed": seeds[0] if len(seeds) == 1 else seeds,
        "arm": folder.resolve().name,
        "noise": scenario.noise,
        "noise_per": per,
        "truth": "linear",
        "dataset": linear["dataset"],
        "models": linear["models"],
        "nonlinear": nonlinear,
        "order": {"seeds": [r["seed"] for r in ordered], **merge([r["order"] for r in ordered])},
        "paired": _paired(reports),
    }
    orders = {name: final["order"][name] for name in ORDER_MODELS}
    return {**final, "which_m": which_m(orders), "claims": claims(final)}


def _paired(reports: Sequence[Report]) -> Report:
    """On the same data: how much MGCO56 differs from MLS32 at most, and how often it is the better one."""

    def p95(report: Report, name: str, group: str) -> float:
        return float(next(m[group]["p95_mm"] for m in report["linear"]["models"] if m["name"] == name))

    def ratio(group: str) -> list[float]:
        return [p95(r, "MGCO56", group) / p95(r, "MLS32", group) for r in reports]

    return {
        "seeds": len(reports),
        "mgco56_better_than_mls32": sum(x < 1 for x in ratio("check")),
        "mgco56_over_mls32_p95_check": merge(ratio("check")),
        "mgco56_over_mls32_p95_readings": merge(ratio("readings")),
    }
