"""Models identified from a campaign and judged, against its readings and by the truth; and as a row each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.files.write import csv_text
from testbench.identify import Estimate, Method
from testbench.identify.estimate import make_estimate
from testbench.identify.evaluate import Score, all_deflections, score
from testbench.identify.fold import reduce
from testbench.model.vjm import Vjm
from testbench.workflows.cell import Campaign, Cell
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
from testbench.workflows.workspace_errors import Places, kept_mm, places_of, rms


@dataclass(frozen=True)
class Result:
    """One model, identified and judged."""

    model: Model  #: What was asked for.
    estimate: Estimate  #: What was found.
    seconds: float  #: Wall time of the estimator.
    identification: Score  #: Errors on the runs it was identified from, against their readings.
    check: Score  #: Errors on the check runs, against their readings.
    check_true: Score  #: The same against their true deflections.
    truth: Score  #: Errors against the true deflections.
    wrong: Array  #: The same marker by marker: true minus predicted, (runs, m, 3) [m].
    residuals: Array  #: Readings minus predictions of all measured runs, (runs, m, 3) [m].

    @property
    def places(self) -> Array:
        """Errors against the true deflections run by run, RMS over the markers, (runs,) [m]."""
        return rms(self.wrong)


class EstimatorFailed(BenchError):
    """An estimator of one's own that failed, or whose answer is none."""

    def __init__(self, model: Model, why: str) -> None:
        super().__init__(f"{model.name}: its estimator failed: {why}")
        self.model, self.why = model, why


def identify(
    cell: Cell, campaign: Campaign, models: Sequence[Model], clock: Callable[[], float]
) -> list[Result]:
    """Identify every model from the campaign and judge it on all sets."""
    found = []
    for model in models:
        start = clock()
        found.append((model, attempted(cell, model, campaign.identification), clock() - start))
    return _judged(cell, campaign, found)


def judge(cell: Cell, campaign: Campaign, model: Model, estimate: Estimate, seconds: float) -> Result:
    """Score an estimate on the runs that it was identified from, on the check runs and by the truth."""
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
            wrong=truth.deflection - own[2],
            residuals=campaign.measured.deflection - own[3],
        )
        for (model, estimate, seconds), *own in zip(found, *predicted, strict=True)
    ]


def of_model(cell: Cell, model: Model, data: Dataset) -> Estimate:
    """What a model makes of runs; an estimator of one's own does not see the folder's compliances."""
    if isinstance(model.estimator, Method):
        return model.estimator(cell.vjm, model.structure, data)
    try:
        found = model.estimator(unseen(cell.vjm), model.structure, data)
    except Exception as err:
        why = str(err) if isinstance(err, BenchError) else f"{type(err).__name__}: {err}"
        raise EstimatorFailed(model, " ".join(why.split())) from err
    if not isinstance(found, Estimate):
        raise EstimatorFailed(model, f"expected an Estimate, got {type(found).__name__}")
    n = model.structure.n
    if found.pi.shape != (n,) or not (np.isfinite(found.pi).all() and np.isfinite(found.C_theta).all()):
        raise EstimatorFailed(model, f"expected {n} finite parameters, got shape {found.pi.shape}")
    return found


def attempted(cell: Cell, model: Model, data: Dataset) -> Estimate:
    """The same; of an estimator that fails a rigid arm, whose status says why: see `has_failed`."""
    try:
        return of_model(cell, model, data)
    except EstimatorFailed as err:
        regression = reduce(cell.vjm, model.structure, data)
        rigid = make_estimate(regression, np.zeros(model.structure.n), method="own estimator")
        return replace(rigid, status=FAILED + err.why)


def has_failed(estimate: Estimate) -> bool:
    """Whether it is of an estimator of one's own that failed: its numbers say nothing."""
    return estimate.status.startswith(FAILED)


def unseen(vjm: Vjm) -> Vjm:
    """An arm without compliances, NaN in their place: in simulations the folder's may be the true ones."""
    links = tuple(replace(link, compliance=np.full((6, 6), np.nan)) for link in vjm.arm.links)
    joints = tuple(replace(joint, compliance=np.nan) for joint in vjm.arm.joints)
    return replace(vjm, arm=replace(vjm.arm, links=links, joints=joints))


@dataclass(frozen=True)
class Drawn:
    """What the pictures of the first seed are made of: nobody simulates it again."""

    measured: str | None  #: All measured runs as CSV, in the row of the first model.
    over: str | None  #: The same of the true deflections that models are judged by.
    residuals_m: tuple[float, ...]  #: Readings minus predictions of all measured runs.
    wrong_m: tuple[float, ...]  #: True minus predicted deflections.


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
        lost = has_failed(result.estimate)
        shown = placed and not lost
        own = CampaignRow(
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
        found.append(own)
    return found


def _fit(result: Result) -> FitRow:
    model, estimate = result.model, result.estimate
    if has_failed(estimate):
        return failed_row(EstimatorFailed(model, estimate.status.removeprefix(FAILED)))
    prior = model.filled or estimate.belief is not None
    return fit_row(model.name, estimate, result.seconds, prior=prior)


def failed_row(err: EstimatorFailed) -> FitRow:
    """What an estimator leaves that failed."""
    name, own, status = err.model.name, err.model.structure, FAILED + err.why
    return FitRow(name=name, structure=own.name, prior=err.model.filled, status=status, parameters=own.n)


def _drawn(cell: Cell, campaign: Campaign, result: Result, *, whole: bool) -> Drawn:
    """What pictures need of a model; `whole` with the runs, once a campaign."""
    data = (campaign.measured, campaign.truth) if whole else ()
    measured, over = [csv_text(own, cell.arm) for own in data] or (None, None)
    return Drawn(measured, over, *(tuple(own.ravel().tolist()) for own in (result.residuals, result.wrong)))


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
