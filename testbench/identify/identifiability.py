"""What a dataset can tell of a structure and what it cannot, before any solve: the numbers.

Of n unknowns the data see as many directions as their rank. The others are lost to the structure (no
experiment on this arm sees them), to the loads and readings (no pose under these loads shows them), or to too
few poses. What the data see they see more or less well: the share of a parameter is what they take off the
variance that the prior leaves it, linear and Gaussian.
"""

from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.fold import reduce
from testbench.identify.identifiability_help import (
    Proposal,
    expected_error,
    more_poses,
    posterior,
    proposals,
    tasks,
    variances,
)
from testbench.identify.identifiability_unseen import (
    Direction,
    Ids,
    direction,
    directions,
    idle,
    null_space,
    whereabouts,
)
from testbench.identify.metric import Metric, metric, precision_root, whitened
from testbench.identify.prior import Prior, Strength, aggregate
from testbench.identify.regression import Regression, check_symmetric, generic_rows
from testbench.identify.weighed import marker_motion, marker_points
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

POSES = 60
"""Random poses under the loads of the data: what these do not see, no pose under these loads shows."""


@dataclass(frozen=True)
class Identifiability:
    """What the data see of a structure, and who decides the rest."""

    structure: Structure  #: The unknowns, n of them.
    component: tuple[str, ...]  #: Link or joint of every parameter, n names.
    entry: Array  #: Row and column of every parameter in its link's compliance, (n, 2); -1 for a joint.
    #: Joints that the structure has no parameter for: their springs count to the link before.
    in_links: tuple[str, ...]
    prior: str  #: Name of the prior.
    uncertainty: float  #: Its relative standard deviation u [1].
    rank: int  #: Directions that the data see.
    rank_of_loads: int  #: Directions that any number of poses under these loads and readings would see.
    rank_of_structure: int  #: Directions that any experiment would see.
    equations: int  #: Independent equations that the runs carry at most: 6 of a pose, load and full reading.
    poses: int  #: Different poses among the runs.
    lost_to_structure: tuple[Direction, ...]  #: Directions that no experiment sees.
    not_loaded: tuple[int, ...]  #: Parameters that no pose under these loads touches.
    lost_to_loads: tuple[Direction, ...]  #: Those that these loads and readings do not see in any pose.
    spread: Array  #: Of the directions lost to too few poses, how many each parameter holds, (n,).
    #: Of every parameter, what the data take off the prior's variance at a known scale, 0 to 1, (n,).
    share: Array
    error: float  #: RMS distance of predicted from true deflection to expect at random poses [m].
    deflection: float  #: RMS distance that the markers are expected to move there [m].
    proposals: tuple[Proposal, ...]  #: What would help, the best first.

    @property
    def lost_to_poses(self) -> int:
        """Directions lost to too few poses."""
        return self.rank_of_loads - self.rank

    @property
    def lost_to_experiment(self) -> int:
        """Directions that another experiment would see: lost to loads, readings or too few poses."""
        return self.rank_of_structure - self.rank


def describe(
    vjm: Vjm, structure: Structure, data: Dataset, prior: Prior, strength: Strength
) -> Identifiability:
    """What a dataset, of which only poses, loads and sigmas count, can tell of a structure, before any solve.

    Raises:
        BenchError: When the dataset is empty or of another arm, the prior has another size or is not positive
            definite, or the structure leaves the symmetry open.
    """
    return of_regression(vjm, reduce(vjm, structure, data), data, prior, strength)


def of_regression(
    vjm: Vjm, regression: Regression, data: Dataset, prior: Prior, strength: Strength
) -> Identifiability:
    """The same of a regression; the dataset may be some of its runs, evenly out of all."""
    structure = regression.structure
    scaled = any_metric(prior, vjm, structure)
    own, loads = _rows(vjm, regression, data)
    unit = _unit(prior, vjm, structure)
    to_structure, to_loads = _unseen(vjm, structure, loads, unit)
    wanted, (B, _) = tasks(vjm, data, scaled), precision_root(scaled, strength)
    R = posterior(whitened(regression, scaled)[0], B)
    component, entry = _places(vjm, structure)
    return Identifiability(
        structure=structure,
        component=component,
        entry=entry,
        in_links=tuple(set_aside(vjm, structure)),
        prior=prior.name,
        uncertainty=strength.uncertainty,
        rank=structure.n - null_space(own).shape[1],
        rank_of_loads=structure.n - len(to_structure) - len(to_loads),
        rank_of_structure=structure.n - len(to_structure),
        equations=_equations(vjm, data),
        poses=len(np.unique(data.q, axis=0)),
        lost_to_structure=to_structure,
        not_loaded=tuple(np.flatnonzero(idle(loads)).tolist()),
        lost_to_loads=to_loads,
        spread=whereabouts(null_space(own), null_space(loads), unit),
        share=_share(R, scaled, strength),
        error=expected_error(wanted, R),
        deflection=wanted.deflection,
        proposals=proposals(vjm, data, regression, scaled, B),
    )


def told(vjm: Vjm, regression: Regression, prior: Prior, strength: Strength) -> tuple[tuple[str, ...], Array]:
    """Link or joint of every parameter, and what the data take off its prior's variance, (n,)."""
    scaled = any_metric(prior, vjm, regression.structure)
    R = posterior(whitened(regression, scaled)[0], precision_root(scaled, strength)[0])
    return _places(vjm, regression.structure)[0], _share(R, scaled, strength)


def _rows(vjm: Vjm, regression: Regression, data: Dataset) -> tuple[Array, Array]:
    """What the data see, and what they and many more poses under their loads would see, (rows, n) each."""
    own = np.vstack([term.R for term in regression.terms])
    everywhere = reduce(vjm, regression.structure, more_poses(vjm, data, POSES, seed=0))
    return own, np.vstack([own, *(term.R for term in everywhere.terms)])


def _places(vjm: Vjm, structure: Structure) -> tuple[tuple[str, ...], Array]:
    """Link or joint of every parameter, and its row and column there, (n, 2); -1 for a joint."""
    links = 6 * len(vjm.arm.links)
    of_joint = structure.a >= links
    names = [*(link.name for link in vjm.arm.links), *(joint.name for joint in vjm.arm.joints)]
    where = np.where(of_joint, len(vjm.arm.links) + structure.a - links, structure.a // 6)
    entry = np.where(of_joint, -1, np.array([structure.a, structure.b]) % 6).T
    return tuple(names[k] for k in where), entry


def any_metric(prior: Prior, vjm: Vjm, structure: Structure) -> Metric:
    """The metric of the prior; for blocks that lack entries that of its entries taken one by one.

    It refuses what `metric` refuses, but for the entries that are lacking.
    """
    check_symmetric(structure)
    if structure.whole:
        return metric(prior, vjm, structure)
    pairs = [(a, b) for block in structure.blocks for b in block for a in block if a <= b]
    a, b = np.array(pairs).T
    metric(prior, vjm, replace(structure, a=a, b=b))  # refuses a bad prior
    size = _unit(prior, vjm, structure) * np.where(structure.a == structure.b, 1, np.sqrt(0.5))
    expected = structure.entries(aggregate(prior.C_theta, vjm, structure)) / size
    return Metric(prior.name, structure, np.diag(size), expected, ())


def set_aside(vjm: Vjm, structure: Structure) -> list[str]:
    """Joints that the structure has no parameter for, but the link before them."""
    used, first = np.union1d(structure.a, structure.b), 6 * len(vjm.arm.links)
    return [
        joint.name
        for j, joint in enumerate(vjm.arm.joints)
        if first + j not in used and np.isin(np.arange(6 * j, 6 * j + 6), used).any()
    ]


def _unit(prior: Prior, vjm: Vjm, structure: Structure) -> Array:
    """What is expected of every parameter: sqrt(P_aa P_bb), (n,)."""
    d = np.sqrt(np.diag(aggregate(prior.C_theta, vjm, structure)))
    return np.asarray(d[structure.a] * d[structure.b])


def _unseen(
    vjm: Vjm, structure: Structure, loads: Array, unit: Array
) -> tuple[tuple[Direction, ...], tuple[Direction, ...]]:
    """Directions lost to the structure, and to the loads."""
    groups, none = _groups(vjm, structure), np.zeros((0, structure.n))
    to_structure = directions(generic_rows(vjm, structure), unit, groups, none)
    to_loads = directions(loads, unit, groups, to_structure)
    return tuple(map(direction, to_structure)), tuple(map(direction, to_loads))


def _groups(vjm: Vjm, structure: Structure) -> list[Ids]:
    """Parameters of every link and joint, in the order of the chain."""
    links = len(vjm.arm.links)
    place = np.where(structure.a < 6 * links, structure.a // 6 * 2, (structure.a - 6 * links) * 2 + 1)
    return [np.flatnonzero(place == k) for k in np.unique(place)]


def _share(R: Array | None, scaled: Metric, strength: Strength) -> Array:
    """What the data take off the prior's variance of every parameter, (n,).

    The prior's variance is that at a known common scale: what the data tell of all parameters by fixing
    the scale is not counted as seeing one of them.
    """
    before = strength.uncertainty**2 * (scaled.L**2).sum(axis=1)
    return np.asarray(np.clip(1 - variances(R, scaled.L) / before, 0, 1))


def _equations(vjm: Vjm, data: Dataset) -> int:
    """Different poses and loads, times the equations of one reading of a rigid tool."""
    different = np.unique(np.hstack([data.q, data.wrench, data.point]), axis=0)
    if data.rotation_before is not None:
        return 6 * len(different)
    motion = marker_motion(marker_points(vjm, data.markers))
    return int(np.linalg.matrix_rank(motion)) * len(different)
