"""Models identified from a campaign and judged: against its readings, and by the truth."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.campaign.campaign import Campaign, Cell
from testbench.campaign.models import Model
from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.identify import Estimate, Method
from testbench.identify.evaluate import Score, all_deflections, score
from testbench.model.vjm import Vjm


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
        return np.asarray(np.sqrt(np.mean(np.sum(self.wrong**2, axis=-1), axis=-1)))


def identify(
    cell: Cell, campaign: Campaign, models: Sequence[Model], clock: Callable[[], float]
) -> list[Result]:
    """Identify every model from the campaign and judge it on all sets."""
    found = []
    for model in models:
        start = clock()
        found.append((model, of_model(cell, model, campaign.identification), clock() - start))
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


class EstimatorFailed(BenchError):
    """An estimator of one's own that failed, or whose answer is none."""

    def __init__(self, model: str, why: str) -> None:
        super().__init__(f"{model}: its estimator failed: {why}")
        self.model = model


def of_model(cell: Cell, model: Model, data: Dataset) -> Estimate:
    """What a model makes of runs; an estimator of one's own does not see the folder's compliances."""
    if isinstance(model.estimator, Method):
        return model.estimator(cell.vjm, model.structure, data)
    try:
        found = model.estimator(unseen(cell.vjm), model.structure, data)
    except Exception as err:
        why = str(err) if isinstance(err, BenchError) else f"{type(err).__name__}: {err}"
        raise EstimatorFailed(model.name, " ".join(why.split())) from err
    if not isinstance(found, Estimate):
        raise EstimatorFailed(model.name, f"expected an Estimate, got {type(found).__name__}")
    n = model.structure.n
    if found.pi.shape != (n,) or not (np.isfinite(found.pi).all() and np.isfinite(found.C_theta).all()):
        raise EstimatorFailed(model.name, f"expected {n} finite parameters, got shape {found.pi.shape}")
    return found


def unseen(vjm: Vjm) -> Vjm:
    """An arm without compliances, NaN in their place: in simulations the folder's may be the true ones."""
    links = tuple(replace(link, compliance=np.full((6, 6), np.nan)) for link in vjm.arm.links)
    joints = tuple(replace(joint, compliance=np.nan) for joint in vjm.arm.joints)
    return replace(vjm, arm=replace(vjm.arm, links=links, joints=joints))


def identify_each(cell: Cell, model: Model, datasets: Sequence[Dataset]) -> list[Estimate]:
    """Identify one model from each of several datasets; an estimator of one's own takes them one by one."""
    if isinstance(model.estimator, Method):
        return model.estimator.each(cell.vjm, model.structure, datasets)
    return [of_model(cell, model, data) for data in datasets]
