"""The order of measuring: the shortest way through all poses; of very many, one that is almost as short.

A travelling salesman problem as an integer program: every pose has two of the chosen legs, and subtours are
forbidden as they show up (Dantzig, Fulkerson and Johnson 1954). A place at no distance from all others is
where the round trip is cut open. The relaxed program (legs between 0 and 1) bounds every trip from below; a
leg whose reduced cost exceeds the gap to a trip found is in no shorter one and is left out.

What is costly to ask of a leg, its surcharge, is asked only of legs that a best trip would take. Without it a
trip seems no longer than it is, so that the best one of which every leg was asked is the shortest.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, depth_first_order

from testbench.design.rows import Ids
from testbench.errors import Array

NEAR = 6  #: Nearest other places whose legs the relaxed program starts with.
GAP = 0.001  #: Share of the bound by which the first trip may be longer; the shortest is found from that.
EXACT, CLOSE = 101, 0.01
"""Most places, 100 poses and the cut, through which the shortest trip is found; with more, one at most this
share above the bound."""
PARTS, SLIGHT = (0.3, 0.5, 0.7, 0.9), 1e-3
"""Parts of legs above which places count as joined when subtours are looked for, and excess that counts."""
TINY = 1e-7  #: Of a leg in a solution, and of a reduced cost over the longest leg, which counts as zero.

Mask = npt.NDArray[np.bool_]
Surcharge = Callable[[int, int], float]
"""What a leg between two places costs beyond its travel, 0 or more."""


def joint_travel(q: Array) -> Array:
    """Travel between poses (poses, n) [rad, m]: that of the joint that turns farthest, (poses, poses)."""
    return np.asarray(np.abs(q[:, None] - q[None]).max(axis=2))


def shortest_path(cost: Array, surcharge: Surcharge = lambda _a, _b: 0.0) -> Ids:
    """The shortest way through all places, wherever it begins and ends, (places,); cost is symmetric.

    Equal places, at no distance, are one stop.
    """
    first = (cost == 0).argmax(axis=1)
    stops = np.unique(first)

    def beyond(a: int, b: int) -> float:
        return surcharge(int(stops[a - 1]), int(stops[b - 1])) if a else 0.0

    trip = round_trip(np.pad(cost[np.ix_(stops, stops)], (1, 0)), beyond)
    return np.concatenate([np.flatnonzero(first == stop) for stop in stops[trip[1:] - 1]])


def round_trip(cost: Array, surcharge: Surcharge = lambda _a, _b: 0.0) -> Ids:
    """The shortest round trip, (places,): it begins at place 0 and ends before it; cost is symmetric."""
    n = len(cost)
    if n <= 3:
        return np.arange(n)
    legs = np.stack(np.triu_indices(n, 1), axis=1)
    trip = _Trip(n, legs, cost[legs[:, 0], legs[:, 1]], surcharge, np.zeros(len(legs), dtype=bool))
    inside, wider, shortest = _near(cost)[legs[:, 0], legs[:, 1]], 1.0, math.inf
    while True:
        least, reduced = _relaxed(trip, inside)
        first = shortest == math.inf
        slack = wider * (GAP * least if first else shortest - least) + TINY * float(cost.max())
        solution = trip.best(np.flatnonzero(reduced <= slack), 0.0 if n <= EXACT else CLOSE / 2)
        if solution is None:
            wider *= 2
        elif trip.learns(solution[0]):
            continue
        elif first and (n <= EXACT or solution[1] > (1 + CLOSE) * least):
            shortest = solution[1]
        else:
            graph = trip.graph(solution[0])
            return np.asarray(depth_first_order(graph, 0, directed=False, return_predecessors=False))


def _near(cost: Array) -> Mask:
    """Legs to the nearest places and, so that there is a round trip, from each place to the next."""
    n = len(cost)
    rank = np.argsort(np.where(np.eye(n, dtype=bool), np.inf, cost), axis=1, kind="stable")
    near = np.zeros((n, n), dtype=bool)
    near[np.arange(n)[:, None], rank[:, :NEAR]] = True
    near[np.arange(n), np.roll(np.arange(n), 1)] = True
    return np.asarray(near | near.T)


@dataclass
class _Trip:
    """The integer program, which grows: what was asked of legs, and the subtours that are forbidden."""

    places: int
    legs: Ids  #: First and second place of all, (legs, 2).
    price: Array  #: Travel, and the surcharge where it was asked, (legs,).
    surcharge: Surcharge
    asked: Mask  #: Legs whose surcharge is known, (legs,).
    parts: list[Mask] = field(default_factory=list)  #: Places that no subtour may join, (places,) each.

    def rules(self, chosen: Ids) -> tuple[Array, Array, Array]:
        """Of some legs: those at every place (two of them), those inside every part, how many at most."""
        legs = self.legs[chosen]
        ends = np.zeros((self.places, len(legs)))
        ends[legs.T, np.arange(len(legs))] = 1
        inside = np.array([part[legs].all(axis=1) for part in self.parts], dtype=float)
        most = np.array([part.sum() - 1 for part in self.parts], dtype=float)
        return ends, inside.reshape(-1, len(legs)), most

    def best(self, chosen: Ids, gap: float) -> tuple[Ids, float] | None:
        """The best of some legs by the rules so far, up to a relative gap; None where they make no trip."""
        ends, inside, most = self.rules(chosen)
        rules = [LinearConstraint(ends, 2, 2), LinearConstraint(inside, ub=most)]
        found = milp(
            self.price[chosen],
            integrality=np.ones(len(chosen), dtype=int),
            bounds=Bounds(0, 1),
            constraints=rules,
            options={"mip_rel_gap": gap},
        )
        return None if found.x is None else (chosen[found.x > 0.5], float(found.fun))

    def worth(self, place: Array, part: Array) -> Array:
        """What every leg is worth by the duals of the rules, (places,) and (parts,) to (legs,)."""
        a, b = self.legs.T
        members = np.array(self.parts, dtype=float).reshape(-1, self.places)
        return np.asarray(place[a] + place[b] + (members.T @ (part[:, None] * members))[a, b])

    def learns(self, used: Ids) -> bool:
        """Ask the surcharge of legs and forbid their subtours; whether they cost more or are no trip."""
        before = self.price[used].sum()
        for k in used[~self.asked[used]]:
            self.price[k] += self.surcharge(*map(int, self.legs[k]))
        self.asked[used] = True
        count, part = connected_components(self.graph(used), directed=False)
        self.parts += [part == k for k in range(count)] if count > 1 else []
        return bool(count > 1 or self.price[used].sum() > before)

    def splits(self, chosen: Ids, x: Array) -> bool:
        """Forbid subtours that parts x of legs make where they are many, (legs,); whether there were any."""
        for least in PARTS:
            count, part = connected_components(self.graph(chosen[x > least]), directed=False)
            own = [part == k for k in range(count) if count > 1]
            inside = [x[places[self.legs[chosen]].all(axis=1)].sum() for places in own]
            over = [p for p, much in zip(own, inside, strict=True) if much > p.sum() - 1 + SLIGHT]
            if over:
                self.parts += over
                return True
        return False

    def graph(self, used: Ids) -> coo_array:
        """Places joined by legs."""
        a, b = self.legs[used].T
        return coo_array((np.ones(len(used)), (a, b)), shape=(self.places, self.places))


def _relaxed(trip: _Trip, inside: Mask) -> tuple[float, Array]:
    """Length that no round trip undercuts, and what each leg adds to it at least, its reduced cost, (legs,).

    Legs that would shorten the relaxed trip join those inside.
    """
    tiny = TINY * float(trip.price.max())
    while True:
        chosen = np.flatnonzero(inside)
        ends, within, most = trip.rules(chosen)
        twice = np.full(trip.places, 2.0)
        found = linprog(trip.price[chosen], A_ub=within, b_ub=most, A_eq=ends, b_eq=twice, bounds=(0, 1))
        assert found.x is not None, found.message  # from each place to the next is a trip
        reduced = trip.price - trip.worth(found.eqlin.marginals, found.ineqlin.marginals)
        joining = ~inside & (reduced < -tiny)
        if joining.any():
            inside |= joining
        elif not trip.learns(chosen[found.x > TINY]) and not trip.splits(chosen, found.x):
            return float(trip.price[chosen] @ found.x), reduced
