"""Calibration by absolute readings: Gauss-Newton outside, the cone inside.

Geometry and joint springs first, which tells wild readings; then all errors that there might be, which tells
the scatter; then again, where cross-validation chooses among them. Compliances are absolute in each: what is
left of the equations when all other unknowns are eliminated is a `Regression`, which least squares and GCO
solve as any other.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.series import Series, select_rows
from testbench.errors import Array, BenchError
from testbench.identify.absolute.align import aligned, alike, check_fits
from testbench.identify.absolute.choose import (
    GEOMETRY,
    Candidate,
    Chosen,
    Rules,
    blocks_of,
    choose,
    patterned,
    with_belief,
)
from testbench.identify.absolute.evidence import Choice, Learnt, choice, learn, squares, usual
from testbench.identify.absolute.inner import eliminate, moved
from testbench.identify.absolute.noise import Noise
from testbench.identify.absolute.scatter import distance, expected_of, pulls_of, scatter, single, units
from testbench.identify.absolute.state import State, nominal, torque_scale
from testbench.identify.absolute.unknowns import Unknowns, unknowns_of
from testbench.identify.diagnosis.finding import Finding
from testbench.identify.diagnosis.moves import settled
from testbench.identify.diagnosis.notation import check_last_joint, check_order
from testbench.identify.estimate import Constraint, Estimate
from testbench.identify.fold import Point, Reduced, reduce_series
from testbench.identify.metric import Metric, metric
from testbench.identify.prior import Prior, Strength
from testbench.model.joint_errors import KINDS, JointErrors
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import Vjm
from testbench.model.weights import Weights, read_weights

ORDERS = 80  #: Periodic errors that are tried, times a turn.
ON_THE_WAY, LEAST_OF_ONE = 4000, 100
"""Rows, over all series and of each, that a step which is not the last needs."""
MANY = 3.0
"""Unknowns of periodic errors over readings at most. More than one: their learnt sizes hold them, and orders
that are left out harm. 50 poses of a UR10 leave 0.17 mm in all others, 0.38 mm with 0.6 of them."""

PATTERN = "common pattern"
NAMES = ("joint springs", "joint errors", PATTERN, "links", *KINDS[1:])
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

    @property
    def may(self) -> frozenset[str]:
        """Names of errors that may be on."""
        return frozenset(NAMES if self.only is None else self.only) - self.without


@dataclass(frozen=True)
class Calibration:
    """A calibrated arm, and what there is to say of it."""

    state: State  #: The arm.
    own: Choice  #: Its unknowns.
    information: Array  #: What the readings tell of all that there might be, no prior, (size, size).
    #: Upper triangular root of the posterior's precision, R^T R, compliances in the metric, (c, c).
    root: Array
    noise: Noise  #: How far readings scatter about it.
    chosen: Chosen  #: What was tried and kept.
    estimate: Estimate | None  #: Compliances, with a certificate; None of a rigid arm.
    pressed: float  #: Chi squared that compliances below zero would take away [1].
    pulls: tuple[Array, ...]  #: Of every series, how much each reading counts, (s, rows) [1].
    step: float  #: How far the last linearisation moved targets, root mean square [m].
    series: tuple[Series, ...]  #: The readings, in parts where a target or a tracker moved.
    found: tuple[Finding, ...]  #: Targets that were left out, and what moved in mid-series.


@dataclass(frozen=True)
class Gathered:
    """Readings boiled down once, to be explained by any of the errors that there might be."""

    series: tuple[Series, ...]  #: What was read, in parts where something moved.
    prior: Prior  #: Expected compliances.
    unknowns: Unknowns  #: All that there might be.
    state: State  #: Where the equations are linear: with joint springs and periodic errors.
    noise: Noise  #: How far readings scatter about it.
    reduced: Reduced  #: The equations, in blocks of joint space.
    found: tuple[Finding, ...]  #: Targets that were left out, and what moved in mid-series.


def calibrate(
    vjm: Vjm,
    series: Sequence[Series],
    prior: Prior,
    options: Options | None = None,
    weights: Weights | None = None,
) -> Calibration:
    """Calibrate an arm from absolute readings: geometry, joint errors and compliances.

    Gauss-Newton linearises geometry and joint errors; least squares or GCO, Eq. (14)-(19), fits the
    compliances of what remains. Evidence sets the sizes of the errors, and cross-validation selects the kinds
    of errors.

    Args:
        vjm: The arm's nominal virtual joint model.
        series: All absolute readings: joint angles, loads, target positions [m].
        prior: Expected compliances, such as `cad_prior(arm)`.
        options: Errors that are tried, and how; None to try all.
        weights: Weights of the links; None for those of the arm's rigid.xml.

    Returns:
        The calibrated state with its posterior, its noise, and the errors that were kept.

    Raises:
        BenchError: When there is no series, or one does not fit the arm or leaves its frame or target
            undetermined.
    """
    if not series:
        raise BenchError("series: expected one or more, got none")
    options = options or Options()
    return explain(gather(vjm, series, prior, options, weights), options)


def gather(
    vjm: Vjm, series: Sequence[Series], prior: Prior, options: Options, weights: Weights | None = None
) -> Gathered:
    """Reduce the readings once, for any selection of errors: the first part of `calibrate`.

    Args:
        vjm: The arm's nominal kinematics.
        series: Absolute readings.
        prior: Expected compliances.
        options: Errors that may be tried.
        weights: Weights of the links; None for those of the arm's folder.

    Returns:
        The reduced equations, with frames, mounts and noise.
    """
    series, lost = alike(series)
    check_order(vjm, series)
    weights = weights or read_weights(vjm.arm)
    bare = nominal(vjm, weights, torque_scale(vjm, weights, series))
    joints = metric(prior, vjm, joints_only(vjm.arm))

    def fitted(some: tuple[Series, ...]) -> tuple[State, Noise]:
        few = thinned(some)
        return first_fit(aligned(bare, few), few, joints, options.constraint)

    check_last_joint(vjm, series, fitted)
    moves, series, (first, noise) = settled(series, fitted, metric(prior, vjm, all153(vjm.arm)))
    check_fits(first, series)
    readings = sum(3 * int(one.seen.sum() + one.turned.sum()) for one in series)
    told = max(1, min(options.orders, int(MANY * readings / (2 * vjm.arm.n_joints))))
    orders = tuple(range(1, told + 1)) if "joint errors" in options.may else ()
    errors = JointErrors(orders, **{name: name in options.may for name in KINDS[1:]})
    most = all153 if "links" in options.may else joints_only
    unknowns = unknowns_of(vjm, series, errors, most(vjm.arm))
    state = replace(first, errors=errors, n=np.zeros((vjm.arm.n_joints, errors.size)))
    own, few = choice(unknowns, GEOMETRY | {"harmonics"}, joints), thinned(series)
    state, share = _stepped(own, few, (state, noise), options.constraint)
    noise = scatter(state, series, share)
    blocks = blocks_of(series) if options.only is None else None
    reduced = reduce_series(Point(unknowns, state, noise), series, blocks)
    return Gathered(series, prior, unknowns, state, noise, reduced, (*lost, *moves))


def explain(found: Gathered, options: Options) -> Calibration:
    """Select the errors that predict held-out readings best, and calibrate with them.

    Args:
        found: The reduced equations.
        options: Errors that are on or may be tried.

    Returns:
        The calibrated arm.

    Raises:
        BenchError: When the readings leave a frame or target undetermined, or were gathered without the
            links.
    """
    series, reduced = found.series, found.reduced
    expected = expected_of(series)
    rules = Rules(units(expected, found.noise)[list(reduced.kinds)], options.constraint)
    chosen = _choose(found, options, rules)
    solved = eliminate(chosen.own, chosen.reduced, chosen.learnt, options.constraint, options.strength)
    chosen = with_belief(chosen, rules, solved.belief)
    after = moved(found.state, chosen.own, solved.x)
    factor = found.noise.factor.copy()
    factor[list(reduced.kinds)] = chosen.learnt.factor
    noise = single(replace(found.noise, factor=factor), expected)
    step = distance(found.state, after, series)
    pulls = tuple(pulls_of(after, one, noise) for one in series)
    return Calibration(
        state=after,
        own=chosen.own,
        information=np.tensordot(chosen.learnt.factor**-2.0, reduced.gram, 1)[:-1, :-1],
        root=solved.root,
        noise=noise,
        chosen=chosen,
        estimate=solved.estimate,
        pressed=solved.pressed,
        pulls=pulls,
        step=step,
        series=series,
        found=found.found,
    )


def first_fit(
    state: State, series: tuple[Series, ...], joints: Metric, constraint: Constraint = "psd"
) -> tuple[State, Noise]:
    """Fit geometry and joint springs, from a state that has frames and mounts.

    Args:
        state: The start.
        series: The readings.
        joints: Metric of the joint compliances.
        constraint: "psd" for GCO, "none" for least squares.

    Returns:
        The fitted state, and the noise of the readings about it.
    """
    first = unknowns_of(state.vjm, series, JointErrors(), joints.structure)
    own, noise = choice(first, GEOMETRY, joints), scatter(state, series, 1.0)
    for _ in range(2):
        state, share = _stepped(own, series, (state, noise), constraint)
        noise = scatter(state, series, share)
    return state, noise


def _choose(found: Gathered, options: Options, rules: Rules) -> Chosen:
    """What is tried, in order, or taken where it was asked for; links bring their own joints."""
    unknowns, reduced, vjm = found.unknowns, found.reduced, found.state.vjm
    joints, links = (metric(found.prior, vjm, most(vjm.arm)) for most in (joints_only, all153))
    every = {
        "joint springs": Candidate("joint springs", elastic=joints, sure=True),
        "joint errors": Candidate("joint errors", frozenset({"harmonics"})),
        PATTERN: Candidate(PATTERN, frozenset({"pattern"}), pattern=True),
        "links": Candidate("links", elastic=links),
    } | {name: Candidate(name, frozenset({name})) for name in KINDS[1:]}
    on = [every[name] for name in NAMES if name in options.may]
    if options.only is None:
        return choose(unknowns, reduced, on, rules)
    kinds = GEOMETRY.union(*(one.kinds for one in on))
    elastic = [one.elastic for one in on if one.elastic is not None]
    own = choice(unknowns, kinds - {"pattern"}, elastic[-1] if elastic else None)

    def learnt(own: Choice, reduced: Reduced, start: Learnt) -> Learnt:
        return learn(own, squares(own, reduced.gram), reduced.counts, start, options.constraint)

    sizes = learnt(own, reduced, usual(unknowns, len(reduced.kinds)))
    if PATTERN in options.may and (shared := patterned(own, kinds, sizes, reduced)):
        own, reduced = shared
        sizes = learnt(own, reduced, sizes)
    return Chosen(own, sizes, reduced, kinds, ())


def thinned(series: Sequence[Series]) -> tuple[Series, ...]:
    """As many rows, all of a pose, as a step on the way needs."""
    every, found = sum(one.rows for one in series), []
    for one in series:
        stride = min(-(-every // ON_THE_WAY), max(1, one.rows // LEAST_OF_ONE))
        _, pose = np.unique(one.pose, return_inverse=True)
        found.append(select_rows(one, pose % stride == 0) if stride > 1 else one)
    return tuple(found)


def _stepped(
    own: Choice, series: tuple[Series, ...], now: tuple[State, Noise], constraint: Constraint
) -> tuple[State, float]:
    """One Gauss-Newton step, and the share of equations that no unknown spends."""
    state, noise = now
    reduced = reduce_series(Point(own.unknowns, state, noise), series)
    S, counts = squares(own, reduced.gram), reduced.counts
    learnt = learn(own, S, counts, usual(own.unknowns, len(counts)), constraint)
    solved = eliminate(own, reduced, learnt, constraint)
    return moved(state, own, solved.x), max(0.1, 1 - solved.spent / counts.sum())
