"""A campaign with every method, and what is varied from there: prior, poses, structure, outliers.

Every method sees the same runs. Errors over the workspace are those of the true deflections in poses never
measured.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Literal

from testbench.bench.campaign import Campaign, Cell, Model, Scenario, simulate, stream
from testbench.data.outliers import spoil
from testbench.identify import gco, robust, with_prior
from testbench.identify.crossval import Candidate, every_fold, held_out_errors, one_standard_error
from testbench.identify.method import ROBUST_UNCERTAINTY
from testbench.identify.prior import Prior, Strength, cad_prior, distorted
from testbench.identify.regularised import fit_all
from testbench.studies.identifiability.methods import (
    STRUCTURES,
    WITH_PRIOR,
    ModelRow,
    filled,
    fixed_scale,
    judge,
    plain,
)
from testbench.trials.spread import middle

SCALE, SHAPE = 2.0, 0.3
"""How wrong the prior is: its common factor, the deviation of the logarithm of each axis's own factor."""
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
class CampaignRow:
    """One fit."""

    part: Part  #: What is varied.
    fit: ModelRow  #: The model.
    x: float | None = None  #: Scale of the prior or number of poses, where that is varied.
    held_out_f_m: float | None = None  #: Of a choice: F_M on poses held out.
    chosen: bool | None = None  #: Whether cross-validation recommends it.
    spoiled: int | None = None  #: Readings that are outliers.
    rejected: int | None = None  #: Readings that the fit did without.


def rows(cell: Cell, scenario: Scenario, tried: Tried, seed: int) -> Iterator[CampaignRow]:
    """All fits of one seed."""
    prior = _wrong(cell, SCALE, seed)
    linear = simulate(cell, scenario.model_copy(update={"truth": "linear"}), seed)
    bent = simulate(cell, scenario.model_copy(update={"truth": "nonlinear"}), seed)
    yield from (CampaignRow("linear", fit) for fit in _all_methods(cell, linear, prior, tried))
    yield from (CampaignRow("nonlinear", fit) for fit in _all_methods(cell, bent, prior, tried))
    for scale, name, method in product(tried.scales, VARIED, ("LS + prior", "GCO + prior")):
        yield CampaignRow("scale", filled(cell, linear, name, method, _wrong(cell, scale, seed)), scale)
    for name in VARIED:
        model = Model(name, STRUCTURES[name](cell), fixed_scale(prior))
        yield CampaignRow("fixed scale", judge(cell, linear, model, "prior")[0])
    for count in tried.poses:
        yield from _poses(cell, scenario, count, prior, seed)
    yield from _choice(cell, linear, prior, tried)
    yield from _outliers(cell, linear, prior, seed)


def _wrong(cell: Cell, scale: float, seed: int) -> Prior:
    return distorted(cad_prior(cell.arm), scale=scale, shape=SHAPE, rng=stream(seed, 5))


def _all_methods(cell: Cell, campaign: Campaign, prior: Prior, tried: Tried) -> Iterator[ModelRow]:
    yield from plain(cell, campaign)
    for name in tried.structures:
        for method in WITH_PRIOR:
            row = filled(cell, campaign, name, method, prior)
            yield _against_gco(cell, campaign, row, prior) if row.constraint == "none" else row


def _against_gco(cell: Cell, campaign: Campaign, ls: ModelRow, prior: Prior) -> ModelRow:
    """Least squares with a prior, and how GCO does with the same one, believed as firmly."""
    method = with_prior(gco, prior, Strength(middle(ls.uncertainty_percent) / 100))
    ours, _ = judge(cell, campaign, Model(ls.name, STRUCTURES[ls.structure](cell), method), "prior")
    ratio = middle(ours.workspace.rms_mm) / middle(ls.workspace.rms_mm)
    return replace(ls, gco_over_ls_at_this_strength=ratio)


def _poses(cell: Cell, scenario: Scenario, count: int, prior: Prior, seed: int) -> Iterator[CampaignRow]:
    """So many poses, each measured about twice."""
    runs = round(count * scenario.identification_runs / scenario.identification_poses)
    update = {"truth": "linear", "identification_poses": count, "identification_runs": runs}
    campaign = simulate(cell, scenario.model_copy(update=update), seed)
    fits = [*plain(cell, campaign)]
    fits += [filled(cell, campaign, name, "GCO + prior", prior) for name in VARIED]
    yield from (CampaignRow("poses", fit, count) for fit in fits)


def _choice(cell: Cell, campaign: Campaign, prior: Prior, tried: Tried) -> Iterator[CampaignRow]:
    """Cross-validated errors of every structure with the prior, and which one the rule recommends."""
    data, candidates, fits = campaign.identification, [], {}
    for name in tried.choice:
        structure = STRUCTURES[name](cell)
        fits[name], estimate = judge(cell, campaign, Model(name, structure, with_prior(gco, prior)), "prior")
        belief = estimate.belief
        assert belief is not None  # it has a prior
        fit = partial(fit_all, constraint="psd", belief=belief)
        errors = held_out_errors(every_fold(cell.vjm, structure, data), fit)
        candidates.append(Candidate(name, structure.n, errors))
    chosen = one_standard_error(candidates)
    for c in candidates:
        yield CampaignRow("choice", fits[c.name], held_out_f_m=c.error, chosen=c.name == chosen)


def _outliers(cell: Cell, campaign: Campaign, prior: Prior, seed: int) -> Iterator[CampaignRow]:
    """What outliers cost with and without the robust loss, at one strength of the prior."""
    spoiled, where = spoil(campaign.identification, SPOILED, SPOILED_BY, stream(seed, 6))
    bad = replace(campaign, identification=spoiled)
    method = with_prior(gco, prior, Strength(ROBUST_UNCERTAINTY))
    model = Model("MGCO68", STRUCTURES["MGCO68"](cell), method)
    yield CampaignRow("clean", judge(cell, campaign, model, "prior")[0])
    yield CampaignRow("plain", judge(cell, bad, model, "prior")[0])
    fit, estimate = judge(cell, bad, replace(model, estimator=robust(method)), "prior")
    yield CampaignRow("robust", fit, spoiled=int(where.sum()), rejected=len(estimate.rejected))
