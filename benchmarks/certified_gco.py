"""Certified GCO of every parameter of an arm: against Clarabel's own time, and against the model in cvxpy."""

from dataclasses import dataclass

import cvxpy as cp
import numpy as np
from measure import Row, at_least, at_most, cell, feasible_poses, interleave, note, seconds, spread
from scipy import sparse

from testbench.bench import Cell
from testbench.dataset import Dataset
from testbench.errors import Array
from testbench.identify import Estimate, gco, reduce
from testbench.identify.certify import scaled_units
from testbench.identify.conic import SOLVER_TOLERANCE, scale_program
from testbench.identify.regression import Regression, f_m
from testbench.plant import settle_linear
from testbench.poses import WorkArea
from testbench.structure import all153
from testbench.tracker import Tracker, read_orientations, read_positions

ANYWHERE = WorkArea((-9.0, -9.0, -9.0), (9.0, 9.0, 9.0))
POSES = 18
LOAD = 1000.0
"""Force [N] and moment [N m] along every axis in turn."""
SIGMA, SIGMA_ROTATION = 25e-6, 250e-6
REPEATS = 9
DEFAULT: dict[str, float] = {}
EQUAL = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), SOLVER_TOLERANCE)


def full_pose_runs(arm: Cell, seed: int) -> Dataset:
    """18 poses under 6 loads at the tool, markers and orientation read with noise, linear truth."""
    rng = np.random.default_rng(seed)
    q = np.repeat(feasible_poses(arm, POSES, seed, ANYWHERE), 6, axis=0)
    wrench, point = np.tile(LOAD * np.eye(6), (POSES, 1)), np.zeros((len(q), 3))
    before = settle_linear(arm.plant, q, 0 * wrench, point)
    after = settle_linear(arm.plant, q, wrench, point)
    tracker = Tracker(SIGMA, SIGMA_ROTATION)
    return Dataset(
        markers=arm.arm.markers,
        run=np.arange(len(q)) + 1,
        pose=np.arange(len(q)) // 6 + 1,
        q=q,
        wrench=wrench,
        point=point,
        before=read_positions(tracker, before.markers, rng),
        after=read_positions(tracker, after.markers, rng),
        sigma=SIGMA,
        rotation_before=read_orientations(tracker, before.rotation, rng),
        rotation_after=read_orientations(tracker, after.rotation, rng),
        sigma_rotation=SIGMA_ROTATION,
    )


@dataclass(frozen=True)
class Modelled:
    """A solution by way of cvxpy.

    Attributes:
        f_m: Cost of its parameters, Eq. (19).
        solver_seconds: Clarabel's own time.
    """

    f_m: float
    solver_seconds: float


def solve_by_cvxpy(regression: Regression, settings: dict[str, float]) -> Modelled:
    """The same program as `gco`, in the same units, written down in cvxpy and solved by Clarabel.

    Args:
        regression: The reduced dataset.
        settings: Of Clarabel.
    """
    program = scale_program(regression)
    s = program.structure
    blocks = [cp.Variable((len(block), len(block)), PSD=True) for block in s.blocks]
    x = cp.sum([
        chosen_entries(s.a, s.b, block) @ cp.vec(X, order="F")
        for X, block in zip(blocks, s.blocks, strict=True)
    ])
    norms = [
        cp.norm(
            cp.hstack([
                (term.R[:, program.columns] * (program.scale / program.unit)) @ x - term.z / program.unit,
                np.sqrt(term.rest) / program.unit,
            ])
        )
        for term in regression.terms
    ]
    trace = np.where(s.a == s.b, program.scale / scaled_units(s)[s.a] ** 2, 0.0)
    problem = cp.Problem(cp.Minimize(cp.sum(norms) + program.trace_weight / program.unit * (trace @ x)))
    problem.solve(solver=cp.CLARABEL, max_threads=1, **settings)
    pi = np.zeros(regression.structure.n)
    pi[program.columns] = program.scale * x.value
    return Modelled(f_m(regression, pi), problem.solver_stats.solve_time)


def chosen_entries(a: Array, b: Array, block: Array) -> sparse.csr_array:
    """Matrix that takes a block's entries, column by column, to the parameters that are entries of it."""
    position = np.full(max(a.max(), b.max(), block.max()) + 1, -1)
    position[block] = np.arange(len(block))
    k = np.flatnonzero(position[a] >= 0)
    entry = position[a[k]] + len(block) * position[b[k]]
    return sparse.csr_array((np.ones(len(k)), (k, entry)), shape=(len(a), len(block) ** 2))


def gco_against_its_solver_and_cvxpy() -> list[Row]:
    """The rows of both six-axis arms."""
    return [row for name in ("arm_6r", "kr500_l480") for row in _rows_of(cell(name), name)]


def _rows_of(arm: Cell, name: str) -> list[Row]:
    data, structure = full_pose_runs(arm, seed=1), all153(arm.arm)
    regression = reduce(arm.vjm, structure, data)
    ours: list[Estimate] = []
    default: list[Modelled] = []
    equal: list[Modelled] = []

    wall, by_default, by_equal = interleave(
        REPEATS,
        lambda: ours.append(gco(arm.vjm, structure, data)),
        lambda: default.append(solve_by_cvxpy(regression, DEFAULT)),
        lambda: equal.append(solve_by_cvxpy(regression, EQUAL)),
    )
    best = ours[0]
    solver = np.array([e.solver_seconds for e in ours[1:]])
    assert best.certificate is not None
    rows = [
        at_most(
            f"(c) {name}, {structure.n} unknowns, {data.runs} runs: certified GCO over Clarabel's own time",
            float(np.median(wall / solver)),
            "x",
            1.5,
            f"GCO {spread(wall, 1e3, 0)} ms, Clarabel {spread(solver, 1e3, 0)} ms, ratio "
            f"{spread(wall / solver, digits=2)}",
        )
    ]
    for label, times, results in (("default", by_default, default), ("equal", by_equal, equal)):
        own = [1e3 * r.solver_seconds for r in results[1:]]
        rows.append(
            at_least(
                f"(c) {name}: cvxpy and Clarabel at {label} tolerance over certified GCO",
                float(np.median(times / wall)),
                "x",
                2,
                f"cvxpy {spread(times, 1e3, 0)} ms, Clarabel {spread(own, digits=0)} of them, ratio "
                f"{spread(times / wall)}",
            )
        )
    apart = max(abs(r.f_m - best.f_m) for r in (*default, *equal)) / best.f_m
    return [
        *rows,
        at_most(
            f"(c) {name}: relative difference of the two F_M",
            apart,
            "1",
            1e-5,
            f"GCO {best.f_m:.9f}, cvxpy {default[0].f_m:.9f} and {equal[0].f_m:.9f}; floor {best.f_m_floor:.3f}",
        ),
        at_most(
            f"(c) {name}: certified gap over F_M",
            best.certificate.gap / best.f_m,
            "1",
            1e-5,
            f"{best.status}; rank {regression.rank}",
        ),
        note(
            f"    {name}: reading and reducing the dataset",
            1e3 * seconds(lambda: reduce(arm.vjm, structure, data)),
            "ms",
            "a part of GCO's time",
        ),
    ]
