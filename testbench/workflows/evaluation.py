"""Models identified from a campaign and judged, against its readings and by the truth; and as a row each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.identify import Estimate, Method
from testbench.identify.estimate import DeflectionErrors, all_deflections, make_estimate, score
from testbench.identify.fold import reduce
from testbench.model.vjm import Vjm
from testbench.workflows.cell import Campaign, Cell
from testbench.workflows.fit_details import COMPLIANCES, eigenvalues, link_compliances, sag_by_part
from testbench.workflows.models import Model
from testbench.workflows.rows import (
    FAILED,
    NO_ERRORS,
    DatasetRow,
    ErrorRow,
    FitRow,
    dataset_row,
    error_row,
    fit_row,
)
from testbench.workflows.workspace_errors import WorkspacePoses, kept_mm, places_of, rms


@dataclass(frozen=True)
class Result:
    """Hold one model, identified and judged."""

    model: Model  #: What was asked for.
    estimate: Estimate  #: What was found.
    seconds: float  #: Wall time of the estimator.
    identification: DeflectionErrors  #: Errors on the runs it was identified from, against their readings.
    check: DeflectionErrors  #: Errors on the check runs, against their readings.
    check_true: DeflectionErrors  #: The same against their true deflections.
    truth: DeflectionErrors  #: Errors against the true deflections.
    error_vectors: Array  #: The same marker by marker: true minus predicted, (runs, m, 3) [m].
    residuals: Array  #: Readings minus predictions of all measured runs, (runs, m, 3) [m].

    @property
    def places(self) -> Array:
        """Compute errors against the true deflections run by run, RMS over the markers, (runs,) [m]."""
        return rms(self.error_vectors)


class EstimatorFailed(BenchError):
    """Signal that a user's estimator failed, or that its answer is none."""

    def __init__(self, model: Model, why: str) -> None:
        super().__init__(f"{model.name}: its estimator failed: {why}")
        self.model, self.why = model, why


def identify(
    cell: Cell, campaign: Campaign, models: Sequence[Model], clock: Callable[[], float]
) -> list[Result]:
    """Identify every model from the campaign and judge it on all sets.

    Args:
        cell: The arm with its model and its truth.
        campaign: The simulated campaign.
        models: The models.
        clock: Returns the time [s].

    Returns:
        A result per model.
    """
    found = []
    for model in models:
        start = clock()
        found.append((model, fit_or_rigid(cell, model, campaign.identification), clock() - start))
    return _judged(cell, campaign, found)


def score_estimate(
    cell: Cell, campaign: Campaign, model: Model, estimate: Estimate, seconds: float
) -> Result:
    """Score an estimate on the runs that it was identified from, on the check runs and by the truth.

    Args:
        cell: The arm with its model and its truth.
        campaign: The simulated campaign.
        model: The model.
        estimate: The estimate.
        seconds: Time of the fit [s].

    Returns:
        The result.
    """
    return _judged(cell, campaign, [(model, estimate, seconds)])[0]


def _judged(cell: Cell, campaign: Campaign, found: Sequence[tuple[Model, Estimate, float]]) -> list[Result]:
    """Several estimates of one campaign judged: where the arm is, is worked out once."""
    fitted, check, truth = campaign.identification, campaign.check, campaign.truth
    estimates = [estimate for _, estimate, _ in found]
    predicted = [
        all_deflections(cell.vjm, estimates, data) for data in (fitted, check, truth, campaign.measured)
    ]
    return [
        Result(
            model=model,
            estimate=estimate,
            seconds=seconds,
            identification=score(own[0], fitted.deflection),
            check=score(own[1], check.deflection),
            check_true=score(own[1], campaign.check_true.deflection),
            truth=score(own[2], truth.deflection),
            error_vectors=truth.deflection - own[2],
            residuals=campaign.measured.deflection - own[3],
        )
        for (model, estimate, seconds), *own in zip(found, *predicted, strict=True)
    ]


def fit_model(cell: Cell, model: Model, data: Dataset) -> Estimate:
    """Fit a model to runs; a user's estimator does not see the folder's compliances.

    Args:
        cell: The arm with its model and its truth.
        model: The model.
        data: Measured runs.

    Returns:
        The estimate.
    """
    if isinstance(model.estimator, Method):
        return model.estimator(cell.vjm, model.structure, data)
    try:
        estimate = model.estimator(without_compliances(cell.vjm), model.structure, data)
    except Exception as err:
        why = str(err) if isinstance(err, BenchError) else f"{type(err).__name__}: {err}"
        raise EstimatorFailed(model, " ".join(why.split())) from err
    if not isinstance(estimate, Estimate):
        raise EstimatorFailed(model, f"expected an Estimate, got {type(estimate).__name__}")
    n = model.structure.n
    if estimate.pi.shape != (n,) or not (
        np.isfinite(estimate.pi).all() and np.isfinite(estimate.C_theta).all()
    ):
        raise EstimatorFailed(model, f"expected {n} finite parameters, got shape {estimate.pi.shape}")
    return estimate


def fit_or_rigid(cell: Cell, model: Model, data: Dataset) -> Estimate:
    """Fit a model to runs; of an estimator that fails return a rigid arm, whose status says why.

    Args:
        cell: The arm with its model and its truth.
        model: The model.
        data: Measured runs.

    Returns:
        The estimate; see `has_failed`.
    """
    try:
        return fit_model(cell, model, data)
    except EstimatorFailed as err:
        regression = reduce(cell.vjm, model.structure, data)
        rigid = make_estimate(regression, np.zeros(model.structure.n), method="own estimator")
        return replace(rigid, status=FAILED + err.why)


def has_failed(estimate: Estimate) -> bool:
    """Tell whether an estimate is of a user's estimator that failed: its numbers say nothing."""
    return estimate.status.startswith(FAILED)


def without_compliances(vjm: Vjm) -> Vjm:
    """Replace an arm's compliances by NaN: in simulations the folder's may be the true ones."""
    links = tuple(replace(link, compliance=np.full((6, 6), np.nan)) for link in vjm.arm.links)
    joints = tuple(replace(joint, compliance=np.nan) for joint in vjm.arm.joints)
    return replace(vjm, arm=replace(vjm.arm, links=links, joints=joints))


@dataclass(frozen=True)
class DrawnErrors:
    """Hold what the pictures of the first seed are made of: nobody simulates it again."""

    measured: str | None  #: All measured runs as CSV, in the row of the first model.
    over: str | None  #: The same of the true deflections that models are judged by.
    moved_m: tuple[float, ...] | None  #: These deflections, (runs m 3,), in the row of the first model.
    parts: tuple[str, ...] | None  #: Link or joint of every eigenvalue, in the row of the first model.
    residuals_m: tuple[float, ...]  #: Readings minus predictions of all measured runs.
    wrong_m: tuple[float, ...]  #: True minus predicted deflections.
    eigenvalues_urad_per_Nm: tuple[float, ...]  #: Of all parts: see `fit_details.eigenvalues`.
    #: Of every link `reference`, `estimate` and `half` row by row: see `fit_details.link_compliances`.
    compliances: tuple[float | None, ...]
    shares_percent: tuple[float, ...]  #: Of every link with its joint, of the deflection: see there.


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
    true_arm: str  #: Its name in `TRUTHS`; model and prior are those of the folder.
    places: WorkspacePoses | None  #: Poses of the workspace; None but in the first seed.
    place_mm: tuple[float, ...] | None  #: Error in each of them.
    drawn: DrawnErrors | None = None  #: For pictures; None but in the first seed.


def campaign_rows(
    cell: Cell, campaign: Campaign, results: Sequence[Result], true_arm: str, *, placed: bool
) -> list[CampaignRow]:
    """Make one row per model.

    Args:
        cell: The arm with its model and its truth.
        campaign: The simulated campaign.
        results: The models, judged.
        true_arm: Kind of the true arm.
        placed: Whether rows have errors pose by pose, and what pictures need.

    Returns:
        The rows.
    """
    data, rows = measured_row(campaign), []
    for k, result in enumerate(results):
        lost = has_failed(result.estimate)
        shown = placed and not lost
        row = CampaignRow(
            **vars(_fit(result)),
            identification=NO_ERRORS if lost else error_row(result.identification),
            check=NO_ERRORS if lost else error_row(result.check),
            check_true=NO_ERRORS if lost else error_row(result.check_true),
            workspace=NO_ERRORS if lost else error_row(result.truth),
            measured=data,
            true_arm=true_arm,
            places=places_of(cell, campaign.truth) if shown else None,
            place_mm=kept_mm(result.places) if shown else None,
            drawn=_drawn(cell, campaign, result, whole=k == 0) if shown else None,
        )
        rows.append(row)
    return rows


def _fit(result: Result) -> FitRow:
    model, estimate = result.model, result.estimate
    if has_failed(estimate):
        return failed_row(EstimatorFailed(model, estimate.status.removeprefix(FAILED)))
    prior = model.filled or estimate.weighted_prior is not None
    return fit_row(model.name, estimate, result.seconds, prior=prior)


def failed_row(err: EstimatorFailed) -> FitRow:
    """Make the row of an estimator that failed."""
    name, structure, status = err.model.name, err.model.structure, FAILED + err.why
    return FitRow(
        name=name, structure=structure.name, prior=err.model.filled, status=status, parameters=structure.n
    )


def _drawn(cell: Cell, campaign: Campaign, result: Result, *, whole: bool) -> DrawnErrors:
    """What pictures need of a model; `whole` with the runs, once a campaign."""
    measured, over, moved, names = None, None, None, None
    estimate, true = result.estimate, cell.plant.arm.C_theta
    parts = eigenvalues(cell.arm, estimate.structure, estimate.C_theta)
    links = link_compliances(
        cell.vjm, estimate, true, sag_by_part(cell.vjm, estimate, campaign.identification)
    )
    if whole:
        from testbench.files.write import csv_text  # here: commands on measured runs write none

        measured, over = (csv_text(own, cell.arm) for own in (campaign.measured, campaign.truth))
        moved = tuple(campaign.truth.deflection.ravel().tolist())
        names = tuple(part.part for part in parts for _ in part.urad_per_Nm)
    return DrawnErrors(
        measured=measured,
        over=over,
        moved_m=moved,
        parts=names,
        residuals_m=tuple(result.residuals.ravel().tolist()),
        wrong_m=tuple(result.error_vectors.ravel().tolist()),
        eigenvalues_urad_per_Nm=tuple(x for part in parts for x in part.urad_per_Nm),
        compliances=tuple(x for link in links for key in COMPLIANCES for row in link[key] for x in row),
        shares_percent=tuple(link.share_percent for link in links),
    )


def measured_row(campaign: Campaign) -> Measured:
    """Count runs and deflections of a campaign."""
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
