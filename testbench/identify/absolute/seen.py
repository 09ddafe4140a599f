"""What readings leave open of a calibration's unknowns, and what hides behind what: in words.

In units of the prior the unknowns have the information 1 + L^T M L, L L^T the prior's covariance. A quantity
is open where much of its prior variance is left. If little of that were left, were all else known, it hides:
behind what, once known, would take most of the rest away.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from testbench.errors import Array, check_array
from testbench.identify.absolute.pull import POSES, Pull
from testbench.identify.absolute.quantities import Quantity, quantities
from testbench.identify.absolute.structural import Structural, structural
from testbench.identify.absolute.unknowns import Unknowns

OPEN = 0.5  #: Share of the prior variance left from which on a quantity is open [1].
HIDES = 0.5
"""Share of what is left, were all else known and were what it hides behind, below which a quantity hides:
else it is unseen, or behind a little of everything."""
ENOUGH, MOST = 0.7, 3
"""Share of what is left that has to go with what it hides behind, and how many those may be."""
HELPS = 0.8  #: Share of what is left after a joint was turned below which turning it helps.
LOOSE = 0.01
"""Standard deviation of what has no prior, frames and mounts [m, rad]: much more than readings leave of it,
and not so much that rounding would hide the rest."""
PINNED = 1e8  #: Information that holds structural directions, in units of the prior.
FLAT = 0.01  #: Share of a quantity's prior variance outside structural directions that does not count.
RIDGE, TINY = 1e-12, 1e-100
"""Share of a covariance that is added to it, and how much of what is known: that has none."""

Kind = Literal["structural", "behind", "unseen"]


@dataclass(frozen=True)
class Hidden:
    """Something that readings leave open."""

    kind: Kind  #: Whether no pose could show it, or it hides behind others, or nothing shows it here.
    what: str  #: Such as "joint_3's offset"; the whole sentence where it is structural.
    behind: tuple[str, ...] = ()  #: What it hides behind, the most important first.
    share: float = 1.0  #: Of its prior variance left [1].
    correlation: float = 0.0  #: With what it hides behind, after the readings, multiple [1].
    advice: str = ""  #: What would show it; nothing where it was not asked for.

    @property
    def words(self) -> str:
        """A sentence."""
        if self.kind == "structural":
            return self.what
        left, then = (
            f"{100 * self.share:.0f} % of its prior variance left",
            self.advice and f": {self.advice}",
        )
        if self.kind == "unseen":
            return f"{self.what} is not seen ({left}){then}"
        behind = " and ".join(filter(None, [", ".join(self.behind[:-1]), self.behind[-1]]))
        return f"{self.what} hides behind {behind} (correlation {self.correlation:.2f}, {left}){then}"


def hidden(
    unknowns: Unknowns, information: Array, prior: Array, pull: Pull | None = None
) -> tuple[Hidden, ...]:
    """What stays unknown: structural directions, then the arm's own quantities, the most open first.

    Args:
        unknowns: Whose columns they are.
        information: Of the readings, no prior, (size, size).
        prior: Variances, (size,), infinite where there is no prior, zero of what is taken to be zero; or
            their covariance, (size, size).
        pull: What further poses would tell, `pull_of`; None leaves advice and what is structural unsaid.

    Returns:
        Each with its `.words`.
    """
    L = _root(prior, unknowns.size)
    M = _in_units(L, check_array(information, (unknowns.size,) * 2, "information"))
    never = Structural((), np.zeros((unknowns.size, 0))) if pull is None else structural(unknowns, L, pull)
    pins = PINNED * never.directions @ never.directions.T
    more = () if pull is None else (*pull.turned, pull.everywhere)
    after = tuple(_covariance(M + _in_units(L, extra) + pins) for extra in more)
    names = tuple(joint.name for joint in unknowns.vjm.arm.joints)
    view = _View(quantities(unknowns), L, M, _covariance(M + pins), never.directions, after, names)
    found = [view.look(k) for k, one in enumerate(view.every) if one.part not in ("frame", "mount")]
    own = sorted((one for one in found if one), key=lambda one: (one.kind != "behind", -one.share))
    return (*(Hidden("structural", words) for words in never.words), *_once(own))


def _root(prior: Array, size: int) -> Array:
    """L with L L^T the prior's covariance, (size, size)."""
    if prior.ndim == 2:
        on = np.flatnonzero(np.diag(check_array(prior, (size, size), "prior")))
        L = np.zeros((size, size))
        L[np.ix_(on, on)] = np.linalg.cholesky(prior[np.ix_(on, on)])
        return L
    return np.diag(np.sqrt(check_array(np.where(np.isinf(prior), LOOSE**2, prior), (size,), "prior")))


def _in_units(L: Array, M: Array) -> Array:
    """Information in units of the prior; a root of variances alone is no product of matrices."""
    d = np.diag(L)
    return d[:, None] * M * d if np.count_nonzero(L) == np.count_nonzero(d) else np.asarray(L.T @ M @ L)


def _covariance(M: Array) -> Array:
    return np.asarray(np.linalg.inv(np.eye(len(M)) + M))


def _once(found: list[Hidden]) -> list[Hidden]:
    """Those that hide behind each other are said once."""
    kept: dict[object, Hidden] = {}
    for one in found:
        kept.setdefault(one.what if one.kind == "unseen" else frozenset((one.what, *one.behind)), one)
    return list(kept.values())


@dataclass(frozen=True)
class _View:
    """Unknowns in units of the prior, as the readings show them."""

    every: tuple[Quantity, ...]
    L: Array  #: Unknowns per unit, (size, size).
    M: Array  #: Information of the readings.
    S: Array  #: Covariance after them, structural directions known.
    never: Array  #: Those, orthonormal, (size, k).
    after: tuple[Array, ...]  #: S after each joint was turned, and after all were; empty where not tried.
    joints: tuple[str, ...]

    @cached_property
    def parts(self) -> list[slice]:
        """Rows of every quantity in `H`."""
        ends = np.cumsum([len(one.H) for one in self.every]).tolist()
        return [slice(end - len(one.H), end) for end, one in zip(ends, self.every, strict=True)]

    @cached_property
    def H(self) -> Array:
        """All quantities per unit."""
        return np.vstack([one.H for one in self.every]) @ self.L

    @cached_property
    def K(self) -> Array:
        """Their covariance after the readings."""
        return self.H @ self.S @ self.H.T

    def look(self, k: int) -> Hidden | None:
        """What there is to say of a quantity, None if it is known."""
        own, unit = self.parts[k], self._unit(k)
        if not len(unit) or (share := _mean(unit, self.K[own, own])) < OPEN:
            return None
        name, advice = self.every[k].name, self._advice(unit @ self.H[own], share)
        behind, rest = self._behind(k, unit) if self._alone(k) < HIDES * share else ((), share)
        if rest > HIDES * share:
            return Hidden("unseen", name, share=share, advice=advice)
        return Hidden("behind", name, behind, share, float(np.sqrt(max(0.0, 1 - rest / share))), advice)

    def _unit(self, k: int) -> Array:
        """Combinations of a quantity's numbers of unit prior variance beside structural directions."""
        H = self.H[self.parts[k]]
        free = H - (H @ self.never) @ self.never.T
        values, V = np.linalg.eigh(free @ free.T)
        own = values > FLAT * np.square(H).sum() / len(H)
        return np.asarray((V[:, own] / np.sqrt(values[own])).T)

    def _alone(self, k: int) -> float:
        """Share of its prior variance left, were all else known."""
        off = np.diag(np.where(np.diag(self.L) > 0, 0.0, 1.0))
        H, move = self.H[self.parts[k]], np.linalg.solve(self.L + off, self.every[k].H.T)
        left = np.linalg.inv(move.T @ move + move.T @ self.M @ move)
        return float(np.trace(np.linalg.solve(H @ H.T, left)) / len(H))

    def _behind(self, k: int, unit: Array) -> tuple[tuple[str, ...], float]:
        """What takes most away, once known, and the share left then."""
        rows, own = np.arange(len(self.H)), self.parts[k]

        def left(known: list[int]) -> float:
            at = np.concatenate([rows[self.parts[i]] for i in known])
            C, X = self.K[np.ix_(at, at)], self.K[own, at]
            ridge = (RIDGE * np.trace(C) / len(C) + TINY) * np.eye(len(C))
            return _mean(unit, self.K[own, own] - X @ np.linalg.solve(C + ridge, X.T))

        found: list[int] = []
        share = first = _mean(unit, self.K[own, own])
        while len(found) < MOST and share > (1 - ENOUGH) * first:
            others = [i for i in range(len(self.every)) if i != k and i not in found]
            rest = [left([*found, i]) for i in others]
            best = int(np.argmin(rest))
            found, share = [*found, others[best]], rest[best]
        return tuple(self.every[i].name for i in found), share

    def _advice(self, H: Array, share: float) -> str:
        """Which joint to turn, by numbers of unit prior variance (k, size)."""
        if not self.after:
            return ""
        *each, everywhere = (float((H @ S * H).sum() / len(H)) for S in self.after)
        best = int(np.argmin(each))
        if each[best] < HELPS * share:
            return f"turn {self.joints[best]} more"
        if everywhere < HELPS * share:
            return "turn several joints together"
        return f"{POSES} more poses hardly help, another load may"


def _mean(unit: Array, K: Array) -> float:
    """Mean variance of combinations (k, n) of numbers of a covariance (n, n)."""
    return float(np.trace(unit @ K @ unit.T) / len(unit))
