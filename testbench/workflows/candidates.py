"""Candidate poses to measure: the arm can take them with its payload, and the tracker sees every target.

The conditions are asked in a fixed order, the cheap ones first; a pose counts for the first that refuses it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, BenchError, Mask, PoseError, check_array
from testbench.model.poses import WorkArea, in_area
from testbench.model.vjm import Vjm, chain
from testbench.plant.site import Kind, Payload, Site, build_site, contacts, hidden
from testbench.plant.tracker import FACES_AWAY, TOO_FAR, TOO_NEAR, TOO_STEEP, Station, out_of_view
from testbench.progress import tell
from testbench.workflows.cell import Cell

POSES_PER_BATCH = 1024
PATIENCE = 200_000
"""Poses drawn before `find` gives up, and DRAWS_A_POSE more for every pose that it has found."""
DRAWS_A_POSE = 1000

OFF_LIMITS = "outside the joint limits"
OFF_AREA = "tool outside the work area"
BLOCKED = "line of sight is blocked"
TOUCHING: dict[Kind, str] = {
    "itself": "arm collides with itself",
    "room": "arm hits the floor or a wall",
    "tracker": "arm hits the tracker",
    "payload": "payload does not hang clear",
}
ADVICE = {
    OFF_LIMITS: "draw within the limits",
    OFF_AREA: "widen the work area",
    TOO_NEAR: "move the station away",
    TOO_FAR: "move the station nearer",
    TOO_STEEP: "move the station away or to another height",
    FACES_AWAY: "move the station to where the targets face, or turn them by hand (no acceptance)",
    TOUCHING["itself"]: "check the collision shapes of rigid.xml",
    TOUCHING["room"]: "raise the work area",
    TOUCHING["tracker"]: "move the station away",
    TOUCHING["payload"]: "shorten the sling, or raise the work area",
    BLOCKED: "move the station to another side",
}
"""What to change where a reason refuses too many poses."""
REASONS = tuple(ADVICE)  #: Why a pose is refused, in the order in which it is asked.


@dataclass(frozen=True)
class PoseConditions:
    """Describe what a pose must satisfy beyond limits and collisions."""

    area: WorkArea | None = None  #: Where the tool has to be; None for anywhere.
    station: Station | None = None  #: Where the tracker stands and what it sees; None where nobody looks.
    payload: Payload | None = None  #: What hangs from the load point; None for nothing.


@dataclass(frozen=True)
class Checks:
    """Hold conditions made ready to be asked of many poses."""

    vjm: Vjm  #: The model, for its nominal kinematics.
    site: Site  #: Arm, payload and tracker as shapes.
    conditions: PoseConditions  #: What is asked.


@dataclass(frozen=True)
class Candidates:
    """Hold feasible poses and what it took to find them; `drawn` counts them and all those rejected."""

    q: Array  #: Actuated joints, (count, n) [rad, m].
    drawn: int  #: Poses drawn.
    rejected: dict[str, int]  #: How many each of `REASONS` refused, in their order.


def build_checks(cell: Cell, conditions: PoseConditions) -> Checks:
    """Make the checks of an arm; BenchError where the tracker is inside something that does not move.

    Args:
        cell: The arm with its model and its truth.
        conditions: Conditions of a pose.

    Returns:
        The checks.
    """
    station = conditions.station
    place = None if station is None else station.position
    site = build_site(cell.arm, conditions.payload, place, cell.floor)
    return Checks(cell.vjm, site, conditions)


def why_not(checks: Checks, q: Array) -> list[str | None]:
    """Find the first of `REASONS` for which each pose is refused.

    Args:
        checks: The checks.
        q: Poses, (poses, n) [rad, m].

    Returns:
        Reason per pose, None where it is feasible.
    """
    q = check_array(q, (None, checks.vjm.arm.n_joints), "q [rad, m]")
    reasons = np.full(len(q), None, dtype=object)
    left = np.arange(len(q))
    for stage in STAGES:
        refused = np.zeros(len(left), dtype=bool)
        for reason, mask in stage(checks, q[left]).items():
            reasons[left[mask & ~refused]] = reason
            refused |= mask
        left = left[~refused]
    return list(reasons)


def feasible(checks: Checks, q: Array) -> Mask:
    """Tell which poses nothing refuses.

    Args:
        checks: The checks.
        q: Poses, (poses, n) [rad, m].

    Returns:
        True for a feasible pose, (poses,).
    """
    return np.array([reason is None for reason in why_not(checks, q)], dtype=bool)


def _limits(checks: Checks, q: Array) -> dict[str, Mask]:
    lower, upper = checks.vjm.arm.limits
    return {OFF_LIMITS: np.asarray(((q < lower) | (q > upper)).any(axis=1))}


def _area(checks: Checks, q: Array) -> dict[str, Mask]:
    area = checks.conditions.area
    return {} if area is None else {OFF_AREA: ~in_area(checks.vjm, area, q)}


def _view(checks: Checks, q: Array) -> dict[str, Mask]:
    station = checks.conditions.station
    if station is None:
        return {}
    where = chain(checks.vjm, q)
    turned = where.rotation.swapaxes(1, 2)  # rows are turned from the tool's axes into the world's
    targets = where.position[:, None] + checks.vjm.markers @ turned
    return out_of_view(station, targets, checks.site.facing @ turned)


def _contacts(checks: Checks, q: Array) -> dict[str, Mask]:
    kinds = [contact.kind if contact else None for contact in contacts(checks.site, q)]
    return {reason: np.array([k == kind for k in kinds], dtype=bool) for kind, reason in TOUCHING.items()}


def _sight(checks: Checks, q: Array) -> dict[str, Mask]:
    if checks.conditions.station is None:
        return {}
    return {BLOCKED: np.array([by is not None for by in hidden(checks.site, q)], dtype=bool)}


STAGES: tuple[Callable[[Checks, Array], dict[str, Mask]], ...] = (_limits, _area, _view, _contacts, _sight)
"""Each says which poses it refuses and why; only those that all before it let pass come to it."""


def find(
    checks: Checks,
    count: int,
    rng: np.random.Generator,
    *,
    least: int | None = None,
    patience: int = PATIENCE,
) -> Candidates:
    """Draw feasible poses evenly over the joint limits, as many as asked for.

    It gives up after `patience` draws, and DRAWS_A_POSE more for every pose found: PoseError says what
    refused them and what to change.

    Args:
        checks: The checks.
        count: Number of poses.
        rng: Source of randomness.
        least: Number of poses that suffices where no more are found; None for `count`.
        patience: Draws after which it gives up.

    Returns:
        The poses.
    """
    least = count if least is None else least
    if not 1 <= least <= count or patience < 1:
        raise BenchError(
            f"expected 1 <= least <= count and a patience of 1 or more, got {least}, {count} and {patience}"
        )
    rejected, drawn = dict.fromkeys(REASONS, 0), 0
    kept: list[Array] = []
    while len(kept) < count and drawn < patience + DRAWS_A_POSE * len(kept):
        q = checks.vjm.arm.drawn(rng, POSES_PER_BATCH)
        reasons = why_not(checks, q)
        good = np.flatnonzero([reason is None for reason in reasons])[: count - len(kept)]
        kept += list(q[good])
        asked = POSES_PER_BATCH if len(kept) < count else int(good[-1]) + 1  # the rest counts as never drawn
        drawn += asked
        for reason in filter(None, reasons[:asked]):
            rejected[reason] += 1
        tell("finding feasible poses", len(kept), count)
    tell("finding feasible poses", count, count)
    if len(kept) < least:
        raise PoseError(_too_few(len(kept), count, drawn, rejected))
    return Candidates(np.array(kept), drawn, rejected)


def _too_few(found: int, count: int, drawn: int, rejected: dict[str, int]) -> str:
    """What was found and what refused the rest: the most of all, and the most of what came to it."""
    came = dict(zip(REASONS, drawn - np.cumsum([0, *rejected.values()]), strict=False))
    most = max(REASONS, key=lambda r: rejected[r])
    strict = max(REASONS, key=lambda r: rejected[r] / max(came[r], 1))
    refused = (
        f"; {strict!r} refused {rejected[strict]} of the {came[strict]} that came to it: {ADVICE[strict]}"
    )
    table = ", ".join(f"{reason} {n}" for reason, n in rejected.items() if n)
    return (
        f"found {found} of {count} poses in {drawn} draws; most were refused by {most!r}: {ADVICE[most]}"
        f"{refused if strict != most else ''} (refused: {table})"
    )
