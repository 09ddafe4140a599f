"""Set-based bounds of predicted deflections: time of one bound on one core."""

import numpy as np
from measure import MODELS, Row, at_most, note, seconds, spread

from testbench.bench.campaign import Cell, Scenario, build_cell, simulate
from testbench.data.dataset import Dataset
from testbench.identify import reduce
from testbench.identify.bounds import FitSet, bounds, fit_set
from testbench.identify.prior import cad_prior, metric
from testbench.identify.uncertainty import deflection_rows
from testbench.model.structure import Structure, all153, mgco68, template56

ARM = "kr500_l480"
CONFIDENCE = 0.95
CEILINGS = (10.0, None)
POSES = 10
STRUCTURES = (template56, mgco68, all153)
BARRED = ("MGCO56", "MGCO68")
BAR_MS = 50.0


def bounds_of_deflections() -> list[Row]:
    """A row for every structure, with and without a ceiling."""
    arm = build_cell(MODELS / ARM)
    campaign = simulate(arm, Scenario(arm=ARM, truth="linear", workspace_poses=POSES), seed=1)
    return [
        row_of(arm, structure(arm.arm), campaign.identification, campaign.workspace, ceiling)
        for structure in STRUCTURES
        for ceiling in CEILINGS
    ]


def row_of(arm: Cell, structure: Structure, data: Dataset, elsewhere: Dataset, ceiling: float | None) -> Row:
    """Both bounds of every marker's deflection along x, y and z in poses never measured."""
    regression = reduce(arm.vjm, structure, data)
    prior = metric(cad_prior(arm.arm), arm.vjm, structure)
    sets: list[FitSet] = []
    ready = seconds(lambda: sets.append(fit_set(regression, prior, CONFIDENCE, ceiling=ceiling)))
    rows = deflection_rows(
        arm.vjm, structure, elsewhere.q, elsewhere.wrench, elsewhere.point, targets=arm.vjm.markers[:1]
    )
    found = bounds(sets[0], rows)
    each = [seconds(lambda a=a: bounds(sets[0], a[None])) / 2 for a in rows]  # type: ignore[misc]
    together = seconds(lambda: bounds(sets[0], rows)) / (2 * len(rows))
    endless = float(np.mean(np.isinf([found.lower, found.upper])))
    limit = "no ceiling" if ceiling is None else f"ceiling {ceiling:g} times the prior"
    name = f"least or greatest deflection, {structure.name}, {limit}"
    behind = (
        f"{spread(each, 1e3)} ms one by one, the program set up each time; the set itself "
        f"{1e3 * ready:.0f} ms once; {100 * endless:.0f} % unbounded"
    )
    if structure.name in BARRED:
        return at_most(f"(f) {name}", 1e3 * together, "ms", BAR_MS, behind)
    return note(f"    {name}", 1e3 * together, "ms", behind)
