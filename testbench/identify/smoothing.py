"""Newton's method on the projection: squared residuals over positive semi-definite blocks, from any start.

At the optimum x is the projection of u = x - unit s onto the cone, s the gradient. Smoothed, eigenvalues w
of U give those of X, (w + sqrt(w^2 + 4 nu)) / 2, and those of unit S, nu over them. Newton's steps in u
follow nu down its path (Chen and Mangasarian 1996; Sun, Sun and Qi 2004). Nothing has to be positive, so that
they start from the optimum without a cone, or from one nearby.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from testbench.errors import Array
from testbench.identify.blocks import Blocks
from testbench.identify.linear import factorised
from testbench.identify.objective import TINY, Objective
from testbench.identify.regression import Ids

PATH = (1e-2, 1e-3, 1e-5, 1e-8, 1e-13)  #: nu from step to step, in units where compliances are of order one.
ITERATIONS = 30
CONVERGED = 1e-18  #: Step as a share of x, both squared in the metric of the data, after which it ends.


@dataclass(frozen=True)
class State:
    """Some of the programs, on their way."""

    objective: Objective
    programs: Ids  #: Which they are, (B,).
    unit: Array  #: Size of x over that of s, (B,).
    u: Array  #: x - unit s, (B, n).


def projected_newton(
    objective: Objective, blocks: Blocks, start: Array, unit: Array
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Minimise 1/2 |R x - z|^2 over positive semi-definite blocks; R has to see all of x.

    Args:
        objective: Squared residuals of B programs.
        blocks: What is positive semi-definite.
        start: x to start from, with or without the cone, (B, n).
        unit: Size of x over that of the multipliers, (B,).

    Returns:
        Coordinates of blocks and multipliers, both positive, (B, n) each, and which converged, (B,).
    """
    x, s, converged = start.copy(), np.zeros_like(start), np.zeros(len(start), dtype=bool)
    state = State(objective, np.arange(len(start)), unit, start)
    for k in range(ITERATIONS):
        last = k >= len(PATH) - 1
        state, own, multipliers, done = _step(state, blocks, PATH[min(k, len(PATH) - 1)])
        done &= last
        at = state.programs[done]
        x[at], s[at], converged[at] = own[done], multipliers[done], True
        left = np.flatnonzero(~done & np.isfinite(state.u).all(axis=1))
        if not len(left):
            break
        if len(left) < len(done):
            state = State(state.objective.take(left), state.programs[left], state.unit[left], state.u[left])
    return x, s, converged


def _step(state: State, blocks: Blocks, nu: float) -> tuple[State, Array, Array, npt.NDArray[np.bool_]]:
    """Newton's step; x and s before it, and whether they are the optimum."""
    objective, unit = state.objective, state.unit[:, None]
    w, Q = np.linalg.eigh(blocks.matrices(state.u) + blocks.padding)
    large = (np.abs(w) + np.sqrt(w * w + 4 * nu)) / 2
    small = nu / large
    p, d = np.where(w > 0, large, small)[..., None, :], np.where(w > 0, small, large)[..., None, :]
    turned = Q.swapaxes(-1, -2)
    x, s = blocks.vector((Q * p) @ turned), blocks.vector((Q * d) @ turned) / unit
    point = objective.at(x)
    missing = point.gradient - s
    hessian = objective.hessian(point, np.zeros(len(x)))
    A = hessian.matrix()
    blocks.add(
        A, blocks.sandwich(Q, (d + d.swapaxes(-1, -2)) / (p + p.swapaxes(-1, -2)) / unit[..., None, None])
    )
    solve, good = factorised(A, hessian.along)
    dx = solve(-missing)
    du = dx - unit * (missing + hessian.times(dx))
    size = ((objective.R @ x[..., None])[..., 0] ** 2).sum(axis=1)
    done = good & (-(missing * dx).sum(axis=1) <= CONVERGED * np.maximum(size, TINY))
    return replace(state, u=np.where(good[:, None], state.u + du, np.nan)), x, s, done
