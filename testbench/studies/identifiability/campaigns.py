"""A campaign with every method, and what is varied from there: prior, poses, structure, outliers.

Every method sees the same runs. Errors over the workspace are those of the true deflections in poses never
measured.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Literal

from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import Campaign, Cell, Scenario, draw_poses, simulate, simulate_at, stream
from testbench.bench.judged import judge_all
from testbench.bench.models import Model
from testbench.bench.rows import MM
from testbench.bench.wrong_prior import SCALE, wrong_prior
from testbench.data.outliers import spoil
from testbench.identify import gco, robust, with_prior
from testbench.identify.crossval import Candidate, held_out_errors, one_standard_error
from testbench.identify.method import ROBUST_UNCERTAINTY
from testbench.identify.prior import Strength
from testbench.identify.regularised import fit_all, fit_reduced
from testbench.studies.identifiability.coverage import Covered
from testbench.studies.identifiability.methods import (
    SCALE_BELIEVED,
    STRUCTURES,
    WITH_PRIOR,
    Asked,
    Fitted,
    ModelRow,
    fit_each,
    identified,
    plain,
)
from testbench.trials.spread import middle

SPOILED, SPOILED_BY = 0.05, 1e-3  #: Share of marker readings that are outliers, and by how much [m].

VARIED = ("MGCO56", "MGCO68")  #: Structures whose prior's scale and number of poses are varied.

Part = Literal["linear", "nonlinear", "scale", "fixed scale", "poses", "choice", "clean", "plain", "robust"]
"""Truth of the campaign; what is varied of the linear one; loss, without and with outliers."""


@dataclass(frozen=True)
class Tried:
    """What is varied."""

    structures: tuple[str, ...] = ("MGCO56", "MGCO68", "ALL153")  #: Names of `STRUCTURES` with a prior.
    scales: tuple[float, ...] = (0.2, 0.5, 1.0, 2.0, 5.0)  #: Factors by which the prior is wrong.
    poses: tuple[int, ...] = (5, 8, 12, 20, 40)  #: Numbers of identification poses.
    #: Names of `STRUCTURES` among which cross-validation chooses.
    choice: tuple[str, ...] = tuple(STRUCTURES)


@dataclass(frozen=True)
class TrialRow:
    """One fit of a campaign, or the intervals of one dataset."""

    part: Part | None = None  #: What is varied; None of intervals.
    fit: ModelRow | None = None  #: The model.
    x: float | None = None  #: Scale of the prior or number of poses, where that is varied.
    f_m_held_out: float | None = None  #: Of a choice: F_M on poses held out.
    is_recommended: bool | None = None  #: Whether it is recommended: by what is held out.
    spoiled: int | None = None  #: Readings that are outliers.
    rejected: int | None = None  #: Readings that the fit did without.
    intervals: Covered | None = None


def rows(cell: Cell, scenario: Scenario, tried: Tried, seed: int) -> Iterator[TrialRow]:
    """All fits of one seed."""
    scenario, poses = scenario.model_copy(update={"truth": "linear"}), draw_poses(cell, scenario, seed)
    linear = simulate_at(cell, scenario, seed, poses)
    bent = simulate_at(cell, scenario.model_copy(update={"truth": "nonlinear"}), seed, poses)
    incumbent = Asked(JOINTS, "LS + prior", SCALE)
    asked = [
        incumbent,
        *(Asked(name, method, SCALE) for name, method in product(tried.structures, WITH_PRIOR)),
    ]
    scaled = [
        Asked(n, m, scale) for scale, n, m in product(tried.scales, VARIED, ("LS + prior", "GCO + prior"))
    ]
    believed = [Asked(name, SCALE_BELIEVED, SCALE) for name in VARIED]
    choice = {name: Asked(name, "GCO + prior", SCALE) for name in (*tried.choice, *VARIED)}
    fits = fit_each(cell, linear, [*asked, *scaled, *believed, *choice.values()], seed)
    yield from _all_methods(cell, linear, "linear", {own: fits[own] for own in asked})
    yield from _all_methods(cell, bent, "nonlinear", fit_each(cell, bent, asked, seed))
    for own in scaled:
        yield TrialRow("scale", fits[own].row, own.scale)
    for own in believed:
        yield TrialRow("fixed scale", replace(fits[own].row, name=own.structure))
    known = [incumbent, *(choice[name] for name in VARIED)]
    for count in tried.poses:
        more = _with_poses(scenario, count)
        campaign = linear if more == scenario else simulate(cell, more, seed)
        found = fits if more == scenario else fit_each(cell, campaign, known, seed)
        for row in (*plain(cell, campaign), *(found[own].row for own in known)):
            yield TrialRow("poses", row, count)
    yield from _choice({name: fits[choice[name]] for name in tried.choice})
    yield from _outliers(cell, linear, seed)


def _with_poses(scenario: Scenario, count: int) -> Scenario:
    """The scenario with so many poses, each measured about twice."""
    runs = round(count * scenario.identification_runs / scenario.identification_poses)
    return scenario.model_copy(update={"identification_poses": count, "identification_runs": runs})


def _all_methods(
    cell: Cell, campaign: Campaign, part: Part, fits: Mapping[Asked, Fitted]
) -> Iterator[TrialRow]:
    """Models without a prior, then with; beside least squares how GCO does with the same, as firm a prior."""
    yield from (TrialRow(part, row) for row in plain(cell, campaign))
    least_squares = [fit for fit in fits.values() if fit.row.constraint == "none"]
    firm = [fit_reduced(fit.seen.regression, "psd", fit.estimate.belief) for fit in least_squares]
    ours = iter(judge_all(cell, campaign, firm))
    for fit in fits.values():
        row = fit.row
        if fit.row.constraint == "none":
            ratio = MM * next(ours).truth.rms / middle(fit.row.workspace.rms_mm)
            row = replace(row, gco_over_ls_at_this_strength=ratio)
        yield TrialRow(part, row)


def _choice(fits: Mapping[str, Fitted]) -> Iterator[TrialRow]:
    """Cross-validated errors of every structure with the prior, and which one the rule recommends."""
    candidates = []
    for name, fit in fits.items():
        again = partial(fit_all, constraint="psd", belief=fit.estimate.belief)
        candidates.append(
            Candidate(name, fit.seen.regression.structure.n, held_out_errors(fit.seen.folds, again))
        )
    chosen = one_standard_error(candidates)
    for c in candidates:
        row = replace(fits[c.name].row, name=c.name)
        yield TrialRow("choice", row, f_m_held_out=c.error, is_recommended=c.name == chosen)


def _outliers(cell: Cell, campaign: Campaign, seed: int) -> Iterator[TrialRow]:
    """What outliers cost with and without the robust loss, at one strength of the prior."""
    spoiled, where = spoil(campaign.identification, SPOILED, SPOILED_BY, stream(seed, 6))
    method = with_prior(gco, wrong_prior(cell, seed, SCALE), Strength(ROBUST_UNCERTAINTY))
    model = Model("MGCO68", STRUCTURES["MGCO68"](cell), method)
    careful = replace(model, estimator=robust(method))
    bad = replace(campaign, identification=spoiled)
    [(clean, _)] = identified(cell, campaign, [model], "prior")
    (unaware, _), (aware, estimate) = identified(cell, bad, [model, careful], "prior")
    yield TrialRow("clean", clean)
    yield TrialRow("plain", unaware)
    yield TrialRow("robust", aware, spoiled=int(where.sum()), rejected=len(estimate.rejected))
