"""What a model makes of a campaign, as a row: of every study that judges models by campaigns."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from testbench.campaign.campaign import Campaign, Cell, Setup
from testbench.campaign.evaluation import Result
from testbench.campaign.rows import DatasetRow, ErrorRow, FitRow, dataset_row, error_row, fit_row
from testbench.campaign.workspace_errors import Places, kept_mm, places_of
from testbench.data.dataset import Dataset

Flat = tuple[float, ...]


@dataclass(frozen=True)
class Runs:
    """A dataset as the row of a trial holds it, its arrays flat."""

    run: tuple[int, ...]
    pose: tuple[int, ...]
    q: Flat
    wrench: Flat
    point: Flat
    before: Flat
    after: Flat
    rotation_before: Flat | None
    rotation_after: Flat | None


@dataclass(frozen=True)
class Drawn:
    """What the pictures of the first seed are made of: nobody simulates it again."""

    measured: Runs | None  #: All measured runs, in the row of the first model.
    over: Runs | None  #: The same of the true deflections that models are judged by.
    residuals_m: Flat  #: Readings minus predictions of all measured runs.
    wrong_m: Flat  #: True minus predicted deflections.


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
class CampaignRow(FitRow):
    """One model in one trial."""

    identification: ErrorRow  #: At the poses that were fitted, against their readings.
    check: ErrorRow  #: At check poses, against their readings.
    check_true: ErrorRow  #: At check poses, against the true deflections.
    workspace: ErrorRow  #: Over the whole workspace, against the true deflections.
    measured: Measured
    true_arm: str  #: Its name in `TRUTHS`; model and prior are those of the folder.
    places: Places | None  #: Poses of the workspace; None but in the first seed.
    place_mm: tuple[float, ...] | None  #: Error in each of them.
    drawn: Drawn | None = None  #: For pictures; None but in the first seed.


def campaign_rows(
    cell: Cell, campaign: Campaign, results: Sequence[Result], true_arm: str, *, placed: bool
) -> list[CampaignRow]:
    """A row a model; `placed` with its errors pose by pose, and what pictures need."""
    data, found = measured(campaign), []
    for k, result in enumerate(results):
        prior = result.estimate.belief is not None
        own = CampaignRow(
            **vars(fit_row(result.model.name, result.estimate, result.seconds, prior=prior)),
            identification=error_row(result.identification),
            check=error_row(result.check),
            check_true=error_row(result.check_true),
            workspace=error_row(result.truth),
            measured=data,
            true_arm=true_arm,
            places=places_of(cell, campaign.truth) if placed else None,
            place_mm=kept_mm(result.places) if placed else None,
            drawn=_drawn(campaign, result, whole=k == 0) if placed else None,
        )
        found.append(own)
    return found


def _drawn(campaign: Campaign, result: Result, *, whole: bool) -> Drawn:
    """What pictures need of a model; `whole` with the runs, once a campaign."""
    measured, over = (_runs(data) if whole else None for data in (campaign.measured, campaign.truth))
    return Drawn(measured, over, *(tuple(own.ravel().tolist()) for own in (result.residuals, result.wrong)))


def _runs(data: Dataset) -> Runs:
    """A dataset for a row: see `dataset_of`."""
    arrays = (getattr(data, f.name) for f in fields(Runs))
    flat = (None if own is None else tuple(own.ravel().tolist()) for own in arrays)
    return Runs(*flat)  # type: ignore[arg-type]  # run and pose are whole numbers, and always there


def dataset_of(cell: Cell, setup: Setup, runs: Runs) -> Dataset:
    """The runs of a row as a dataset again, bit by bit."""
    markers, (sigma, sigma_rotation), n = cell.arm.markers, setup.sigmas, len(runs.run)
    shapes = {"run": (n,), "pose": (n,), "before": (n, len(markers), 3), "after": (n, len(markers), 3)}
    arrays = {
        key: None if own is None else np.reshape(own, shapes.get(key, (n, -1)))
        for key, own in vars(runs).items()
    }
    return Dataset(markers, sigma=sigma, sigma_rotation=sigma_rotation, **arrays)  # type: ignore[arg-type]


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
