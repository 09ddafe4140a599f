"""Corrections of 10,000 points: time over that of one loaded equilibrium a point, and how exact they are."""

import numpy as np
from measure import Row, at_most, feasible_poses, interleave, note, spread

from testbench.correct.compensated import compensate
from testbench.correct.newton import Aim, InverseStaticsProblem, equilibrium, programmed_target
from testbench.correct.newton import solve_inverse_statics as corrected
from testbench.errors import Array
from testbench.identify.method import gco, with_prior
from testbench.identify.posterior import elastic_state, model_of_estimate
from testbench.identify.prior import cad_prior
from testbench.model.load import Load, read_body_masses
from testbench.model.structure import all153
from testbench.workflows.campaign import simulate
from testbench.workflows.cell import build_cell

ARM, SEED, POINTS, REPEATS = "kr500_l480", 5, 10_000, 5
FORCE = 2000.0  #: Of the process [N].
DRAWN = 300  #: Feasible poses between which paths run.


def correcting_ten_thousand_points() -> list[Row]:
    """The rows of time and accuracy; paths run between random feasible poses."""
    cell = build_cell(ARM)
    state = elastic_state(cell.vjm, cell.arm.C_theta, read_body_masses(cell.arm))
    q = _paths(feasible_poses(cell, DRAWN, SEED))
    force = np.random.default_rng(SEED).standard_normal((POINTS, 3))
    force *= FORCE / np.linalg.norm(force, axis=1, keepdims=True)
    load = Load(np.hstack([force, np.zeros((POINTS, 3))]), np.zeros((POINTS, 3)))
    found = []

    def solve() -> None:
        target = programmed_target(state, q, "unloaded", np.zeros(3))
        found.append(corrected(InverseStaticsProblem(state, q, [load], target, Aim(), np.ones(q.shape))))

    own, still = interleave(REPEATS, solve, lambda: equilibrium(state, q, [load]))
    left = np.linalg.norm(found[-1].position_error, axis=1).max()
    return [
        at_most(f"(m) correcting {POINTS} points", np.median(own), "s", 2, spread(own, digits=2)),
        note(
            "    the same over one equilibrium a point, by the steps that corrections take too",
            np.median(own / still),
            "x",
            f"own weight in both; {spread(still, digits=2)} s of equilibria alone",
        ),
        at_most("(m) farthest that a tool is left from its target", left, "m", 1e-9, ""),
        _with_intervals(q, load),
    ]


def _with_intervals(q: Array, load: Load) -> Row:
    """Corrections by an identified model of 153 unknowns, limits, intervals of what is left."""
    cell = build_cell(ARM)
    data = simulate(cell, seed=SEED).identification
    estimate = with_prior(gco, cad_prior(cell.arm))(cell.vjm, all153(cell.arm), data)
    model = model_of_estimate(cell.vjm, estimate, read_body_masses(cell.arm))
    [whole] = interleave(REPEATS, lambda: compensate(model, q, [load]))
    name = f"(m) {POINTS} points with limits and intervals"
    return note(name, np.median(whole), "s", spread(whole, digits=2))


def _paths(poses: Array) -> Array:
    """Points on straight ways from pose to pose, (POINTS, n) [rad]."""
    at = np.linspace(0, len(poses) - 1, POINTS)
    return np.column_stack([np.interp(at, np.arange(len(poses)), joint) for joint in poses.T])
