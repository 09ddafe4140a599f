"""Single fits with a prior end to end, from dataset to estimate, against Clarabel's own time."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from measure import MODELS, Row, at_most, interleave, note, spread

from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset
from testbench.identify.method import gco, with_prior
from testbench.identify.prior import PriorUncertainty, cad_prior, rows_with_prior
from testbench.identify.regression import reduce
from testbench.identify.solve import fit_on_cone_by_library
from testbench.model.structure import Structure, all153, mgco68, template56
from testbench.workflows.campaign import Scenario, simulate
from testbench.workflows.cell import Cell, build_cell

ARM = "kr500_l480"
STRENGTH = PriorUncertainty(0.3)
REPEATS, TIMES = 15, 10  #: So many fits in a row are timed so often.


@dataclass(frozen=True)
class Fit:
    """What is fitted, and its bars."""

    structure: Callable[[Arm], Structure]
    ratio: float  #: Bar of the time of the whole fit over Clarabel's own.
    ms: float  #: What the whole fit may take on a core at rest [ms].


FITS = (
    Fit(template56, ratio=1.0, ms=1.5),
    Fit(mgco68, ratio=0.6, ms=1.5),
    Fit(all153, ratio=0.5, ms=6.0),
)


def single_fits() -> list[Row]:
    """The rows of all fits of the gravity campaign, 15 runs of three markers."""
    cell = build_cell(MODELS / ARM)
    data = simulate(cell, Scenario(arm=ARM, workspace_poses=1), seed=1).identification
    return [row for fit in FITS for row in rows_of(cell, fit, data)]


def rows_of(cell: Cell, fit: Fit, data: Dataset) -> list[Row]:
    """Ratio and time of a fit, the reduction of the dataset included."""
    structure, regression = fit.structure(cell.arm), reduce(cell.vjm, fit.structure(cell.arm), data)
    method = with_prior(gco, cad_prior(cell.arm), STRENGTH)
    weighted_prior = method(cell.vjm, structure, data).weighted_prior
    assert weighted_prior is not None
    own: list[float] = []

    def often(run: Callable[[], object]) -> Callable[[], object]:
        return lambda: [run() for _ in range(TIMES)]

    def alone() -> None:
        M, r = rows_with_prior(regression, weighted_prior.scaling, weighted_prior.uncertainty)
        own.append(fit_on_cone_by_library(M, r, weighted_prior.scaling.block_orders).seconds)

    times = interleave(
        REPEATS,
        often(lambda: method(cell.vjm, structure, data)),
        often(alone),
        often(lambda: reduce(cell.vjm, structure, data)),
    )
    whole, reducing = times[0] / TIMES, times[2] / TIMES
    solver = np.reshape(own, (-1, TIMES))[1:].mean(axis=1)
    ratio = whole / solver
    name = f"{structure.name} with prior, {data.n_runs} runs: fit end to end"
    behind = (
        f"Clarabel {spread(solver, 1e3, 2)} ms; of the fit {spread(reducing, 1e3, 2)} ms reduce the dataset"
    )
    return [
        at_most(f"(j) {name} over Clarabel", np.median(ratio), "x", fit.ratio, spread(ratio, digits=2)),
        note(f"    the same, {fit.ms:g} ms on a core at rest", 1e3 * np.median(whole), "ms", behind),
    ]
