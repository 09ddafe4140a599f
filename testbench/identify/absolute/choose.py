"""Which errors an arm has: those that foretell readings that were held out, blocks of joint space and series.

A kind of error is tried after the others, and kept where it pays: where blocks that were held out, or whole
series, are foretold better by a share that is worth its unknowns, and neither is foretold worse.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.series import Series
from testbench.errors import Array, Ids
from testbench.identify.absolute.evidence import LOOSE, Choice, Learnt, choice, learn, solve, squares, usual
from testbench.identify.absolute.pattern import find, waves
from testbench.identify.absolute.unknowns import Unknowns
from testbench.identify.crossval import paired
from testbench.identify.estimate import Constraint
from testbench.identify.fold import Part, Reduced, total
from testbench.identify.metric import Belief, Metric
from testbench.identify.prior import Strength
from testbench.progress import stepwise

GEOMETRY = frozenset({"geometry shift", "geometry turn"})
BLOCKS = 16  #: Blocks of joint space over all series.
LEAST = 6  #: Poses below which a block would be too small, or tell too little of a frame.
PAYS = 0.1  #: Share of the mean square by which an error must foretell better to be kept: 5 % of the error.
HURTS = 0.01  #: The same by which it may foretell the others worse.
OPENED = 100.0
"""Times the variance of a frame or mount by all readings beyond which those left tell it no more: a fold that
opens it so far is fitted to it anew."""
OWN = 0.2  #: Share of the variance of waves that is taken as each joint's own while a pattern is sought.
LEFT = 0.2  #: Share of all equations below which what is left of them is too little to foretell a series.
LOAD = 2.0
"""Distance of the largest load from none, where sine and cosine of a joint are at most 2 apart: loads that
differ much are blocks of their own."""


@dataclass(frozen=True)
class Step:
    """One kind of error that was tried."""

    name: str  #: What was tried, beside all that was kept before.
    kept: bool
    before: float  #: RMS error of held-out positions along an axis without it [m].
    after: float  #: With it [m].
    deviation: float  #: Standard error of the difference of their mean squares, over that before [1].
    series_before: float  #: RMS error of series that were held out, realigned [m]; NaN of a single one.
    series_after: float  #: [m]


@dataclass(frozen=True)
class Chosen:
    """What was kept, and what is known of its size."""

    own: Choice
    learnt: Learnt
    reduced: Reduced  #: The readings, in the basis of its unknowns.
    kinds: frozenset[str]  #: Kinds of errors that are on.
    steps: tuple[Step, ...]  #: What was tried, in order.
    plain: str = ""  #: What stands beside all that was kept: geometry, with joint springs if more was kept.
    #: Held-out positions of every block by that and by all that was kept, root mean square along an axis [m].
    held_out: tuple[Array, Array] = (np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class Candidate:
    """One kind of error that may be added."""

    name: str  #: For people, and for `--without`.
    kinds: frozenset[str] = frozenset()  #: Groups of columns that it puts on.
    elastic: Metric | None = None  #: Compliances that it puts on, in place of those before.
    sure: bool = False  #: Whether it is kept whatever it foretells: every arm has it.
    pattern: bool = False  #: Whether it looks for a `pattern` in what was kept, and is kept unless it harms.


def blocks_of(series: Sequence[Series], seed: int = 0) -> list[Ids]:
    """Divide rows into blocks of joint space by k-means on sine and cosine; rows of a pose share a block.

    If a block leaves too few poses beside it, there are two halves.

    Args:
        series: The readings.
        seed: Seed of k-means.

    Returns:
        Block of every row, (rows,) per series.
    """
    from scipy.cluster.vq import kmeans2  # here: it takes long to import, and few runs need it

    rows = sum(one.rows for one in series)
    found = []
    for one in series:
        share = round(BLOCKS * one.rows / rows)
        _, first, pose = np.unique(one.pose, return_index=True, return_inverse=True)
        k = max(1, min(max(2, share), len(first) // LEAST))
        load = np.linalg.norm(one.wrench[:, :3], axis=1)
        place = np.column_stack([np.sin(one.q), np.cos(one.q), LOAD * load / (load.max() or 1.0)])
        label = np.zeros(one.rows, dtype=int)
        if k > 1:
            label = kmeans2(place, k, minit="++", seed=seed)[1].astype(int)
        if k > 1 and len(first) - np.bincount(label[first]).max() < LEAST:
            label[first] = 2 * np.arange(len(first)) // len(first)
        found.append(label[first[pose]])
    return found


@dataclass(frozen=True)
class Rules:
    """By what candidates are judged."""

    unit: Array  #: Standard deviation of a whitened equation of every kind, (kinds,) [m, rad].
    constraint: Constraint = "psd"  #: That of the arm that is delivered.
    strength: Strength = LOOSE  #: How firmly expected compliances are believed.


def choose(unknowns: Unknowns, reduced: Reduced, candidates: Sequence[Candidate], rules: Rules) -> Chosen:
    """Try candidates one after the other.

    Mathematics: `abs-10`.

    Args:
        unknowns: All that there might be.
        reduced: The readings, in blocks.
        candidates: What to try, in order; geometry is always on.
        rules: By what they are judged.
    """
    kinds, elastic = GEOMETRY, None
    tried = _tried(choice(unknowns, kinds, elastic), reduced, usual(unknowns, len(reduced.kinds)), rules)
    steps: dict[str, Step] = {}
    beside = {"geometry": tried}
    for one in stepwise(candidates, "trying errors"):
        more = kinds | one.kinds, one.elastic or elastic
        found = patterned(tried.own, kinds, tried.learnt, reduced) if one.pattern else None
        if one.pattern and found is None:
            continue
        own, equations = found or (choice(unknowns, *more), reduced)
        other = _tried(own, equations, tried.learnt, rules)
        steps[one.name] = _step(one, tried, other)
        if steps[one.name].kept:
            tried, (kinds, elastic), unknowns, reduced = other, more, own.unknowns, equations
        if one.sure:
            beside[f"geometry and {one.name}"] = tried
    kept = [one for one in candidates if one.name in steps and steps[one.name].kept]
    for one in kept[:-1]:  # the next one that was kept may explain the same
        if one.kinds and not one.sure and not ("pattern" in kinds and one.kinds & {"harmonics", "pattern"}):
            fewer = choice(unknowns, kinds - one.kinds, elastic)
            other = _tried(fewer, reduced, tried.learnt, rules)
            again = _step(one, other, tried)
            if not again.kept:
                tried, kinds, steps[one.name] = other, kinds - one.kinds, again
    plain, other = [(name, one) for name, one in beside.items() if one is not tried or len(beside) == 1][-1]
    held = _by_block(other.blocks), _by_block(tried.blocks)
    return Chosen(tried.own, tried.learnt, reduced, kinds, tuple(steps.values()), plain, held)


def patterned(
    own: Choice, kinds: frozenset[str], learnt: Learnt, reduced: Reduced
) -> tuple[Choice, Reduced] | None:
    """The unknowns of some kinds, and the pattern that joints share; None where no two share one."""
    unknowns, errors, joints = own.unknowns, own.unknowns.errors, own.unknowns.vjm.arm.joints
    some = waves(errors)
    if "harmonics" not in kinds or not len(some):
        return None
    at = unknowns.starts["errors"] + errors.size * np.arange(len(joints))[:, None] + some
    whole, orders = learnt.deviation[at[0]] ** 2, np.array(errors.orders)[some[: len(some) // 2]]
    solved, told = solve(own, squares(own, reduced.gram), learnt, LOOSE), []
    V = solved.covariance
    for joint, j in zip(joints, np.searchsorted(own.columns, at), strict=True):
        precision = np.asarray(np.linalg.inv(V[np.ix_(j, j)]), dtype=float)
        known = float(not joint.prismatic)
        told.append((known * (precision - np.diag(1 / whole)), np.asarray(known * (precision @ solved.x[j]))))
    unknowns = replace(unknowns, pattern=find(told, OWN * whole, (1 - OWN) * whole, orders))
    if unknowns.basis is None:
        return None
    return choice(unknowns, kinds | {"pattern"}, own.elastic), reduced.turned(unknowns.basis)


@dataclass(frozen=True)
class _Tried:
    own: Choice
    learnt: Learnt
    #: Of every held-out block its positions and their sums of squares, whitened and in m^2, (blocks, 3).
    blocks: Array
    series: Array  #: The same of every series, (series, 3).


def _tried(own: Choice, reduced: Reduced, start: Learnt, rules: Rules) -> _Tried:
    S = squares(own, reduced.gram)
    learnt = learn(own, S, reduced.counts, start, rules.constraint)
    every = _by_series(reduced)
    most = (1 - LEFT) * reduced.counts.sum()
    fair = [one for one in every if len(every) > 1 and sum(part.counts.sum() for part in one) <= most]
    blocks = _left(own, reduced, learnt, rules, _blocks(reduced))
    return _Tried(own, learnt, blocks, _left(own, reduced, learnt, rules, fair))


def _by_series(reduced: Reduced) -> list[list[Part]]:
    """Group the blocks by their series."""
    places = sorted({part.series for part in reduced.parts})
    return [[part for part in reduced.parts if part.series == place] for place in places]


def _blocks(reduced: Reduced) -> list[list[Part]]:
    """List the blocks that can be held out: nothing tells the frame of a series without its only one."""
    return [[part] for one in _by_series(reduced) if len(one) > 1 for part in one]


def _left(
    own: Choice, reduced: Reduced, learnt: Learnt, rules: Rules, held: Sequence[Sequence[Part]]
) -> Array:
    """Hold out some blocks, or all of a series, in turn: their positions and sums of squares, (held, 3)."""
    S, some, found = squares(own, reduced.gram), reduced.positions, []
    first = np.searchsorted(own.columns, own.unknowns.starts["geometry"])
    whole = solve(own, S, learnt, rules.strength).variances(np.arange(first))
    for parts in held:
        n = sum(part.counts[some].sum() for part in parts)
        sums = _held_out(own, S, parts, (learnt, rules), whole)[some]
        found.append((n, sums.sum(), rules.unit[some] ** 2 @ sums))
    return np.array(found).reshape(-1, 3)


def with_belief(chosen: Chosen, rules: Rules, belief: Belief | None) -> Chosen:
    """Hold out the blocks once more, by the prior of the arm that is delivered, where there are any.

    Args:
        chosen: What was kept, and held-out errors by the prior that candidates are compared with.
        rules: By what candidates are judged.
        belief: What the delivered arm believes of compliances; None of a rigid arm.
    """
    plain, every = chosen.held_out
    if belief is None or not len(every):
        return chosen
    own, rules = replace(chosen.own, elastic=belief.metric), replace(rules, strength=belief.strength)
    blocks = _left(own, chosen.reduced, chosen.learnt, rules, _blocks(chosen.reduced))
    return replace(chosen, held_out=(plain, _by_block(blocks)))


def _held_out(own: Choice, S: Array, parts: Sequence[Part], how: tuple[Learnt, Rules], whole: Array) -> Array:
    """Sums of squares of some parts by the others; frames and mounts that these hardly tell are fitted anew.

    Args:
        own: The unknowns.
        S: Squares of all readings.
        parts: What is held out: a block, or a series.
        how: Sizes of errors, and by what candidates are judged.
        whole: Variances of frames and mounts by all readings, (k,).
    """
    (learnt, rules), k = how, len(whole)
    T, every = squares(own, total(parts)), np.arange(len(own.columns))
    others = S - T
    alone = np.flatnonzero(np.abs(others[:, : own.rigid, :k]).sum(axis=(0, 1)) == 0)
    rest, at = np.delete(every, alone), np.delete(np.arange(len(every) + 1), alone)
    if len(alone):
        others = others[:, at][:, :, at]
    found = solve(
        Choice(own.unknowns, own.columns[rest], own.elastic), others, learnt, rules.strength, rules.constraint
    )
    told = rest[rest < k]
    opened = told[found.variances(np.arange(len(told))) > OPENED * whole[told]]
    v, open_ = np.zeros(len(every) + 1), np.r_[alone, opened]
    v[at] = np.r_[found.x, -1.0]
    if len(open_):
        H = np.tensordot(learnt.factor**-2.0, T, 1)
        v[open_] -= np.linalg.lstsq(H[np.ix_(open_, open_)], H[open_] @ v, rcond=None)[0]
    return np.asarray(T @ v @ v)


def _step(tried: Candidate, before: _Tried, after: _Tried) -> Step:
    count = max(before.blocks[:, 0].sum(), 1.0)
    saved = (before.blocks[:, 1] - after.blocks[:, 1]) / count
    old, new = (max(x.blocks[:, 1].sum(), 1e-300) / count for x in (before, after))
    deviation = max(1, len(saved)) * paired(saved)[1] / old
    gain = 1 - after.series[:, 1].sum() / before.series[:, 1].sum() if len(before.series) else 0.0
    blocks = 1 - new / old
    pays = blocks > max(PAYS, deviation) or gain > PAYS or tried.pattern
    pays = pays and min(blocks, gain) > -HURTS
    every = (before.blocks, after.blocks, before.series, after.series)
    rms = [float(_by_block(sums.sum(axis=0)[None])[0]) if len(sums) else math.nan for sums in every]
    return Step(tried.name, bool(pays or tried.sure), rms[0], rms[1], deviation, rms[2], rms[3])


def _by_block(sums: Array) -> Array:
    """Along an axis, of every block, (blocks,) [m]."""
    return np.asarray(np.sqrt(sums[:, 2] / np.maximum(sums[:, 0], 1.0)))
