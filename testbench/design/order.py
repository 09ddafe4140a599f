"""The order of measuring: the shortest way through all poses, as an integer program.

It is a travelling salesman problem. Every pose has two of the chosen legs, and subtours are forbidden as they
appear (Dantzig, Fulkerson and Johnson 1954). A place at distance zero from all others is where the round trip
is cut open. Programs over legs to near places come first, and linear relaxations before integer ones: these
cheaper programs show most subtours, and most surcharges, sooner. More than `MAX_EXACT_PLACES` places use legs
to near places only.

A surcharge of a leg, such as a collision check, is expensive to compute. It is asked only for legs that a
best trip uses. Without it a trip seems no longer than it is. So the best trip whose legs were all asked is
the shortest.
"""

import itertools
from collections.abc import Callable

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, depth_first_order

from testbench.errors import Array, Ids, Mask

MAX_NEIGHBOURS = 12  #: Nearest other places of each place whose legs come first.
ZERO_LEG = 1e-7  #: Part of a leg that counts as zero in a linear relaxation [1].
MAX_EXACT_PLACES = 101  #: Most places whose legs are all tried: 100 poses and the cut.

Surcharge = Callable[[int, int], float]
"""Function of two places to the cost of their leg beyond its travel, 0 or more."""


def joint_travel(q: Array) -> Array:
    """Compute the travel between all pairs of poses: that of the joint that moves farthest.

    Mathematics: `pose-14`.

    Args:
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        Travel, symmetric, (poses, poses) [rad, m].
    """
    return np.asarray(np.abs(q[:, None] - q[None]).max(axis=2))


def shortest_path(cost: Array, surcharge: Surcharge = lambda _a, _b: 0.0) -> Ids:
    """Find the shortest way through all places, whatever place it begins and ends at.

    Places at distance zero of each other are visited together.

    Args:
        cost: Length of every leg, symmetric, zero on the diagonal, (places, places).
        surcharge: Function of two places that gives what their leg costs beyond its length, 0 or more.

    Returns:
        Indices of the places in order, (places,). Optimal up to `MAX_EXACT_PLACES` - 1 places.
    """
    first = (cost == 0).argmax(axis=1)
    stops = np.unique(first)

    def beyond(a: int, b: int) -> float:
        return surcharge(int(stops[a - 1]), int(stops[b - 1])) if a else 0.0

    trip = round_trip(np.pad(cost[np.ix_(stops, stops)], (1, 0)), beyond)
    return np.concatenate([np.flatnonzero(first == stop) for stop in stops[trip[1:] - 1]])


def round_trip(cost: Array, surcharge: Surcharge = lambda _a, _b: 0.0) -> Ids:
    """Find the shortest round trip through all places.

    Args:
        cost: Length of every leg, symmetric, (places, places).
        surcharge: Function of two places that gives what their leg costs beyond its length, 0 or more.

    Returns:
        Indices of the places in order, from place 0 to the last one before it, (places,). Optimal up to
        `MAX_EXACT_PLACES` places; beyond, the shortest that uses legs to near places only.
    """
    n = len(cost)
    if n <= 3:
        return np.arange(n)
    every = np.stack(np.triu_indices(n, 1), axis=1)
    price, asked = cost[every[:, 0], every[:, 1]], np.zeros(len(every), dtype=bool)
    parts: list[Mask] = []  # places that no subtour may join, (places,) each
    near = _near(cost)[every[:, 0], every[:, 1]]
    legs = (near, np.ones_like(near)) if n <= MAX_EXACT_PLACES else (near,)
    # near legs relaxed, then whole; all legs relaxed, then whole: each keeps the rules found before
    for chosen, whole in itertools.product(legs, (False, True)):
        while True:
            # the best trip under the subtours and surcharges known so far
            used = np.flatnonzero(chosen)[_best_legs(every[chosen], price[chosen], parts, n, whole)]
            before = price[used].sum()
            # its legs that were not asked yet get their surcharge
            for k in used[~asked[used]]:
                price[k] += surcharge(*map(int, every[k]))
            asked[used] = True
            # every part that is no round trip through all places becomes a forbidden subtour
            graph = coo_array((np.ones(len(used)), every[used].T), shape=(n, n))
            count, part = connected_components(graph, directed=False)
            parts += [part == k for k in range(count) if count > 1]
            # one trip whose surcharges were known: no other is shorter
            if count == 1 and price[used].sum() <= before:
                break
    return np.asarray(depth_first_order(graph, 0, directed=False, return_predecessors=False))


def _near(cost: Array) -> Mask:
    """Select legs to the nearest places and, so that there is a round trip, from each place to the next."""
    n = len(cost)
    rank = np.argsort(np.where(np.eye(n, dtype=bool), np.inf, cost), axis=1, kind="stable")
    near = np.zeros((n, n), dtype=bool)
    near[np.arange(n)[:, None], rank[:, :MAX_NEIGHBOURS]] = True
    near[np.arange(n), np.roll(np.arange(n), 1)] = True
    return np.asarray(near | near.T)


def _best_legs(legs: Ids, price: Array, parts: list[Mask], n: int, whole: bool) -> Ids:
    """Choose the cheapest legs, (legs, 2), two per place, without a subtour in any of the parts.

    Where whole is False, legs may be used in part: the linear relaxation.
    """
    ends = np.zeros((n, len(legs)))
    ends[legs.T, np.arange(len(legs))] = 1
    inside = np.array([part[legs].all(axis=1) for part in parts], dtype=float).reshape(-1, len(legs))
    rules = [LinearConstraint(ends, 2, 2), LinearConstraint(inside, ub=[part.sum() - 1 for part in parts])]
    integrality = np.full(len(legs), int(whole))
    found = milp(price, integrality=integrality, bounds=Bounds(0, 1), constraints=rules)
    assert found.x is not None, found.message  # from each place to the next is a trip
    return np.flatnonzero(found.x > (0.5 if whole else ZERO_LEG))
