"""A pattern that joints share: gears or encoders of one make have the same error, turned and maybe mirrored.

    error_j(q) = s_j f(s_j q + phi_j) + what is the joint's own,    s_j 1 or -1

f is periodic. Of the joints' waves, each turned back by phi_j, the mean is f's and the differences (Helmert)
are the joints' own; both have a Gaussian prior. What one joint was not read in, others may tell.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import helmert
from scipy.sparse import coo_array, csr_array

from testbench.errors import Array, Ids
from testbench.model.joint_errors import JointErrors

FIRST = 3
"""Lowest order that counts: an axis that is not where it is drawn looks like orders 1 and 2."""
SURE = 10.0
"""Logarithm of the odds against any other turn, and against none, from which a joint has the pattern."""
RIVALS = 8  #: Turns, each the best near it, that are compared.
SENSES = (1, -1)
TURNS: Array = np.radians(np.arange(0, 360, 1.0))  #: Turns that are tried, then finer ones beside the best.
FINER: Array = np.radians(np.linspace(-1, 1, 41))


@dataclass(frozen=True)
class Pattern:
    """Joints that share a pattern."""

    joints: tuple[int, ...]  #: Their places, two or more; the pattern is in the angle of the first.
    turns: tuple[float, ...]  #: phi of each [rad].
    senses: tuple[int, ...]  #: s of each.


def waves(errors: JointErrors) -> Ids:
    """Coefficients of a joint that a pattern may have, (2 k,): sines, then cosines."""
    return np.flatnonzero(np.tile(errors.orders, 2) >= FIRST)


def turned(f: Array, turn: Array | float, sense: int, orders: Ids) -> Array:
    """Waves of s f(s q + phi), by those of f, (..., 2 k), sines first.

    Mathematics: `abs-11`.
    """
    (a, b), angle = np.split(f, 2, axis=-1), np.asarray(turn, dtype=float)[..., None] * orders
    c, s = np.cos(angle), np.sin(angle)
    return np.concatenate([a * c - b * s, sense * (a * s + b * c)], axis=-1)


def basis(pattern: Pattern, errors: JointErrors, first: int, size: int) -> csr_array:
    """Unknowns by the pattern and the differences from it, (size, size).

    Args:
        pattern: The pattern, in place of the waves of its first joint; differences in place of the others'.
        errors: Errors of the joints.
        first: First column of these among all unknowns.
        size: Number of unknowns.
    """
    n, own, k = len(pattern.joints), waves(errors), len(waves(errors)) // 2
    mix = helmert(n, full=True).T
    mix[:, 0] = 1.0
    at = first + errors.size * np.array(pattern.joints)[:, None] + own
    where = np.concatenate([np.setdiff1d(np.arange(size), at)] * 2).reshape(2, -1)
    entries, places = [np.ones(where.shape[1])], [where]
    orders = np.array(errors.orders)[own[:k]]
    for i in range(n):
        R = turned(np.eye(2 * k), pattern.turns[i], pattern.senses[i], orders).T
        row, column = np.nonzero(R)
        for j in np.flatnonzero(mix[i]):
            entries.append(mix[i, j] * R[row, column])
            places.append(np.stack([at[i, row], at[j, column]]))
    return csr_array(coo_array((np.concatenate(entries), tuple(np.hstack(places))), (size, size)))


@dataclass(frozen=True)
class _Told:
    """What readings tell of the pattern by one joint, its own error in the way."""

    W: Array  #: Precision, (2 k, 2 k).
    g: Array  #: Its product with the most likely waves, (2 k,).
    alone: float  #: Logarithm of the odds of waves that are all its own, as large, over none but its own.


def find(told: Sequence[tuple[Array, Array]], own: Array, shared: Array, orders: Ids) -> Pattern | None:
    """The pattern of some joints, None where no two share one.

    The two that share it best begin; then whoever is surest by those before, one after the other. In the end
    each is to be sure by all others.

    Mathematics: `abs-11`.

    Args:
        told: Of every joint the precision of its waves by the readings, (2 k, 2 k), and its product with
            the most likely ones, (2 k,); zero of a joint without.
        own: Variance of waves that are a joint's own, (2 k,).
        shared: Of those of the pattern, (2 k,).
        orders: Of these, (k,).
    """
    every = [_told(*one, own, own + shared) for one in told]

    def best(j: int, others: dict[int, tuple[float, int]]) -> tuple[float, int, float, int]:
        P, b = np.diag(1 / shared), np.zeros(len(shared))
        for i, (turn, sense) in others.items():
            R = turned(np.eye(len(b)), turn, sense, orders)
            P, b = P + R @ every[i].W @ R.T, b + R @ every[i].g
        return (*_best(every[j], P, b, orders), j)

    joints = range(len(every))
    pairs = [[best(j, {i: (0.0, 1)})[2] for j in joints if j != i] for i in joints]
    found = {int(np.argmax([np.maximum(own, 0).sum() for own in pairs])): (0.0, 1)}
    while len(found) < len(every):
        turn, sense, odds, j = max((best(j, found) for j in joints if j not in found), key=lambda one: one[2])
        if odds < SURE:
            break
        found[j] = turn, sense
    while len(found) > 1:
        again = [best(j, {i: at for i, at in found.items() if i != j}) for j in found]
        worst = min(again, key=lambda one: one[2])
        if worst[2] >= SURE:
            return _of_first({j: (turn, sense) for turn, sense, _, j in again})
        del found[worst[3]]
    return None


def _told(precision: Array, pull: Array, own: Array, whole: Array) -> _Told:
    solved = np.linalg.solve(precision + np.diag(1 / own), np.column_stack([precision, pull]))
    alone, none = (_log_sum(precision + np.diag(1 / d), pull) - np.log(d).sum() / 2 for d in (whole, own))
    return _Told(precision - precision @ solved[:, :-1], pull - precision @ solved[:, -1], alone - none)


def _best(own: _Told, P: Array, b: Array, orders: Ids) -> tuple[float, int, float]:
    """Turn and sense in which a joint has a pattern, and the logarithm of the odds against all others.

    Args:
        own: What the joint tells.
        P: Precision of the pattern by others, (2 k, 2 k).
        b: Its product with the most likely one, (2 k,).
        orders: Of its waves, (k,).
    """
    f = np.asarray(np.linalg.solve(P, b), dtype=float)
    before = _log_sum(P, b)

    def likely(turns: Array, sense: int) -> Array:
        x = turned(f, turns, sense, orders)
        return np.asarray(x @ own.g - ((x @ own.W) * x).sum(axis=1) / 2)

    every = np.stack([likely(TURNS, sense) for sense in SENSES])
    peaks = (every > np.roll(every, 1, axis=1)) & (every >= np.roll(every, -1, axis=1))
    rivals, odds = np.argwhere(peaks)[np.argsort(-every[peaks], kind="stable")[:RIVALS]], [own.alone]
    for way, k in rivals:
        R = turned(np.eye(len(f)), TURNS[k], SENSES[way], orders)
        odds.append(_log_sum(P + R @ own.W @ R.T, b + R @ own.g) - before)
    first, *others = np.argsort(odds)[::-1]
    if not first:
        return 0.0, 1, odds[others[0]] - own.alone if others else 0.0
    way, k = rivals[first - 1]
    finer = TURNS[k] + FINER
    return float(finer[likely(finer, SENSES[way]).argmax()]), SENSES[way], odds[first] - odds[others[0]]


def _log_sum(P: Array, b: Array) -> float:
    """Logarithm of the integral of exp(b x - x P x / 2), but for a constant."""
    return float(b @ np.linalg.solve(P, b) - np.linalg.slogdet(P)[1]) / 2


def _of_first(found: dict[int, tuple[float, int]]) -> Pattern:
    """The pattern in the angle of the first joint that has it."""
    joints = tuple(sorted(found))
    start, way = found[joints[0]]
    turns = tuple(float((way * (found[j][0] - start) + np.pi) % (2 * np.pi) - np.pi) for j in joints)
    return Pattern(joints, turns, tuple(way * found[j][1] for j in joints))
