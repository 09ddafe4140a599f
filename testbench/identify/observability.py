"""Observability by the readings: unobservable directions, and unknowns that cannot be separated.

A null space has no axes of its own. It is searched from small sets of unknowns to large ones: one link or
joint, then neighbours along the chain. Elimination with pivots chosen by size gives a basis of circuits: each
direction has the fewest parameters that can compensate each other, all in units of their expectation.

With a prior, a quantity is undetermined if much of its prior variance remains after the readings. If little
of it would remain once all other unknowns were known, it is confounded: with those unknowns that, once known,
would remove most of it.

Identifiability of a structure from runs, before any fit, and what else to measure.

Of n unknowns the data see as many directions as their rank. The others are lost to the structure (no
experiment on this arm sees them), to the loads and readings (no pose under these loads shows them), or to too
few poses. What the data see they see more or less well: the share of a parameter is what they take off the
variance that the prior leaves it, linear and Gaussian.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, Ids, Mask
from testbench.identify.posterior import Posterior, conditional_covariance
from testbench.identify.prior import (
    Prior,
    PriorScaling,
    PriorUncertainty,
    aggregate_left_out_joints,
    prior_rows,
    rows_in_prior_units,
    scale_by_prior,
)
from testbench.identify.regression import (
    RANK_TOLERANCE,
    ZERO_COLUMN,
    Regression,
    check_symmetric,
    generic_observation_matrix,
    rank,
    reduce,
)
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, evaluate_chain, marker_positions, observation_matrix, rigid_motion_matrix

# --- Directions that readings do not show, and unknowns that they cannot separate --------------------------

PARTICIPATION_SHARE = 0.15
"""Least change of a parameter, relative to the largest change, that counts as part of a direction [1]."""
ZERO_ENTRY = 1e-7
"""Share of the largest entry below which an entry of a direction counts as zero [1]."""
MIN_NEW_SHARE = 1e-5
"""Share of a direction outside those found before from which it counts as new [1]."""
NEIGHBOURS = (1, 2, 3, 5)
"""Numbers of neighbouring links and joints that are searched together, before all are."""
UNDETERMINED_SHARE = 0.5
"""Share of the prior variance that remains from which a quantity counts as undetermined [1]."""
CONFOUNDED_SHARE = 0.5
"""Share of the remaining variance, once all others or the confounded ones were known, below which a quantity
counts as confounded [1]; otherwise it is unobservable, or confounded with a little of everything."""
MIN_EXPLAINED, MAX_CONFOUNDERS = 0.7, 3
"""Share of the remaining variance that must vanish with the confounded quantities [1], and most of those."""
HELPFUL_SHARE = 0.8
"""Share of the remaining variance after one joint was turned below which turning it helps [1]."""
STRUCTURAL_INFORMATION = 1e8
"""Information that fixes structural directions, in units of the prior."""
NEGLIGIBLE_OUTSIDE = 0.01
"""Share of a quantity's prior variance outside structural directions that counts as zero [1]."""


@dataclass(frozen=True)
class Direction:
    """Describe parameters that compensate each other: they can change together without changing a reading."""

    #: Their indices, the largest change first, relative to their expectation.
    parameters: tuple[int, ...]
    #: Those that change as well, but less than `PARTICIPATION_SHARE` of it, in the same order.
    minor_parameters: tuple[int, ...]


@dataclass(frozen=True)
class ObservedQuantity:
    """Describe a quantity that can be named in reports."""

    name: str  #: Name, such as "joint_3's offset".
    H: Array  #: Jacobian of its k numbers with respect to the unknowns, (k, size).
    #: Whether it belongs to the arm; otherwise arm quantities are only confounded with it.
    belongs_to_arm: bool = True


@dataclass(frozen=True)
class UndeterminedQuantity:
    """Describe a quantity that the readings leave undetermined."""

    name: str  #: Name of the quantity.
    #: Quantities with which it is confounded, most important first; empty if it is unobservable.
    confounded_with: tuple[str, ...] = ()
    share: float = 1.0  #: Share of its prior variance that remains [1].
    correlation: float = 0.0  #: Multiple correlation with these quantities, given the readings [1].
    #: Joint to turn; the number of joints if no single one suffices, -1 if no joint helps; None if
    #: it was not requested.
    joint_to_turn: int | None = None


def null_space(A: Array) -> Array:
    """Compute a basis of the null space, (n, n - rank), of rows whose columns differ in unit, (rows, n).

    Mathematics: `obs-5`.
    """
    n = A.shape[1]
    seen = np.flatnonzero(~zero_columns(A))
    norm = np.linalg.norm(A, axis=0)
    if not len(seen):
        return np.eye(n)
    triangular: Array = np.asarray(np.linalg.qr(A[:, seen] / norm[seen], mode="r"))
    _, s, Vt = np.linalg.svd(triangular)
    rank = int((s > RANK_TOLERANCE * s[0]).sum())
    N = np.zeros((n, n - rank))
    N[seen, : len(seen) - rank] = Vt[rank:].T / norm[seen, None]
    N[np.setdiff1d(np.arange(n), seen), np.arange(len(seen) - rank, n - rank)] = 1
    return N


def directions(A: Array, unit: Array, groups: Sequence[Ids], known_directions: Array) -> Array:
    """Find a sparse basis of the unobservable directions of a matrix, beyond those that are known.

    Args:
        A: Rows, (rows, n).
        unit: Expected size of every parameter, (n,) [m/N, rad/(N m), rad/N].
        groups: Parameters of every link and joint, in the order of the chain.
        known_directions: Unobservable directions that are known already, (m, n).

    Returns:
        Further directions, (k, n).
    """
    R: Array = np.array(np.linalg.qr(A, mode="r"))
    R[:, zero_columns(A)] = 0
    missing = null_space(R).shape[1] - len(known_directions)
    basis = np.zeros((0, A.shape[1]))
    Q = np.linalg.qr(known_directions.T)[0].T  # orthonormal rows: known, then found
    for window in _neighbouring_groups(groups):
        if len(basis) >= missing:
            break
        rows = circuits(null_space(R[:, window]), unit[window])
        T = np.zeros((len(rows), A.shape[1]))
        T[:, window] = rows
        for row in T[np.argsort((np.abs(T) > ZERO_ENTRY).sum(axis=1), kind="stable")]:
            new = row / np.linalg.norm(row)
            for _ in range(2):  # twice is enough
                new = new - (Q @ new) @ Q
            if np.linalg.norm(new) > MIN_NEW_SHARE:
                basis = np.vstack([basis, row])
                Q = np.vstack([Q, new / np.linalg.norm(new)])
    return basis


def zero_columns(A: Array) -> Mask:
    """Tell which columns of rows are zero up to rounding, (n,)."""
    norm = np.linalg.norm(A, axis=0)
    return np.asarray(norm <= ZERO_COLUMN * norm.max(initial=0))


def _neighbouring_groups(groups: Sequence[Ids]) -> Iterator[Ids]:
    for length in NEIGHBOURS:
        for first in range(len(groups) - length + 1):
            yield np.concatenate(groups[first : first + length])
    yield np.concatenate(groups)


def circuits(N: Array, unit: Array) -> Array:
    """Compute the reduced echelon form of a null space, with pivots selected by size.

    Args:
        N: Basis of the null space, (n, k).
        unit: Expected size of every parameter, (n,).

    Returns:
        Directions relative to `unit`, (k, n) [1].
    """
    T = (N / unit[:, None]).T
    T = T / np.linalg.norm(T, axis=1, keepdims=True)
    pivots: list[int] = []
    for i in range(len(T)):
        size = np.abs(T[i:])
        size[:, pivots] = 0
        row, column = divmod(int(size.argmax()), T.shape[1])
        T[[i, i + row]] = T[[i + row, i]]
        T[i] /= T[i, column]
        others = np.arange(len(T)) != i
        T[others] -= np.outer(T[others, column], T[i])
        pivots.append(column)
    return np.asarray(T)


def participants(row: Array) -> Direction:
    """Describe a direction, (n,), by its unknowns, the one that changes most first."""
    size = np.abs(row) / np.abs(row).max()
    order = [int(k) for k in np.argsort(-size, kind="stable") if size[k] > ZERO_ENTRY]
    return Direction(
        tuple(k for k in order if size[k] >= PARTICIPATION_SHARE),
        tuple(k for k in order if size[k] < PARTICIPATION_SHARE),
    )


def participation(N: Array, within: Array, unit: Array) -> Array:
    """Compute how many directions of N beyond those of `within` each parameter holds.

    Args:
        N: Unobservable directions, (n, k + m).
        within: Some of them, (n, m).
        unit: Expected size of every parameter, (n,).

    Returns:
        Share of every parameter, summing to k, (n,) [1].
    """
    scaled = (within / unit[:, None], N / unit[:, None])
    inner, outer = (np.linalg.qr(M / np.linalg.norm(M, axis=0))[0] for M in scaled)
    values, V = np.linalg.eigh(np.eye(outer.shape[1]) - outer.T @ inner @ (inner.T @ outer))
    more = outer @ V[:, len(values) - (N.shape[1] - within.shape[1]) :]
    return np.asarray((more**2).sum(axis=1))


def undetermined_quantities(
    quantities: Sequence[ObservedQuantity],
    L: Array,
    M: Array,
    structural: Array,
    further: Sequence[Array] = (),
) -> tuple[UndeterminedQuantity, ...]:
    """Find the quantities that the readings leave undetermined, the most uncertain first.

    Mathematics: `obs-8`.

    Args:
        quantities: Quantities that may be named.
        L: Root of the prior's covariance L L^T, (size, size).
        M: Information of the readings in units of the prior, L^T A^T A L, (size, size).
        structural: Structural directions, orthonormal, in units of the prior, (size, k); they count as known.
        further: Information that further readings would add, in units of the prior, (size, size) each: one
            matrix for every joint turned alone, the last one for all joints.

    Returns:
        The undetermined quantities; of a group that compensate each other, only the most uncertain one.
    """
    H = np.vstack([quantity.H for quantity in quantities]) @ L
    ends = np.cumsum([len(quantity.H) for quantity in quantities])
    parts = [np.arange(end - len(quantity.H), end) for end, quantity in zip(ends, quantities, strict=True)]
    # Covariance of all quantities, structural directions held.
    pins = STRUCTURAL_INFORMATION * structural @ structural.T
    K = H @ _covariance(M + pins) @ H.T
    after = [_covariance(M + extra + pins) for extra in further]
    hidden = []
    # Of every quantity of the arm that is left open: what hides it, and which joint helps.
    for k, (quantity, at) in enumerate(zip(quantities, parts, strict=True)):
        unit = _unit_combinations(H[at], structural)
        if not quantity.belongs_to_arm or not len(unit):
            continue
        share = _mean_variance(unit, K[np.ix_(at, at)])
        if share < UNDETERMINED_SHARE:
            continue
        helps = _joint_to_turn(unit @ H[at], after, share)
        confounded = _share_if_all_known(quantity.H, L, M) < CONFOUNDED_SHARE * share
        behind, rest = _confounders(K, parts, k, unit) if confounded else ([], share)
        if rest > CONFOUNDED_SHARE * share:
            hidden.append(UndeterminedQuantity(quantity.name, share=share, joint_to_turn=helps))
            continue
        correlation = float(np.sqrt(max(0.0, 1 - rest / share)))
        names = tuple(quantities[i].name for i in behind)
        hidden.append(UndeterminedQuantity(quantity.name, names, share, correlation, helps))
    return _most_uncertain(hidden)


def _most_uncertain(hidden: Sequence[UndeterminedQuantity]) -> tuple[UndeterminedQuantity, ...]:
    """Keep the most uncertain one of quantities that hide behind each other."""
    kept: dict[frozenset[str], UndeterminedQuantity] = {}
    for quantity in sorted(hidden, key=lambda quantity: (not quantity.confounded_with, -quantity.share)):
        kept.setdefault(frozenset((quantity.name, *quantity.confounded_with)), quantity)
    return tuple(kept.values())


def _covariance(M: Array) -> Array:
    return np.asarray(np.linalg.inv(np.eye(len(M)) + M))


def _unit_combinations(H: Array, structural: Array) -> Array:
    """Combine a quantity's numbers to unit prior variance, outside structural directions."""
    free = H - (H @ structural) @ structural.T
    values, V = np.linalg.eigh(free @ free.T)
    kept = values > NEGLIGIBLE_OUTSIDE * np.square(H).sum() / len(H)
    return np.asarray((V[:, kept] / np.sqrt(values[kept])).T)


def _share_if_all_known(H: Array, L: Array, M: Array) -> float:
    """Compute the share of a quantity's prior variance that remains once all others are known."""
    move = np.linalg.solve(L + np.diag(np.where(np.diag(L) > 0, 0.0, 1.0)), H.T)
    left, before = np.linalg.inv(move.T @ move + move.T @ M @ move), (H @ L) @ (H @ L).T
    return float(np.trace(np.linalg.solve(before, left)) / len(H))


def _confounders(K: Array, parts: Sequence[Ids], k: int, unit: Array) -> tuple[list[int], float]:
    """Find the quantities that, once known, remove most of quantity k, and the share that remains."""
    confounders: list[int] = []
    share = first = _mean_variance(unit, K[np.ix_(parts[k], parts[k])])
    while len(confounders) < MAX_CONFOUNDERS and share > (1 - MIN_EXPLAINED) * first:
        others = [i for i in range(len(parts)) if i != k and i not in confounders]
        known = [np.concatenate([parts[j] for j in (*confounders, i)]) for i in others]
        rest = [_mean_variance(unit, conditional_covariance(K, parts[k], at)) for at in known]
        best = int(np.argmin(rest))
        confounders, share = [*confounders, others[best]], rest[best]
    return confounders, share


def _joint_to_turn(H: Array, after: Sequence[Array], share: float) -> int | None:
    """Find the joint to turn, for numbers of unit prior variance, (k, size)."""
    if not after:
        return None
    *shares, everywhere = (float((H @ S * H).sum() / len(H)) for S in after)
    best = int(np.argmin(shares))
    if shares[best] < HELPFUL_SHARE * share:
        return best
    return len(shares) if everywhere < HELPFUL_SHARE * share else -1


def _mean_variance(unit: Array, K: Array) -> float:
    """Average the variance of combinations, (k, n), of numbers with a covariance, (n, n)."""
    return float(np.trace(unit @ K @ unit.T) / len(unit))


# --- Identifiability of a structure from runs, before any fit, and what else to measure ---------------------

RANDOM_POSES = 60
"""Random poses under the loads of the data: what these do not see, no pose under these loads shows."""
TASKS = 50  #: Random poses in which predictions are judged.
OFFSET = 0.3  #: Distance of a second load point or of one more marker [m].
SIGMA_ROTATION = 250e-6
"""Standard deviation of one orientation reading where the data have none, as in section 5.2 [rad]."""
REPEAT = "the same runs once more"  #: The yardstick: what only averages noise is no better.
TIE = 0.02  #: Expected errors within this share of each other are the same.
DECIDED = 0.05  #: Share that data tell of an unknown below which the prior decides it [1].


@dataclass(frozen=True)
class MeasurementProposal:
    """Describe one more way to measure, and what it would bring."""

    words: str  #: What to do.
    rank: int  #: Directions that all data then see.
    #: RMS distance of predicted from true deflections then to be expected [m]; infinite if nothing fixes the
    #: common scale.
    error: float
    place: int  #: 1 for the best; ties share it.


@dataclass(frozen=True)
class Identifiability:
    """Hold what the data see of a structure, and who decides the rest."""

    structure: Structure  #: The unknowns, n of them.
    component: tuple[str, ...]  #: Link or joint of every parameter, n names.
    entry: Array  #: Row and column of every parameter in its link's compliance, (n, 2); -1 for a joint.
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
    proposals: tuple[MeasurementProposal, ...]  #: What would help, the best first.

    @property
    def lost_to_poses(self) -> int:
        """Count the directions lost to too few poses."""
        return self.rank_of_loads - self.rank


def of_regression(
    vjm: Vjm, regression: Regression, data: Dataset, prior: Prior, uncertainty: PriorUncertainty
) -> Identifiability:
    """Describe what a reduced dataset can tell of its structure; only poses, loads and sigmas count.

    Args:
        vjm: Kinematics of the arm.
        regression: The reduced dataset.
        data: Its runs, or some of them, evenly out of all.
        prior: The prior.
        uncertainty: Uncertainty of the prior.

    Returns:
        The description.

    Raises:
        BenchError: When the prior has another size or is not positive definite, or the structure leaves the
            symmetry open.
    """
    structure, scaled = regression.structure, scale_any_structure(prior, vjm, regression.structure)
    everywhere = reduce(vjm, structure, more_poses(vjm, data, RANDOM_POSES, seed=0))
    own = _rows(regression)
    loads, unit = np.vstack([own, _rows(everywhere)]), _unit(prior, vjm, structure)
    groups, none = _groups(vjm, structure), np.zeros((0, structure.n_parameters))
    to_structure = directions(generic_observation_matrix(vjm, structure), unit, groups, none)
    to_loads = directions(loads, unit, groups, to_structure)
    wanted = sampled_tasks(vjm, data, structure)
    moved = np.linalg.norm(wanted @ (scaled.L @ scaled.expected_x), axis=-1)
    known = _known(scaled, uncertainty, regression)
    component, entry = _places(vjm, structure)
    proposals = []
    for words, more in _measured_otherwise(vjm, data, regression):
        error = expected_error(_known(scaled, uncertainty, regression, more), wanted)
        proposals.append(MeasurementProposal(words, rank(np.vstack([own, _rows(more)])), error, 0))
    return Identifiability(
        structure=structure,
        component=component,
        entry=entry,
        prior=prior.name,
        uncertainty=uncertainty.relative,
        rank=structure.n_parameters - null_space(own).shape[1],
        rank_of_loads=structure.n_parameters - len(to_structure) - len(to_loads),
        rank_of_structure=structure.n_parameters - len(to_structure),
        equations=_equations(vjm, data),
        poses=len(np.unique(data.q, axis=0)),
        lost_to_structure=tuple(map(participants, to_structure)),
        not_loaded=tuple(np.flatnonzero(zero_columns(loads)).tolist()),
        lost_to_loads=tuple(map(participants, to_loads)),
        spread=participation(null_space(own), null_space(loads), unit),
        share=_share(known, scaled, uncertainty),
        error=expected_error(known, wanted),
        deflection=math.sqrt(np.square(moved).mean()),
        proposals=_placed(sorted(proposals, key=lambda p: (p.error, -p.rank))),
    )


def explained_variance(
    vjm: Vjm, regression: Regression, prior: Prior, uncertainty: PriorUncertainty
) -> tuple[tuple[str, ...], Array]:
    """Compute what the data take off the prior's variance of every parameter.

    Args:
        vjm: Kinematics of the arm.
        regression: The reduced dataset.
        prior: The prior.
        uncertainty: Uncertainty of the prior.

    Returns:
        Link or joint of every parameter, and the share of its variance, (n,) [1].
    """
    scaled = scale_any_structure(prior, vjm, regression.structure)
    return _places(vjm, regression.structure)[0], _share(
        _known(scaled, uncertainty, regression), scaled, uncertainty
    )


def sampled_tasks(vjm: Vjm, data: Dataset, structure: Structure) -> Array:
    """Sample where predictions are wanted: random poses, the data's loads and markers.

    Args:
        vjm: Kinematics of the arm.
        data: Measured runs.
        structure: The unknowns.

    Returns:
        Rows of the observation matrix, (poses, m, 3, n) [m].
    """
    wanted = more_poses(vjm, data, TASKS, seed=1)
    args = (evaluate_chain(vjm, wanted.q), structure, wanted.wrench, wanted.point)
    return observation_matrix(*args, marker_positions(vjm, data.markers))


def expected_error(known: Posterior, wanted: Array) -> float:
    """Compute the RMS error of deflections at `sampled_tasks`.

    Args:
        known: The posterior.
        wanted: Rows of the tasks, (poses, m, 3, n) [m].

    Returns:
        Error [m]; infinite if nothing fixes the scale.
    """
    if len(known.unobservable_directions):
        return math.inf
    deviation = known.standard_deviations(wanted.reshape(-1, wanted.shape[-1]))
    return math.sqrt(3 * np.square(deviation).mean())  # three axes a marker


def _known(scaled: PriorScaling, uncertainty: PriorUncertainty, *data: Regression) -> Posterior:
    """Compute the posterior by a prior and the rows of data; their readings do not count."""
    rows = [rows_in_prior_units(regression, scaled)[0] for regression in data]
    M = np.vstack([*rows, prior_rows(scaled, uncertainty)[0]])
    return Posterior.from_whitened_rows(M, scaled.L, scaled.L @ scaled.expected_x)


def _placed(proposals: list[MeasurementProposal]) -> tuple[MeasurementProposal, ...]:
    placed: list[MeasurementProposal] = []
    first = 0
    for k, proposal in enumerate(proposals):
        best = proposals[first]
        if proposal.error > (1 + TIE) * best.error or proposal.rank != best.rank:
            first = k
        placed.append(replace(proposal, place=first + 1))
    return tuple(placed)


def _rows(regression: Regression) -> Array:
    """Stack the reduced rows of all readings, (rows, n)."""
    return np.vstack([term.R for term in regression.terms])


def _places(vjm: Vjm, structure: Structure) -> tuple[tuple[str, ...], Array]:
    """Find the link or joint of every parameter, and its row and column there, (n, 2); -1 for a joint."""
    links = 6 * len(vjm.arm.links)
    of_joint = structure.rows >= links
    names = [*(link.name for link in vjm.arm.links), *(joint.name for joint in vjm.arm.joints)]
    where = np.where(of_joint, len(vjm.arm.links) + structure.rows - links, structure.rows // 6)
    entry = np.where(of_joint, -1, np.array([structure.rows, structure.columns]) % 6).T
    return tuple(names[k] for k in where), entry


def scale_any_structure(prior: Prior, vjm: Vjm, structure: Structure) -> PriorScaling:
    """Compute the units of a prior as `scale_by_prior` does, also for a structure whose blocks lack entries.

    If blocks lack entries, every parameter has a unit of its own: its expected size under the prior.

    Args:
        prior: The prior.
        vjm: Kinematics of the arm.
        structure: The unknowns.

    Returns:
        The units of the prior.

    Raises:
        BenchError: When the prior cannot be used for the arm, or the structure is not symmetric.
    """
    check_symmetric(structure)
    if structure.has_full_blocks:
        return scale_by_prior(prior, vjm, structure)
    pairs = [(a, b) for block in structure.blocks for b in block for a in block if a <= b]
    a, b = np.array(pairs).T
    scale_by_prior(prior, vjm, replace(structure, rows=a, columns=b))  # refuses a bad prior
    size = _unit(prior, vjm, structure) * np.where(structure.rows == structure.columns, 1, np.sqrt(0.5))
    expected = structure.entries(aggregate_left_out_joints(prior.C_theta, vjm, structure)) / size
    return PriorScaling(prior.name, structure, np.diag(size), expected, ())


def set_aside(vjm: Vjm, structure: Structure) -> list[str]:
    """List the joints for which the structure has no parameter but in the link before them.

    Args:
        vjm: Kinematics of the arm.
        structure: The unknowns.

    Returns:
        Their names.
    """
    used, first = np.union1d(structure.rows, structure.columns), 6 * len(vjm.arm.links)
    return [
        joint.name
        for j, joint in enumerate(vjm.arm.joints)
        if first + j not in used and np.isin(np.arange(6 * j, 6 * j + 6), used).any()
    ]


def _unit(prior: Prior, vjm: Vjm, structure: Structure) -> Array:
    """Compute the expected size of every parameter, sqrt(P_aa P_bb), (n,)."""
    d = np.sqrt(np.diag(aggregate_left_out_joints(prior.C_theta, vjm, structure)))
    return np.asarray(d[structure.rows] * d[structure.columns])


def _groups(vjm: Vjm, structure: Structure) -> list[Ids]:
    """Group the parameters by link and joint, in the order of the chain."""
    links = len(vjm.arm.links)
    place = np.where(
        structure.rows < 6 * links, structure.rows // 6 * 2, (structure.rows - 6 * links) * 2 + 1
    )
    return [np.flatnonzero(place == k) for k in np.unique(place)]


def _share(known: Posterior, scaled: PriorScaling, uncertainty: PriorUncertainty) -> Array:
    """Compute the share of the prior's variance of every parameter that the data remove, (n,).

    The prior's variance is that at a known common scale: what the data tell of all parameters by fixing
    the scale is not counted as seeing one of them.
    """
    before = uncertainty.relative**2 * (scaled.L**2).sum(axis=1)
    if len(known.unobservable_directions):  # nothing fixes the common scale
        return np.zeros(len(before))
    after = known.standard_deviations(np.eye(len(before))) ** 2
    return np.asarray(np.clip(1 - after / before, 0, 1))


def _equations(vjm: Vjm, data: Dataset) -> int:
    """Count different poses and loads, times the equations of one reading of a rigid tool."""
    different = np.unique(np.hstack([data.q, data.wrench, data.point]), axis=0)
    if data.rotation_before is not None:
        return 6 * len(different)
    if data.is_line_reading.any():
        return int(data.is_line_reading.sum() + 3 * (data.is_measured & ~data.is_line_reading).sum())
    motion = rigid_motion_matrix(marker_positions(vjm, data.markers))
    return int(np.linalg.matrix_rank(motion)) * len(different)


def without_readings(data: Dataset, **changes: object) -> Dataset:
    """Copy a dataset with other runs, markers or loads and all readings zero: only its rows are wanted.

    Args:
        data: Measured runs.
        changes: Fields of the dataset that change.

    Returns:
        The dataset.
    """
    other = {"run_id": data.run_id, "q": data.q, "markers": data.markers, **changes}
    runs, markers = len(np.asarray(other["run_id"])), len(tuple(other["markers"]))  # type: ignore[arg-type]
    blank = np.zeros((runs, markers, 3))
    turned = None if data.rotation_before is None else np.zeros((runs, 3))
    plain = dict.fromkeys(
        (
            "precision",
            "station",
            "unloaded_after_load",
            "direction",
            "direction_deviation",
            "line_length",
            "tilt_error",
        )
    )
    fields = {"rotation_before": turned, "rotation_after": turned, **plain, **other}
    return replace(data, before=blank, after=blank, **fields)  # type: ignore[arg-type]


def more_poses(vjm: Vjm, data: Dataset, count: int, *, seed: int) -> Dataset:
    """Make runs in random poses within the joint limits, under the loads of the data in turn.

    Where the data have more runs than are asked for, these are evenly spaced among them.

    Args:
        vjm: Kinematics of the arm.
        data: Measured runs.
        count: Number of poses.
        seed: Seed of the poses.

    Returns:
        The runs.
    """
    q = vjm.arm.draw_poses(np.random.Generator(np.random.Philox(seed)), count)
    turn = np.arange(count) % data.n_runs
    if data.n_runs > count:
        turn = np.linspace(0, data.n_runs - 1, count).astype(int)
    ids = np.arange(count)
    return without_readings(
        data, run_id=ids, pose_id=ids, q=q, wrench=data.wrench[turn], point=data.point[turn]
    )


def _measured_otherwise(vjm: Vjm, data: Dataset, regression: Regression) -> Iterator[tuple[str, Regression]]:
    """Reduce the readings that each proposal adds."""
    structure = regression.structure
    for words, extra in _loads(data):
        yield words, reduce(vjm, structure, without_readings(data, **extra))
    poses = np.unique(data.q, axis=0, return_inverse=True)[1].ravel()
    fresh = more_poses(vjm, data, poses.max() + 1, seed=2).q[poses]
    yield "as many more random poses", reduce(vjm, structure, without_readings(data, q=fresh))
    points = marker_positions(vjm, data.markers)
    name = f"one more marker, outside the {'plane' if len(points) > 2 else 'line'} of the other {len(points)}"
    name = "a second marker" if len(points) == 1 else name
    marker = reduce(_with_marker(vjm, points, name), structure, without_readings(data, markers=(name,)))
    yield name, replace(marker, terms=marker.terms[:1])
    if data.rotation_before is None:
        blank = np.zeros((data.n_runs, 3))
        turned = replace(
            without_readings(data), rotation_before=blank, rotation_after=blank, sigma_rotation=SIGMA_ROTATION
        )
        read = reduce(vjm, structure, turned)
        yield (
            f"orientation of the tool read to {1e6 * SIGMA_ROTATION:g} urad",
            replace(read, terms=read.terms[1:]),
        )


def _loads(data: Dataset) -> Iterator[tuple[str, dict[str, Array]]]:
    yield REPEAT, {}
    yield "half the load", {"wrench": data.wrench / 2}
    force = np.linalg.norm(data.wrench[:, :3], axis=1)
    if force.any():
        for k, axis in enumerate("xy"):
            side = np.zeros((data.n_runs, 6))
            side[:, k] = force
            yield f"the same force, as a side load along world {axis}", {"wrench": side}
        for k, axis in enumerate("xyz"):
            point = data.point + OFFSET * np.eye(3)[k]
            yield f"load point moved {OFFSET:g} m along tool {axis}", {"point": point}


def _with_marker(vjm: Vjm, points: Array, name: str) -> Vjm:
    """Add one marker to the model, fixed to the tool off the line or plane of others, (m, 3) [m]."""
    centre = points.mean(axis=0)
    away = np.linalg.svd(points - centre)[2][-1]
    arm = replace(vjm.arm, markers=(*vjm.arm.markers, name))
    return replace(vjm, arm=arm, markers=np.vstack([vjm.markers, centre + OFFSET * away]))
