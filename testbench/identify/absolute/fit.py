"""Calibration from absolute readings: Gauss-Newton for geometry, and a conic program for the compliances.

First geometry and joint springs are fitted, which reveals outliers; then all kinds of errors, which reveals
the noise; then the kinds that cross-validation selects. In each step all unknowns except the compliances are
eliminated from the equations. The remaining `Regression` of the compliances is solved by least squares or
GCO.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Series, evenly_spaced, select_rows
from testbench.display import Displayed
from testbench.errors import Array, BenchError, check_items, check_type
from testbench.identify.absolute.align import (
    Misfit,
    Noise,
    align_all,
    check_fitted_distances,
    equation_deviations,
    estimate_model_error,
    mean_stated_variances,
    robust_weights,
    single_reading_noise,
    unknowns_of,
    with_common_targets,
)
from testbench.identify.absolute.choose import (
    ErrorCandidate,
    SelectedModel,
    SelectionRules,
    joint_space_blocks,
    select_errors,
    with_final_prior,
    with_shared_pattern,
)
from testbench.identify.absolute.evidence import (
    GEOMETRY_ERROR_KINDS,
    ActiveUnknowns,
    activate_unknowns,
    apply_step,
    default_error_scales,
    fit_geometry_and_springs,
    gauss_newton_step,
    learn_error_scales,
    solve_step,
)
from testbench.identify.absolute.posterior import covariance_root
from testbench.identify.absolute.state import (
    ArmState,
    Unknowns,
    nominal_state,
    torque_scale,
    with_error_terms,
)
from testbench.identify.diagnosis.kinematics import (
    MAX_COMPARED_ROWS,
    Issue,
    find_row_shift,
    observations_of_series,
)
from testbench.identify.diagnosis.moves import divide_at_moves
from testbench.identify.estimate import Constraint, Estimate
from testbench.identify.posterior import ArmModel, ModelOrigin, Posterior
from testbench.identify.prior import Prior, PriorUncertainty, scale_by_prior
from testbench.identify.regression import Linearisation, ReducedReadings, reduce_series
from testbench.model.kinematics import JointErrorTerms
from testbench.model.load import BodyMasses, read_body_masses
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import Vjm

MAX_HARMONIC_ORDER = 80
"""Highest order of periodic joint errors that is tried, per turn [1]."""
MAX_INTERMEDIATE_ROWS, MIN_SERIES_ROWS = 4000, 100
"""Most rows of all series, and fewest rows of each series, that an intermediate fit uses."""
MAX_HARMONIC_UNKNOWNS_PER_READING = 3.0
"""Most unknowns of periodic errors per reading [1]. It is above one: their learnt sizes regularise them, and
missing orders harm. 50 poses of a UR10 give 0.17 mm in all other poses, with a limit of 0.6 only 0.38 mm."""
MAX_REVERSED_SCATTER_RATIO = 0.5
"""Scatter of corrected readings over that of the readings as they are, below which these are rejected [1]."""
COMMON_PATTERN = "common pattern"  #: Name of the periodic error that several joints share.
SINGLE_COEFFICIENT_ERRORS = {"gear ratio": "ratio", "backlash": "play", "stiffening": "stiffening"}
"""Terms of `JointErrorTerms` with one coefficient per joint, by the name of the error."""
SELECTABLE_ERRORS = ("joint springs", "joint errors", COMMON_PATTERN, "links", *SINGLE_COEFFICIENT_ERRORS)
"""Names of the errors that a calibration tries in addition to geometry, in order."""


@dataclass(frozen=True)
class CalibrationOptions:
    """Hold the settings of a calibration: its method, and the errors of `SELECTABLE_ERRORS` that it tries."""

    constraint: Constraint = "psd"  #: "psd" for GCO, "none" for least squares.
    max_order: int = MAX_HARMONIC_ORDER  #: Highest order of periodic joint errors, per turn [1].
    excluded_errors: frozenset[str] = frozenset()  #: Names of errors that are not tried.
    #: Names of errors that are used without cross-validation; None to select the errors by cross-validation.
    used_errors: frozenset[str] | None = None
    #: Relative uncertainty of the expected compliances; None to learn it from the readings.
    prior_uncertainty: PriorUncertainty | None = None

    def __post_init__(self) -> None:
        """Refuse unknown names of errors, by BenchError."""
        unknown = (self.excluded_errors | (self.used_errors or frozenset())) - set(SELECTABLE_ERRORS)
        if unknown:
            raise BenchError(
                f"no errors called {', '.join(sorted(unknown))}; there are {', '.join(SELECTABLE_ERRORS)}"
            )

    @property
    def selectable_errors(self) -> frozenset[str]:
        """Return the names of the kinds of errors that this calibration may include, tried or stated."""
        names = SELECTABLE_ERRORS if self.used_errors is None else self.used_errors
        return frozenset(names) - self.excluded_errors


@dataclass(frozen=True, repr=False)
class Calibration(Displayed):
    """Hold a calibrated arm with the uncertainty of its unknowns, the noise and the selection of errors."""

    state: ArmState  #: The calibrated arm, with the frames and mounts of all series.
    active_unknowns: ActiveUnknowns  #: The c unknowns that were estimated.
    #: Information of the readings about all candidate unknowns, without prior, (size, size), SI units.
    information: Array
    #: Upper triangular root R of the posterior precision R^T R, compliances in units of the prior, (c, c).
    precision_root: Array
    noise: Noise  #: Noise of single readings about the calibrated arm.
    selection: SelectedModel  #: Kinds of errors that were selected, with all trials.
    estimate: Estimate | None  #: The compliances with their certificate; None for a rigid arm.
    #: Increase of chi squared by the constraint to positive semi-definite compliances [1].
    constraint_chi2: float
    robust_weights: tuple[Array, ...]  #: Robust weights of the readings, (s, rows) [1] per series.
    series: tuple[Series, ...]  #: The readings, divided where a target or the tracker moved.
    issues: tuple[Issue, ...]  #: Targets that were left out, and moves in mid-series.

    def summary(self) -> dict[str, object]:
        """Summarise the calibration: arm, readings, unknowns, errors that were kept, model error."""
        return {
            "arm": self.state.vjm.arm.name,
            "rows": sum(series.n_rows for series in self.series),
            "unknowns": len(self.active_unknowns.columns),
            "kept": " ".join(step.name.replace(" ", "_") for step in self.selection.steps if step.kept),
            "model_error_um": f"{1e6 * self.noise.position_model_error:.3g}",
        }

    def model(self) -> ArmModel:
        """Make the model of the arm with its uncertainty, without the frames and mounts of the series."""
        active = self.active_unknowns
        state = self.state
        known = posterior_of_calibration(self)
        first = active.unknowns.first_columns["geometry"]
        f = int((active.columns < first).sum())
        prior = active.compliance_prior
        structure = joints_only(state.vjm.arm) if prior is None else prior.structure
        arm = Posterior.from_covariance_root(known.mean[f:], known.covariance_root[f:, f:])
        model = ArmModel(
            state, structure, active.columns, arm, ModelOrigin("absolute calibration"), self.noise
        )
        rigid = active.columns[f : active.n_rigid] - first
        compliances = model.unknowns.first_columns["elastic"] + np.arange(
            len(active.columns) - active.n_rigid
        )
        return replace(model, uncertain_columns=np.concatenate([rigid, compliances]))


def posterior_of_calibration(calibration: "Calibration") -> Posterior:
    """Return the posterior of all unknowns of a calibration; those of frames and mounts are steps from it.

    Mathematics: `abs-13`.

    Args:
        calibration: The calibrated arm.

    Returns:
        Mean and covariance root of the c unknowns, in SI units.
    """
    active = calibration.active_unknowns
    L = np.zeros((0, 0)) if active.compliance_prior is None else active.compliance_prior.L
    x = active.unknowns.values(calibration.state)[active.columns]
    return Posterior.from_covariance_root(x, covariance_root(calibration.precision_root, L))


@dataclass(frozen=True)
class LinearisedReadings:
    """Hold the linear equations of absolute readings, reduced once for any selection of errors."""

    series: tuple[Series, ...]  #: The readings, divided where a target or the tracker moved.
    prior: Prior  #: Expected compliances.
    unknowns: Unknowns  #: All unknowns that may be used.
    state: ArmState  #: Arm at which the equations are linearised, with joint springs and periodic errors.
    noise: Noise  #: Noise of the readings about this arm.
    reduced_readings: ReducedReadings  #: The reduced equations, in blocks of joint space.
    issues: tuple[Issue, ...]  #: Targets that were left out, and moves in mid-series.


def calibrate(
    vjm: Vjm,
    series: Sequence[Series],
    prior: Prior,
    options: CalibrationOptions | None = None,
    body_masses: BodyMasses | None = None,
) -> Calibration:
    """Calibrate an arm from absolute readings: geometry, joint errors and compliances.

    Gauss-Newton linearises geometry and joint errors; least squares or GCO, Eq. (14)-(19), fits the
    compliances. The evidence sets the prior deviations of the errors, and cross-validation selects the kinds
    of errors.

    Args:
        vjm: The arm's nominal virtual joint model.
        series: All absolute readings: joint angles, loads, target positions [m].
        prior: Expected compliances, such as `cad_prior(arm)`.
        options: Method and errors that are tried; None for GCO with all errors.
        body_masses: Masses of the links; None for those of the arm's rigid.xml.

    Returns:
        The calibrated arm with its uncertainty, the noise, and the errors that were kept.

    Raises:
        BenchError: When an argument has another type, there is no series, or one does not fit the arm or
            leaves its frame or target undetermined.
    """
    check_type(vjm, Vjm, "vjm")
    check_items(series, Series, "series")
    check_type(prior, Prior, "prior")
    if not series:
        raise BenchError("series: expected one or more, got none")
    _check_points(series)
    options = options or CalibrationOptions()
    return select_and_solve(linearise_readings(vjm, series, prior, options, body_masses), options)


def _check_points(series: Sequence[Series]) -> None:
    """Refuse a frame of distances with two fixed points, with positions or with planes, by BenchError.

    Planes of one frame are faces of one block.
    """
    fixed: dict[str, tuple[object, float]] = {}
    for readings in series:
        place = "planes" if readings.plane_normal is not None else readings.fixed_point or "positions"
        stated = place, readings.distance_offset_sigma
        known = fixed.setdefault(readings.frame, stated)
        if known != stated:
            raise BenchError(
                f"{readings.name}: frame {readings.frame!r}: expected one fixed point, got {known[0]} and "
                f"{place}, with constants within {known[1]:g} m and {stated[1]:g} m"
            )


def linearise_readings(
    vjm: Vjm,
    series: Sequence[Series],
    prior: Prior,
    options: CalibrationOptions,
    body_masses: BodyMasses | None = None,
) -> LinearisedReadings:
    """Fit geometry and springs to absolute readings, and reduce their equations for any selection of errors.

    This is the first part of `calibrate`.

    Args:
        vjm: The arm's nominal virtual joint model.
        series: The readings.
        prior: Expected compliances.
        options: Method and errors that may be tried.
        body_masses: Masses of the links; None for those of the arm's rigid.xml.

    Returns:
        The reduced equations, and the fitted arm at which they are linearised.
    """
    # Check the readings, and start from the rigid nominal arm.
    series, lost = with_common_targets(series)
    check_row_order(vjm, series)
    body_masses = body_masses or read_body_masses(vjm.arm)
    bare = nominal_state(vjm, body_masses, torque_scale(vjm, body_masses, series))
    joints = scale_by_prior(prior, vjm, joints_only(vjm.arm))

    def fit_series(parts: tuple[Series, ...]) -> tuple[ArmState, Noise]:
        few = thin_series(parts)
        return fit_geometry_and_springs(align_all(bare, few), few, joints, options.constraint)

    # Find moves in mid-series, and fit geometry and joint springs to each part.
    check_last_joint_sign(vjm, series, fit_series)
    moves, (series, (first, noise)) = divide_at_moves(
        series, fit_series, scale_by_prior(prior, vjm, all153(vjm.arm))
    )
    check_fitted_distances(first, series)
    # All errors that the readings can support, as unknowns.
    readings = sum(part.n_equations for part in series)
    highest_order = max(
        1, min(options.max_order, int(MAX_HARMONIC_UNKNOWNS_PER_READING * readings / (2 * vjm.arm.n_joints)))
    )
    orders = tuple(range(1, highest_order + 1)) if "joint errors" in options.selectable_errors else ()
    single = {kind: name in options.selectable_errors for name, kind in SINGLE_COEFFICIENT_ERRORS.items()}
    errors = JointErrorTerms(orders, **single)
    most = all153 if "links" in options.selectable_errors else joints_only
    unknowns = unknowns_of(vjm, series, errors, most(vjm.arm))
    state = with_error_terms(first, errors)
    # One step with periodic errors, for the noise and the point of linearisation.
    active, few = (
        activate_unknowns(unknowns, GEOMETRY_ERROR_KINDS | {"harmonics"}, joints),
        thin_series(series),
    )
    state, dof_ratio = gauss_newton_step(active, few, (state, noise), options.constraint)
    noise = estimate_model_error(state, series, dof_ratio)
    # Reduce all equations once, by blocks of joint space if errors are selected.
    blocks = joint_space_blocks(series) if options.used_errors is None else None
    reduced = reduce_series(Linearisation(unknowns, state, noise), series, blocks)
    return LinearisedReadings(series, prior, unknowns, state, noise, reduced, (*lost, *moves))


def check_last_joint_sign(
    vjm: Vjm, series: Sequence[Series], fit_series: Callable[[tuple[Series, ...]], tuple[ArmState, Noise]]
) -> None:
    """Reject readings that fit much better with the sign of the last joint reversed.

    If a target is near the axis of the last joint, the readings fit some frame with either sign. Readings
    with orientations are not checked, because the alignment finds this mistake in them.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings.
        fit_series: Function that fits geometry and springs to series, and returns the arm and the noise.

    Raises:
        BenchError: When the scatter with the sign reversed is below MAX_REVERSED_SCATTER_RATIO times the
            scatter as read.
    """
    if any(readings.rotation is not None for readings in series):
        return
    thin = [select_rows(readings, evenly_spaced(readings.n_rows, MAX_COMPARED_ROWS)) for readings in series]
    sign = np.where(np.arange(vjm.arm.n_joints) == vjm.arm.n_joints - 1, -1.0, 1.0)
    try:
        mirrored = fit_series(tuple(replace(readings, q=sign * readings.q) for readings in thin))[
            1
        ].position_model_error
    except BenchError:
        return
    as_read = fit_series(tuple(thin))[1].position_model_error
    if mirrored < MAX_REVERSED_SCATTER_RATIO * as_read:
        raise BenchError(
            f"{series[0].name}: the readings fit this arm to {1e3 * as_read:.2g} mm along an axis; with the "
            f"other sign of {vjm.arm.joints[-1].name} they would fit to {1e3 * mirrored:.2g} mm"
        )


def check_row_order(vjm: Vjm, series: Sequence[Series]) -> None:
    """Reject a series in which all readings from some row on belong to the previous or the next pose.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings.

    Raises:
        Misfit: When the rows of a series slipped in this way.
    """
    for readings in series:
        if readings.distance is None and (slip := find_row_shift(observations_of_series(vjm, readings))):
            first = readings.row_id[slip.first_row]
            raise Misfit(f"{readings.name}: its rows from {first} on do not fit those before", readings)


def select_and_solve(linearised_readings: LinearisedReadings, options: CalibrationOptions) -> Calibration:
    """Select the errors that predict held-out readings best, and solve for the selected unknowns.

    This is the second part of `calibrate`.

    Args:
        linearised_readings: The reduced equations of the readings.
        options: Method and errors that are tried.

    Raises:
        BenchError: When the readings leave a frame or target undetermined, or the options use link
            compliances that the reduced equations lack.
    """
    series, reduced = linearised_readings.series, linearised_readings.reduced_readings
    variance, repetitions = mean_stated_variances(series)
    deviations = equation_deviations(linearised_readings.noise, variance, repetitions)
    rules = SelectionRules(deviations[list(reduced.kinds)], options.constraint)
    # Select the errors, then solve for the selected unknowns.
    chosen = _select_errors(linearised_readings, options, rules)
    solved = solve_step(
        chosen.active_unknowns,
        chosen.reduced_readings,
        chosen.error_scales,
        options.constraint,
        options.prior_uncertainty,
    )
    chosen = with_final_prior(chosen, rules, solved.weighted_prior)
    after = apply_step(linearised_readings.state, chosen.active_unknowns, solved.x)
    # Noise of single readings about the result.
    factor = linearised_readings.noise.factor.copy()
    factor[list(reduced.kinds)] = chosen.error_scales.noise_factor
    combined = replace(linearised_readings.noise, factor=factor)
    noise = single_reading_noise(combined, variance, repetitions)
    return Calibration(
        state=after,
        active_unknowns=chosen.active_unknowns,
        information=np.tensordot(chosen.error_scales.noise_factor**-2.0, reduced.total_gram_matrices, 1)[
            :-1, :-1
        ],
        precision_root=solved.precision_root,
        noise=noise,
        selection=chosen,
        estimate=solved.estimate,
        constraint_chi2=solved.constraint_chi2,
        robust_weights=tuple(robust_weights(after, readings, noise) for readings in series),
        series=series,
        issues=linearised_readings.issues,
    )


def _select_errors(
    linearised_readings: LinearisedReadings, options: CalibrationOptions, rules: SelectionRules
) -> SelectedModel:
    """Select the errors by cross-validation, or take those of the options; links include joint springs."""
    unknowns = linearised_readings.unknowns
    reduced = linearised_readings.reduced_readings
    vjm = linearised_readings.state.vjm
    # The errors that may be added to geometry, in their order.
    joints, links = (
        scale_by_prior(linearised_readings.prior, vjm, most(vjm.arm)) for most in (joints_only, all153)
    )
    every = {
        "joint springs": ErrorCandidate("joint springs", compliance_prior=joints, always_kept=True),
        "joint errors": ErrorCandidate("joint errors", frozenset({"harmonics"})),
        COMMON_PATTERN: ErrorCandidate(COMMON_PATTERN, frozenset({"pattern"}), searches_pattern=True),
        "links": ErrorCandidate("links", compliance_prior=links),
    } | {name: ErrorCandidate(name, frozenset({kind})) for name, kind in SINGLE_COEFFICIENT_ERRORS.items()}
    on = [every[name] for name in SELECTABLE_ERRORS if name in options.selectable_errors]
    if options.used_errors is None:
        return select_errors(unknowns, reduced, on, rules)
    # Chosen by hand: all of them at once, and then the pattern if joints share one.
    kinds = GEOMETRY_ERROR_KINDS.union(*(candidate.error_kinds for candidate in on))
    priors = [candidate.compliance_prior for candidate in on if candidate.compliance_prior is not None]
    active = activate_unknowns(unknowns, kinds - {"pattern"}, priors[-1] if priors else None)

    scales = default_error_scales(unknowns, len(reduced.kinds))
    scales = learn_error_scales(active, reduced, scales, options.constraint)
    if COMMON_PATTERN in options.selectable_errors and (
        shared := with_shared_pattern(active, kinds, scales, reduced)
    ):
        active, reduced = shared
        scales = learn_error_scales(active, reduced, scales, options.constraint)
    return SelectedModel(active, scales, reduced, kinds, ())


def thin_series(series: Sequence[Series]) -> tuple[Series, ...]:
    """Select at most about `MAX_INTERMEDIATE_ROWS` rows of all series; all rows of a pose stay together."""
    every, thinned = sum(readings.n_rows for readings in series), []
    for readings in series:
        stride = min(-(-every // MAX_INTERMEDIATE_ROWS), max(1, readings.n_rows // MIN_SERIES_ROWS))
        _, pose = np.unique(readings.pose_id, return_inverse=True)
        thinned.append(select_rows(readings, pose % stride == 0) if stride > 1 else readings)
    return tuple(thinned)
