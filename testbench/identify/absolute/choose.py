"""Selection of errors: those that predict held-out readings better, in blocks of joint space and series.

Kinds of errors are tried one after the other. A kind is kept if held-out blocks, or whole series, are
predicted better by a share that justifies its unknowns, and neither is predicted worse.
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
BLOCKS = 16
"""Blocks of joint space over all series."""
LEAST = 6
"""Fewest poses of a block: fewer determine a frame too poorly."""
PAYS = 0.1
"""Least gain of a kind of error, as a share of the mean square [1]: 5 % of the RMS error."""
HURTS = 0.01
"""Largest loss in the other comparison, as a share of the mean square [1]."""
OPENED = 100.0
"""Factor on the variance of a frame or mount without the held-out readings beyond which these readings fit it
anew [1]."""
OWN = 0.2
"""Share of the variance of waves that is individual to a joint while a pattern is sought [1]."""
LEFT = 0.2
"""Least share of all equations that must remain to predict a held-out series [1]."""
LOAD = 2.0
"""Distance of the largest load from none, in the space of sine and cosine of the joints: loads that differ
much are in different blocks."""


@dataclass(frozen=True)
class Step:
    """Report the trial of one kind of error."""

    name: str  #: Kind of error that was added to all those kept before.
    kept: bool  #: Whether it is kept.
    before: float  #: RMS error of held-out positions along an axis without it [m].
    after: float  #: The RMS error with it [m].
    deviation: float  #: Standard error of the difference of the two mean squares, over the first [1].
    #: RMS error of held-out series after realignment, without it [m]; NaN for a single series.
    series_before: float
    series_after: float  #: The RMS error of held-out series with it [m].


@dataclass(frozen=True)
class Chosen:
    """Hold the result of the selection."""

    own: Choice  #: The selected unknowns.
    learnt: Learnt  #: Sizes of their errors, and noise factors.
    reduced: Reduced  #: The reduced equations, in the basis of its unknowns.
    kinds: frozenset[str]  #: Kinds of errors that are selected.
    steps: tuple[Step, ...]  #: Trials, in order.
    plain: str = ""  #: Simpler model for comparison: geometry, with joint springs if more was kept.
    #: RMS error of held-out positions along an axis, for every block, by the simpler and by the selected
    #: model [m].
    held_out: tuple[Array, Array] = (np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class Candidate:
    """Describe one kind of error that may be added."""

    name: str  #: Name in reports, and in `Options.without`.
    kinds: frozenset[str] = frozenset()  #: Groups of columns that it adds.
    elastic: Metric | None = None  #: Compliances that it selects, in place of the earlier ones.
    sure: bool = False  #: Whether it is kept whatever the trial shows: every arm has it.
    #: Whether it searches for a shared `pattern` in the kept errors; it is kept unless it harms.
    pattern: bool = False


def blocks_of(series: Sequence[Series], seed: int = 0) -> list[Ids]:
    """Divide rows into blocks of joint space by k-means on sine and cosine; rows of a pose share a block.

    If a block leaves fewer than `LEAST` poses outside it, the series is divided into two halves.

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
    """Hold the criteria of the selection."""

    unit: Array  #: Standard deviation of a whitened equation of every kind, (kinds,) [m, rad].
    constraint: Constraint = "psd"  #: Constraint of the final arm.
    strength: Strength = LOOSE  #: Relative uncertainty of the expected compliances.


def choose(unknowns: Unknowns, reduced: Reduced, candidates: Sequence[Candidate], rules: Rules) -> Chosen:
    """Select the kinds of errors that predict held-out readings better, tried one after the other.

    Mathematics: `abs-10`.

    Args:
        unknowns: All unknowns that may be used.
        reduced: The reduced equations, in blocks.
        candidates: Kinds of errors to try, in order; geometry is always used.
        rules: Criteria of the selection.

    Returns:
        The selected unknowns, the sizes of their errors, and the steps of the selection.
    """
    kinds, elastic = GEOMETRY, None
    tried = _tried(choice(unknowns, kinds, elastic), reduced, usual(unknowns, len(reduced.kinds)), rules)
    # Forward selection: add each candidate to the kept ones, and keep it if held-out readings improve.
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
    # Backward pass: drop a kind that a later one has made unnecessary.
    kept = [one for one in candidates if one.name in steps and steps[one.name].kept]
    for one in kept[:-1]:  # the next one that was kept may explain the same
        if one.kinds and not one.sure and not ("pattern" in kinds and one.kinds & {"harmonics", "pattern"}):
            fewer = choice(unknowns, kinds - one.kinds, elastic)
            other = _tried(fewer, reduced, tried.learnt, rules)
            again = _step(one, other, tried)
            if not again.kept:
                tried, kinds, steps[one.name] = other, kinds - one.kinds, again
    # Held-out errors of the simpler model, for comparison.
    plain, other = [(name, one) for name, one in beside.items() if one is not tried or len(beside) == 1][-1]
    held = _by_block(other.blocks), _by_block(tried.blocks)
    return Chosen(tried.own, tried.learnt, reduced, kinds, tuple(steps.values()), plain, held)


def patterned(
    own: Choice, kinds: frozenset[str], learnt: Learnt, reduced: Reduced
) -> tuple[Choice, Reduced] | None:
    """Add the error pattern that several joints share to the unknowns.

    Args:
        own: The unknowns so far.
        kinds: Kinds of errors among them.
        learnt: Sizes of errors, and noise factors.
        reduced: The reduced equations.

    Returns:
        The unknowns with the pattern, and the equations in their basis; None if no two joints share a
        pattern.
    """
    unknowns, errors, joints = own.unknowns, own.unknowns.errors, own.unknowns.vjm.arm.joints
    some = waves(errors)
    if "harmonics" not in kinds or not len(some):
        return None
    at = unknowns.starts["errors"] + errors.size * np.arange(len(joints))[:, None] + some
    whole, orders = learnt.deviation[at[0]] ** 2, np.array(errors.orders)[some[: len(some) // 2]]
    # Precision of each hinge's waves from the readings alone: posterior precision minus that of the prior.
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
    #: Number, whitened sum of squares and sum of squares [m^2] of the positions in every held-out block,
    #: (blocks, 3).
    blocks: Array
    series: Array  #: The three numbers for every held-out series, (series, 3).


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
    """List the blocks that can be held out: the only block of a series has no others to fix its frame."""
    return [[part] for one in _by_series(reduced) if len(one) > 1 for part in one]


def _left(
    own: Choice, reduced: Reduced, learnt: Learnt, rules: Rules, held: Sequence[Sequence[Part]]
) -> Array:
    """Hold out parts of the readings in turn: number and sums of squares of their positions, (held, 3)."""
    S, some, found = squares(own, reduced.gram), reduced.positions, []
    first = np.searchsorted(own.columns, own.unknowns.starts["geometry"])
    whole = solve(own, S, learnt, rules.strength).variances(np.arange(first))
    for parts in held:
        n = sum(part.counts[some].sum() for part in parts)
        sums = _held_out(own, S, parts, (learnt, rules), whole)[some]
        found.append((n, sums.sum(), rules.unit[some] ** 2 @ sums))
    return np.array(found).reshape(-1, 3)


def with_belief(chosen: Chosen, rules: Rules, belief: Belief | None) -> Chosen:
    """Repeat the hold-out test with the prior of the final arm, if blocks can be held out.

    Args:
        chosen: The selection, with held-out errors for the prior under which candidates were compared.
        rules: Criteria of the selection.
        belief: Prior of the final arm's compliances; None for a rigid arm.

    Returns:
        The selection, with its held-out errors updated.
    """
    plain, every = chosen.held_out
    if belief is None or not len(every):
        return chosen
    own, rules = replace(chosen.own, elastic=belief.metric), replace(rules, strength=belief.strength)
    blocks = _left(own, chosen.reduced, chosen.learnt, rules, _blocks(chosen.reduced))
    return replace(chosen, held_out=(plain, _by_block(blocks)))


def _held_out(own: Choice, S: Array, parts: Sequence[Part], how: tuple[Learnt, Rules], whole: Array) -> Array:
    """Compute the sums of squares of held-out parts, predicted by the other readings.

    Frames and mounts that the others hardly determine are fitted to the held-out parts.

    Args:
        own: The unknowns.
        S: Gram matrices of all readings.
        parts: Held-out parts: a block, or all blocks of a series.
        how: Sizes of errors with noise factors, and criteria of the selection.
        whole: Variances of frames and mounts by all readings, (k,).
    """
    (learnt, rules), k = how, len(whole)
    # Gram matrices of the other readings: the difference of two sums.
    T, every = squares(own, total(parts)), np.arange(len(own.columns))
    others = S - T
    # Frames and mounts that occur in the held-out parts alone are no unknowns of the others.
    alone = np.flatnonzero(np.abs(others[:, : own.rigid, :k]).sum(axis=(0, 1)) == 0)
    rest, at = np.delete(every, alone), np.delete(np.arange(len(every) + 1), alone)
    if len(alone):
        others = others[:, at][:, :, at]
    found = solve(
        Choice(own.unknowns, own.columns[rest], own.elastic), others, learnt, rules.strength, rules.constraint
    )
    # Fit these, and those with a much larger variance, to the held-out parts, all else fixed.
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
    """Compute the RMS error along an axis in every block, (blocks,) [m]."""
    return np.asarray(np.sqrt(sums[:, 2] / np.maximum(sums[:, 0], 1.0)))
