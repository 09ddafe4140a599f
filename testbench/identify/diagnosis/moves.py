"""Moves of the targets on the tool, or of the tracker against the base, in the middle of a series.

A move is a step in the residuals that nothing else explains. From row k on, a rigid motion b of three or six
numbers is added to the model, in tool axes for the targets and in base axes for the tracker. A nuisance model
holds all other errors that the model may lack: geometry, periodic joint errors of low order and compliances,
each with its prior. The projector 1 - P of the score test removes what these explain. A single wrong row or
pose is another hypothesis, with the same columns.

`identify` reports a move. `calibrate` also divides the series there: the rows after it get a mount or frame
of their own, and the search is repeated.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.special import fdtrc

from testbench.data.dataset import Series, evenly_spaced, select_rows
from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.align import Noise, robust_whitening, unknowns_of, without_unread_targets
from testbench.identify.absolute.evidence import (
    GEOMETRY_ERROR_KINDS,
    WIDE_PRIOR,
    ActiveUnknowns,
    ErrorScales,
    activate_unknowns,
    default_error_scales,
    prior_precision,
)
from testbench.identify.absolute.state import ArmState, with_error_terms
from testbench.identify.diagnosis.kinematics import Issue, ScoreTest, correct_one_by_one, score_test
from testbench.identify.equations import series_equations
from testbench.identify.prior import PriorScaling
from testbench.model.kinematics import JointErrorTerms
from testbench.model.vjm import rigid_motion_matrix

MAX_PERIODIC_ORDER = 8  #: Highest order of periodic joint errors in the nuisance model.
#: Prior deviation of the other errors in the test of a step, over their usual size [1].
NUISANCE_SCALE_FACTOR = 3.0
MAX_NUMBERS_IN_MEMORY = 3_000_000  #: Most numbers of the equations that are in memory together.
MAX_EQUATIONS_PER_POSE = 6
"""Most independent equations of a pose: its targets and loads share the model's errors in this pose."""
MAX_AMBIGUOUS_CHI2_DIFFERENCE = 10.0
"""Difference of chi squared below which moves of targets and of the tracker explain readings equally well."""


@dataclass(frozen=True)
class NuisanceModel:
    """Hold a linear model of all errors, with their prior, that may explain residuals instead of a move."""

    active_unknowns: ActiveUnknowns  #: The unknowns, c of them.
    prior_precision: Array  #: Prior precision of the unknowns, compliances in units of the prior, (c, c).
    state: ArmState  #: The arm at which the equations are linearised.
    noise: Noise  #: Noise of the readings about this arm.


def nuisance_model(
    state: ArmState,
    series: tuple[Series, ...],
    noise: Noise,
    compliance_prior: PriorScaling,
    max_order: int = MAX_PERIODIC_ORDER,
) -> NuisanceModel:
    """Build the linear model of all errors other than a step that may explain the residuals of series.

    Its unknowns are geometry, periodic joint errors and compliances, each with a wide prior.

    Args:
        state: The arm without joint errors.
        series: The readings.
        noise: Noise of the readings about the arm.
        compliance_prior: Prior of all compliances of the arm.
        max_order: Highest order of periodic joint errors, per turn [1].

    Returns:
        The unknowns with their prior precision, and the arm at which they are linearised.
    """
    errors = JointErrorTerms(tuple(range(1, max_order + 1)))
    state = with_error_terms(state, errors)
    unknowns = unknowns_of(state.vjm, series, errors, compliance_prior.structure)
    active, size = (
        activate_unknowns(unknowns, GEOMETRY_ERROR_KINDS | {"harmonics"}, compliance_prior),
        default_error_scales(unknowns, len(noise.factor)),
    )
    P, _ = prior_precision(
        active, ErrorScales(NUISANCE_SCALE_FACTOR * size.deviation, size.noise_factor), WIDE_PRIOR
    )
    return NuisanceModel(active, P, state, noise)


def p_value(step: Issue) -> float:
    """Compute the probability that readings without a step show by chance a step at least as clear as this.

    With z numbers of the step, f independent equations and the log-likelihood gain L of the step, it is
    P(F(z, f) > 2 L / z) by Fisher's F test.
    """
    z = len(step.size)
    return float(fdtrc(z, step.details["free"], 2 * (step.log_likelihood_gain or 0.0) / z))


def best_step(nuisance: NuisanceModel, series: Series, candidate_steps: Ids) -> Issue:
    """Find the move of targets or tracker in a series that explains most of the residuals.

    Args:
        nuisance: The linear model of all other errors.
        series: The readings, in order of time.
        candidate_steps: Index of the first row after each candidate step, ascending, (steps,).

    Returns:
        The step, named "target_moved" or "tracker_moved". Its size is translation and, if six numbers,
        rotation, (3 or 6,) [m, rad]. Its details are:

        - `place`: index of the first row after the step;
        - `before`, `after`: identifiers of the rows on both sides;
        - `across`: whether both rows are of one pose;
        - `alike`: whether a move of the other kind, target or tracker, explains the readings as well;
        - `share`: fraction of the sum of squares that the step explains [1];
        - `free`: number of independent equations less the fitted unknowns.
    """
    sums = _sums(nuisance, series, candidate_steps)
    return _greatest_step(
        _unexplained(nuisance, (series,), [sums]), series, sums, candidate_steps, with_rotation=True
    )


def most_significant_steps(
    nuisance: NuisanceModel, series: Sequence[Series], candidate_steps: Sequence[Ids]
) -> Iterator[tuple[Series, Issue]]:
    """Find the step with the smallest p-value in every series, with or without a rotation.

    A series is skipped when a single wrong row or pose explains its readings as well.

    Args:
        nuisance: The linear model of all errors other than steps.
        series: The readings, in order of time; all of them determine the arm.
        candidate_steps: Index of the first row after each candidate step, ascending, (steps,) per series.

    Yields:
        A series and its step, with details as in `best_step`.
    """
    sums = [_sums(nuisance, readings, np.arange(1, readings.n_rows)) for readings in series]
    rest = _unexplained(nuisance, series, sums)
    for readings, series_sums, steps in zip(series, sums, candidate_steps, strict=True):
        if not len(steps):
            continue
        found = (
            _greatest_step(rest, readings, series_sums, steps, with_rotation=rotated)
            for rotated in (False, True)
        )
        step = min(found, key=p_value)
        poses = np.unique(readings.pose_id, return_inverse=True)[1]
        together = np.zeros((poses.max() + 1, *series_sums.Z.shape[1:]))
        np.add.at(together, poses, series_sums.Z)
        # Single rows, and single poses.
        rotated = len(step.size) == 6
        alone = [
            score for Z in (series_sums.Z, together) for score in rest.score_moves(Z, with_rotation=rotated)
        ]
        if max(score.chi2_decrease.max() for score in alone) < step.details["share"] * rest.before:
            yield readings, step


@dataclass(frozen=True)
class _Sums:
    """Hold sums over whitened rows: columns A of the nuisance model, Z of both moves, and residuals e."""

    AA: Array  #: Over all rows, (c + 1, c + 1), e last.
    Z: Array  #: Over the rows of every cell between two edges, (cells, z, c + 1 + z): Z A, Z e, Z Z.
    edges: Ids  #: First rows of all cells but the first.
    count: int  #: Number of equations.


@dataclass(frozen=True)
class _Unexplained:
    """Project on the part of the residuals that no other unknown explains, 1 - P."""

    L: Array  #: Root of the precision of the possible errors, scaled to unit diagonal, (c, c).
    size: Array  #: Roots of its diagonal, (c,).
    e: Array  #: Part of the residuals that the possible errors explain, (c,).
    before: float  #: Sum of squares of the rest.
    count: float  #: Number of equations less the fitted unknowns.
    shared: float  #: Number of equations per independent one.

    def score_moves(self, Z: Array, *, with_rotation: bool) -> tuple[ScoreTest, ScoreTest]:
        """Test by the score test whether the targets or the tracker moved, in several sets of rows.

        Args:
            Z: Whitened sums over each set of rows, (sets, z, c + 1 + z): products of the columns of z moves
                with those of the c other unknowns, with the residuals, and with themselves.
            with_rotation: Whether the moves have a rotation; else they are translations.

        Returns:
            Scores of moved targets, and of a moved tracker, one per set.
        """
        c = len(self.e)
        half = solve_triangular(self.L, (Z[:, :, :c] / self.size).reshape(-1, c).T, lower=True)
        K = half.T.reshape(*Z.shape[:2], c)
        g, M = Z[:, :, c] - K @ self.e, Z[:, :, c + 1 :] - K @ K.swapaxes(1, 2)
        z = g.shape[1] - 6
        target, tracker = slice(z if with_rotation else 3), slice(z, None if with_rotation else z + 3)
        return score_test(g[:, target], M[:, target, target]), score_test(
            g[:, tracker], M[:, tracker, tracker]
        )


def _unexplained(nuisance: NuisanceModel, series: Sequence[Series], sums: Sequence[_Sums]) -> _Unexplained:
    """Factorise the precision of all possible errors, and project the residuals on the rest."""
    AA, c = np.sum([part.AA for part in sums], axis=0), len(nuisance.active_unknowns.columns)
    H = AA[:c, :c] + nuisance.prior_precision
    size = np.sqrt(np.diag(H))
    L = cholesky(H / size / size[:, None], lower=True)
    spent = c - float(np.trace(cho_solve((L, True), nuisance.prior_precision / size / size[:, None])))
    e, count = solve_triangular(L, AA[:c, c] / size, lower=True), sum(part.count for part in sums)
    poses = sum(len(np.unique(part.pose_id)) for part in series)
    shared = max(1.0, count / (MAX_EQUATIONS_PER_POSE * poses))
    return _Unexplained(L, size, e, float(AA[c, c] - e @ e), max(count - spent, 1.0), shared)


def _greatest_step(
    rest: _Unexplained, series: Series, sums: _Sums, steps: Ids, *, with_rotation: bool
) -> Issue:
    """Find the step that lowers chi squared most in a series, of the targets or the tracker, as an issue."""
    behind = np.cumsum(sums.Z[:0:-1], axis=0)[::-1][np.searchsorted(sums.edges, steps)]
    # Score of a step at every place, of targets and of the tracker; the greatest is taken.
    target, tracker = rest.score_moves(behind, with_rotation=with_rotation)
    slipped = target.chi2_decrease.max() > tracker.chi2_decrease.max()
    score, other = (target, tracker) if slipped else (tracker, target)
    k = int(score.chi2_decrease.argmax())
    decrease, place = float(score.chi2_decrease[k]), int(steps[k])
    rival = other.chi2_decrease[max(0, k - 2) : k + 3].max()
    # The variance of an equation, and the gain for the number of independent ones.
    s2 = max(rest.before - decrease, 1e-300) / rest.count
    gain = decrease / s2 / rest.shared / 2
    details = {
        "alike": bool(decrease - rival < MAX_AMBIGUOUS_CHI2_DIFFERENCE * s2),
        "share": decrease / rest.before,
        "free": rest.count / rest.shared,
        "place": place,
        "before": int(series.row_id[place - 1]),
        "after": int(series.row_id[place]),
        "across": bool(series.pose_id[place - 1] == series.pose_id[place]),
    }
    kind = "target_moved" if slipped else "tracker_moved"
    return Issue(kind, (series.name, series.frame), score.expected_size[k], details, gain)


def _sums(nuisance: NuisanceModel, series: Series, steps: Ids) -> _Sums:
    """Sum the whitened equations of a series between the places of possible steps."""
    edges = np.r_[0, steps, series.n_rows]
    cells, AA = [], 0.0
    numbers = 3 * series.n_rows * (len(series.markers) + 1) * nuisance.active_unknowns.unknowns.size
    batches = min(
        len(edges) - 1, 1 + numbers // MAX_NUMBERS_IN_MEMORY
    )  # of cells that are in memory together
    for part in np.array_split(np.arange(len(edges) - 1), batches):
        A, Z = _equations(nuisance, select_rows(series, np.arange(edges[part[0]], edges[part[-1] + 1])))
        AA = AA + np.einsum("ar,br->ab", A, A, optimize=True)
        per_row = A.shape[1] // (edges[part[-1] + 1] - edges[part[0]])
        for a, b in zip(edges[part] - edges[part[0]], edges[part + 1] - edges[part[0]], strict=True):
            rows = slice(per_row * a, per_row * b)
            cells.append(Z[:, rows] @ np.vstack([A[:, rows], Z[:, rows]]).T)
    return _Sums(
        np.asarray(AA), np.array(cells), steps, 3 * int(series.is_measured.sum() + series.is_oriented.sum())
    )


def _equations(nuisance: NuisanceModel, series: Series) -> tuple[Array, Array]:
    """Whiten [A e], (c + 1, equations), and Z, (z, equations); equations are ordered by row."""
    active, rows = (
        nuisance.active_unknowns,
        series_equations(nuisance.active_unknowns.unknowns, nuisance.state, series),
    )
    rotation = nuisance.state.frame(series).rotation
    W, weights = robust_whitening(series, nuisance.noise, rotation, rows[:, :, -1])
    W = W * np.sqrt(weights)[..., None, None]
    A = rows[:, :, np.r_[active.columns, -1]]
    moves = [move_columns(nuisance, series, rows, moved) for moved in ("target", "tracker")]
    Z = np.concatenate(moves, axis=2)
    whitened = np.einsum("srxy,sycr->crsx", W, np.concatenate([A, Z], axis=2))
    if active.compliance_prior is not None:
        e = slice(active.n_rigid, len(active.columns))
        whitened[e] = np.tensordot(active.compliance_prior.L.T, whitened[e], 1)
    lines = whitened.reshape(len(whitened), -1)
    return lines[: A.shape[2]], lines[A.shape[2] :]


def move_columns(nuisance: NuisanceModel, series: Series, A: Array, moved_object: str) -> Array:
    """Compute the columns of a rigid move of the tracker or of the targets in the equations of a series.

    Args:
        nuisance: The linear model, whose unknowns name the columns.
        series: The readings.
        A: Columns of all unknowns, then the residuals, (s, 3, unknowns + 1, rows) [m, rad].
        moved_object: "tracker" or "target".

    Returns:
        Columns of translation and rotation, (s, 3, 6, rows); of translation alone, (s, 3, 3, rows), for the
        mount of one target without orientation.
    """
    if moved_object == "tracker":
        return A[:, :, nuisance.active_unknowns.unknowns.columns(f"frame {series.frame}")]
    mount = A[:, :, nuisance.active_unknowns.unknowns.columns(f"mount {series.mount}")]
    points = nuisance.state.mount(series).points
    T = np.zeros((mount.shape[2], 6))
    T[: 3 * len(points)] = rigid_motion_matrix(points)
    T[3 * len(points) :, 3:] = np.eye(3)[: max(0, len(T) - 3 * len(points))]
    return np.asarray(np.einsum("sxcr,cz->sxzr", mount, T[:, : 3 if len(T) == 3 else 6]))


def with_rms_shift_of_targets(nuisance: NuisanceModel, series: Series, step: Issue) -> Issue:
    """Complete the issue of a step: note in its details how far the step moves the targets.

    Args:
        nuisance: The linear model of all errors other than the step.
        series: The readings.
        step: The issue of the step.

    Returns:
        The issue; its detail `shift` is the RMS distance over all readings [m].
    """
    moved = step.name.removesuffix("_moved")
    Z = move_columns(
        nuisance, series, series_equations(nuisance.active_unknowns.unknowns, nuisance.state, series), moved
    )
    d = np.einsum("sxcr,c->sxr", Z[:, :, : len(step.size)], step.size)[: len(series.markers)]
    shift = float(np.sqrt((d**2).sum() / max(1, series.is_measured.sum())))
    return replace(step, details={**step.details, "shift": shift})


MAX_TRIED_STEPS = 400  #: Most candidate steps of the first search, evenly spaced.
MAX_SCREENED_ROWS = 1500  #: Most rows of the first search, evenly spaced.
#: Fewest poses before and after a step that divides a series; fewer do not determine frame or mount.
MIN_POSES_OF_PART = 6
MIN_STEP_CHI2 = 80.0
"""Least decrease of chi squared by a step that divides a series. Sound simulated series reach 50, series of a
robot whose frame drifts by 10 um reach 80."""
#: Least share of the sum of squares that such a step explains [1]; the drift of a robot explains 1 %.
MIN_EXPLAINED_VARIANCE = 0.05
SERIES_PART_SUFFIX = " from row "  #: Text between the name of a divided series and the first row of its part.
SeriesParts = tuple[Series, ...]
"""Series, divided where a target or the tracker moved."""
FittedState = tuple[ArmState, Noise]
"""A fitted arm, and the noise of the readings about it."""
FittedParts = tuple[SeriesParts, FittedState]
"""Divided series, and their fit."""


def candidate_rows(series: Series, min_poses: int) -> Ids:
    """List the rows of a series before which a move of targets or tracker is possible.

    Args:
        series: Readings in order of time.
        min_poses: Fewest different poses before, and after, each step.

    Returns:
        Index of the first row after each candidate step, ascending, (steps,).
    """
    before, behind = _poses_so_far(series.pose_id), _poses_so_far(series.pose_id[::-1])[::-1]
    steps = np.flatnonzero(np.diff(series.row_id)) + 1  # rows of one identifier are of one moment
    return steps[(before[steps - 1] >= min_poses) & (behind[steps] >= min_poses)]


def _poses_so_far(pose: Ids) -> Ids:
    """Count the different poses up to and including every row, (rows,)."""
    first = np.zeros(len(pose), dtype=int)
    first[np.unique(pose, return_index=True)[1]] = 1
    return np.cumsum(first)


def _clear_step(series: Series, fitted: FittedState, compliance_prior: PriorScaling) -> Issue | None:
    """Find the greatest step in a series; None if no step is clear enough to divide it.

    The arm is without joint errors, and rows of the series, by their identifiers, are in order of time.
    """
    ordered = without_unread_targets(sort_by_time(series))
    steps = candidate_rows(ordered, MIN_POSES_OF_PART)
    nuisance = nuisance_model(fitted[0], (ordered,), fitted[1], compliance_prior)
    thin = evenly_spaced(ordered.n_rows, MAX_SCREENED_ROWS)
    tried = steps[evenly_spaced(len(steps), MAX_TRIED_STEPS)]
    place = np.unique(np.searchsorted(thin, tried))
    place = place[(place > 0) & (place < len(thin))]
    if not len(place) or not _is_sure(issue := best_step(nuisance, select_rows(ordered, thin), place)):
        return None
    if len(tried) < len(steps) or len(thin) < ordered.n_rows:
        middle = np.searchsorted(tried, thin[int(issue.details["place"])])
        low, high = tried[max(middle - 2, 0)], tried[min(middle + 2, len(tried) - 1)]
        issue = best_step(nuisance, ordered, np.union1d(tried, steps[(steps >= low) & (steps <= high)]))
    return with_rms_shift_of_targets(nuisance, ordered, issue) if _is_sure(issue) else None


def _is_sure(step: Issue) -> bool:
    return (
        2 * (step.log_likelihood_gain or 0.0) > MIN_STEP_CHI2
        and step.details["share"] > MIN_EXPLAINED_VARIANCE
    )


def sort_by_time(series: Series) -> Series:
    """Return a series with its rows sorted by their identifiers, which are in order of time."""
    return select_rows(series, np.argsort(series.row_id, kind="stable"))


def divide_at_moves(
    series: SeriesParts, fit_series: Callable[[SeriesParts], FittedState], compliance_prior: PriorScaling
) -> tuple[list[Issue], FittedParts]:
    """Fit series, divide them where targets or tracker moved, and repeat until no more moves are found.

    Args:
        series: The readings.
        fit_series: Function that fits geometry and joint compliances to series.
        compliance_prior: Prior of all compliances of the arm.

    Returns:
        Issues of moves and of series that no longer share a mount or frame; and the divided series with
        their fit.

    Raises:
        BenchError: When the first fit fails.
    """

    def divide_at_clear_steps(fitted_parts: FittedParts) -> tuple[list[Issue], FittedParts] | None:
        """Divide series where the tracker or the targets clearly moved, and fit them again.

        Args:
            fitted_parts: The series as divided so far, and their fit.

        Returns:
            New issues, the divided series and their fit; None if nothing moved.
        """
        parts, fitted = fitted_parts
        steps = [
            None if part.distance is not None else _clear_step(part, fitted, compliance_prior)
            for part in parts
        ]
        issues = [step for step in steps if step]
        if not issues:
            return None
        apart, shared = _divide(parts, steps)
        try:
            return issues + shared, (apart, fit_series(apart))
        except BenchError:
            return [*issues, Issue("not_parted", tuple(step.where[0] for step in issues))], fitted_parts

    return correct_one_by_one((series, fit_series(series)), divide_at_clear_steps)


def _divide(parts: SeriesParts, steps: Sequence[Issue | None]) -> tuple[SeriesParts, list[Issue]]:
    """Divide each series at its step; the moved frame or mount gets a new name after the step.

    A mount or frame that moved in one series is no longer shared with another, because the part that would
    share it is unknown. Issues report this.
    """
    divided = [part for readings, step in zip(parts, steps, strict=True) for part in _halves(readings, step)]
    unshared: dict[tuple[str, str], Issue] = {}
    for series, step in zip(parts, steps, strict=True):
        if step is None:
            continue
        name, whole = _moved_name(series, step), _undivided_name(series)
        for k, readings in enumerate(divided):
            if _moved_name(readings, step) == name and _undivided_name(readings) != whole:
                divided[k] = _rename_moved(readings, step, f"{name} of {_undivided_name(readings)}")
                where = _undivided_name(readings), "mount" if step.name == "target_moved" else "frame"
                unshared[where] = Issue("unshared", where)
    return tuple(divided), list(unshared.values())


def _undivided_name(part: Series) -> str:
    """Return the name of the series that a part belongs to."""
    return part.name.partition(SERIES_PART_SUFFIX)[0]


def _moved_name(series: Series, step: Issue) -> str:
    """Return the name of the frame or mount that moved in a step."""
    return series.mount if step.name == "target_moved" else series.frame


def _rename_moved(series: Series, step: Issue, name: str) -> Series:
    """Rename the frame or mount that moved in a step."""
    if step.name == "target_moved":
        return replace(series, mount=name)
    return replace(series, frame=name)


def _halves(series: Series, step: Issue | None) -> SeriesParts:
    """Divide a series at a step; without a step it stays whole."""
    if step is None:
        return (series,)
    ordered, words = sort_by_time(series), f"{SERIES_PART_SUFFIX}{step.details['after']}"
    behind = np.arange(series.n_rows) >= step.details["place"]
    second = _rename_moved(select_rows(ordered, behind), step, _moved_name(series, step) + words)
    return select_rows(ordered, ~behind), replace(second, name=series.name + words)
