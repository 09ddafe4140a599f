"""Set-based bounds of predicted deflections: time of one bound on one core."""

from measure import MODELS, Row, at_most, note, seconds, spread

from testbench.data.dataset import Dataset
from testbench.identify.metric import cad_prior, scale_by_prior
from testbench.identify.regression import reduce
from testbench.model.structure import Structure, all153, mgco68, template56
from testbench.model.vjm import chain, observation
from testbench.studies.intervals import CEILING, FitSet, bounds, fit_set
from testbench.workflows.campaign import Scenario, simulate
from testbench.workflows.cell import Cell, build_cell

ARM = "kr500_l480"
CONFIDENCE = 0.95
POSES = 10
STRUCTURES = (template56, mgco68, all153)
BARRED = ("MGCO56", "MGCO68")
BAR_MS = 50.0


def bounds_of_deflections() -> list[Row]:
    """A row for every structure."""
    arm = build_cell(MODELS / ARM)
    campaign = simulate(arm, Scenario(arm=ARM, truth="linear", workspace_poses=POSES), seed=1)
    return [
        row_of(arm, structure(arm.arm), campaign.identification, campaign.truth) for structure in STRUCTURES
    ]


def row_of(arm: Cell, structure: Structure, data: Dataset, elsewhere: Dataset) -> Row:
    """Both bounds of every marker's deflection along x, y and z in poses never measured."""
    regression = reduce(arm.vjm, structure, data)
    prior = scale_by_prior(cad_prior(arm.arm), arm.vjm, structure)
    sets: list[FitSet] = []
    ready = seconds(lambda: sets.append(fit_set(regression, prior, CONFIDENCE)))
    args = (chain(arm.vjm, elsewhere.q), structure, elsewhere.wrench, elsewhere.point)
    rows = observation(*args, arm.vjm.markers[:1]).reshape(-1, structure.n)
    each = [seconds(lambda a=a: bounds(sets[0], a[None])) / 2 for a in rows]  # type: ignore[misc]
    together = seconds(lambda: bounds(sets[0], rows)) / (2 * len(rows))
    name = f"least or greatest deflection, {structure.name}, ceiling {CEILING:g} times the prior"
    behind = (
        f"{spread(each, 1e3)} ms one by one, the program set up each time; the set itself "
        f"{1e3 * ready:.0f} ms once"
    )
    if structure.name in BARRED:
        return at_most(f"(f) {name}", 1e3 * together, "ms", BAR_MS, behind)
    return note(f"    {name}", 1e3 * together, "ms", behind)
