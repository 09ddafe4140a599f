"""One trial of a factorial campaign: a case is a choice of every factor; models are fitted to it and judged.

Factors are the true arm, the prior, noise, instruments, disturbances, loads, poses and the structure of the
model. A study lists its cases and its models; rows are the same in all of them. All cases of a trial share
their random numbers, so that differences between cases and models are theirs alone.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil
from time import perf_counter
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.files.write import csv_text
from testbench.identify.estimate import Constraint, DeflectionErrors, Estimate, deflections_of_models, score
from testbench.identify.posterior import CONFIDENCE, intervals
from testbench.plant.tracker import IsotropicTracker, read_orientations, read_positions
from testbench.runs.spread import Share
from testbench.studies.study import plain_models, without_cone
from testbench.workflows.advice import fit_row
from testbench.workflows.campaign import Truth
from testbench.workflows.cell import Cell
from testbench.workflows.models import (
    Model,
    fit_or_rigid,
    has_failed,
    named_models,
    with_priors,
    with_wrong_prior,
    wrong_prior,
)
from testbench.workflows.own_estimator import Models
from testbench.workflows.rows import MM, NO_ERRORS, UM, DatasetRow, ErrorRow, dataset_row, error_row

R = TypeVar("R")

ANGLE_PER_LENGTH = 10.0
"""Standard deviation of an orientation over that of a position [rad/m]: 250 urad beside 25 um."""
WEIGHT = 25e-6  #: Sigma by which noise-free readings are weighted [m]: any will do.
LEARNS = ("ALL153",)
"""What `DEFAULT` fits: it alone, with its cone and without, learns its prior, which takes long."""


@dataclass(frozen=True, kw_only=True)
class CampaignFitRow:
    """Hold one model in one case of one trial: what was chosen, and how it errs in other poses."""

    name: str  #: Of the model.
    structure: str
    constraint: Constraint
    prior: bool
    status: str  #: "solved", or why not; of an estimator of one's own that failed, why: it has no errors.
    rms_um: float | None
    p95_um: float | None
    max_um: float | None
    conservative: Share
    solved: Share  #: Whether the method found what it looks for.
    parameters: int  #: Unknowns.
    rank: int  #: Directions of them that the data see.
    min_eigenvalue: float | None  #: Smallest eigenvalue of a block [m/N, rad/(N m)].
    f_m: float | None  #: Cost of Eq. (19).
    f_m_floor: float  #: What noise alone leaves of it.
    duality_gap: float | None  #: How well the program is solved; None where none is.
    solve_seconds: float | None  #: Wall time of a fit, of all cases at once; None where it was not taken.
    identification: ErrorRow  #: At the poses that were fitted, against their readings.
    true_arm: str  #: One of FAMILY_TRUE_ARMS.
    part: str | None = None  #: Of a study whose parts have cases of different kinds.
    truth: Truth | None = None
    prior_error: str | None = None  #: What is wrong with the prior, one of PRIORS.
    poses: int | None = None  #: From how many is identified.
    payload_kg: float | None = None
    sigma_um: float | None = None  #: Noise of a reading along an axis; None of an instrument.
    instrument: str | None = None  #: None of noise alike along all axes.
    distance_m: float | None = None  #: Of the instrument; 0 of the one that reads alike wherever it stands.
    case: str | None = None  #: What disturbs the true arm.
    moved_um: float | None = None  #: How far that moves the deflections to be predicted, RMS.
    measured: DatasetRow | None = None  #: The dataset that the study leaves, in one row of the first seed.
    data_file: str | None = None  #: The same as dataset.csv has it.


@dataclass(frozen=True)
class Cover:
    """Describe 95 % intervals of the components of deflection over the workspace."""

    covered_percent: float  #: Share of the true components that lie inside.
    half_mm: float  #: Median half width.
    ideal_mm: float  #: Half width of the narrowest intervals, all alike, that cover 95 %.


@dataclass(frozen=True)
class TrialCase:
    """Hold runs to identify from, and true deflections, at one choice of every factor."""

    runs: Dataset
    test: Dataset
    factors: Mapping[str, object]  #: Fields of a row.
    saved: Dataset | None = None  #: The dataset that the study leaves, in one case of the first seed.


class Fits(dict[str, Sequence[Estimate]]):
    """Hold estimates by model, one per case."""

    def __init__(
        self,
        found: Mapping[str, Sequence[Estimate]],
        seconds: Mapping[str, float] | None = None,
        filled: Sequence[str] = (),
    ):
        super().__init__(found)
        self.seconds = seconds or {}  #: Wall time of a fit, by model.
        self.filled = filled  #: Models that were given a prior.


def fitted(cell: Cell, models: Sequence[Model], cases: Sequence[TrialCase]) -> Fits:
    """Identify every model from the runs of every case.

    Args:
        cell: The arm with its model and its truth.
        models: The models.
        cases: The cases.

    Returns:
        Estimates of every model, one per case.
    """
    runs = [case.runs for case in cases]
    found, seconds = {}, {}
    for model in models:
        start = perf_counter()
        found[model.name] = [fit_or_rigid(cell, model, data) for data in runs]
        seconds[model.name] = (perf_counter() - start) / len(runs)
    return Fits(found, seconds, [m.name for m in models if m.filled])


def score_cases(
    cell: Cell,
    cases: Sequence[TrialCase],
    fits: Fits,
    kind: type[R] = CampaignFitRow,  # type: ignore[assignment]  # the rows of most studies
    more: Callable[[str, int], Mapping[str, object]] = lambda *_: {},
) -> Iterator[R]:
    """Score the models of every case by true deflections.

    Args:
        cell: The arm.
        cases: Of one arm.
        fits: Of its models.
        kind: Type of the rows.
        more: Other fields of a row, by the model's name and the case's place.

    Yields:
        A row per case and model.
    """
    far = _scores(cell, [case.test for case in cases], fits)
    near = _scores(cell, [case.runs for case in cases], fits)
    for k, case in enumerate(cases):
        shown = {} if case.saved is None else _left(cell, case.saved)
        for name, estimates in fits.items():
            fields = _fields(name, estimates[k], far[k, name], fits.seconds.get(name))
            fields["prior"] = fields["prior"] or name in fits.filled
            lost = has_failed(estimates[k])
            identification = NO_ERRORS if lost else error_row(near[k, name])
            own = {**fields, "identification": identification, **case.factors, **more(name, k), **shown}
            yield kind(**own)
            shown = {}


def _scores(cell: Cell, data: Sequence[Dataset], fits: Fits) -> dict[tuple[int, str], DeflectionErrors]:
    """Errors of every fit by the dataset of its case: where the arm is in one, is worked out once."""
    found: dict[tuple[int, str], DeflectionErrors] = {}
    for one in {id(own): own for own in data}.values():
        keys = [(k, name) for k, own in enumerate(data) if own is one for name in fits]
        moved = deflections_of_models(cell.vjm, [fits[name][k] for k, name in keys], one)
        some = (
            slice(None) if one.line_direction is None else one.is_measured
        )  # along lines, what was read alone
        own_score = (score(one.measured_components(own)[some], one.deflection[some]) for own in moved)
        found |= dict(zip(keys, own_score, strict=True))
    return found


def cover(cell: Cell, estimate: Estimate, truth: Dataset) -> Cover:
    """Compare the intervals of an estimate with true deflections.

    Args:
        cell: The arm with its model and its truth.
        estimate: The estimate.
        truth: True deflections.

    Returns:
        Their coverage.
    """
    found, true = intervals(cell.vjm, estimate, truth), truth.deflection
    return covers(found.centre, (found.upper - found.lower) / 2, true)


def covers(centre: Array, half: Array, true: Array) -> Cover:
    """Measure how well intervals cover what is true, arrays of one shape.

    Args:
        centre: Centres of the intervals [m].
        half: Half widths of the intervals [m].
        true: What is true [m].

    Returns:
        The coverage.
    """
    error = np.abs(centre - true)
    return Cover(
        covered_percent=100 * float(np.mean(error <= half)),
        half_mm=MM * float(np.median(half)),
        ideal_mm=MM * float(np.quantile(error, CONFIDENCE)),
    )


def worst_tenth(covered: Array) -> float:
    """Return the mean coverage of the tenth of arms whose intervals cover worst, from (arms,) [%]."""
    return float(np.sort(covered)[: ceil(len(covered) / 10)].mean())


def _left(cell: Cell, data: Dataset) -> dict[str, object]:
    """The dataset that a study leaves, in a row."""
    return {"measured": dataset_row(data), "data_file": csv_text(data, cell.arm)}


OF_ANSWER = ("rms_um", "p95_um", "max_um", "min_eigenvalue", "f_m")  #: What who failed has not.
OF_FIT = (
    "name structure constraint prior status conservative parameters rank min_eigenvalue f_m f_m_floor "
    "duality_gap solve_seconds"
).split()


def _fields(
    name: str, estimate: Estimate, error: DeflectionErrors, seconds: float | None
) -> dict[str, object]:
    """Fields of a row that all studies have."""
    row = fit_row(name, estimate, seconds, prior=estimate.weighted_prior is not None)
    found = {key: getattr(row, key) for key in OF_FIT} | {
        "rms_um": UM * error.rms,
        "p95_um": UM * error.p95,
        "max_um": UM * error.max,
        "solved": estimate.status == "solved",
    }
    return found | (dict.fromkeys(OF_ANSWER) | {"conservative": False} if has_failed(estimate) else {})


def with_wrong_priors(
    cell: Cell, names: Sequence[str], filled: Sequence[str], seed: int, own: Models
) -> list[Model]:
    """List models without a prior, some with one that is wrong, and the default.

    Behind the first one stand estimators of one's own; last the default without its cone, and with it.

    Args:
        cell: The arm of the model: the prior is wrong about its folder.
        names: Of all models.
        filled: Of those that are fitted with the prior too.
        seed: Of the prior's errors.
        own: Makes the models of estimators of one's own.

    Returns:
        The models.
    """
    prior = wrong_prior(cell, seed)
    default = with_priors(cell.arm, [without_cone(cell), *named_models(cell, LEARNS)], prior)
    first, *others = with_wrong_prior(cell, plain_models(cell, names), filled, seed)
    return [first, *own(cell, prior), *others, *default]


def reread(clean: Dataset, sigma: float, rng: np.random.Generator) -> Dataset:
    """Read a noise-free dataset with noise: for every sigma the same random numbers.

    Args:
        clean: Readings without noise.
        sigma: Standard deviation of a reading along an axis [m]; orientations follow it.
        rng: Source of randomness.

    Returns:
        The readings.
    """
    tracker = IsotropicTracker(sigma, ANGLE_PER_LENGTH * sigma)
    before, after = (read_positions(tracker, p, rng) for p in (clean.before, clean.after))
    data = replace(clean, before=before, after=after, sigma=sigma or WEIGHT)
    if clean.rotation_before is None or clean.rotation_after is None:
        return data
    turned = [
        read_orientations(tracker, Rotation.from_rotvec(r).as_matrix(), rng)
        for r in (clean.rotation_before, clean.rotation_after)
    ]
    sigma_rotation = ANGLE_PER_LENGTH * data.sigma
    return replace(data, rotation_before=turned[0], rotation_after=turned[1], sigma_rotation=sigma_rotation)
