"""Certified GCO of every parameter of an arm: against Clarabel's own time, and against the model in cvxpy."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from by_cvxpy import Entries, cvxpy, solve_modelled, vectorised
from measure import MODELS, Row, at_least, at_most, feasible_poses, interleave, note, seconds, spread

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.cone import SOLVER_TOLERANCE
from testbench.identify.conic import scaled_gco_program, solve_gco_by_clarabel, tie_break_penalty
from testbench.identify.estimate import Estimate
from testbench.identify.method import paper_gco
from testbench.identify.regression import reduce
from testbench.model.structure import Structure, all153
from testbench.plant.equilibrium import solve_linear_equilibrium
from testbench.plant.tracker import IsotropicTracker, read_orientations, read_positions
from testbench.workflows.cell import Cell, build_cell

ARMS = ("arm_6r", "kr500_l480")
POSES = 18
LOAD = 1000.0
"""Force [N] and moment [N m] along every axis in turn."""
SIGMA, SIGMA_ROTATION = 25e-6, 250e-6
REPEATS = 9
SOLVER = "CLARABEL"
AGREE = 1e-5
"""Relative difference of F_M that the two models may have."""
DEFAULT: dict[str, float] = {}
EQUAL = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), SOLVER_TOLERANCE)


def full_pose_runs(arm: Cell, seed: int) -> Dataset:
    """18 poses under 6 loads at the tool, markers and orientation read with noise; linear truth."""
    rng = np.random.default_rng(seed)
    q = np.repeat(feasible_poses(arm, POSES, seed), 6, axis=0)
    wrench, point = np.tile(LOAD * np.eye(6), (POSES, 1)), np.zeros((len(q), 3))
    before = solve_linear_equilibrium(arm.plant, q, 0 * wrench, point)
    after = solve_linear_equilibrium(arm.plant, q, wrench, point)
    tracker = IsotropicTracker(SIGMA, SIGMA_ROTATION)
    return Dataset(
        markers=arm.arm.markers,
        run_id=np.arange(len(q)) + 1,
        pose_id=np.arange(len(q)) // 6 + 1,
        q=q,
        wrench=wrench,
        point=point,
        before=read_positions(tracker, before.marker_positions, rng),
        after=read_positions(tracker, after.marker_positions, rng),
        sigma=SIGMA,
        rotation_before=read_orientations(tracker, before.tool_rotations, rng),
        rotation_after=read_orientations(tracker, after.tool_rotations, rng),
        sigma_rotation=SIGMA_ROTATION,
    )


def entry_by_entry(s: Structure, blocks: list[Any]) -> Any:
    """Parameters as the paper writes them: every one an entry of its block."""
    place = {int(row): (k, i) for k, block in enumerate(s.blocks) for i, row in enumerate(block)}
    picked = []
    for a, b in zip(s.rows, s.columns, strict=True):
        (k, i), (_, j) = place[int(a)], place[int(b)]
        picked.append(blocks[k][i, j])
    return cvxpy(SOLVER).hstack(picked)


@dataclass(frozen=True)
class Way:
    """A way to write the program down in cvxpy, and whether a bar is set against it."""

    label: str
    entries: Entries
    settings: dict[str, float]
    barred: bool


WAYS = (
    Way("default tolerance", entry_by_entry, DEFAULT, True),
    Way("equal tolerance", entry_by_entry, EQUAL, True),
    Way("vectorised by hand, default tolerance", vectorised, DEFAULT, False),
    Way("vectorised by hand, equal tolerance", vectorised, EQUAL, False),
)


def gco_against_its_solver_and_cvxpy() -> list[Row]:
    """The rows of both six-axis arms."""
    return [row for name in ARMS for row in rows_of(build_cell(MODELS / name))]


def rows_of(arm: Cell) -> list[Row]:
    """The rows of one arm."""
    name = arm.arm.name
    data = full_pose_runs(arm, seed=1)
    structure = all153(arm.arm)
    regression = reduce(arm.vjm, structure, data)
    ours: list[Estimate] = []
    theirs: list[list[Estimate]] = [[] for _ in WAYS]

    def by_cvxpy(way: Way, results: list[Estimate]) -> None:
        found = solve_modelled(regression, SOLVER, entries=way.entries, max_threads=1, **way.settings)
        results.append(found)

    solver: list[float] = []

    def alone() -> None:
        solver.append(
            solve_gco_by_clarabel(
                regression, scaled_gco_program(regression, tie_break_penalty(regression))
            ).solver_seconds
        )

    wall, _, *others = interleave(
        REPEATS,
        lambda: ours.append(paper_gco(arm.vjm, structure, data)),
        alone,
        *(partial(by_cvxpy, way, results) for way, results in zip(WAYS, theirs, strict=True)),
    )
    own = np.array(solver[1:])
    both = f"GCO {spread(wall, 1e3, 0)} ms, Clarabel {spread(own, 1e3, 0)} ms"
    size = f"{structure.n_parameters} unknowns, {data.n_runs} runs"
    title = f"(c) {name}: certified GCO over Clarabel's own time, {size}"
    ratio = wall / np.median(own)
    reducing = [seconds(lambda: reduce(arm.vjm, structure, data)) for _ in range(REPEATS)]
    text = "a part of GCO's time, none of cvxpy's"
    return [
        at_most(title, np.median(ratio), "x", 0.8, f"ratio {spread(ratio, digits=2)}: {both}"),
        *(way_row(name, *row, wall) for row in zip(WAYS, theirs, others, strict=True)),
        *agreement(name, ours[0], [results[0].f_m for results in theirs]),
        note(f"    {name}: reducing the dataset", 1e3 * np.median(reducing), "ms", text),
    ]


def way_row(name: str, way: Way, results: list[Estimate], times: Array, wall: Array) -> Row:
    """Time of one way to write the program down, over that of GCO."""
    inside = spread([r.solver_seconds for r in results[1:]], 1e3, 0)
    ratio, text = times / wall, f"cvxpy {spread(times, 1e3, 0)} ms, of which Clarabel {inside} ms"
    behind = f"ratio {spread(ratio)}: {text}"
    if way.barred:
        return at_least(
            f"(c) {name}: cvxpy over certified GCO, {way.label}", np.median(ratio), "x", 2, behind
        )
    return note(f"    {name}: {way.label}", np.median(ratio), "x", behind)


def agreement(name: str, best: Estimate, costs: list[float]) -> list[Row]:
    """Whether all found the same F_M, and what is proven of it."""
    assert best.certificate is not None
    apart = max(abs(cost / best.f_m - 1) for cost in costs)
    listed = f"GCO {best.f_m:.9f}, cvxpy {', '.join(f'{cost:.9f}' for cost in costs)}"
    text = f"{best.status}; rank {best.regression.rank}; F_M of noise alone {best.f_m_floor:.3f}"
    return [
        at_most(f"(c) {name}: relative difference of F_M", apart, "", AGREE, listed),
        note(f"    {name}: duality gap over F_M", best.certificate.duality_gap / best.f_m, "", text),
    ]
