"""Fits of models to a user's runs, their doubts, and the model to take.

Mistakes in readings have their doubts in `identify.diagnosis.hypotheses`.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import gammainc

from testbench.data.dataset import MAX_EVALUATED_RUNS, Dataset, select_evenly, select_rows
from testbench.errors import Array, BenchError, Doubt
from testbench.files.read_pairs import SIGMA
from testbench.identify.equations import RUNS_PER_BATCH
from testbench.identify.estimate import DeflectionErrors, Estimate, deflections, score
from testbench.identify.hierarchy import (
    COMMON_JOINT_SCALE_NAME,
    UndeterminedCompliances,
    contradicted_scales,
    undetermined_compliances,
)
from testbench.identify.method import Method
from testbench.identify.observability import joints_without_parameters
from testbench.identify.posterior import intervals
from testbench.identify.prior import LearntScale, WeightedPrior, scale_by_prior
from testbench.identify.regression import (
    ZERO_COLUMN_TOLERANCE,
    GroupedRegression,
    with_rows_by_pose,
)
from testbench.model.laws import law_sizes, law_unit, vjm_for_structure
from testbench.model.load import read_body_masses_with_note
from testbench.model.vjm import evaluate_chain, generalised_load
from testbench.progress import stepwise
from testbench.runs.rows import Row, finite
from testbench.workflows.advice import advice, fit_row, of_average
from testbench.workflows.arm_models import loads_about_tool, origin_of, write_files
from testbench.workflows.cell import Cell
from testbench.workflows.models import (
    EstimatorFailed,
    Model,
    Recommendation,
    default_name,
    failed_row,
    fit_model,
    recommend,
    reduce_runs,
)
from testbench.workflows.read_runs import MeasuredRuns
from testbench.workflows.rows import FAILED, MM, error_row

QUIET, CHANCE = 0.6, 1e-6
"""Share of the floor below which F_M is a doubt, and chance of it in sound readings from which it is none."""


def of_scale(scale: LearntScale) -> Doubt:
    """Doubt a scale of a learnt prior that the readings contradict."""
    low, high = (scale.factor * math.exp(sign * 2 * scale.log_deviation) for sign in (-1, 1))
    name, verb, others = scale.name, "is", "the other links or joints"
    if name == COMMON_JOINT_SCALE_NAME:
        name, verb, others = "the joints", "are", "the links"
    size = f"{scale.factor:.2g} times ({low:.2g} to {high:.2g}) as compliant as in the prior"
    return Doubt("prior", f"compared with {others}, {name} {verb} {size}: check the arm's folder")


def of_noise(estimates: Iterable[Estimate]) -> list[Doubt]:
    """Doubt the noise where a model leaves far less than the stated noise alone would."""
    quiet = [estimate for estimate in estimates if estimate.f_m < QUIET * estimate.f_m_floor]
    if not quiet:
        return []
    least = min(quiet, key=lambda e: e.f_m / e.f_m_floor)
    free = least.regression.n_equations - least.regression.rank
    if gammainc(free / 2, free / 2 * (least.f_m / least.f_m_floor) ** 2) > CHANCE:
        return []
    words = (
        f"the F_M of {least.structure.name} is {least.f_m:.2g}, but noise alone would give "
        f"{least.f_m_floor:.3g}: is sigma too large (default {1e6 * SIGMA[0]:g} um; is it a U95?), "
        "or were readings averaged or copied?"
    )
    return [Doubt("noise", words)]


Clock = Callable[[], float]  #: Wall time [s].
UNITS = "links in beam frames, m/N and rad/(N m); hinges rad/(N m), slides m/N, null where aggregated"


@dataclass(frozen=True)
class IdentifyResult:
    """Hold models fitted to a user's runs, and what there is to say of them."""

    fits: Row  #: Numbers and words, as `fit_models` has them.
    runs: MeasuredRuns
    estimates: Mapping[str, Estimate]  #: By the name of the model.
    held_out: Mapping[str, Array]  #: F_M of models on what was held out in turn, (folds,) [1].

    @property
    def taken(self) -> Estimate:
        """Return the estimate of the recommended model."""
        return self.estimates[self.fits.recommended]


@dataclass(frozen=True)
class FittedModel:
    """Hold a model fitted to runs."""

    model: Model
    estimate: Estimate
    seconds: float  #: Of the fit; the runs were reduced for all models before.


def fit_models(
    cell: Cell, models: Sequence[Model], runs: MeasuredRuns, clock: Clock, *, widths: bool = False
) -> IdentifyResult:
    """Fit every model, judge it, and recommend one; `widths` asks for intervals of predicted deflections.

    What is found is models.json: of every model a `FitRow` with its errors, intervals, compliances and laws,
    the model to take and its F_M on what was held out, doubts, the likeliest first, and what no reading
    checks of the prior.

    Args:
        cell: The arm with its model and its truth.
        models: The models.
        runs: The measured runs.
        clock: Returns the time [s].
        widths: Whether intervals of predicted deflections are computed.

    Returns:
        The fits.

    Raises:
        BenchError: When a method cannot fit a structure to the runs.
    """
    try:
        models, still = _moved(cell, models, runs.used)
        fitted, taken, lost = _fit_all(cell, models, runs.used, clock)
    except BenchError as err:
        raise BenchError("; ".join([*(doubt.sentence for doubt in runs.doubts), str(err)])) from err
    runs = replace(runs, notes=(*runs.notes, *still))
    runs, shown = _shown_runs(runs) if widths else (runs, None)
    estimates = {one.model.name: one.estimate for one in fitted}
    # beside a prior, intervals that count noise alone would look the surest
    plain = all(estimate.weighted_prior is None for estimate in estimates.values())
    sure = [
        widths and (plain or estimate.weighted_prior is not None or name == taken.name)
        for name, estimate in estimates.items()
    ]
    fits = Row(
        dataset=runs.name,
        arm=cell.arm.name,
        runs=runs.used.n_runs,
        poses=len(np.unique(runs.used.pose_id)),
        models=tuple(
            _fit(cell, one, runs, shown if wanted else None)
            for one, wanted in zip(fitted, stepwise(sure, "intervals"), strict=True)
        ),
        recommended=taken.name,
        why="; ".join([taken.why, *of_average(estimates[taken.name].averaged_models)]),
        held_out=[
            Row(name=c.model_name, f_m=c.mean_error, standard_error=c.standard_error)
            for c in taken.candidates
        ],
        doubts=(
            *runs.doubts,
            *of_noise(estimates.values()),
            *_of_prior(estimates, taken.name, default_name(cell)),
        ),
        unchecked=_unchecked(cell, next(m for m in models if m.name == taken.name), estimates),
        notes=runs.notes,
        registration=runs.registration,
        scale=runs.scale,
        failed=tuple(
            failed_row(own.model.name, own.model.structure, FAILED + own.why, prior=own.model.filled)
            for own in lost
        ),
    )
    return IdentifyResult(fits, runs, estimates, {c.model_name: c.errors for c in taken.candidates})


def _shown_runs(runs: MeasuredRuns) -> tuple[MeasuredRuns, Dataset]:
    """Select runs for intervals: those to check with or else those used, at most `MAX_EVALUATED_RUNS`."""
    shown = runs.check or runs.used
    if shown.n_runs <= MAX_EVALUATED_RUNS:
        return runs, shown
    note = f"intervals are computed for {MAX_EVALUATED_RUNS} of {shown.n_runs} runs"
    every = select_evenly(np.arange(shown.n_runs), MAX_EVALUATED_RUNS)
    return replace(runs, notes=(*runs.notes, note)), select_rows(shown, every)


def _moved(cell: Cell, models: Sequence[Model], data: Dataset) -> tuple[Sequence[Model], list[str]]:
    """The models that the loads move, and a sentence on each other one.

    Loads along z turn no hinge about z and push no slide along y: an arm of these alone bends in its links.

    Raises:
        BenchError: When they move none.
    """
    blocks = [slice(k, k + RUNS_PER_BATCH) for k in range(0, data.n_runs, RUNS_PER_BATCH)]
    loads = (
        generalised_load(evaluate_chain(cell.vjm, data.q[b]), data.wrench[b], data.point[b]) for b in blocks
    )
    u = np.max([np.abs(load).max(axis=1) for load in loads], axis=0)
    acts = u > ZERO_COLUMN_TOLERANCE * u.max()
    entries = [np.concatenate([m.structure.rows, m.structure.columns]) for m in models]
    moved = [m for m, own in zip(models, entries, strict=True) if acts[own[own < len(acts)]].any()]
    still = [m.name for m in models if m not in moved]
    if not moved:
        raise BenchError(
            f"expected loads that deflect a part of the model; these deflect none of {', '.join(still)}"
        )
    return moved, [f"{name} is left out: no load deflects its links and joints" for name in still]


def _fit_all(
    cell: Cell, models: Sequence[Model], data: Dataset, clock: Clock
) -> tuple[list[FittedModel], Recommendation, list[EstimatorFailed]]:
    """Fit models and choose one, without the estimators of users that fail; name these.

    Raises:
        BenchError: When a method cannot fit its structure, or no model is left.
    """
    reduced = reduce_runs(cell, models, data)
    fitted, lost = [], []
    for model in stepwise(models, "fitting models"):
        start = clock()
        try:
            estimate = _estimate(cell, model, data, reduced[model.structure.name])
        except EstimatorFailed as err:
            lost.append(err)
        else:
            fitted.append(FittedModel(model, estimate, clock() - start))
    while fitted:
        try:
            return fitted, recommend(cell, [one.model for one in fitted], data, reduced), lost
        except EstimatorFailed as err:  # in runs of which some are held out
            lost.append(err)
            fitted = [one for one in fitted if one.model is not err.model]
    raise BenchError("; ".join(map(str, lost)))


def _estimate(cell: Cell, model: Model, data: Dataset, reduced: GroupedRegression) -> Estimate:
    """Fit a model, to the reduced runs if its method needs no more."""
    method = model.estimator
    if not isinstance(method, Method) or method.loss != "plain":
        return fit_model(cell, model, data)
    if method.learns_trace_weight:
        return method.fit_reduced(cell.vjm, reduced)
    return method.fit_reduced(cell.vjm, with_rows_by_pose(cell.vjm, reduced.to_regression(), data))


def _errors(cell: Cell, estimate: Estimate, data: Dataset) -> DeflectionErrors:
    moved = data.measured_components(deflections(cell.vjm, estimate, data))
    return score(moved[data.is_measured], data.deflection[data.is_measured])


def _of_prior(by_name: Mapping[str, Estimate], taken: str, default: str) -> list[Doubt]:
    """What the readings say against the prior of the default, or of the model that is taken."""
    weighted_prior = by_name[default if default in by_name else taken].weighted_prior
    said = [of_scale(scale) for scale in contradicted_scales(weighted_prior)] if weighted_prior else []
    if default in by_name and taken != default:
        words = f"{taken} predicts better than {default}: is the arm's folder that of this arm?"
        said.append(Doubt("prior", words))
    return said


def _unchecked(cell: Cell, taken: Model, estimates: Mapping[str, Estimate]) -> UndeterminedCompliances:
    """What the readings do not check of a model's prior; nothing where it has none."""
    method = taken.estimator
    if not isinstance(method, Method) or method.prior is None:
        return UndeterminedCompliances()
    regression = estimates[taken.name].compliance_regression
    return undetermined_compliances(regression, scale_by_prior(method.prior, cell.vjm, regression.structure))


def _fit(cell: Cell, fitted: FittedModel, runs: MeasuredRuns, widest: Dataset | None) -> Row:
    """A model; where runs are given with intervals of its predictions there.

    A joint that is counted in the link before it has no compliance. Laws are half widths of backlash and
    friction [rad, m], and the share by which a joint is stiffer when its spring is turned by a milliradian (a
    slide: a millimetre) [1].
    """
    estimate = fitted.estimate
    prior = fitted.model.filled or estimate.weighted_prior is not None
    blocks = (estimate.C_theta[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] for i in range(len(cell.arm.links)))
    return Row(
        vars(fit_row(fitted.model.name, estimate, fitted.seconds, prior=prior)),
        equations=estimate.regression.n_equations,
        identification=error_row(_errors(cell, estimate, runs.used)),
        check=None if runs.check is None else error_row(_errors(cell, estimate, runs.check)),
        intervals=None if widest is None else _intervals(cell, estimate, widest),
        learnt=estimate.weighted_prior is not None
        and estimate.weighted_prior.hyperparameter_effect is not None,
        links={link.name: C.tolist() for link, C in zip(cell.arm.links, blocks, strict=True)},
        joints=_joints(cell, estimate),
        units=UNITS,
        laws=_laws(cell, estimate),
        rejected=estimate.rejected_readings,
    )


def _joints(cell: Cell, estimate: Estimate) -> dict[str, float | None]:
    """Compliance of every joint; None where it is aggregated into the link before it."""
    own = np.diag(estimate.C_theta)[6 * len(cell.arm.links) : cell.arm.n_theta].tolist()
    inside = joints_without_parameters(cell.vjm, estimate.structure)
    pairs = zip(cell.arm.joints, own, strict=True)
    return {joint.name: None if joint.name in inside else compliance for joint, compliance in pairs}


def _laws(cell: Cell, estimate: Estimate) -> dict[str, dict[str, float]]:
    """What every joint does beyond a linear spring; nothing of a linear model."""
    if estimate.averaged_models is None or not estimate.averaged_models.joint_laws_weight:
        return {}
    found = law_sizes(vjm_for_structure(cell.vjm, estimate.structure), estimate.C_theta)
    return {joint: {kind: law_unit(kind) * own[kind] for kind in own} for joint, own in found.items()}


def _intervals(cell: Cell, estimate: Estimate, data: Dataset) -> Row:
    """95 % intervals of deflections, each by itself; null without a bound."""
    found = intervals(cell.vjm, estimate, data)
    half = MM * (found.upper - found.lower) / 2
    known = half[np.isfinite(half)]
    ends = {"centre_mm": found.centre, "lower_mm": found.lower, "upper_mm": found.upper}
    return Row(
        confidence=found.confidence,
        on_boundary=found.on_cone_boundary,
        unbounded=half.size - known.size,
        components=half.size,
        half_width_mm=float(np.median(known)) if known.size else None,
        half_width_max_mm=float(known.max()) if known.size else None,
        deflections=tuple(
            {
                "run": run,
                "marker": marker,
                **{key: [finite(MM * x) for x in own[i, k]] for key, own in ends.items()},
            }
            for i, run in enumerate(data.run_id.tolist())
            for k, marker in enumerate(data.markers)
        ),
    )


def write_stiffness(cell: Cell, identified: IdentifyResult, data: Mapping[str, str], folder: Path) -> None:
    """Write the recommended model into a folder that exists.

    Args:
        cell: The arm with its model and its truth.
        identified: The fits.
        data: SHA-256 of every file of readings, by name.
        folder: The folder.
    """
    fits = identified.fits
    estimate, runs = identified.taken, identified.runs
    used = runs.used
    model, notes = cell.model(estimate), read_body_masses_with_note(cell.arm)[1]
    doubts = [*(doubt.sentence for doubt in fits.doubts), *notes]
    origin = origin_of(
        f"{fits.recommended}: {estimate.method}", data, doubts, loads_about_tool(cell.vjm, used)
    )
    fit = {
        "conservative": estimate.conservative,
        "prior": None if estimate.weighted_prior is None else _prior(estimate.weighted_prior),
        "runs": {
            "runs": used.n_runs,
            "poses": len(np.unique(used.pose_id)),
            "held_back": [] if runs.check is None else np.unique(runs.check.pose_id).tolist(),
            "rejected": len(estimate.rejected_readings),
            "sigma_m": used.sigma,
            "sigma_rotation_rad": used.sigma_rotation,
        },
        "unseen": {
            "directions": estimate.compliance_regression.structure.n_parameters
            - estimate.compliance_regression.rank,
            "without_bound": len(model.posterior.unobservable_directions),
            "stiffer": list(fits.unchecked.stiffer),
            "softer": list(fits.unchecked.softer),
            "words": list(advice(estimate)),
        },
        "notes": [*notes, *fits.notes],
    }
    write_files(replace(model, origin=origin), folder, name=fits.recommended, fit=fit)


def _prior(weighted_prior: WeightedPrior) -> object:
    uncertainty = weighted_prior.uncertainty
    return {
        "name": weighted_prior.scaling.prior_name,
        "learnt": weighted_prior.hyperparameter_effect is not None,
        "uncertainty": float(uncertainty.relative),
        "scale_uncertainty": finite(uncertainty.scale),
        "coupling": None if uncertainty.link_coupling is None else float(uncertainty.link_coupling),
        "misfit": float(weighted_prior.noise_factor),
        "scales": [
            {"name": scale.name, "factor": float(scale.factor), "deviation": finite(scale.log_deviation)}
            for scale in weighted_prior.learnt_scales
        ],
    }
