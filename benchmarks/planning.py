"""Planning: 200 poses over 12, candidates doubled, and the exchange over trying every candidate."""

import numpy as np
from measure import MODELS, Row, at_least, at_most, feasible_poses, interleave, spread

from testbench.arm.mjcf import GRAVITY
from testbench.design.criteria import Criterion, LinearCriterion, mean_square_weight
from testbench.design.exchange import MAX_EXCHANGE_SWEEPS, MIN_EXCHANGE_GAIN, Feasibility, exchange_poses
from testbench.design.planning import make_plan
from testbench.design.rows import (
    DesignProblem,
    MeasurementSetup,
    PlanSpecification,
    Tasks,
    build_design_problem,
    information,
    task_rows,
    whitened_rows_by_load,
)
from testbench.errors import Array, Ids
from testbench.identify.prior import cad_prior, scale_by_prior
from testbench.model.load import Load
from testbench.model.structure import mgco68
from testbench.workflows.cell import build_cell

ARM, WEIGHT = "kr500_l480", 460.0
FEW, MANY, CANDIDATES, TASKS = 12, 200, 1000, 20
REPEATS = 3
BAR_POSES, BAR_CANDIDATES, BAR_EXCHANGE = MANY / FEW, 2.0, 2.0
"""Poses and candidates cost no more than in proportion, and the exchange half of trying everything."""


def specification(poses: Array, count: int) -> PlanSpecification:
    """So many poses under a weight, for tasks among those given, (poses, n) [rad]."""
    cell = build_cell(MODELS / ARM)
    load = Load(np.array([0, 0, -WEIGHT * GRAVITY, 0, 0, 0]), cell.vjm.load_point)
    setup = MeasurementSetup(
        cell.vjm, scale_by_prior(cad_prior(cell.arm), cell.vjm, mgco68(cell.arm)), cell.vjm.markers, 50e-6
    )
    return PlanSpecification(setup, (load,), Tasks(poses[:TASKS], load), poses[:TASKS], 0.3, count)


def try_everything(problem: DesignProblem, criterion: Criterion, start: Ids) -> Ids:
    """The exchange by its definition: every candidate in every place, until a sweep changes nothing."""
    plan = start.copy()
    value = criterion.phi(information(problem, plan))
    for _ in range(MAX_EXCHANGE_SWEEPS):
        before = value
        for k in range(len(plan)):
            reached = criterion.phi_with_candidate(information(problem, np.delete(plan, k)), problem.rows)
            if reached.max() > (1 + MIN_EXCHANGE_GAIN) * value:
                plan[k], value = int(reached.argmax()), float(reached.max())
        if value == before:
            break
    return plan


def planning_of_many_poses() -> list[Row]:
    """A row for poses, for candidates, and for the exchange alone."""
    q = feasible_poses(build_cell(MODELS / ARM), 2 * CANDIDATES, seed=1)
    reach = Feasibility(lambda tried: np.ones(len(tried), dtype=bool))

    def plan(poses: int, candidates: int) -> None:
        make_plan(specification(q, poses), "test", q[:candidates], reach, np.random.default_rng(1))

    few, many, twice = interleave(
        REPEATS,
        lambda: plan(FEW, CANDIDATES),
        lambda: plan(MANY, CANDIDATES),
        lambda: plan(FEW, 2 * CANDIDATES),
    )
    spec = specification(q, MANY)
    rows = whitened_rows_by_load(spec, q[:CANDIDATES], np.zeros(CANDIDATES, dtype=int))
    problem = build_design_problem(spec.setup, rows, spec.prior_uncertainty)
    criterion = LinearCriterion(mean_square_weight(task_rows(spec) @ problem.lift))
    start = np.random.default_rng(2).integers(0, CANDIDATES, MANY)
    fast, slow = interleave(
        REPEATS,
        lambda: exchange_poses(problem, criterion, problem.rows, start),
        lambda: try_everything(problem, criterion, start),
    )
    alone = f"{spread(few)} s for {FEW} poses of {CANDIDATES}"
    return [
        at_most(
            f"(k) plan of {MANY} poses over one of {FEW}",
            np.median(many / few),
            "x",
            BAR_POSES,
            f"{alone}; {spread(many)} s for {MANY}",
        ),
        at_most(
            f"    plan of {FEW} poses, candidates doubled",
            np.median(twice / few),
            "x",
            BAR_CANDIDATES,
            f"{spread(twice)} s for {2 * CANDIDATES}",
        ),
        at_least(
            f"    every candidate tried over the exchange, {MANY} poses of {CANDIDATES}",
            np.median(slow / fast),
            "x",
            BAR_EXCHANGE,
            f"{spread(fast)} s against {spread(slow)} s, the same plan",
        ),
    ]
