"""Selection of the kinds of errors that a calibration estimates; and link masses from joint torques.

`select_errors` tries kinds of errors one after the other. A kind is kept if it improves the prediction of
held-out blocks of joint space, or of held-out series, and makes neither worse.

`fit_link_masses` fits masses to measured joint torques,

    sign torque_j = sum over bodies of (load of joint j per unit of p) p + load of the wrench + offset_j

with p the mass and first moments of every body. Torques in static poses do not determine all of them: the
masses of rigid.xml are their prior. Friction of unknown direction counts as noise, and Huber's loss bounds
outliers. The deflection of the arm is neglected, which changes a torque by a thousandth.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from testbench.data.dataset import Series
from testbench.errors import Array, Ids
from testbench.identify.absolute.evidence import (
    GEOMETRY_ERROR_KINDS,
    WIDE_PRIOR,
    ActiveUnknowns,
    ErrorScales,
    activate_unknowns,
    default_error_scales,
    gram_of_active_unknowns,
    learn_error_scales,
    solve_active_unknowns,
)
from testbench.identify.absolute.state import Unknowns, error_pattern_coefficients, find_error_pattern
from testbench.identify.estimate import Constraint
from testbench.identify.hierarchy import NormalEquationsSolution
from testbench.identify.prior import PriorScaling, PriorUncertainty, WeightedPrior
from testbench.identify.regression import ReducedReadings, SeriesBlock, sum_gram_matrices
from testbench.identify.trace import mean_and_standard_error
from testbench.model.load import BodyMasses, own_weight_matrix
from testbench.model.vjm import Vjm, evaluate_chain, generalised_load
from testbench.progress import stepwise

# --- Selection of errors ------------------------------------------------------------------------------------

MAX_JOINT_SPACE_BLOCKS = 16
"""Most blocks of joint space, over all series, that are held out in turn."""
MIN_BLOCK_POSES = 6
"""Fewest poses of a block of joint space: fewer determine a frame too poorly."""
MIN_HELD_OUT_ERROR_DECREASE = 0.1
"""Least relative decrease of the held-out mean square by a kind of error that is kept [1]: 5 % of the RMS."""
MAX_HELD_OUT_ERROR_INCREASE = 0.01
"""Largest relative increase of the held-out mean square, in blocks or series, by a kind that is kept [1]."""
MIN_VARIANCE_RATIO_OF_REFIT = 100.0
"""Variance of a frame or mount without the held-out readings, over that with them, above which the held-out
readings fit it anew [1]."""
INDIVIDUAL_PERIODIC_ERROR_SHARE = 0.2
"""Share of the variance of periodic errors that is individual to each joint while a pattern is sought [1]."""
MIN_REMAINING_EQUATION_RATIO = 0.2
"""Least share of all equations that must remain when a series is held out [1]."""
LOAD_FEATURE_WEIGHT = 2.0
"""Distance between the largest load and no load in the space of sines and cosines of the joints, in which
blocks are formed [1]: very different loads are in different blocks."""


@dataclass(frozen=True)
class SelectionStep:
    """Hold the prediction errors of held-out readings without and with one kind of error."""

    name: str  #: Kind of error that was added to all those kept before.
    kept: bool  #: Whether this kind of error is kept.
    rms_before: float  #: RMS error of held-out positions along an axis without this kind [m].
    rms_after: float  #: RMS error of held-out positions along an axis with this kind [m].
    standard_error: float  #: Standard error of the difference of the two mean squares, over the first [1].
    #: RMS error of held-out series, with frame and mount fitted anew, without this kind [m]; NaN for one
    #: series.
    series_rms_before: float
    series_rms_after: float  #: RMS error of held-out series with this kind [m].


@dataclass(frozen=True)
class SelectedModel:
    """Hold the unknowns that a calibration estimates, selected by `select_errors` or stated by the user."""

    active_unknowns: ActiveUnknowns  #: The selected unknowns.
    error_scales: ErrorScales  #: Their prior deviations, and noise factors.
    reduced_readings: ReducedReadings  #: The reduced equations, in the basis of these unknowns.
    error_kinds: frozenset[str]  #: Kinds of errors among the unknowns.
    steps: tuple[SelectionStep, ...]  #: Trials of kinds of errors, in order.
    #: Name of the best simpler model, for comparison: geometry, perhaps with joint springs.
    simpler_model: str = ""
    #: Errors of held-out positions along an axis, by the simpler and the selected model, (blocks,) [m].
    #: Blocks are weighted by their positions, so that the RMS over blocks is that over positions.
    held_out_rms: tuple[Array, Array] = (np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class ErrorCandidate:
    """Describe one kind of error that `select_errors` tries."""

    name: str  #: Name in reports and in `CalibrationOptions`.
    error_kinds: frozenset[str] = frozenset()  #: Kinds of unknowns that it adds.
    #: Prior of the compliances that it adds, in place of the earlier ones; None if it adds none.
    compliance_prior: PriorScaling | None = None
    always_kept: bool = False  #: Whether it is kept without a trial, because every arm has this error.
    #: Whether it searches for an error pattern that joints share; it is kept unless it harms.
    searches_pattern: bool = False


def joint_space_blocks(series: Sequence[Series]) -> list[Ids]:
    """Divide the rows of each series into blocks of joint space, to be held out in turn.

    The blocks are the clusters of k-means on sines and cosines of the joints and on the load. Rows of a pose
    share a block. If a block leaves fewer than `MIN_BLOCK_POSES` poses outside it, the series is divided into
    two halves.

    Args:
        series: The readings.

    Returns:
        Index of the block of every row, (rows,) per series.
    """
    from scipy.cluster.vq import kmeans2  # here: it takes long to import, and few runs need it

    rows = sum(readings.n_rows for readings in series)
    blocks = []
    for readings in series:
        share = round(MAX_JOINT_SPACE_BLOCKS * readings.n_rows / rows)
        _, first, pose = np.unique(readings.pose_id, return_index=True, return_inverse=True)
        k = max(1, min(max(2, share), len(first) // MIN_BLOCK_POSES))
        load = np.linalg.norm(readings.wrench[:, :3], axis=1)
        place = np.column_stack(
            [np.sin(readings.q), np.cos(readings.q), LOAD_FEATURE_WEIGHT * load / (load.max() or 1.0)]
        )
        label = np.zeros(readings.n_rows, dtype=int)
        if k > 1:
            label = kmeans2(place, k, minit="++", seed=0)[1].astype(int)
        if k > 1 and len(first) - np.bincount(label[first]).max() < MIN_BLOCK_POSES:
            label[first] = 2 * np.arange(len(first)) // len(first)
        blocks.append(label[first[pose]])
    return blocks


@dataclass(frozen=True)
class SelectionRules:
    """Hold the settings with which `select_errors` compares models on held-out readings."""

    #: Expected standard deviation of each kind of equations, (kinds,) [m, rad].
    equation_deviation: Array
    constraint: Constraint = "psd"  #: Constraint on the compliances: "psd" for GCO, "none" for least squares.
    prior_uncertainty: PriorUncertainty = WIDE_PRIOR  #: Relative uncertainty of the expected compliances.


def select_errors(
    unknowns: Unknowns,
    reduced_readings: ReducedReadings,
    candidates: Sequence[ErrorCandidate],
    rules: SelectionRules,
) -> SelectedModel:
    """Select the kinds of errors that predict held-out readings better, tried one after the other.

    Mathematics: `abs-10`.

    Args:
        unknowns: All unknowns that may be used.
        reduced_readings: The reduced equations, in blocks of joint space.
        candidates: Kinds of errors to try, in order; geometry is always used.
        rules: Settings of the comparison.

    Returns:
        The selected unknowns with the sizes of their errors, and all trials.
    """
    geometry = activate_unknowns(unknowns, GEOMETRY_ERROR_KINDS, None)
    initial = default_error_scales(unknowns, len(reduced_readings.kinds))
    best = _evaluate(geometry, GEOMETRY_ERROR_KINDS, reduced_readings, initial, rules)
    # Forward selection: add each candidate to the kept ones, and keep it if held-out readings improve.
    steps: dict[str, SelectionStep] = {}
    simpler_trials = {"geometry": best}
    for candidate in stepwise(candidates, "trying errors"):
        added = _add_candidate(best, candidate)
        if added is None:
            continue
        trial = _evaluate(*added, best.scales, rules)
        steps[candidate.name] = _selection_step(candidate, best, trial)
        if steps[candidate.name].kept:
            best = trial
        if candidate.always_kept:
            simpler_trials[f"geometry and {candidate.name}"] = best
    # Backward pass: drop a kind that a later one has made unnecessary.
    kept = [candidate for candidate in candidates if candidate.name in steps and steps[candidate.name].kept]
    for candidate in kept[:-1]:  # the next one that was kept may explain the same
        has_pattern = "pattern" in best.error_kinds and candidate.error_kinds & {"harmonics", "pattern"}
        if candidate.error_kinds and not candidate.always_kept and not has_pattern:
            fewer = best.error_kinds - candidate.error_kinds
            active = activate_unknowns(best.active.unknowns, fewer, best.active.compliance_prior)
            trial = _evaluate(active, fewer, best.reduced_readings, best.scales, rules)
            again = _selection_step(candidate, trial, best)
            if not again.kept:
                best = trial
                steps[candidate.name] = again
    # Held-out errors of the simpler model, for comparison.
    simpler = {name: trial for name, trial in simpler_trials.items() if trial is not best} or simpler_trials
    plain, trial = min(simpler.items(), key=lambda named: named[1].blocks[:, 2].sum())
    return SelectedModel(
        best.active,
        best.scales,
        best.reduced_readings,
        best.error_kinds,
        tuple(steps.values()),
        plain,
        (_by_block(trial.blocks), _by_block(best.blocks)),
    )


def with_shared_pattern(
    active_unknowns: ActiveUnknowns,
    error_kinds: frozenset[str],
    scales: ErrorScales,
    reduced_readings: ReducedReadings,
) -> tuple[ActiveUnknowns, ReducedReadings] | None:
    """Add an error pattern that several joints share to the unknowns, if the readings show one.

    Args:
        active_unknowns: The selected unknowns, periodic joint errors among them.
        error_kinds: Kinds of errors among the unknowns.
        scales: Prior deviations of the unknowns, and noise factors.
        reduced_readings: The reduced equations of all unknowns.

    Returns:
        The unknowns with the pattern, and the equations in their basis; None if no two joints share a
        pattern.
    """
    unknowns = active_unknowns.unknowns
    errors = active_unknowns.unknowns.error_terms
    joints = active_unknowns.unknowns.vjm.arm.joints
    waves = error_pattern_coefficients(errors)
    if "harmonics" not in error_kinds or not len(waves):
        return None
    at = unknowns.first_columns["errors"] + errors.n_coefficients * np.arange(len(joints))[:, None] + waves
    whole, orders = scales.deviation[at[0]] ** 2, np.array(errors.orders)[waves[: len(waves) // 2]]
    # Precision of each hinge's waves from the readings alone: posterior precision minus that of the prior.
    gram = gram_of_active_unknowns(active_unknowns, reduced_readings.total_gram_matrices)
    solved, joint_information = solve_active_unknowns(active_unknowns, gram, scales, WIDE_PRIOR), []
    V = solved.covariance
    for joint, j in zip(joints, np.searchsorted(active_unknowns.columns, at), strict=True):
        precision = np.asarray(np.linalg.inv(V[np.ix_(j, j)]), dtype=float)
        known = float(not joint.prismatic)
        joint_information.append(
            (known * (precision - np.diag(1 / whole)), np.asarray(known * (precision @ solved.x[j])))
        )
    individual = INDIVIDUAL_PERIODIC_ERROR_SHARE * whole
    unknowns = replace(
        unknowns, shared_pattern=find_error_pattern(joint_information, individual, whole - individual, orders)
    )
    if unknowns.equation_basis is None:
        return None
    with_pattern = activate_unknowns(unknowns, error_kinds | {"pattern"}, active_unknowns.compliance_prior)
    return with_pattern, reduced_readings.in_basis(unknowns.equation_basis)


@dataclass(frozen=True)
class _Trial:
    """Hold the held-out errors of one choice of errors."""

    active: ActiveUnknowns
    error_kinds: frozenset[str]
    reduced_readings: ReducedReadings  #: The reduced equations, in the basis of the unknowns.
    scales: ErrorScales
    #: Number, whitened sum of squares and sum of squares [m^2] of the positions in every held-out block, and
    #: its `predictive_deviance` if there are faces, (blocks, 4).
    blocks: Array
    series: Array  #: The four numbers for every held-out series, (series, 4).


def _add_candidate(
    trial: _Trial, candidate: ErrorCandidate
) -> tuple[ActiveUnknowns, frozenset[str], ReducedReadings] | None:
    """Add a kind of error to those of a trial; None for a pattern that no joints share."""
    active, equations = trial.active, trial.reduced_readings
    kinds = trial.error_kinds | candidate.error_kinds
    if candidate.searches_pattern:
        shared = with_shared_pattern(active, trial.error_kinds, trial.scales, equations)
        return None if shared is None else (shared[0], kinds, shared[1])
    prior = candidate.compliance_prior or active.compliance_prior
    return activate_unknowns(active.unknowns, kinds, prior), kinds, equations


def _evaluate(
    active: ActiveUnknowns,
    error_kinds: frozenset[str],
    reduced: ReducedReadings,
    start: ErrorScales,
    rules: SelectionRules,
) -> _Trial:
    """Learn the sizes of a choice of errors, and compute its errors on held-out blocks and series."""
    scales = learn_error_scales(active, reduced, start, rules.constraint)
    every = _by_series(reduced)
    most = (1 - MIN_REMAINING_EQUATION_RATIO) * reduced.n_equations.sum()
    # A face is no repetition of the others: only its own heights show motion along its normal.
    repeated = [parts for parts in every if len(every) > 1 and not any(part.is_plane_face for part in parts)]
    fair = [parts for parts in repeated if sum(part.n_equations.sum() for part in parts) <= most]
    blocks = _held_out_sums(active, reduced, scales, rules, _blocks_to_hold_out(reduced))
    series = _held_out_sums(active, reduced, scales, rules, fair)
    return _Trial(active, error_kinds, reduced, scales, blocks, series)


def _by_series(reduced: ReducedReadings) -> list[list[SeriesBlock]]:
    """Group the blocks by their series."""
    places = sorted({part.series_index for part in reduced.blocks})
    return [[part for part in reduced.blocks if part.series_index == place] for place in places]


def _has_plane_faces(reduced: ReducedReadings) -> bool:
    """Tell whether some readings are heights over plane faces."""
    return any(part.is_plane_face for part in reduced.blocks)


def _blocks_to_hold_out(reduced: ReducedReadings) -> list[list[SeriesBlock]]:
    """List the blocks that can be held out: the only block of a series has no others to fix its frame."""
    return [[part] for blocks in _by_series(reduced) if len(blocks) > 1 for part in blocks]


def _held_out_sums(
    active: ActiveUnknowns,
    reduced: ReducedReadings,
    scales: ErrorScales,
    rules: SelectionRules,
    held: Sequence[Sequence[SeriesBlock]],
) -> Array:
    """Hold out parts of the readings in turn: the numbers of `_Trial.blocks`, (held, 4)."""
    S = gram_of_active_unknowns(active, reduced.total_gram_matrices)
    positions = reduced.is_position
    totals = []
    faces = _has_plane_faces(reduced)
    first = np.searchsorted(active.columns, active.unknowns.first_columns["geometry"])
    whole = solve_active_unknowns(active, S, scales, rules.prior_uncertainty).variances(np.arange(first))
    for parts in held:
        n = sum(part.n_equations[positions].sum() for part in parts)
        every, deviance = _held_out(active, S, parts, (scales, rules), whole, faces=faces)
        sums = every[positions]
        totals.append((n, sums.sum(), rules.equation_deviation[positions] ** 2 @ sums, deviance))
    return np.array(totals).reshape(-1, 4)


def with_final_prior(
    selected_model: SelectedModel, rules: SelectionRules, weighted_prior: WeightedPrior | None
) -> SelectedModel:
    """Compute the held-out errors of a selected model again, with the prior of the final compliances.

    Args:
        selected_model: The selection; its held-out errors are those under the prior of the comparison.
        rules: Settings of the comparison.
        weighted_prior: Prior of the final compliances; None for a rigid arm.

    Returns:
        The selection with the new held-out errors; unchanged if no block can be held out.
    """
    plain, every = selected_model.held_out_rms
    if weighted_prior is None or not len(every):
        return selected_model
    active, rules = (
        replace(selected_model.active_unknowns, compliance_prior=weighted_prior.scaling),
        replace(rules, prior_uncertainty=weighted_prior.uncertainty),
    )
    blocks = _held_out_sums(
        active,
        selected_model.reduced_readings,
        selected_model.error_scales,
        rules,
        _blocks_to_hold_out(selected_model.reduced_readings),
    )
    return replace(selected_model, held_out_rms=(plain, _by_block(blocks)))


def _held_out(
    active: ActiveUnknowns,
    S: Array,
    parts: Sequence[SeriesBlock],
    scales_and_rules: tuple[ErrorScales, SelectionRules],
    variances: Array,
    *,
    faces: bool,
) -> tuple[Array, float]:
    """Compute the sums of squares of held-out parts, predicted by the other readings, and their deviance.

    S are the Gram matrices of all readings; a part is a block, or all blocks of a series. Frames and mounts
    that the others hardly determine are fitted to the held-out parts; variances are theirs by all readings.
    """
    (scales, rules), k = scales_and_rules, len(variances)
    # Gram matrices of the other readings: the difference of two sums.
    T, every = gram_of_active_unknowns(active, sum_gram_matrices(parts)), np.arange(len(active.columns))
    others = S - T
    # Frames and mounts that occur in the held-out parts alone are no unknowns of the others.
    alone = np.flatnonzero(np.abs(others[:, : active.n_rigid, :k]).sum(axis=(0, 1)) == 0)
    rest, at = np.delete(every, alone), np.delete(np.arange(len(every) + 1), alone)
    if len(alone):
        others = others[:, at][:, :, at]
    normal = solve_active_unknowns(
        ActiveUnknowns(active.unknowns, active.columns[rest], active.compliance_prior),
        others,
        scales,
        rules.prior_uncertainty,
        rules.constraint,
    )
    # Fit these, and those with a much larger variance, to the held-out parts, all else fixed.
    placements = rest[rest < k]
    opened = placements[
        normal.variances(np.arange(len(placements))) > MIN_VARIANCE_RATIO_OF_REFIT * variances[placements]
    ]
    v, open_ = np.zeros(len(every) + 1), np.r_[alone, opened]
    v[at] = np.r_[normal.x, -1.0]
    deviance = 0.0
    if faces:
        counts = np.sum([part.n_equations for part in parts], axis=0)
        deviance = predictive_deviance(
            np.tensordot(scales.noise_factor**-2.0, T, 1)[np.ix_(at, at)], v[at], normal
        ) + float(2 * counts @ np.log(scales.noise_factor))
    if len(open_):
        H = np.tensordot(scales.noise_factor**-2.0, T, 1)
        v[open_] -= np.linalg.lstsq(H[np.ix_(open_, open_)], H[open_] @ v, rcond=None)[0]
    return np.asarray(T @ v @ v), deviance


def predictive_deviance(
    gram: Array, unknowns_and_minus_one: Array, posterior: NormalEquationsSolution
) -> float:
    """Compute -2 times the log predictive density of held-out readings, up to a constant.

    Mathematics: `abs-16`.

    Args:
        gram: Gram matrix [A | y]^T [A | y] of the whitened held-out equations, (c + 1, c + 1).
        unknowns_and_minus_one: Most probable unknowns by the other readings, then -1, (c + 1,).
        posterior: Posterior of the unknowns by the other readings.

    Returns:
        The deviance [1].
    """
    v = unknowns_and_minus_one
    left, U = gram @ v, np.triu(posterior.precision_root[0]) * posterior.precision_scale
    both = cho_factor(U.T @ U + gram[:-1, :-1])  # precision by all readings
    squares = float(v @ left - left[:-1] @ cho_solve(both, left[:-1]))
    return squares + 2 * float(np.log(np.diag(both[0])).sum()) - posterior.log_determinant


def _selection_step(tried: ErrorCandidate, before: _Trial, after: _Trial) -> SelectionStep:
    """Decide whether a candidate is kept, from the held-out errors before and after it."""
    count = max(before.blocks[:, 0].sum(), 1.0)
    saved = (before.blocks[:, 1] - after.blocks[:, 1]) / count
    old, new = (max(x.blocks[:, 1].sum(), 1e-300) / count for x in (before, after))
    deviation = max(1, len(saved)) * mean_and_standard_error(saved)[1] / old
    gain = 1 - after.series[:, 1].sum() / before.series[:, 1].sum() if len(before.series) else 0.0
    blocks = 1 - new / old
    if _has_plane_faces(after.reduced_readings):
        # One block may be all that shows a direction: its prediction is then uncertain.
        saved = (before.blocks[:, 3] - after.blocks[:, 3]) / count
        blocks, deviation = -math.expm1(-saved.sum()), max(1, len(saved)) * mean_and_standard_error(saved)[1]
    pays = (
        blocks > max(MIN_HELD_OUT_ERROR_DECREASE, deviation)
        or gain > MIN_HELD_OUT_ERROR_DECREASE
        or tried.searches_pattern
    )
    pays = pays and min(blocks, gain) > -MAX_HELD_OUT_ERROR_INCREASE
    every = (before.blocks, after.blocks, before.series, after.series)
    rms = [
        math.sqrt(sums[:, 2].sum() / max(sums[:, 0].sum(), 1.0)) if len(sums) else math.nan for sums in every
    ]
    return SelectionStep(
        tried.name, bool(pays or tried.always_kept), rms[0], rms[1], deviation, rms[2], rms[3]
    )


def _by_block(sums: Array) -> Array:
    """Compute errors along an axis, (blocks,) [m], whose RMS is that over the positions of all blocks."""
    return np.asarray(np.sqrt(sums[:, 2] * len(sums) / max(sums[:, 0].sum(), 1.0)))


# --- Masses of the links from measured joint torques --------------------------------------------------------

MASS_DEVIATION = 0.3  #: Prior standard deviation of a mass, relative to that of rigid.xml [1].
CENTRE_DEVIATION = 0.1  #: Prior standard deviation of each coordinate of a centre of mass [m].
MAX_MASS_DEVIATIONS = 3.0
"""Bound on each parameter of the masses, in prior standard deviations [1]: no mass falls below a tenth."""
MAX_UNEXPLAINED_TORQUE_RATIO = 0.3
"""Largest residual of the torques, over their standard deviation, with which fitted masses are used [1]."""
HUBER_THRESHOLD = 1.345
"""Threshold of Huber's loss in standard deviations [1]: 95 % efficiency for normal errors."""
MIN_TORQUE_NOISE_RATIO = 1e-4
"""Least noise of the torques of a joint, over their standard deviation [1]."""
N_REWEIGHTINGS = 10  #: Reweighted solutions of the robust least squares.
MAX_POSES_IN_MEMORY = 1000  #: Most poses whose columns of all virtual joints are in memory together.


@dataclass(frozen=True)
class MassFit:
    """Hold link masses fitted to measured joint torques, and how well they explain the torques."""

    body_masses: BodyMasses  #: Fitted masses; the nominal ones if gravity does not explain the torques.
    n_poses: int  #: Number of poses with measured torques.
    nominal_residual: float  #: RMS residual of the torques with the nominal masses [N m, N].
    residual: float  #: RMS residual of the torques with the fitted masses [N m, N].
    torque_deviation: (
        float  #: RMS deviation of the torques, less those of the wrenches, from their mean [N m, N].
    )
    bodies_at_bound: tuple[str, ...]  #: Links and tool with a parameter at its bound.
    #: Whether the torques are those of the motors against gravity; else they are those of gravity.
    are_motor_torques: bool = False

    @property
    def explains_torques(self) -> bool:
        """Tell whether gravity with the fitted masses explains the measured torques."""
        return self.residual <= MAX_UNEXPLAINED_TORQUE_RATIO * self.torque_deviation


def fit_link_masses(vjm: Vjm, nominal_masses: BodyMasses, series: tuple[Series, ...]) -> MassFit | None:
    """Fit the masses of the links to the measured joint torques of absolute readings.

    Torques may have either sign, and each joint a constant offset.

    Mathematics: `abs-12`.

    Args:
        vjm: The arm's virtual joint model.
        nominal_masses: Nominal masses of the links; bodies without mass stay massless.
        series: The readings, some with torques.

    Returns:
        The masses, and how well they explain the torques; None if no series has torques.
    """
    parts = list(_rows(vjm, series))
    if not parts:
        return None
    A, known, torque = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    names = [*(link.name for link in vjm.arm.links[1:]), vjm.arm.tool]
    carries, carried = (_fit(nominal_masses, names, A, sign * torque - known) for sign in (1, -1))
    best = min(carries, replace(carried, are_motor_torques=True), key=lambda fit: fit.residual)
    return best if best.explains_torques else replace(best, body_masses=nominal_masses, bodies_at_bound=())


def _rows(vjm: Vjm, series: tuple[Series, ...]) -> Iterator[tuple[Array, Array, Array]]:
    """Compute columns, (n, runs, 4 (bodies - 1)), wrench loads and torques, (n, runs), of some poses."""
    n = vjm.arm.n_joints
    for readings, torque in ((part, part.torque) for part in series if part.torque is not None):
        for start in range(0, readings.n_rows, MAX_POSES_IN_MEMORY):
            rows = slice(start, start + MAX_POSES_IN_MEMORY)
            where = evaluate_chain(vjm, readings.q[rows])
            columns = own_weight_matrix(where)[-n:, :, 1:]
            known = generalised_load(where, readings.wrench[rows], readings.point[rows])[-n:]
            yield columns.reshape(*columns.shape[:2], -1), known, torque[rows].T


def _fit(nominal_masses: BodyMasses, names: Sequence[str], A: Array, y: Array) -> MassFit:
    """Fit masses by least squares with a prior, reweighted; offsets are removed as weighted means.

    y are loads of the joints by gravity, (n, runs) [N m, N], with an offset. A is y per unit of each of the
    four parameters of every body but the base, (n, runs, 4 (bodies - 1)).
    """
    prior = nominal_masses.inertial_parameters[1:].ravel()
    sd = (
        nominal_masses.mass[1:, None]
        * np.array([MASS_DEVIATION, CENTRE_DEVIATION, CENTRE_DEVIATION, CENTRE_DEVIATION])
    ).ravel()
    y_0, A = y - A @ prior, A * sd  # from here on steps from the prior, in its standard deviations
    ones = np.ones_like(y)
    spread, left = _scatter(_off_mean(y, ones)), _off_mean(y_0, ones)
    before, x = _scatter(left), np.zeros_like(sd)
    for _ in range(N_REWEIGHTINGS):
        sigma = np.maximum(_scatter(left), MIN_TORQUE_NOISE_RATIO * spread)[:, None]
        sigma = np.where(sigma > 0, sigma, 1.0)  # a joint without torques
        w = np.minimum(1, HUBER_THRESHOLD * sigma / np.maximum(np.abs(left), 1e-300)) / sigma**2
        x = _step(_off_mean(A, w), _off_mean(y_0, w), w)
        left = _off_mean(y_0 - A @ x, w)
    at_bound = (np.abs(x) > MAX_MASS_DEVIATIONS * (1 - 1e-9)).reshape(-1, 4).any(axis=1)
    p = np.vstack([nominal_masses.inertial_parameters[:1], (prior + sd * x).reshape(-1, 4)])
    return MassFit(
        body_masses=BodyMasses(p[:, 0], p[:, 1:] / np.where(p[:, :1] > 0, p[:, :1], 1)),
        n_poses=y.shape[1],
        nominal_residual=_rms(before),
        residual=_rms(_scatter(left)),
        torque_deviation=_rms(spread),
        bodies_at_bound=tuple(name for name, on in zip(names, at_bound, strict=True) if on),
    )


def _step(A: Array, y: Array, w: Array) -> Array:
    """Minimise the sum of w (A x - y)^2 and x^2 within the bounds, (4 (bodies - 1),) [1]."""
    from scipy.optimize import lsq_linear  # here: it takes long to import, and few runs have torques

    size = A.shape[2]
    rows = np.column_stack([A.reshape(-1, size), y.ravel()]) * np.sqrt(w).reshape(-1, 1)
    R: Array = np.asarray(np.linalg.qr(np.vstack([rows, np.eye(size, size + 1)]), mode="r"))
    return np.asarray(
        lsq_linear(R[:, :-1], R[:, -1], (-MAX_MASS_DEVIATIONS, MAX_MASS_DEVIATIONS), method="bvls").x
    )


def _off_mean(x: Array, w: Array) -> Array:
    """Subtract the weighted mean of every joint from its values, (n, runs, ...)."""
    share = w / w.sum(axis=1, keepdims=True)
    return np.asarray(x - np.einsum("jr...,jr->j...", x, share)[:, None])


def _scatter(x: Array) -> Array:
    """Estimate the standard deviation of values about zero by their median, (n,)."""
    return np.asarray(1.4826 * np.median(np.abs(x), axis=1))


def _rms(x: Array) -> float:
    return float(np.sqrt((x**2).mean()))
