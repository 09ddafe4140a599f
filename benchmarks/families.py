"""Many fits with a prior: time of a fit over Clarabel's own time for the same program."""

import numpy as np
from measure import MODELS, Row, at_most, interleave, note, spread

from testbench.errors import Array
from testbench.identify.conic import solve_gco
from testbench.identify.prior import (
    PriorUncertainty,
    WeightedPrior,
    cad_prior,
    rescale_to_data,
    rows_with_prior,
    scale_by_prior,
)
from testbench.identify.regression import Regression, reduce
from testbench.identify.solve import fit_on_cone_by_library, solve_with_prior
from testbench.model.structure import Structure, all153, mgco68, template56
from testbench.studies.intervals import resampler
from testbench.workflows.campaign import Scenario, simulate
from testbench.workflows.cell import Cell, build_cell

ARM = "kr500_l480"
FITS, ALONE, REPEATS = 100, 8, 5
BARRED = "ALL153"
BARS = {0.3: 0.25, 3.0: 1.0}
"""By uncertainty of the prior: firm enough that the cone hardly binds, and so weak that it does everywhere.

Where it does, every fit is a conic program of its own, which must not be slower than Clarabel.
"""


def families_of_fits() -> list[Row]:
    """A row for every structure and kind of fit."""
    arm = build_cell(MODELS / ARM)
    data = simulate(arm, Scenario(arm=ARM, workspace_poses=1), seed=1).identification
    rows = []
    for structure in (template56(arm.arm), mgco68(arm.arm), all153(arm.arm)):
        best = solve_gco(reduce(arm.vjm, structure, data))
        draw, rng = resampler(best.regression), np.random.default_rng(1)
        rows += rows_of(arm, structure, [draw(best.pi, rng) for _ in range(FITS)])
    return rows


def rows_of(arm: Cell, structure: Structure, regressions: list[Regression]) -> list[Row]:
    """GCO with a prior, of every dataset."""
    rows: list[Row] = []
    prior = rescale_to_data(scale_by_prior(cad_prior(arm.arm), arm.vjm, structure), regressions[0])
    for u, bar in BARS.items():
        weighted_prior = WeightedPrior(prior, PriorUncertainty(u))
        [together] = interleave(
            REPEATS,
            lambda p=weighted_prior: [solve_with_prior("psd", r, p) for r in regressions],  # type: ignore[misc]
        )
        problems = [rows_with_prior(r, prior, PriorUncertainty(u)) for r in regressions[:ALONE]]
        own = [fit_on_cone_by_library(M, r, prior.block_orders).seconds for M, r in problems]
        rows.append(_row(f"{structure.name}, prior uncertain by {100 * u:g} %", together, own, bar))
    return rows


def _row(name: str, together: Array, own: list[float], bar: float) -> Row:
    each = together / FITS
    behind = f"{spread(each, 1e3, 2)} ms a fit, Clarabel {spread(own, 1e3)} ms"
    title = f"(i) time of {FITS} fits at once over {FITS} of Clarabel: {name}"
    ratio = np.median(each) / np.median(own)
    return (
        at_most(title, ratio, "x", bar, behind)
        if name.startswith(BARRED)
        else note(title, ratio, "x", behind)
    )
