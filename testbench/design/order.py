"""The order of measuring: the shortest way through all poses; of very many, by legs to near ones.

A travelling salesman problem as an integer program: every pose has two of the chosen legs, and subtours are
forbidden as they show up (Dantzig, Fulkerson and Johnson 1954). A place at no distance from all others is
where the round trip is cut open. Legs to near places come first, and parts of legs before whole ones: these
cheaper programs show most subtours, and most surcharges, sooner.

What is costly to ask of a leg, its surcharge, is asked only of legs that a best trip would take. Without it a
trip seems no longer than it is, so that the best one of which every leg was asked is the shortest.
"""

import itertools
from collections.abc import Callable

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, depth_first_order

from testbench.errors import Array, Ids, Mask

NEAR = 12  #: Nearest other places whose legs come first.
TINY = 1e-7  #: Part of a leg that counts as none.
EXACT = 101  #: Most places, 100 poses and the cut, of which all legs are tried.

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
    every = np.stack(np.triu_indices(n, 1), axis=1)
    price, asked = cost[every[:, 0], every[:, 1]], np.zeros(len(every), dtype=bool)
    parts: list[Mask] = []  # places that no subtour may join, (places,) each
    near = _near(cost)[every[:, 0], every[:, 1]]
    legs = (near, np.ones_like(near)) if n <= EXACT else (near,)
    for chosen, whole in itertools.product(legs, (False, True)):
        while True:
            used = np.flatnonzero(chosen)[_best_legs(every[chosen], price[chosen], parts, n, whole)]
            before = price[used].sum()
            for k in used[~asked[used]]:
                price[k] += surcharge(*map(int, every[k]))
            asked[used] = True
            graph = coo_array((np.ones(len(used)), every[used].T), shape=(n, n))
            count, part = connected_components(graph, directed=False)
            parts += [part == k for k in range(count) if count > 1]
            if count == 1 and price[used].sum() <= before:
                break
    return np.asarray(depth_first_order(graph, 0, directed=False, return_predecessors=False))


def _near(cost: Array) -> Mask:
    """Legs to the nearest places and, so that there is a round trip, from each place to the next."""
    n = len(cost)
    rank = np.argsort(np.where(np.eye(n, dtype=bool), np.inf, cost), axis=1, kind="stable")
    near = np.zeros((n, n), dtype=bool)
    near[np.arange(n)[:, None], rank[:, :NEAR]] = True
    near[np.arange(n), np.roll(np.arange(n), 1)] = True
    return np.asarray(near | near.T)


def _best_legs(legs: Ids, price: Array, parts: list[Mask], n: int, whole: bool) -> Ids:
    """The cheapest legs (legs, 2), two at every place, no subtour in any of the parts; or parts of legs."""
    ends = np.zeros((n, len(legs)))
    ends[legs.T, np.arange(len(legs))] = 1
    inside = np.array([part[legs].all(axis=1) for part in parts], dtype=float).reshape(-1, len(legs))
    rules = [LinearConstraint(ends, 2, 2), LinearConstraint(inside, ub=[part.sum() - 1 for part in parts])]
    integrality = np.full(len(legs), int(whole))
    found = milp(price, integrality=integrality, bounds=Bounds(0, 1), constraints=rules)
    assert found.x is not None, found.message  # from each place to the next is a trip
    return np.flatnonzero(found.x > (0.5 if whole else TINY))
