"""Calibration by absolute readings: Gauss-Newton outside, the cone inside.

Geometry and joint springs first, which tells wild readings; then all errors that there might be, which tells
the scatter; then again, where cross-validation chooses among them. Compliances are absolute in each: what is
left of the equations when all other unknowns are eliminated is a `Regression`, which least squares and GCO
solve as any other.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from testbench.data.series import Series
from testbench.errors import Array, BenchError
from testbench.identify import hierarchy
from testbench.identify.absolute.align import aligned
from testbench.identify.absolute.changes import settled
from testbench.identify.absolute.choose import GEOMETRY, Candidate, Chosen, blocks_of, choose
from testbench.identify.absolute.evidence import LOOSE, Choice, Learnt, choice, learn, squares, usual
from testbench.identify.absolute.noise import KINDS, Noise, lengths, plan_of, pull, roots, spread
from testbench.identify.absolute.reduced import Point, Reduced, Weighting, reduce
from testbench.identify.absolute.rows import left_over
from testbench.identify.absolute.state import Frame, Mount, State, nominal, tell, torque_scale
from testbench.identify.absolute.unknowns import Unknowns, unknowns_of
from testbench.identify.estimate import Constraint, Estimate
from testbench.identify.metric import Belief, Metric, metric, precision_root, rescaled
from testbench.identify.prior import Prior, Strength
from testbench.identify.regression import Regression, Term, regression_of
from testbench.identify.regularised import fit_reduced
from testbench.model.joint_errors import JointErrors
from testbench.model.structure import Ids, Structure, all153, joints_only
from testbench.model.vjm import Vjm
from testbench.model.weights import Weights, read_weights

ORDERS = 80  #: Periodic errors that are tried, times a turn.
OPEN = 1e-10  #: Share of a column that no other has, below which it is not seen at all.
MANY = 0.6  #: Share of the readings that periodic errors may have as unknowns at most.

NAMES = ("joint springs", "joint errors", "links", "ratio", "play", "stiffening")
"""Errors beside those of geometry, in the order in which they are tried."""


@dataclass(frozen=True)
class Options:
    """What a calibration tries, and how."""

    constraint: Constraint = "psd"  #: "psd" for GCO, "none" for least squares.
    orders: int = ORDERS  #: Highest order of periodic errors.
    without: frozenset[str] = frozenset()  #: Names of errors that are not tried.
    only: frozenset[str] | None = None  #: Names of errors that are on, untried; None to choose.
    #: How firmly expected compliances are believed; None to learn it from the readings.
    strength: Strength | None = None

    def __post_init__(self) -> None:
        """Refuse names that no errors have, by BenchError."""
        unknown = (self.without | (self.only or frozenset())) - set(NAMES)
        if unknown:
            raise BenchError(f"no errors called {', '.join(sorted(unknown))}; there are {', '.join(NAMES)}")


@dataclass(frozen=True)
class Calibration:
    """A calibrated arm, and what there is to say of it."""

    state: State  #: The arm.
    own: Choice  #: Its unknowns.
    #: Upper triangular root of the posterior's precision, R^T R, compliances in the metric, (c, c).
    root: Array
    noise: Noise  #: How far readings scatter about it.
    chosen: Chosen  #: What was tried and kept.
    estimate: Estimate | None  #: Compliances, with a certificate; None of a rigid arm.
    pulls: tuple[Array, ...]  #: Of every series, how much each reading counts, (s, rows) [1].
    step: float  #: How far the last linearisation moved targets, root mean square [m].
    series: tuple[Series, ...]  #: The readings, in parts where a target or a tracker moved.
    notes: tuple[str, ...]  #: What moved.


@dataclass(frozen=True)
class Gathered:
    """Readings boiled down once, to be explained by any of the errors that there might be."""

    vjm: Vjm  #: The arm's nominal kinematics.
    series: tuple[Series, ...]  #: What was read, in parts where something moved.
    prior: Prior  #: Expected compliances.
    unknowns: Unknowns  #: All that there might be.
    state: State  #: Where the equations are linear: with joint springs and periodic errors.
    noise: Noise  #: How far readings scatter about it.
    reduced: Reduced  #: The equations, in blocks of joint space.
    notes: tuple[str, ...]  #: What moved in mid-series.


def calibrate(
    vjm: Vjm,
    series: Sequence[Series],
    prior: Prior,
    options: Options | None = None,
    weights: Weights | None = None,
) -> Calibration:
    """Calibrate an arm.

    Args:
        vjm: Its nominal kinematics.
        series: Absolute readings, all of it.
        prior: Expected compliances.
        options: What to try.
        weights: What its links weigh; None for what rigid.xml says.

    Raises:
        BenchError: When a series does not fit the arm, or leaves its frame or target open.
    """
    options = options or Options()
    return explain(gather(vjm, series, prior, options, weights), options)


def gather(
    vjm: Vjm, series: Sequence[Series], prior: Prior, options: Options, weights: Weights | None = None
) -> Gathered:
    """The part of `calibrate` that is the same whatever errors are on; of links, if they may be."""
    series = tuple(series)
    weights = weights or read_weights(vjm.arm)
    bare = nominal(vjm, weights, torque_scale(vjm, weights, series))
    joints = metric(prior, vjm, joints_only(vjm.arm))

    def fitted(some: tuple[Series, ...]) -> tuple[State, Noise]:
        return _first_fit(bare, some, joints)

    start = settled(series, fitted, metric(prior, vjm, all153(vjm.arm)))
    series, state, seen = start.series, start.state, _judged(start.state, start.series, start.noise)
    errors = JointErrors(_orders(series, options), ratio=True, play=True, stiffening=True)
    unknowns = unknowns_of(vjm, series, errors, _most(vjm, options))
    state = replace(state, errors=errors, n=np.zeros((vjm.arm.n_joints, errors.size)))
    own = choice(unknowns, GEOMETRY | {"harmonics"}, joints)
    state, share = _stepped(own, series, state, seen)
    seen = _seen(state, series, share)
    blocks = _whole(series) if options.only is not None else blocks_of(series)
    weighting = [Weighting(p, b) for p, b in zip(seen.pulls, blocks, strict=True)]
    reduced = reduce(Point(unknowns, state, seen.noise), series, weighting)
    return Gathered(vjm, series, prior, unknowns, state, seen.noise, reduced, start.notes)


def explain(found: Gathered, options: Options) -> Calibration:
    """What explains the readings best, of the errors that are to be on or tried.

    Raises:
        BenchError: When the readings leave a frame or target open, or were gathered without the links.
    """
    series, reduced, vjm = found.series, found.reduced, found.vjm
    candidates = _candidates(vjm, found.prior, options)
    chosen = _choose(found.unknowns, reduced, candidates, options, _unit(series, found.noise))
    solved = _solve(chosen.own, reduced, chosen.learnt, options)
    after = moved(found.state, chosen.own, solved.x)
    factor = found.noise.factor.copy()
    factor[list(reduced.kinds)] = chosen.learnt.factor
    noise = replace(found.noise, factor=factor)
    step = _distance(found.state, after, series)
    pulls = tuple(pulls_of(after, one, noise) for one in series)
    return Calibration(
        state=after,
        own=chosen.own,
        root=solved.root,
        noise=noise,
        chosen=chosen,
        estimate=solved.estimate,
        pulls=pulls,
        step=step,
        series=series,
        notes=found.notes,
    )


def _first_fit(bare: State, series: tuple[Series, ...], joints: Metric) -> tuple[State, Noise]:
    """Geometry and joint springs from where the closed forms have frames and mounts."""
    state = aligned(bare, series)
    first = unknowns_of(bare.vjm, series, JointErrors(), joints.structure)
    own, seen = choice(first, GEOMETRY, joints), _seen(state, series, 1.0)
    for _ in range(2):
        state, share = _stepped(own, series, state, seen)
        seen = _seen(state, series, share)
    return state, seen.noise


def _orders(series: Sequence[Series], options: Options) -> tuple[int, ...]:
    """Orders of periodic errors that so many readings may tell."""
    readings = sum(3 * int(one.seen.sum() + one.turned.sum()) for one in series)
    joints = series[0].q.shape[1]
    most = int(MANY * readings / (2 * joints))
    return tuple(range(1, max(1, min(options.orders, most)) + 1))


def _most(vjm: Vjm, options: Options) -> Structure:
    rigid = "links" in options.without or (options.only is not None and "links" not in options.only)
    return joints_only(vjm.arm) if rigid else all153(vjm.arm)


def _candidates(vjm: Vjm, prior: Prior, options: Options) -> list[Candidate]:
    """What may be tried, in order; links bring their own joints with them."""
    every = {
        "joint springs": Candidate(
            "joint springs", elastic=metric(prior, vjm, joints_only(vjm.arm)), sure=True
        ),
        "joint errors": Candidate("joint errors", frozenset({"harmonics"})),
        "links": Candidate("links", elastic=metric(prior, vjm, all153(vjm.arm))),
    } | {name: Candidate(name, frozenset({name})) for name in NAMES[3:]}
    return [every[name] for name in NAMES if name not in options.without]


def _choose(
    unknowns: Unknowns, reduced: Reduced, candidates: list[Candidate], options: Options, unit: float
) -> Chosen:
    if options.only is None:
        return choose(unknowns, reduced, candidates, unit)
    on = [one for one in candidates if one.name in options.only]
    kinds = GEOMETRY.union(*(one.kinds for one in on))
    elastic = [one.elastic for one in on if one.elastic is not None]
    own = choice(unknowns, kinds, elastic[-1] if elastic else None)
    learnt = learn(own, squares(own, reduced.gram), reduced.counts, usual(unknowns, len(reduced.kinds)))
    return Chosen(own, learnt, kinds, ())


def _whole(series: Sequence[Series]) -> list[Ids]:
    """Every series as one block."""
    return [np.zeros(one.rows, dtype=int) for one in series]


@dataclass(frozen=True)
class _Seen:
    """How readings scatter about a state."""

    noise: Noise
    pulls: tuple[Array, ...]  #: How much each counts, of every series (s, rows).


def _seen(state: State, series: tuple[Series, ...], share: float) -> _Seen:
    return _judged(state, series, scatter(state, series, share))


def _judged(state: State, series: tuple[Series, ...], noise: Noise) -> _Seen:
    return _Seen(noise, tuple(pulls_of(state, one, noise) for one in series))


def _stepped(own: Choice, series: tuple[Series, ...], state: State, seen: _Seen) -> tuple[State, float]:
    """One Gauss-Newton step, and the share of equations that no unknown spends."""
    weighting = [Weighting(p, b) for p, b in zip(seen.pulls, _whole(series), strict=True)]
    reduced = reduce(Point(own.unknowns, state, seen.noise), series, weighting)
    S, counts = squares(own, reduced.gram), reduced.counts
    solved = _solve(own, reduced, learn(own, S, counts, usual(own.unknowns, len(counts))), Options())
    return moved(state, own, solved.x), max(0.1, 1 - solved.spent / counts.sum())


@dataclass(frozen=True)
class _Solved:
    x: Array  #: Of the choice, compliances in m/N and so on, (c,).
    root: Array  #: Of the posterior's precision, compliances in the metric, (c, c).
    estimate: Estimate | None
    spent: float  #: Equations that the unknowns spend.


def _solve(own: Choice, reduced: Reduced, learnt: Learnt, options: Options) -> _Solved:
    """The most likely unknowns by QR: the others are eliminated, compliances solved for, then the others."""
    T = _factor(own, reduced, learnt)
    r, c = own.rigid, len(own.columns)
    R, z = T[:r, :r], T[:r, c]
    if own.elastic is None:
        x, root, estimate = solve_triangular(R, z), R, None
    else:
        estimate, belief = _compliances(own.elastic, T[r:, r:], options, int(reduced.counts.sum()))
        x = np.r_[solve_triangular(R, z - T[:r, r:c] @ estimate.pi), estimate.pi]
        L, B = own.elastic.L, precision_root(belief.metric, belief.strength)[0]
        B = B @ np.linalg.solve(belief.metric.L, L)
        below = np.asarray(np.linalg.qr(np.vstack([T[r:c, r:c] @ L, B]), mode="r"))
        if belief.moves is not None:
            below = _widened(below, np.asarray(np.linalg.solve(L, belief.moves.T)))
        root = np.block([[R, T[:r, r:c] @ L], [np.zeros((c - r, r)), below]])
    inverse, deviation = solve_triangular(root[:r, :r], np.eye(r)), learnt.deviation[own.columns[:r]]
    held = np.isfinite(deviation)
    known = 1 - (inverse[held] ** 2).sum(axis=1) / deviation[held] ** 2
    spent = float(np.maximum(known, 0).sum() + (~held).sum() + c - r)
    return _Solved(x, root, estimate, spent)


def _widened(root: Array, moves: Array) -> Array:
    """Triangular root of a precision, (e, e), when moves, one a column, add to the covariance."""
    deviations = np.hstack([solve_triangular(root, np.eye(len(root))), moves])
    R = np.linalg.qr(deviations.T, mode="r")
    return np.asarray(np.linalg.qr(solve_triangular(R, np.eye(len(R)), trans="T"), mode="r"))


def _factor(own: Choice, reduced: Reduced, learnt: Learnt) -> Array:
    """Triangular factor of all equations and of the priors but compliances', readings last."""
    some = np.r_[own.columns, own.unknowns.size]
    deviation = learnt.deviation[own.columns[: own.rigid]]
    held = np.flatnonzero(np.isfinite(deviation))
    rows = np.zeros((len(held), len(some)))
    rows[np.arange(len(held)), held] = 1 / deviation[held]
    factors = zip(reduced.factors.values(), learnt.factor, strict=True)
    lines = [R[:, some] / factor for R, factor in factors]
    T = np.asarray(np.linalg.qr(np.vstack([*lines, rows, np.zeros((len(some), len(some)))]), mode="r"))
    free = np.abs(np.diag(T))[: own.rigid]
    if not (free > OPEN * np.linalg.norm(T[:, : own.rigid], axis=0)).all():
        raise BenchError("calibration: the readings leave a frame or target open; expected more poses")
    return T


def _compliances(elastic: Metric, T: Array, options: Options, equations: int) -> tuple[Estimate, Belief]:
    """Least squares or GCO with a prior, of what the readings leave when all else is eliminated."""
    n, share = elastic.structure.n, np.sqrt(equations / 3)
    R, z, rest = T[:n, :n] / share, T[:n, n] / share, float((T[n:, n] ** 2).sum()) / share**2
    regression = regression_of(elastic.structure, (Term(R, z, rest, equations),))
    belief = Belief(elastic, options.strength) if options.strength else _believed(regression, elastic)
    return fit_reduced(regression, options.constraint, belief), belief


def _believed(regression: Regression, elastic: Metric) -> Belief:
    """The prior in the scale of the readings; in its own where they want none above zero."""
    try:
        rescaled(elastic, regression)
    except BenchError:
        return Belief(elastic, LOOSE)
    return hierarchy.learn(regression, elastic)


def moved(state: State, own: Choice, x: Array) -> State:
    """The state with the unknowns of a choice, (c,); what is off is zero."""
    unknowns = own.unknowns
    every = np.zeros(unknowns.size)
    every[own.columns] = x
    theta_0 = state.theta_0.copy()
    theta_0[unknowns.inner] = every[unknowns.columns("geometry")]
    frames = {**state.frames}
    for name in unknowns.frames:
        frames[name] = moved_frame(frames[name], every[unknowns.columns(f"frame {name}")])
    mounts = {**state.mounts}
    for name in unknowns.mounts:
        mounts[name] = moved_mount(mounts[name], every[unknowns.columns(f"mount {name}")])
    return replace(
        state,
        theta_0=theta_0,
        C_theta=unknowns.structure.matrix(every[unknowns.columns("elastic")]),
        errors=unknowns.errors,
        n=every[unknowns.columns("errors")].reshape(state.vjm.arm.n_joints, unknowns.errors.size),
        frames=frames,
        mounts=mounts,
    )


def moved_frame(frame: Frame, step: Array) -> Frame:
    """A frame after the base moved by a step, base axes: x + move + turn x x."""
    turn = _rotation(step[3:])
    return Frame(frame.rotation @ turn, frame.translation + frame.rotation @ step[:3])


def moved_mount(mount: Mount, step: Array) -> Mount:
    """A mount whose targets moved, tool axes, and whose target with an orientation turned."""
    m = len(mount.points)
    points = mount.points + step[: 3 * m].reshape(m, 3)
    return Mount(points, _rotation(step[3 * m :]) @ mount.rotation if len(step) > 3 * m else mount.rotation)


def _rotation(vector: Array) -> Array:
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def residuals(state: State, series: Series) -> Array:
    """Readings minus model in base axes, (s, 3, rows) [m, rad]; zero where nothing was read."""
    return left_over(state, series, tell(state, series.q, series.wrench, series.point))


def pulls_of(state: State, series: Series, noise: Noise) -> Array:
    """How much every reading counts, by its own residual, (s, rows)."""
    alone = replace(series, pose=np.arange(series.rows))
    W, _ = roots(alone, noise, plan_of(alone), state.frame(series).rotation)
    return pull(lengths(np.einsum("srxy,syr->sxr", W, residuals(state, series))))


def scatter(state: State, series: Sequence[Series], share: float) -> Noise:
    """What a state leaves open beside the scatter of the readings.

    Args:
        state: The arm.
        series: The readings.
        share: Equations less what unknowns spend, over all equations [1].
    """
    position, rotation = [], []
    for one in series:
        left = residuals(state, one)
        m = len(one.markers)
        variance = np.full((one.rows, m), one.sigma**2)
        if one.precision is not None:
            own = np.linalg.inv(np.where(one.seen[..., None, None], one.precision, np.eye(3)))
            variance = np.trace(own, axis1=2, axis2=3) / 3
        seen = one.seen
        position.append((np.linalg.norm(left[:m], axis=1).T[seen], variance[seen]))
        if one.sigma_rotation is not None:
            turned = np.linalg.norm(left[m], axis=0)[one.turned]
            rotation.append((turned, np.full(len(turned), one.sigma_rotation**2)))
    found = []
    for kind in (position, rotation):
        length, own = (np.concatenate([part[k] for part in kind]) if kind else np.zeros(0) for k in (0, 1))
        found.append(spread(length, own, share))
    return Noise(found[0], found[1], np.ones(len(KINDS)))


def _unit(series: Sequence[Series], noise: Noise) -> float:
    """Standard deviation of a whitened position [m]."""
    sigma = np.sqrt(np.mean([one.sigma**2 for one in series]))
    return float(np.hypot(sigma, noise.open_position))


def _distance(before: State, after: State, series: Sequence[Series]) -> float:
    """How far targets are from where they were, root mean square [m]."""
    total, count = 0.0, 0
    for one in series:
        m = len(one.markers)
        d = residuals(before, one)[:m] - residuals(after, one)[:m]
        total, count = total + float((d**2).sum()), count + int(one.seen.sum())
    return float(np.sqrt(total / max(count, 1)))
