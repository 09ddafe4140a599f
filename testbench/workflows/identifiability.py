"""Identifiability of a structure from runs, before any fit, and what else to measure.

Of n unknowns the data see as many directions as their rank. The others are lost to the structure (no
experiment on this arm sees them), to the loads and readings (no pose under these loads shows them), or to too
few poses. What the data see they see more or less well: the share of a parameter is what they take off the
variance that the prior leaves it, linear and Gaussian.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.design.rows import marker_motion
from testbench.errors import Array, Ids
from testbench.identify.fold import reduce
from testbench.identify.metric import PriorScaling, precision_root, scale_by_prior, weighted_rows
from testbench.identify.observability import (
    Direction,
    directions,
    null_space,
    participants,
    participation,
    zero_columns,
)
from testbench.identify.posterior import Posterior
from testbench.identify.prior import Prior, Strength, aggregate
from testbench.identify.regression import Regression, check_symmetric, generic_rows, rank
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, chain, marker_points, observation
from testbench.runs.rows import Row

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
    proposals: tuple[MeasurementProposal, ...]  #: What would help, the best first.

    @property
    def lost_to_poses(self) -> int:
        """Count the directions lost to too few poses."""
        return self.rank_of_loads - self.rank


def describe(
    vjm: Vjm, structure: Structure, data: Dataset, prior: Prior, strength: Strength
) -> Identifiability:
    """Describe what a dataset can tell of a structure before any solve; only poses, loads and sigmas count.

    Args:
        vjm: Kinematics of the arm.
        structure: The unknowns.
        data: Measured runs.
        prior: The prior.
        strength: Strength of the prior.

    Returns:
        The description.

    Raises:
        BenchError: When the dataset is empty or of another arm, the prior has another size or is not positive
            definite, or the structure leaves the symmetry open.
    """
    return of_regression(vjm, reduce(vjm, structure, data), data, prior, strength)


def of_regression(
    vjm: Vjm, regression: Regression, data: Dataset, prior: Prior, strength: Strength
) -> Identifiability:
    """Describe what a reduced dataset can tell of its structure.

    Args:
        vjm: Kinematics of the arm.
        regression: The reduced dataset.
        data: Its runs, or some of them, evenly out of all.
        prior: The prior.
        strength: Strength of the prior.

    Returns:
        The description.
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
    known = _known(scaled, strength, regression)
    component, entry = _places(vjm, structure)
    proposals = []
    for words, more in _measured_otherwise(vjm, data, regression):
        error = expected_error(_known(scaled, strength, regression, more), wanted)
        proposals.append(MeasurementProposal(words, rank(np.vstack([own, _rows(more)])), error, 0))
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
        lost_to_structure=tuple(map(participants, to_structure)),
        not_loaded=tuple(np.flatnonzero(zero_columns(loads)).tolist()),
        lost_to_loads=tuple(map(participants, to_loads)),
        spread=participation(null_space(own), null_space(loads), unit),
        share=_share(known, scaled, strength),
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
        for own in lost:
            every = [*own.parameters, *own.others]
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
    vjm: Vjm, regression: Regression, prior: Prior, strength: Strength
) -> tuple[tuple[str, ...], Array]:
    """Compute what the data take off the prior's variance of every parameter.

    Args:
        vjm: Kinematics of the arm.
        regression: The reduced dataset.
        prior: The prior.
        strength: Strength of the prior.

    Returns:
        Link or joint of every parameter, and the share of its variance, (n,) [1].
    """
    scaled = any_metric(prior, vjm, regression.structure)
    return _places(vjm, regression.structure)[0], _share(
        _known(scaled, strength, regression), scaled, strength
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
    if len(known.unseen):
        return math.inf
    deviation = known.deviations(wanted.reshape(-1, wanted.shape[-1]))
    return math.sqrt(3 * np.square(deviation).mean())  # three axes a marker


def _known(scaled: PriorScaling, strength: Strength, *data: Regression) -> Posterior:
    """Parameters by a prior and by what the rows of data would tell, their readings aside."""
    rows = [weighted_rows(regression, scaled)[0] for regression in data]
    M = np.vstack([*rows, precision_root(scaled, strength)[0]])
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


def _share(known: Posterior, scaled: PriorScaling, strength: Strength) -> Array:
    """What the data take off the prior's variance of every parameter, (n,).

    The prior's variance is that at a known common scale: what the data tell of all parameters by fixing
    the scale is not counted as seeing one of them.
    """
    before = strength.uncertainty**2 * (scaled.L**2).sum(axis=1)
    if len(known.unseen):  # nothing fixes the common scale
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
    q = vjm.arm.drawn(np.random.Generator(np.random.Philox(seed)), count)
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
    yield "as many poses again at random", reduce(vjm, structure, without_readings(data, q=fresh))
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
