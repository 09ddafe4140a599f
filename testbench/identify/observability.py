"""Observability by the readings: unobservable directions, and unknowns that cannot be separated.

A direction is a change of all parameters. It is unobservable if it changes no reading: its parameters
compensate each other. A null space has no basis of its own. A sparse one is searched from small sets of
parameters to large ones: one link or joint, then neighbours along the chain. Elimination with pivots chosen
by size leaves each direction the fewest parameters, all in units of their expected size.

With a prior, a quantity is undetermined if much of its prior variance remains after the readings. If little
would remain once all other unknowns were known, it is confounded: with those unknowns that, once known, would
remove most of it.

Identifiability tells before any fit what a dataset can determine, and what else to measure. Of n parameters
the readings observe as many directions as their rank. The others are lost to the structure (no experiment on
this arm observes them), to the loads and readings (no pose under these loads observes them), or to too few
poses. How well a parameter is observed is the share of its prior variance that the readings explain, by a
linear model with normal noise.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset, evenly_spaced
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
    ZERO_COLUMN_TOLERANCE,
    Regression,
    check_symmetric,
    generic_observation_matrix,
    rank,
    reduce,
)
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, evaluate_chain, marker_positions, observation_matrix, rigid_motion_matrix

# --- Unobservable directions, and unknowns that cannot be separated -----------------------------------------

MIN_PARTICIPATION = 0.15
"""Change of a parameter over the largest change in a direction, from which it takes part in it [1]."""
ZERO_DIRECTION_ENTRY = 1e-7
"""Change of a parameter over the largest change in a direction, below which it counts as zero [1]."""
MIN_NEW_DIRECTION_SHARE = 1e-5
"""Part of a direction orthogonal to those found before, over its length, from which it counts as new [1]."""
NEIGHBOURING_GROUP_COUNTS = (1, 2, 3, 5)
"""Numbers of neighbouring links and joints whose directions are searched together, before those of all."""
UNDETERMINED_SHARE = 0.5
"""Share of the prior variance that remains from which a quantity counts as undetermined [1]."""
CONFOUNDED_SHARE = 0.5
"""Variance of a quantity with all other unknowns known, or with its confounders known, over its variance
after the readings, below which it counts as confounded [1]; otherwise it is unobservable."""
MIN_EXPLAINED, MAX_CONFOUNDERS = 0.7, 3
"""Share of a quantity's remaining variance that its confounders must explain [1], and most confounders."""
MAX_REMAINING_VARIANCE_RATIO = 0.8
"""Variance after further poses with one joint moved, over that without, below which moving it helps [1]."""
STRUCTURAL_DIRECTION_INFORMATION = 1e8
"""Information that fixes structural directions, over the prior's [1]."""
NEGLIGIBLE_NON_STRUCTURAL_SHARE = 0.01
"""Share of a quantity's prior variance outside structural directions that counts as zero [1]."""


@dataclass(frozen=True)
class UnobservableDirection:
    """Describe parameters that compensate each other: they can change together without changing a reading."""

    #: Indices of the parameters, ordered by their change over their expected size, the largest first.
    parameters: tuple[int, ...]
    #: Indices of parameters that change by less than `MIN_PARTICIPATION` of the largest, in this order.
    minor_parameters: tuple[int, ...]


@dataclass(frozen=True)
class NamedQuantity:
    """Describe a linear function of the unknowns that has a name in reports, such as a joint's offset."""

    name: str  #: Name, such as "joint_3's offset".
    jacobian: Array  #: Derivatives of its k numbers with respect to the unknowns, (k, size).
    #: Whether it belongs to the arm. Frames and mounts do not: they are only named as confounders.
    belongs_to_arm: bool = True


@dataclass(frozen=True)
class UndeterminedQuantity:
    """Describe a quantity of the arm that the readings leave undetermined."""

    name: str  #: Name of the quantity.
    #: Names of the quantities with which it is confounded, the most important first; empty if unobservable.
    confounded_with: tuple[str, ...] = ()
    remaining_variance_share: float = (
        1.0  #: Variance that remains after the readings, over the prior variance [1].
    )
    multiple_correlation: float = 0.0  #: Multiple correlation with `confounded_with` after the readings [1].
    #: Index of the joint to move in further poses; the number of joints if all must move, -1 if no motion
    #: helps; None if it was not requested.
    joint_to_turn: int | None = None


def null_space(A: Array) -> Array:
    """Compute a basis, (n, n - rank), of the null space of a matrix, (rows, n), whose columns differ in unit.

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


def unobservable_directions(
    A: Array, parameter_sizes: Array, groups: Sequence[Ids], known_directions: Array
) -> Array:
    """Find a sparse basis of the null space of an observation matrix, beyond directions that are known.

    Args:
        A: Observation matrix, (rows, n).
        parameter_sizes: Expected size of every parameter, (n,) [m/N, rad/(N m), rad/N].
        groups: Indices of the parameters of every link and joint, in the order of the chain.
        known_directions: Directions that are known, in the units of the result, (m, n) [1].

    Returns:
        Further directions, as changes of the parameters over their expected sizes, (k, n) [1].
    """
    R: Array = np.array(np.linalg.qr(A, mode="r"))
    R[:, zero_columns(A)] = 0
    missing = null_space(R).shape[1] - len(known_directions)
    basis = np.zeros((0, A.shape[1]))
    Q = np.linalg.qr(known_directions.T)[0].T  # orthonormal rows: known, then found
    # one link or joint, then neighbours, then all: the first directions have the fewest parameters
    for window in _neighbouring_groups(groups):
        if len(basis) >= missing:
            break
        rows = echelon_directions(null_space(R[:, window]), parameter_sizes[window])
        T = np.zeros((len(rows), A.shape[1]))
        T[:, window] = rows
        for row in T[np.argsort((np.abs(T) > ZERO_DIRECTION_ENTRY).sum(axis=1), kind="stable")]:
            # a direction is new if it is no combination of those before; twice makes it orthogonal enough
            new = row / np.linalg.norm(row)
            for _ in range(2):
                new = new - (Q @ new) @ Q
            if np.linalg.norm(new) > MIN_NEW_DIRECTION_SHARE:
                basis = np.vstack([basis, row])
                Q = np.vstack([Q, new / np.linalg.norm(new)])
    return basis


def zero_columns(A: Array) -> Mask:
    """Tell which columns of a matrix, (rows, n), are zero up to rounding, (n,)."""
    norm = np.linalg.norm(A, axis=0)
    return np.asarray(norm <= ZERO_COLUMN_TOLERANCE * norm.max(initial=0))


def _neighbouring_groups(groups: Sequence[Ids]) -> Iterator[Ids]:
    for length in NEIGHBOURING_GROUP_COUNTS:
        for first in range(len(groups) - length + 1):
            yield np.concatenate(groups[first : first + length])
    yield np.concatenate(groups)


def echelon_directions(N: Array, parameter_sizes: Array) -> Array:
    """Compute a sparse basis of a null space: its reduced echelon form, with the largest entries as pivots.

    Args:
        N: Basis of the null space, (n, k).
        parameter_sizes: Expected size of every parameter, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        Directions over the expected sizes, (k, n) [1].
    """
    T = (N / parameter_sizes[:, None]).T
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


def describe_direction(direction: Array) -> UnobservableDirection:
    """Describe an unobservable direction, (n,) [1], by its parameters, the one that changes most first."""
    size = np.abs(direction) / np.abs(direction).max()
    order = [int(k) for k in np.argsort(-size, kind="stable") if size[k] > ZERO_DIRECTION_ENTRY]
    return UnobservableDirection(
        tuple(k for k in order if size[k] >= MIN_PARTICIPATION),
        tuple(k for k in order if size[k] < MIN_PARTICIPATION),
    )


def parameter_participation(N: Array, known_directions: Array, parameter_sizes: Array) -> Array:
    """Compute how much each parameter takes part in k unobservable directions beyond m known ones.

    It is the diagonal of the projection on the k directions, in units of the expected sizes.

    Args:
        N: Basis of all unobservable directions, (n, k + m).
        known_directions: Basis of the known ones among them, (n, m).
        parameter_sizes: Expected size of every parameter, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        Participation of every parameter, 0 to 1, with sum k, (n,) [1].
    """
    scaled = (known_directions / parameter_sizes[:, None], N / parameter_sizes[:, None])
    inner, outer = (np.linalg.qr(M / np.linalg.norm(M, axis=0))[0] for M in scaled)
    values, V = np.linalg.eigh(np.eye(outer.shape[1]) - outer.T @ inner @ (inner.T @ outer))
    more = outer @ V[:, len(values) - (N.shape[1] - known_directions.shape[1]) :]
    return np.asarray((more**2).sum(axis=1))


def undetermined_quantities(
    quantities: Sequence[NamedQuantity],
    L: Array,
    information: Array,
    structural_directions: Array,
    further_information: Sequence[Array] = (),
) -> tuple[UndeterminedQuantity, ...]:
    """Find the quantities that the readings leave undetermined, the most uncertain first.

    Mathematics: `obs-8`.

    Args:
        quantities: Quantities to judge, and quantities that may be their confounders.
        L: Root of the prior's covariance L L^T of all unknowns, (size, size).
        information: Information of the readings in units of the prior, L^T A^T A L, (size, size) [1].
        structural_directions: Directions that no experiment can observe, orthonormal, in units of the prior,
            (size, k); they count as known.
        further_information: Information that further readings would add, in units of the prior, (size, size)
            each [1]: one matrix for poses that move each joint alone, then one for poses that move all
            joints.

    Returns:
        The undetermined quantities; of those that compensate each other, only the most uncertain one.
    """
    H = np.vstack([quantity.jacobian for quantity in quantities]) @ L
    ends = np.cumsum([len(quantity.jacobian) for quantity in quantities])
    parts = [
        np.arange(end - len(quantity.jacobian), end) for end, quantity in zip(ends, quantities, strict=True)
    ]
    # Covariance of all quantities, structural directions held.
    pins = STRUCTURAL_DIRECTION_INFORMATION * structural_directions @ structural_directions.T
    K = H @ _covariance(information + pins) @ H.T
    after = [_covariance(information + extra + pins) for extra in further_information]
    hidden = []
    # For every undetermined quantity of the arm: its confounders, and the joint whose motion helps.
    for k, (quantity, at) in enumerate(zip(quantities, parts, strict=True)):
        unit = _unit_combinations(H[at], structural_directions)
        if not quantity.belongs_to_arm or not len(unit):
            continue
        share = _mean_variance(unit, K[np.ix_(at, at)])
        if share < UNDETERMINED_SHARE:
            continue
        helps = _joint_to_turn(unit @ H[at], after, share)
        confounded = _share_if_all_known(quantity.jacobian, L, information) < CONFOUNDED_SHARE * share
        behind, rest = _confounders(K, parts, k, unit) if confounded else ([], share)
        if rest > CONFOUNDED_SHARE * share:
            hidden.append(
                UndeterminedQuantity(quantity.name, remaining_variance_share=share, joint_to_turn=helps)
            )
            continue
        correlation = float(np.sqrt(max(0.0, 1 - rest / share)))
        names = tuple(quantities[i].name for i in behind)
        hidden.append(UndeterminedQuantity(quantity.name, names, share, correlation, helps))
    return _most_uncertain(hidden)


def _most_uncertain(hidden: Sequence[UndeterminedQuantity]) -> tuple[UndeterminedQuantity, ...]:
    """Select the most uncertain one of quantities that are confounded with each other."""
    kept: dict[frozenset[str], UndeterminedQuantity] = {}
    for quantity in sorted(
        hidden, key=lambda quantity: (not quantity.confounded_with, -quantity.remaining_variance_share)
    ):
        kept.setdefault(frozenset((quantity.name, *quantity.confounded_with)), quantity)
    return tuple(kept.values())


def _covariance(M: Array) -> Array:
    return np.asarray(np.linalg.inv(np.eye(len(M)) + M))


def _unit_combinations(H: Array, structural: Array) -> Array:
    """Combine a quantity's numbers to unit prior variance, outside structural directions."""
    free = H - (H @ structural) @ structural.T
    values, V = np.linalg.eigh(free @ free.T)
    kept = values > NEGLIGIBLE_NON_STRUCTURAL_SHARE * np.square(H).sum() / len(H)
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
    if shares[best] < MAX_REMAINING_VARIANCE_RATIO * share:
        return best
    return len(shares) if everywhere < MAX_REMAINING_VARIANCE_RATIO * share else -1


def _mean_variance(unit: Array, K: Array) -> float:
    """Average the variance of combinations, (k, n), of numbers with a covariance, (n, n)."""
    return float(np.trace(unit @ K @ unit.T) / len(unit))


# --- Identifiability of a structure from runs, before any fit, and what else to measure ---------------------

N_RANDOM_POSES = 60
"""Number of random poses under the loads of the data: what they do not observe, no pose does."""
N_TASK_POSES = 50  #: Number of random poses in which the error of predictions is expected.
PROPOSED_OFFSET = 0.3  #: Distance of a proposed load point or marker from the present ones [m].
PROPOSED_SIGMA_ROTATION = 250e-6
"""Standard deviation of a proposed orientation reading, as in section 5.2 of the paper [rad]."""
REPEAT_PROPOSAL = "the same runs once more"
"""Description of the proposal that only averages noise, with which the others are compared."""
EQUAL_PROPOSALS_ERROR_DIFFERENCE = 0.02
"""Relative difference of two expected errors below which their proposals rank the same [1]."""
PRIOR_DECIDES_SHARE = 0.05
"""Share of a parameter's prior variance that the readings explain, below which the prior decides it [1]."""


@dataclass(frozen=True)
class MeasurementProposal:
    """Describe readings that could be added to a dataset, and what they would bring."""

    description: str  #: What to measure, such as "half the load".
    rank: int  #: Number of directions of pi that all readings together would observe.
    #: RMS distance of predicted from true deflections to expect with these readings [m]; infinite if they
    #: leave the common scale of all compliances undetermined.
    expected_error: float
    ranking: int  #: 1 for the proposal with the least expected error; equal ones share a number.


@dataclass(frozen=True)
class Identifiability:
    """Hold what a dataset can determine of a structure, before any fit, and which readings would help."""

    structure: Structure  #: The unknown parameters pi, n of them.
    parameter_components: tuple[str, ...]  #: Name of the link or joint of every parameter, n names.
    #: Row and column of every parameter in its link's compliance, (n, 2); -1 for a joint.
    parameter_entries: Array
    rank: int  #: Number of directions of pi that the dataset observes.
    #: Largest number of independent equations in the dataset: 6 per pose and load with a full reading.
    max_independent_equations: int
    lost_to_structure: tuple[UnobservableDirection, ...]  #: Directions that no dataset observes.
    #: Further directions that no pose under these loads observes.
    lost_to_loads: tuple[UnobservableDirection, ...]
    #: Participation of every parameter in the directions lost to too few poses, 0 to 1, (n,) [1].
    participation_lost_to_poses: Array
    #: Share of the prior variance of every parameter that the readings explain, at a known common scale of
    #: all compliances, 0 to 1, (n,) [1].
    explained_share: Array
    expected_error: float  #: RMS distance of predicted from true deflections to expect at random poses [m].
    expected_deflection: float  #: RMS distance that the markers are expected to deflect at these poses [m].
    proposals: tuple[MeasurementProposal, ...]  #: Readings that would help, the best first.

    @property
    def n_lost_to_poses(self) -> int:
        """Count the directions that more poses under the same loads would observe."""
        lost = len(self.lost_to_structure) + len(self.lost_to_loads)
        return self.structure.n_parameters - lost - self.rank


def describe_identifiability(
    vjm: Vjm, regression: Regression, data: Dataset, prior: Prior, uncertainty: PriorUncertainty
) -> Identifiability:
    """Describe what a dataset can determine of a structure by its poses, loads and noise, before any fit.

    Args:
        vjm: The arm's virtual joint model.
        regression: The reduced dataset.
        data: Runs of the dataset, or some of them, evenly out of all.
        prior: Expected compliances.
        uncertainty: Uncertainty of the prior.

    Raises:
        BenchError: When the prior has another size or is not positive definite, or the structure does not
            impose symmetry.
    """
    structure, scaled = regression.structure, scale_any_structure(prior, vjm, regression.structure)
    everywhere = reduce(vjm, structure, runs_in_random_poses(vjm, data, N_RANDOM_POSES, seed=0))
    own = _rows(regression)
    loads, unit = np.vstack([own, _rows(everywhere)]), _unit(prior, vjm, structure)
    groups, none = _groups(vjm, structure), np.zeros((0, structure.n_parameters))
    to_structure = unobservable_directions(generic_observation_matrix(vjm, structure), unit, groups, none)
    to_loads = unobservable_directions(loads, unit, groups, to_structure)
    wanted = sample_task_rows(vjm, data, structure)
    moved = np.linalg.norm(wanted @ (scaled.L @ scaled.expected_x), axis=-1)
    known = _known(scaled, uncertainty, regression)
    component, entry = _places(vjm, structure)
    proposals = []
    for words, more in _measured_otherwise(vjm, data, regression):
        error = expected_error(_known(scaled, uncertainty, regression, more), wanted)
        proposals.append(MeasurementProposal(words, rank(np.vstack([own, _rows(more)])), error, 0))
    return Identifiability(
        structure=structure,
        parameter_components=component,
        parameter_entries=entry,
        rank=structure.n_parameters - null_space(own).shape[1],
        max_independent_equations=_equations(vjm, data),
        lost_to_structure=tuple(map(describe_direction, to_structure)),
        lost_to_loads=tuple(map(describe_direction, to_loads)),
        participation_lost_to_poses=parameter_participation(null_space(own), null_space(loads), unit),
        explained_share=_share(known, scaled, uncertainty),
        expected_error=expected_error(known, wanted),
        expected_deflection=math.sqrt(np.square(moved).mean()),
        proposals=_placed(sorted(proposals, key=lambda p: (p.expected_error, -p.rank))),
    )


def explained_variance(
    vjm: Vjm, regression: Regression, prior: Prior, uncertainty: PriorUncertainty
) -> tuple[tuple[str, ...], Array]:
    """Compute the share of every parameter's prior variance that the readings explain.

    Args:
        vjm: The arm's virtual joint model.
        regression: The reduced dataset.
        prior: Expected compliances.
        uncertainty: Uncertainty of the prior.

    Returns:
        Name of the link or joint of every parameter, and its explained share, 0 to 1, (n,) [1].
    """
    scaled = scale_any_structure(prior, vjm, regression.structure)
    return _places(vjm, regression.structure)[0], _share(
        _known(scaled, uncertainty, regression), scaled, uncertainty
    )


def sample_task_rows(vjm: Vjm, data: Dataset, structure: Structure) -> Array:
    """Compute the observation matrix, Eq. (12), at random poses under the loads of a dataset.

    Args:
        vjm: The arm's virtual joint model.
        data: Measured runs, with their loads and markers.
        structure: The unknowns, n of them.

    Returns:
        Rows of the deflections of the m markers, (poses, m, 3, n) [m per unit of pi].
    """
    wanted = runs_in_random_poses(vjm, data, N_TASK_POSES, seed=1)
    args = (evaluate_chain(vjm, wanted.q), structure, wanted.wrench, wanted.point)
    return observation_matrix(*args, marker_positions(vjm, data.markers))


def expected_error(posterior: Posterior, task_rows: Array) -> float:
    """Compute the RMS distance of predicted from true deflections to expect with a posterior.

    Args:
        posterior: Posterior of the parameters pi, n of them.
        task_rows: Observation matrix of the predictions, (poses, m, 3, n) [m per unit of pi].

    Returns:
        RMS distance of a marker [m]; infinite if the posterior leaves a direction unbounded.
    """
    if len(posterior.unobservable_directions):
        return math.inf
    deviation = posterior.standard_deviations(task_rows.reshape(-1, task_rows.shape[-1]))
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
        if (
            proposal.expected_error > (1 + EQUAL_PROPOSALS_ERROR_DIFFERENCE) * best.expected_error
            or proposal.rank != best.rank
        ):
            first = k
        placed.append(replace(proposal, ranking=first + 1))
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
    """Scale parameters pi = L x by a prior, so that x has order one; blocks may lack entries.

    For whole blocks it is `scale_by_prior`. If blocks lack entries, L is diagonal: the expected size of every
    parameter.

    Args:
        prior: Expected compliances.
        vjm: The arm's virtual joint model.
        structure: The unknowns.

    Returns:
        L and the expectation of x.

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
    expected = structure.parameters_of(aggregate_left_out_joints(prior.C_theta, vjm, structure)) / size
    return PriorScaling(prior.name, structure, np.diag(size), expected)


def joints_without_parameters(vjm: Vjm, structure: Structure) -> list[str]:
    """List the joints that have no parameter of their own, while the link before them has parameters.

    The compliance of such a joint is part of that of the link.

    Args:
        vjm: The arm's virtual joint model.
        structure: The unknowns.

    Returns:
        Names of the joints.
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
    """Compute the share of the prior variance of every parameter that the readings explain, (n,).

    The prior variance is that at a known common scale of all compliances: readings that only determine the
    scale explain none of it.
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


def with_zero_readings(data: Dataset, **changes: object) -> Dataset:
    """Copy a dataset with all readings zero and some fields changed, to plan other runs.

    Args:
        data: Measured runs.
        changes: New values of fields of the dataset, such as run_id, q, markers or wrench.

    Returns:
        The dataset, with point readings of equal noise.
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
            "line_direction",
            "line_direction_deviation",
            "line_length",
            "tilt_error",
        )
    )
    fields = {"rotation_before": turned, "rotation_after": turned, **plain, **other}
    return replace(data, before=blank, after=blank, **fields)  # type: ignore[arg-type]


def runs_in_random_poses(vjm: Vjm, data: Dataset, count: int, *, seed: int) -> Dataset:
    """Make runs in random poses within the joint limits, each under the load of a run of a dataset.

    The loads are those of all runs in turn, or of runs evenly spaced among them if there are more than poses.

    Args:
        vjm: The arm's virtual joint model.
        data: Measured runs.
        count: Number of poses.
        seed: Seed of the poses.

    Returns:
        The runs, one per pose, with all readings zero.
    """
    q = vjm.arm.draw_poses(np.random.Generator(np.random.Philox(seed)), count)
    ids = np.arange(count) % data.n_runs
    loads = evenly_spaced(data.n_runs, count) if data.n_runs > count else ids % data.n_runs
    return with_zero_readings(
        data, run_id=ids, pose_id=ids, q=q, wrench=data.wrench[loads], point=data.point[loads]
    )


def _measured_otherwise(vjm: Vjm, data: Dataset, regression: Regression) -> Iterator[tuple[str, Regression]]:
    """Reduce the readings that each proposal adds."""
    structure = regression.structure
    for words, extra in _loads(data):
        yield words, reduce(vjm, structure, with_zero_readings(data, **extra))
    poses = np.unique(data.q, axis=0, return_inverse=True)[1].ravel()
    fresh = runs_in_random_poses(vjm, data, poses.max() + 1, seed=2).q[poses]
    yield "as many more random poses", reduce(vjm, structure, with_zero_readings(data, q=fresh))
    points = marker_positions(vjm, data.markers)
    name = f"one more marker, outside the {'plane' if len(points) > 2 else 'line'} of the other {len(points)}"
    name = "a second marker" if len(points) == 1 else name
    marker = reduce(_with_marker(vjm, points, name), structure, with_zero_readings(data, markers=(name,)))
    yield name, replace(marker, terms=marker.terms[:1])
    if data.rotation_before is None:
        blank = np.zeros((data.n_runs, 3))
        turned = replace(
            with_zero_readings(data),
            rotation_before=blank,
            rotation_after=blank,
            sigma_rotation=PROPOSED_SIGMA_ROTATION,
        )
        read = reduce(vjm, structure, turned)
        yield (
            f"orientation of the tool read to {1e6 * PROPOSED_SIGMA_ROTATION:g} urad",
            replace(read, terms=read.terms[1:]),
        )


def _loads(data: Dataset) -> Iterator[tuple[str, dict[str, Array]]]:
    yield REPEAT_PROPOSAL, {}
    yield "half the load", {"wrench": data.wrench / 2}
    force = np.linalg.norm(data.wrench[:, :3], axis=1)
    if force.any():
        for k, axis in enumerate("xy"):
            side = np.zeros((data.n_runs, 6))
            side[:, k] = force
            yield f"the same force, as a side load along world {axis}", {"wrench": side}
        for k, axis in enumerate("xyz"):
            point = data.point + PROPOSED_OFFSET * np.eye(3)[k]
            yield f"load point moved {PROPOSED_OFFSET:g} m along tool {axis}", {"point": point}


def _with_marker(vjm: Vjm, points: Array, name: str) -> Vjm:
    """Add one marker to the model, fixed to the tool off the line or plane of others, (m, 3) [m]."""
    centre = points.mean(axis=0)
    away = np.linalg.svd(points - centre)[2][-1]
    arm = replace(vjm.arm, markers=(*vjm.arm.markers, name))
    return replace(vjm, arm=arm, markers=np.vstack([vjm.markers, centre + PROPOSED_OFFSET * away]))
