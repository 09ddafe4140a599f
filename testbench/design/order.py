"""The order of measuring: the shortest way through all poses, exactly.

A travelling salesman problem as an integer program: every pose has two of the chosen legs, and subtours are
forbidden as they show up (Dantzig, Fulkerson and Johnson 1954). A place at no distance from all others is
where the round trip is cut open.
"""

import itertools

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, depth_first_order

from testbench.design.rows import Ids
from testbench.errors import Array


def joint_travel(q: Array) -> Array:
    """Travel between poses (poses, n) [rad]: that of the joint that turns farthest, (poses, poses)."""
    return np.asarray(np.abs(q[:, None] - q[None]).max(axis=2))


def shortest_path(cost: Array) -> Ids:
    """The shortest way through all places, wherever it begins and ends, (places,); cost is symmetric."""
    return round_trip(np.pad(cost, (1, 0)))[1:] - 1


def round_trip(cost: Array) -> Ids:
    """The shortest round trip, (places,): it begins at place 0 and ends before it; cost is symmetric."""
    n = len(cost)
    if n <= 3:
        return np.arange(n)
    legs = np.array(list(itertools.combinations(range(n), 2)))
    each = np.arange(len(legs))
    ends = coo_array((np.ones(2 * len(legs)), (legs.T.ravel(), np.tile(each, 2))), shape=(n, len(legs)))
    rules = [LinearConstraint(csr_array(ends), 2, 2)]
    price = cost[legs[:, 0], legs[:, 1]]
    while True:
        solution = milp(
            price, integrality=np.ones(len(legs), dtype=int), bounds=Bounds(0, 1), constraints=rules
        )
        assert solution.x is not None, solution.message  # a full graph always has a round trip
        used = legs[solution.x > 0.5]
        graph = coo_array((np.ones(len(used)), (used[:, 0], used[:, 1])), shape=(n, n))
        count, part = connected_components(graph, directed=False)
        if count == 1:
            return np.asarray(depth_first_order(graph, 0, directed=False, return_predecessors=False))
        for k in range(count):
            inside = (part[legs] == k).all(axis=1)
            rules.append(LinearConstraint(inside[None].astype(float), ub=(part == k).sum() - 1))
