"""Models of a simulated campaign: identified and judged, a row each, and what reports say of them."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.files.write import csv_text
from testbench.identify.estimate import Estimate, deflections_of_models, score
from testbench.model.structure import JOINTS_ONLY, Constraint
from testbench.report.schema import Table, best_of, columns
from testbench.report.table import Row, Trials, merged, plain
from testbench.report.table import rows as as_rows
from testbench.runs.rows import nested
from testbench.runs.spread import span
from testbench.studies.campaign.trial import Fits
from testbench.studies.study import DEFAULT_WITHOUT_CONE
from testbench.workflows.advice import fit_row
from testbench.workflows.campaign import Campaign
from testbench.workflows.cell import Cell
from testbench.workflows.error_places import (
    PLACE_DIGITS,
    ErrorPlaces,
    WorkspacePoses,
    error_places,
    places_of,
    rms,
)
from testbench.workflows.fit_numbers import (
    eigenvalues,
    link_compliances,
    predictions,
    residual_histograms,
    sag_by_part,
)
from testbench.workflows.model_names import IN_PAPER, in_words
from testbench.workflows.models import DEFAULT, failed_row, has_failed
from testbench.workflows.rows import (
    MM,
    NO_ERRORS,
    DatasetRow,
    ErrorRow,
    FitRow,
    dataset_row,
    error_row,
    rounded,
)

TRUE = "workspace.rms_mm"  #: What models are judged by.
NOT_OF_A_MODEL = ("seed", "truth", "true_arm", "measured.", "places.", "place_mm", "drawn.", "data_file")
"""Columns of a `CampaignRow` that are of its campaign."""


def seeds_of(seeds: range) -> int | list[int]:
    """Return what report.json says of the seeds: one number, or a list."""
    return seeds[0] if len(seeds) == 1 else list(seeds)


def seeds_label(seed: int | Sequence[int]) -> str:
    """Say of which trials a report's numbers are, for its title."""
    return f"seed {seed}" if isinstance(seed, int) else f"{len(seed)} seeds: median ({span(len(seed))})"


def dataset(trials: Trials, fitted: int | None = None) -> Row:
    """Summarise what was measured in every trial.

    Args:
        trials: Rows of the trials.
        fitted: Number of poses that are counted; None for all.

    Returns:
        The numbers.
    """
    [row] = merged(trials.where(name=trials["name"][0]).inside("measured"))
    if fitted is None:
        return row
    return Row(row, runs=row.identification_runs, points=row.identification_points, poses=fitted)


def best(models: Sequence[Row], constraint: Constraint, *, prior: bool) -> str:
    """Name the best model of one method over the workspace; joint stiffness alone is no method.

    Of those alike the one of most unknowns: MLS32 is MLS56 without what no reading tells, to the digits.

    Args:
        models: Rows of models.
        constraint: Constraint of the method.
        prior: Whether it has a prior.

    Returns:
        The name; empty for none.
    """
    own = {
        m.name: m
        for m in models
        if (m.constraint, m.prior) == (constraint, prior) and m.structure != JOINTS_ONLY
    }
    alike = best_of({name: m.workspace.rms_mm for name, m in own.items()})
    return max(alike, key=lambda name: own[name].parameters, default="")


def by_arm(trials: Trials, value: str) -> list[Row]:
    """Merge a quantity of every model by true arm.

    Args:
        trials: Rows of the trials.
        value: Column of the quantity.

    Returns:
        Rows; none where there is one true arm.
    """
    several = len(trials.values("true_arm")) > 1
    return merged(trials.keep("name", "true_arm", value), "name", "true_arm") if several else []


def error_map(trials: Trials, compared: Sequence[str]) -> ErrorPlaces:
    """Map errors of the first seed pose by pose, ordered by those models that are compared.

    Args:
        trials: Rows of the trials.
        compared: Names of the models.

    Returns:
        The errors by place.
    """
    drawn = trials.where(seed=trials["seed"][0])
    workspace_poses = WorkspacePoses(
        **nested({name: cells[0] for name, cells in drawn.keep("places.").columns.items()}).places
    )
    mm = dict(zip(drawn["name"], drawn["place_mm"], strict=True))
    return error_places(workspace_poses, mm, [name for name in dict.fromkeys(compared) if name in mm])


def details(trials: Trials, compared: Sequence[str], taken: str) -> Row:
    """Collect what figures show of the first seed's fits.

    Args:
        trials: Rows of a campaign.
        compared: Models, by name; those that are not there are left out.
        taken: The model whose compliances are set beside the true ones.

    Returns:
        `residuals` at all measured runs, `predictions` over the workspace, and `eigenvalues`, by model, and
        `compliances` of one model: see `workflows.fit_numbers`; nothing where no fit was kept.
    """
    first = trials.where(seed=trials["seed"][0])
    kept = {name: k for k, name in enumerate(first["name"].tolist()) if first["drawn.wrong_m"][k] is not None}
    names, whole = [name for name in compared if name in kept], min(kept.values(), default=None)
    if whole is None or not names:
        return Row()
    left, wrong = (
        {name: np.array(first[f"drawn.{key}"][kept[name]]) for name in names}
        for key in ("residuals_m", "wrong_m")
    )
    parts, links = (
        {name: as_rows(json.loads(first[f"drawn.{key}"][k])) for name, k in kept.items()}
        for key in ("parts", "links")
    )
    moved = np.reshape(first["drawn.moved_m"][whole], (-1, 3))
    return Row(
        residuals=residual_histograms(left),
        predictions=predictions(moved, {name: own.reshape(-1, 3) for name, own in wrong.items()}),
        eigenvalues={name: parts[name] for name in names},
        compliances=links.get(taken, []),
    )


def distinct(models: Sequence[Row]) -> list[Row]:
    """Drop completions that exist in no seed: they are least squares once more."""
    return [m for m in models if m.constraint != "free" or m.conservative is not False]


def user_estimators(models: Sequence[Row]) -> list[str]:
    """Name the user's estimators that worked in a trial."""
    return [m.name for m in models if m.constraint == "own"]


WORST = "name place_error_mm x_m y_m z_m joints"
PRINTED = (DEFAULT, DEFAULT_WITHOUT_CONE, JOINTS_ONLY, "MGCO56", f"MGCO56{IN_PAPER}", "MLS56")
"""The models that are printed, in this order."""


def told(rows: Sequence[Row]) -> Sequence[Row]:
    """Select the models that tell the story, and those of the user; all of an arm that names others.

    Args:
        rows: All models.

    Returns:
        Rows with the column `meaning`.
    """
    models = {m.name: m for m in distinct(rows)}
    listed = [name for name in (*PRINTED, *user_estimators([*models.values()])) if name in models]
    names = listed if len(listed) > 2 else models
    return [Row(models[name], meaning=_meaning(models[name])) for name in names]


def _meaning(model: Row) -> str:
    """Describe a model by its name; an estimator of a user by what it is."""
    return "an estimator of your own" if model.constraint == "own" else in_words(model.name)


def worst_places(errors: ErrorPlaces) -> Table:
    """Tabulate where every model of a map errs most."""
    rows = []
    for name in errors.compared:
        worst = errors.worst[name]
        x, y, z = worst.position_m
        rows.append(Row(name=name, place_error_mm=worst.error_mm, x_m=x, y_m=y, z_m=z, joints=worst.joints))
    return Table(columns(WORST), rows, "Where models err most, first trial")


@dataclass(frozen=True)
class DrawnErrors:
    """Hold what the pictures of the first seed are made of: nobody simulates it again."""

    measured: str | None  #: All measured runs as CSV, in the row of the first model.
    over: str | None  #: The same of the true deflections that models are judged by.
    moved_m: tuple[float, ...] | None  #: These deflections, (runs m 3,), in the row of the first model.
    residuals_m: tuple[float, ...]  #: Readings minus predictions of all measured runs.
    wrong_m: tuple[float, ...]  #: True minus predicted deflections.
    parts: str  #: JSON of `fit_numbers.eigenvalues`, a row a link or joint.
    links: str  #: JSON of `fit_numbers.link_compliances`, beside the true ones.


@dataclass(frozen=True)
class Measured(DatasetRow):
    """Hold what was measured."""

    poses: int
    identification_runs: int
    identification_points: int
    check_runs: int
    check_points: int
    workspace_poses: int


@dataclass(frozen=True)
class CampaignRow(FitRow):
    """Hold one model in one trial."""

    identification: ErrorRow  #: At the poses that were fitted, against their readings.
    check: ErrorRow  #: At check poses, against their readings.
    check_true: ErrorRow  #: At check poses, against the true deflections.
    workspace: ErrorRow  #: Over the whole workspace, against the true deflections.
    measured: Measured
    true_arm: str  #: Its name in `FAMILY_TRUE_ARMS`; model and prior are those of the folder.
    places: WorkspacePoses | None  #: Poses of the workspace; None but in the first seed.
    place_mm: tuple[float, ...] | None  #: Error in each of them.
    drawn: DrawnErrors | None = None  #: For pictures; None but in the first seed.


def campaign_rows(
    cell: Cell, campaign: Campaign, fits: Fits, true_arm: str, *, placed: bool
) -> list[CampaignRow]:
    """Score every model on the runs it was identified from, on the check runs and by the truth; a row each.

    Args:
        cell: The arm with its model and its truth.
        campaign: The simulated campaign.
        fits: One estimate of every model, from its identification runs.
        true_arm: Kind of the true arm.
        placed: Whether rows have errors pose by pose, and what pictures need.

    Returns:
        The rows.
    """
    fitted = campaign.identification
    check = campaign.check
    truth = campaign.truth
    estimates = [own for [own] in fits.values()]
    moved = [
        deflections_of_models(cell.vjm, estimates, data) for data in (fitted, check, truth, campaign.measured)
    ]
    data, rows = _measured_row(campaign), []
    for k, (name, estimate, at_fitted, at_check, over, every) in enumerate(
        zip(fits, estimates, *moved, strict=True)
    ):
        shown = placed and not has_failed(estimate)
        error = truth.deflection - over
        row = CampaignRow(
            **vars(_fit(name, estimate, fits)),
            identification=_errors(estimate, at_fitted, fitted),
            check=_errors(estimate, at_check, check),
            check_true=_errors(estimate, at_check, campaign.check_true),
            workspace=_errors(estimate, over, truth),
            measured=data,
            true_arm=true_arm,
            places=places_of(cell, truth) if shown else None,
            place_mm=tuple(rounded(MM * rms(error), PLACE_DIGITS)) if shown else None,
        )
        if shown:
            left = campaign.measured.deflection - every
            row = replace(row, drawn=_drawn(cell, campaign, estimate, error, left, whole=k == 0))
        rows.append(row)
    return rows


def _errors(estimate: Estimate, moved: Array, data: Dataset) -> ErrorRow:
    """Errors of predicted deflections; none of a failed estimator."""
    return NO_ERRORS if has_failed(estimate) else error_row(score(moved, data.deflection))


def _fit(name: str, estimate: Estimate, fits: Fits) -> FitRow:
    prior, structure = name in fits.filled, estimate.structure
    if has_failed(estimate):
        return failed_row(name, structure, estimate.status, prior=prior)
    return fit_row(name, estimate, fits.seconds.get(name), prior=prior or estimate.weighted_prior is not None)


def _drawn(
    cell: Cell, campaign: Campaign, estimate: Estimate, error: Array, left: Array, *, whole: bool
) -> DrawnErrors:
    """What pictures need of a model: true minus predicted, readings minus predicted deflections.

    It is `whole`, with the runs, once a campaign.
    """
    measured = None
    over = None
    moved = None
    true = cell.plant.arm.C_theta
    sag = sag_by_part(cell.vjm, estimate, campaign.identification)
    if whole:
        measured, over = (csv_text(data, cell.arm) for data in (campaign.measured, campaign.truth))
        moved = tuple(campaign.truth.deflection.ravel().tolist())
    return DrawnErrors(
        measured=measured,
        over=over,
        moved_m=moved,
        residuals_m=tuple(left.ravel().tolist()),
        wrong_m=tuple(error.ravel().tolist()),
        parts=json.dumps(plain(eigenvalues(cell.arm, estimate.structure, estimate.C_theta))),
        links=json.dumps(plain(link_compliances(cell.vjm, estimate, true, sag))),
    )


def _measured_row(campaign: Campaign) -> Measured:
    """Count runs and deflections of a campaign."""
    every = campaign.measured
    fitted = campaign.identification
    check = campaign.check
    return Measured(
        **vars(dataset_row(every)),
        poses=len(np.unique(every.pose_id)),
        identification_runs=fitted.n_runs,
        identification_points=fitted.n_points,
        check_runs=check.n_runs,
        check_points=check.n_points,
        workspace_poses=campaign.truth.n_runs,
    )
