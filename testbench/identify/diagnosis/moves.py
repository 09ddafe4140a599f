"""Moves in the middle of a series: of the targets on the tool, or of the tracker against the base.

A move is a step in the residuals that nothing else explains. From row k on a step b of up to six numbers is
added to the model, in tool axes for the targets and in base axes for the tracker. A nuisance model has all
that the arm may still lack: geometry, low periodic errors of the joints and compliances, each with its prior.
A step that these explain as well is none: the projector 1 - P of the score test removes them. A single wrong
row or pose is another hypothesis, with the same columns.

`identify` reports a move. `calibrate` makes the rows after it a series with its own mount or frame,
fits again and searches again.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.special import fdtrc

from testbench.data.dataset import Series, evenly_spaced, select_rows
from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.align import Noise, robust_whitening, without_unread_targets
from testbench.identify.absolute.evidence import (
    GEOMETRY,
    WIDE_PRIOR,
    ActiveUnknowns,
    ErrorScales,
    activate,
    active_prior,
    default_scales,
)
from testbench.identify.absolute.state import ArmState, unknowns_of
from testbench.identify.diagnosis.kinematics import Issue, Score, score_test, undo_one_by_one
from testbench.identify.metric import PriorScaling
from testbench.identify.rows import series_rows
from testbench.model.kinematics import JointErrors
from testbench.model.vjm import marker_motion

MAX_ORDER = 8  #: Highest order of periodic errors that the poses of a part of a series may share.
#: Prior size of other errors in the test of a step, over their usual size [1], which is unknown here.
NUISANCE_FACTOR = 3.0
MAX_NUMBERS = 3_000_000  #: Most numbers of the equations in memory at a time.
EQUATIONS_PER_POSE = 6
"""Most independent equations of a pose: its targets and loads share the errors of the model there."""
AMBIGUOUS_GAIN = 10.0
"""Difference of gains, over the variance, below which two steps explain the readings equally well."""


@dataclass(frozen=True)
class NuisanceModel:
    """Hold the linearised errors that the model may have in addition to a step, with their prior."""

    active: ActiveUnknowns  #: Unknowns that the model may lack, c of them.
    prior: Array  #: Prior precision of the unknowns, compliances in units of the prior, (c, c).
    state: ArmState  #: The arm that the equations are linearised about.
    noise: Noise  #: Noise of the readings about the arm.


def nuisance_model(
    state: ArmState, series: tuple[Series, ...], noise: Noise, elastic: PriorScaling, orders: int = MAX_ORDER
) -> NuisanceModel:
    """Build the linear model of everything but a step that may explain the residuals of series.

    It has geometry, periodic joint errors and compliances as unknowns, each with a loose prior.

    Args:
        state: The arm without joint errors.
        series: The readings.
        noise: Noise of the readings about the arm.
        elastic: Prior of all compliances that there may be.
        orders: Highest order of periodic joint errors, per turn [1].

    Returns:
        The unknowns with their prior precision, and the arm that they are linearised about.
    """
    errors = JointErrors(tuple(range(1, orders + 1)))
    state = replace(state, errors=errors, n=np.zeros((state.vjm.arm.n_joints, errors.size)))
    unknowns = unknowns_of(state.vjm, series, errors, elastic.structure)
    active, size = (
        activate(unknowns, GEOMETRY | {"harmonics"}, elastic),
        default_scales(unknowns, len(noise.factor)),
    )
    P, _ = active_prior(active, ErrorScales(NUISANCE_FACTOR * size.deviation, size.factor), WIDE_PRIOR)
    return NuisanceModel(active, P, state, noise)


def p_value(step: Issue) -> float:
    """Compute the probability of a step as clear as this one of `best_step` in readings without any.

    With z numbers of the step and f independent equations, it is P(F(z, f) > 2 nats / z), Fisher's F test.
    """
    z = len(step.size)
    return float(fdtrc(z, step.numbers["free"], 2 * (step.nats or 0.0) / z))


def best_step(linear: NuisanceModel, series: Series, steps: Ids) -> Issue:
    """Find the step of a series that explains most of the residuals.

    Args:
        linear: The linear model of everything but the step.
        series: The readings, in order of time.
        steps: First row after each step that is tried, ascending, (steps,).

    Returns:
        The step, named "target_moved" or "tracker_moved". Its size is translation and, if six numbers,
        rotation, (3 or 6,) [m, rad]. Its numbers are:

        - `place`: index of the first row after it;
        - `before`, `after`: identifiers of the rows on both sides;
        - `across`: whether both are of one pose;
        - `alike`: whether a move of the other, target or tracker, explains the readings as well;
        - `share`: fraction of the sum of squares that it explains [1];
        - `free`: independent equations left after the fit.
    """
    sums = _sums(linear, series, steps)
    return _greatest_step(_unexplained(linear, (series,), [sums]), series, sums, steps, turns=True)


def most_significant_step(
    linear: NuisanceModel, series: Sequence[Series], places: Sequence[Ids]
) -> Iterator[tuple[Series, Issue]]:
    """Find in every series the step that is least likely by chance, with or without a rotation.

    A series is skipped when a single wrong row or pose explains its readings as well.

    Args:
        linear: The linear model of everything but the steps.
        series: The readings, in order of time; all of them determine the arm.
        places: First row after each step that is tried, per series, ascending, (steps,).

    Yields:
        A series and its step, with numbers as in `best_step`.
    """
    sums = [_sums(linear, readings, np.arange(1, readings.rows)) for readings in series]
    rest = _unexplained(linear, series, sums)
    for readings, series_sums, steps in zip(series, sums, places, strict=True):
        if not len(steps):
            continue
        step = min(
            (_greatest_step(rest, readings, series_sums, steps, turns=t) for t in (False, True)), key=p_value
        )
        poses = np.unique(readings.pose, return_inverse=True)[1]
        together = np.zeros((poses.max() + 1, *series_sums.Z.shape[1:]))
        np.add.at(together, poses, series_sums.Z)
        alone = [t for Z in (series_sums.Z, together) for t in rest.score_moves(Z, turns=len(step.size) == 6)]
        if max(t.gain.max() for t in alone) < step.numbers["share"] * rest.before:
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

    def score_moves(self, Z: Array, *, turns: bool) -> tuple[Score, Score]:
        """Test whether the targets or the tracker moved, in a batch of rows.

        Args:
            Z: Whitened sums over each batch, (batch, z, c + 1 + z): products of the moves with A, with e and
                with themselves.
            turns: Whether the moves may turn.

        Returns:
            Scores of moved targets, and of a moved tracker.
        """
        c = len(self.e)
        half = solve_triangular(self.L, (Z[:, :, :c] / self.size).reshape(-1, c).T, lower=True)
        K = half.T.reshape(*Z.shape[:2], c)
        g, M = Z[:, :, c] - K @ self.e, Z[:, :, c + 1 :] - K @ K.swapaxes(1, 2)
        z = g.shape[1] - 6
        target, tracker = slice(z if turns else 3), slice(z, None if turns else z + 3)
        return score_test(g[:, target], M[:, target, target]), score_test(
            g[:, tracker], M[:, tracker, tracker]
        )


def _unexplained(linear: NuisanceModel, series: Sequence[Series], sums: Sequence[_Sums]) -> _Unexplained:
    """Factorise the precision of all possible errors, and project the residuals on the rest."""
    AA, c = np.sum([part.AA for part in sums], axis=0), len(linear.active.columns)
    H = AA[:c, :c] + linear.prior
    size = np.sqrt(np.diag(H))
    L = cholesky(H / size / size[:, None], lower=True)
    spent = c - float(np.trace(cho_solve((L, True), linear.prior / size / size[:, None])))
    e, count = solve_triangular(L, AA[:c, c] / size, lower=True), sum(part.count for part in sums)
    poses = sum(len(np.unique(part.pose)) for part in series)
    shared = max(1.0, count / (EQUATIONS_PER_POSE * poses))
    return _Unexplained(L, size, e, float(AA[c, c] - e @ e), max(count - spent, 1.0), shared)


def _greatest_step(rest: _Unexplained, series: Series, sums: _Sums, steps: Ids, *, turns: bool) -> Issue:
    """Find the step of greatest gain in a series, of the targets or of the tracker, as an issue."""
    behind = np.cumsum(sums.Z[:0:-1], axis=0)[::-1][np.searchsorted(sums.edges, steps)]
    # Score of a step at every place, of targets and of the tracker; the greatest is taken.
    target, tracker = rest.score_moves(behind, turns=turns)
    slipped = target.gain.max() > tracker.gain.max()
    score, other = (target, tracker) if slipped else (tracker, target)
    k = int(score.gain.argmax())
    gain, place = float(score.gain[k]), int(steps[k])
    s2 = max(rest.before - gain, 1e-300) / rest.count
    numbers = {
        "alike": bool(gain - other.gain[max(0, k - 2) : k + 3].max() < AMBIGUOUS_GAIN * s2),
        "share": gain / rest.before,
        "free": rest.count / rest.shared,
        "place": place,
        "before": int(series.row[place - 1]),
        "after": int(series.row[place]),
        "across": bool(series.pose[place - 1] == series.pose[place]),
    }
    kind = "target_moved" if slipped else "tracker_moved"
    return Issue(kind, (series.name, series.frame), score.b[k], numbers, gain / s2 / rest.shared / 2)


def _sums(linear: NuisanceModel, series: Series, steps: Ids) -> _Sums:
    """Sum the whitened equations of a series between the places of possible steps."""
    edges = np.r_[0, steps, series.rows]
    cells, AA = [], 0.0
    numbers = 3 * series.rows * (len(series.markers) + 1) * linear.active.unknowns.size
    batches = min(len(edges) - 1, 1 + numbers // MAX_NUMBERS)  # of cells that are in memory together
    for part in np.array_split(np.arange(len(edges) - 1), batches):
        A, Z = _equations(linear, select_rows(series, np.arange(edges[part[0]], edges[part[-1] + 1])))
        AA = AA + np.einsum("ar,br->ab", A, A, optimize=True)
        per_row = A.shape[1] // (edges[part[-1] + 1] - edges[part[0]])
        for a, b in zip(edges[part] - edges[part[0]], edges[part + 1] - edges[part[0]], strict=True):
            rows = slice(per_row * a, per_row * b)
            cells.append(Z[:, rows] @ np.vstack([A[:, rows], Z[:, rows]]).T)
    return _Sums(np.asarray(AA), np.array(cells), steps, 3 * int(series.seen.sum() + series.oriented.sum()))


def _equations(linear: NuisanceModel, series: Series) -> tuple[Array, Array]:
    """Whiten [A e], (c + 1, equations), and Z, (z, equations); equations are ordered by row."""
    active, rows = linear.active, series_rows(linear.active.unknowns, linear.state, series)
    W, pull = robust_whitening(series, linear.noise, linear.state.frame(series).rotation, rows[:, :, -1])
    W = W * np.sqrt(pull)[..., None, None]
    A = rows[:, :, np.r_[active.columns, -1]]
    Z = np.concatenate([move_columns(linear, series, rows, what) for what in ("target", "tracker")], axis=2)
    whitened = np.einsum("srxy,sycr->crsx", W, np.concatenate([A, Z], axis=2))
    if active.elastic is not None:
        e = slice(active.n_rigid, len(active.columns))
        whitened[e] = np.tensordot(active.elastic.L.T, whitened[e], 1)
    lines = whitened.reshape(len(whitened), -1)
    return lines[: A.shape[2]], lines[A.shape[2] :]


def move_columns(linear: NuisanceModel, series: Series, A: Array, what: str) -> Array:
    """Compute the columns of a rigid move of the tracker or of the targets.

    Args:
        linear: The linear model, whose unknowns name the columns.
        series: The readings.
        A: Columns of all unknowns, then the residuals, (s, 3, unknowns + 1, rows) [m, rad].
        what: "tracker" or "target".

    Returns:
        Columns of translation and rotation, (s, 3, 6, rows); of translation alone, (s, 3, 3, rows), for the
        mount of one target without orientation.
    """
    if what == "tracker":
        return A[:, :, linear.active.unknowns.columns(f"frame {series.frame}")]
    mount = A[:, :, linear.active.unknowns.columns(f"mount {series.target}")]
    points = linear.state.mount(series).points
    T = np.zeros((mount.shape[2], 6))
    T[: 3 * len(points)] = marker_motion(points)
    T[3 * len(points) :, 3:] = np.eye(3)[: max(0, len(T) - 3 * len(points))]
    return np.asarray(np.einsum("sxcr,cz->sxzr", mount, T[:, : 3 if len(T) == 3 else 6]))


def with_shift(linear: NuisanceModel, series: Series, step: Issue) -> Issue:
    """Add to a step the RMS distance by which it moves the targets.

    Args:
        linear: The linear model of everything but the step.
        series: The readings.
        step: The step.

    Returns:
        The step with that distance over all readings, RMS [m], as its number `shift`.
    """
    what = step.name.removesuffix("_moved")
    Z = move_columns(linear, series, series_rows(linear.active.unknowns, linear.state, series), what)
    d = np.einsum("sxcr,c->sxr", Z[:, :, : len(step.size)], step.size)[: len(series.markers)]
    shift = float(np.sqrt((d**2).sum() / max(1, series.seen.sum())))
    return replace(step, numbers={**step.numbers, "shift": shift})


MAX_TRIED_STEPS = 400  #: Steps that are tried at first.
MAX_THIN_ROWS = 1500  #: Rows that are looked at first.
MIN_POSES = 6  #: Poses before and behind a step that divides a series: fewer leave frame or mount open.
MIN_GAIN = 80.0
"""Sum of squares that such a step takes away at least, over the variance: sound simulated series reach 50,
series of a robot whose frame drifts by 10 um 80."""
MIN_SHARE = 0.05  #: Share of the sum of squares that it takes away at least: a robot's drift takes 1 %.
PART_SUFFIX = " from row "  #: Ends the name of a series, before the first row of its part.


def step_places(series: Series, min_poses: int) -> Ids:
    """List the rows at which a step is tried.

    Args:
        series: Readings in order of time.
        min_poses: Fewest different poses before, and after, each step.

    Returns:
        Index of the first row after each step, (steps,), ascending.
    """
    before, behind = _poses_so_far(series.pose), _poses_so_far(series.pose[::-1])[::-1]
    steps = np.flatnonzero(np.diff(series.row)) + 1  # rows of one identifier are of one moment
    return steps[(before[steps - 1] >= min_poses) & (behind[steps] >= min_poses)]


def _poses_so_far(pose: Ids) -> Ids:
    """Count the different poses up to and including every row, (rows,)."""
    first = np.zeros(len(pose), dtype=int)
    first[np.unique(pose, return_index=True)[1]] = 1
    return np.cumsum(first)


def _clear_step(state: ArmState, series: Series, noise: Noise, elastic: PriorScaling) -> Issue | None:
    """Find the greatest step in a series; None if no step is clear enough to divide it.

    The arm is without joint errors, and rows of the series, by their identifiers, are in order of time.
    """
    ordered = without_unread_targets(in_order_of_time(series))
    steps = step_places(ordered, MIN_POSES)
    linear = nuisance_model(state, (ordered,), noise, elastic)
    thin = evenly_spaced(ordered.rows, MAX_THIN_ROWS)
    tried = steps[evenly_spaced(len(steps), MAX_TRIED_STEPS)]
    place = np.unique(np.searchsorted(thin, tried))
    place = place[(place > 0) & (place < len(thin))]
    if not len(place) or not _is_sure(issue := best_step(linear, select_rows(ordered, thin), place)):
        return None
    if len(tried) < len(steps) or len(thin) < ordered.rows:
        middle = np.searchsorted(tried, thin[int(issue.numbers["place"])])
        low, high = tried[max(middle - 2, 0)], tried[min(middle + 2, len(tried) - 1)]
        issue = best_step(linear, ordered, np.union1d(tried, steps[(steps >= low) & (steps <= high)]))
    return with_shift(linear, ordered, issue) if _is_sure(issue) else None


def _is_sure(step: Issue) -> bool:
    return 2 * (step.nats or 0.0) > MIN_GAIN and step.numbers["share"] > MIN_SHARE


def in_order_of_time(series: Series) -> Series:
    """Sort the rows of a series by their identifiers, which are in order of time."""
    return select_rows(series, np.argsort(series.row, kind="stable"))


SeriesParts = tuple[Series, ...]
"""Series, in parts where something moved."""
FittedState = tuple[ArmState, Noise]


def divide_at_moves(
    series: SeriesParts, fitted: Callable[[SeriesParts], FittedState], elastic: PriorScaling
) -> tuple[list[Issue], SeriesParts, FittedState]:
    """Fit series, divide them where targets or tracker moved, and fit again until nothing moves.

    Args:
        series: The readings.
        fitted: Function that fits geometry and springs to series, without joint errors.
        elastic: Prior of all compliances that there may be.

    Returns:
        Issues of moves and of series that no longer share a mount or frame; the divided series; and
        their fit.

    Raises:
        BenchError: When the first fit fails.
    """

    def undo(parts: SeriesParts, now: FittedState) -> tuple[list[Issue], SeriesParts, FittedState] | None:
        """Fit the parts again, each with its own tracker or targets where they moved.

        Args:
            parts: The series as divided so far.
            now: Their fit, state and noise.

        Returns:
            New issues, the divided series and their fit; None if nothing moved.
        """
        steps = [
            None if part.distance is not None else _clear_step(now[0], part, now[1], elastic)
            for part in parts
        ]
        issues = [step for step in steps if step]
        if not issues:
            return None
        apart, shared = _divide(parts, steps)
        try:
            return issues + shared, apart, fitted(apart)
        except BenchError:
            return [*issues, Issue("not_parted", tuple(step.where[0] for step in issues))], parts, now

    return undo_one_by_one(series, fitted(series), undo)


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
    return part.name.partition(PART_SUFFIX)[0]


def _moved_name(series: Series, step: Issue) -> str:
    """Return the name of the frame or mount that moved in a step."""
    return series.target if step.name == "target_moved" else series.frame


def _rename_moved(series: Series, step: Issue, name: str) -> Series:
    """Rename the frame or mount that moved in a step."""
    if step.name == "target_moved":
        return replace(series, target=name)
    return replace(series, frame=name)


def _halves(series: Series, step: Issue | None) -> SeriesParts:
    """Divide a series at a step; without a step it stays whole."""
    if step is None:
        return (series,)
    ordered, words = in_order_of_time(series), f"{PART_SUFFIX}{step.numbers['after']}"
    behind = np.arange(series.rows) >= step.numbers["place"]
    second = _rename_moved(select_rows(ordered, behind), step, _moved_name(series, step) + words)
    return select_rows(ordered, ~behind), replace(second, name=series.name + words)
