"""What a model makes of a campaign, as a row: of every study that judges models by campaigns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.bench.campaign import Campaign, Cell, stream
from testbench.bench.error_places import Places, kept_mm, places_of
from testbench.bench.judged import Result
from testbench.bench.rows import (
    DatasetRow,
    JudgedRow,
    NormalityRow,
    dataset_row,
    fit_row,
    judged_row,
    normality_row,
)
from testbench.identify.evaluate import Normality, normality


@dataclass(frozen=True)
class Residuals:
    """Residual components of the runs that were fitted, and of those that were not."""

    identification: NormalityRow
    check: NormalityRow


@dataclass(frozen=True)
class Measured(DatasetRow):
    """What was measured."""

    poses: int
    identification_runs: int
    identification_points: int
    check_runs: int
    check_points: int
    workspace_poses: int


@dataclass(frozen=True)
class CampaignRow(JudgedRow):
    """One model in one trial."""

    residuals: Residuals
    measured: Measured
    true_arm: str  #: Its name in `TRUTHS`; model and prior are those of the folder.
    places: Places | None  #: Poses of the workspace; None but in the first seed.
    place_mm: tuple[float, ...] | None  #: Error in each of them.


def campaign_rows(
    cell: Cell, campaign: Campaign, results: Sequence[Result], true_arm: str, *, placed: bool
) -> list[CampaignRow]:
    """A row a model; `placed` with its errors pose by pose."""
    data, places = measured(campaign), places_of(cell, campaign.truth) if placed else None
    found = []
    for result, normal in zip(results, normalities(campaign, results), strict=True):
        prior = result.estimate.belief is not None
        fit = fit_row(result.model.name, result.estimate, result.seconds, prior=prior)
        own = CampaignRow(
            **vars(judged_row(fit, result)),
            residuals=Residuals(*map(normality_row, normal)),
            measured=data,
            true_arm=true_arm,
            places=places,
            place_mm=kept_mm(result.places) if placed else None,
        )
        found.append(own)
    return found


def normalities(campaign: Campaign, results: Sequence[Result]) -> list[tuple[Normality, Normality]]:
    """Of every model's residuals in the runs that were fitted, and in those that were not."""
    rng = stream(campaign.seed, 2)
    used = np.isin(campaign.measured.pose, campaign.identification.pose)
    fitted, others = (
        normality(np.array([result.residuals[runs].ravel() for result in results]), rng)
        for runs in (used, ~used)
    )
    return list(zip(fitted, others, strict=True))


def measured(campaign: Campaign) -> Measured:
    """Counts and deflections of a campaign."""
    every, fitted, check = campaign.measured, campaign.identification, campaign.check
    return Measured(
        **vars(dataset_row(every)),
        poses=len(np.unique(every.pose)),
        identification_runs=fitted.runs,
        identification_points=fitted.points,
        check_runs=check.runs,
        check_points=check.points,
        workspace_poses=campaign.truth.runs,
    )
