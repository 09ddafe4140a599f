"""Joints as files and pendants count them, and as the chain turns: q_model = L q_file + q_0.

A pendant may count joint 3 from the horizontal, so that it moves with joint 2; a palletiser's hand is
levelled by joints that nobody commands. Both are this one linear map. Files, programs, plans and limits that
people read are in file joints; all mathematics is in the joints of the chain.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from testbench.errors import Array, BenchError, Ids, check_array, cut

ROUNDING = 1e-9  #: Singular value over the largest, or coefficient, that is rounding [1].
LARGEST = 1000.0  #: Of a coefficient [1].
LISTED = 100  #: Characters of names in a message.


class Coordinate(Protocol):
    """A joint of a chain, as far as a map asks."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def lower(self) -> float:
        """Lower limit [rad, m]."""

    @property
    def upper(self) -> float:
        """Upper limit [rad, m]."""

    @property
    def prismatic(self) -> bool:
        """Whether it slides."""


@dataclass(frozen=True, eq=False)
class JointMap:
    """q_model = L q_file + q_0, for n joints of a chain and m of files, m <= n."""

    names: tuple[str, ...]  #: File joints, m.
    prismatic: tuple[bool, ...]  #: Which of them are slides.
    slides: tuple[bool, ...]  #: Which chain joints are, n.
    L: Array  #: (n, m) [1].
    q_0: Array  #: (n,) [rad, m].
    #: Chain joints that the others follow, m: those that are a file joint first, then other independent rows.
    free: Ids
    inverse: Array  #: Of the free rows of L, (m, m) [1].
    #: How all joints move as the free ones do, (n, n), zero in the columns of those that follow [1].
    moves: Array

    @property
    def square(self) -> bool:
        """Whether no joint of the chain follows others."""
        return len(self.names) == len(self.q_0)

    def to_model(self, q: Array) -> Array:
        """Chain joints of file joints, (..., m) to (..., n) [rad, m]."""
        return np.asarray(q @ self.L.T + self.q_0)

    def to_file(self, q: Array) -> Array:
        """File joints of chain joints, (..., n) to (..., m) [rad, m]; joints that follow are not asked."""
        return self.change_to_file(q - self.q_0)

    def change_to_file(self, change: Array) -> Array:
        """A change of file joints from that of chain joints, (..., n) to (..., m) [rad, m]."""
        return np.asarray(change[..., self.free] @ self.inverse.T) + 0.0

    def torque_to_model(self, torque: Array) -> Array:
        """Torques of chain joints of those of file joints, (..., m) to (..., n) [N m, N].

        Both do the same work, so torque_file = L^T torque_model. BenchError where joints follow others.
        """
        if not self.square:
            raise BenchError("torques do not tell those of joints that follow others: leave them out")
        return np.asarray(torque @ self.inverse)

    def torque_to_file(self, torque: Array) -> Array:
        """Torques of file joints of those of chain joints, (..., n) to (..., m) [N m, N]."""
        return np.asarray(torque @ self.L)

    def followed(self, q: Array) -> Array:
        """The same poses, (..., n) [rad, m], with joints that follow where the free ones bring them."""
        if self.square:
            return q
        found = q.copy()
        others = np.setdiff1d(np.arange(len(self.q_0)), self.free)
        at = (q - self.q_0) @ self.moves.T + self.q_0
        found[..., others] = at[..., others]
        return found

    def follows(self, k: int) -> tuple[int, float, float] | None:
        """The one free chain joint that chain joint k follows, with multiplier and offset [1; rad, m].

        None where it is free itself, or follows none or several.
        """
        drivers = np.flatnonzero(self.moves[k])
        if k in self.free or len(drivers) != 1:
            return None
        j, c = int(drivers[0]), float(self.moves[k, drivers[0]])
        return j, c, float(self.q_0[k] - c * self.q_0[j])

    def words(self, k: int) -> str:
        """What chain joint k is in file joints, such as "joint_3 - joint_2"."""
        terms = [
            f"{'-' if c < 0 else '+'} {'' if abs(c) == 1 else f'{abs(c):.6g} '}{name}"
            for name, c in zip(self.names, self.L[k].tolist(), strict=True)
            if c
        ]
        if self.q_0[k]:
            size = 1e3 * self.q_0[k] if self.slides[k] else np.degrees(self.q_0[k])
            terms.append(f"{'-' if size < 0 else '+'} {abs(size):.6g} {'mm' if self.slides[k] else 'deg'}")
        text = " ".join(terms).removeprefix("+ ") or "0"
        return f"-{text[2:]}" if text.startswith("- ") else text


def build_map(
    joints: Sequence[Coordinate], rows: Mapping[str, Mapping[str, float]], q_0: Mapping[str, float]
) -> JointMap | None:
    """The map of a chain.

    File joints stand in the order of the chain: one named as a joint of the chain at its place, any other
    where it is needed first.

    Args:
        joints: Of the chain, n.
        rows: Coefficients of file joints, by the chain joint's name; a joint without a row is a file joint
            of its own [1].
        q_0: Offsets, by the chain joint's name, zero where there is none [rad, m].

    Returns:
        The map; None where every chain joint is the file joint of its name.

    Raises:
        BenchError: When rows leave a file joint open, or it would turn one joint and slide another.
    """
    known = {joint.name: k for k, joint in enumerate(joints)}
    own = {joint.name: rows.get(joint.name, {joint.name: 1.0}) for joint in joints}
    place: dict[str, tuple[int, int]] = {}
    for k, row in enumerate(own.values()):
        for name in (name for name, c in row.items() if c):
            place.setdefault(name, (known.get(name, k), len(place)))
    names = tuple(sorted(place, key=lambda name: place[name]))
    L = np.array([[float(row.get(name, 0.0)) for name in names] for row in own.values()])
    L = L.reshape(len(joints), len(names))
    offsets = np.array([q_0.get(joint.name, 0.0) for joint in joints])
    if names == tuple(known) and np.array_equal(L, np.eye(len(names))) and not offsets.any():
        return None
    L, offsets = check_array(L, (None, None), "coefficients"), check_array(offsets, (None,), "offsets")
    if np.abs(L).max(initial=0.0) > LARGEST:
        raise BenchError(f"expected coefficients up to {LARGEST:g}, got {np.abs(L).max():g}")
    alone = [k for k, (name, row) in enumerate(own.items()) if [n for n, c in row.items() if c] == [name]]
    free = _independent(L, sorted(range(len(L)), key=lambda k: k not in alone))
    if not names or len(free) < len(names):
        listed = cut(", ".join(names), LISTED) or "none"
        raise BenchError(f"expected file joints that the chain tells apart, got {listed}: rows depend")
    slides = np.array([joint.prismatic for joint in joints], dtype=bool)
    for j, name in enumerate(names):
        if len(set(slides[L[:, j] != 0].tolist())) > 1:
            raise BenchError(f"{name}: expected a file joint of hinges or of slides, got both")
    inverse = np.asarray(np.linalg.inv(L[free]), dtype=np.float64) + 0.0
    moves = np.zeros((len(L), len(L)))
    moves[:, free] = L @ inverse
    moves[np.abs(moves) <= ROUNDING] = 0.0
    prismatic = tuple(bool(slides[L[:, j] != 0][0]) for j in range(len(names)))
    return JointMap(names, prismatic, tuple(slides.tolist()), L, offsets, free, inverse, moves)


def _independent(L: Array, order: Sequence[int]) -> Ids:
    """Rows that are independent of all before them in an order, sorted."""
    found: list[int] = []
    for k in order:
        rows = L[[*found, k]]
        s = np.linalg.svd(rows, compute_uv=False)
        if len(rows) <= L.shape[1] and s[-1] > ROUNDING * max(1.0, s[0]):
            found.append(k)
    return np.array(sorted(found), dtype=int)


def file_limits(found: JointMap, joints: Sequence[Coordinate]) -> Array:
    """The least and the largest of every file joint within the chain's limits, (2, m) [rad, m]."""
    ends = (
        np.array([[joint.lower, joint.upper] for joint in joints])[found.free] - found.q_0[found.free, None]
    )
    parts = found.inverse[:, :, None] * ends
    return np.array([parts.min(axis=2).sum(axis=1), parts.max(axis=2).sum(axis=1)])


def narrowed(found: JointMap, joints: Sequence[Coordinate]) -> Array:
    """Limits of the chain joints, (2, n) [rad, m]: a joint that one other follows ends where that one does.

    Raises:
        BenchError: When nothing is left between the limits of a joint.
    """
    limits = np.array([[joint.lower, joint.upper] for joint in joints]).T
    D = found.moves
    for k in np.setdiff1d(np.arange(len(D)), found.free):
        drivers = np.flatnonzero(D[k])
        if len(drivers) > 1:
            continue
        if not len(drivers):
            if not limits[0, k] <= found.q_0[k] <= limits[1, k]:
                raise BenchError(f"{joints[k].name}: it is held beyond its limits")
            continue
        j = int(drivers[0])
        ends = found.q_0[j] + (limits[:, k] - found.q_0[k]) / D[k, j]
        low, high = max(limits[0, j], ends.min()), min(limits[1, j], ends.max())
        if not low < high:
            raise BenchError(f"{joints[j].name}: no angle of it is within the limits of {joints[k].name} too")
        limits[:, j] = low, high
    return limits
