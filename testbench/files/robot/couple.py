"""Joints of a robot's file that move together: URDF's mimic, MJCF's equalities of joints and fixed tendons.

All are linear equations between joints. Solved for the joints of the arm they are its `JointMap`. Closed
loops and nonlinear equations are refused, unless they concern only branches off the arm.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from testbench.arm.joint_map import JointMap, build_map
from testbench.errors import Array, BenchError, InputError
from testbench.files.robot.equalities import Coupling
from testbench.files.robot.robot import Body, ImportedJoint

ZERO_COEFFICIENT = 1e-9
"""Coefficient of an equation below which it counts as zero [1]."""
DIGITS = 12
"""Decimals of a coefficient."""
STATE = "leave it out and state how joints depend in [joints] of elastic.toml"
Rows = Mapping[str, tuple[Mapping[str, float], float]]
"""Dependent joints by name: coefficients of the joints that they follow [1], and an offset [rad, m]."""


def map_of(
    file: Path,
    bodies: Sequence[Body],
    path: Sequence[int],
    couplings: Sequence[Coupling],
    driven: Collection[str],
) -> tuple[Rows, list[Coupling]]:
    """Determine how joints of an arm follow others.

    Args:
        file: The robot's file, for messages.
        bodies: All bodies of the robot.
        path: Bodies from the first to the tip.
        couplings: Linear equations between joints that the file states.
        driven: Joints with a motor; if there is a choice, the others follow these.

    Returns:
        The joints that follow others, and the couplings that do not concern the arm.

    Raises:
        InputError: If a loop is closed over a joint of the arm, an equation is not linear, a joint does not
            exist, or equations contradict each other.
    """
    chain = [joint.name for k in path if (joint := bodies[k].joint)]
    _check_loops(file, bodies, chain, couplings)
    left = _needed([own for own in couplings if own.bodies is None], set(chain), set(driven))
    used, known = list[Coupling](), set(chain)
    while more := [own for own in left if own.terms.keys() & known]:
        left = [own for own in left if not own.terms.keys() & known]
        used += more
        known |= {name for own in more for name in own.terms}
    for coupling in used:
        if coupling.bent:
            raise InputError(file, "", f"{coupling.label} is not linear; {STATE}")
    there = {body.joint.name for body in bodies if body.joint}
    if missing := sorted(known - there):
        raise InputError(file, "", f"no joint {missing[0]!r}, which others follow")
    followers = {own.follower for own in used}
    order = [body.joint.name for body in reversed(bodies) if body.joint and body.joint.name in known]
    order.sort(key=lambda name: (name in driven, name not in followers))
    return _solved(file, order, used), list(set(couplings) - set(used))


def _needed(left: list[Coupling], chain: set[str], driven: set[str]) -> list[Coupling]:
    """Drop couplings that only position a joint off the arm: a rod that follows the arm."""

    def is_spare(coupling: Coupling, count: Counter[str]) -> bool:
        takes = {name for name in coupling.terms if count[name] == 1} - chain
        if coupling.follower:
            return coupling.follower in takes
        return not coupling.bent and bool(takes - driven)

    while True:
        count = Counter(name for coupling in left for name in coupling.terms)
        kept = [coupling for coupling in left if not is_spare(coupling, count)]
        if len(kept) == len(left):
            return kept
        left = kept


def _check_loops(
    file: Path, bodies: Sequence[Body], chain: Collection[str], couplings: Sequence[Coupling]
) -> None:
    """Refuse bodies tied together over a joint of the arm; a free body tied once is allowed."""
    ties = [
        (own, _above(bodies, own.bodies[0]) ^ _above(bodies, own.bodies[1]))
        for own in couplings
        if own.bodies is not None
    ]
    floating = Counter(k for _, loop in ties for k in loop if bodies[k].odd)
    for coupling, loop in ties:
        over = {joint.name for k in loop if (joint := bodies[k].joint)}
        free = [k for k in loop if floating[k] == 1]
        if not free and (closed := [name for name in chain if name in over]):
            problem = (
                f"{coupling.label} closes a loop over the joint {closed[0]!r}, so the arm is no chain; "
                f"{STATE}"
            )
            raise InputError(file, "", problem)


def _above(bodies: Sequence[Body], k: int) -> set[int]:
    """List a body and those before it; -1 is the world."""
    found = set()
    while k >= 0:
        found.add(k)
        k = bodies[k].parent
    return found


def _solved(file: Path, order: Sequence[str], equations: Sequence[Coupling]) -> Rows:
    """Solve by Gauss-Jordan elimination: in each equation the first joint in the order is dependent."""
    A = np.array(
        [[*(coupling.terms.get(name, 0.0) for name in order), coupling.constant] for coupling in equations]
    )
    A = A.reshape(len(equations), len(order) + 1)
    pivots: list[int] = []
    for column in range(len(order)):
        row = len(pivots)
        if row == len(A):
            break
        best = row + int(np.argmax(np.abs(A[row:, column])))
        if abs(A[best, column]) <= ZERO_COEFFICIENT:
            continue
        A[[row, best]] = A[[best, row]]
        A[row] /= A[row, column]
        others = np.arange(len(A)) != row
        A[others] -= A[others, column, None] * A[row]
        pivots.append(column)
    if (np.abs(A[len(pivots) :, -1]) > ZERO_COEFFICIENT).any():
        raise InputError(file, "", f"{equations[0].label} and others contradict: no joints satisfy all")
    return {order[column]: _row(order, A[k], column) for k, column in enumerate(pivots)}


def _row(order: Sequence[str], row: Array, column: int) -> tuple[dict[str, float], float]:
    """Convert an equation, solved for a joint, to its coefficients and offset."""
    terms = {name: -round(float(c), DIGITS) + 0.0 for name, c in zip(order, row[:-1], strict=True)}
    del terms[order[column]]
    return {name: c for name, c in terms.items() if c}, round(float(row[-1]), DIGITS) + 0.0


def chain_map(file: Path, joints: Sequence[ImportedJoint], rows: Rows) -> JointMap | None:
    """Build the joint map of an arm's chain: its joints as a linear function of those that the motors drive.

    Args:
        file: The robot's file, for messages.
        joints: Joints of the chain, from base to tool.
        rows: Joints that follow others, as `map_of` returns them.

    Returns:
        The map; None if no joint of the chain follows others.

    Raises:
        InputError: If no map of an arm satisfies the equations.
    """
    own = {joint.name: rows[joint.name] for joint in joints if joint.name in rows}
    try:
        return build_map(
            joints, {name: row for name, (row, _) in own.items()}, {name: x for name, (_, x) in own.items()}
        )
    except BenchError as err:
        raise InputError(file, "", str(err)) from err
