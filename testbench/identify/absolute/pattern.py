"""Error pattern of several joints: gears or encoders of one make share an error, shifted or mirrored.

    error_j(q) = s_j f(s_j q + phi_j) + individual error of joint j,    s_j = 1 or -1

f is periodic. If the waves of each joint are shifted back by phi_j, their mean is the pattern, and their
differences (Helmert) are individual errors; both have a Gaussian prior. Angles that one joint was not read in
may be covered by the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import helmert
from scipy.sparse import coo_array, csr_array

from testbench.errors import Array, Ids
from testbench.model.joint_errors import JointErrors

FIRST = 3
"""Lowest order of a pattern: errors of an axis' position look like orders 1 and 2."""
MIN_LOG_ODDS = 10.0
"""Least log odds of a joint's shift against any other shift, and against no pattern."""
RIVALS = 8
"""Shifts that are compared, each a local maximum."""
SENSES = (1, -1)
TURNS: Array = np.radians(np.arange(0, 360, 1.0))
"""Shifts that are tried [rad]."""
FINER: Array = np.radians(np.linspace(-1, 1, 41))
"""Finer shifts around the best one [rad]."""


@dataclass(frozen=True)
class Pattern:
    """Describe joints that share a pattern."""

    #: Indices of the joints, two or more; the pattern is a function of the first joint's angle.
    joints: tuple[int, ...]
    turns: tuple[float, ...]  #: Shift phi of each joint [rad].
    senses: tuple[int, ...]  #: Sign s of each joint.


def wave_columns(errors: JointErrors) -> Ids:
    """List the Fourier coefficients of a joint that a pattern may have.

    Args:
        errors: The arm's joint errors.

    Returns:
        Places of the sines, then of the cosines, (2 k,).
    """
    return np.flatnonzero(np.tile(errors.orders, 2) >= FIRST)


def shift_waves(f: Array, turn: Array | float, sense: int, orders: Ids) -> Array:
    """Compute the Fourier coefficients of s f(s q + phi) from those of f.

    Mathematics: `abs-11`.

    Args:
        f: Coefficients of f, sines first, (..., 2 k).
        turn: phi [rad], one number or (...).
        sense: s, 1 or -1.
        orders: Orders of the waves, (k,).

    Returns:
        The coefficients, (..., 2 k).
    """
    (a, b), angle = np.split(f, 2, axis=-1), np.asarray(turn, dtype=float)[..., None] * orders
    c, s = np.cos(angle), np.sin(angle)
    return np.concatenate([a * c - b * s, sense * (a * s + b * c)], axis=-1)


def pattern_basis(pattern: Pattern, errors: JointErrors, first: int, size: int) -> csr_array:
    """Make the basis in which joints have a shared pattern, and differences from it.

    Args:
        pattern: The pattern. It replaces the waves of its first joint; differences replace those of the
            others.
        errors: Errors of the joints.
        first: First column of the joint errors among all unknowns.
        size: Number of unknowns.

    Returns:
        Unknowns in SI units by those in the basis, (size, size).
    """
    n, own, k = len(pattern.joints), wave_columns(errors), len(wave_columns(errors)) // 2
    # Columns: the pattern, in place of the mean, then the differences between joints.
    mix = helmert(n, full=True).T
    mix[:, 0] = 1.0
    at = first + errors.size * np.array(pattern.joints)[:, None] + own
    where = np.concatenate([np.setdiff1d(np.arange(size), at)] * 2).reshape(2, -1)
    entries, places = [np.ones(where.shape[1])], [where]
    orders = np.array(errors.orders)[own[:k]]
    # Waves of joint i: each column, shifted and mirrored to its angle.
    for i in range(n):
        R = shift_waves(np.eye(2 * k), pattern.turns[i], pattern.senses[i], orders).T
        row, column = np.nonzero(R)
        for j in np.flatnonzero(mix[i]):
            entries.append(mix[i, j] * R[row, column])
            places.append(np.stack([at[i, row], at[j, column]]))
    return csr_array(coo_array((np.concatenate(entries), tuple(np.hstack(places))), (size, size)))


@dataclass(frozen=True)
class _PatternInformation:
    """Hold the information of one joint's readings about the pattern; its individual error is eliminated."""

    W: Array  #: Precision of the pattern's waves, (2 k, 2 k).
    g: Array  #: Its product with the most probable waves, (2 k,).
    alone: float  #: Log odds of individual waves of full size against those of individual size.


def find_pattern(
    told: Sequence[tuple[Array, Array]], own: Array, shared: Array, orders: Ids
) -> Pattern | None:
    """Find the pattern that some joints share.

    The two joints with the best agreement start; others are added in the order of their odds. In the end the
    odds of each joint, given all others, must exceed `MIN_LOG_ODDS`.

    Mathematics: `abs-11`.

    Args:
        told: For every joint the precision of its waves from the readings, (2 k, 2 k), and its product with
            the most probable waves, (2 k,); zero for a joint without readings.
        own: Variance of waves that are individual to a joint, (2 k,).
        shared: Variance of the waves of the pattern, (2 k,).
        orders: Orders of the waves, (k,).

    Returns:
        The pattern; None if no two joints share one.
    """
    every = [_pattern_information(*one, own, own + shared) for one in told]

    def best(j: int, others: dict[int, tuple[float, int]]) -> tuple[float, int, float, int]:
        """Find the best shift and sign of a joint's pattern, given those of others.

        Args:
            j: The joint.
            others: Shift [rad] and sign of the joints that have the pattern.

        Returns:
            Shift [rad], sign, log odds, and the joint.
        """
        P, b = np.diag(1 / shared), np.zeros(len(shared))
        for i, (turn, sense) in others.items():
            R = shift_waves(np.eye(len(b)), turn, sense, orders)
            P, b = P + R @ every[i].W @ R.T, b + R @ every[i].g
        return (*_best(every[j], P, b, orders), j)

    # Start with the joint whose odds with the others are best.
    joints = range(len(every))
    pairs = [[best(j, {i: (0.0, 1)})[2] for j in joints if j != i] for i in joints]
    found = {int(np.argmax([np.maximum(own, 0).sum() for own in pairs])): (0.0, 1)}
    # Add the joint with the best odds, as long as they suffice.
    while len(found) < len(every):
        turn, sense, odds, j = max((best(j, found) for j in joints if j not in found), key=lambda one: one[2])
        if odds < MIN_LOG_ODDS:
            break
        found[j] = turn, sense
    # Remove joints whose odds, given all others, do not suffice.
    while len(found) > 1:
        again = [best(j, {i: at for i, at in found.items() if i != j}) for j in found]
        worst = min(again, key=lambda one: one[2])
        if worst[2] >= MIN_LOG_ODDS:
            return _of_first({j: (turn, sense) for turn, sense, _, j in again})
        del found[worst[3]]
    return None


def _pattern_information(precision: Array, pull: Array, own: Array, whole: Array) -> _PatternInformation:
    solved = np.linalg.solve(precision + np.diag(1 / own), np.column_stack([precision, pull]))
    alone, none = (_log_sum(precision + np.diag(1 / d), pull) - np.log(d).sum() / 2 for d in (whole, own))
    return _PatternInformation(
        precision - precision @ solved[:, :-1], pull - precision @ solved[:, -1], alone - none
    )


def _best(
    pattern_information: _PatternInformation, P: Array, b: Array, orders: Ids
) -> tuple[float, int, float]:
    """Find the shift and sign in which a joint has a pattern, and the log odds against all alternatives.

    Args:
        pattern_information: Information of the joint's readings.
        P: Precision of the pattern by the other joints, (2 k, 2 k).
        b: Its product with the most probable pattern, (2 k,).
        orders: Orders of the waves, (k,).
    """
    f = np.asarray(np.linalg.solve(P, b), dtype=float)
    before = _log_sum(P, b)

    def likely(turns: Array, sense: int) -> Array:
        """Compute the log-likelihood of the most probable pattern at many shifts.

        Args:
            turns: Shifts, (s,) [rad].
            sense: Sign of the pattern.

        Returns:
            Log-likelihoods up to a constant, (s,).
        """
        x = shift_waves(f, turns, sense, orders)
        return np.asarray(x @ pattern_information.g - ((x @ pattern_information.W) * x).sum(axis=1) / 2)

    every = np.stack([likely(TURNS, sense) for sense in SENSES])
    # Local maxima of the likelihood over the shift.
    peaks = (every > np.roll(every, 1, axis=1)) & (every >= np.roll(every, -1, axis=1))
    rivals, odds = (
        np.argwhere(peaks)[np.argsort(-every[peaks], kind="stable")[:RIVALS]],
        [pattern_information.alone],
    )
    # Evidence of each, the pattern integrated out.
    for way, k in rivals:
        R = shift_waves(np.eye(len(f)), TURNS[k], SENSES[way], orders)
        odds.append(_log_sum(P + R @ pattern_information.W @ R.T, b + R @ pattern_information.g) - before)
    first, *others = np.argsort(odds)[::-1]
    if not first:
        return 0.0, 1, odds[others[0]] - pattern_information.alone if others else 0.0
    way, k = rivals[first - 1]
    finer = TURNS[k] + FINER
    return float(finer[likely(finer, SENSES[way]).argmax()]), SENSES[way], odds[first] - odds[others[0]]


def _log_sum(P: Array, b: Array) -> float:
    """Compute the logarithm of the integral of exp(b x - x P x / 2), up to a constant."""
    return float(b @ np.linalg.solve(P, b) - np.linalg.slogdet(P)[1]) / 2


def _of_first(found: dict[int, tuple[float, int]]) -> Pattern:
    """Express the pattern in the angle of the first joint that has it."""
    joints = tuple(sorted(found))
    start, way = found[joints[0]]
    turns = tuple(float((way * (found[j][0] - start) + np.pi) % (2 * np.pi) - np.pi) for j in joints)
    return Pattern(joints, turns, tuple(way * found[j][1] for j in joints))
