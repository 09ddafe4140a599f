"""Whether plans keep their promise, and what a second load or a fourth marker is worth.

A promise is one of a linear model and of an arm that the prior could have drawn: so arms are drawn from it
here, and MuJoCo's linear truth is their deflection. Worth is judged on the one true arm, non-linear.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import wishart

from testbench.bench.campaign import Cell, build_cell, stream
from testbench.design.planning import promise
from testbench.design.rows import Experiment, Load
from testbench.design.specification import Specification, Tasks, promise_of, task_rows
from testbench.errors import Array
from testbench.identify import reduce
from testbench.identify.evaluate import predict, score
from testbench.identify.metric import Metric, metric, rescaled
from testbench.identify.prior import Strength
from testbench.identify.regularised import gco_with, least_squares_with
from testbench.model.vjm import Vjm
from testbench.plant import Plant
from testbench.studies.pose_selection.ground import (
    CHANCE,
    FITS,
    PLANNED,
    RANDOM,
    STRUCTURES,
    UNCERTAINTY,
    Chosen,
    Ground,
    at_random,
    hung,
    plan,
    specification_for,
    wrong_prior,
)
from testbench.studies.pose_selection.trial import (
    build_bench,
    identify,
    judge,
    measured,
    metrics_of,
    with_marker,
)
from testbench.views.report import MM, Report

OFFSET = 0.3
"""How far beside the load point a second hanging point is, along the tool's y, and how far a fourth marker
stands off the plane of the three [m]."""
MORE = 4
"""Further poses: the yardstick of what else could be done."""


def draw(own: Metric, uncertainty: float, rng: np.random.Generator) -> Array:
    """Compliances of an arm that the prior could have drawn, conservative, (n_theta, n_theta).

    X of every block is Wishart with 2 / u^2 degrees of freedom and mean one: x then has the mean and the
    covariance u^2 of the prior, and C = P^1/2 X P^1/2 is positive definite.

    Args:
        own: A structure in the metric of the prior.
        uncertainty: u, relative [1].
        rng: Source of the arm.
    """
    freedom, parts = 2 / uncertainty**2, []
    for n in own.sizes:
        X = np.reshape(wishart(freedom, np.eye(n) / freedom).rvs(random_state=rng), (n, n))
        column, row = np.tril_indices(n)
        parts.append(X[row, column] * np.where(row == column, 1, np.sqrt(2)))
    return own.structure.matrix(own.L @ np.concatenate(parts))


def promises(ground: Ground, chosen: dict[tuple[str, int], Chosen], seeds: Sequence[int]) -> list[Report]:
    """Promised and simulated errors at the tasks, an arm of its own a seed.

    Args:
        ground: What all share.
        chosen: Poses by criterion and number.
        seeds: Roots of the arm, of the noise and of the random poses.
    """
    cell = build_cell(ground.folder)
    prior = wrong_prior(cell, ground.seed)
    own = metric(prior, cell.vjm, STRUCTURES[PLANNED](cell))
    found = []
    for seed in seeds:
        C = draw(own, UNCERTAINTY, stream(seed, 11))
        drawn = replace(cell, plant=_with_compliance(cell, C))
        rows = []
        for name in (*ground.study.criteria, RANDOM):
            for poses in _judged(ground, name):
                specification = specification_for(cell, ground, prior, poses)
                used = (
                    at_random(ground.candidates.q, poses, stream(seed, CHANCE + poses))
                    if name == RANDOM
                    else chosen[name, poses]
                )
                rows.append(
                    _promise(drawn, specification, used, own, stream(seed, 200 + poses)) | {"plan": name}
                )
        found.append({"seed": seed, "rows": rows})
    return found


def _judged(ground: Ground, name: str) -> tuple[int, ...]:
    """Numbers of poses whose promises are tried: all of the first criterion and of random poses."""
    study = ground.study
    return study.poses if name in (study.criteria[0], RANDOM) else (study.featured,)


def _with_compliance(cell: Cell, C_theta: Array) -> Plant:
    """The plant with other springs, for its linear truth."""
    C = np.zeros_like(cell.plant.C)
    C[np.ix_(cell.plant.theta, cell.plant.theta)] = C_theta
    return replace(cell.plant, C=C)


def _promise(
    drawn: Cell, specification: Specification, used: Chosen, own: Metric, rng: np.random.Generator
) -> Report:
    promised = promise_of(specification, used.q, used.load, task_rows(specification))
    load, sigma = specification.loads[0], specification.experiment.sigma
    data = measured(drawn, drawn.vjm, "linear", used.q, load, sigma, sigma, rng)
    tasks = measured(drawn, drawn.vjm, "linear", specification.tasks.q, load, sigma, None, rng)
    regression = reduce(drawn.vjm, own.structure, data)
    fitted = rescaled(own, regression)
    errors = {
        key: score(
            predict(drawn.vjm, fit(regression, fitted, Strength(UNCERTAINTY)), tasks), tasks.deflection
        ).rms
        for key, fit in (("gco_mm", gco_with), ("ls_mm", least_squares_with))
    }
    return {
        "poses": len(used.q),
        "expected_mm": MM * promised.overall,
        **{key: MM * error for key, error in errors.items()},
        "inside": bool(promised.overall_low <= errors["gco_mm"] <= promised.overall_high),
    }


def kept(found: Sequence[Report]) -> list[Report]:
    """Promised against simulated root mean squares over all arms, a row a plan and number of poses.

    Args:
        found: What `promises` found, a report a seed.
    """
    rows = []
    for k, first in enumerate(found[0]["rows"]):
        own = [report["rows"][k] for report in found]
        expected, gco, ls = (
            float(np.sqrt(np.mean([row[key] ** 2 for row in own])))
            for key in ("expected_mm", "gco_mm", "ls_mm")
        )
        rows.append(
            {
                "plan": first["plan"],
                "poses": first["poses"],
                "expected_mm": expected,
                "gco_mm": gco,
                "ls_mm": ls,
                "gco_over_expected": gco / expected,
                "inside_90_percent": float(np.mean([row["inside"] for row in own])),
                "arms": len(own),
            }
        )
    return rows


@dataclass(frozen=True)
class Variant:
    """Another way to measure.

    Attributes:
        name: What is done.
        vjm: The model, perhaps with more markers.
        loads: What may be hung.
        poses: How many.
        sigma: Of a reading, or of the mean of several [m].
    """

    name: str
    vjm: Vjm
    loads: tuple[Load, ...]
    poses: int
    sigma: float


def variants(cell: Cell, ground: Ground) -> list[Variant]:
    """The featured plan, and what could be done beyond it."""
    study = ground.study
    n, sigma, one = study.featured, study.sigma, hung(cell, study.payload)
    half = hung(cell, study.payload / 2)
    beside = hung(cell, study.payload, (0.0, OFFSET, 0.0))
    centre = cell.vjm.markers.mean(axis=0)
    away = np.linalg.svd(cell.vjm.markers - centre)[2][-1]
    fourth = with_marker(cell.vjm, tuple((centre + OFFSET * away).tolist()), "P4")
    return [
        Variant(f"{n} poses, one weight, three markers", cell.vjm, (one,), n, sigma),
        Variant(f"{MORE} more poses", cell.vjm, (one,), n + MORE, sigma),
        Variant("every reading taken twice", cell.vjm, (one,), n, sigma / np.sqrt(2)),
        Variant("half the weight as second load", cell.vjm, (one, half), n, sigma),
        Variant(f"a second hanging point {OFFSET:g} m beside", cell.vjm, (one, beside), n, sigma),
        Variant("a fourth marker", fourth, (one,), n, sigma),
    ][: study.variants]


def worth(ground: Ground, seeds: Sequence[int], numbers: Sequence[int]) -> list[Report]:
    """Promised and simulated errors of some variants, a report a variant.

    Args:
        ground: What all share.
        seeds: Roots of noise and of the identification's prior.
        numbers: Which variants.
    """
    cell = build_cell(ground.folder)
    every = variants(cell, ground)
    return [_worth(cell, ground, every[k], seeds) for k in numbers]


def _worth(cell: Cell, ground: Ground, variant: Variant, seeds: Sequence[int]) -> Report:
    specification = _specification(cell, ground, variant)
    best = plan(cell, ground, specification, "test", ground.candidates.q, ground.seed)
    promised = promise(best, task_rows(specification))
    bench = build_bench(cell, ground, variant.vjm)
    load = Load(
        np.stack([each.wrench for each in variant.loads])[best.load],
        np.stack([each.point for each in variant.loads])[best.load],
    )
    judged = []
    for seed in seeds:
        rng = stream(seed, 13)
        data = measured(cell, variant.vjm, "nonlinear", best.q, load, variant.sigma, variant.sigma, rng)
        metrics = metrics_of(cell, wrong_prior(cell, seed))
        judged.append(judge(bench, identify(variant.vjm, metrics, FITS[0], data)))
    return {
        "variant": variant.name,
        "poses": variant.poses,
        "directions": best.examined.problem.r,
        "with_first_load": int((best.load == 0).sum()),
        "efficiency": best.efficiency,
        "expected_tasks_mm": MM * promised.overall,
        "judged": judged,
    }


def _specification(cell: Cell, ground: Ground, variant: Variant) -> Specification:
    """A plan of another kind; the tasks stay those of the one weight and three markers."""
    own = metric(wrong_prior(cell, ground.seed), cell.vjm, STRUCTURES[PLANNED](cell))
    return Specification(
        experiment=Experiment(variant.vjm, own, variant.vjm.markers, variant.sigma),
        loads=variant.loads,
        tasks=Tasks(ground.tasks, variant.loads[0]),
        workspace=ground.workspace,
        uncertainty=UNCERTAINTY,
        poses=variant.poses,
    )
