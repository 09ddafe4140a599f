"""The conic program of GCO written down in cvxpy: any of its solvers may be the referee.

cvxpy is no dependency of the package: it is imported where it is used, and its absence is one line.
"""

import importlib
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from testbench.errors import BenchError
from testbench.identify.cone import nearest_psd
from testbench.identify.conic import scaled_gco_program, tie_break_penalty
from testbench.identify.estimate import Estimate, make_estimate
from testbench.identify.regression import Regression, check_symmetric
from testbench.model.structure import Structure

Entries = Callable[[Structure, list[Any]], Any]
"""How a model takes its parameters from its blocks, both expressions of cvxpy."""


def cvxpy(solver: str) -> Any:
    """Import cvxpy with this solver; BenchError where one of them is not installed."""
    try:
        module: Any = importlib.import_module("cvxpy")
    except ImportError:
        raise BenchError(f"{solver} is called through cvxpy, which is not installed: make bench") from None
    if solver not in module.installed_solvers():
        have = ", ".join(sorted(module.installed_solvers()))
        raise BenchError(f"cvxpy has no solver {solver!r} here; it has {have}")
    return module


def vectorised(s: Structure, blocks: list[Any]) -> Any:
    """Write parameters as sparse matrices times whole blocks, as a user of cvxpy does for speed.

    Args:
        s: The unknowns.
        blocks: Variables of the blocks.

    Returns:
        The expression.
    """
    cp = cvxpy("CLARABEL")
    return cp.sum(
        [_picking(s, block) @ cp.vec(X, order="F") for X, block in zip(blocks, s.blocks, strict=True)]
    )


def _picking(s: Structure, block: npt.NDArray[np.int_]) -> sparse.csr_array:
    position = np.full(s.n_theta, -1)
    position[block] = np.arange(len(block))
    k = np.flatnonzero(position[s.rows] >= 0)
    entry = position[s.rows[k]] + len(block) * position[s.columns[k]]
    return sparse.csr_array((np.ones(len(k)), (k, entry)), shape=(s.n_parameters, len(block) ** 2))


def solve_modelled(regression: Regression, solver: str, *, entries: Entries, **settings: float) -> Estimate:
    """Solve the program of the paper's GCO in the same units, written down in cvxpy.

    Args:
        regression: The reduced dataset.
        solver: Name of the solver.
        entries: Writes parameters as an expression.
        settings: Settings of the solver.

    Returns:
        The estimate.

    Raises:
        BenchError: When cvxpy or the solver is not installed, or the structure is not symmetric.
    """
    cp = cvxpy(solver)
    check_symmetric(regression.structure)
    program = scaled_gco_program(regression, tie_break_penalty(regression))
    s = program.observed_structure
    blocks = [cp.Variable((len(block), len(block)), PSD=True) for block in s.blocks]
    x = entries(s, blocks)
    cost = program.trace_cost @ x
    for R, z, rest in zip(program.R, program.z, program.unexplained, strict=True):
        cost += cp.norm(cp.hstack([R @ x - z, rest]))
    problem = cp.Problem(cp.Minimize(cost))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Solution may be inaccurate")  # the status tells
        problem.solve(solver=solver, **settings)
    C = np.zeros((s.n_theta, s.n_theta))
    for i, X in zip(s.blocks, blocks, strict=True):
        C[np.ix_(i, i)] = nearest_psd((X.value + X.value.T) / 2)
    pi = program.to_pi(s.parameters_of(C), regression.structure.n_parameters)
    method, word = f"GCO (conic program, cvxpy with {solver})", str(problem.status)
    return replace(
        make_estimate(regression, pi, method=method, constraint="psd"),
        status="not certified" if word == "optimal" else f"not solved: {solver} says {word}",
        solver_seconds=float(problem.solver_stats.solve_time),
    )
