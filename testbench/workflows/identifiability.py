"""Identifiability of a structure from runs, before any fit, and what else to measure.

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
from testbench.errors import Array, Ids
from testbench.identify.absolute.posterior import (
    FURTHER_ROWS,
    AddedInformation,
    StructuralDirections,
    structural_directions,
)
from testbench.identify.absolute.state import Unknowns
from testbench.identify.metric import (
    Prior,
    PriorScaling,
    PriorUncertainty,
    aggregate,
    precision_root,
    scale_by_prior,
    weighted_rows,
)
from testbench.identify.observability import (
    Direction,
    ObservedQuantity,
    UndeterminedQuantity,
    directions,
    null_space,
    participants,
    participation,
    undetermined_quantities,
    zero_columns,
)
from testbench.identify.posterior import Posterior
from testbench.identify.regression import Regression, check_symmetric, generic_rows, rank, reduce
from testbench.model.structure import TEMPLATE, Structure
from testbench.model.vjm import Vjm, chain, marker_motion, marker_points, observation
from testbench.runs.rows import Row

# --- Identifiability of a structure from runs, before any fit, and what else to measure ---------------------

RANDOM_POSES = 60
"""Random poses under the loads of the data: what these do not see, no pose under these loads shows."""
TASKS = 50  #: Random poses in which predictions are judged.
OFFSET = 0.3  #: Distance of a second load point or of one more marker [m].
SIGMA_ROTATION = 250e-6
"""Standard deviation of one orientation reading where the data have none, as in section 5.2 [rad]."""
REPEAT = "the same runs once more"  #: The yardstick: what only averages noise is no better.
TIE = 0.02  #: Expected errors within this share of each other are the same.
NAMED = 3  #: Links and joints that are named of those that too few poses leave open.
DECIDED = 0.05  #: Share that data tell of an unknown below which the prior decides it [1].
AXES = ("stretch", "deflection y", "deflection z", "torsion", "rotation y", "rotation z")
"""Names of the diagonal entries of a link's compliance, in its beam frame: c11 to c66."""


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
    structure, scaled = regression.structure, any_metric(prior, vjm, regression.structure)
    everywhere = reduce(vjm, structure, more_poses(vjm, data, RANDOM_POSES, seed=0))
    own = _rows(regression)
    loads, unit = np.vstack([own, _rows(everywhere)]), _unit(prior, vjm, structure)
    groups, none = _groups(vjm, structure), np.zeros((0, structure.n))
    to_structure = directions(generic_rows(vjm, structure), unit, groups, none)
    to_loads = directions(loads, unit, groups, to_structure)
    wanted = sampled_tasks(vjm, data, structure)
    moved = np.linalg.norm(wanted @ (scaled.L @ scaled.expected), axis=-1)
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
        rank=structure.n - null_space(own).shape[1],
        rank_of_loads=structure.n - len(to_structure) - len(to_loads),
        rank_of_structure=structure.n - len(to_structure),
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


def unseen_poses(identifiability: Identifiability) -> list[Row]:
    """List the directions that the data do not show, a row for each set of links and joints that trade.

    Returns:
        Rows with `why` (structure: no experiment shows them; loads: no pose does under these loads; poses:
        these are too few), `parts`, the number of `directions`, and `parameters` that change in the first.
    """
    rows: dict[tuple[str, tuple[str, ...]], Row] = {}
    for why, lost in (
        ("structure", identifiability.lost_to_structure),
        ("loads", identifiability.lost_to_loads),
    ):
        for direction in lost:
            every = [*direction.parameters, *direction.minor_parameters]
            parts = tuple(dict.fromkeys(identifiability.component[k] for k in sorted(every)))
            names = ", ".join(_name(identifiability, k) for k in every)
            start = Row(why=why, parts=", ".join(parts), directions=0, parameters=names)
            rows.setdefault((why, parts), start)["directions"] += 1
    if identifiability.lost_to_poses:
        most = sorted(
            dict.fromkeys(identifiability.component), key=lambda name: -_spread(identifiability, name)
        )[:NAMED]
        last = Row(
            why="poses", parts=", ".join(most), directions=identifiability.lost_to_poses, parameters=""
        )
        rows["poses", ()] = last
    return list(rows.values())


def _spread(identifiability: Identifiability, part: str) -> float:
    """How many of the directions lost to too few poses a link or joint holds."""
    return float(identifiability.spread[np.array(identifiability.component) == part].sum())


def _name(identifiability: Identifiability, parameter: int) -> str:
    """Name a parameter: its joint, or its link and axes."""
    part, (a, b) = identifiability.component[parameter], identifiability.entry[parameter].tolist()
    if a < 0:
        return part
    return f"{part} {AXES[a]}" if a == b else f"{part} {AXES[min(a, b)]} with {AXES[max(a, b)]}"


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
    scaled = any_metric(prior, vjm, regression.structure)
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
    args = (chain(vjm, wanted.q), structure, wanted.wrench, wanted.point)
    return observation(*args, marker_points(vjm, data.markers))


def expected_error(known: Posterior, wanted: Array) -> float:
    """Compute the RMS error of deflections at `sampled_tasks`.

    Args:
        known: The posterior.
        wanted: Rows of the tasks, (poses, m, 3, n) [m].

    Returns:
        Error [m]; infinite if nothing fixes the scale.
    """
    if len(known.unobservable):
        return math.inf
    deviation = known.deviations(wanted.reshape(-1, wanted.shape[-1]))
    return math.sqrt(3 * np.square(deviation).mean())  # three axes a marker


def _known(scaled: PriorScaling, uncertainty: PriorUncertainty, *data: Regression) -> Posterior:
    """Parameters by a prior and by what the rows of data would tell, their readings aside."""
    rows = [weighted_rows(regression, scaled)[0] for regression in data]
    M = np.vstack([*rows, precision_root(scaled, uncertainty)[0]])
    return Posterior.of_rows(M, scaled.L, scaled.L @ scaled.expected)


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
    """What data see, (rows, n)."""
    return np.vstack([term.R for term in regression.terms])


def _places(vjm: Vjm, structure: Structure) -> tuple[tuple[str, ...], Array]:
    """Link or joint of every parameter, and its row and column there, (n, 2); -1 for a joint."""
    links = 6 * len(vjm.arm.links)
    of_joint = structure.a >= links
    names = [*(link.name for link in vjm.arm.links), *(joint.name for joint in vjm.arm.joints)]
    where = np.where(of_joint, len(vjm.arm.links) + structure.a - links, structure.a // 6)
    entry = np.where(of_joint, -1, np.array([structure.a, structure.b]) % 6).T
    return tuple(names[k] for k in where), entry


def any_metric(prior: Prior, vjm: Vjm, structure: Structure) -> PriorScaling:
    """Compute the metric of the prior; for blocks that lack entries that of its entries one by one.

    It refuses what `scale_by_prior` refuses, but for the entries that are lacking.

    Args:
        prior: The prior.
        vjm: Kinematics of the arm.
        structure: The unknowns.

    Returns:
        The metric.
    """
    check_symmetric(structure)
    if structure.has_full_blocks:
        return scale_by_prior(prior, vjm, structure)
    pairs = [(a, b) for block in structure.blocks for b in block for a in block if a <= b]
    a, b = np.array(pairs).T
    scale_by_prior(prior, vjm, replace(structure, a=a, b=b))  # refuses a bad prior
    size = _unit(prior, vjm, structure) * np.where(structure.a == structure.b, 1, np.sqrt(0.5))
    expected = structure.entries(aggregate(prior.C_theta, vjm, structure)) / size
    return PriorScaling(prior.name, structure, np.diag(size), expected, ())


def set_aside(vjm: Vjm, structure: Structure) -> list[str]:
    """List the joints for which the structure has no parameter but in the link before them.

    Args:
        vjm: Kinematics of the arm.
        structure: The unknowns.

    Returns:
        Their names.
    """
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


def _groups(vjm: Vjm, structure: Structure) -> list[Ids]:
    """Parameters of every link and joint, in the order of the chain."""
    links = len(vjm.arm.links)
    place = np.where(structure.a < 6 * links, structure.a // 6 * 2, (structure.a - 6 * links) * 2 + 1)
    return [np.flatnonzero(place == k) for k in np.unique(place)]


def _share(known: Posterior, scaled: PriorScaling, uncertainty: PriorUncertainty) -> Array:
    """What the data take off the prior's variance of every parameter, (n,).

    The prior's variance is that at a known common scale: what the data tell of all parameters by fixing
    the scale is not counted as seeing one of them.
    """
    before = uncertainty.relative**2 * (scaled.L**2).sum(axis=1)
    if len(known.unobservable):  # nothing fixes the common scale
        return np.zeros(len(before))
    after = known.deviations(np.eye(len(before))) ** 2
    return np.asarray(np.clip(1 - after / before, 0, 1))


def _equations(vjm: Vjm, data: Dataset) -> int:
    """Different poses and loads, times the equations of one reading of a rigid tool."""
    different = np.unique(np.hstack([data.q, data.wrench, data.point]), axis=0)
    if data.rotation_before is not None:
        return 6 * len(different)
    if data.lines.any():
        return int(data.lines.sum() + 3 * (data.seen & ~data.lines).sum())
    motion = marker_motion(marker_points(vjm, data.markers))
    return int(np.linalg.matrix_rank(motion)) * len(different)


def without_readings(data: Dataset, **changes: object) -> Dataset:
    """Copy a dataset with other runs, markers or loads and all readings zero: only its rows are wanted.

    Args:
        data: Measured runs.
        changes: Fields of the dataset that change.

    Returns:
        The dataset.
    """
    other = {"run": data.run, "q": data.q, "markers": data.markers, **changes}
    runs, markers = len(np.asarray(other["run"])), len(tuple(other["markers"]))  # type: ignore[arg-type]
    blank = np.zeros((runs, markers, 3))
    turned = None if data.rotation_before is None else np.zeros((runs, 3))
    plain = dict.fromkeys(("precision", "station", "taken_off", "direction", "tilt", "reach", "slide"))
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
    turn = np.arange(count) % data.runs
    if data.runs > count:
        turn = np.linspace(0, data.runs - 1, count).astype(int)
    ids = np.arange(count)
    return without_readings(data, run=ids, pose=ids, q=q, wrench=data.wrench[turn], point=data.point[turn])


def _measured_otherwise(vjm: Vjm, data: Dataset, regression: Regression) -> Iterator[tuple[str, Regression]]:
    """What each proposal adds, reduced."""
    structure = regression.structure
    for words, extra in _loads(data):
        yield words, reduce(vjm, structure, without_readings(data, **extra))
    poses = np.unique(data.q, axis=0, return_inverse=True)[1].ravel()
    fresh = more_poses(vjm, data, poses.max() + 1, seed=2).q[poses]
    yield "as many random poses again", reduce(vjm, structure, without_readings(data, q=fresh))
    points = marker_points(vjm, data.markers)
    name = f"one more marker off the {'plane' if len(points) > 2 else 'line'} of the {len(points)}"
    name = "a second marker" if len(points) == 1 else name
    marker = reduce(_with_marker(vjm, points, name), structure, without_readings(data, markers=(name,)))
    yield name, replace(marker, terms=marker.terms[:1])
    if data.rotation_before is None:
        blank = np.zeros((data.runs, 3))
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
            side = np.zeros((data.runs, 6))
            side[:, k] = force
            yield f"the force as a side load along world {axis}", {"wrench": side}
        for k, axis in enumerate("xyz"):
            point = data.point + OFFSET * np.eye(3)[k]
            yield f"load point moved {OFFSET:g} m along tool {axis}", {"point": point}


def _with_marker(vjm: Vjm, points: Array, name: str) -> Vjm:
    """The model with one more marker, fixed to the tool off the line or plane of others, (m, 3) [m]."""
    centre = points.mean(axis=0)
    away = np.linalg.svd(points - centre)[2][-1]
    arm = replace(vjm.arm, markers=(*vjm.arm.markers, name))
    return replace(vjm, arm=arm, markers=np.vstack([vjm.markers, centre + OFFSET * away]))


# --- Quantities of a calibration that readings do not determine, and what they hide behind, in sentences ----

FREE_DEVIATION = 0.01
"""Standard deviation of what has no prior, frames and mounts [m, rad]: much more than readings leave of it,
and not so much that rounding would hide the rest."""
SINGLE = {"ratio": "gear ratio", "play": "play", "stiffening": "stiffening"}
STRETCH, TWIST, BENDING, COUPLING = "stretch", "torsion", "bending", "coupling that beams lack"
ERROR = "'s error of "  #: Between a joint and the orders of its periodic errors.
MAX_NAMED_BANDS = 2  #: Bands of one joint's errors that are named one by one.


def unobservable(
    unknowns: Unknowns, information: Array, prior: Array, further: AddedInformation
) -> tuple[str, ...]:
    """Say what readings leave unknown of a calibration, in few sentences.

    Args:
        unknowns: Whose columns they are.
        information: Of the readings, no prior, (size, size).
        prior: Covariance, (size, size), zero of what is taken to be zero.
        further: What further poses would tell, `further_information`.

    Returns:
        The sentences.
    """
    on, L = np.flatnonzero(np.diag(prior)), np.zeros_like(prior)
    L[np.ix_(on, on)] = np.linalg.cholesky(prior[np.ix_(on, on)])
    every = structural_directions(unknowns, L, further)
    d, every_one = np.diag(L), (information, *further.by_joint, further.whole_space)
    plain = np.count_nonzero(L) == np.count_nonzero(d)  # a root of variances alone is no product of matrices
    M, *more = (d[:, None] * one * d if plain else np.asarray(L.T @ one @ L) for one in every_one)
    found = undetermined_quantities(quantities(unknowns), L, M, every.directions, more)
    names = [joint.name for joint in unknowns.vjm.arm.joints]
    return (*structure_words(every, names, unknowns.structure.n), *sentences(found, names))


def structure_words(found: StructuralDirections, joints: Sequence[str], compliances: int) -> Iterator[str]:
    """Say what no pose could show.

    Args:
        found: Directions that no pose shows.
        joints: Names of the joints.
        compliances: Number of directions of compliances.

    Yields:
        Sentences.
    """
    if found.n_geometry:
        shared = [
            f"{name} ({count})" for name, count in zip(joints, found.between_links, strict=True) if count > 0
        ]
        left = found.n_geometry - sum(found.between_links)
        yield (
            f"{found.n_geometry} directions of geometry, frames and mounts cannot be determined by any "
            "pose, because they move no target. A turn about a joint's axis, or a shift along it, may belong "
            f"to the link before or behind it. Such directions per joint: {', '.join(shared)}"
            f"{f'; {left} concern several links' if left else ''}"
        )
    if found.inactive_joints:
        idle = " and ".join(joints[j] for j in found.inactive_joints)
        yield f"No pose can determine the joint errors of {idle}, because they move no target"
    if found.n_elastic:
        yield (
            f"{found.n_elastic} of {compliances} directions of compliance cannot be determined by any "
            "pose, because they move no target under these loads"
        )


def sentences(found: Sequence[UndeterminedQuantity], joints: Sequence[str]) -> tuple[str, ...]:
    """Write one sentence per advice for what is not seen, one for errors of a joint among themselves.

    Args:
        found: Hidden quantities.
        joints: Names of the joints.

    Returns:
        The sentences.
    """
    behind = [hidden_quantity for hidden_quantity in found if hidden_quantity.confounded_with]
    said = [
        _words(hidden_quantity, joints)
        for hidden_quantity in behind
        if not _among_themselves(hidden_quantity)
    ]
    said += [
        _mutual(own, joints)
        for own in _grouped(
            [hidden_quantity for hidden_quantity in behind if _among_themselves(hidden_quantity)]
        )
    ]
    unseen = [hidden_quantity for hidden_quantity in found if not hidden_quantity.confounded_with]
    for advice in dict.fromkeys(hidden_quantity.joint_to_turn for hidden_quantity in unseen):
        said.append(
            _unseen(
                [hidden_quantity for hidden_quantity in unseen if hidden_quantity.joint_to_turn == advice],
                joints,
            )
        )
    return tuple(said)


def _words(hidden_quantity: UndeterminedQuantity, joints: Sequence[str]) -> str:
    left = f"{100 * hidden_quantity.share:.0f} % of its prior variance remains"
    if not hidden_quantity.confounded_with:
        return f"{hidden_quantity.name} is not determined ({left}){_advice(hidden_quantity, joints)}"
    behind = " and ".join(
        filter(None, [", ".join(hidden_quantity.confounded_with[:-1]), hidden_quantity.confounded_with[-1]])
    )
    return (
        f"{hidden_quantity.name} cannot be separated from {behind} "
        f"(correlation {hidden_quantity.correlation:.2f}, {left}){_advice(hidden_quantity, joints)}"
    )


def _advice(hidden_quantity: UndeterminedQuantity, joints: Sequence[str]) -> str:
    """What would show it; nothing where that was not asked for."""
    if hidden_quantity.joint_to_turn is None:
        return ""
    if hidden_quantity.joint_to_turn < 0:
        return f": {FURTHER_ROWS} more poses hardly help; another load may help"
    return (
        f": turn {joints[hidden_quantity.joint_to_turn]} more"
        if hidden_quantity.joint_to_turn < len(joints)
        else ": turn several joints together"
    )


def _joint(name: str) -> str:
    """The joint of a periodic error, nothing for other quantities."""
    return name.split(ERROR)[0] if ERROR in name else ""


def _among_themselves(hidden_quantity: UndeterminedQuantity) -> bool:
    """Whether a joint's error hides behind others of the same joint alone."""
    return bool(_joint(hidden_quantity.name)) and all(
        _joint(name) == _joint(hidden_quantity.name) for name in hidden_quantity.confounded_with
    )


def _grouped(found: Sequence[UndeterminedQuantity]) -> list[list[UndeterminedQuantity]]:
    """By joint and advice, in their order."""
    keys = dict.fromkeys(
        (_joint(hidden_quantity.name), hidden_quantity.joint_to_turn) for hidden_quantity in found
    )
    return [
        [
            hidden_quantity
            for hidden_quantity in found
            if (_joint(hidden_quantity.name), hidden_quantity.joint_to_turn) == key
        ]
        for key in keys
    ]


def _mutual(own: Sequence[UndeterminedQuantity], joints: Sequence[str]) -> str:
    if len(own) == 1:
        return _words(own[0], joints)
    orders = ", ".join(
        hidden_quantity.name.split(ERROR)[1].removeprefix("orders ").removeprefix("order ")
        for hidden_quantity in own
    )
    joint = _joint(own[0].name)
    return f"{joint}'s errors of orders {orders} cannot be separated ({_left(own)}){_advice(own[0], joints)}"


def _unseen(own: Sequence[UndeterminedQuantity], joints: Sequence[str]) -> str:
    if len(own) == 1:
        return _words(own[0], joints)
    names: list[str] = []
    for group in _grouped(own):
        if not _joint(group[0].name) or len(group) <= MAX_NAMED_BANDS:
            names += [hidden_quantity.name for hidden_quantity in group]
        else:
            names.append(f"{len(group)} groups of orders of {_joint(group[0].name)}'s errors")
    return f"{', '.join(names)} are not determined ({_left(own)}){_advice(own[0], joints)}"


def _left(own: Sequence[UndeterminedQuantity]) -> str:
    shares = [f"{100 * share:.0f}" for share in sorted(hidden_quantity.share for hidden_quantity in own)]
    return f"{' to '.join(dict.fromkeys((shares[0], shares[-1])))} % of their prior variance remains"


def quantities(unknowns: Unknowns) -> tuple[ObservedQuantity, ...]:
    """List all quantities, in the order of the columns."""
    return (*_set_ups(unknowns), *_lengths(unknowns), *_bands(unknowns), *_springs(unknowns))


def _of(unknowns: Unknowns, name: str, columns: Ids) -> ObservedQuantity:
    """One whose numbers are columns themselves."""
    return ObservedQuantity(name, np.eye(unknowns.size)[columns])


def _set_ups(unknowns: Unknowns) -> Iterator[ObservedQuantity]:
    every = np.eye(unknowns.size)
    keys = [*(("frame", name) for name in unknowns.frames), *(("mount", name) for name in unknowns.mounts)]
    for kind, name in keys:
        columns = np.arange(unknowns.size)[unknowns.columns(f"{kind} {name}")]
        own = np.setdiff1d(columns, unknowns.unused_rotations)
        rows, words = every[own], f"the {kind} of {name}"
        if kind == "frame" and name in unknowns.normals:
            # Planes show shifts along their normals, and turns about the axes across these.
            words, normals = f"the plane of {name}", np.array(unknowns.normals[name])
            across = np.concatenate([np.linalg.svd(normal[None])[2][1:] for normal in normals])
            rows = np.concatenate([_span(normals) @ rows[:3], _span(across) @ rows[3:]])
        elif kind == "frame" and name in unknowns.fixed:
            words = f"the fixed point of {name}"
        yield ObservedQuantity(words, rows, belongs_to_arm=False)


def _span(vectors: Array) -> Array:
    """Find an orthonormal basis of what some vectors, (k, 3), span."""
    _, size, basis = np.linalg.svd(vectors)
    return np.asarray(basis[: int((size > 1e-6).sum())])  # of unit vectors; a turn of 1e-6 rad is none


def _lengths(unknowns: Unknowns) -> Iterator[ObservedQuantity]:
    """Of every inner link the offset of the joint behind it, its other turns and its shifts."""
    arm, first = unknowns.vjm.arm, unknowns.starts["geometry"]
    for k in range(1, arm.n_joints):
        link, joint, axis = arm.links[k].name, arm.joints[k], unknowns.vjm.beam_axes[k]
        own = np.eye(unknowns.size)[first + 6 * (k - 1) + np.arange(6)]
        shift, turn = own[:3], own[3:]
        across = np.linalg.svd(axis[None])[2][1:]  # two axes at right angles to the joint's
        along, other = (shift, turn) if joint.prismatic else (turn, shift)
        kinds = ("shift", "turn") if joint.prismatic else ("turn", "shift")
        yield ObservedQuantity(f"{joint.name}'s offset", axis[None] @ along)
        yield ObservedQuantity(f"{link}'s {kinds[0]}", across @ along)
        yield ObservedQuantity(f"{link}'s {kinds[1]}", other)


def _bands(unknowns: Unknowns) -> Iterator[ObservedQuantity]:
    errors, first = unknowns.errors, unknowns.starts["errors"]
    orders = np.tile(errors.orders, 2)
    kinds, bands = np.array(errors.kinds), errors.bands
    for j, joint in enumerate(unknowns.vjm.arm.joints):
        own = first + j * errors.size
        for band in np.unique(bands[bands >= 0]) if not joint.prismatic else ():
            at = np.flatnonzero(bands == band)
            low, high = orders[at].min(), orders[at].max()
            name = f"error of order {low}" if low == high else f"error of orders {low} to {high}"
            yield _of(unknowns, f"{joint.name}'s {name}", own + at)
        for kind in kinds[bands < 0]:
            name = f"{joint.name}'s {SINGLE[kind]}"
            yield _of(unknowns, name, own + np.flatnonzero(kinds == kind))


def _springs(unknowns: Unknowns) -> Iterator[ObservedQuantity]:
    arm, structure, first = unknowns.vjm.arm, unknowns.structure, unknowns.starts["elastic"]
    links = 6 * len(arm.links)
    kind = np.array([_kind(a % 6, b % 6) for a, b in zip(structure.a, structure.b, strict=True)])
    for k, link in enumerate(arm.links):
        for name in (STRETCH, TWIST, BENDING, COUPLING):
            own = np.flatnonzero((structure.a // 6 == k) & (structure.a < links) & (kind == name))
            if len(own):
                yield _of(unknowns, f"{link.name}'s {name}", first + own)
    for k in np.flatnonzero(structure.a >= links).tolist():
        name = arm.joints[structure.a[k] - links].name
        yield _of(unknowns, f"{name}'s compliance", first + np.array([k]))


def _kind(a: int, b: int) -> str:
    """What an entry of a link's compliance stands for."""
    a, b = min(a, b), max(a, b)
    if (a, b) not in TEMPLATE:
        return COUPLING
    return {(0, 0): STRETCH, (3, 3): TWIST}.get((a, b), BENDING)
