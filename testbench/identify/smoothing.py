"""Newton's method on the projection: squared residuals over positive semi-definite blocks, from any start.

At the optimum x is the projection of u = x - unit s onto the cone, s the gradient. Smoothed, eigenvalues w
of U give those of X, (w + sqrt(w^2 + 4 nu)) / 2, and those of unit S, nu over them. Newton's steps in u
follow nu down its path (Chen and Mangasarian 1996; Sun, Sun and Qi 2004). Nothing has to be positive, so that
they start from the optimum without a cone, or from one nearby.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from testbench.errors import Array
from testbench.identify.blocks import Blocks
from testbench.identify.linear import factorised
from testbench.identify.objective import TINY, Objective
from testbench.identify.regression import Ids

PATHS = (
    (1e-2, 1e-3, 1e-5, 1e-8, 1e-13),
    (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-7, 1e-10, 1e-14),
)
"""nu from step to step, in units of x squared: a quick way, and one for those whom it leads nowhere."""
MORE = 8  #: Steps at the end of a path after which it leads nowhere.
CONVERGED = 1e-18  #: Step as a share of x, both squared in the metric of the data, after which it ends.


@dataclass(frozen=True)
class State:
    """Some of the programs, on their way."""

    objective: Objective
    programs: Ids  #: Which they are, (B,).
    unit: Array  #: Size of x over that of s, (B,).
    square: Array  #: Size of x, squared, (B,).
    u: Array  #: x - unit s, (B, n).

    def take(self, which: Ids) -> "State":
        """Some of them."""
        if len(which) == len(self.programs):
            return self
        return State(
            objective=self.objective.take(which),
            programs=self.programs[which],
            unit=self.unit[which],
            square=self.square[which],
            u=self.u[which],
        )


@dataclass(frozen=True)
class Start:
    """Where to start from."""

    x: Array  #: With or without the cone, (B, n).
    unit: Array  #: Size of x over that of its multipliers, (B,).


def projected_newton(
    objective: Objective, blocks: Blocks, start: Start
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Minimise 1/2 |R x - z|^2 over positive semi-definite blocks; R has to see all of x.

    Returns:
        Coordinates of blocks and multipliers, both positive, (B, n) each, and which converged, (B,).
    """
    x, s, converged = start.x.copy(), np.zeros_like(start.x), np.zeros(len(start.x), dtype=bool)
    square = np.maximum((start.x**2).sum(axis=1) / blocks.degree, TINY)
    with np.errstate(all="ignore"):  # a step that is not finite ends it
        for path in PATHS:
            left = np.flatnonzero(~converged)
            if len(left):
                state = State(objective.take(left), left, start.unit[left], square[left], start.x[left])
                for programs, own, multipliers in _follow(state, blocks, path):
                    x[programs], s[programs], converged[programs] = own, multipliers, True
    return x, s, converged


def _follow(state: State, blocks: Blocks, path: tuple[float, ...]) -> Iterator[tuple[Ids, Array, Array]]:
    """Programs as they converge, with x and s."""
    for k in range(len(path) + MORE):
        state, x, s, done = _step(state, blocks, path[min(k, len(path) - 1)])
        done &= k >= len(path) - 1
        yield state.programs[done], x[done], s[done]
        state = state.take(np.flatnonzero(~done & np.isfinite(state.u).all(axis=1)))
        if not len(state.programs):
            return


def _step(state: State, blocks: Blocks, nu: float) -> tuple[State, Array, Array, npt.NDArray[np.bool_]]:
    """Newton's step; x and s before it, and whether they are the optimum."""
    objective, unit = state.objective, state.unit[:, None]
    w, Q = np.linalg.eigh(blocks.matrices(state.u) + blocks.padding)
    product = nu * state.square[:, None, None]
    large = (np.abs(w) + np.sqrt(w * w + 4 * product)) / 2
    small = product / large
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
    factors = factorised(A)
    dx = factors.solve(-missing)
    du = dx - unit * (missing + hessian.times(dx))
    size = ((objective.R @ x[..., None])[..., 0] ** 2).sum(axis=1)
    done = factors.good & (-(missing * dx).sum(axis=1) <= CONVERGED * np.maximum(size, TINY))
    return replace(state, u=np.where(factors.good[:, None], state.u + du, np.nan)), x, s, done
