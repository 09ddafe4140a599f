"""Quantities of a calibration that readings do not determine, and what they hide behind, in sentences."""

from collections.abc import Iterator, Sequence

import numpy as np

from testbench.errors import Array, Ids
from testbench.identify.absolute.posterior import (
    FURTHER_ROWS,
    AddedInformation,
    StructuralDirections,
    structural_directions,
)
from testbench.identify.absolute.state import Unknowns
from testbench.identify.observability import (
    ObservedQuantity,
    UndeterminedQuantity,
    undetermined_quantities,
)
from testbench.model.structure import TEMPLATE

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
            f"to the link before or after it. Such directions per joint: {', '.join(shared)}"
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
            names.append(f"{len(group)} bands of orders in the errors of {_joint(group[0].name)}")
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
